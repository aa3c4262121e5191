"""ArmUR: a UR arm at the table, with joint limits and inverse kinematics for any motion."""

import dataclasses
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.geometry import ArmGeometry
from cablecast.arm.inverse import JointMotion, level_motion
from cablecast.arm.limits import JointLimits
from cablecast.arm.tilted import tilted_motion
from cablecast.checks import check_keys
from cablecast.errors import IKError, InputError

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
