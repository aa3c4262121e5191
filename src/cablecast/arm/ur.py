"""Joint limits: position, velocity and acceleration.

ArmUR: a UR arm at the table, with joint limits and inverse kinematics for any motion.
"""

import dataclasses
import enum
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.kinematics import ArmGeometry, JointMotion, level_motion, tilted_motion
from cablecast.errors import IKError, InputError, check_keys, check_number

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


Array = NDArray[np.float64]

# A pose with less pitch counts as level [rad].
_LEVEL = 1e-9


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArmUR(ArmGeometry):
    """A UR arm at the table.

    Attributes:
        limits: Joint limits; those of the model where none are given, see `JointLimits`.
    """

    # Those of the model as soon as the arm is made.
    limits: JointLimits = cast(JointLimits, None)  # noqa: RUF009

    def __post_init__(self):
        super().__post_init__()
        if self.limits is None:
            object.__setattr__(self, "limits", JointLimits.of_model(self.model))
        if not isinstance(self.limits, JointLimits):
            raise InputError(f"arm limits must be JointLimits, not {type(self.limits).__name__}")

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for a config or YAML file."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return values | {"limits": self.limits.to_dict()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "ArmUR":
        """Make an arm from plain values; missing keys take their defaults.

        Raises:
            InputError: A key is unknown, or a value out of bounds.
            UnknownNameError: There is no such model.
        """
        values = check_keys(values, {field.name for field in dataclasses.fields(cls)}, "arm")
        if "limits" in values:
            values["limits"] = JointLimits.from_dict(
                values["limits"], values.get("model", cls.model)
            )
        return cls(**values)

    def inverse(self, poses: ArrayLike) -> Array:
        """Return joint angles that bring the gripped end to given poses.

        Args:
            poses: x, y, z [m], yaw, pitch [rad], shape [..., 5].

        Returns:
            Joint angles of a single branch [rad], shape [..., 6].

        Raises:
            IKError: A pose is out of reach.
        """
        poses = np.asarray(poses, dtype=float)
        still = np.zeros_like(poses)
        motion = self.inverse_motion(poses, still, still)
        bad = ~np.all(np.isfinite(motion.q), axis=-1)
        if np.any(bad):
            radius, low, high = (
                float(values[bad][0])
                for values in (motion.radius, motion.radius_min, motion.radius_max)
            )
            part = "first wrist joint" if np.any(_tilted(poses)) else "flange"
            raise IKError(
                f"the arm does not reach the grip at x, y, z = "
                f"{poses[bad][0][:3].round(4).tolist()} m: its {part} would be {radius:.4f} m from "
                f"the base axis, outside [{low:.4f}, {high:.4f}]"
            )
        return motion.q

    def inverse_motion(
        self, poses: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike
    ) -> JointMotion:
        """Return joint angles along moving poses, with exact rates and accelerations.

        Args:
            poses: x, y, z [m], yaw, pitch [rad], shape [..., 5]. If any is tilted, all are solved
                by the slower general form of arm/tilted.py.
            velocities: Their first derivatives, same shape.
            accelerations: Their second derivatives, same shape.

        Returns:
            Joint motion; NaN where a pose is out of reach.
        """
        p, v, a = (np.asarray(values, dtype=float) for values in (poses, velocities, accelerations))
        solve = tilted_motion if np.any(_tilted(p)) else level_motion
        return solve(self, p, v, a)


def _tilted(poses: Array) -> NDArray[np.bool_]:
    """Return which poses are tilted by more than rounding."""
    return np.abs(poses[..., 4]) > _LEVEL
