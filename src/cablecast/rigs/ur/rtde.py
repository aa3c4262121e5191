"""Frames and recipes of the Real-Time Data Exchange, and the registers through which we talk.

Source: Universal Robots, "Real-Time Data Exchange (RTDE) Guide", version 2 of the protocol: every
frame begins with its length, header included, and its type; all numbers are big-endian. Of the
general purpose registers, 0 to 23 belong to fieldbuses, 24 to 47 to clients of RTDE such as this.
"""

import dataclasses
import socket
import struct
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from cablecast.errors import RigError

RTDE_PORT = 30004
REGISTER_COUNT = 48
Version = tuple[int, int, int]
CB3, E_SERIES, POLYSCOPE_X = 3, 5, 10
"""Generations of controllers, by the major version of their software."""
CB3_MODELS = ("ur3", "ur5", "ur10")
"""Arms of the first of them; the others move all that came later."""
BEAT, STOP, PHASE = 0, 1, 2
"""Input registers, counted from the robot's `input_register`: a number that this computer changes
as long as all is well; number of the program that shall stop; a `RigPhase`: what the rig does."""
STATE, TICK, NUMBER = 0, 1, 2
"""Output registers, counted from its `output_register`: a `ProgramState`; time of the set point
that is being approached, in units of `TICK_DT`, 0 before the motion; number of the program, so that
one is not taken for another."""

TYPES = {
    "UINT32": "I",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
}
"""Struct codes of the types that a recipe names."""

_HEADER = struct.Struct(">HB")
REQUEST_PROTOCOL_VERSION, GET_VERSION = ord("V"), ord("v")
SETUP_OUTPUTS, SETUP_INPUTS = ord("O"), ord("I")
START, PAUSE, DATA_PACKAGE = ord("S"), ord("P"), ord("U")
_ANSWER_TIME_MAX = 3.0


def frame(kind: int, payload: bytes = b"") -> bytes:
    """Return one frame of RTDE."""
    return _HEADER.pack(_HEADER.size + len(payload), kind) + payload


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
        while len(self._buffer) >= _HEADER.size:
            size, kind = _HEADER.unpack_from(self._buffer)
            if size < _HEADER.size:
                raise ValueError(f"a frame of {size} bytes is shorter than its header")
            if len(self._buffer) < size:
                return
            payload, self._buffer = self._buffer[_HEADER.size : size], self._buffer[size:]
            yield kind, payload


def read_version(connection: socket.socket, reader: FrameReader) -> Version:
    """Return the version of the controller's software: major, minor, bugfix."""
    return struct.unpack(">3I", ask(connection, reader, GET_VERSION)[:12])


def ask(connection: socket.socket, reader: FrameReader, kind: int, payload: bytes = b"") -> bytes:
    """Return the answer to a frame; the controller may send text messages before it.

    Raises:
        OSError: The controller does not answer.
        ValueError: It speaks no RTDE.
    """
    connection.sendall(frame(kind, payload))
    deadline = time.monotonic() + (connection.gettimeout() or _ANSWER_TIME_MAX)
    while data := connection.recv(4096):
        for answered, answer in reader.feed(data):
            if answered == kind:
                return answer
        if time.monotonic() > deadline:
            raise OSError(f"RTDE sends other messages, but does not answer request {chr(kind)!r}")
    raise OSError("RTDE closed the connection")


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

    @classmethod
    def of_answer(cls, names: tuple[str, ...], answer: bytes) -> "Recipe":
        """Return the recipe of some names, by the controller's answer to them."""
        return cls(answer[0], names, tuple(answer[1:].decode().split(",")))

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
            values.extend(value if isinstance(value, Sequence) else [value])
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


class RtdeClient:
    """Client that writes three integer registers, and reads every report.

    Args:
        address: Name or address of the controller.
        first: First of the registers, which nobody else may write meanwhile.
        outputs: Function that returns the names of what is reported, by the controller's version.

    Raises:
        RigError: Somebody else writes one of the registers, or something cannot be reported.
        OSError: The controller does not answer.
    """

    def __init__(self, address: str, first: int, outputs: Callable[[Version], Sequence[str]]):
        names = tuple(f"input_int_register_{first + index}" for index in range(3))
        self._values = dict.fromkeys(names, 0)
        self._connection = socket.create_connection((address, RTDE_PORT), _ANSWER_TIME_MAX)
        self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._reader = FrameReader()
        if self._ask(REQUEST_PROTOCOL_VERSION, struct.pack(">H", 2)) != b"\x01":
            raise RigError("the controller does not speak version 2 of RTDE: update its software")
        version = read_version(self._connection, self._reader)
        self._inputs = Recipe.of_answer(names, self._ask(SETUP_INPUTS, ",".join(names).encode()))
        if "NOT_FOUND" in self._inputs.types:
            raise RigError(
                f"a controller of version {'.'.join(map(str, version))} has no input registers "
                f"{first} to {first + 2}: update its software (those from 24 on came with 3.9 and "
                "5.3), or set robot input_register in the lab file to 21 or less"
            )
        if not self._inputs.is_valid:
            raise RigError(
                f"input registers {first} to {first + 2} of the controller are written by a "
                "fieldbus or another program: end it, or set robot input_register in the lab file "
                "to the first of three that are free, from 24 to 45. After a lost network it may "
                "be our own connection, which the controller drops within a minute"
            )
        names = tuple(outputs(version))
        rate = struct.pack(">d", 125.0 if version[0] == CB3 else 500.0)
        answer = self._ask(SETUP_OUTPUTS, rate + ",".join(names).encode())
        self._outputs = Recipe.of_answer(names, answer)
        if not self._outputs.is_valid:
            unknown = [n for n, t in zip(names, self._outputs.types, strict=True) if t not in TYPES]
            raise RigError(f"the controller does not report {', '.join(unknown)}")
        if self._ask(START) != b"\x01":
            raise RigError("the controller does not start its reports: look at the pendant's log")
        self._connection.settimeout(None)

    def _ask(self, kind: int, payload: bytes = b"") -> bytes:
        return ask(self._connection, self._reader, kind, payload)

    def write(self, index: int, value: int) -> None:
        """Write one register, counted from the first."""
        self._values[self._inputs.names[index]] = value
        self._connection.sendall(self._inputs.pack(self._values))

    def reports(self) -> Iterator[dict[str, Any]]:
        """Yield every report until the connection breaks; they wait for a reader who is late."""
        data = b""
        while True:
            for kind, payload in self._reader.feed(data):
                if kind == DATA_PACKAGE:
                    yield self._outputs.unpack(payload[1:])
            try:
                data = self._connection.recv(1 << 16)
            except OSError:
                data = b""
            if not data:
                return
