"""What the twin's clients talk to: its sockets, the Real-Time Data Exchange, and the dashboard.

All sockets are served by one thread, on the loopback address only.

Sources: that of rtde.py; Universal Robots, "Dashboard Server e-Series, port 29999" and
"... CB-Series": one line in, one line out.
"""

import collections
import contextlib
import ipaddress
import os
import selectors
import socket
import struct
from collections.abc import Callable
from typing import Any

from cablecast.conventions import stream
from cablecast.errors import InputError
from cablecast.rigs.ur.rtde import (
    DATA_PACKAGE,
    GET_VERSION,
    PAUSE,
    REGISTER_COUNT,
    REQUEST_PROTOCOL_VERSION,
    SETUP_INPUTS,
    SETUP_OUTPUTS,
    START,
    FrameReader,
    Recipe,
    frame,
)
from cablecast.rigs.ur.twin.controller import (
    MODE_RUNNING,
    SAFETY_EMERGENCY,
    SAFETY_NORMAL,
    SAFETY_PROTECTIVE,
    Controller,
)
from cablecast.rigs.virtual.config import TrialNoise

_RECEIVE_SIZE = 1 << 16
_SEND_MAX = 1 << 22
"""Most bytes that wait for a client who does not read; then it is dropped, as a controller does."""


class Client:
    """One connection of a client.

    Attributes:
        kind: Name of the server that it came to.
        state: Whatever the server keeps about it.
    """

    def __init__(self, connection: socket.socket, kind: str):
        self.connection = connection
        self.kind = kind
        self.state: dict[str, Any] = {}
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
            self.open = len(self._waiting) <= _SEND_MAX
        except OSError:
            self.open = False


class Servers:
    """Listening sockets and their clients.

    Args:
        address: Loopback address.
        ports: Port by the name of the server.
        names: Servers that listen from the start.

    Raises:
        InputError: The address is not of this computer, or a port is taken.
    """

    def __init__(self, address: str, ports: dict[str, int], names: set[str]):
        self.address = _check_loopback(address)
        self._ports = ports
        self.clients: list[Client] = []
        self._selector = selectors.DefaultSelector()
        self._listening: dict[str, socket.socket] = {}
        try:
            for name in names:
                self.listen(name)
        except InputError:
            self.close()
            raise

    def listen(self, name: str) -> None:
        """Open a server's port, unless it is open."""
        if name in self._listening:
            return
        try:
            server = socket.create_server((self.address, self._ports[name]))
        except OSError as error:
            raise InputError(
                f"port {self._ports[name]} of {self.address} is not free "
                f"({os.strerror(error.errno or 0)}): is another twin running?"
            ) from None
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
                self._accept(self._listening[key.data], key.data, accepted)
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


def _check_loopback(address: str) -> str:
    """Return an address of this computer that nobody else can reach."""
    with contextlib.suppress(ValueError):
        if ipaddress.ip_address(address).is_loopback:
            return address
    raise InputError(f"the twin listens on a loopback address such as 127.0.0.1, not on {address}")


def _registers(what: str) -> dict[str, str]:
    return {f"{what}_int_register_{index}": "INT32" for index in range(REGISTER_COUNT)}


OUTPUTS = {
    **dict.fromkeys(("timestamp", "speed_scaling", "target_speed_fraction", "payload"), "DOUBLE"),
    **dict.fromkeys(("target_q", "target_qd", "actual_q", "actual_qd"), "VECTOR6D"),
    "payload_cog": "VECTOR3D",
    **dict.fromkeys(("runtime_state", "robot_status_bits", "safety_status_bits"), "UINT32"),
    **dict.fromkeys(("robot_mode", "safety_mode", "safety_status"), "INT32"),
    **_registers("output"),
}
"""Types of what the controller can report: what the twin models, and nothing else."""
INPUTS = _registers("input")
"""Types of what a client can write."""
_SAFETY_BITS = {
    SAFETY_NORMAL: 1,
    SAFETY_PROTECTIVE: 1 << 2 | 1 << 10,
    SAFETY_EMERGENCY: 1 << 6 | 1 << 7 | 1 << 10,
}
_RUNTIME_STOPPED, _RUNTIME_PLAYING = 1, 2

_LATE_TIME = 0.3
"""Delay of reports while they are late [s]."""


class RtdeServer:
    """Answers RTDE clients of one controller.

    Args:
        controller: Controller that they talk to.
        seed: Seed of the noise of its encoders.
        heard: Called after each package of inputs.
    """

    def __init__(self, controller: Controller, seed: int, heard: Callable[[], None]):
        self.controller = controller
        self.heard = heard
        self.lost_until = -1.0
        self.late_until = -1.0
        self._rng = stream(seed, "encoders of the twin")
        self._late: collections.deque[tuple[float, Client, bytes]] = collections.deque()
        self._tick = 0

    def accept(self, client: Client) -> None:
        """Welcome a new client."""
        client.state.update(reader=FrameReader(), outputs=None, inputs={}, started=False, every=1)

    def receive(self, client: Client, data: bytes, others: list[Client]) -> None:
        """Answer what a client sent; `others` are all clients of this server."""
        try:
            for kind, payload in client.state["reader"].feed(data):
                self._answer(client, kind, payload, others)
        except (ValueError, LookupError, struct.error):
            self.controller.log("RTDE client sent nonsense")
            client.open = False

    def _answer(self, client: Client, kind: int, payload: bytes, others: list[Client]) -> None:
        if kind == REQUEST_PROTOCOL_VERSION:
            client.send(frame(kind, bytes([int.from_bytes(payload[:2], "big") == 2])))
        elif kind == GET_VERSION:
            client.send(frame(kind, struct.pack(">4I", *self.controller.generation.version)))
        elif kind == SETUP_OUTPUTS:
            self._set_outputs(client, payload)
        elif kind == SETUP_INPUTS:
            self._set_inputs(client, payload, others)
        elif kind in (START, PAUSE):
            client.state["started"] = kind == START
            client.send(frame(kind, b"\x01"))
        elif kind == DATA_PACKAGE:
            recipe: Recipe | None = client.state["inputs"].get(payload[0])
            if recipe is None:
                raise ValueError("a data package of an unknown recipe")
            self.controller.inputs.update(recipe.unpack(payload[1:]))
            self.controller.inputs["written at"] = self.controller.time
            self.heard()

    def _set_outputs(self, client: Client, payload: bytes) -> None:
        (frequency,) = struct.unpack_from(">d", payload)
        rate = 1.0 / self.controller.dt
        client.state["every"] = max(1, round(rate / min(max(frequency, 1.0), rate)))
        client.state["outputs"] = _set_up(client, SETUP_OUTPUTS, payload[8:], 1, OUTPUTS)

    def _set_inputs(self, client: Client, payload: bytes, others: list[Client]) -> None:
        taken = {
            name: "IN_USE"
            for other in others
            if other is not client
            for recipe in other.state["inputs"].values()
            for name in recipe.names
        }
        inputs = client.state["inputs"]
        recipe = _set_up(client, SETUP_INPUTS, payload, len(inputs) + 1, INPUTS | taken)
        if recipe is not None:
            inputs[recipe.number] = recipe

    def state(self) -> dict[str, Any]:
        """Return the value of every output, with the noise of the encoders."""
        c = self.controller
        noise = TrialNoise.encoder * self._rng.normal(size=(2, 6))
        powered = c.robot_mode == MODE_RUNNING
        playing = c.is_running_program
        return {
            "timestamp": c.time,
            "target_q": c.target_q.tolist(),
            "target_qd": c.target_qd.tolist(),
            "actual_q": (c.arm.q + noise[0]).tolist(),
            "actual_qd": (c.arm.qd + 20 * noise[1] * (not c.at_rest)).tolist(),
            "robot_mode": c.robot_mode,
            "safety_mode": c.safety_mode,
            "safety_status": c.safety_mode,
            "speed_scaling": 1.0 if powered else 0.0,
            "target_speed_fraction": c.speed_slider,
            "runtime_state": _RUNTIME_PLAYING if playing else _RUNTIME_STOPPED,
            "robot_status_bits": int(powered) | int(playing) << 1,
            "safety_status_bits": _SAFETY_BITS[c.safety_mode],
            "payload": c.payload,
            "payload_cog": c.robot.payload_cog,
            **{f"output_int_register_{i}": value for i, value in enumerate(c.int_registers)},
        }

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


def _set_up(
    client: Client, kind: int, names: bytes, number: int, types: dict[str, str]
) -> Recipe | None:
    """Tell a client the types of what it names, and return the recipe if it may have all of it."""
    # ur-rtde sends a comma after the last.
    asked = tuple(name for name in names.decode("ascii").split(",") if name)
    recipe = Recipe(number, asked, tuple(types.get(name, "NOT_FOUND") for name in asked))
    number = number if recipe.is_valid else 0
    client.send(frame(kind, bytes([number]) + ",".join(recipe.types).encode()))
    return recipe if recipe.is_valid else None


_ROBOT_STATE, _ROBOT_MESSAGE, _VERSION_MESSAGE, _MODE_DATA = 16, 20, 3, 0
STATE_PERIOD = 0.1
"""Time between two states that the program port sends [s]."""


def _message(kind: int, body: bytes) -> bytes:
    return struct.pack(">IB", 5 + len(body), kind) + body


def version_message(controller: Controller) -> bytes:
    """Return what the program port says first (Universal Robots, Client Interfaces)."""
    major, minor, bugfix, build = controller.generation.version
    name, date = b"URControl", b"01-01-2022, 00:00:00"
    body = struct.pack(">QbbB", round(1e6 * controller.time), -2, _VERSION_MESSAGE, len(name))
    body += name + struct.pack(">BBii", major, minor, bugfix, build) + date
    return _message(_ROBOT_MESSAGE, body)


def robot_state(controller: Controller) -> bytes:
    """Return what the program port says ten times a second, its modes alone (the same source)."""
    c, powered = controller, controller.robot_mode == MODE_RUNNING
    stops = (c.safety_mode == SAFETY_EMERGENCY, c.safety_mode == SAFETY_PROTECTIVE)
    flags = (True, powered, powered, *stops, c.is_running_program, False)
    body = struct.pack(">Q7?BB", round(1e6 * c.time), *flags, c.robot_mode, 0)
    body += struct.pack(">3dB", c.speed_slider, float(powered), 1.0, 0)
    return _message(_ROBOT_STATE, _message(_MODE_DATA, body))


DASHBOARD_GREETING = "Connected: Universal Robots Dashboard Server"
_SAFETY_WORDS = {
    SAFETY_NORMAL: "NORMAL",
    SAFETY_PROTECTIVE: "PROTECTIVE_STOP",
    SAFETY_EMERGENCY: "ROBOT_EMERGENCY_STOP",
}


def dashboard_answer(controller: Controller, line: str) -> str:
    """Return the dashboard's answer to one command, without line breaks."""
    command = line.strip().lower()
    major, minor, bugfix, build = controller.generation.version
    powered = controller.robot_mode == MODE_RUNNING
    questions = {
        "robotmode": f"Robotmode: {'RUNNING' if powered else 'POWER_OFF'}",
        "safetymode": f"Safetymode: {_SAFETY_WORDS[controller.safety_mode]}",
        "running": f"Program running: {str(controller.is_running_program).lower()}",
        "get robot model": controller.setup.arm.model.removesuffix("e").upper(),
        "polyscopeversion": f"URSoftware {major}.{minor}.{bugfix}.{build} (Jan 01 2022)",
    }
    if controller.generation.has_remote_control:
        questions["is in remote control"] = str(controller.is_in_remote_control).lower()
    if command in questions:
        return questions[command]
    controller.log("dashboard", command=command)
    if command == "stop":
        controller.stop_program("dashboard")
        return "Stopped"
    if command == "unlock protective stop":
        if controller.safety_mode == SAFETY_PROTECTIVE:
            controller.clear()
        return "Protective stop releasing"
    return f"could not understand: {line.strip()}"
