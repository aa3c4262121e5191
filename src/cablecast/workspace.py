"""The table, the reach of the arm, the reset pose, and the 32 evaluation targets."""

import csv
import dataclasses
import importlib.resources

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.conventions import xy_to_polar
from cablecast.errors import TargetError


@dataclasses.dataclass(frozen=True, kw_only=True)
class Workspace:
    """Table and arm as they stand in the paper's experiments; the base is at the origin.

    Attributes:
        table_width: Extent along x, centred on the base [m] (section V).
        table_depth: Extent along y, from the base to the far edge [m] (section V).
        r_max: Largest distance from the base to the gripper [m] (arXiv source of the paper).
        support_depth: Distance from the base to the edge of the robot's own table [m], which a
            radial pull must not cross (section VI-A).
        reset_y: Distance of the gripper from the base after a reset [m]. With r0 = 0.6 the polar
            origin then coincides with the base, as section V-B describes.
        grip_height: Height of the gripped end above the table's surface [m].
    """

    table_width: float = 2.75
    table_depth: float = 1.50
    r_max: float = 0.94
    support_depth: float = 0.466
    reset_y: float = 0.60
    grip_height: float = 0.02

    def on_table(self, xy: ArrayLike) -> NDArray[np.bool_]:
        """Which points lie on the table.

        Args:
            xy: Points [m], shape [..., 2].

        Returns:
            True where on the table, shape [...]; NaN points are not.
        """
        xy = np.asarray(xy, dtype=float)
        x, y = xy[..., 0], xy[..., 1]
        return (np.abs(x) <= self.table_width / 2) & (y >= 0.0) & (y <= self.table_depth)

    def reach(self, cable_length: float) -> float:
        """Radius of the reachable half disc, r_max + r_c [m] (section III)."""
        return self.r_max + cable_length

    def check_target(self, target_xy: ArrayLike, cable_length: float) -> NDArray[np.float64]:
        """Return targets that can be asked for, and refuse the others.

        Args:
            target_xy: Targets [m], shape [..., 2].
            cable_length: Cable length r_c [m].

        Raises:
            TargetError: A target is not finite, farther than r_max + r_c, or off the table.
        """
        target_xy = np.asarray(target_xy, dtype=float)
        for xy in target_xy.reshape(-1, 2):
            if not np.all(np.isfinite(xy)):
                raise TargetError(f"target ({xy[0]}, {xy[1]}) is not finite")
            r, theta = xy_to_polar(xy)
            bound = self.reach(cable_length)
            where = f"target r = {r:.3f} m, theta = {np.degrees(theta):.1f} deg"
            if r > bound:
                raise TargetError(f"{where} is out of reach: r must be at most {bound:.3f} m")
            if not self.on_table(xy):
                raise TargetError(
                    f"{where} is off the table: |x| <= {self.table_width / 2} m and "
                    f"0 <= y <= {self.table_depth} m, but x = {xy[0]:.3f}, y = {xy[1]:.3f}"
                )
        return target_xy


def load_targets() -> NDArray[np.float64]:
    """The 32 evaluation targets of the paper, as (x, y) [m], shape [32, 2].

    Source: figure of arXiv 2405.09581; x is exact to about 2 mm, y to about 1 cm.
    """
    text = importlib.resources.files("cablecast").joinpath("data/targets_32.csv").read_text()
    rows = csv.DictReader(text.splitlines())
    return np.array([[float(row["x_m"]), float(row["y_m"])] for row in rows])
