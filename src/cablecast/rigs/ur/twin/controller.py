"""Limits that the twin's controller checks on its own, whatever the program says.

They stand for the safety system of a real controller. Nothing here is shared with the checks that a
rig makes before it sends a program: both must agree for an arm to move.

The twin's controller: runs programs on its own clock, moves the arm, and keeps it safe.

State of the twin's controller as RTDE reports it.

Sockets of the twin: all in one thread, on the loopback address only.

Dashboard server of the twin: one line in, one line out.

Source: Universal Robots, "Dashboard Server e-Series, port 29999" and "... CB-Series".

Frames of the Real-Time Data Exchange, version 2, as a controller sends and reads them.

Source: Universal Robots, "Real-Time Data Exchange (RTDE) Guide". Every frame begins with its
length, header included, and its type; all numbers are big-endian.

RTDE server of the twin: recipes, data packages, and who may write what.
"""

import collections
import contextlib
import dataclasses
import ipaddress
import itertools
import selectors
import socket
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.ur import JOINT_NAMES
from cablecast.errors import InputError
from cablecast.rigs.ur.twin.urscript import Command, Program, Run, ScriptError
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
_TABLE_MARGIN = 0.0


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
        self._speed_max = np.radians(np.array(_SPEEDS_MAX_DEG[size]) + _SPEED_TOLERANCE_DEG)
        self._past: list[NDArray[np.float64]] = []

    def forget(self) -> None:
        """Begin anew: the next set point follows none."""
        self._past = []

    def violation(self, q: NDArray[np.float64]) -> str | None:
        """Return what is wrong with the next set point, or None.

        Args:
            q: Set point one cycle after the one before [rad], shape [6].
        """
        if q.shape != (6,) or not np.all(np.isfinite(q)):
            return "a set point is not six finite angles"
        joint = int(np.argmax(np.abs(q)))
        if abs(q[joint]) > _POSITION_MAX:
            return f"{JOINT_NAMES[joint]} at {q[joint]:.3f} rad is beyond its limit of position"
        count = self._window
        self._past = [*self._past, q.copy()][-2 * count - 1 :]
        if len(self._past) > count:
            rate = (q - self._past[-1 - count]) / (count * self.dt)
            joint = int(np.argmax(np.abs(rate) / self._speed_max))
            if abs(rate[joint]) > self._speed_max[joint]:
                return f"{JOINT_NAMES[joint]} at {rate[joint]:.2f} rad/s is beyond its speed"
        if len(self._past) > 2 * count:
            before = (self._past[-1 - count] - self._past[0]) / (count * self.dt)
            change = (rate - before) / (count * self.dt)
            joint = int(np.argmax(np.abs(change)))
            if abs(change[joint]) > _ACCELERATION_MAX:
                return (
                    f"{JOINT_NAMES[joint]} at {change[joint]:.0f} rad/s2 is beyond its acceleration"
                )
        return self._outside(q)

    def _outside(self, q: NDArray[np.float64]) -> str | None:
        arm = self.setup.arm
        grip, flange = arm.grip_pose(q)[:3], arm.forward(q)[:3, 3]
        for name, place in (("the grip", grip), ("the flange", flange)):
            if place[2] < _TABLE_MARGIN:
                return f"{name} would be {-place[2]:.3f} m below the table"
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
RUNTIME_STOPPED, RUNTIME_PLAYING = 1, 2
START_TIMESTAMP = 1000.0

CB3_VERSION, E_SERIES_VERSION = (3, 15, 8, 106339), (5, 12, 6, 1102099)

TIMED = {"servoj", "stopj"}
_EVENT_COUNT = 10_000
_MESSAGE_COUNT = 200


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
        self.events: collections.deque[dict[str, Any]] = collections.deque(maxlen=_EVENT_COUNT)
        self.messages: collections.deque[str] = collections.deque(maxlen=_MESSAGE_COUNT)
        self.payload = robot.payload_mass
        self.payload_cog = list(robot.payload_cog)
        self.remote_control = True
        self._running: _Running | None = None
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
        return self._stopj(*values)

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
        return {
            "read_input_integer_register": lambda i: int(self.inputs[f"input_int_register_{i}"]),
            "write_output_integer_register": self._write_int,
            "textmsg": lambda *parts: self.messages.append(" ".join(map(str, parts))),
        }

    def _write_int(self, index: int, value: Any) -> None:
        self.int_registers[index] = int(value)


ENCODER_ERROR = 5e-5
"""Standard deviation of a reported angle, as in the virtual laboratory [rad]."""
_RATE_ERROR = 20 * ENCODER_ERROR
_CONSTANTS: dict[str, Any] = {
    "joint_mode": [255] * 6,
    "joint_temperatures": [30.0] * 6,
    "actual_main_voltage": 48.0,
    "actual_robot_voltage": 48.0,
    "actual_joint_voltage": [48.0] * 6,
}
TYPES = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
"""Struct codes of the types that a recipe names."""


OUTPUTS: dict[str, str] = {
    "timestamp": "DOUBLE",
    "target_q": "VECTOR6D",
    "target_qd": "VECTOR6D",
    "target_qdd": "VECTOR6D",
    "target_current": "VECTOR6D",
    "target_moment": "VECTOR6D",
    "actual_q": "VECTOR6D",
    "actual_qd": "VECTOR6D",
    "actual_current": "VECTOR6D",
    "joint_control_output": "VECTOR6D",
    "actual_TCP_pose": "VECTOR6D",
    "actual_TCP_speed": "VECTOR6D",
    "actual_TCP_force": "VECTOR6D",
    "target_TCP_pose": "VECTOR6D",
    "target_TCP_speed": "VECTOR6D",
    "actual_digital_input_bits": "UINT64",
    "actual_digital_output_bits": "UINT64",
    "joint_temperatures": "VECTOR6D",
    "actual_execution_time": "DOUBLE",
    "robot_mode": "INT32",
    "joint_mode": "VECTOR6INT32",
    "safety_mode": "INT32",
    "safety_status": "INT32",
    "actual_tool_accelerometer": "VECTOR3D",
    "speed_scaling": "DOUBLE",
    "target_speed_fraction": "DOUBLE",
    "actual_momentum": "DOUBLE",
    "actual_main_voltage": "DOUBLE",
    "actual_robot_voltage": "DOUBLE",
    "actual_robot_current": "DOUBLE",
    "actual_joint_voltage": "VECTOR6D",
    "runtime_state": "UINT32",
    "robot_status_bits": "UINT32",
    "safety_status_bits": "UINT32",
    "standard_analog_input0": "DOUBLE",
    "standard_analog_input1": "DOUBLE",
    "standard_analog_output0": "DOUBLE",
    "standard_analog_output1": "DOUBLE",
    "payload": "DOUBLE",
    "payload_cog": "VECTOR3D",
    "payload_inertia": "VECTOR6D",
    "ft_raw_wrench": "VECTOR6D",
    "output_bit_registers0_to_31": "UINT32",
    "output_bit_registers32_to_63": "UINT32",
    **{f"output_int_register_{index}": "INT32" for index in range(48)},
    **{f"output_double_register_{index}": "DOUBLE" for index in range(48)},
}
"""Types of what the controller can report."""


_ZEROS = {
    name: [0.0] * int(TYPES[kind][:-1] or 1) if kind.startswith("VECTOR") else 0
    for name, kind in OUTPUTS.items()
}


class Reporter:
    """Collects what a controller reports, with the noise of its encoders.

    Args:
        controller: Controller that is reported on.
        seed: Seed of the noise.
    """

    def __init__(self, controller: Controller, seed: int = 0):
        self.controller = controller
        self._rng = np.random.default_rng([seed, 79])

    def state(self) -> dict[str, Any]:
        """Return the value of every variable."""
        c = self.controller
        noise = self._rng.normal(size=(2, 6))
        powered = c.robot_mode == MODE_RUNNING
        state = {
            **_ZEROS,
            **_CONSTANTS,
            "timestamp": c.time,
            "target_q": c.target_q.tolist(),
            "target_qd": c.target_qd.tolist(),
            "actual_q": (c.arm.q + ENCODER_ERROR * noise[0]).tolist(),
            "actual_qd": (c.arm.qd + _RATE_ERROR * noise[1] * (not c.at_rest)).tolist(),
            "robot_mode": c.robot_mode,
            "safety_mode": c.safety_mode,
            "safety_status": c.safety_mode,
            "speed_scaling": 1.0 if powered else 0.0,
            "target_speed_fraction": c.speed_slider,
            "runtime_state": RUNTIME_PLAYING if c.is_running_program else RUNTIME_STOPPED,
            "robot_status_bits": int(powered) | int(c.is_running_program) << 1,
            "safety_status_bits": _safety_bits(c.safety_mode),
            "payload": c.payload,
            "payload_cog": c.payload_cog,
        }
        for index in range(48):
            state[f"output_int_register_{index}"] = c.int_registers[index]
        return state


def _safety_bits(mode: int) -> int:
    """Return the bits of RTDE's safety_status_bits."""
    if mode == SAFETY_PROTECTIVE:
        return 1 << 2 | 1 << 10
    if mode == SAFETY_EMERGENCY:
        return 1 << 6 | 1 << 7 | 1 << 10
    return 1 if mode == SAFETY_NORMAL else 1 << 9


_RECEIVE_SIZE = 1 << 16
_SEND_MAX = 1 << 22
"""Most bytes that wait for a client who does not read; then it is dropped, as a controller does."""


def check_loopback(address: str) -> str:
    """Return an address of this computer that nobody else can reach.

    Raises:
        InputError: It is another address.
    """
    try:
        if ipaddress.ip_address(address).is_loopback:
            return address
    except ValueError:
        pass
    raise InputError(f"the twin listens on a loopback address such as 127.0.0.1, not on {address}")


class Client:
    """One connection of a client.

    Attributes:
        kind: Name of the server that it came to.
        state: Whatever the server keeps about it.
    """

    def __init__(self, connection: socket.socket, kind: str):
        self.connection = connection
        self.kind = kind
        self.state: dict = {}
        self.open = True
        self._waiting = b""

    def send(self, data: bytes) -> None:
        """Send now what goes, and the rest later."""
        self._waiting += data
        self.flush()

    def flush(self) -> None:
        """Send what waits."""
        if not self.open:
            return
        try:
            while self._waiting:
                self._waiting = self._waiting[self.connection.send(self._waiting) :]
        except BlockingIOError:
            if len(self._waiting) > _SEND_MAX:
                self.open = False
        except OSError:
            self.open = False


class Servers:
    """Listening sockets and their clients.

    Args:
        address: Loopback address.
        ports: Port by the name of the server; 0 for any free one.

    Raises:
        InputError: The address is not of this computer, or a port is taken.
    """

    def __init__(self, address: str, ports: dict[str, int]):
        self.address = check_loopback(address)
        self.ports = dict(ports)
        self.clients: list[Client] = []
        self.muted = False
        self._selector = selectors.DefaultSelector()
        self._listening: dict[str, socket.socket] = {}
        try:
            for name in ports:
                self.listen(name)
        except InputError:
            self.close()
            raise

    def listen(self, name: str) -> None:
        """Open a server's port."""
        server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            server.bind((self.address, self.ports[name]))
        except OSError as error:
            server.close()
            raise InputError(
                f"port {self.ports[name]} of {self.address} is not free ({error.strerror}): is "
                "another twin running?"
            ) from None
        self.ports[name] = server.getsockname()[1]
        server.listen()
        server.setblocking(False)
        self._listening[name] = server
        self._selector.register(server, selectors.EVENT_READ, name)

    def drop(self, names: set[str]) -> None:
        """Close servers and their clients, as a controller without power does."""
        for name in names & set(self._listening):
            self._selector.unregister(self._listening[name])
            self._listening.pop(name).close()
        for client in self.clients:
            if client.kind in names:
                client.open = False
        self._forget_closed()

    def of(self, kind: str) -> list[Client]:
        """Return the clients of a server."""
        return [client for client in self.clients if client.kind == kind and client.open]

    def poll(
        self,
        timeout: float,
        accepted: Callable[[Client], None],
        received: Callable[[Client, bytes], None],
    ) -> None:
        """Wait for what clients send, and hand it on.

        Args:
            timeout: Longest time to wait [s].
            accepted: Called with every new client.
            received: Called with a client and what it sent.
        """
        for key, _ in self._selector.select(max(timeout, 0.0)):
            if isinstance(key.data, str):
                self._accept(key.fileobj, key.data, accepted)  # pyright: ignore
                continue
            client: Client = key.data
            try:
                data = client.connection.recv(_RECEIVE_SIZE)
            except BlockingIOError:
                continue
            except OSError:
                data = b""
            if not data:
                client.open = False
            else:
                received(client, data)
        for client in self.clients:
            client.flush()
        self._forget_closed()

    def _accept(self, server: socket.socket, name: str, accepted: Callable[[Client], None]) -> None:
        with contextlib.suppress(OSError):
            connection, _ = server.accept()
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client = Client(connection, name)
            self.clients.append(client)
            self._selector.register(connection, selectors.EVENT_READ, client)
            accepted(client)

    def _forget_closed(self) -> None:
        for client in [client for client in self.clients if not client.open]:
            self.clients.remove(client)
            with contextlib.suppress(KeyError, ValueError):
                self._selector.unregister(client.connection)
            client.connection.close()

    def close(self) -> None:
        """Close everything."""
        self.drop(set(self._listening) | {client.kind for client in self.clients})
        self._selector.close()


GREETING = "Connected: Universal Robots Dashboard Server"
_SAFETY_WORDS = {
    SAFETY_NORMAL: "NORMAL",
    SAFETY_PROTECTIVE: "PROTECTIVE_STOP",
    SAFETY_EMERGENCY: "ROBOT_EMERGENCY_STOP",
}


def answer(controller: Controller, line: str) -> str:
    """Return the answer to one command.

    Args:
        controller: Controller that is asked.
        line: Command, without its line break.
    """
    command = line.strip().lower()
    if command not in _QUIET:
        controller.log("dashboard", command=command)
    if command == "stop":
        controller.stop_program("dashboard")
        return "Stopped"
    if command == "unlock protective stop":
        if controller.safety_mode == SAFETY_PROTECTIVE:
            controller.clear()
        return "Protective stop releasing"
    if command == "is in remote control":
        if not controller.is_e_series:
            return f"could not understand: {line.strip()}"
        return str(controller.remote_control).lower()
    return _facts(controller).get(command, f"could not understand: {line.strip()}")


def _facts(controller: Controller) -> dict[str, str]:
    major, minor, bugfix, build = controller.version
    running = controller.is_running_program
    mode = "RUNNING" if controller.robot_mode == MODE_RUNNING else "POWER_OFF"
    state = f"{'PLAYING' if running else 'STOPPED'} {controller.program_name or '<unnamed>'}"
    safety = _SAFETY_WORDS[controller.safety_mode]
    model = controller.setup.arm.model.removesuffix("e").upper()
    return {
        "robotmode": f"Robotmode: {mode}",
        "safetymode": f"Safetymode: {safety}",
        "safetystatus": f"Safetystatus: {safety}",
        "running": f"Program running: {str(running).lower()}",
        "programstate": state,
        "polyscopeversion": f"URSoftware {major}.{minor}.{bugfix}.{build} (Jan 01 2022)",
        "get robot model": model,
        "get serial number": "20260000000",
        "close popup": "closing popup",
        "close safety popup": "closing safety popup",
        "quit": "Disconnected",
    }


_QUIET = {
    "robotmode",
    "safetymode",
    "safetystatus",
    "running",
    "programstate",
    "polyscopeversion",
    "get robot model",
    "get serial number",
    "is in remote control",
    "quit",
}


HEADER = struct.Struct(">HB")
FRAME_SIZE_MAX = 65_535

REQUEST_PROTOCOL_VERSION = ord("V")
GET_VERSION = ord("v")
TEXT_MESSAGE = ord("M")
DATA_PACKAGE = ord("U")
SETUP_OUTPUTS = ord("O")
SETUP_INPUTS = ord("I")
START = ord("S")
PAUSE = ord("P")


INPUTS: dict[str, str] = {
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    "standard_digital_output_mask": "UINT8",
    "standard_digital_output": "UINT8",
    "configurable_digital_output_mask": "UINT8",
    "configurable_digital_output": "UINT8",
    "tool_digital_output_mask": "UINT8",
    "tool_digital_output": "UINT8",
    "standard_analog_output_mask": "UINT8",
    "standard_analog_output_type": "UINT8",
    "standard_analog_output_0": "DOUBLE",
    "standard_analog_output_1": "DOUBLE",
    "external_force_torque": "VECTOR6D",
    "input_bit_registers0_to_31": "UINT32",
    "input_bit_registers32_to_63": "UINT32",
    **{f"input_bit_register_{index}": "BOOL" for index in range(64, 128)},
    **{f"input_int_register_{index}": "INT32" for index in range(48)},
    **{f"input_double_register_{index}": "DOUBLE" for index in range(48)},
}
"""Types of what a client can write."""


def frame(kind: int, payload: bytes = b"") -> bytes:
    """Return one frame."""
    return HEADER.pack(HEADER.size + len(payload), kind) + payload


class FrameReader:
    """Cuts a stream of bytes into frames."""

    def __init__(self) -> None:
        self._buffer = b""

    def feed(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Yield type and payload of every frame that is now whole.

        Raises:
            ValueError: The stream is no RTDE.
        """
        self._buffer += data
        while len(self._buffer) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._buffer)
            if size < HEADER.size:
                raise ValueError(f"a frame of {size} bytes is shorter than its header")
            if len(self._buffer) < size:
                return
            payload, self._buffer = self._buffer[HEADER.size : size], self._buffer[size:]
            yield kind, payload


@dataclasses.dataclass(frozen=True)
class Recipe:
    """Names and layout of a data package.

    Attributes:
        number: Number of the recipe.
        names: Names of its variables.
        types: Type of each, NOT_FOUND where the controller does not know it.
    """

    number: int
    names: tuple[str, ...]
    types: tuple[str, ...]

    @property
    def is_valid(self) -> bool:
        """True where the controller knows every variable, and nobody else writes it."""
        return all(kind in TYPES for kind in self.types)

    @property
    def layout(self) -> struct.Struct:
        """Layout of the values after the recipe's number."""
        return struct.Struct(">" + "".join(TYPES[kind] for kind in self.types))

    def pack(self, state: Mapping[str, Any]) -> bytes:
        """Return a data package of the present state."""
        values: list[Any] = []
        for name in self.names:
            value = state[name]
            if isinstance(value, Sequence):
                values.extend(value)
            else:
                values.append(value)
        return frame(DATA_PACKAGE, bytes([self.number]) + self.layout.pack(*values))

    def unpack(self, payload: bytes) -> dict[str, Any]:
        """Return the values of a data package, without its recipe's number."""
        flat = list(self.layout.unpack(payload))
        values: dict[str, Any] = {}
        for name, kind in zip(self.names, self.types, strict=True):
            count = int(TYPES[kind][:-1] or 1)
            taken, flat = flat[:count], flat[count:]
            values[name] = taken if count > 1 else taken[0]
        return values


_LATE_TIME = 0.3
"""Delay of reports while they are late [s]."""


class RtdeServer:
    """Answers RTDE clients of one controller.

    Args:
        controller: Controller that they talk to.
        state: Function that returns what the controller reports.
        heard: Called after each package of inputs.
    """

    def __init__(
        self,
        controller: Controller,
        state: Callable[[], dict[str, Any]],
        heard: Callable[[], None],
    ):
        self.controller = controller
        self.state = state
        self.heard = heard
        self.lost_until = -1.0
        self.late_until = -1.0
        self._late: collections.deque[tuple[float, Client, bytes]] = collections.deque()
        self._tick = 0

    def accept(self, client: Client) -> None:
        """Begin with a new client."""
        client.state.update(reader=FrameReader(), outputs=None, inputs={}, started=False, every=1)

    def receive(self, client: Client, data: bytes, others: list[Client]) -> None:
        """Answer what a client sent.

        Args:
            client: Client.
            data: Bytes from it.
            others: All clients of this server.
        """
        try:
            for kind, payload in client.state["reader"].feed(data):
                self._answer(client, kind, payload, others)
        except (ValueError, IndexError, UnicodeDecodeError, LookupError):
            self.controller.log("RTDE client sent nonsense")
            client.open = False

    def _answer(self, client: Client, kind: int, payload: bytes, others: list[Client]) -> None:
        if kind == REQUEST_PROTOCOL_VERSION:
            client.send(frame(kind, bytes([int.from_bytes(payload[:2], "big") == 2])))
        elif kind == GET_VERSION:
            client.send(
                frame(kind, b"".join(n.to_bytes(4, "big") for n in self.controller.version))
            )
        elif kind == SETUP_OUTPUTS:
            self._set_outputs(client, payload)
        elif kind == SETUP_INPUTS:
            self._set_inputs(client, payload, others)
        elif kind == START:
            client.state["started"] = True
            client.send(frame(kind, b"\x01"))
        elif kind == PAUSE:
            client.state["started"] = False
            client.send(frame(kind, b"\x01"))
        elif kind == DATA_PACKAGE:
            recipe: Recipe | None = client.state["inputs"].get(payload[0])
            if recipe is None or not recipe.is_valid:
                raise ValueError("a data package of an unknown recipe")
            values = recipe.unpack(payload[1:])
            self.controller.inputs.update(values)
            self.controller.inputs["written at"] = self.controller.time
            self._move_slider(values)
            self.heard()

    def _set_outputs(self, client: Client, payload: bytes) -> None:
        (frequency,) = struct.unpack_from(">d", payload)
        names = _names(payload[8:])
        types = tuple(OUTPUTS.get(name, "NOT_FOUND") for name in names)
        recipe = Recipe(1, names, types)
        client.state["outputs"] = recipe if recipe.is_valid else None
        rate = 1.0 / self.controller.dt
        client.state["every"] = max(1, round(rate / min(max(frequency, 1.0), rate)))
        client.send(frame(SETUP_OUTPUTS, bytes([recipe.number]) + ",".join(types).encode()))

    def _set_inputs(self, client: Client, payload: bytes, others: list[Client]) -> None:
        names = _names(payload)
        taken = {
            name
            for other in others
            if other is not client
            for recipe in other.state["inputs"].values()
            for name in recipe.names
        }
        types = tuple(
            "IN_USE" if name in taken else INPUTS.get(name, "NOT_FOUND") for name in names
        )
        recipe = Recipe(len(client.state["inputs"]) + 1, names, types)
        number = recipe.number if recipe.is_valid else 0
        if recipe.is_valid:
            client.state["inputs"][recipe.number] = recipe
        client.send(frame(SETUP_INPUTS, bytes([number]) + ",".join(types).encode()))

    def _move_slider(self, values: dict[str, Any]) -> None:
        if values.get("speed_slider_mask"):
            fraction = float(values["speed_slider_fraction"])
            self.controller.speed_slider = min(max(fraction, 0.0), 1.0)

    def publish(self, clients: list[Client]) -> None:
        """Send every client what it asked for, once a control cycle."""
        self._tick += 1
        now = self.controller.time
        while self._late and self._late[0][0] <= now:
            _, client, data = self._late.popleft()
            client.send(data)
        wanting = [
            client
            for client in clients
            if client.state["started"]
            and client.state["outputs"] is not None
            and self._tick % client.state["every"] == 0
        ]
        if not wanting or now < self.lost_until:
            return
        state = self.state()
        for client in wanting:
            data = client.state["outputs"].pack(state)
            if now < self.late_until:
                self._late.append((now + _LATE_TIME, client, data))
            elif self._late:
                # No report overtakes another.
                self._late.append((max(now, self._late[-1][0]), client, data))
            else:
                client.send(data)


def _names(text: bytes) -> tuple[str, ...]:
    """Return the names of a recipe; ur-rtde sends a comma after the last."""
    return tuple(name for name in text.decode("ascii").split(",") if name)
