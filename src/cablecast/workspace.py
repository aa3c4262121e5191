"""Workspace: table, reach of the arm, reset pose, and the 32 evaluation targets."""

import dataclasses
import pathlib
import warnings
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.conventions import Array, polar_to_xy, xy_to_polar
from cablecast.errors import InputError, TargetError, check_keys, check_ranges
from cablecast.files import read_numbers

_SUPPORT_DEPTH = 0.466

R_MAX_BOUNDS = 0.2, 2.0
"""Bounds of the largest distance from the base to the gripper [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Workspace:
    """Table, reach and reset pose; the defaults are those of the paper's experiments.

    The base is at the origin. The table must be symmetric about the workspace axis: the planner
    plans for the right half and mirrors.

    Attributes:
        table_width: Width of the table [m] (section V); along x unless the table is turned.
        table_depth: Depth of the table [m] (section V); along y unless the table is turned.
        table_yaw_deg: Rotation of the table in place [deg], a multiple of 90.
        table_near_y: y of the table's near edge [m]; negative where it reaches behind the base.
        r_max: Largest distance from the base to the gripper [m] (arXiv source of the paper).
        support_depth: Distance from the base to the edge of the robot's own table [m], which a
            radial pull must not cross (section VI-A); at most reset_y.
        reset_y: Distance of the gripper from the base after a reset [m]. With r0 = 0.6 the polar
            origin then coincides with the base, as section V-B describes.
        grip_height: Height of the gripped end above the table's surface [m].
    """

    table_width: float = 2.75
    table_depth: float = 1.50
    table_yaw_deg: float = 0.0
    table_near_y: float = 0.0
    r_max: float = 0.94
    # The paper's 0.466 m, or reset_y where that is less, as soon as the workspace is made.
    support_depth: float = cast(float, None)
    reset_y: float = 0.60
    grip_height: float = 0.02

    def __post_init__(self):
        if self.support_depth is None:
            nearer = isinstance(self.reset_y, float | int) and self.reset_y < _SUPPORT_DEPTH
            object.__setattr__(self, "support_depth", self.reset_y if nearer else _SUPPORT_DEPTH)
        check_ranges(
            self,
            {
                "table_width": (0.3, 10.0, "m"),
                "table_depth": (0.3, 10.0, "m"),
                "table_yaw_deg": (-360.0, 360.0, "deg"),
                "table_near_y": (-5.0, 1.0, "m"),
                "r_max": (*R_MAX_BOUNDS, "m"),
                "support_depth": (0.0, 2.0, "m"),
                "reset_y": (0.1, 2.0, "m"),
                "grip_height": (0.001, 0.5, "m"),
            },
            "workspace",
        )
        if self.table_yaw_deg % 90.0 != 0.0:
            raise InputError(
                f"workspace table_yaw_deg = {self.table_yaw_deg:g} deg is not a multiple of 90: "
                "the table must be symmetric about the workspace axis"
            )
        if self.support_depth > self.reset_y:
            raise InputError(
                f"workspace support_depth = {self.support_depth:g} m is beyond reset_y = "
                f"{self.reset_y:g} m: the gripper would rest over the robot's own table"
            )
        if self.reset_y > self.r_max:
            raise InputError(
                f"workspace reset_y = {self.reset_y:g} m is beyond r_max = {self.r_max:g} m"
            )

    @property
    def half_width(self) -> float:
        """Largest |x| on the table [m]."""
        return (self.table_depth if self._is_turned else self.table_width) / 2

    @property
    def y_min(self) -> float:
        """Smallest y on the table [m]."""
        return self.table_near_y

    @property
    def y_max(self) -> float:
        """Largest y on the table [m]."""
        return self.table_near_y + (self.table_width if self._is_turned else self.table_depth)

    @property
    def _is_turned(self) -> bool:
        return self.table_yaw_deg % 180.0 != 0.0

    def edge_distance(self, xy: ArrayLike) -> Array:
        """Return the distance of points [m], shape [..., 2], from the nearest edge of the table.

        It is negative off the table, and NaN for NaN points [m], shape [...].
        """
        xy = np.asarray(xy, dtype=float)
        x, y = xy[..., 0], xy[..., 1]
        return np.minimum.reduce([self.half_width - np.abs(x), y - self.y_min, self.y_max - y])

    def on_table(self, xy: ArrayLike) -> NDArray[np.bool_]:
        """Return which points [m], shape [..., 2], lie on the table, shape [...]; NaN do not."""
        return self.edge_distance(xy) >= 0.0

    def reach(self, cable_length: float) -> float:
        """Return the radius of the reachable half disc, r_max + r_c [m] (section III)."""
        return self.r_max + cable_length

    def check_targets(
        self,
        target_xy: ArrayLike | None = None,
        *,
        r: ArrayLike | None = None,
        theta_deg: ArrayLike | None = None,
        cable_length: float,
    ) -> Array:
        """Check targets, Cartesian or polar, and return them as x and y.

        Args:
            target_xy: Targets [m], shape [2] or [target, 2]; alternative to r and theta_deg.
            r: Distances from the robot's base [m], a number or shape [target].
            theta_deg: Angles from straight ahead, positive to the robot's right [deg], a number or
                shape [target].
            cable_length: Cable length r_c [m].

        Returns:
            Targets [m], shape [target, 2].

        Raises:
            InputError: Both forms are given, or neither, or values of the wrong kind or shape.
            TargetError: A target is not finite, has a negative radius, is farther than r_max + r_c,
                or off the table.
        """
        if (target_xy is None) == (r is None and theta_deg is None):
            raise InputError("targets are given as either target_xy or r and theta_deg")
        if target_xy is None:
            target_xy = _targets_from_polar(r, theta_deg)
        targets = np.atleast_2d(_numbers("target_xy", target_xy))
        if targets.ndim != 2 or targets.shape[1] != 2:
            raise InputError(
                f"target_xy has shape {np.shape(target_xy)}: it must be [2] or [target, 2]"
            )
        bound = self.reach(cable_length)
        for xy in targets:
            if not np.all(np.isfinite(xy)):
                raise TargetError(f"target ({xy[0]}, {xy[1]}) is not finite")
            radius, theta = xy_to_polar(xy)
            where = f"target r = {radius:.3f} m, theta = {np.degrees(theta):.1f} deg"
            if radius > bound:
                raise TargetError(f"{where} is out of reach: r must be at most {bound:.3f} m")
            if not self.on_table(xy):
                raise TargetError(
                    f"{where} is off the table: |x| <= {self.half_width:g} m and "
                    f"{self.y_min:g} <= y <= {self.y_max:g} m, but x = {xy[0]:.3f}, y = {xy[1]:.3f}"
                )
        return targets

    def to_dict(self) -> dict[str, float]:
        """Return plain values for a config or YAML file."""
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "Workspace":
        """Make a workspace from plain values; missing keys take their defaults.

        Raises:
            InputError: A key is unknown, or a value out of bounds.
        """
        known = {field.name for field in dataclasses.fields(cls)}
        return cls(**check_keys(values, known, "workspace"))


def load_targets() -> Array:
    """Return the 32 evaluation targets of the paper, as (x, y) [m], shape [32, 2].

    Source: figure of arXiv 2405.09581; x is exact to about 2 mm, y to about 1 cm.
    """
    file = pathlib.Path(__file__).with_name("data") / "targets_32.csv"
    return np.array(read_numbers(file, ("x_m", "y_m"), 1))


def _targets_from_polar(r: ArrayLike | None, theta_deg: ArrayLike | None) -> Array:
    """Return targets [m] from radii [m] and angles [deg], shape [target, 2]."""
    if r is None or theta_deg is None:
        raise InputError("a target needs both r and theta_deg")
    radius, angle = _numbers("r", r), _numbers("theta_deg", theta_deg)
    try:
        radius, angle = np.broadcast_arrays(np.atleast_1d(radius), np.atleast_1d(angle))
    except ValueError:
        shapes = f"{radius.shape} and {angle.shape}"
        raise InputError(f"r and theta_deg have shapes {shapes}, which do not match") from None
    if radius.ndim != 1:
        raise InputError(f"r and theta_deg have shape {radius.shape}: it must be [target]")
    for one_r, one_theta in zip(radius, angle, strict=True):
        if not (np.isfinite(one_r) and np.isfinite(one_theta)):
            raise TargetError(
                f"target r = {one_r:g} m, theta = {one_theta:g} deg must be finite numbers"
            )
        if abs(one_theta) > 180.0:
            raise TargetError(f"theta_deg = {one_theta:g} must be from -180 to 180")
        if one_r < 0:
            raise TargetError(f"target r = {one_r:g} m must not be negative")
    # Degrees are typed with few digits, and radians computed.
    small = (angle != 0.0) & (np.abs(angle) <= np.pi / 2)
    computed = small & (np.abs(angle - np.round(angle, 3)) > 1e-9)
    if computed.any():
        found = float(angle[computed][0])
        warnings.warn(
            f"theta_deg = {found:.6g} looks like radians: it is read as {found:.3g} degrees, and "
            f"{found:.3g} rad would be {np.degrees(found):.1f} degrees",
            stacklevel=4,
        )
    return polar_to_xy(np.stack([radius, np.radians(angle)], axis=-1))


def _numbers(name: str, values: ArrayLike) -> Array:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {str(values)[:80]!r} must be numbers") from None
