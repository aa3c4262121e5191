"""EnsembleLandings: where simulators of different physics land the same casts, and how far apart.

All of them follow the casts that they were fitted to. Where they part, the physics matters that
those casts do not tell, and each is as likely to be right as the others. So their mean is a better
guess than any of them, and their spread says how far off it may be (docs/aim.md).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.dynamics import Dynamics
from cablecast.engines.base import Engine
from cablecast.motion.cast import cast_grip_paths
from cablecast.setup import Setup

OWN_MISS, SPREAD_FACTOR = 0.05, 1.25
"""A landing misses by about the spread of the ensemble times a factor, and by a part of its own
[cable lengths]. Told by landings at 224 targets of the virtual rig: with them, 56 % and 89 % of
the landings lie in regions of 50 % and 90 %."""

# Farther apart than this nothing is known of a landing, by however much more [cable lengths].
_APART_MAX = 1.0


class EnsembleLandings:
    """Casts to the right in several simulators. What was simulated once is kept.

    Args:
        setup: Cable, workspace, arm and motion settings.
        members: Parameters, material and servo of each simulator. The landings of the first one are
            known otherwise: the others shift them.
        engine: Engine that simulates them.
    """

    def __init__(self, setup: Setup, members: Sequence[Dynamics], engine: Engine):
        self.setup = setup
        self.members = tuple(members)
        self.engine = engine
        self._known: dict[bytes, tuple[float, float, float]] = {}

    def landings(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where each simulator lands each cast [m], shape [member, action, 2].

        Args:
            actions: Actions to the right, shape [action, 4].

        Returns:
            Landings; NaN where a simulation broke off.
        """
        paths = cast_grip_paths(actions, self.setup)
        return np.stack(
            [
                member.rollout(self.engine, self.setup, paths).endpoint_xy[:, -1]
                for member in self.members
            ]
        )

    def judge(
        self, actions: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what the ensemble adds to the landings of the first simulator.

        Args:
            actions: Actions to the right, shape [action, 4].

        Returns:
            Shifts and sizes; see `judged`.
        """
        keys = [action.tobytes() for action in np.ascontiguousarray(actions, dtype=float)]
        row_of = {key: row for row, key in enumerate(keys) if key not in self._known}
        if row_of:
            new = np.array(list(row_of.values()))
            shifts, sizes = judged(self.landings(actions[new]) / self.setup.cable.length)
            rows = np.column_stack([shifts, sizes])
            self._known.update(zip(row_of, map(tuple, rows), strict=True))
        known = np.array([self._known[key] for key in keys]).reshape(-1, 3)
        return known[:, :2], known[:, 2]


def judged(landings: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what landings in several simulators say of a cast.

    Args:
        landings: Landings [cable lengths], shape [member, action, 2]; NaN where there is none.

    Returns:
        Shift from the landing of the first simulator to the mean of all, shape [action, 2], and
        standard deviation along each axis of a real landing about it, shape [action]; [cable
        lengths].
    """
    there: NDArray[np.bool_] = np.all(np.isfinite(landings), axis=2)
    count = np.maximum(there.sum(axis=0), 1)
    known = np.where(there[..., None], landings, 0.0)
    mean = known.sum(axis=0) / count[:, None]
    shift = np.where(there[0][:, None], mean - known[0], 0.0)
    apart = np.minimum(np.linalg.norm(landings - mean, axis=2), _APART_MAX)
    # A simulation that broke off knows nothing.
    apart = np.where(there, apart, _APART_MAX)
    spread = np.sqrt(0.5 * np.mean(apart**2, axis=0))
    return shift, np.hypot(OWN_MISS, SPREAD_FACTOR * spread)
