"""Refinement: small changes of actions that move their predicted landings onto the targets."""

import numpy as np
from numpy.typing import NDArray

from cablecast.conventions import mirror_xy
from cablecast.models.landing import LandingModel
from cablecast.motion.action import PSI_MAX, THETA_MAX, THETA_MIN, mirror_actions
from cablecast.motion.feasibility import check_actions

ITERATION_COUNT = 2
"""Number of Newton steps; the second lands within 0.1 % of the cable's length of the target."""

# Longest step in units of DEVIATION. Beyond it the landing is not linear in the action. Longer
# steps are not needed: neighbouring candidates of the grid are about 5 degrees and 3 cm apart.
_STEP_MAX = 2.0


def refine_actions(
    actions: NDArray[np.float64],
    target_xy: NDArray[np.float64],
    changes: NDArray[np.float64],
    *,
    model: LandingModel,
    table_margin: float,
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

    Returns:
        Actions and their predicted landings [m], shapes [target, 4] and [target, 2].
    """
    left = actions[:, 1:2] < 0
    start = np.where(left, mirror_actions(actions), actions)
    targets = np.where(left, mirror_xy(target_xy), target_xy)
    start_xy = model.predict(start)
    moved, moved_xy = start.copy(), start_xy
    for _ in range(ITERATION_COUNT):
        shifts = model.landing_shifts(moved, changes)
        step = (np.linalg.pinv(shifts, rcond=1e-3) @ (targets - moved_xy)[..., None])[..., 0]
        length = np.linalg.norm(step, axis=1, keepdims=True)
        step *= np.minimum(1.0, _STEP_MAX / np.maximum(length, 1e-12))
        moved += step @ changes
        moved[:, 0] = np.clip(moved[:, 0], -THETA_MAX, -THETA_MIN)
        moved[:, 1] = np.clip(moved[:, 1], THETA_MIN, THETA_MAX)
        moved[:, 3] = np.clip(moved[:, 3], moved[:, 1], PSI_MAX)
        moved_xy = model.predict(moved)
    nearer = np.linalg.norm(moved_xy - targets, axis=1) < np.linalg.norm(start_xy - targets, axis=1)
    if np.any(nearer):
        rows = np.flatnonzero(nearer)
        stays = model.predict_margin(moved[rows]) >= table_margin
        feasible = check_actions(moved[rows], model.setup).mask
        nearer[rows] = stays & feasible
    final = np.where(nearer[:, None], moved, start)
    final_xy = np.where(nearer[:, None], moved_xy, start_xy)
    return (
        np.where(left, mirror_actions(final), final),
        np.where(left, mirror_xy(final_xy), final_xy),
    )
