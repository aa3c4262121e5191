"""A time limit on a call into somebody else's code, which may hang."""

import signal
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import TypeVar

from cablecast.errors import RigError

Answer = TypeVar("Answer")

_GRACE_MIN, _GRACE_MAX = 0.5, 10.0
"""Shortest and longest time from one interruption to the next [s]: the code that was interrupted
may first stop an arm and close its connections."""


class _TimeIsUp(BaseException):
    """Interrupts the call; no Exception, so that `except Exception` does not swallow it."""


def call_within(limit: float | None, what: str, call: Callable[[], Answer]) -> Answer:
    """Return what a call returns, unless it takes too long.

    A call that takes too long is interrupted where it stands, so that its own `finally` clauses
    run. One that goes on all the same is interrupted again and again. The limit holds in the main
    thread of a system with interval timers; elsewhere there is none. Code in another language is
    interrupted when it returns to Python.

    Args:
        limit: Longest time of the call [s]; None for no limit.
        what: Name of the call in the error.
        call: Function without arguments.

    Raises:
        RigError: The call took too long.
    """
    if limit is None or not _has_timers():
        return call()
    armed, fired = True, False

    def interrupt(signum: int, frame: FrameType | None) -> None:
        nonlocal fired
        if armed:
            fired = True
            raise _TimeIsUp

    too_long = RigError(f"{what} took longer than its time limit of {limit:g} s")
    grace = min(max(limit, _GRACE_MIN), _GRACE_MAX)
    start = time.monotonic()
    handler_before = signal.signal(signal.SIGALRM, interrupt)
    timer_before = signal.setitimer(signal.ITIMER_REAL, limit, grace)
    try:
        answer = call()
        armed = False
    except BaseException as error:
        armed = False
        # A clause of the interrupted code that failed in turn is no better answer.
        if fired and not isinstance(error, KeyboardInterrupt):
            raise too_long from (None if isinstance(error, _TimeIsUp) else error)
        raise
    finally:
        armed = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL if handler_before is None else handler_before)
        if timer_before[0] > 0.0:
            left = max(timer_before[0] - (time.monotonic() - start), 1e-3)
            signal.setitimer(signal.ITIMER_REAL, left, timer_before[1])
    if fired:
        raise too_long
    return answer


def _has_timers() -> bool:
    """Return whether this thread of this system can set an interval timer."""
    return hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
