from collections.abc import Callable
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from tests.rigs.puppet.config import RobotPuppet

from cablecast.errors import InputError, RigError
from cablecast.motion.polar import reset_pose
from cablecast.rigs.driver import ArmReport, MotionRecord, RigPhase
from cablecast.rigs.path import JointCurve
from cablecast.setup import Setup

SPEED_MAX = 50.0


class DriverPuppet:
    """Moves nothing; its clock goes on with each report that is asked for.

    Attributes:
        made: All that were made.
        played: Names of the motions that were played to their end or stopped.
        fault: Called with the name and the time of each report of a motion; may raise.
        is_moving: True from the start of a motion until it ends well, or is stopped.
    """

    made: ClassVar[list["DriverPuppet"]] = []
    fault: Callable[[str, float], object] = staticmethod(lambda name, time: None)

    def __init__(self, setup: Setup):
        robot = setup.robot
        if not isinstance(robot, RobotPuppet):
            raise InputError("a puppet needs its own robot section")
        self.dt, self.description = robot.report_dt, {"string_length": robot.string_length}
        self.q = setup.arm.inverse(np.asarray(reset_pose(setup.workspace), dtype=float))
        self.reports: list[ArmReport] = []
        self.played: list[str] = []
        self.is_moving = self.is_open = self.is_blocked = False
        self.made.append(self)

    def ready(self) -> str:
        if self.is_blocked:
            raise RigError("the strings are tangled: untangle them")
        self.is_open = True
        return "puppet ready"

    def latest(self) -> ArmReport:
        if not self.is_open:
            raise RigError("nobody holds the strings")
        return self._report(self.q, 0.0 * self.q)

    def since(self, when: float) -> list[ArmReport]:
        return [report for report in self.reports if report.time > when]

    def play(self, name: str, curve: JointCurve, phase: RigPhase) -> MotionRecord:
        self.played.append(name)
        self.phase = phase
        start = self.latest().time
        self.is_moving = True
        times = np.append(np.arange(self.dt, curve.duration, self.dt), curve.duration)
        for time, q in zip(times, curve.evaluate(times), strict=True):
            self._report(q, np.clip((q - self.q) / self.dt, -SPEED_MAX, SPEED_MAX))
            self.q = q
            self.fault(name, time)
        self.is_moving = False
        return MotionRecord(start, self.since(start))

    def check_standing(self) -> None:
        self.latest()

    def set_phase(self, phase: RigPhase) -> None:
        self.phase = phase

    def stop(self) -> None:
        self.is_moving = False

    def close(self) -> None:
        self.is_open = False

    def _report(self, q: NDArray[np.float64], qd: NDArray[np.float64]) -> ArmReport:
        time = self.reports[-1].time + self.dt if self.reports else 100.0
        self.reports.append(ArmReport(time, time, q, qd, q, 1.0, 1, self.is_moving))
        return self.reports[-1]
