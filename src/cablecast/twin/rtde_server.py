"""RTDE server of the twin: recipes, data packages, and who may write what."""

import collections
import struct
from collections.abc import Callable
from typing import Any

from cablecast.twin.controller import Controller
from cablecast.twin.rtde_protocol import (
    DATA_PACKAGE,
    GET_VERSION,
    INPUTS,
    OUTPUTS,
    PAUSE,
    REQUEST_PROTOCOL_VERSION,
    SETUP_INPUTS,
    SETUP_OUTPUTS,
    START,
    FrameReader,
    Recipe,
    frame,
)
from cablecast.twin.sockets import Client

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
