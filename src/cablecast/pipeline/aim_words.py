"""Words of a session: why an action was chosen, and what a cast taught."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.aiming.choice import LandingPredictor
from cablecast.pipeline.aim_casts import AimProposal, AimTrial

DRIFT_NOTE = (
    "The last casts land elsewhere than earlier ones say: the cable, its grip or the camera has "
    "changed, or changes. Earlier casts count less from now on"
)
"""Sentence that tells of a drift."""

BLIND_NOTE = (
    "; the camera cannot tell the marker at the target from something else of its colour, so that "
    "casts land beside it"
)
"""End of the reason of a cast at a target that the camera is blind at."""

# Steps of this many degrees or centimetres, together, lead to another action.
_OTHER_ACTION = 12.0


def reason_text(action: NDArray[np.float64], earlier: Sequence[AimTrial], known_count: int) -> str:
    """Return why an action was chosen, in words.

    Args:
        action: Action, shape [4].
        earlier: Casts at the same target.
        known_count: Number of casts of the session.
    """
    landed = [trial for trial in earlier if np.all(np.isfinite(trial.final_xy))]
    if not earlier:
        return f"first cast at this target, after {known_count} casts of this cable"
    if not landed:
        return "another action, since the last one had no landing"
    step = [_step(action, trial.action) for trial in landed]
    nearest = landed[int(np.argmin(step))]
    if min(step) > _OTHER_ACTION:
        return "another action, which is expected to land nearer than a correction of the last"
    theta1, theta2, r2, psi = action - nearest.action
    return (
        f"try {nearest.try_number} with theta1 {math.degrees(theta1):+.1f} deg, theta2 "
        f"{math.degrees(theta2):+.1f} deg, r2 {100 * r2:+.1f} cm, psi {math.degrees(psi):+.1f} deg"
    )


def change_text(proposal: AimProposal, trial: AimTrial, predictor: LandingPredictor) -> str:
    """Return what a cast taught, in words.

    Args:
        proposal: Plan of the cast.
        trial: Cast.
        predictor: Predictor of landings that has learned from it.
    """
    if not np.all(np.isfinite(trial.final_xy)):
        return "no landing: actions like this one are avoided from now on"
    xy, _, scatter = predictor.predict(proposal.action.to_array())
    moved = 100.0 * (xy[0] - proposal.expected_xy)
    scatter_pct = 100.0 * scatter[0] / predictor.length
    return (
        f"the expected landing of this action moves by {moved[0]:+.1f} cm in x and "
        f"{moved[1]:+.1f} cm in y; its scatter is {scatter_pct:.1f} % of the cable's length"
    )


def _step(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return the size of the step between two actions in degrees and centimetres."""
    offset = (first - second) * np.array([57.3, 57.3, 100.0, 57.3])
    return float(np.linalg.norm(offset))
