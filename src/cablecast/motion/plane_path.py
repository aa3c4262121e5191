"""PlanePath: builder of grip paths in a vertical plane that turns about the robot's base.

The reset and polar casting lift, swing and drag the cable within such a plane. A path is built move
by move in plane coordinates: azimuth of the plane, radius and height in it, heading of the cable
relative to the azimuth, and pitch.
"""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath

COORDINATES = ("azimuth", "radius", "height", "turn", "pitch")

PIECE_DURATION = 0.1
"""Longest piece of a path [s]. A quintic that matches pose, velocity and acceleration at both ends
follows the turning plane to within 1 um at 2 rad/s (tests/motion/test_plane_path.py)."""

# Minimum-jerk move from 0 to 1 over unit time, from rest to rest.
_SMOOTH = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])


class PlanePath:
    """Path under construction; every move is appended and returns the path.

    Args:
        pose: Start pose: x, y, z [m], yaw, pitch [rad], shape [5].
    """

    def __init__(self, pose: ArrayLike):
        x, y, z, yaw, pitch = (float(value) for value in np.asarray(pose, dtype=float))
        azimuth = float(np.arctan2(x, y))
        self._times = [0.0]
        # Position, velocity and acceleration before and after each knot.
        still = np.zeros(len(COORDINATES))
        here = np.array([azimuth, np.hypot(x, y), z, yaw - azimuth, pitch])
        self._before = [np.stack([here, still, still])]
        self._after: list[NDArray[np.float64]] = []

    @property
    def duration(self) -> float:
        """Duration so far [s]."""
        return self._times[-1]

    @property
    def place(self) -> dict[str, float]:
        """Coordinates at the current end of the path, by name [m], [rad]."""
        return dict(zip(COORDINATES, self._before[-1][0].tolist(), strict=True))

    def hold(self, duration: float) -> "PlanePath":
        """Hold the pose for a duration [s]."""
        return self.move(duration)

    def move(self, duration: float, **goal: float) -> "PlanePath":
        """Move with minimum jerk from rest to rest.

        Args:
            duration: Duration [s].
            goal: New values of some coordinates [m], [rad]; the others are kept.
        """
        start = self._before[-1][0]
        end = start.copy()
        for name, value in goal.items():
            end[COORDINATES.index(name)] = value
        count = max(1, int(np.ceil(duration / PIECE_DURATION)))
        share = np.linspace(0.0, 1.0, count + 1)
        orders = [_SMOOTH.deriv(order)(share) / duration**order for order in range(3)]
        states = np.stack(orders, axis=1)[:, :, None] * (end - start)
        states[:, 0] += start
        self._append(share * duration, states, states)
        return self

    def through(self, times: Sequence[float], **points: Sequence[float]) -> "PlanePath":
        """Move through points from rest to rest, along a cubic spline.

        Args:
            times: Ascending times of the points, counted from the current end of the path [s]. The
                path comes to rest at the last one.
            points: Values of some coordinates at these times [m], [rad]; the others are kept.
        """
        from scipy.interpolate import CubicSpline

        knots = np.concatenate([[0.0], np.asarray(times, dtype=float)])
        if np.any(np.diff(knots) <= 0):
            raise InputError(f"times {list(times)} must ascend and be above 0")
        values = np.repeat(self._before[-1][:1], len(knots), axis=0)
        for name, row in points.items():
            values[1:, COORDINATES.index(name)] = row
        spline = CubicSpline(knots, values, bc_type="clamped")
        parts = [
            np.linspace(low, high, max(1, int(np.ceil((high - low) / PIECE_DURATION))) + 1)[1:]
            for low, high in itertools.pairwise(knots)
        ]
        at = np.concatenate([[0.0], *parts])
        states = np.stack([spline(at, order) for order in range(3)], axis=1)
        self._append(at, states, states)
        return self

    def _append(self, at, before, after) -> None:
        self._times += (self._times[-1] + at[1:]).tolist()
        self._after += list(after[:-1])
        self._before += list(before[1:])

    def grip_path(self) -> GripPath:
        """Return the path so far as one row.

        Raises:
            InputError: The path has no move yet.
        """
        if not self._after:
            raise InputError("a path needs at least one move")
        after = [*self._after, self._before[-1]]
        poses, velocities, ends = _to_base(np.stack(self._before))
        _, _, starts = _to_base(np.stack(after))
        # Accelerations jump at some knots; poses and velocities do not.
        accelerations = np.stack([starts[:-1], ends[1:]], axis=1)
        knots = np.array(self._times)
        return GripPath.from_hermite(
            knots[None], poses[None], velocities[None], accelerations[None]
        ).levelled()


def _to_base(states: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return pose, velocity and acceleration in the base frame, each of shape [knot, 5].

    Args:
        states: Pose, velocity and acceleration in plane coordinates, shape [knot, 3, 5].
    """
    (a, da, dda), (r, dr, ddr), (z, dz, ddz), (t, dt, ddt), (p, dp, ddp) = states.transpose(2, 1, 0)
    sin, cos = np.sin(a), np.cos(a)
    radial, across = ddr - r * da**2, r * dda + 2.0 * dr * da
    return (
        np.stack([r * sin, r * cos, z, a + t, p], axis=1),
        np.stack([dr * sin + r * da * cos, dr * cos - r * da * sin, dz, da + dt, dp], axis=1),
        np.stack(
            [radial * sin + across * cos, radial * cos - across * sin, ddz, dda + ddt, ddp], axis=1
        ),
    )
