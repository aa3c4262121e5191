"""Workspace: table, reach of the arm, reset pose, and the 32 evaluation targets."""

import dataclasses
import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.conventions import Array
from cablecast.errors import InputError, check_keys, check_ranges
from cablecast.files import read_numbers

_SUPPORT_DEPTH = 0.466
# Stands for _SUPPORT_DEPTH, or reset_y where that is less, until the workspace is made.
_NOT_GIVEN = float("nan")

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
    support_depth: float = _NOT_GIVEN
    reset_y: float = 0.60
    grip_height: float = 0.02

    def __post_init__(self):
        if self.support_depth is _NOT_GIVEN:
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
