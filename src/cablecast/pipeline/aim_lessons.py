"""Lessons near a target: casts that simulators learn from before the next one is chosen."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.aiming.choice import Aimer
from cablecast.data.store import CastStore
from cablecast.pipeline.aim_casts import SAME_TARGET, AimTrial
from cablecast.tuning.tracks import MeasuredTracks

LESSON_COUNT = 8
"""Casts that the simulators learn from at most: a step takes the longer, the more there are."""


class Lessons:
    """The aimer at a target, whose simulators learned from the casts near it; the last is kept.

    Args:
        store: Casts of the session.
    """

    def __init__(self, store: CastStore):
        self.store = store
        self._known: tuple[Aimer, int, list[int], tuple[float, ...]] | None = None
        self._taught: Aimer | None = None

    def aimer_at(
        self, target_xy: NDArray[np.float64], aimer: Aimer, trials: Sequence[AimTrial]
    ) -> Aimer:
        """Return an aimer that knows what another one does, and whose simulators learned.

        Args:
            target_xy: Target [m], shape [2].
            aimer: Aimer that learned from all casts.
            trials: Casts of the store that may teach the simulators.
        """
        rows = rows_near(trials, target_xy)
        if not rows:
            return aimer
        known = aimer, len(self.store), rows, tuple(target_xy)
        if self._taught is None or self._known != known:
            some = CastStore(self.store.setup)
            some.casts = [self.store.casts[row] for row in rows]
            tracks = MeasuredTracks.from_dataset(some.dataset())
            self._known, self._taught = known, aimer.taught(tracks, target_xy)
        return self._taught


def rows_near(trials: Sequence[AimTrial], target_xy: NDArray[np.float64]) -> list[int]:
    """Return the numbers of the casts that tell most of a target, in ascending order.

    Those that were aimed at it come first, the latest before earlier ones, then those that landed
    nearest to it.

    Args:
        trials: Casts to choose from.
        target_xy: Target [m], shape [2].
    """
    aimed, landed = [], []
    for trial in trials:
        if np.linalg.norm(trial.target_xy - target_xy) < SAME_TARGET:
            aimed.append(trial.number)
        elif np.all(np.isfinite(trial.final_xy)):
            landed.append((float(np.linalg.norm(trial.final_xy - target_xy)), trial.number))
    chosen = [*reversed(aimed), *(number for _, number in sorted(landed))]
    return sorted(chosen[:LESSON_COUNT])
