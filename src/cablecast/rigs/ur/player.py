"""Process of its own that talks to the controller through ur-rtde; `UrLink` starts and commands it.

ur-rtde ends its whole process when a connection breaks at the wrong moment, keeps Python's lock
while it connects, and prints to standard output. Here none of that reaches the one who drives the
arm. The heart beats here, too: it stops as soon as the owner is gone, or says nothing.

Commands come in and answers go out as JSON, one a line.

Connection to a UR controller: reports, programs, heartbeat, dashboard.

Reading the controller's state: whether the arm may move, and what a person has to do if not.

Paths of set points for the arm, and the checks that each must pass before it is sent.

The program that carries one motion to the controller, set point by set point.

It runs on the controller's clock. Each cycle it looks whether this computer is still there, and
whether it asks to stop; if so, it brakes and ends. What it does and how far it is stands in
registers that RTDE reports.

Plays one motion on the controller, watches it, and stops the arm whatever happens.

Plays a motion set point by set point from a process of its own, the other mode of a cast.

The controller's clock does not carry the motion here: set points arrive over the network, and a
computer that is busy lets the arm stutter. So the way that the controller says it follows is
compared with the one that was meant, and a cast that differs is aborted.
"""

import collections
import contextlib
import dataclasses
import enum
import itertools
import json
import os
import queue
import socket
import subprocess
import sys
import threading
import time
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.robot import RobotConfig
from cablecast.arm.shape import find_collision
from cablecast.arm.ur import JOINT_NAMES
from cablecast.errors import (
    CablecastError,
    InputError,
    JointLimitError,
    MissingExtraError,
    RigError,
)
from cablecast.setup import Setup

OWNER_TIME_MAX = 0.5
"""Longest time for which the heart beats without a word from the owner [s]."""
_POLL = 0.0005
_CONNECT_TIME_MAX_MS = 3000


class Agent:
    """Connections of ur-rtde to one controller.

    Args:
        out: Stream of answers.
        settings: Address, dashboard port, registers, and the period of the heartbeat.
    """

    def __init__(self, out: TextIO, settings: dict[str, Any]):
        import dashboard_client
        import rtde_io
        import rtde_receive

        self._out = out
        self._settings = settings
        self._lock = threading.Lock()
        self._write_lock = threading.Lock()
        self._alive_until = 0.0
        self._beat = 0
        self._beat_at = 0.0
        address = settings["address"]
        self._dashboard: Any = dashboard_client.DashboardClient(address, settings["dashboard_port"])
        self._dashboard.connect(_CONNECT_TIME_MAX_MS)
        self._receive: Any = rtde_receive.RTDEReceiveInterface(address)
        self._io: Any = rtde_io.RTDEIOInterface(address)
        self._control: Any = None
        for target in (self._record, self._pulse):
            threading.Thread(target=target, daemon=True).start()

    def say(self, values: dict[str, Any]) -> None:
        """Send one answer."""
        with self._lock:
            self._out.write(json.dumps(values) + "\n")
            self._out.flush()

    def obey(self, command: dict[str, Any]) -> None:
        """Carry out one command."""
        do = command["do"]
        if do == "alive":
            self._alive_until = time.monotonic() + OWNER_TIME_MAX
        elif do == "rest":
            self._alive_until = 0.0
        elif do == "write":
            with self._write_lock:
                written = self._io.setInputIntRegister(command["register"], command["value"])
            if not written:
                self.say({"error": f"register {command['register']} was not written"})
        elif do == "ask":
            try:
                self.say({"answer": str(getattr(self._dashboard, command["question"])())})
            except Exception as error:
                self.say({"answer": None, "error": " ".join(str(error).split())[:200]})
        elif do == "stream":
            threading.Thread(target=self._stream, args=(command,), daemon=True).start()

    def _pulse(self) -> None:
        """Change the beat's register as long as the owner wants."""
        while True:
            time.sleep(self._settings["beat_period"])
            self._pulse_once()

    def _pulse_once(self) -> None:
        """Beat, unless the owner is silent or the last beat was just now."""
        now, period = time.monotonic(), self._settings["beat_period"]
        if now > self._alive_until or now - self._beat_at < period / 2:
            return
        self._beat_at = now
        self._beat = (self._beat + 1) % 1_000_000
        with contextlib.suppress(Exception), self._write_lock:
            self._io.setInputIntRegister(self._settings["beat_register"], self._beat)

    def _record(self) -> None:
        """Send every report that is read whole."""
        r, settings = self._receive, self._settings
        state, tick, number = (settings[f"{name}_register"] for name in ("state", "tick", "number"))
        before = -1.0
        while True:
            try:
                now = r.getTimestamp()
                if now == before:
                    time.sleep(_POLL)
                    continue
                report = [
                    now,
                    time.monotonic(),
                    r.getActualQ(),
                    r.getActualQd(),
                    r.getTargetQ(),
                    r.getSpeedScaling() * r.getTargetSpeedFraction(),
                    r.getSafetyStatusBits(),
                    r.getRobotMode(),
                    r.getRuntimeState() == 2,
                    r.getPayload(),
                    self._payload_cog(),
                    r.getOutputIntRegister(state),
                    r.getOutputIntRegister(tick),
                    r.getOutputIntRegister(number),
                ]
                # A report that changed while it was read is read again.
                if r.getTimestamp() == now:
                    before = now
                    self.say({"report": report})
                    # On a busy computer this thread may be the only one that runs in time.
                    self._pulse_once()
            except (BrokenPipeError, ValueError):
                os._exit(0)
            except Exception:
                # A connection that breaks: the silence will be noticed.
                time.sleep(0.01)

    def _payload_cog(self) -> list[float] | None:
        """Return the centre of the payload; None where the controller does not report it."""
        try:
            return self._receive.getPayloadCog()
        except RuntimeError:
            return None

    def _stream(self, command: dict[str, Any]) -> None:
        """Send set points one by one, each a cycle after the one before."""
        import rtde_control

        try:
            if self._control is None:
                self._control = rtde_control.RTDEControlInterface(self._settings["address"])
            control, dt = self._control, command["dt"]
            control.setWatchdog(1.0 / command["watchdog"])
            self.say({"stream": "begins"})
            for tick, q in enumerate(command["q"]):
                if time.monotonic() > self._alive_until:
                    self.say({"stream": "silence", "tick": tick})
                    break
                begin = control.initPeriod()
                control.servoJ(q, 0.0, 0.0, dt, command["lookahead"], command["gain"])
                control.waitPeriod(begin)
            else:
                self.say({"stream": "done"})
            control.servoStop(command["deceleration"])
            control.stopScript()
            control.disconnect()
            self._control = None
        except Exception as error:
            self._control = None
            self.say({"stream": "failed", "error": " ".join(str(error).split())[:200]})


def main() -> None:
    """Connect, say so, and obey until the owner is gone."""
    # What libraries print must not get between the answers.
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    try:
        agent = Agent(out, json.loads(sys.stdin.readline()))
    except ModuleNotFoundError as error:
        out.write(json.dumps({"missing": str(error.name)}) + "\n")
        out.flush()
        return
    except Exception as error:
        out.write(json.dumps({"failed": " ".join(str(error).split())[:200]}) + "\n")
        out.flush()
        os._exit(1)
    agent.say({"connected": True})
    with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
        for line in sys.stdin:
            agent.obey(json.loads(line))
    # ur-rtde's own end may hang or abort, and nothing is left to do.
    os._exit(0)


if __name__ == "__main__":
    main()


RTDE_PORT = 30004
"""Port of RTDE; ur-rtde knows no other."""
_CONNECT_TIME_MAX = 3.0
_AGENT_TIME_MAX = 20.0
_ANSWER_TIME_MAX = 5.0
_ALIVE_PERIOD = 0.05
_REPORT_COUNT_MAX = 100_000
_BEATS_PER_WATCHDOG = 10


@dataclasses.dataclass(frozen=True)
class Report:
    """One report of the controller.

    Attributes:
        time: Controller's clock [s].
        host_time: `time.monotonic` of this computer when it was read [s].
        q: Measured joint angles [rad].
        qd: Measured joint rates [rad/s].
        target_q: Set points that the controller follows [rad].
        speed_scaling: Speed scaling, the slider's included [-].
        safety_bits: Safety status bits of RTDE.
        robot_mode: Robot mode of RTDE; 7 is running.
        is_playing: True while a program runs.
        payload: Payload that is set [kg].
        payload_cog: Centre of that payload in the flange frame [m], shape [3]; None where the
            controller does not report it.
        state: State that the program wrote.
        tick: Set point that the program has reached.
        number: Number of the program.
    """

    time: float
    host_time: float
    q: NDArray[np.float64]
    qd: NDArray[np.float64]
    target_q: NDArray[np.float64]
    speed_scaling: float
    safety_bits: int
    robot_mode: int
    is_playing: bool
    payload: float
    payload_cog: NDArray[np.float64] | None
    state: int
    tick: int
    number: int

    def __post_init__(self):
        for name in ("q", "qd", "target_q"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))
        if self.payload_cog is not None:
            object.__setattr__(self, "payload_cog", np.array(self.payload_cog, dtype=float))


class UrLink:
    """Connection to one controller, through a process of its own (rigs/ur/agent.py).

    Args:
        robot: Address and ports.

    Raises:
        MissingExtraError: ur-rtde is not installed.
        RigError: The controller does not answer.
    """

    def __init__(self, robot: RobotConfig):
        self.robot = robot
        self.reports: collections.deque[Report] = collections.deque(maxlen=_REPORT_COUNT_MAX)
        self.stream_states: queue.Queue[dict[str, Any]] = queue.Queue()
        self._answers: queue.Queue[dict[str, Any]] = queue.Queue()
        self._alive_said = 0.0
        for name, port in (
            ("dashboard", robot.dashboard_port),
            ("RTDE", RTDE_PORT),
            ("program", robot.program_port),
        ):
            _probe(robot.address, port, name)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "cablecast.rigs.ur.player"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            # What ur-rtde prints is no message of ours.
            stderr=subprocess.DEVNULL,
            text=True,
            # Ctrl-C is for the one who drives the arm, who still needs the connection to stop it.
            start_new_session=True,
        )
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
            dashboard_port=robot.dashboard_port,
            beat_period=robot.watchdog / _BEATS_PER_WATCHDOG,
            beat_register=BEAT_REGISTER,
            state_register=STATE_REGISTER,
            tick_register=TICK_REGISTER,
            number_register=NUMBER_REGISTER,
        )
        answer = self._answer(_AGENT_TIME_MAX)
        if "missing" in answer:
            raise MissingExtraError("ur-rtde", "ur", "--rig ur")
        if "connected" not in answer:
            raise RigError(
                f"the controller at {robot.address} refused the connection: {answer.get('failed')}"
            )
        self.wait_for_report()

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
            raise RigError(
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
        begin = time.monotonic()
        deadline = begin + _CONNECT_TIME_MAX
        while not self.reports or self.reports[-1].host_time < begin:
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
        self._tell(do="write", register=STOP_REGISTER, value=number)

    def set_phase(self, phase: int) -> None:
        """Say what the rig is doing."""
        self._tell(do="write", register=PHASE_REGISTER, value=phase)

    def send_program(self, text: str) -> None:
        """Send a program, which runs at once.

        Raises:
            RigError: The controller does not take it.
        """
        try:
            with socket.create_connection(
                (self.robot.address, self.robot.program_port), _CONNECT_TIME_MAX
            ) as connection:
                connection.sendall(text.encode())
        except OSError as error:
            raise RigError(
                f"the controller at {self.robot.address} takes no program: {error}"
            ) from None

    def send_stream(self, q: NDArray[np.float64], dt: float, deceleration: float) -> None:
        """Let the process send set points one by one; `stream_states` says what comes of it."""
        self._tell(
            do="stream",
            q=q.tolist(),
            dt=dt,
            watchdog=self.robot.watchdog,
            lookahead=self.robot.lookahead,
            gain=self.robot.gain,
            deceleration=deceleration,
        )

    def ask(self, question: str) -> str:
        """Return the dashboard's answer to a question: one of ur-rtde's `DashboardClient` methods.

        Raises:
            RigError: The dashboard does not answer.
        """
        self._tell(do="ask", question=question)
        answer = self._answer(_ANSWER_TIME_MAX)
        if answer.get("answer") is None:
            raise RigError(
                f"the dashboard at {self.robot.address} does not answer: {answer.get('error')}"
            )
        return answer["answer"]

    def close(self) -> None:
        """Let go of the controller; it may be called twice."""
        self.rest()
        with contextlib.suppress(OSError, ValueError):
            if self._process.stdin is not None:
                self._process.stdin.close()
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(2.0)
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _tell(self, **command: Any) -> None:
        try:
            stream = self._process.stdin
            if stream is None:
                raise OSError("no stream")
            stream.write(json.dumps(command) + "\n")
            stream.flush()
        except (OSError, ValueError):
            raise RigError(
                f"the connection to the controller at {self.robot.address} broke: look whether it "
                "has power and the network cable is in. The same command resumes"
            ) from None

    def _answer(self, time_max: float) -> dict[str, Any]:
        try:
            return self._answers.get(timeout=time_max)
        except queue.Empty:
            raise RigError(
                f"the controller at {self.robot.address} did not answer within {time_max:g} s"
            ) from None

    def _read(self) -> None:
        """Sort what the process says."""
        stream = self._process.stdout
        for line in stream or ():
            values = json.loads(line)
            if "report" in values:
                self.reports.append(Report(*values["report"]))
            elif "stream" in values:
                self.stream_states.put(values)
            else:
                self._answers.put(values)
        self._answers.put({"failed": "its process ended", "error": "its process ended"})


def _probe(address: str, port: int, name: str) -> None:
    """Refuse an address where nothing listens; ur-rtde would print, and hang."""
    try:
        socket.create_connection((address, port), _CONNECT_TIME_MAX).close()
    except OSError as error:
        raise RigError(
            f"no {name} server answers at {address}:{port} ({error.strerror or error}): look "
            "whether the controller has power, is in the same network, and its services are on"
        ) from None


ROBOT_RUNNING = 7
NORMAL_BIT, REDUCED_BIT = 0, 1
_STOP_WORDS = {
    2: "protective stop",
    3: "recovery mode",
    4: "safeguard stop",
    5: "emergency stop of the system",
    6: "emergency stop of the robot",
    7: "emergency stop",
    8: "safety violation",
    9: "fault",
    10: "stop for safety",
}
_ADVICE = {
    2: "look what the arm touched or which limit it met, make the way free, and enable the robot "
    "on the pendant",
    3: "move the arm back within its limits by hand, as the pendant says",
    4: "step out of the guarded space and reset the safeguard",
    5: "find out why, release the button, and start the robot on the pendant",
    6: "find out why, release the button, and start the robot on the pendant",
    7: "find out why, release the button, and start the robot on the pendant",
}
RESUME = "cablecast never clears a stop; the same command resumes with this trial"
PAYLOAD_TOLERANCE = 0.05
"""Largest difference between the payload of the lab file and that on the controller [kg]."""
CENTER_TOLERANCE = 0.02
"""Largest distance between the centre of the payload in the lab file and on the controller [m]."""
SPEED_TOLERANCE = 1e-3


def stop_text(bits: int) -> str | None:
    """Return what stopped the arm for safety, and what to do; None where nothing did.

    Args:
        bits: Safety status bits of RTDE.
    """
    for bit in (7, 6, 5, 2, 3, 4, 8, 9, 10):
        if bits >> bit & 1:
            advice = _ADVICE.get(bit, "read the pendant's log and clear the cause")
            return f"{_STOP_WORDS[bit]}: {advice}. {RESUME}"
    if not bits >> NORMAL_BIT & 1:
        return f"the safety system is not in its normal mode: read the pendant's log. {RESUME}"
    return None


def check_ready(link: UrLink, robot: RobotConfig) -> Report:
    """Refuse to move unless the controller is ready for it, and return its newest report.

    Args:
        link: Connection to the controller.
        robot: Payload that must be set.

    Raises:
        RigError: It is not; says what a person has to do.
    """
    report = link.wait_for_report()
    if text := stop_text(report.safety_bits):
        raise RigError(text)
    if report.robot_mode != ROBOT_RUNNING:
        raise RigError(
            f"the robot is in mode {report.robot_mode}, not running: power it on and release its "
            "brakes on the pendant"
        )
    if link.ask("polyscopeVersion").strip()[:1] >= "5" and link.ask("isInRemoteControl") != "True":
        raise RigError("the robot is in local control: switch the pendant to remote control")
    if abs(report.speed_scaling - 1.0) > SPEED_TOLERANCE:
        raise RigError(
            f"the speed slider of the pendant is at {100 * report.speed_scaling:.0f} %: set it to "
            "100 %, or casts land elsewhere"
        )
    if abs(report.payload - robot.payload_mass) > PAYLOAD_TOLERANCE:
        raise RigError(
            f"the payload on the controller is {report.payload:.2f} kg, that of the lab file "
            f"{robot.payload_mass:.2f} kg: weigh gripper and cable, and set both alike"
        )
    center = report.payload_cog
    if center is not None and np.linalg.norm(center - robot.payload_cog) > CENTER_TOLERANCE:
        raise RigError(
            f"the payload's centre on the controller is at {center.round(3).tolist()} m, that of "
            f"the lab file at {list(robot.payload_cog)} m: measure it, and set both alike"
        )
    return report


Array = NDArray[np.float64]

CONTROL_DTS = (0.002, 0.004, 0.008)
"""Times between set points that the programs use [s]: whole cycles of both controllers."""
_LIMIT_TOLERANCE = 1.001
_ACCELERATION_MARGIN = 1.25
"""Second differences of set points overshoot the true peak of an acceleration at its corners."""


@dataclasses.dataclass(frozen=True)
class SetPoints:
    """Set points at even times, from rest to rest.

    Attributes:
        q: Joint angles [rad], shape [tick, 6].
        dt: Time between two of them [s].
    """

    q: Array
    dt: float

    def __post_init__(self):
        if self.q.ndim != 2 or self.q.shape[1] != 6 or len(self.q) < 2:
            raise InputError(f"set points have shape {self.q.shape}, not [tick, 6]")
        if not np.all(np.isfinite(self.q)):
            raise InputError("set points must be finite")
        if not any(abs(self.dt - dt) < 1e-9 for dt in CONTROL_DTS):
            known = ", ".join(f"{dt:g}" for dt in CONTROL_DTS)
            raise InputError(f"control_dt = {self.dt:g} s of a robot must be one of {known} s")

    @property
    def duration(self) -> float:
        """Time from the first to the last [s]."""
        return (len(self.q) - 1) * self.dt

    def slowed(self, factor: float) -> "SetPoints":
        """Return the same way at a part of the speed.

        Args:
            factor: Share of the speed, above 0 and at most 1 [-].
        """
        from scipy.interpolate import CubicSpline

        times = np.arange(len(self.q)) * self.dt
        count = int(np.ceil(times[-1] / factor / self.dt)) + 1
        spline = CubicSpline(times, self.q, axis=0, bc_type="clamped")
        q = spline(np.minimum(np.arange(count) * self.dt * factor, times[-1]))
        return SetPoints(np.asarray(q), self.dt)


def joint_move(start: Array, end: Array, speed: float, dt: float) -> SetPoints:
    """Return a straight way in joint space, from rest to rest.

    Args:
        start: Joint angles at its begin [rad], shape [6].
        end: Joint angles at its end [rad], shape [6].
        speed: Largest speed of a joint [rad/s].
        dt: Time between set points [s].
    """
    distance = float(np.abs(end - start).max())
    duration = max(1.875 * distance / speed, 4 * dt)
    count = int(np.ceil(duration / dt)) + 1
    u = np.linspace(0.0, 1.0, count)[:, None]
    return SetPoints(start + u**3 * (10 - 15 * u + 6 * u * u) * (end - start), dt)


def check_path(points: SetPoints, setup: Setup, what: str) -> None:
    """Refuse set points that leave limits or box, or come too close to anything.

    Args:
        points: Set points.
        setup: Arm with its limits, and the robot section with box, margins and obstacles.
        what: Name of the motion in the error.

    Raises:
        JointLimitError: A limit, the box or a distance is violated; names the value and the bound.
        InputError: The set-up has no robot.
    """
    robot, limits = setup.robot, setup.arm.limits
    if robot is None:
        raise InputError("the lab file has no robot section: --rig ur needs one")
    q, dt = points.q, points.dt
    position = np.array(limits.position) - robot.position_margin
    qd = np.diff(q, axis=0) / dt
    padded = np.concatenate([np.zeros((1, 6)), qd, np.zeros((1, 6))])
    qdd = np.diff(padded, axis=0) / dt
    for values, bound, name, unit in (
        (q, position, "at", "rad"),
        (qd, np.array(limits.velocity) * _LIMIT_TOLERANCE, "turning at", "rad/s"),
        (qdd, np.array(limits.acceleration) * _ACCELERATION_MARGIN, "speeding up at", "rad/s²"),
    ):
        over = np.abs(values) - bound
        if over.max() > 0.0:
            tick, joint = np.unravel_index(int(np.argmax(over)), over.shape)
            raise JointLimitError(
                f"{what}: {JOINT_NAMES[int(joint)]} {name} {values[tick, joint]:.3f} {unit} is "
                f"beyond {bound[joint]:.3f} {unit}"
            )
    low, high = np.array(robot.box_low), np.array(robot.box_high)
    for name, places in (
        ("grip", setup.arm.grip_pose(q)[:, :3]),
        ("flange", setup.arm.forward(q)[:, :3, 3]),
    ):
        outside = np.maximum(low - places, places - high).max(axis=1)
        if outside.max() > 0.0:
            tick = int(np.argmax(outside))
            raise JointLimitError(
                f"{what}: the {name} at {places[tick].round(3).tolist()} m is outside the box from "
                f"{low.tolist()} to {high.tolist()} m"
            )
    if found := find_collision(setup.arm, robot, q):
        raise JointLimitError(f"{what}: {found}")


BEAT_REGISTER = 18
"""Input: a number that this computer changes as long as all is well."""
STOP_REGISTER = 19
"""Input: number of the program that shall stop."""
PHASE_REGISTER = 20
"""Input: what the rig is doing, for a person who looks, and for the twin."""
STATE_REGISTER = 12
"""Output: one of `ProgramState`."""
TICK_REGISTER = 13
"""Output: number of the set point that is being approached, from 1; 0 before the motion."""
NUMBER_REGISTER = 14
"""Output: number of the program, so that one is not taken for another."""

STOP_DECELERATION = 15.0
"""Deceleration of all joints when the program stops early [rad/s²]."""
HOLD_TIME = 0.3
"""Time for which the arm holds its place before a motion [s]."""


class ProgramState(enum.IntEnum):
    """States of a program."""

    NONE = 0
    HOLDING = 1
    MOVING = 2
    DONE = 3
    STOPPED = 4
    SILENCE = 5


def motion_program(name: str, points: SetPoints, robot: RobotConfig, number: int) -> str:
    """Return the program of one motion, in URScript.

    Args:
        name: Name of the program.
        points: Set points; the arm stands at the first.
        robot: Settings of servoj, and the longest silence.
        number: Number of the program.
    """
    silence = max(2, round(robot.watchdog / points.dt))
    rows = points.q
    lines = [
        f"def {name}():",
        f"  global beat = read_input_integer_register({BEAT_REGISTER})",
        "  global silence = 0",
        "  global going = True",
        f"  write_output_integer_register({TICK_REGISTER}, 0)",
        f"  write_output_integer_register({STATE_REGISTER}, {ProgramState.HOLDING:d})",
        f"  write_output_integer_register({NUMBER_REGISTER}, {number})",
        "  def watch():",
        f"    local now = read_input_integer_register({BEAT_REGISTER})",
        "    if now == beat:",
        "      silence = silence + 1",
        "    else:",
        "      silence = 0",
        "      beat = now",
        "    end",
        f"    if read_input_integer_register({STOP_REGISTER}) == {number}:",
        "      going = False",
        f"      write_output_integer_register({STATE_REGISTER}, {ProgramState.STOPPED:d})",
        f"    elif silence > {silence}:",
        "      going = False",
        f"      write_output_integer_register({STATE_REGISTER}, {ProgramState.SILENCE:d})",
        "    end",
        "  end",
        "  def go(tick, q):",
        "    if going:",
        "      watch()",
        "      if going:",
        f"        write_output_integer_register({TICK_REGISTER}, tick)",
        f"        servoj(q, t={points.dt:g}, lookahead_time={robot.lookahead:g}, "
        f"gain={robot.gain:g})",
        "      else:",
        f"        stopj({STOP_DECELERATION:g})",
        "      end",
        "    end",
        "  end",
        "  local held = 0",
        f"  while held < {round(HOLD_TIME / points.dt)}:",
        f"    go(0, {_row(rows[0])})",
        "    held = held + 1",
        "  end",
        "  if going:",
        f"    write_output_integer_register({STATE_REGISTER}, {ProgramState.MOVING:d})",
        "  end",
        *(f"  go({tick}, {_row(row)})" for tick, row in enumerate(rows[1:], 1)),
        "  if going:",
        f"    stopj({STOP_DECELERATION:g})",
        f"    write_output_integer_register({STATE_REGISTER}, {ProgramState.DONE:d})",
        "  end",
        "end",
    ]
    return "\n".join(lines) + "\n"


def _row(q) -> str:
    # A microradian moves the grip by less than a micrometre.
    return "[" + ",".join(f"{angle:.6f}" for angle in q) + "]"


REST_SPEED = 0.02
"""Joint speed below which the arm rests, encoder noise included [rad/s]."""
_START_TIME_MAX = 15.0
"""Longest time from sending a program to its first sign of life [s]."""
_STOP_TIME_MAX = 1.0
_TICK_LAG_MAX = 0.1
"""Longest time by which the program may be behind the controller's clock [s]."""
_POLL__player = 0.002
_STREAM_TAIL = 0.3
_START_TOLERANCE = 1e-3


class CastAbortedError(RigError):
    """A motion that was not carried out as it was meant, and from which nothing is learned."""


@dataclasses.dataclass(frozen=True)
class Played:
    """A motion that was carried out.

    Attributes:
        start_time: Begin of the motion by the controller's clock [s].
        reports: All reports from its begin to its end.
    """

    start_time: float
    reports: list[Report]


class Player:
    """Plays motions one after another.

    Args:
        link: Connection to the controller.
        robot: Settings of servoj and of the watchdogs.
    """

    _numbers = itertools.count(1)

    def __init__(self, link: UrLink, robot: RobotConfig):
        self.link = link
        self.robot = robot

    def play(self, name: str, points: SetPoints) -> Played:
        """Play a motion to its end, and stop the arm if anything is not as it should be.

        Args:
            name: Name of the program.
            points: Set points, which have been checked; the arm stands at the first.

        Raises:
            CastAbortedError: The motion was slowed, lagged, or was stopped by somebody.
            RigError: The arm stopped for safety, or the controller is silent.
        """
        link = self.link
        off = float(np.abs(link.latest().q - points.q[0]).max())
        if off > _START_TOLERANCE:
            raise CastAbortedError(
                f"the arm stands {off * 1e3:.1f} mrad from where the motion begins, more than "
                f"{_START_TOLERANCE * 1e3:g} mrad: reset it"
            )
        if self.robot.mode == "stream":
            return self._play_stream(points)
        # The number tells this program from an earlier one, also from that of another session.
        number = next(self._numbers) + int(time.monotonic() * 100) % 1_000_000 * 1000
        number %= 2_000_000_000
        done = False
        try:
            link.keep_alive()
            first = link.latest().time
            link.send_program(motion_program(name, points, self.robot, number))
            self._wait_for_start(number)
            reports = self._watch(points, first, number)
            done = True
            return Played(_start_time(reports, points.dt), reports)
        finally:
            link.rest()
            if not done:
                self.stop(number)

    def _play_stream(self, points: SetPoints) -> Played:
        """Play a motion set point by set point from the connection's process."""
        link = self.link
        done = False
        try:
            before = begin_stream(link, points)
            seen: list[Report] = []
            while not (done or stream_ended(link)):
                link.keep_alive()
                link.latest()
                fresh = link.since(seen[-1].time if seen else before)
                for report in fresh:
                    self._check_motion(report)
                seen.extend(fresh)
                time.sleep(_POLL__player)
            end = link.wait_for_report().time + _STREAM_TAIL
            while link.latest().time < end:
                time.sleep(_POLL__player)
            reports = link.since(before)
            start, deviation = align(reports, points)
            if deviation > DEVIATION_MAX:
                raise CastAbortedError(
                    f"set points arrived {deviation:.3f} rad from where they were meant, more than "
                    f"{DEVIATION_MAX:g} rad: computer or network is busy. Use mode: program"
                )
            done = True
            return Played(start, reports)
        finally:
            link.rest()
            if not done:
                self.stop()

    def stop(self, number: int | None = None) -> None:
        """Stop the arm by every way there is; it may be called at any time.

        Args:
            number: Number of the program to stop; that which runs where None.
        """
        link = self.link
        link.rest()
        with contextlib.suppress(CablecastError):
            link.ask_to_stop(link.latest().number if number is None else number)
        deadline = time.monotonic() + _STOP_TIME_MAX
        while link.is_alive and time.monotonic() < deadline:
            report = link.reports[-1]
            if np.abs(report.qd).max() < REST_SPEED and not report.is_playing:
                return
            time.sleep(_POLL__player)
        # The program ends itself for want of a heartbeat; this is for one that does not.
        with contextlib.suppress(CablecastError):
            link.ask("stop")

    def _wait_for_start(self, number: int) -> None:
        deadline = time.monotonic() + _START_TIME_MAX
        while (report := self.link.latest()).number != number:
            self.link.keep_alive()
            _check_safe(report)
            if time.monotonic() > deadline:
                raise RigError(
                    f"the controller did not start the program within {_START_TIME_MAX:g} s: look "
                    "at the log of the pendant, and whether another program runs"
                )
            time.sleep(_POLL__player)

    def _watch(self, points: SetPoints, first: float, number: int) -> list[Report]:
        """Watch until the motion is done, and return its reports."""
        link = self.link
        seen: list[Report] = []
        start: float | None = None
        while True:
            link.keep_alive()
            newest = link.latest()
            fresh = link.since(seen[-1].time if seen else first)
            for report in fresh:
                self._check(report, number)
                if start is None and report.tick > 0 and report.number == number:
                    start = report.time - report.tick * points.dt
                if start is not None:
                    _check_pace(report, start, points)
            seen.extend(fresh)
            if newest.number == number and newest.state == ProgramState.DONE:
                return seen
            time.sleep(_POLL__player)

    def _check(self, report: Report, number: int) -> None:
        """Refuse a report that says that the program is not as it should be."""
        self._check_motion(report)
        if report.number != number:
            return
        if report.state == ProgramState.SILENCE:
            raise CastAbortedError(
                f"the controller heard nothing of this computer for {self.robot.watchdog:g} s and "
                "stopped the arm: close other programs, or use a cable instead of Wi-Fi"
            )
        if report.state == ProgramState.STOPPED:
            raise CastAbortedError("the motion was stopped")
        if not report.is_playing and report.state != ProgramState.DONE:
            raise CastAbortedError("somebody stopped the program at the pendant")

    def _check_motion(self, report: Report) -> None:
        """Refuse a report that says that the arm does not move as it should."""
        _check_safe(report)
        if abs(report.speed_scaling - 1.0) > SPEED_TOLERANCE:
            raise CastAbortedError(
                f"the speed fell to {100 * report.speed_scaling:.0f} % in the motion: set the "
                "slider of the pendant to 100 %, or lower v_max if the arm is at its limits"
            )
        lag = float(np.abs(report.q - report.target_q).max())
        if lag > self.robot.lag_max:
            raise CastAbortedError(
                f"a joint lags {lag:.2f} rad behind its set point, more than "
                f"{self.robot.lag_max:g} rad: the arm is at its limits, or something holds it"
            )


def _check_safe(report: Report) -> None:
    if text := stop_text(report.safety_bits):
        raise RigError(text)


def _check_pace(report: Report, start: float, points: SetPoints) -> None:
    """Refuse a program that falls behind the clock: the controller has slowed it."""
    if report.state != ProgramState.MOVING:
        return
    behind = report.time - start - report.tick * points.dt
    if behind > _TICK_LAG_MAX:
        raise CastAbortedError(
            f"the program is {behind:.3f} s behind the controller's clock, more than "
            f"{_TICK_LAG_MAX:g} s: the controller has slowed it"
        )


def _start_time(reports: list[Report], dt: float) -> float:
    """Return when the motion began by the controller's clock [s]."""
    begins = [r.time - r.tick * dt for r in reports if r.state == ProgramState.MOVING and r.tick]
    if not begins:
        raise CastAbortedError(f"no report came from the motion after its hold of {HOLD_TIME:g} s")
    return float(np.median(begins))


BEGIN_TIME_MAX = 20.0
"""Longest time for ur-rtde to upload its program and begin [s]."""
DEVIATION_MAX = 0.03
"""Largest distance between the set points that were meant and those that arrived [rad]."""
_MOVED = 1e-4
_POLL__streaming = 0.002
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
            state = link.stream_states.get(timeout=_POLL__streaming)
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
