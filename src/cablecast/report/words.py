"""Words about casts: why one is proposed, and what follows from its landing."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.aiming.session import (
    STUCK_COUNT,
    AimSession,
    RefitDue,
    RefitReason,
    Stop,
    StopReason,
)
from cablecast.cast import Cast, Proposal
from cablecast.conventions import xy_to_polar
from cablecast.motion.polar import PolarCast

DRIFT_NOTE = (
    "The last casts land elsewhere than earlier ones say: the cable, its grip or the camera has "
    "changed, or changes. Earlier casts count less from now on"
)
BLIND_NOTE = (
    "; the camera cannot tell the marker at the target from something else of its colour, so that "
    "casts land beside it"
)

# Steps of this many degrees, centimetres or hundredths of the pace, together, lead to another
# action.
_OTHER_ACTION = 12.0


def place_text(xy: NDArray[np.float64]) -> str:
    """Return a place on the table [m], shape [2], in polar coordinates."""
    r, theta = xy_to_polar(xy)
    return f"{r:.2f} m, {math.degrees(theta):.0f}°"


def verdict_text(tries: Sequence[Sequence[Cast]], beyond_count: int = 0) -> str:
    """Return how many targets were hit, and what became of the others.

    >>> verdict_text([[], []], 1)
    '0 of 3 targets were hit; 2 were not cast at, 1 is out of reach'

    Args:
        tries: Casts at each target.
        beyond_count: Number of further targets that are out of reach.
    """
    hit = sum(any(cast.hit for cast in casts) for casts in tries)
    uncast = sum(not casts for casts in tries)
    others = (
        (len(tries) - hit - uncast, "was missed", "were missed"),
        (uncast, "was not cast at", "were not cast at"),
        (beyond_count, "is out of reach", "are out of reach"),
    )
    text = f"{hit} of {len(tries) + beyond_count} targets were hit"
    words = [f"{count} {one if count == 1 else many}" for count, one, many in others if count]
    return text + "; " * bool(words) + ", ".join(words)


def region_text(proposal: Proposal, share: float) -> str:
    """Return the axes of the region that holds a share of the landings [-], e.g. 90 %."""
    axes = 2.0 * proposal.expected.ellipse(share).semi_axes
    table = proposal.setup.workspace
    if axes.min() > max(table.table_width, table.table_depth):
        return "a region larger than the table"
    centimetres = " by ".join(f"{100 * axis:.0f}" for axis in axes)
    percent = " by ".join(f"{100 * axis / proposal.setup.cable.length:.0f}" for axis in axes)
    return f"{centimetres} cm ({percent} %)"


def motion_text(proposal: Proposal) -> str:
    """Return how long a motion takes, and its pace where that is not the paper's."""
    action, duration = proposal.action, f"{proposal.trajectory.duration:.2f} s"
    if isinstance(action, PolarCast):
        return f"{duration}, {action}"
    pace = action.to_array()[-1]
    return duration if pace == 1.0 else f"{duration}, a pace of {pace:.2f}"


def outlook_text(proposal: Proposal) -> str:
    """Return what to expect of a cast that is unlikely to hit."""
    wide, narrow = 200.0 * proposal.expected.ellipse().semi_axes
    miss, length = proposal.expected_miss, proposal.setup.cable.length
    # A cast that was found by search may land near a target that no candidate comes near.
    far = not proposal.inside_coverage and 100.0 * miss > proposal.goal.within_pct
    return "no simulated cast of this cable lands near this target, and " * far + (
        f"the next cast would hit it with a chance of {100 * proposal.hit_chance:.0f} %: it is "
        f"expected {100.0 * miss * length:.1f} cm off the target, somewhere in "
        f"{wide:.0f} by {narrow:.0f} cm"
    )


def refit_text(due: RefitDue) -> str:
    """Return why the simulator should be fitted anew."""
    count = "none" if due.reason is RefitReason.FIRST_FIT else str(due.fitted_count)
    text = f"{due.cast_count} casts are known, and the simulator is fitted to {count}"
    if due.reason is RefitReason.POOR_FIT:
        return f"{text}, and follows them to {100.0 * due.size:.1f} % of cable length only"
    if due.reason is RefitReason.FAR_OFF:
        return f"{text}; first tries land {due.size:.1f} times as far off as was stated"
    return text


def stop_text(stop: Stop) -> str:
    """Return why a proposed cast is not worth making."""
    goal = stop.proposal.goal
    why = outlook_text(stop.proposal)
    if stop.reason is StopReason.STUCK:
        why = f"none of the last {STUCK_COUNT} casts came nearer"
    r, theta = xy_to_polar(stop.nearest)
    miss = 100.0 * float(goal.miss(stop.nearest)) * goal.setup.cable.length
    return (
        f"{why}; the nearest landing of a {'simulated ' * stop.is_simulated}cast is "
        f"r = {r:.2f} m, theta = {np.degrees(theta):.1f} deg, {miss:.0f} cm off the target"
    )


def reason_text(proposal: Proposal, session: AimSession) -> str:
    """Return why an action is proposed."""
    earlier = [
        cast for cast in session.casts_at(proposal.goal.value) if cast.number < proposal.number
    ]
    reason = _reason(earlier, proposal)
    if session.sight is not None and session.sight.is_blind_at(proposal.goal.value):
        reason += BLIND_NOTE
    return reason


def _reason(earlier: list[Cast], proposal: Proposal) -> str:
    if not earlier:
        return f"first cast at this target, after {proposal.number} casts of this cable"
    action = proposal.action
    landed = [
        (cast.try_number, cast.action.to_array())
        for cast in earlier
        if cast.landed and cast.action is not None and cast.action.family == action.family
    ]
    if not landed:
        return "another action, since no cast like it has landed"
    if isinstance(action, PolarCast):
        number, last = landed[-1]
        azimuth, x, y = action.to_array() - last
        return (
            f"try {number} with the azimuth {math.degrees(azimuth):+.1f} deg, the end of the pull "
            f"{100 * x:+.1f} cm in x and {100 * y:+.1f} cm in y"
        )
    units = np.array([57.3, 57.3, 100.0, 57.3, 100.0])
    steps = [action.to_array() - values for _, values in landed]
    sizes = [float(np.linalg.norm(step * units)) for step in steps]
    nearest = int(np.argmin(sizes))
    if sizes[nearest] > _OTHER_ACTION:
        return "another action, which is expected to land nearer than a correction of the last"
    theta1, theta2, r2, psi, pace = steps[nearest]
    return (
        f"try {landed[nearest][0]} with theta1 {math.degrees(theta1):+.1f} deg, theta2 "
        f"{math.degrees(theta2):+.1f} deg, r2 {100 * r2:+.1f} cm, psi {math.degrees(psi):+.1f} deg"
        + (f", pace {pace:+.2f}" if round(pace, 2) else "")
    )


def change_text(cast: Cast, session: AimSession) -> str:
    """Return what follows from the last cast of a session, which was aimed."""
    note = f"{cast.track.note}. " if cast.track.note else ""
    if not cast.landed:
        return f"{note}no landing: actions like this one are avoided from now on"
    # The simulators take a step only for a cast that follows.
    done = session.is_done(cast.target_xy)
    predictor = session.predictor if done else session.predictor_at(cast.target_xy)
    xy, scatter = predictor.moved(cast)
    moved = 100.0 * (xy - cast.expected_xy)
    text = (
        f"{note}the expected landing of this action moves by {moved[0]:+.1f} cm in x and "
        f"{moved[1]:+.1f} cm in y; equal casts scatter by {100.0 * scatter:.1f} cm"
    )
    return f"{text}. {DRIFT_NOTE}" if session.drifted else text
