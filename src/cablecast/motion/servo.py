"""How an arm follows its set points: the path that the gripper really takes.

Every joint answers its set points with a delay and the response of a damped oscillator. A cast
lasts a second or two and turns within tenths of a second, so a lag of some hundredths bends its
path by centimetres, more than the cable's own modelling error. A simulation of what an arm will do
must therefore play the path that the servo makes of the command.
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

_STEP = 0.016
"""Interval at which `apply` works [s], and half of that between the knots of its result: coarse,
because it is to convert 36,000 paths; it stays within 0.1 mm of the exact response."""
_KNOT_STEPS = 2
_SETTLED = 1e-4
"""Share of a step that may be left when the resulting path ends."""
_SETTLE_MAX = 2.0
# Paths converted at a time: bounds the memory of the intermediate arrays to some 100 MB.
_CHUNK = 1000


@dataclasses.dataclass(frozen=True, kw_only=True)
class ServoModel:
    """Each joint follows its set points after a delay, as a damped oscillator.

    Attributes:
        delay: Time before a set point has any effect [s], shape [6].
        frequency: Undamped angular frequency of the response [rad/s], shape [6].
        damping: Damping ratio of the response [-], shape [6].
        residual: What the model leaves of measured joints, rms [rad], shape [6]; NaN where unknown.
    """

    delay: NDArray[np.float64]
    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    residual: NDArray[np.float64] = dataclasses.field(
        default_factory=lambda: np.full(JOINT_COUNT, np.nan)
    )

    def __post_init__(self):
        for name, unit, low, high in (
            ("delay", "s", 0.0, 0.5),
            ("frequency", "rad/s", 5.0, 5000.0),
            ("damping", "-", 0.2, 5.0),
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
        """How far each joint trails a steady motion, delay + 2 damping / frequency [s], [6]."""
        return self.delay + 2.0 * self.damping / self.frequency

    @property
    def settle_time(self) -> float:
        """How long after the last set point the slowest joint is at rest [s]."""
        # The slower of both poles where the response does not oscillate.
        root = np.sqrt(np.maximum(self.damping**2 - 1.0, 0.0))
        decay = self.frequency * (self.damping - root)
        return float(min(np.max(self.delay + np.log(1.0 / _SETTLED) / decay), _SETTLE_MAX))

    def respond(self, q: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
        """Joints that follow set points between which the controller interpolates smoothly.

        Args:
            q: Set points at an even interval, begun at rest [rad], shape [..., tick, 6].
            dt: The interval [s].

        Returns:
            Joints at the same times [rad], same shape.
        """
        from scipy.signal import cont2discrete, lfilter

        start = q[..., :1, :]
        moved = q - start
        result = np.empty_like(q)
        for joint in range(JOINT_COUNT):
            w, zeta = self.frequency[joint], self.damping[joint]
            # Exact for set points that run straight from tick to tick. Curved ones run inside their
            # chords; moving each by a twelfth of the second difference makes up for it on average.
            discrete: Any = cont2discrete(([w * w], [1.0, 2.0 * zeta * w, w * w]), dt, method="foh")
            numerator, denominator = discrete[:2]
            delayed = _delayed(moved[..., joint], self.delay[joint] / dt)
            delayed[..., 1:-1] -= np.diff(delayed, 2, axis=-1) / 12.0
            result[..., joint] = lfilter(np.ravel(numerator), denominator, delayed, axis=-1)
        return result + start

    def apply(self, grip_path: GripPath, arm: ArmUR) -> GripPath:
        """The paths that the gripper takes when it is commanded along others.

        Args:
            grip_path: Commanded paths, begun at rest, all at the same time.
            arm: Robot arm.

        Returns:
            As many paths, each of which ends when the arm has settled.

        Raises:
            IKError: A path leaves the reach of the arm.
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
            raise InputError("paths that start at different times cannot be followed in one batch")
        ends = grip_path.duration + self.settle_time
        knot_dt = _KNOT_STEPS * _STEP
        # Three pieces are the least that a spline with given ends needs to be one.
        end_knot = np.maximum(np.ceil((ends - start) / knot_dt - 1e-9).astype(int), 3)
        knot_count = int(end_knot.max()) + 1
        times = start[0] + np.arange((knot_count - 1) * _KNOT_STEPS + 1) * _STEP
        q = arm.inverse(grip_path.evaluate(times))
        poses = arm.grip_pose(self.respond(q, _STEP)[:, ::_KNOT_STEPS])
        poses[..., 3] = np.unwrap(poses[..., 3], axis=1)
        knots = times[::_KNOT_STEPS]
        spline = CubicSpline(knots, poses, axis=1, bc_type="clamped")
        # The spline's coefficients are [power, piece, world, channel], highest power first.
        coefficients = np.zeros((len(grip_path), knot_count - 1, poses.shape[2], 6))
        coefficients[..., :4] = np.transpose(spline.c[::-1], (2, 1, 3, 0))
        # Rows that end earlier keep the pose that they have settled to.
        row_knots = np.minimum(knots, knots[end_knot][:, None])
        over = np.arange(knot_count - 1) >= end_knot[:, None]
        coefficients[over] = 0.0
        last = poses[np.arange(len(poses)), end_knot]
        coefficients[..., 0] = np.where(over[..., None], last[:, None], coefficients[..., 0])
        return GripPath(knots=row_knots, coefficients=coefficients)

    def to_dict(self) -> dict[str, list[float | None]]:
        """Plain values for a file."""
        return {
            field.name: [
                float(value) if np.isfinite(value) else None for value in getattr(self, field.name)
            ]
            for field in dataclasses.fields(self)
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "ServoModel":
        """The model that `to_dict` described.

        Raises:
            InputError: A value is missing, unknown or out of bounds.
        """
        try:
            arrays = {
                name: np.array([np.nan if v is None else float(v) for v in column])
                for name, column in values.items()
            }
            return cls(**arrays)
        except (TypeError, ValueError, AttributeError) as error:
            raise InputError(f"this is no servo model: {error}") from None


def _delayed(values: NDArray[np.float64], steps: float) -> NDArray[np.float64]:
    """Values that begin at rest at 0, later by a fraction of steps, on cubics between them."""
    whole = int(np.floor(steps))
    share = steps - whole
    count = values.shape[-1]
    before = np.zeros((*values.shape[:-1], whole + 2))
    padded = np.concatenate([before, values, values[..., -1:]], axis=-1)
    result = np.zeros_like(values)
    # Lagrange's weights of the values one step later, now, and one and two steps before.
    places = np.array([1.0, 0.0, -1.0, -2.0])
    for index, place in enumerate(places):
        others = np.delete(places, index)
        weight = np.prod((-share - others) / (place - others))
        first = 2 + int(place)
        result += weight * padded[..., first : first + count]
    return result
