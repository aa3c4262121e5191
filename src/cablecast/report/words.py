"""Words about casts: why one is proposed, and what follows from its landing."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.aiming.propose import hit_chances
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
from cablecast.motion.joint_move import JointMove
from cablecast.motion.polar import PolarCast

# Steps of this many degrees, centimetres or hundredths of the pace, together, lead to another
# action.
_OTHER_ACTION = 12.0

# Such steps that are small, and misses that are large [cable lengths].
_SMALL_STEP, _LARGE_MISS = 3.0, 0.1


def place_text(xy: NDArray[np.float64]) -> str:
    """Return a place on the table [m], shape [2], in polar coordinates."""
    r, theta = xy_to_polar(xy)
    return f"{r:.2f} m, {math.degrees(theta):z.0f}°"


def miss_text(cast: Cast) -> str:
    """Return how far an aimed cast came from its goal, or why it has no outcome.

    >>> from cablecast.cast import EndpointTrack, TrialStatus
    >>> unseen = EndpointTrack.unseen(TrialStatus.OFF_TABLE)
    >>> miss_text(Cast(action=None, duration=1.0, joint_path=None, track=unseen, purpose="aim"))
    'off table'
    """
    if cast.goal is None or not math.isfinite(cast.miss_pct):
        return cast.status.words
    return f"{cast.miss_pct * cast.goal.setup.cable.length:.1f} cm"


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


def counted(count: int, noun: str) -> str:
    """Return a number of things.

    >>> counted(1, "cast"), counted(0, "target")
    ('1 cast', '0 targets')
    """
    return f"{count} {noun}{'s' * (count != 1)}"


def chance_text(chance: float) -> str:
    """Return a probability [-] in words.

    >>> chance_text(0.333), chance_text(0.002), chance_text(0.999)
    ('33 %', 'less than 1 %', 'more than 99 %')
    """
    if chance < 0.005:
        return "less than 1 %"
    return "more than 99 %" if chance > 0.995 else f"{100.0 * chance:.0f} %"


def hit_text(proposal: Proposal, tries: int) -> str:
    """Return the chance of a hit with a cast, and with the last of so many tries at its goal.

    How the tries of swings go on is not known.
    """
    text, left = chance_text(proposal.hit_chance), tries - proposal.try_number + 1
    if left < 2 or isinstance(proposal.action, JointMove):
        return text
    chances = hit_chances(
        proposal.expected, proposal.goal, proposal.action.family, left, proposal.try_number
    )
    return f"{text}, within {left} tries {chance_text(chances[-1])}"


def distance_text(proposal: Proposal) -> str:
    """Return how far from its target a cast will land: half of such casts, and nine of ten."""
    goal, length = proposal.goal, proposal.setup.cable.length
    half, most = (100.0 * length * proposal.expected.miss_within(goal, p) for p in (0.5, 0.9))
    return f"most likely {half:.1f} cm off the target, nine of ten within {most:.1f} cm"


def floor_text(scatter: float) -> str:
    """Return how far apart equal casts of some deviation [m] land, which no correction changes."""
    # Half of the draws of a round normal distribution lie within this multiple of its deviation.
    floor = 100.0 * scatter * math.sqrt(2.0 * math.log(2.0))
    return f"equal casts scatter by about {floor:.1f} cm"


def motion_text(proposal: Proposal) -> str:
    """Return how long a motion takes, and its pace where that is not the paper's."""
    action, duration = proposal.action, f"{proposal.trajectory.duration:.2f} s"
    if isinstance(action, PolarCast):
        return f"{duration}, {action}"
    if isinstance(action, JointMove):
        return duration
    pace = action.to_array()[-1]
    return duration if pace == 1.0 else f"{duration}, a pace of {pace:.2f}"


def outlook_text(proposal: Proposal) -> str:
    """Return what to expect of a cast that is unlikely to hit."""
    # A cast that was found by search may land near a target that no candidate comes near.
    far = 100.0 * proposal.expected_miss > proposal.goal.within_pct
    nowhere = "no simulated cast of this cable lands near this target, and "
    return nowhere * (far and not proposal.inside_coverage) + (
        f"the next cast has a chance of {chance_text(proposal.hit_chance)} to hit it: "
        f"{distance_text(proposal)}"
    )


def refit_text(due: RefitDue) -> str:
    """Return why the simulator should be fitted anew."""
    count = "none" if due.reason is RefitReason.FIRST_FIT else str(due.fitted_count)
    text = f"{due.cast_count} casts are known, and the simulator is fitted to {count}"
    if due.reason is RefitReason.FAR_OFF:
        return f"{text}; first tries land {due.size:.1f} times as far off as was stated"
    return text


def stop_text(stop: Stop) -> str:
    """Return why a proposed cast is not worth making."""
    goal = stop.proposal.goal
    miss = 100.0 * float(goal.miss(stop.nearest)) * goal.setup.cable.length
    why = outlook_text(stop.proposal)
    if stop.reason is StopReason.STUCK and stop.is_simulated:
        return (
            f"none of the last {STUCK_COUNT} casts has a landing, though a simulated one lands "
            f"{miss:.1f} cm off the target"
        )
    if stop.reason is StopReason.STUCK:
        why = f"none of the last {STUCK_COUNT} casts came nearer"
    elif stop.reason is StopReason.IN_VAIN:
        why = (
            "the last two casts missed far in one direction, whatever was corrected: something "
            "here is not as in the simulator. Check the grip, the camera, and the values of the "
            "cable, or choose another target"
        )
    r, theta = xy_to_polar(stop.nearest)
    return (
        f"{why}; the nearest landing of a {'simulated ' * stop.is_simulated}cast is "
        f"r = {r:.2f} m, theta = {np.degrees(theta):z.1f} deg, {miss:.1f} cm off the target"
    )


def reason_text(proposal: Proposal, session: AimSession) -> str:
    """Return why an action is proposed."""
    earlier = [
        cast for cast in session.casts_at(proposal.goal.value) if cast.number < proposal.number
    ]
    reason = _reason(earlier, proposal)
    if session.sight is not None and session.sight.is_blind_at(proposal.goal.value):
        reason += (
            "; the camera cannot tell the marker at the target from something else of its colour, "
            "so that casts land off it"
        )
    return reason


def _reason(earlier: list[Cast], proposal: Proposal) -> str:
    if not earlier:
        return f"first cast at this target, after {counted(proposal.number, 'cast')} of this cable"
    action = proposal.action
    landed = [
        (cast, cast.action.to_array())
        for cast in earlier
        if cast.landed and cast.action is not None and cast.action.family == action.family
    ]
    if not landed:
        if any(cast.landed for cast in earlier):
            return "another kind of motion, which is expected to land nearer"
        return "another action, since none has landed yet"
    if isinstance(action, PolarCast):
        last, values = landed[-1]
        azimuth, x, y, pace = action.to_array() - values
        turn, right, away = math.degrees(azimuth), 100.0 * x, 100.0 * y
        small = math.hypot(turn, right, away) < _SMALL_STEP
        return (
            f"try {last.try_number} with the azimuth {turn:+z.1f} deg, the end of the pull "
            f"{right:+z.1f} cm in x and {away:+z.1f} cm in y"
            + (f", pace {pace:+.2f}" if round(pace, 2) else "")
            + (small_step_text(proposal, last) if small else "")
        )
    units = np.array([57.3, 57.3, 100.0, 57.3, 100.0])
    steps = [action.to_array() - values for _, values in landed]
    sizes = [float(np.linalg.norm(step * units)) for step in steps]
    nearest = int(np.argmin(sizes))
    if sizes[nearest] > _OTHER_ACTION:
        return "another action, which is expected to land nearer than a correction of the last"
    r2, pace = 100.0 * steps[nearest][2], steps[nearest][4]
    theta1, theta2, psi = np.degrees(steps[nearest][[0, 1, 3]])
    why = small_step_text(proposal, landed[nearest][0]) if sizes[nearest] < _SMALL_STEP else ""
    return (
        f"try {landed[nearest][0].try_number} with theta1 {theta1:+z.1f} deg, theta2 "
        f"{theta2:+z.1f} deg, r2 {r2:+z.1f} cm, psi {psi:+z.1f} deg"
        + (f", pace {pace:+.2f}" if round(pace, 2) else "")
        + why
    )


def moved_text(moved: NDArray[np.float64]) -> str:
    """Return by how much the landing that is expected of a motion has moved [cm], shape [2].

    >>> moved_text(np.array([-4.5, 1.7]))
    'the same motion is now expected 4.5 cm farther left and 1.7 cm farther away than before'
    """
    right, away = (float(value) for value in moved)
    return (
        f"the same motion is now expected {abs(right):.1f} cm farther "
        f"{'right' if right >= 0 else 'left'} and {abs(away):.1f} cm "
        f"{'farther away' if away >= 0 else 'nearer'} than before"
    )


def small_step_text(proposal: Proposal, last: Cast) -> str:
    """Return why a small correction follows a large miss; empty for a small one."""
    goal, length = proposal.goal, proposal.setup.cable.length
    miss = float(goal.miss(last.outcome))
    if miss < _LARGE_MISS:
        return ""
    moves = float(goal.task.miss(proposal.expected.mean, last.outcome, proposal.setup))
    text = f", a small change after a miss of {100.0 * miss * length:.0f} cm: "
    if moves >= 0.5 * miss:
        return text + f"it is expected to move the landing by {100.0 * moves * length:.0f} cm"
    if proposal.expected_miss >= 0.5 * miss:
        return text + "nothing that the arm can do is expected to land much nearer"
    return text + "most of that miss is taken for chance"


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
    text = f"{note}{moved_text(moved)}; {floor_text(scatter)}"
    if session.drifted:
        text += (
            ". The last casts land elsewhere than earlier ones say: the cable, its grip or the "
            "camera has changed, or changes. Earlier casts count less from now on"
        )
    return text
