"""Confidence ellipses of the landings of one action."""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.errors import InputError

CONFIDENCE = 0.95
"""Share of the landings of an action that are expected within its ellipse."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ConfidenceEllipse:
    """Confidence ellipse of the normal distribution with the mean and covariance of landings.

    Attributes:
        center_xy: Mean [m], shape [2].
        semi_axes: Longer and shorter semi-axis [m], shape [2].
        angle: Direction of the longer axis from x towards y [rad].
    """

    center_xy: NDArray[np.float64]
    semi_axes: NDArray[np.float64]
    angle: float

    def contains(self, xy: ArrayLike) -> NDArray[np.bool_]:
        """Return which points lie inside, shape [...], for points of shape [..., 2]."""
        offset = np.asarray(xy, dtype=float) - self.center_xy
        c, s = math.cos(self.angle), math.sin(self.angle)
        along = offset[..., 0] * c + offset[..., 1] * s
        across = offset[..., 1] * c - offset[..., 0] * s
        return np.hypot(along / self.semi_axes[0], across / self.semi_axes[1]) <= 1.0

    def outline(self, point_count: int = 73) -> NDArray[np.float64]:
        """Return points on the ellipse, the last equal to the first [m], shape [point, 2]."""
        turn = np.linspace(0.0, 2.0 * np.pi, point_count)
        along, across = self.semi_axes[0] * np.cos(turn), self.semi_axes[1] * np.sin(turn)
        c, s = math.cos(self.angle), math.sin(self.angle)
        return self.center_xy + np.stack([along * c - across * s, along * s + across * c], axis=-1)


def confidence_ellipse(
    xy: ArrayLike, level: float = CONFIDENCE, *, small_sample: bool = False
) -> ConfidenceEllipse | None:
    """Return the ellipse in which landings of one action are expected.

    Args:
        xy: Landings [m], shape [cast, 2]; those with NaN are left out.
        level: Share of the landings that are expected within the ellipse.
        small_sample: Whether to scale by Hotelling's distribution, which accounts for a covariance
            estimated from a few points (5.05 standard deviations for five points at 95 %).
            Otherwise the chi-squared distribution is used, as in the paper's figures (2.45).

    Returns:
        The ellipse; None for fewer than three landings, too few for a covariance.

    Raises:
        InputError: The level does not lie between 0 and 1.
    """
    if not 0.0 < level < 1.0:
        raise InputError(f"level = {level} must lie between 0 and 1")
    points = np.asarray(xy, dtype=float).reshape(-1, 2)
    points = points[np.all(np.isfinite(points), axis=1)]
    count = len(points)
    if count < 3:
        return None
    from scipy import stats

    scale = float(stats.chi2.ppf(level, 2))
    if small_sample:
        scale = 2.0 * (count - 1) / (count - 2) * float(stats.f.ppf(level, 2, count - 2))
    variances, axes = np.linalg.eigh(np.cov(points.T))
    return ConfidenceEllipse(
        center_xy=points.mean(axis=0),
        semi_axes=np.sqrt(scale * np.maximum(variances[::-1], 0.0)),
        angle=float(np.arctan2(axes[1, 1], axes[0, 1])),
    )
