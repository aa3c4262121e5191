"""Frames, polar coordinates, the mirror, ellipses, gravity, and the register of random streams.

The robot base is at (0, 0); y points away from the robot over the table, x to the right, z up, and
the table's surface is z = 0. theta is measured from the y axis, positive to the right (clockwise
seen from above), so x = r sin(theta) and y = r cos(theta). See docs/conventions.md.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

GRAVITY = 9.81
"""Gravitational acceleration [m/s²]."""

STREAMS: dict[str, int] = {
    "encoders of the twin": 79,
    "epochs": 2,
    "evolution": 0,
    "feasible actions": 0,
    "feasible grid": 0,
    "folds": 7,
    "Gaussian process": 3,
    "check": 3,
    "held-out casts": 0,
    "order of a grid": 1,
    "poses of an arm": 0,
    "posterior": 13,
    "prior": 11,
    "spread casts": 0,
    "suggested targets": 0,
    "swing": 83,
    "weights": 1,
}
"""Number of each random stream. Streams of one number and one seed draw the same chances, for
different purposes; a new stream takes a new number."""


def stream(seed: int, name: str, index: int = 0) -> np.random.Generator:
    """Return the random stream of a seed for one purpose of `STREAMS`, or the index-th of it."""
    return np.random.default_rng([seed, STREAMS[name] + index])


def polar_to_xy(polar: ArrayLike) -> Array:
    """Convert polar to Cartesian coordinates (g_p2c of the paper).

    Args:
        polar: Radius [m] and angle from the y axis [rad], shape [..., 2].

    Returns:
        x and y [m], shape [..., 2].

    Example:
        A target 1.10 m away and 30 degrees to the right of straight ahead:

        >>> polar_to_xy([1.10, np.radians(30.0)]).round(3)
        array([0.55 , 0.953])
    """
    polar = np.asarray(polar, dtype=float)
    r, theta = polar[..., 0], polar[..., 1]
    return np.stack([r * np.sin(theta), r * np.cos(theta)], axis=-1)


def xy_to_polar(xy: ArrayLike) -> Array:
    """Convert Cartesian to polar coordinates.

    Args:
        xy: x and y [m], shape [..., 2].

    Returns:
        Radius [m] and angle from the y axis in (-pi, pi] [rad], shape [..., 2].

    Example:
        >>> r, theta = xy_to_polar([0.3, 0.4])
        >>> print(f"{r:.2f} m, {np.degrees(theta):.1f} deg")
        0.50 m, 36.9 deg
    """
    xy = np.asarray(xy, dtype=float)
    x, y = xy[..., 0], xy[..., 1]
    return np.stack([np.hypot(x, y), np.arctan2(x, y)], axis=-1)


def mirror_xy(xy: ArrayLike, side: ArrayLike = -1.0) -> Array:
    """Mirror points [m], shape [..., 2] or [..., 3], about the workspace axis (x -> -x).

    Points are left where `side`, shape [...], is +1, and mirrored where it is -1.

    Example:
        >>> mirror_xy([[0.2, 0.9], [-0.1, 1.1]])
        array([[-0.2,  0.9],
               [ 0.1,  1.1]])
    """
    xy = np.asarray(xy, dtype=float)
    is_x = np.arange(xy.shape[-1]) == 0
    return xy * np.where(is_x, np.asarray(side, dtype=float)[..., None], 1.0)


def side_of(xy: ArrayLike) -> Array:
    """Return +1 for points on the right half of the table, axis included, -1 for others, [...]."""
    return np.where(np.asarray(xy)[..., 0] < 0, -1.0, 1.0)


def tangent(yaw: ArrayLike, pitch: ArrayLike = 0.0) -> Array:
    """Return the unit direction in which the cable leaves the gripper.

    Args:
        yaw: Heading from the y axis, positive to the right [rad], shape [...].
        pitch: Elevation above the horizontal [rad], shape [...].

    Returns:
        (sin yaw cos pitch, cos yaw cos pitch, sin pitch), shape [..., 3].
    """
    yaw, pitch = np.broadcast_arrays(np.asarray(yaw, float), np.asarray(pitch, float))
    cos_pitch = np.cos(pitch)
    return np.stack([np.sin(yaw) * cos_pitch, np.cos(yaw) * cos_pitch, np.sin(pitch)], axis=-1)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ellipse:
    """Ellipse in the plane of the table, a contour of a distribution of landings.

    Attributes:
        center_xy: Center [m], shape [2].
        semi_axes: Longer and shorter semi-axis [m], shape [2].
        angle: Direction of the longer axis from x towards y [rad].
    """

    center_xy: Array
    semi_axes: Array
    angle: float

    @classmethod
    def of_covariance(cls, center_xy: ArrayLike, covariance: ArrayLike, square: float) -> "Ellipse":
        """Return the ellipse of points p with (p - center)' covariance^-1 (p - center) = square.

        Args:
            center_xy: Mean [m], shape [2].
            covariance: Covariance [m²], shape [2, 2].
            square: Squared distance in standard deviations [-]; -2 log(1 - share) holds a share of
                a normal distribution.
        """
        variances, axes = np.linalg.eigh(np.asarray(covariance, dtype=float))
        return cls(
            center_xy=np.asarray(center_xy, dtype=float),
            semi_axes=np.sqrt(square * np.maximum(variances[::-1], 0.0)),
            angle=math.atan2(axes[1, 1], axes[0, 1]),
        )

    def outline(self) -> Array:
        """Return points on the ellipse, the last equal to the first [m], shape [point, 2]."""
        turn = np.linspace(0.0, 2.0 * np.pi, 73)
        along, across = self.semi_axes[0] * np.cos(turn), self.semi_axes[1] * np.sin(turn)
        c, s = math.cos(self.angle), math.sin(self.angle)
        return self.center_xy + np.stack([along * c - across * s, along * s + across * c], axis=-1)


def finite_or_none(value: float) -> float | None:
    """Return a number for a JSON file; None for NaN and infinity, which JSON lacks.

    >>> finite_or_none(float("nan")) is None
    True
    """
    return float(value) if math.isfinite(value) else None
