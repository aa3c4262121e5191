"""Frames of the Real-Time Data Exchange, version 2, as a controller sends and reads them.

Source: Universal Robots, "Real-Time Data Exchange (RTDE) Guide". Every frame begins with its
length, header included, and its type; all numbers are big-endian.
"""

import dataclasses
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

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
