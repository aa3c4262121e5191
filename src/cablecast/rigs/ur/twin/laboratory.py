"""The twin's world: one controller, one arm, one cable, a camera, and the faults that it makes."""

import collections
import dataclasses
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.conventions import finite_or_none, tangent
from cablecast.errors import CablecastError, InputError, check_count, check_number, check_seed
from cablecast.motion.polar import reset_pose
from cablecast.rigs.driver import RigPhase
from cablecast.rigs.ur.agent import DASHBOARD_PORT, PROGRAM_PORT
from cablecast.rigs.ur.program import ProgramState
from cablecast.rigs.ur.rtde import CB3_MODELS, PHASE, RTDE_PORT, STATE
from cablecast.rigs.ur.twin.controller import GENERATIONS, MODE_POWER_OFF, Controller
from cablecast.rigs.ur.twin.servers import (
    DASHBOARD_GREETING,
    STATE_PERIOD,
    Client,
    RtdeServer,
    Servers,
    dashboard_answer,
    robot_state,
    version_message,
)
from cablecast.rigs.ur.twin.urscript import PROGRAM_SIZE_MAX
from cablecast.rigs.virtual.camera_stream import CameraStream
from cablecast.rigs.virtual.config import CameraConfig, VirtualConfig
from cablecast.rigs.virtual.laboratory import LiveCable
from cablecast.setup import Setup

CAMERA_DT = 0.008
"""Time between two instants that the camera is shown [s]."""
RESET_GLANCE, RESET_GLANCE_PERIOD = 0.06, 0.5
"""While the arm carries the cable back, the camera is shown this much of every period [s]: nobody
looks then, and drawing whole resets would take minutes."""

_HISTORY_TIME = 120.0
_LATE_TIME, _LOST_TIME, _SILENT_TIME, _RESTART_TIME = 1.0, 1.0, 5.0, 1.0
_SLOW_TIME = 3.0
_HURRY_MAX = 0.02
_CROOKED = np.radians(15.0)
_PROGRAM_IDLE_TIME = 0.05
_STICK_NODE_COUNT = 12
_ROBOT_SERVERS = {"rtde": RTDE_PORT, "dashboard": DASHBOARD_PORT, "program": PROGRAM_PORT}
"""Ports of the controller's own servers, which fall silent with it."""
ADMIN_PORT = 30101
"""Port that takes faults, and tells the truth to tests."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TwinConfig:
    """Settings of a twin.

    Attributes:
        address: Loopback address. Ports are fixed, so that two twins at a time need two addresses:
            on Linux, 127.0.0.1 to 127.255.255.254 are all of this computer.
        camera_port: Port of the camera's stream, on 127.0.0.1; 0 for any free one.
        rate: Largest speed of the twin's clock [-]: 1 for that of the world, more for tests. It
            runs slower where the simulation cannot keep up, and no faster than the world where no
            client of RTDE is connected.
        patience: Longest time for which the clock waits for a silent client while a program runs
            [s], so that the watchdog does not bark at a busy computer. A real controller waits for
            nobody.
        seed: Seed of what differs from trial to trial.
        segment_count: Segments of the simulated cable.
        program_size_max: Longest program that the controller takes [byte].
        has_cable: False for an arm that holds a stick as long as the cable, which is quicker.
        generation: One of `GENERATIONS`; by default "cb3", or "e-series" for an arm of that series.
    """

    address: str = "127.0.0.1"
    camera_port: int = 30100
    rate: float = 1.0
    patience: float = 0.0
    seed: int = 0
    segment_count: int = 30
    has_cable: bool = True
    program_size_max: int = PROGRAM_SIZE_MAX
    generation: str = ""

    def __post_init__(self):
        check_count("twin camera_port", self.camera_port, 0, 65535)
        check_number("twin rate", self.rate, 0.01, 100.0)
        check_number("twin patience", self.patience, 0.0, 60.0)
        check_seed(self.seed)
        check_count("twin segment_count", self.segment_count, 4, 200)
        check_count("twin program_size_max", self.program_size_max, 1, 10_000_000)
        if self.generation not in ("", *GENERATIONS):
            raise InputError(
                f"unknown generation {self.generation[:40]!r} of a twin: one of "
                f"{', '.join(GENERATIONS)}"
            )

    def generation_of(self, model: str) -> str:
        """Return the generation of a twin of an arm, by the name of its model.

        Raises:
            InputError: There is no such arm with that generation's controller.
        """
        is_cb3 = model in CB3_MODELS
        generation = self.generation or ("cb3" if is_cb3 else "e-series")
        if is_cb3 != (generation == "cb3"):
            raise InputError(f"there is no {model} with a controller of generation {generation}")
        return generation


FAULTS: dict[str, str] = {
    "protective_stop": "protective stop, as after a collision",
    "emergency_stop": "emergency stop button pressed",
    "speed_slider": "speed slider at 50 %",
    "wrong_payload": "payload set to 0 kg on the controller",
    "lost_packets": "reports of the controller are lost for 1 s",
    "late_packets": "reports of the controller come 0.3 s late",
    "network_lost": "nothing passes between computer and controller for 5 s",
    "controller_dies": "controller without power",
    "controller_restarts": "controller without power for 1 s, then up again",
    "program_stopped": "somebody presses stop on the pendant",
    "local_control": "the pendant is switched to local control",
    "dashboard_slow": "each answer of the dashboard takes 3 s",
    "dashboard_off": "the dashboard's service is switched off",
    "cable_slips": "the cable slips in the jaws",
    "cable_drops": "the cable slips out of the jaws",
    "crooked_reset": "the reset leaves the cable 15 deg aside",
    "camera_frozen": "the camera sends the same picture again and again",
    "camera_black": "the camera sees nothing",
    "camera_unplugged": "the camera's stream ends",
    "camera_exposed": "something changes the camera's exposure",
    "camera_moved_tag": "somebody moves a tag",
}
"""Faults of the twin, each in words."""


def faults_of(generation: str) -> list[str]:
    """Return the faults that a generation of controllers can have."""
    g = GENERATIONS[generation]
    impossible = set() if g.has_remote_control else {"local_control"}
    if not g.has_dashboard:
        impossible |= {"dashboard_slow", "dashboard_off"}
    return [name for name in FAULTS if name not in impossible]


PHASES = ("idle", "reset", "approach", "cast", "settle", "readout", "now")
"""Phases that a fault may wait for: the arm stands, the reset's motion, the hold at the start of a
cast, the cast's motion, the time in which the cable comes to rest, and the end of the film. "now"
waits for nothing."""


@dataclasses.dataclass(frozen=True)
class Fault:
    """One fault that waits for its moment.

    Attributes:
        name: One of `FAULTS`.
        phase: One of `PHASES`.
        after: Time from the start of the phase to the fault [s].
    """

    name: str
    phase: str = "now"
    after: float = 0.0

    def __post_init__(self):
        if self.name not in FAULTS:
            raise InputError(f"unknown fault {self.name[:40]!r}: one of {', '.join(FAULTS)}")
        if self.phase not in PHASES:
            raise InputError(f"unknown phase {self.phase[:40]!r}: one of {', '.join(PHASES)}")
        check_number("fault after", self.after, 0.0, 600.0, "s")


class TwinLaboratory:
    """A controller and the world around it.

    Args:
        setup: Lab file of the twin, with a robot section.
        config: Where it listens, and how it behaves.

    Raises:
        InputError: A port is not free, or the set-up has no robot.
    """

    def __init__(self, setup: Setup, config: TwinConfig):
        self.setup = setup
        self.config = config
        home = np.asarray(reset_pose(setup.workspace), dtype=float)
        self.generation = config.generation_of(setup.arm.model)
        self.controller = Controller(setup, setup.arm.inverse(home), self.generation)
        self.controller.program_size_max = config.program_size_max
        self.cable: LiveCable | None = None
        # One that swings in the air is not simulated.
        if config.has_cable and setup.strike is None:
            lab = VirtualConfig(segment_count=config.segment_count)
            self.cable = LiveCable(setup, lab, config.seed)
        # Phases that were said since the last tick: a slow tick may miss a short one.
        self._said: set[str] = set()
        self.rtde = RtdeServer(self.controller, config.seed, lambda: self._said.add(self.phase))
        self.faults: list[Fault] = []
        self._robot_servers = set(_ROBOT_SERVERS)
        if not self.controller.generation.has_dashboard:
            self._robot_servers.remove("dashboard")
        ports = {**_ROBOT_SERVERS, "admin": ADMIN_PORT}
        self.servers = Servers(config.address, ports, self._robot_servers | {"admin"})
        self._phase = ("idle", self.controller.time)
        self._held: list[tuple[Client, bytes]] = []
        self._senders: list[Client] = []
        self._silent_until = -1.0
        self._answer_time = 0.0
        self._answers: collections.deque[tuple[float, Client, str]] = collections.deque()
        self._restart_at: float | None = None
        self._next_picture = self._next_state = 0.0
        self._heard_at = time.monotonic()
        self.camera = self._make_camera()
        self._grip = setup.arm.grip_pose(self.controller.arm.q)
        self._history: collections.deque[tuple[float, NDArray[np.float64], float]] = (
            collections.deque(maxlen=round(_HISTORY_TIME / self.controller.dt))
        )

    def run(self, is_wanted: Callable[[], bool]) -> None:
        """Run as long as it is wanted, which is asked every control cycle."""
        due = time.monotonic()
        while is_wanted():
            # A twin that is late does not hurry, or its clients miss reports: its clock just runs
            # slower.
            due = max(due + self.controller.dt / self._rate(), time.monotonic() - _HURRY_MAX)
            while True:
                self.servers.poll(due - time.monotonic(), self._accepted, self._received)
                if time.monotonic() >= due:
                    break
            if not self._is_waiting():
                self.tick()

    def _rate(self) -> float:
        """Return the speed of the clock: no more than that of the world where nobody is there."""
        return self.config.rate if self.servers.of("rtde") else min(self.config.rate, 1.0)

    def _is_waiting(self) -> bool:
        """Return whether the clock waits for a client that is silent."""
        controller = self.controller
        silence = controller.time - controller.inputs.get("written at", controller.time)
        if not controller.is_running_program or silence < controller.robot.watchdog / 4:
            self._heard_at = time.monotonic()
            return False
        return time.monotonic() - self._heard_at < self.config.patience

    def tick(self) -> None:
        """Advance the world by one control cycle."""
        controller = self.controller
        self._read_programs()
        while self._answers and self._answers[0][0] <= controller.time:
            _, client, line = self._answers.popleft()
            client.send(line.encode())
        self._make_faults()
        poses = controller.tick()
        self._grip = poses[-1]
        if self.cable is not None:
            is_reset = self._phase[0] == "reset"
            trial = self.cable.update(poses, controller.at_rest, is_reset)
            if trial is not None:
                controller.arm.prepare(trial)
                controller.log("cable laid down", number=self.cable.trial_count)
        speed = float(np.abs(controller.arm.qd).max())
        self._history.append((controller.time, self._nodes()[-1].copy(), speed))
        if controller.time >= self._silent_until:
            for client, data in self._held:
                self._serve(client, data)
            self._held.clear()
            self.rtde.publish(self.servers.of("rtde"))
            if controller.time >= self._next_state:
                self._next_state = controller.time + STATE_PERIOD
                for client in self.servers.of("program"):
                    client.send(robot_state(controller))
        self._show_camera()

    def close(self) -> None:
        """Close all sockets, and stop the camera."""
        self.servers.close()
        if self.camera is not None:
            self.camera.close()

    def _nodes(self) -> NDArray[np.float64]:
        """Return the cable, or the stick in its place, from grip to endpoint, shape [node, 3]."""
        if self.cable is not None:
            return self.cable.nodes
        pose = self._grip
        arc = np.linspace(0.0, self.setup.cable.length, _STICK_NODE_COUNT)
        return pose[:3] + arc[:, None] * tangent(pose[3], pose[4])

    def _accepted(self, client: Client) -> None:
        if client.kind == "rtde":
            self.rtde.accept(client)
        elif client.kind == "dashboard":
            self._answer(client, DASHBOARD_GREETING)
        elif client.kind == "program":
            self._senders.append(client)
            client.send(version_message(self.controller) + robot_state(self.controller))
        client.state.update(text=b"", at=0.0)

    def _received(self, client: Client, data: bytes) -> None:
        if client.kind in _ROBOT_SERVERS and self.controller.time < self._silent_until:
            self._held.append((client, data))
        else:
            self._serve(client, data)

    def _serve(self, client: Client, data: bytes) -> None:
        if client.kind == "rtde":
            self.rtde.receive(client, data, self.servers.of("rtde"))
            return
        client.state["text"] += data
        if client.kind == "program":
            client.state["at"] = time.monotonic()
            return
        *lines, client.state["text"] = client.state["text"].split(b"\n")
        for line in lines:
            text = line.decode("utf-8", "replace")
            if client.kind == "dashboard":
                self._answer(client, dashboard_answer(self.controller, text))
            else:
                client.send(json.dumps(self._administer(text)).encode() + b"\n")

    def _answer(self, client: Client, line: str) -> None:
        """Let the dashboard answer now, also while the clock waits, or late."""
        if self._answer_time == 0.0:
            client.send(f"{line}\n".encode())
        else:
            self._answers.append((self.controller.time + self._answer_time, client, f"{line}\n"))

    def _read_programs(self) -> None:
        """Run each program that has arrived whole, that is, up to its last `end`."""
        for client in list(self._senders):
            text = client.state["text"]
            if time.monotonic() - client.state["at"] < _PROGRAM_IDLE_TIME:
                continue
            # A sender may close its connection as soon as it has sent all.
            if text.rstrip(b"\r\n").endswith(b"\nend"):
                client.state["text"] = b""
                self.controller.load(text.decode("utf-8", "replace"))
            elif not client.open:
                self._senders.remove(client)

    def _administer(self, text: str) -> dict[str, Any]:
        """Answer one command of a test or a person, as plain values."""
        try:
            command = json.loads(text)
            do = command.pop("do")
            if do == "events":
                return {"events": list(self.controller.events)}
            if do == "truth":
                return self._truth(float(command["since"]), float(command["until"]))
            if do == "fault":
                fault = Fault(**command)
                if fault.name not in faults_of(self.generation):
                    raise InputError(f"a controller {self.generation} has no {fault.name}")
                self.faults.append(fault)
            elif do == "clear":
                self._clear()
            elif do != "state":
                return {"error": f"there is no command {str(do)[:40]!r}"}
            return {
                "time": self.controller.time,
                "heard": self.controller.inputs.get("written at", 0.0),
                "program": self.controller.program_name,
                "at_rest": self.controller.at_rest,
                "q": self.controller.arm.q.tolist(),
                "tip": [finite_or_none(value) for value in self._nodes()[-1]],
                "holds_cable": self.cable is None or self.cable.is_held,
                "faults": len(self.faults),
            }
        except (CablecastError, ValueError, KeyError, TypeError, AttributeError) as error:
            return {"error": f"{type(error).__name__}: {error}"}

    def _clear(self) -> None:
        """Do what a person does to go on after a fault."""
        self.faults.clear()
        self._silent_until = -1.0
        self._answer_time = 0.0
        if "dashboard" in self._robot_servers:
            self.servers.listen("dashboard")
        self.rtde.late_until = self.rtde.lost_until = -1.0
        if self.camera is not None:
            self.camera.fault(None)
        if self.cable is not None:
            self.cable.lies_aside = 0.0
            self.cable.grip_anew()
        if self.controller.robot_mode == MODE_POWER_OFF:
            self._power_up()
        else:
            self.controller.clear()

    def _truth(self, since: float, until: float) -> dict[str, Any]:
        """Return the true way of the endpoint, and the speed of the fastest joint."""
        rows = [row for row in self._history if since <= row[0] <= until]
        return {
            "times": [row[0] for row in rows],
            "tip": [[finite_or_none(value) for value in row[1]] for row in rows],
            "joint_speed": [row[2] for row in rows],
        }

    @property
    def phase(self) -> str:
        """Name of what the rig is doing, for faults that wait for it."""
        controller = self.controller
        robot = controller.robot
        index = int(controller.inputs[f"input_int_register_{robot.input_register + PHASE}"])
        phase = next((phase.name.lower() for phase in RigPhase if phase == index), "idle")
        moving = controller.int_registers[robot.output_register + STATE] == ProgramState.MOVING
        if phase == "cast" and not (controller.is_running_program and moving):
            return "approach"
        return phase

    def _make_faults(self) -> None:
        controller = self.controller
        if self._restart_at is not None and controller.time >= self._restart_at:
            self._power_up()
        phase = self.phase
        if phase != self._phase[0]:
            self._phase = (phase, controller.time)
        said, self._said = self._said, set()
        for fault in list(self.faults):
            is_on = fault.phase in ("now", phase)
            is_due = is_on and controller.time - self._phase[1] >= fault.after
            if is_due or (fault.phase in said and fault.after == 0.0):
                self.faults.remove(fault)
                controller.log("fault", name=fault.name, phase=phase)
                self._make(fault.name)

    def _make(self, name: str) -> None:
        controller, now = self.controller, self.controller.time
        if name == "protective_stop":
            controller.protective_stop("a fault of the twin")
        elif name == "emergency_stop":
            controller.emergency_stop()
        elif name == "speed_slider":
            controller.speed_slider = 0.5
        elif name == "wrong_payload":
            controller.payload = 0.0
        elif name == "program_stopped":
            controller.stop_program("the pendant")
        elif name == "local_control":
            controller.is_in_remote_control = False
            controller.stop_program("local control")
        elif name == "dashboard_slow":
            self._answer_time = _SLOW_TIME
        elif name == "dashboard_off":
            self.servers.drop({"dashboard"})
        elif name == "lost_packets":
            self.rtde.lost_until = now + _LOST_TIME
        elif name == "late_packets":
            self.rtde.late_until = now + _LATE_TIME
        elif name == "network_lost":
            self._silent_until = now + _SILENT_TIME
        elif name in ("controller_dies", "controller_restarts"):
            controller.stop_program("no power")
            controller.robot_mode = MODE_POWER_OFF
            self.servers.drop(self._robot_servers)
            self._held.clear()
            self._answers.clear()
            if name == "controller_restarts":
                self._restart_at = now + _RESTART_TIME
        elif name.startswith("camera_"):
            if self.camera is not None:
                self.camera.fault(name.removeprefix("camera_"))
        elif self.cable is not None and name == "cable_slips":
            self.cable.slip()
        elif self.cable is not None and name == "cable_drops":
            self.cable.drop()
        elif self.cable is not None:
            self.cable.lies_aside = _CROOKED

    def _power_up(self) -> None:
        """Start a controller that had no power."""
        self._restart_at = None
        self.controller.boot()
        self.servers.drop(self._robot_servers)
        for name in self._robot_servers:
            self.servers.listen(name)
        self.controller.log("powered up")

    def _make_camera(self) -> CameraStream | None:
        settings = self.setup.camera
        if settings is None:
            return None
        config = dataclasses.replace(
            CameraConfig.over(self.setup.workspace).resized(settings.width),
            frame_rate=settings.rate,
            exposure=settings.exposure,
            row_time=settings.row_time,
        )
        return CameraStream(self.setup, config, port=self.config.camera_port)

    def _show_camera(self) -> None:
        """Let the camera see this instant; it waits where the camera draws more slowly."""
        now = self.controller.time
        if self.camera is None or now < self._next_picture:
            return
        self._next_picture = now + CAMERA_DT - 1e-9
        if self.phase != "reset" or now % RESET_GLANCE_PERIOD < RESET_GLANCE:
            self.camera.show(now, self.controller.arm.q, self._nodes())
