"""Servo model: actual motion of the joints, and so of the gripper, for commanded set points.

Each joint follows its set points with a dead time and as a damped oscillator. A cast lasts a second
or two and turns within tenths of a second, so a lag of a few hundredths of a second changes the
gripper's path by centimetres. That is more than the error of the cable model. A simulator must
therefore play the path that the arm takes, not the commanded path.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.limits import JOINT_COUNT
from cablecast.arm.ur import ArmUR
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath
from cablecast.motion.joint_response import joint_response

_STEP = 0.016
"""Time step of `apply` [s]. Coarse, so that 36,000 paths convert quickly; the result stays within
0.1 mm of the exact response."""
_KNOT_STEPS = 2
"""Time steps between the knots of the resulting path."""
_KNOT_DT = _KNOT_STEPS * _STEP
"""Time between the knots of the resulting path [s]."""
_CATCH_UP_KNOTS = 31
"""Knots beyond the usual end of a path in which a joint with a weak motor still may arrive: 1 s."""
_AWAY = 1e-4
"""Angle from its last set point at which such a joint is still on its way [rad]."""
_UNKNOWN = {"acceleration_max": np.inf, "speed_max": np.inf, "residual": np.nan}
"""Values that None stands for in a file."""
_SETTLED = 1e-4
"""Remaining share of a step input at the end of the resulting path [-]."""
_SETTLE_MAX = 2.0
"""Longest settling time of a resulting path [s]."""
# Paths per chunk: limits the intermediate arrays to about 100 MB.
_CHUNK = 1000


def _unlimited() -> NDArray[np.float64]:
    return np.full(JOINT_COUNT, np.inf)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ServoModel:
    """Second-order servo with a dead time, one per joint.

    The joint angle q follows its set point q_set as

        qdd = frequency^2 (q_set(t - delay) - q) - 2 damping frequency qd.

    as far as its motor can: its acceleration is at most acceleration_max at rest and in braking,
    nothing at speed_max, and in between on the line from one to the other.

    Attributes:
        delay: Dead time before a set point has any effect [s], shape [6].
        frequency: Undamped angular frequency of the response [rad/s], shape [6].
        damping: Damping ratio of the response [-], shape [6].
        acceleration_max: Acceleration that the motor can give at rest [rad/s²], shape [6]; infinite
            where the motor is never too weak.
        speed_max: Speed at which it can give none [rad/s], shape [6]; infinite likewise.
        residual: RMS difference between measured and modelled joint angles [rad], shape [6]; NaN
            if unknown.
    """

    delay: NDArray[np.float64]
    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    acceleration_max: NDArray[np.float64] = dataclasses.field(default_factory=_unlimited)
    speed_max: NDArray[np.float64] = dataclasses.field(default_factory=_unlimited)
    residual: NDArray[np.float64] = dataclasses.field(
        default_factory=lambda: np.full(JOINT_COUNT, np.nan)
    )

    def __post_init__(self):
        for name, unit, low, high in (
            ("delay", "s", 0.0, 0.5),
            ("frequency", "rad/s", 5.0, 5000.0),
            ("damping", "-", 0.2, 5.0),
            ("acceleration_max", "rad/s²", 0.1, np.inf),
            ("speed_max", "rad/s", 0.01, np.inf),
        ):
            values = np.asarray(getattr(self, name), dtype=float)
            object.__setattr__(self, name, values)
            if values.shape != (JOINT_COUNT,):
                raise InputError(f"servo {name} has shape {values.shape}, not ({JOINT_COUNT},)")
            if not np.all((values >= low) & (values <= high)):
                bad = values[~((values >= low) & (values <= high))][0]
                raise InputError(f"servo {name} = {bad:g} {unit} is outside [{low:g}, {high:g}]")

    @property
    def lag(self) -> NDArray[np.float64]:
        """Lag behind a steady motion, delay + 2 damping / frequency [s], shape [6]."""
        return self.delay + 2.0 * self.damping / self.frequency

    @property
    def settle_time(self) -> float:
        """Time from the last set point until the slowest joint is at rest [s]."""
        # An overdamped response decays with the slower of its two poles.
        root = np.sqrt(np.maximum(self.damping**2 - 1.0, 0.0))
        decay = self.frequency * (self.damping - root)
        return float(min(np.max(self.delay + np.log(1.0 / _SETTLED) / decay), _SETTLE_MAX))

    def respond(self, q: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
        """Return the joint angles that follow evenly spaced set points.

        Args:
            q: Set points, which start at rest [rad], shape [..., tick, 6].
            dt: Interval between set points [s].

        Returns:
            Joint angles at the same times [rad], shape [..., tick, 6].
        """
        result = np.empty_like(q)
        for joint in range(JOINT_COUNT):
            result[..., joint] = joint_response(
                q[..., joint],
                dt,
                delay=self.delay[joint],
                frequency=self.frequency[joint],
                damping=self.damping[joint],
                acceleration_max=self.acceleration_max[joint],
                speed_max=self.speed_max[joint],
            )
        return result

    def apply(self, grip_path: GripPath, arm: ArmUR) -> GripPath:
        """Return the paths that the gripper takes along commanded paths.

        Args:
            grip_path: Commanded paths, which start from rest and at the same time.
            arm: Robot arm.

        Returns:
            One path per commanded path, which ends when the arm has settled.

        Raises:
            IKError: A path leaves the reach of the arm.
            InputError: The paths start at different times.
        """
        chunks = [
            self._apply(grip_path[start : start + _CHUNK], arm)
            for start in range(0, len(grip_path), _CHUNK)
        ]
        return GripPath.stack(chunks) if len(chunks) > 1 else chunks[0]

    def _apply(self, grip_path: GripPath, arm: ArmUR) -> GripPath:
        from scipy.interpolate import CubicSpline

        start = grip_path.knots[:, 0]
        if np.ptp(start) > 0.0:
            raise InputError(
                f"the paths of a batch must start at the same time: these start between "
                f"{np.min(start):g} and {np.max(start):g} s"
            )
        ends = grip_path.duration - start + self.settle_time
        # A clamped spline needs at least three pieces.
        end_knot = np.maximum(np.ceil(ends / _KNOT_DT - 1e-9).astype(int), 3)
        weak = np.isfinite(self.acceleration_max) | np.isfinite(self.speed_max)
        knot_count = int(end_knot.max()) + 1 + (_CATCH_UP_KNOTS if weak.any() else 0)
        times = start[0] + np.arange((knot_count - 1) * _KNOT_STEPS + 1) * _STEP
        q = arm.inverse(grip_path.evaluate(times))
        moved = self.respond(q, _STEP)[:, ::_KNOT_STEPS]
        if weak.any():
            away = np.abs(moved - q[:, -1:])[..., weak].max(axis=-1) > _AWAY
            arrival = np.max(away * np.arange(1, knot_count + 1), axis=1)
            end_knot = np.maximum(end_knot, np.minimum(arrival, knot_count - 1))
            knot_count = int(end_knot.max()) + 1
        poses = arm.grip_pose(moved[:, :knot_count])
        poses[..., 3] = np.unwrap(poses[..., 3], axis=1)
        knots = times[: (knot_count - 1) * _KNOT_STEPS + 1 : _KNOT_STEPS]
        spline = CubicSpline(knots, poses, axis=1, bc_type="clamped")
        # The spline's coefficients are [power, piece, world, channel], highest power first.
        coefficients = np.zeros((len(grip_path), knot_count - 1, poses.shape[2], 6))
        coefficients[..., :4] = np.transpose(spline.c[::-1], (2, 1, 3, 0))
        # Rows that end earlier hold their settled pose.
        row_knots = np.minimum(knots, knots[end_knot][:, None])
        over = np.arange(knot_count - 1) >= end_knot[:, None]
        coefficients[over] = 0.0
        last = poses[np.arange(len(poses)), end_knot]
        coefficients[..., 0] = np.where(over[..., None], last[:, None], coefficients[..., 0])
        return GripPath(knots=row_knots, coefficients=coefficients)

    def to_dict(self) -> dict[str, list[float | None]]:
        """Return plain values to store in a file."""
        return {
            field.name: [
                float(value) if np.isfinite(value) else None for value in getattr(self, field.name)
            ]
            for field in dataclasses.fields(self)
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "ServoModel":
        """Return the model that `to_dict` described.

        Args:
            values: One list of six numbers per attribute; None stands for one that is unknown.

        Raises:
            InputError: A value is missing, unknown or out of bounds.
        """
        try:
            arrays = {
                name: np.array([_UNKNOWN.get(name) if v is None else v for v in column], float)
                for name, column in values.items()
            }
            return cls(**arrays)
        except (TypeError, ValueError, AttributeError) as error:
            raise InputError(f"this is not a servo model: {error}") from None
