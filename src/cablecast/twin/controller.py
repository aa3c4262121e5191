"""The twin's controller: runs programs on its own clock, moves the arm, and keeps it safe."""

import collections
import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.rigs.virtual.live import REST_SPEED, LiveArm
from cablecast.setup import Setup
from cablecast.twin.limits import TwinLimits
from cablecast.twin.rtde_program import UrRtdeProgram, is_ur_rtde_program
from cablecast.twin.urscript import Command, Program, Run, ScriptError

MODE_POWER_OFF, MODE_RUNNING = 3, 7
SAFETY_NORMAL, SAFETY_PROTECTIVE, SAFETY_EMERGENCY = 1, 3, 7
RUNTIME_STOPPED, RUNTIME_PLAYING = 1, 2
START_TIMESTAMP = 1000.0

CB3_VERSION, E_SERIES_VERSION = (3, 15, 8, 106339), (5, 12, 6, 1102099)

TIMED = {"servoj", "movej", "stopj", "sleep", "sync"}
_EVENT_COUNT = 10_000
_MESSAGE_COUNT = 200
_MOVEJ_SPEED, _MOVEJ_ACCELERATION = 1.05, 1.4


@dataclasses.dataclass
class _Running:
    """A program that runs, and the command that it waits for."""

    name: str
    run: Run
    wait: "Callable[[], bool] | None" = None


class Controller:
    """A UR controller of one arm.

    Args:
        setup: Arm, table and robot section.
        q: Joint angles at the start [rad], shape [6].
        is_e_series: True for 500 Hz and PolyScope 5, False for 125 Hz and PolyScope 3.
        lab_seed: Seed of the laboratory.
    """

    def __init__(
        self,
        setup: Setup,
        q: NDArray[np.float64],
        is_e_series: bool = False,
        lab_seed: int = 0,
    ):
        robot = setup.robot
        if robot is None:
            raise InputError("a twin needs a lab file with a robot section")
        self.setup = setup
        self.robot = robot
        self.is_e_series = is_e_series
        self.dt = 0.002 if is_e_series else 0.008
        self.version = E_SERIES_VERSION if is_e_series else CB3_VERSION
        self.arm = LiveArm(setup, q, lab_seed=lab_seed)
        self.limits = TwinLimits(setup, self.dt)
        self.inputs: dict[str, Any] = collections.defaultdict(int)
        self.int_registers = [0] * 48
        self.double_registers = [0.0] * 48
        self.events: collections.deque[dict[str, Any]] = collections.deque(maxlen=_EVENT_COUNT)
        self.messages: collections.deque[str] = collections.deque(maxlen=_MESSAGE_COUNT)
        self.payload = robot.payload_mass
        self.payload_cog = list(robot.payload_cog)
        self.remote_control = True
        self._running: _Running | None = None
        self._noise = np.random.default_rng([lab_seed, 77])
        self.boot()

    def boot(self) -> None:
        """Start up: at rest, without a program, the clock at its beginning."""
        self.time = START_TIMESTAMP
        self.robot_mode, self.safety_mode = MODE_RUNNING, SAFETY_NORMAL
        self.speed_slider = 1.0
        self._running = None
        self.target_q = self.arm.q.copy()
        self.target_qd = np.zeros(6)
        self.arm.freeze()
        self.limits.forget()
        self.int_registers = [0] * 48
        self.double_registers = [0.0] * 48
        self.inputs.clear()

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
        if self.is_e_series and not self.remote_control:
            self.log("program refused", reason="not in remote control")
            return
        try:
            if is_ur_rtde_program(text):
                running = _Running("rtde_control", UrRtdeProgram(self).run())
            else:
                program = Program(text)
                running = _Running(program.name, program.run(self._instant(), TIMED))
        except ScriptError as error:
            self.messages.append(str(error))
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
        if self.setup.robot is not None:
            self.payload = self.setup.robot.payload_mass
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
            for _ in itertools.count():
                if running.wait is not None:
                    if not running.wait():
                        return
                    running.wait = None
                running.wait = self._begin(next(running.run))
        except StopIteration:
            self.stop_program("its end")
        except ScriptError as error:
            self.messages.append(str(error))
            self.stop_program(f"error: {error}")

    def _begin(self, command: Command) -> Callable[[], bool]:
        """Return the function that carries a command out, one control cycle a call.

        It returns True once the command is over, before anything is done in that cycle.
        """
        name, values, named = command
        if name == "servoj":
            return self._servoj(*values, **named)
        if name == "movej":
            return self._movej(*values, **named)
        if name == "stopj":
            return self._stopj(*values)
        return self._wait(float(values[0]) if values else self.dt)

    def _servoj(
        self,
        q: Any,
        a: float = 0.0,
        v: float = 0.0,
        t: float = 0.002,
        lookahead_time: float = 0.1,
        gain: float = 300,
    ) -> Callable[[], bool]:
        del a, v
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

    def _movej(
        self, q: Any, a: float = _MOVEJ_ACCELERATION, v: float = _MOVEJ_SPEED, **_: Any
    ) -> Callable[[], bool]:
        target, start = np.array(q, dtype=float), self.target_q.copy()
        distance = float(np.abs(target - start).max())
        # A quintic whose peaks of speed and acceleration stay within v and a.
        duration = max(1.875 * distance / v, np.sqrt(5.78 * distance / a), self.dt)
        progress = 0.0

        def advance() -> bool:
            nonlocal progress
            if progress >= duration and self.at_rest:
                return True
            progress += self.dt * self.speed_slider
            u = min(progress / duration, 1.0)
            self.target_q = start + u**3 * (10 - 15 * u + 6 * u * u) * (target - start)
            return False

        return advance

    def _stopj(self, a: float = 2.0) -> Callable[[], bool]:
        def advance() -> bool:
            if np.all(self.target_qd == 0.0) and self.at_rest:
                return True
            self._brake(float(a))
            return False

        return advance

    def _wait(self, duration: float) -> Callable[[], bool]:
        end = self.time + duration
        return lambda: self.time >= end - 1e-9

    def _brake(self, deceleration: float) -> None:
        """Slow the set points down, all joints at once."""
        peak = float(np.abs(self.target_qd).max())
        if peak == 0.0:
            return
        share = max(1.0 - deceleration * self.dt / peak, 0.0)
        self.target_q = self.target_q + self.target_qd * share * self.dt

    def _instant(self) -> dict[str, Callable[..., Any]]:
        return {
            "read_input_integer_register": lambda i: int(self.inputs[f"input_int_register_{i}"]),
            "read_input_float_register": lambda i: float(self.inputs[f"input_double_register_{i}"]),
            "write_output_integer_register": self._write_int,
            "write_output_float_register": self._write_double,
            "textmsg": lambda *parts: self.messages.append(" ".join(map(str, parts))),
        }

    def _write_int(self, index: int, value: Any) -> None:
        self.int_registers[index] = int(value)

    def _write_double(self, index: int, value: Any) -> None:
        self.double_registers[index] = float(value)
