"""EnsembleLandings: where simulators of different physics land the same casts, and how far apart.

All of them follow the casts that they were fitted to. Where they part, the physics matters that
those casts do not tell, and each is as likely to be right as the others. So their mean is a better
guess than any of them, and their spread says how far off it may be (docs/aim.md).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.dynamics import Dynamics
from cablecast.engines.base import Engine
from cablecast.motion.cast import cast_grip_paths
from cablecast.setup import Setup
from cablecast.tuning.objective import TrackObjective
from cablecast.tuning.posterior import ParamPosterior
from cablecast.tuning.tracks import MeasuredTracks
from cablecast.tuning.update import updated_params

OWN_MISS, SPREAD_FACTOR = 0.05, 1.25
"""A landing misses by about the spread of the ensemble times a factor, and by a part of its own
[cable lengths]. Chosen by landings at targets in laboratories 0 and 1 of the virtual rig;
docs/aim.md has the share of landings that lie in the regions that are stated with them."""

# Farther apart than this nothing is known of a landing, by however much more [cable lengths].
_APART_MAX = 1.0
# Between samples the free end moves by some centimetres where it turns at the back [s].
_SAMPLE_DT = 0.05


@dataclasses.dataclass(frozen=True, kw_only=True)
class Judgement:
    """Judgement of an ensemble on some casts.

    Attributes:
        shifts: From the landing in the reference simulator to the mean of all [cable lengths],
            shape [action, 2].
        sizes: Standard deviation along each axis of a real landing about that mean [cable lengths],
            shape [action].
        leaving: Share of the simulators in which the free end passes an edge of the table [-],
            shape [action].
    """

    shifts: NDArray[np.float64]
    sizes: NDArray[np.float64]
    leaving: NDArray[np.float64]


class EnsembleLandings:
    """Casts to the right in several simulators. What was simulated once is kept.

    Args:
        setup: Cable, workspace, arm and motion settings.
        members: Parameters, material and servo of each simulator. The landings of the first one are
            known otherwise: the others shift them.
        engine: Engine that simulates them.
        posterior: Uncertainty of the first one's parameters; None for simulators that do not learn.
        reference: Simulator that landings are known of otherwise; the first member where None.
    """

    def __init__(
        self,
        setup: Setup,
        members: Sequence[Dynamics],
        engine: Engine,
        posterior: ParamPosterior | None = None,
        reference: Dynamics | None = None,
    ):
        self.setup = setup
        self.members = tuple(members)
        self.engine = engine
        self.posterior = posterior
        self.reference = reference
        self._known: dict[bytes, tuple[float, ...]] = {}

    def tracks(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how the free end moves in each simulator [m], shape [member, action, sample, 2].

        Args:
            actions: Actions to the right, shape [action, 4].

        Returns:
            Positions every `_SAMPLE_DT`, the landing last; NaN where a simulation broke off.
        """
        return self._tracks(self.members, actions)

    def _tracks(
        self, members: Sequence[Dynamics], actions: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        paths = cast_grip_paths(actions, self.setup)
        rollouts = [
            member.rollout(self.engine, self.setup, paths, sample_dt=_SAMPLE_DT)
            for member in members
        ]
        return np.stack([rollout.endpoint_xy for rollout in rollouts])

    def taught(self, tracks: MeasuredTracks) -> "EnsembleLandings":
        """Return the simulators after they learned from a few casts more.

        Each takes one step from its parameters towards the tracks (`updated_params`). Simulators
        without a posterior stay as they are.

        Args:
            tracks: Casts that they were not fitted to.
        """
        if self.posterior is None or not tracks.compared.any():
            return self
        members = []
        for member in self.members:
            cable = self.setup.cable
            if member.material is not None:
                cable = cable.with_material(member.material)
            objective = TrackObjective(self.engine, cable, tracks)
            members.append(
                member.with_params(updated_params(objective, self.posterior, member.params))
            )
        reference = self.reference or self.members[0]
        return EnsembleLandings(self.setup, members, self.engine, self.posterior, reference)

    def judge(self, actions: NDArray[np.float64]) -> Judgement:
        """Return what the ensemble adds to the landings of the reference.

        Args:
            actions: Actions to the right, shape [action, 4].
        """
        keys = [action.tobytes() for action in np.ascontiguousarray(actions, dtype=float)]
        row_of = {key: row for row, key in enumerate(keys) if key not in self._known}
        if row_of:
            some = actions[list(row_of.values())]
            reference = None
            if self.reference is not None:
                reference = self._tracks((self.reference,), some)[0, :, -1]
            new = judged(self.tracks(some), self.setup, reference)
            rows = np.column_stack([new.shifts, new.sizes, new.leaving])
            self._known.update(zip(row_of, map(tuple, rows), strict=True))
        known = np.array([self._known[key] for key in keys]).reshape(-1, 4)
        return Judgement(shifts=known[:, :2], sizes=known[:, 2], leaving=known[:, 3])


def judged(
    tracks: NDArray[np.float64], setup: Setup, reference_xy: NDArray[np.float64] | None = None
) -> Judgement:
    """Return what tracks in several simulators say of casts.

    Args:
        tracks: Positions of the free end [m], shape [member, action, sample, 2]; NaN where a
            simulation broke off.
        setup: Gives the table and the cable.
        reference_xy: Landings that shifts lead from [m], shape [action, 2]; those in the first
            simulator where None.
    """
    landings = tracks[:, :, -1] / setup.cable.length
    there: NDArray[np.bool_] = np.all(np.isfinite(landings), axis=2)
    count = np.maximum(there.sum(axis=0), 1)
    known = np.where(there[..., None], landings, 0.0)
    mean = known.sum(axis=0) / count[:, None]
    first = landings[0] if reference_xy is None else reference_xy / setup.cable.length
    told: NDArray[np.bool_] = np.all(np.isfinite(first), axis=1) & np.any(there, axis=0)
    shifts = np.where(told[:, None], mean - first, 0.0)
    apart = np.minimum(np.linalg.norm(landings - mean, axis=2), _APART_MAX)
    # A simulation that broke off knows nothing.
    apart = np.where(there, apart, _APART_MAX)
    spread = np.sqrt(0.5 * np.mean(apart**2, axis=0))
    passed = np.any(setup.workspace.edge_distance(tracks) < 0.0, axis=2)
    return Judgement(
        shifts=shifts,
        sizes=np.hypot(OWN_MISS, SPREAD_FACTOR * spread),
        leaving=passed.mean(axis=0),
    )
