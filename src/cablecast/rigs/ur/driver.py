"""DriverUR: the `ArmDriver` of a UR controller."""

import time
from typing import Any

from cablecast.arm.ur import ArmUR
from cablecast.errors import InputError, RigError
from cablecast.rigs.driver import MotionRecord, RigPhase
from cablecast.rigs.path import JointCurve
from cablecast.rigs.ur.config import RobotUR
from cablecast.rigs.ur.link import BY_HAND, Report, UrLink, check_arm, check_ready, check_report
from cablecast.rigs.ur.player import ProgramPlayer
from cablecast.rigs.ur.program import UNDER_WAY
from cablecast.setup import Setup

_SILENCE_MAX = 2.0
"""Longest `silence_max` of a real arm [s]."""
_SLOW_ANSWER = 1.0


class DriverUR:
    """A UR arm; see `ArmDriver`.

    Args:
        setup: Lab file with the robot section of a UR.

    Raises:
        InputError: The arm is no UR, or nobody would notice in time that its controller is silent.
    """

    def __init__(self, setup: Setup):
        robot = setup.robot
        if not isinstance(setup.arm, ArmUR) or not isinstance(robot, RobotUR):
            raise InputError(
                f"--rig ur drives a UR arm, and the lab file describes a {setup.arm.model}"
            )
        if robot.silence_max > _SILENCE_MAX and not robot.is_loopback:
            raise InputError(
                f"robot silence_max = {robot.silence_max:g} s is for a twin: a real arm would move "
                f"unwatched. Leave it out of the lab file, or set it to {_SILENCE_MAX:g} s at most"
            )
        self.robot, self.model = robot, setup.arm.model
        self._link: UrLink | None = None
        self.description: dict[str, Any] = {
            "is_twin": robot.is_loopback,
            "lookahead": robot.lookahead,
            "gain": robot.gain,
            "payload_mass": robot.payload_mass,
        }

    def ready(self) -> str:
        """Connect where needed, and refuse an arm that may not move; see `ArmDriver`."""
        link = self._connected()
        start = time.monotonic()
        report = check_ready(link)
        asked = time.monotonic() - start
        version = ".".join(map(str, link.version))
        payload = "not reported" if report.payload is None else f"{report.payload:.2f} kg"
        words = f"{version} ready at {self.robot.address}, payload {payload}"
        if asked > _SLOW_ANSWER:
            words += f"; its dashboard took {asked:.1f} s to answer, which delays every cast"
        return words if link.has_dashboard else f"{words}; {BY_HAND}"

    def latest(self) -> Report:
        """Return the newest report."""
        return self._held().latest()

    def since(self, when: float) -> list[Report]:
        """Return the reports after a time by the controller's clock, oldest first."""
        return self._held().since(when)

    def play(self, name: str, curve: JointCurve, phase: RigPhase) -> MotionRecord:
        """Play a motion to its end, watch it, and stop the arm if anything is not as it should."""
        link = self._connected()
        link.set_phase(phase)
        return ProgramPlayer(link).play(name, curve)

    def check_standing(self) -> None:
        """Refuse an arm that is not as the lab file says, from a new report."""
        check_report(self._held().wait_for_report(), self.robot)

    def set_phase(self, phase: RigPhase) -> None:
        """Write what the rig is doing into a register."""
        self._held().set_phase(phase)

    def stop(self) -> None:
        """Stop a program of ours that runs; one that is not ours goes on."""
        link = self._link
        if link is None or not link.is_alive:
            return
        newest = link.reports[-1]
        if newest.is_playing and newest.state in UNDER_WAY:
            ProgramPlayer(link).stop()

    def close(self) -> None:
        """Disconnect; may be called twice."""
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def _held(self) -> UrLink:
        if self._link is None:
            raise RigError("the controller is not connected: reset the rig")
        return self._link

    def _connected(self) -> UrLink:
        """Return the connection, made anew where it was lost."""
        if self._link is not None and not self._link.is_alive:
            self.close()
        if self._link is None:
            self._link = UrLink(self.robot)
            try:
                check_arm(self._link.version, self.model, self._link.arm_name())
            except BaseException:
                self.close()
                raise
        return self._link
