"""Connection to a UR controller: reports, programs, heartbeat, dashboard, readiness."""

import collections
import contextlib
import dataclasses
import json
import queue
import re
import socket
import struct
import subprocess
import sys
import threading
import time
from typing import Any, TextIO, cast

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.ur import LINKS
from cablecast.errors import RigError, StoppedError
from cablecast.rigs.driver import ArmReport, RigPhase
from cablecast.rigs.ur.agent import DASHBOARD_PORT, PROGRAM_PORT
from cablecast.rigs.ur.config import RobotUR
from cablecast.rigs.ur.rtde import (
    CB3,
    CB3_MODELS,
    E_SERIES,
    PHASE,
    POLYSCOPE_X,
    RTDE_PORT,
    STOP,
    FrameReader,
    Version,
    read_version,
)

_CONNECT_TIME_MAX = 3.0
_AGENT_TIME_MAX = 20.0
_ANSWER_TIME_MAX = 10.0
_ALIVE_PERIOD = 0.05
_GREETING_SIZE, _GREETING_TIME_MAX = 79, 0.3
"""The port for programs speaks first: bytes that a sender has to read, or its program may be
discarded (Script Manual, Connecting to URControl); and the longest wait for them, during which the
heart beats on [s]."""
_PLAYING_TIME_MAX = 0.5
"""Longest time for which our last program may still count as running [s]."""
_REPORT_COUNT_MAX = 100_000
_BEATS_PER_WATCHDOG = 10


@dataclasses.dataclass(frozen=True)
class Report(ArmReport):
    """One report of a UR controller, whose speed scaling includes the slider's.

    Attributes:
        robot_mode: Robot mode of RTDE; 7 is running.
        payload: Payload that is set [kg]; None where the controller does not report it.
        payload_cog: Centre of that payload in the flange frame [m], shape [3]; None where the
            controller does not report it.
        state: State that the program wrote.
        tick: Time of the set point that the program has reached, in units of `TICK_DT`.
        number: Number of the program.
    """

    robot_mode: int
    payload: float | None
    payload_cog: NDArray[np.float64] | None
    state: int
    tick: int
    number: int

    def __post_init__(self):
        super().__post_init__()
        if self.payload_cog is not None:
            object.__setattr__(self, "payload_cog", np.array(self.payload_cog, dtype=float))


_REMOTE_CONTROL_SINCE = (5, 6, 0)
BY_HAND = (
    "PolyScope X has no dashboard: see to it on the pendant that remote control is on and no other "
    "program runs, and enable the robot there after a stop"
)


class UrLink:
    """Connection to one controller, through a process of its own (rigs/ur/agent.py).

    Args:
        robot: Address and ports.

    Attributes:
        version: Version of the controller's software.

    Raises:
        RigError: The controller does not answer, or its generation is unknown.
    """

    def __init__(self, robot: RobotUR):
        self.robot = robot
        self.reports: collections.deque[Report] = collections.deque(maxlen=_REPORT_COUNT_MAX)
        self._answers: queue.Queue[dict[str, Any]] = queue.Queue()
        self._alive_said = 0.0
        self._sender: socket.socket | None = None
        with _reach(robot.address, RTDE_PORT, "RTDE") as connection:
            self.version = _read_version(connection, robot.address)
        _reach(robot.address, PROGRAM_PORT, "program").close()
        if self.has_dashboard:
            _reach(robot.address, DASHBOARD_PORT, "dashboard").close()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "cablecast.rigs.ur.agent"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            # Ctrl-C is for the one who drives the arm, who still needs the connection to stop it.
            start_new_session=True,
        )
        # Pipes are there, for they were asked for.
        self._stdin = cast(TextIO, self._process.stdin)
        self._stdout = cast(TextIO, self._process.stdout)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        try:
            self._connect()
        except BaseException:
            self.close()
            raise

    def _connect(self) -> None:
        robot = self.robot
        self._tell(
            address=robot.address,
            beat_period=robot.watchdog / _BEATS_PER_WATCHDOG,
            input_register=robot.input_register,
            output_register=robot.output_register,
        )
        try:
            answer = self._answers.get(timeout=_AGENT_TIME_MAX)
        except queue.Empty:
            raise RigError(
                f"the controller at {robot.address} did not answer within {_AGENT_TIME_MAX:g} s"
            ) from None
        if "refused" in answer:
            raise RigError(answer["refused"])
        if "connected" not in answer:
            raise RigError(
                f"the controller at {robot.address} refused the connection: {answer.get('failed')}"
            )
        self.wait_for_report()

    @property
    def has_dashboard(self) -> bool:
        """True but for PolyScope X, which came without one."""
        return self.version[0] < POLYSCOPE_X

    @property
    def is_alive(self) -> bool:
        """True while reports arrive."""
        if self._process.poll() is not None or not self.reports:
            return False
        return time.monotonic() - self.reports[-1].host_time < self.robot.silence_max

    def latest(self) -> Report:
        """Return the newest report.

        Raises:
            RigError: None has come for too long.
        """
        if not self.is_alive:
            raise StoppedError(
                f"the controller at {self.robot.address} has been silent for "
                f"{self.robot.silence_max:g} s: look whether it has power and the network cable "
                "is in; the arm stops by itself. The same command resumes"
            )
        return self.reports[-1]

    def since(self, when: float) -> list[Report]:
        """Return the reports after a time by the controller's clock, oldest first."""
        found: list[Report] = []
        for index in range(1, len(self.reports) + 1):
            report = self.reports[-index]
            if report.time <= when:
                break
            # The deque grows at its end meanwhile, so that one may come up twice.
            if not found or report.time < found[-1].time:
                found.append(report)
        return found[::-1]

    def wait_for_report(self) -> Report:
        """Wait for a report that is read after this was called, and return it."""
        start = time.monotonic()
        deadline = start + _CONNECT_TIME_MAX
        while not self.reports or self.reports[-1].host_time < start:
            if self.reports:
                self.latest()
            elif time.monotonic() > deadline:
                raise RigError(f"the controller at {self.robot.address} reports nothing")
            time.sleep(0.001)
        return self.reports[-1]

    def keep_alive(self) -> None:
        """Let the heart beat on for a while; call it as long as the arm is watched."""
        now = time.monotonic()
        if now - self._alive_said > _ALIVE_PERIOD:
            self._alive_said = now
            self._tell(do="alive")

    def rest(self) -> None:
        """Let the heart stop, and with it any program of ours."""
        self._alive_said = 0.0
        with contextlib.suppress(RigError):
            self._tell(do="rest")

    def ask_to_stop(self, number: int) -> None:
        """Ask the program of a number to stop; one that comes later does not heed it."""
        self._tell(do="write", register=STOP, value=number)

    def set_phase(self, phase: RigPhase) -> None:
        """Say what the rig is doing."""
        self._tell(do="write", register=PHASE, value=phase)

    def send_program(self, text: str) -> None:
        """Send a program, which runs at once.

        Raises:
            RigError: The controller does not take it.
        """
        self._hang_up()
        try:
            place = (self.robot.address, PROGRAM_PORT)
            connection = socket.create_connection(place, _CONNECT_TIME_MAX)
            self._sender = connection
            connection.settimeout(_GREETING_TIME_MAX)
            heard = 0
            with contextlib.suppress(TimeoutError):
                while heard < _GREETING_SIZE and (data := connection.recv(4096)):
                    heard += len(data)
            connection.settimeout(_CONNECT_TIME_MAX)
            connection.sendall(text.encode())
            # Closed with something unread, it would take the program along.
            threading.Thread(target=_read_on, args=(connection,), daemon=True).start()
        except OSError as error:
            self._hang_up()
            raise RigError(
                f"the controller at {self.robot.address} takes no program: {error}"
            ) from None

    def ask(self, question: str) -> str:
        """Return the dashboard's answer to a command of its manual, one line.

        Raises:
            RigError: The dashboard does not answer in time.
        """
        address = self.robot.address
        # A connection for each: no answer that comes too late belongs to a later question.
        with (
            _reach(address, DASHBOARD_PORT, "dashboard") as connection,
            connection.makefile("rb") as stream,
        ):
            connection.settimeout(_ANSWER_TIME_MAX)
            try:
                # It greets first.
                stream.readline()
                connection.sendall(f"{question}\n".encode())
                answer = stream.readline()
                if not answer.endswith(b"\n"):
                    raise OSError("it hung up")
                return answer.decode("utf-8", "replace").strip()
            except OSError as error:
                raise RigError(
                    f"the dashboard at {address} did not answer {question!r} within "
                    f"{_ANSWER_TIME_MAX:g} s ({error}): the controller is busy, or the network "
                    "slow. Wait until the pendant responds. The same command resumes"
                ) from None

    def arm_name(self) -> str:
        """Return what the dashboard calls its arm; empty where it does not answer."""
        with contextlib.suppress(RigError):
            return self.ask("get robot model") if self.has_dashboard else ""
        return ""

    def stop_program(self) -> None:
        """End whatever program runs; the arm brakes.

        Raises:
            RigError: The controller does not take it.
        """
        if self.has_dashboard:
            self.ask("stop")
        else:
            # A program replaces the one that runs.
            self.send_program("def cablecast_stop():\n  stopj(15)\nend\n")

    def _hang_up(self) -> None:
        if self._sender is not None:
            # What reads on holds it open otherwise.
            with contextlib.suppress(OSError):
                self._sender.shutdown(socket.SHUT_RDWR)
            self._sender.close()
            self._sender = None

    def close(self) -> None:
        """Disconnect; may be called twice."""
        self.rest()
        self._hang_up()
        with contextlib.suppress(OSError, ValueError):
            self._stdin.close()
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(2.0)
        self._stdout.close()

    def _tell(self, **command: Any) -> None:
        try:
            self._stdin.write(json.dumps(command) + "\n")
            self._stdin.flush()
        except (OSError, ValueError):
            raise StoppedError(
                f"the connection to the controller at {self.robot.address} broke: look whether it "
                "has power and the network cable is in. The same command resumes"
            ) from None

    def _read(self) -> None:
        """Sort what the process says."""
        # A process that is killed may leave half a line.
        with contextlib.suppress(json.JSONDecodeError):
            for line in self._stdout:
                values = json.loads(line)
                if "report" in values:
                    self.reports.append(Report(*values["report"]))
                else:
                    self._answers.put(values)
        self._answers.put({"failed": "its process ended"})


def _reach(address: str, port: int, name: str) -> socket.socket:
    """Return a connection to one of the controller's servers."""
    try:
        return socket.create_connection((address, port), _CONNECT_TIME_MAX)
    except OSError as error:
        raise RigError(
            f"no {name} server answers at {address}:{port} ({error.strerror or error}): look "
            "whether the controller has power, is in the same network, and its services are on"
        ) from None


def _read_on(connection: socket.socket) -> None:
    """Read what nobody wants to know, until the connection is closed."""
    with contextlib.suppress(OSError):
        connection.settimeout(None)
        while connection.recv(1 << 16):
            pass


def _read_version(connection: socket.socket, address: str) -> Version:
    """Return the version of the controller's software, which RTDE tells in every generation.

    Raises:
        RigError: It does not tell, or no such generation is known.
    """
    connection.settimeout(_ANSWER_TIME_MAX)
    try:
        major, minor, bugfix = read_version(connection, FrameReader())
    except (OSError, ValueError, struct.error) as error:
        raise RigError(f"the controller at {address} does not say its version: {error}") from None
    if major not in (CB3, E_SERIES, POLYSCOPE_X):
        raise RigError(
            f"the controller at {address} runs version {major}.{minor}.{bugfix}, and cablecast "
            "knows 3 (CB3), 5 (e-Series) and 10 (PolyScope X): it moves no arm whose controller it "
            "does not know"
        )
    return major, minor, bugfix


_ROBOT_RUNNING = 7
_FIND_OUT = "find out why, release the button, and start the robot on the pendant"
_READ_LOG = "read the pendant's log and clear the cause"
_STOPS = {
    7: ("emergency stop", _FIND_OUT),
    6: ("emergency stop of the robot", _FIND_OUT),
    5: ("emergency stop of the system", _FIND_OUT),
    2: (
        "protective stop",
        "look what the arm touched or which limit it met, make the way free, and enable the robot "
        "on the pendant",
    ),
    3: ("recovery mode", "move the arm back within its limits by hand, as the pendant says"),
    4: ("safeguard stop", "step out of the guarded space and reset the safeguard"),
    8: ("safety violation", _READ_LOG),
    9: ("fault", _READ_LOG),
    10: ("stop for safety", _READ_LOG),
    1: ("reduced mode (bit 1)", "leave the reduced space, or switch its safety input off"),
}
"""Names of RTDE's safety status bits, and what to do; the most telling first. Bit 0 is normal."""
_RESUME = "cablecast never clears a stop; the same command resumes with this trial"
PAYLOAD_TOLERANCE = 0.05
"""Largest difference between the payload of the lab file and that on the controller [kg]."""
CENTER_TOLERANCE = 0.02
"""Largest distance between the centre of the payload in the lab file and on the controller [m]."""
SPEED_TOLERANCE = 1e-3


def check_safe(report: Report) -> None:
    """Refuse a report of an arm that is stopped for safety.

    Raises:
        StoppedError: It is stopped; says why, and what a person has to do.
    """
    for bit, (name, advice) in _STOPS.items():
        if report.safety_bits >> bit & 1:
            raise StoppedError(f"{name}: {advice}. {_RESUME}")
    if not report.safety_bits & 1:
        raise StoppedError(
            f"the safety system is not in its normal mode: read the pendant's log. {_RESUME}"
        )


def check_arm(version: Version, model: str, named: str = "") -> None:
    """Refuse an arm that cannot belong to the controller: it would move to other places.

    Args:
        version: Version of the controller's software.
        model: Model of the arm in the lab file.
        named: Name that the dashboard gives to its arm, such as UR5 for a UR5 and a UR5e; anything
            else where it does not know.

    Raises:
        RigError: It cannot.
    """
    if (version[0] == CB3) != (model in CB3_MODELS):
        known = f"a CB3 moves {', '.join(CB3_MODELS)}" if version[0] == CB3 else "no CB3"
        raise RigError(
            f"the lab file describes a {model}, and the controller runs version "
            f"{'.'.join(map(str, version))}: {known}. Set arm model to that of your arm, and "
            "measure its five values"
        )
    size = re.fullmatch(r"ur *(\d+)e?", named.strip().lower())
    models = [f"ur{size[1]}", f"ur{size[1]}e"] if size else []
    known = [LINKS[name] for name in models if name in LINKS]
    if known and LINKS[model] not in known:
        raise RigError(
            f"the lab file describes a {model}, and the controller moves a {named.strip()}: set "
            "arm model to that of your arm, and measure its five values"
        )


def check_ready(link: UrLink) -> Report:
    """Refuse to move unless the controller is ready for it, and return its newest report.

    Raises:
        RigError: It is not; says what a person has to do.
    """
    deadline = time.monotonic() + _PLAYING_TIME_MAX
    while (report := link.wait_for_report()).is_playing:
        if time.monotonic() > deadline:
            raise StoppedError(
                "another program runs on the controller, and a cast would replace it: stop it on "
                "the pendant. The same command resumes"
            )
    check_report(report, link.robot)
    # RTDE tells all the rest; of PolyScope X nobody tells it.
    if _REMOTE_CONTROL_SINCE <= link.version < (POLYSCOPE_X, 0, 0):
        answer = link.ask("is in remote control")
        if answer.lower() != "true":
            raise StoppedError(
                "the robot is in local control: switch the pendant to remote control"
            )
    return report


def check_report(report: Report, robot: RobotUR) -> None:
    """Refuse a report of an arm that is not as the lab file says.

    Raises:
        RigError: It is not; says what a person has to do.
    """
    check_safe(report)
    if report.robot_mode != _ROBOT_RUNNING:
        raise RigError(
            f"the robot is in mode {report.robot_mode}, not running: power it on and release its "
            "brakes on the pendant"
        )
    if abs(report.speed_scaling - 1.0) > SPEED_TOLERANCE:
        raise RigError(
            f"the speed slider of the pendant is at {100 * report.speed_scaling:.3g} %: set it to "
            "100 %, or casts land elsewhere"
        )
    mass, center = report.payload, report.payload_cog
    if mass is not None and abs(mass - robot.payload_mass) > PAYLOAD_TOLERANCE:
        raise RigError(
            f"the payload on the controller is {mass:.2f} kg, that of the lab file "
            f"{robot.payload_mass:.2f} kg: weigh gripper and cable, and set both alike"
        )
    if center is not None and np.linalg.norm(center - robot.payload_cog) > CENTER_TOLERANCE:
        raise RigError(
            f"the payload's centre on the controller is at {center.round(3).tolist()} m, that of "
            f"the lab file at {list(robot.payload_cog)} m: measure it, and set both alike"
        )
