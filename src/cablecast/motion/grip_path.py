"""GripPath: gripper pose over time as piecewise polynomials, one row per world.

Engines evaluate it inside their step, rigs at the robot's control ticks. Measured paths are fitted
to it. It is the only description of a motion that passes from planning to execution.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.errors import InputError

CHANNELS = ("x", "y", "z", "yaw", "pitch")
DEGREE = 5

# Hermite basis of degree five: coefficients of (value, velocity, acceleration) at the start and at
# the end of a piece of unit duration, in ascending powers.
_HERMITE = np.array(
    [
        [1, 0, 0, 0, 0, 0],
        [0, 1, 0, 0, 0, 0],
        [0, 0, 0.5, 0, 0, 0],
        [-10, -6, -1.5, 10, -4, 0.5],
        [15, 8, 1.5, -15, 7, -1],
        [-6, -3, -0.5, 6, -3, 0.5],
    ]
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class GripPath:
    """Gripper pose over time, constant before the first and after the last knot.

    Attributes:
        knots: Boundaries of the pieces, ascending; a row may repeat its last knot as padding [s],
            shape [world, piece + 1].
        coefficients: Coefficient of each power of the time since the start of the piece, for
            x, y, z [m], yaw and pitch [rad], shape [world, piece, 5, 6].
    """

    knots: NDArray[np.float64]
    coefficients: NDArray[np.float64]

    def __post_init__(self):
        world_count, knot_count = self.knots.shape
        shape = (world_count, knot_count - 1, len(CHANNELS), DEGREE + 1)
        if self.coefficients.shape != shape or knot_count < 2:
            raise InputError(
                f"coefficients have shape {self.coefficients.shape}: the knots require {shape}"
            )
        if not (np.all(np.isfinite(self.knots)) and np.all(np.isfinite(self.coefficients))):
            raise InputError("a grip path must be finite")
        if np.any(np.diff(self.knots, axis=1) < 0):
            raise InputError("the knots of a grip path must not decrease")

    def __len__(self) -> int:
        return len(self.knots)

    def __getitem__(self, index) -> "GripPath":
        """Return the worlds selected by an index, a slice or a mask, always as a batch."""
        if isinstance(index, (int, np.integer)):
            index = [int(index)]
        return GripPath(knots=self.knots[index], coefficients=self.coefficients[index])

    @property
    def duration(self) -> NDArray[np.float64]:
        """End time of each motion [s], shape [world]."""
        return self.knots[:, -1]

    def evaluate(self, times: ArrayLike, derivative: int = 0) -> NDArray[np.float64]:
        """Return the poses, or their time derivatives, at given times.

        Args:
            times: Times [s], shape [step] for all worlds or [world, step] per world.
            derivative: 0 for poses, 1 for velocities, 2 for accelerations and so on.

        Returns:
            x, y, z [m], yaw and pitch [rad] (or per s^derivative), shape [world, step, 5].
        """
        times = np.asarray(times, dtype=float)
        times = np.broadcast_to(times, (len(self), times.shape[-1]))
        clamped = np.clip(times, self.knots[:, :1], self.knots[:, -1:])
        piece = np.empty(times.shape, dtype=int)
        for world, row in enumerate(self.knots):
            piece[world] = np.searchsorted(row[1:-1], clamped[world], side="right")
        world = np.arange(len(self))[:, None]
        # The end time may fall on a padding piece of zero duration; step back from it.
        last = np.argmax(self.knots >= self.knots[:, -1:], axis=1)[:, None] - 1
        piece = np.minimum(piece, np.maximum(last, 0))
        local = (clamped - self.knots[world, piece])[..., None]
        coefficients = self.coefficients[world, piece]
        value = np.zeros((*times.shape, len(CHANNELS)))
        for power in range(DEGREE, derivative - 1, -1):
            factor = np.prod(np.arange(power, power - derivative, -1), dtype=float)
            value = value * local + factor * coefficients[..., power]
        if derivative:
            outside = (times < self.knots[:, :1]) | (times > self.knots[:, -1:])
            value[outside] = 0.0
        return value

    def mirrored(self) -> "GripPath":
        """Return the motion mirrored about the workspace axis (x and yaw change sign)."""
        coefficients = self.coefficients.copy()
        coefficients[:, :, [0, 3]] *= -1.0
        return GripPath(knots=self.knots.copy(), coefficients=coefficients)

    @classmethod
    def from_hermite(
        cls, knots: ArrayLike, poses: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike
    ) -> "GripPath":
        """Make quintic pieces that match pose, velocity and acceleration at both ends.

        Args:
            knots: Times [s], shape [world, piece + 1].
            poses: x, y, z, yaw, pitch at the knots, shape [world, piece + 1, 5].
            velocities: Their first derivatives, same shape.
            accelerations: Their second derivatives, same shape. If they jump at knots, the values
                at the start and at the end of each piece, shape [world, piece, 2, 5].
        """
        knots = np.atleast_2d(np.asarray(knots, dtype=float))
        p, v, a = (np.asarray(k, dtype=float) for k in (poses, velocities, accelerations))
        if a.ndim == 3:
            a = np.stack([a[:, :-1], a[:, 1:]], axis=2)
        h = np.diff(knots, axis=1)[..., None]
        ends = [p[:, :-1], h * v[:, :-1], h**2 * a[:, :, 0]]
        ends += [p[:, 1:], h * v[:, 1:], h**2 * a[:, :, 1]]
        unit = np.einsum("ij,wpcj->wpci", _HERMITE, np.stack(ends, axis=-1))
        safe = np.where(h > 0, h, 1.0)[..., None]
        unit /= safe ** np.arange(DEGREE + 1)
        # Padding pieces of zero duration hold the pose.
        still = (h <= 0)[..., None] & (np.arange(DEGREE + 1) > 0)
        return cls(knots=knots, coefficients=np.where(still, 0.0, unit))

    @classmethod
    def fit(cls, times: ArrayLike, poses: ArrayLike) -> "GripPath":
        """Fit a smooth path through measured poses (not-a-knot cubic spline), for one world.

        Args:
            times: At least four ascending times [s], shape [step].
            poses: x, y, z [m], yaw, pitch [rad], shape [step, 5].
        """
        from scipy.interpolate import CubicSpline

        times = np.asarray(times, dtype=float)
        if times.ndim != 1 or len(times) < 4:
            raise InputError(f"fitting a grip path needs at least 4 times, not {times.shape}")
        spline = CubicSpline(times, np.asarray(poses, dtype=float))
        coefficients = np.zeros((1, len(times) - 1, len(CHANNELS), DEGREE + 1))
        coefficients[0, :, :, :4] = np.moveaxis(spline.c[::-1], 0, -1)
        return cls(knots=times[None], coefficients=coefficients)

    @classmethod
    def hold(cls, pose: ArrayLike, duration: float) -> "GripPath":
        """Return a path that holds one pose, for one world.

        Args:
            pose: x, y, z [m], yaw, pitch [rad], shape [5].
            duration: Duration [s].
        """
        coefficients = np.zeros((1, 1, len(CHANNELS), DEGREE + 1))
        coefficients[0, 0, :, 0] = np.asarray(pose, dtype=float)
        return cls(knots=np.array([[0.0, duration]]), coefficients=coefficients)

    @classmethod
    def stack(cls, paths: Sequence["GripPath"]) -> "GripPath":
        """Stack several batches into one, padded to the longest."""
        piece_count = max(path.coefficients.shape[1] for path in paths)
        knots, coefficients = [], []
        for path in paths:
            pad = piece_count - path.coefficients.shape[1]
            knots.append(np.pad(path.knots, ((0, 0), (0, pad)), mode="edge"))
            end = path.evaluate(path.duration[:, None])[:, 0]
            still = np.zeros((len(path), pad, len(CHANNELS), DEGREE + 1))
            still[..., 0] = end[:, None]
            coefficients.append(np.concatenate([path.coefficients, still], axis=1))
        return cls(knots=np.concatenate(knots), coefficients=np.concatenate(coefficients))

    @classmethod
    def chain(cls, paths: Sequence["GripPath"]) -> "GripPath":
        """Chain several paths into one, for one world.

        Args:
            paths: Paths of one row; each must start where the previous one ends.
        """
        knots, coefficients, end, before = [np.zeros(1)], [], 0.0, np.zeros(len(CHANNELS))
        for path in paths:
            if len(path) != 1:
                raise InputError(f"a chain takes paths of one row, not a batch of {len(path)}")
            start = path.evaluate(path.knots[:, :1])[0, 0]
            if coefficients and np.max(np.abs(start - before)) > 1e-6:
                raise InputError(
                    f"a path that starts at {start.round(4).tolist()} cannot follow one that ends "
                    f"at {before.round(4).tolist()}"
                )
            before = path.evaluate(path.duration[:, None])[0, 0]
            knots.append(path.knots[0, 1:] - path.knots[0, 0] + end)
            coefficients.append(path.coefficients)
            end = knots[-1][-1]
        return cls(
            knots=np.concatenate(knots)[None], coefficients=np.concatenate(coefficients, axis=1)
        )
