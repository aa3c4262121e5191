"""Limits of the joints: position, velocity and acceleration."""

import dataclasses
import enum

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError

JOINT_NAMES = ("base", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3")
JOINT_COUNT = len(JOINT_NAMES)


class LimitKind(enum.Enum):
    """What a motion can break; the value is the unit in which it is told."""

    REACH = "m"
    POSITION = "rad"
    VELOCITY = "rad/s"
    ACCELERATION = "rad/s²"


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointLimits:
    """Symmetric limits, one value per joint.

    The defaults are those of a UR5: position and velocity from its data sheet (±360 deg, 180 deg/s,
    all joints). The maker states no acceleration. The three large joints get 20 rad/s²: stretched
    out to 0.8 m the arm has about 4.5 kg·m² about the base axis, so this takes 90 of the joint's
    150 N·m. The wrist joints carry little and get 40 rad/s², the largest value that the controller
    accepts.

    Attributes:
        position: Largest angle from zero [rad], six values.
        velocity: Largest rate [rad/s], six values.
        acceleration: Largest acceleration [rad/s²], six values.
    """

    position: tuple[float, ...] = (2 * np.pi,) * 6
    velocity: tuple[float, ...] = (np.pi,) * 6
    acceleration: tuple[float, ...] = (20.0, 20.0, 20.0, 40.0, 40.0, 40.0)

    def __post_init__(self):
        for name in ("position", "velocity", "acceleration"):
            values = getattr(self, name)
            if len(values) != JOINT_COUNT or not all(0.0 < value < np.inf for value in values):
                raise InputError(f"{name} limits {values} must be six positive numbers")

    def to_array(self) -> NDArray[np.float64]:
        """Position, velocity and acceleration limits, shape [3, 6]."""
        return np.array([self.position, self.velocity, self.acceleration])
