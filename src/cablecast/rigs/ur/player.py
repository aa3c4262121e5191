"""Plays one motion on the controller, watches it, and stops the arm whatever happens."""

import contextlib
import itertools
import time

import numpy as np

from cablecast.errors import CablecastError, RigError, StoppedError
from cablecast.rigs.driver import CastAbortedError, MotionRecord
from cablecast.rigs.path import JointCurve
from cablecast.rigs.ur.link import SPEED_TOLERANCE, Report, UrLink, check_safe
from cablecast.rigs.ur.program import (
    TICK_DT,
    UNDER_WAY,
    ProgramState,
    hold_time,
    motion_program,
)

REST_SPEED = 0.02
"""Joint speed below which the arm rests, encoder noise included [rad/s]."""
_START_TIME_MAX = 15.0
"""Longest time from sending a program to its first sign of life [s]."""
_STOP_TIME_MAX = 1.0
_LATE_MAX = 2.0
"""Time beyond that of its motion after which a program counts as lost [s]."""
_TICK_LAG_MAX = 0.1
"""Longest time by which the program may be behind the controller's clock [s]."""
_POLL = 0.002
_START_TOLERANCE = 1e-3


class ProgramPlayer:
    """Plays motions one after another.

    Args:
        link: Connection to the controller.
    """

    _numbers = itertools.count(1)

    def __init__(self, link: UrLink):
        self.link, self.robot = link, link.robot

    def play(self, name: str, curve: JointCurve) -> MotionRecord:
        """Play a motion to its end, and stop the arm if anything is not as it should be.

        Args:
            name: Name of the program.
            curve: Path, which has been checked; the arm stands at its start.

        Raises:
            CastAbortedError: The motion was slowed.
            StoppedError: Somebody stopped or paused it, or moved the arm; something holds it, it
                stopped for safety, or the controller is silent.
        """
        link = self.link
        off = float(np.abs(link.latest().q - curve.q[0]).max())
        if off > _START_TOLERANCE:
            raise StoppedError(
                f"the arm stands {off * 1e3:.1f} mrad from where the motion begins, more than "
                f"{_START_TOLERANCE * 1e3:g} mrad: reset it"
            )
        # The number tells this program from an earlier one, also from that of another session.
        number = next(self._numbers) + int(time.monotonic() * 100) % 1_000_000 * 1000
        done = False
        try:
            link.keep_alive()
            first = link.latest().time
            program = motion_program(name, curve, self.robot, number)
            link.send_program(program)
            self._wait_for_start(number, len(program))
            reports = self._watch(first, number, hold_time(self.robot) + curve.duration)
            done = True
            return MotionRecord(_start_time(reports), reports)
        finally:
            link.rest()
            if not done:
                self.stop(number)

    def stop(self, number: int | None = None) -> None:
        """Stop the arm by every way there is; it may be called at any time.

        Args:
            number: Number of the program to stop; that which runs if None.
        """
        link = self.link
        link.rest()
        with contextlib.suppress(CablecastError):
            link.ask_to_stop(link.latest().number if number is None else number)
        deadline = time.monotonic() + _STOP_TIME_MAX
        while link.is_alive and time.monotonic() < deadline:
            report = link.reports[-1]
            rests = np.abs(report.qd).max() < REST_SPEED and not report.is_playing
            # One that is paused would go on as soon as somebody presses play.
            if rests and report.state not in UNDER_WAY:
                return
            time.sleep(_POLL)
        # The program ends itself for want of a heartbeat; this is for one that does not.
        with contextlib.suppress(CablecastError):
            link.stop_program()

    def _wait_for_start(self, number: int, size: int) -> None:
        deadline = time.monotonic() + _START_TIME_MAX
        while (report := self.link.latest()).number != number:
            self.link.keep_alive()
            check_safe(report)
            if time.monotonic() > deadline:
                raise RigError(
                    f"the controller did not start a program of {size / 1000:.1f} kB within "
                    f"{_START_TIME_MAX:g} s: look at the log of the pendant, whether it is in "
                    "remote control, whether another program runs, and whether it takes programs "
                    "of that size"
                )
            time.sleep(_POLL)

    def _watch(self, first: float, number: int, duration: float) -> list[Report]:
        """Watch until the motion of a duration [s] is done, and return its reports."""
        link = self.link
        seen: list[Report] = []
        begin: float | None = None
        start: float | None = None
        while True:
            link.keep_alive()
            newest = link.latest()
            fresh = link.since(seen[-1].time if seen else first)
            for report in fresh:
                self._check_motion(report)
                if report.number == number:
                    begin = report.time if begin is None else begin
                    self._check_program(report)
                    if start is None and report.tick > 0:
                        start = report.time - report.tick * TICK_DT
                if start is not None:
                    _check_pace(report, start)
            seen.extend(fresh)
            if newest.number == number and newest.state == ProgramState.DONE:
                return seen
            if begin is not None and newest.time > begin + duration + _LATE_MAX:
                raise StoppedError(
                    "the motion is not done in its time: look at the pendant whether another "
                    "program took the place of ours"
                )
            time.sleep(_POLL)

    def _check_motion(self, report: Report) -> None:
        """Refuse a report that says that the arm does not move as it should."""
        check_safe(report)
        if abs(report.speed_scaling - 1.0) > SPEED_TOLERANCE:
            raise CastAbortedError(
                f"the speed fell to {100 * report.speed_scaling:.3g} % in the motion: set the "
                "slider of the pendant to 100 %, or lower v_max if the arm is at its limits"
            )
        lag = float(np.abs(report.q - report.target_q).max())
        if lag > self.robot.lag_max:
            raise StoppedError(
                f"a joint lags {lag:.2f} rad behind its set point, more than "
                f"{self.robot.lag_max:g} rad: the arm is at its limits, or something holds it"
            )

    def _check_program(self, report: Report) -> None:
        """Refuse a report that says that our program ended early."""
        if report.state == ProgramState.SILENCE:
            raise CastAbortedError(
                f"the controller heard nothing of this computer for {self.robot.watchdog:g} s and "
                "stopped the arm: close other programs, or use a cable instead of Wi-Fi"
            )
        if report.state == ProgramState.ELSEWHERE:
            raise StoppedError(
                "the arm was moved before its program began: let nobody move it, and start again"
            )
        if report.state == ProgramState.STOPPED:
            raise CastAbortedError("the motion was stopped")
        if not report.is_playing and report.state != ProgramState.DONE:
            raise StoppedError(
                "somebody stopped or paused the program, or took remote control away: look why, "
                "and make sure that the arm may move. The same command resumes"
            )


def _check_pace(report: Report, start: float) -> None:
    """Refuse a program that falls behind the clock: the controller has slowed it."""
    if report.state != ProgramState.MOVING:
        return
    behind = report.time - start - report.tick * TICK_DT
    if behind > _TICK_LAG_MAX:
        raise CastAbortedError(
            f"the program is {behind:.3f} s behind the controller's clock, more than "
            f"{_TICK_LAG_MAX:g} s: the controller has slowed it"
        )


def _start_time(reports: list[Report]) -> float:
    """Return when the motion began by the controller's clock [s]."""
    starts = [
        r.time - r.tick * TICK_DT for r in reports if r.state == ProgramState.MOVING and r.tick
    ]
    if not starts:
        raise CastAbortedError("no report came from the motion")
    return float(np.median(starts))
