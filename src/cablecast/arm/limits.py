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


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointLimits:
    """Symmetric limits, one value per joint.

    The defaults are shared by the UR5 and the UR5e. Position and velocity limits are from the
    manufacturer's data sheets ("UR5 technical specifications" and "UR5e technical specifications":
    ±360 deg and 180 deg/s for all joints), which state no acceleration limits. The three large
    joints get 20 rad/s². Stretched out to 0.8 m, the arm has about 4.5 kg·m² about the base axis,
    so this takes 90 of the 150 N·m that the large joints of both models have. The wrist joints
    carry little and get 40 rad/s², the largest value that the controller accepts.

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

    def to_dict(self) -> dict[str, list[float]]:
        """Return plain values for a config or YAML file."""
        return {name: list(values) for name, values in dataclasses.asdict(self).items()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "JointLimits":
        """Make limits from plain values; missing keys take their defaults.

        Raises:
            InputError: A key is unknown, or a value is not six positive numbers.
        """
        known = {field.name for field in dataclasses.fields(cls)}
        values = check_keys(values, known, "arm limits")
        return cls(
            **{
                name: tuple(row) if isinstance(row, (list, tuple)) else row
                for name, row in values.items()
            }
        )

    def to_array(self) -> NDArray[np.float64]:
        """Return position, velocity and acceleration limits, shape [3, 6]."""
        return np.array([self.position, self.velocity, self.acceleration])
