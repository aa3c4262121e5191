"""Refinement: small changes of actions that move their predicted landings onto the targets."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cablecast.motion.action import PSI_MAX, THETA_MAX, THETA_MIN
from cablecast.motion.feasibility import check_actions
from cablecast.motion.mirrored import played, rightward, to_right

ITERATION_COUNT = 2
"""Number of Newton steps; the second lands within 0.1 % of the cable's length of the target."""

# Longest step in units of DEVIATION. Beyond it the landing is not linear in the action. Longer
# steps are not needed: neighbouring candidates of the grid are about 5 degrees and 3 cm apart.
_STEP_MAX = 2.0


class Landings(Protocol):
    """Interface of models for refinement; see `LandingModel`."""

    setup: Any

    def predict(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Predict landings [m], shape [action, 2]."""
        ...

    def landing_shifts(
        self, actions: NDArray[np.float64], changes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the shift of the landing for each change of an action, [action, 2, change]."""
        ...

    def predict_margin(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Predict the distance that the free end keeps from the table's edges [m]."""
        ...


def refine_actions(
    actions: NDArray[np.float64],
    target_xy: NDArray[np.float64],
    changes: NDArray[np.float64],
    *,
    model: Landings,
    table_margin: float,
    iterations: int = ITERATION_COUNT,
    fractions: Sequence[float] = (1.0,),
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Move the predicted landings onto the targets by the smallest changes of the actions.

    Many changes of the four variables move the landing to the same point of the plane. Each Newton
    step takes the smallest of them, in units of `DEVIATION`. If the arm could not follow the
    refined action, or the free end would leave the table, the action is left unchanged.

    Args:
        actions: Feasible actions for either side, shape [target, 4].
        target_xy: Targets [m], shape [target, 2].
        changes: Perturbations of an action, see `deviations`, shape [change, 4].
        model: Model of landings, valid for theta2 > 0.
        table_margin: Distance that the free end must keep within the table's edges [m].
        iterations: Number of Newton steps.
        fractions: Parts of the way that are tried in turn until the arm can follow.

    Returns:
        Actions and their predicted landings [m], shapes [target, 4] and [target, 2].
    """
    start, hands = rightward(actions)
    targets = to_right(target_xy, hands)
    start_xy = model.predict(start)
    moved, moved_xy = start.copy(), start_xy
    for _ in range(iterations):
        shifts = model.landing_shifts(moved, changes)
        step = (np.linalg.pinv(shifts, rcond=1e-3) @ (targets - moved_xy)[..., None])[..., 0]
        length = np.linalg.norm(step, axis=1, keepdims=True)
        step *= np.minimum(1.0, _STEP_MAX / np.maximum(length, 1e-12))
        moved += step @ changes
        moved = within_ranges(moved)
        moved_xy = model.predict(moved)
    final, final_xy = start.copy(), start_xy.copy()
    left_over = np.ones(len(start), dtype=bool)
    start_miss = np.linalg.norm(start_xy - targets, axis=1)
    for fraction in fractions:
        tried = moved if fraction == 1.0 else within_ranges(start + fraction * (moved - start))
        tried_xy = moved_xy if fraction == 1.0 else model.predict(tried)
        taken = left_over & (np.linalg.norm(tried_xy - targets, axis=1) < start_miss)
        if np.any(taken):
            rows = np.flatnonzero(taken)
            stays = model.predict_margin(tried[rows]) >= table_margin
            taken[rows] = stays & check_actions(tried[rows], model.setup).mask
        final[taken], final_xy[taken] = tried[taken], tried_xy[taken]
        left_over &= ~taken
    return played(final, hands), to_right(final_xy, hands)


def within_ranges(actions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return actions to the right whose angles are clipped to their bounds."""
    clipped = actions.copy()
    clipped[:, 0] = np.clip(actions[:, 0], -THETA_MAX, -THETA_MIN)
    clipped[:, 1] = np.clip(actions[:, 1], THETA_MIN, THETA_MAX)
    clipped[:, 3] = np.clip(actions[:, 3], clipped[:, 1], PSI_MAX)
    return clipped
