"""The twin's controller: runs programs on its own clock, moves the arm, and keeps it safe.

Its limits stand for the safety system of a real controller. They share nothing with the checks that
a rig makes before it sends a program: both must agree for an arm to move.
"""

import collections
import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import LimitKind, limit_violations
from cablecast.arm.ur import JOINT_NAMES, ArmUR
from cablecast.errors import InputError
from cablecast.rigs.ur.config import RobotUR
from cablecast.rigs.ur.rtde import REGISTER_COUNT
from cablecast.rigs.ur.twin.urscript import PROGRAM_SIZE_MAX, Program, Run, ScriptError
from cablecast.rigs.virtual.arm import REST_SPEED, LiveArm
from cablecast.setup import Setup

# The maker's data sheets: all joints turn by 360 deg either way. A controller tolerates a little
# more before it stops.
_POSITION_MAX = np.radians(363.0)
_SPEEDS_MAX_DEG = {
    "ur3": (180.0, 180.0, 180.0, 360.0, 360.0, 360.0),
    "ur5": (180.0, 180.0, 180.0, 180.0, 180.0, 180.0),
    "ur10": (120.0, 120.0, 180.0, 180.0, 180.0, 180.0),
}
"""Largest speed of each joint by the size of the arm, of both series [deg/s]."""
_SPEED_TOLERANCE_DEG = 11.0
# A jump of a set point that no motor could follow stops a real arm as well.
_ACCELERATION_MAX = 45.0
_WINDOW = 0.032
"""Time over which rates are measured [s]: servoj smooths its set points over as much, so that one
which comes a cycle late is no jump."""


@dataclasses.dataclass
class TwinLimits:
    """Limits of set points, checked one after another.

    Args:
        setup: Arm, table and box; the box of its robot section is the controller's safety planes.
        dt: Control cycle [s].
    """

    setup: Setup
    dt: float

    def __post_init__(self):
        self._window = round(_WINDOW / self.dt)
        size = self.setup.arm.model.removesuffix("e")
        if not isinstance(self.setup.arm, ArmUR) or size not in _SPEEDS_MAX_DEG:
            raise InputError(
                f"there is no twin of a {self.setup.arm.model}: of {', '.join(_SPEEDS_MAX_DEG)} "
                "and their e-Series alone"
            )
        self._speed_max = np.radians(np.array(_SPEEDS_MAX_DEG[size]) + _SPEED_TOLERANCE_DEG)
        self._past: list[NDArray[np.float64]] = []

    def forget(self) -> None:
        """Start anew: the next set point follows none."""
        self._past = []

    def violation(self, q: NDArray[np.float64]) -> str | None:
        """Return what is wrong with the next set point, or None.

        Args:
            q: Set point one cycle after the one before [rad], shape [6].
        """
        if q.shape != (6,) or not np.all(np.isfinite(q)):
            return "a set point is not six finite angles"
        count = self._window
        self._past = [*self._past, q.copy()][-2 * count - 1 :]
        # The newest first; shorter by one with each difference, and empty after a start.
        places = np.array(self._past[::-count])
        rates = -np.diff(places, axis=0) / (count * self.dt)
        changes = -np.diff(rates, axis=0) / (count * self.dt)
        asked = [values[:1] for values in (places, rates, changes)]
        bounds = (_POSITION_MAX, self._speed_max, _ACCELERATION_MAX)
        if peak := next(limit_violations(asked, bounds), None):
            words = {
                LimitKind.POSITION: f"{peak.value:.3f} rad is beyond its limit of position",
                LimitKind.VELOCITY: f"{peak.value:.2f} rad/s is beyond its speed",
                LimitKind.ACCELERATION: f"{peak.value:.0f} rad/s2 is beyond its acceleration",
            }
            return f"{JOINT_NAMES[peak.joint]} at {words[peak.kind]}"
        return self._outside(q)

    def _outside(self, q: NDArray[np.float64]) -> str | None:
        arm = self.setup.arm
        grip, flange = arm.grip_pose(q)[:3], arm.forward(q)[:3, 3]
        strike = self.setup.strike
        ground, floor = ("table", 0.0) if strike is None else ("floor", strike.floor)
        for name, place in (("the grip", grip), ("the flange", flange)):
            if place[2] < floor:
                return f"{name} would be {floor - place[2]:.3f} m below the {ground}"
            robot = self.setup.robot
            if robot is None:
                continue
            low, high = np.asarray(robot.box_low), np.asarray(robot.box_high)
            # A thousandth of a metre of tolerance, as safety planes have.
            if np.any(place < low - 1e-3) or np.any(place > high + 1e-3):
                return f"{name} at {place.round(3).tolist()} m would be outside the safety planes"
        return None


MODE_POWER_OFF, MODE_RUNNING = 3, 7
SAFETY_NORMAL, SAFETY_PROTECTIVE, SAFETY_EMERGENCY = 1, 3, 7
_START_TIMESTAMP = 1000.0
_EVENT_COUNT = 10_000


@dataclasses.dataclass(frozen=True)
class Generation:
    """One generation of controllers.

    Attributes:
        version: Version of its software: major, minor, bugfix, build.
        dt: Control cycle [s].
        has_dashboard: True where a dashboard server answers.
        has_remote_control: True where programs from outside need the pendant's permission.
    """

    version: tuple[int, int, int, int]
    dt: float
    has_dashboard: bool = True
    has_remote_control: bool = True


GENERATIONS = {
    "cb3": Generation((3, 15, 8, 106339), 0.008, has_remote_control=False),
    "e-series": Generation((5, 12, 6, 1102099), 0.002),
    "polyscope-x": Generation((10, 7, 0, 0), 0.002, has_dashboard=False),
}
"""Generations by name; the last two run on the same arms."""


@dataclasses.dataclass
class _Running:
    """A program that runs, and the command that it waits for."""

    name: str
    run: Run
    wait: Callable[[], bool] | None = None


# What a program of a person may do wrong.
_PROGRAM_ERRORS = (ScriptError, TypeError, ValueError, LookupError, ArithmeticError, RecursionError)


class Controller:
    """A UR controller of one arm.

    Args:
        setup: Arm, table and robot section.
        q: Joint angles at the start [rad], shape [6].
        generation: One of `GENERATIONS`.
    """

    def __init__(self, setup: Setup, q: NDArray[np.float64], generation: str = "cb3"):
        robot = setup.robot
        if not isinstance(robot, RobotUR):
            raise InputError("a twin needs a lab file whose robot section is that of a UR")
        self.setup = setup
        self.robot = robot
        self.program_size_max = PROGRAM_SIZE_MAX
        self.generation = GENERATIONS[generation]
        self.dt = self.generation.dt
        self.arm = LiveArm(setup, q)
        self.limits = TwinLimits(setup, self.dt)
        self.inputs: dict[str, Any] = collections.defaultdict(int)
        self.events: collections.deque[dict[str, Any]] = collections.deque(maxlen=_EVENT_COUNT)
        # Functions of URScript that take time. Each returns a function that carries it out, one
        # control cycle a call, and that returns True, having done nothing, once it is over.
        self._timed = {"servoj": self._servoj, "stopj": self._stopj}
        self.time = _START_TIMESTAMP
        self.boot()

    def boot(self) -> None:
        """Start up: at rest, without a program, and as after `clear`."""
        self._running: _Running | None = None
        self.target_q = self.arm.q.copy()
        self.target_qd = np.zeros(6)
        self.arm.freeze()
        self.int_registers = [0] * REGISTER_COUNT
        self.inputs.clear()
        self.clear()

    @property
    def is_running_program(self) -> bool:
        """True while a program runs."""
        return self._running is not None

    @property
    def program_name(self) -> str:
        """Name of the program that runs, or nothing."""
        return self._running.name if self._running else ""

    @property
    def at_rest(self) -> bool:
        """True where no joint moves."""
        return bool(np.abs(self.arm.qd).max() < REST_SPEED)

    @property
    def can_move(self) -> bool:
        """True unless stopped for safety or without power."""
        return self.robot_mode == MODE_RUNNING and self.safety_mode == SAFETY_NORMAL

    def log(self, what: str, **more: Any) -> None:
        """Remember an event with its time by the twin's clock."""
        self.events.append({"time": self.time, "what": what, **more})

    def load(self, text: str) -> None:
        """Run a program instead of the one that runs, as a real controller does."""
        if not self.can_move:
            self.log("program refused", reason="stopped for safety")
            return
        if not self.is_in_remote_control:
            self.log("program refused", reason="in local control")
            return
        if len(text) > self.program_size_max:
            # Real controllers do nothing, and say nothing.
            self.log("program refused", reason=f"{len(text)} bytes")
            return
        try:
            program = Program(text)
            running = _Running(program.name, program.run(self._instant(), set(self._timed)))
        except ScriptError as error:
            self.log("program refused", reason=str(error))
            return
        self.stop_program("replaced by another")
        self._running = running
        self.limits.forget()
        self.log("program starts", name=running.name)

    def stop_program(self, why: str) -> None:
        """End the program; the arm brakes."""
        if self._running is not None:
            self.log("program ends", name=self._running.name, why=why)
            self._running = None

    def protective_stop(self, why: str) -> None:
        """Stop for safety; a person has to clear it."""
        if self.safety_mode == SAFETY_NORMAL:
            self.safety_mode = SAFETY_PROTECTIVE
            self.log("protective stop", why=why)
            self.stop_program("protective stop")

    def emergency_stop(self) -> None:
        """Stop at once and take the power off."""
        self.safety_mode, self.robot_mode = SAFETY_EMERGENCY, MODE_POWER_OFF
        self.log("emergency stop")
        self.stop_program("emergency stop")

    def clear(self) -> None:
        """Do what a person does after a stop: clear it, and release the brakes."""
        self.safety_mode, self.robot_mode = SAFETY_NORMAL, MODE_RUNNING
        self.speed_slider = 1.0
        self.is_in_remote_control = True
        self.payload = self.robot.payload_mass
        self.limits.forget()
        self.log("cleared")

    def tick(self) -> NDArray[np.float64]:
        """Advance by one control cycle, and return the grip's poses every millisecond."""
        before = self.target_q.copy()
        if self._running is not None and self.can_move:
            self._advance_program(self._running)
        if self._running is None or not self.can_move:
            self._brake(20.0 if self.can_move else 40.0)
        why = None if self._running is None else self.limits.violation(self.target_q)
        if why:
            self.target_q = before
            self.protective_stop(why)
        self.target_qd = (self.target_q - before) / self.dt
        self.arm.command(self.target_q)
        poses = self.arm.advance(round(self.dt / self.arm.dt))
        self.time += self.dt
        return poses

    def _advance_program(self, running: _Running) -> None:
        """Let a program run until it waits for time to pass."""
        try:
            while running.wait is None or running.wait():
                name, values, named = next(running.run)
                running.wait = self._timed[name](*values, **named)
        except StopIteration:
            self.stop_program("its end")
        except _PROGRAM_ERRORS as error:
            self.stop_program(f"error: {error}")

    def _servoj(
        self, q: Any, *, t: float, lookahead_time: float, gain: float
    ) -> Callable[[], bool]:
        if not (0.03 <= lookahead_time <= 0.2 and 100 <= gain <= 2000):
            raise ScriptError(f"servoj lookahead_time {lookahead_time} or gain {gain} out of range")
        target, start, progress = np.array(q, dtype=float), self.target_q.copy(), 0.0
        if target.shape != (6,):
            raise ScriptError("servoj takes six angles")

        def advance() -> bool:
            nonlocal progress
            if progress >= t - 1e-9:
                return True
            # The speed slider slows the clock of the program.
            progress += self.dt * self.speed_slider
            share = min(progress / t, 1.0)
            self.target_q = start + share * (target - start)
            return False

        return advance

    def _stopj(self, a: float = 2.0) -> Callable[[], bool]:
        def advance() -> bool:
            if np.all(self.target_qd == 0.0) and self.at_rest:
                return True
            self._brake(float(a))
            return False

        return advance

    def _brake(self, deceleration: float) -> None:
        """Slow the set points down, all joints at once."""
        peak = float(np.abs(self.target_qd).max())
        if peak == 0.0:
            return
        share = max(1.0 - deceleration * self.dt / peak, 0.0)
        self.target_q = self.target_q + self.target_qd * share * self.dt

    def _instant(self) -> dict[str, Callable[..., Any]]:
        """Return the functions of URScript that take no time."""

        def write_integer(index: int, value: Any) -> None:
            if not (0 <= index < REGISTER_COUNT and abs(int(value)) < 2**31):
                raise ScriptError(f"register {index} takes no {value}")
            self.int_registers[index] = int(value)

        return {
            "read_input_integer_register": lambda i: int(self.inputs[f"input_int_register_{i}"]),
            "write_output_integer_register": write_integer,
            "get_steptime": lambda: self.dt,
            "get_actual_joint_positions": lambda: self.arm.q.tolist(),
            "floor": math.floor,
        }
