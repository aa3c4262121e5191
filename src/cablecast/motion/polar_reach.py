"""PolarReach: the region in which polar casting can lay down the endpoint of a cable."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.conventions import polar_to_xy, xy_to_polar
from cablecast.errors import InputError
from cablecast.motion.polar_config import PolarCastConfig
from cablecast.setup import Setup

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolarReach:
    """Region in which polar casting can lay the endpoint of a cable.

    The cast lays the endpoint at most cast_radius + r_c from the base, and inside the table. The
    pull ends where the gripper would run into the robot's own table, at y = 0.466 m. Straight
    ahead, y of the endpoint is therefore at least 0.466 m + r_c, the limit that the paper states.
    To the side the cable lies at an angle, and the endpoint may be nearer. The paper's errors of
    polar casting (median 43 %, third quartile 76 %, largest 106 % of the cable's length) match the
    distances of its targets from this region (44, 76, 105 %), not from the half plane beyond
    0.466 m + r_c (63, 97, 118 %).

    Attributes:
        cable_length: Cable length r_c [m].
        cast_radius: Largest radius at which the gripper comes down [m].
        grip_y_min: Smallest y of the gripper, at the robot's own table [m].
        half_width: Largest |x| of an endpoint [m].
        y_max: Largest y of an endpoint [m].
    """

    cable_length: float
    cast_radius: float
    grip_y_min: float
    half_width: float
    y_max: float

    @classmethod
    def of(cls, setup: Setup, config: PolarCastConfig | None = None) -> "PolarReach":
        """Return the region for the cable and table of a set-up.

        Raises:
            InputError: The region is empty: the cable is too long for the table.
        """
        cable, workspace = setup.cable, setup.workspace
        config = config or PolarCastConfig.of(workspace)
        reach = cls(
            cable_length=cable.length,
            cast_radius=min(config.cast_radius, workspace.r_max),
            grip_y_min=workspace.support_depth,
            half_width=workspace.half_width - config.table_margin,
            y_max=workspace.y_max - config.table_margin,
        )
        if reach.landing_radius(0.0) <= reach.pulled_radius(0.0):
            raise InputError(
                f"polar casting reaches nothing with a cable of {cable.length} m: straight ahead "
                f"its endpoint lands at {reach.landing_radius(0.0):.3f} m and can be pulled no "
                f"nearer than {reach.pulled_radius(0.0):.3f} m"
            )
        return reach

    @property
    def radius(self) -> float:
        """Largest distance of an endpoint from the base, table edges ignored [m]."""
        return self.cast_radius + self.cable_length

    @property
    def area(self) -> float:
        """Area of the region [m²]."""
        x, y = self.outline(2000).T
        return float(0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))))

    def contains(self, xy: ArrayLike) -> NDArray[np.bool_]:
        """Return which points lie in the region.

        Args:
            xy: Points [m], shape [..., 2].
        """
        xy = np.asarray(xy, dtype=float)
        r, theta = np.moveaxis(xy_to_polar(xy), -1, 0)
        inside = (r <= self.radius) & (np.abs(xy[..., 0]) <= self.half_width)
        inside &= (xy[..., 1] <= self.y_max) & (np.abs(theta) < np.pi / 2)
        return inside & ((r - self.cable_length) * np.cos(theta) >= self.grip_y_min)

    def landing_radius(self, theta: float) -> float:
        """Return the distance from the base at which the endpoint lands, before the pull [m].

        Args:
            theta: Azimuth [rad].
        """
        sin, cos = abs(np.sin(theta)), np.cos(theta)
        edges = [self.half_width / sin if sin > 0 else np.inf, self.y_max / cos]
        return float(min(self.radius, *edges))

    def pulled_radius(self, theta: float) -> float:
        """Return the smallest distance from the base to which the endpoint can be pulled [m].

        Args:
            theta: Azimuth [rad].
        """
        return float(self.grip_y_min / np.cos(theta) + self.cable_length)

    @property
    def theta_max(self) -> float:
        """Largest azimuth at which the cable can be cast and pulled [rad]."""
        low, high = 0.0, float(np.pi / 2)
        for _ in range(60):
            middle = (low + high) / 2
            reached = self.landing_radius(middle) > self.pulled_radius(middle)
            low, high = (middle, high) if reached else (low, middle)
        return low

    def outline(self, count: int = 200) -> Array:
        """Return points around the region, from the right end along the far bound and back.

        Args:
            count: Number of points on each bound.

        Returns:
            x, y [m], shape [2 count, 2].
        """
        theta = np.linspace(self.theta_max, -self.theta_max, count)
        bounds = [
            polar_to_xy(np.stack([[radius(t) for t in angles], angles], axis=-1))
            for radius, angles in (
                (self.landing_radius, theta),
                (self.pulled_radius, theta[::-1]),
            )
        ]
        return np.concatenate(bounds)

    def nearest(self, xy: ArrayLike) -> Array:
        """Return the points of the region nearest to given points.

        Args:
            xy: Points [m], shape [..., 2].
        """
        xy = np.asarray(xy, dtype=float)
        near = xy.reshape(-1, 2).copy()
        # Project onto every edge of a fine outline; its chords are within 1 um of the curves.
        start = self.outline(1000)
        edge = np.roll(start, -1, axis=0) - start
        length2 = np.maximum(np.sum(edge**2, axis=1), 1e-30)
        for row in np.flatnonzero(~self.contains(near)):
            share = np.clip(np.sum((near[row] - start) * edge, axis=1) / length2, 0.0, 1.0)
            places = start + share[:, None] * edge
            near[row] = places[np.argmin(np.sum((places - near[row]) ** 2, axis=1))]
        return near.reshape(xy.shape)
