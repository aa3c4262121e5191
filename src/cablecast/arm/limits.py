"""Joint limits: position, velocity and acceleration."""

import dataclasses
import enum
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.checks import check_keys, check_number
from cablecast.errors import InputError

JOINT_NAMES = ("base", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3")
JOINT_COUNT = len(JOINT_NAMES)


class LimitKind(enum.Enum):
    """Kind of limit that a motion can violate; the value is its unit."""

    REACH = "m"
    POSITION = "rad"
    VELOCITY = "rad/s"
    ACCELERATION = "rad/s²"


_OTHERS: dict[str, dict[str, tuple[float, ...]]] = {
    "ur3": {"velocity": (np.pi,) * 3 + (2 * np.pi,) * 3},
    "ur10": {
        "velocity": (2 * np.pi / 3,) * 2 + (np.pi,) * 4,
        "acceleration": (14.0, 14.0, 20.0, 40.0, 40.0, 40.0),
    },
}
"""Limits of the arms of other sizes that differ from the defaults, for both series."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointLimits:
    """Symmetric limits, one value per joint.

    The defaults are those of a UR5 and a UR5e; `JointLimits.of_model` has those of the others.
    Position and velocity limits are from the manufacturer's user manuals and data sheets (±360 deg;
    180 deg/s for all joints, but 360 deg/s for the wrists of a UR3 and 120 deg/s for base and
    shoulder of a UR10), which state no acceleration limits. The three large joints get 20 rad/s²,
    but base and shoulder of a UR10 14 rad/s². Stretched out with a gripper of 1 kg, this takes at
    most 60 % of the torque that the maker states for the base joint (56, 150 and 330 N·m), with the
    masses of his table (tests/arm/test_limits.py). The wrist joints carry little and get 40 rad/s²,
    the largest value that the controller accepts.

    Attributes:
        position: Largest absolute angle [rad], six values.
        velocity: Largest speed [rad/s], six values.
        acceleration: Largest acceleration [rad/s²], six values.
    """

    position: tuple[float, ...] = (2 * np.pi,) * 6
    velocity: tuple[float, ...] = (np.pi,) * 6
    acceleration: tuple[float, ...] = (20.0, 20.0, 20.0, 40.0, 40.0, 40.0)

    def __post_init__(self):
        for name in ("position", "velocity", "acceleration"):
            values = getattr(self, name)
            if not isinstance(values, tuple) or len(values) != JOINT_COUNT:
                raise InputError(f"arm {name} limits {str(values)[:60]} must be six numbers")
            for value in values:
                check_number(f"arm {name} limit", value, 1e-3, 1e3)

    @classmethod
    def of_model(cls, model: str) -> "JointLimits":
        """Return the default limits of an arm, "ur3" to "ur10e"."""
        return cls(**_OTHERS.get(model.removesuffix("e"), {}))

    def to_dict(self) -> dict[str, list[float]]:
        """Return plain values for a config or YAML file."""
        return {name: list(values) for name, values in dataclasses.asdict(self).items()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], model: str = "ur5") -> "JointLimits":
        """Make limits from plain values; missing keys take the defaults of the model.

        Args:
            values: Limits by name.
            model: Name of the arm.

        Raises:
            InputError: A key is unknown, or a value is not six positive numbers.
        """
        known = {field.name for field in dataclasses.fields(cls)}
        values = check_keys(values, known, "arm limits")
        return dataclasses.replace(
            cls.of_model(str(model)),
            **{
                name: tuple(row) if isinstance(row, (list, tuple)) else row
                for name, row in values.items()
            },
        )

    def to_array(self) -> NDArray[np.float64]:
        """Return position, velocity and acceleration limits, shape [3, 6]."""
        return np.array([self.position, self.velocity, self.acceleration])
