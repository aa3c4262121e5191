"""Plays a motion set point by set point from a process of its own, the other mode of a cast.

The controller's clock does not carry the motion here: set points arrive over the network, and a
computer that is busy lets the arm stutter. So the way that the controller says it follows is
compared with the one that was meant, and a cast that differs is aborted.
"""

import queue
import time

import numpy as np

from cablecast.errors import RigError
from cablecast.rigs.ur.link import Report, UrLink
from cablecast.rigs.ur.path import SetPoints
from cablecast.rigs.ur.program import STOP_DECELERATION

BEGIN_TIME_MAX = 20.0
"""Longest time for ur-rtde to upload its program and begin [s]."""
DEVIATION_MAX = 0.03
"""Largest distance between the set points that were meant and those that arrived [rad]."""
_MOVED = 1e-4
_POLL = 0.002
_ALIGN_STEP = 0.001


def begin_stream(link: UrLink, points: SetPoints) -> float:
    """Let the set points go, and return the controller's time before the first.

    Raises:
        RigError: ur-rtde did not begin.
    """
    while not link.stream_states.empty():
        link.stream_states.get_nowait()
    before = link.latest().time
    link.send_stream(points.q, points.dt, STOP_DECELERATION)
    deadline = time.monotonic() + BEGIN_TIME_MAX
    while True:
        link.keep_alive()
        try:
            state = link.stream_states.get(timeout=_POLL)
        except queue.Empty:
            if time.monotonic() > deadline:
                raise RigError(
                    f"ur-rtde did not start to stream within {BEGIN_TIME_MAX:g} s"
                ) from None
            continue
        if state["stream"] == "begins":
            return before
        raise RigError(f"ur-rtde cannot stream: {state.get('error', state['stream'])}")


def stream_ended(link: UrLink) -> bool:
    """Return whether all set points were sent.

    Raises:
        RigError: The stream failed or was stopped.
    """
    try:
        state = link.stream_states.get_nowait()
    except queue.Empty:
        return False
    if state["stream"] == "done":
        return True
    raise RigError(f"the stream of set points ended early: {state.get('error', state['stream'])}")


def align(reports: list[Report], points: SetPoints) -> tuple[float, float]:
    """Return when a streamed motion began, and how far what arrived is from what was meant.

    Args:
        reports: Reports from before the motion to after it.
        points: Set points that were meant.

    Returns:
        Begin by the controller's clock [s], and the largest deviation of a set point [rad].

    Raises:
        RigError: The controller followed no set point.
    """
    times = np.array([report.time for report in reports])
    targets = np.stack([report.target_q for report in reports])
    moved = np.flatnonzero(np.abs(targets - points.q[0]).max(axis=1) > _MOVED)
    if not len(moved):
        raise RigError("the controller followed none of the set points")
    meant = np.flatnonzero(np.abs(points.q - points.q[0]).max(axis=1) > _MOVED)
    guess = times[moved[0]] - (meant[0] if len(meant) else 0) * points.dt
    clock = np.arange(len(points.q)) * points.dt
    best = (guess, np.inf)
    for shift in np.arange(-0.1, 0.1, _ALIGN_STEP):
        begin = guess + shift
        wanted = np.stack([np.interp(times - begin, clock, joint) for joint in points.q.T], axis=1)
        deviation = float(np.abs(wanted - targets).max())
        if deviation < best[1]:
            best = (begin, deviation)
    return float(best[0]), best[1]
