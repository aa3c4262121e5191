"""Fiducial tags on the table: where they lie, and where the robot that touched them stands.

Tags are of one family of AprilTag or ArUco, 36h11 where a layout names none. tools/make_tags.py
writes pictures of those that a layout asks for, to print, and the layout as a file to edit.

The tags' places were measured with a tape; the robot reports where it touched them in its own base
frame, to a fraction of a millimetre. A rigid fit of the one onto the other gives the height and the
yaw of the base, and where its axis meets the table, which is the origin of all frames here.
"""

import dataclasses
import itertools
import math
import pathlib
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from cablecast.conventions import Array
from cablecast.errors import InputError, check_count, check_keys, check_number, check_ranges
from cablecast.files import read_csv, read_yaml, write_text
from cablecast.workspace import Workspace

TAG_COUNTS = {
    **{f"{n}X{n}_{count}": count for n in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    "ARUCO_ORIGINAL": 1024,
    "ARUCO_MIP_36h12": 250,
    "APRILTAG_16h5": 30,
    "APRILTAG_25h9": 35,
    "APRILTAG_36h10": 2320,
    "APRILTAG_36h11": 587,
}
"""Number of tags in each family, by the name of OpenCV's dictionary without its DICT_."""
FAMILY = "APRILTAG_36h11"
"""Family of tags that name none."""
_EDGE_X, _EDGE_Y = 0.105, 0.10
"""Distance of the outer tags' centres from the table's edges along x and y [m]."""
_SPACING = 0.65
"""Typical distance between tags along an edge [m]."""
_ROBOT_RADIUS = 0.3
"""Distance from the base within which the robot stands on the tags [m]."""

TOUCH_COUNT_MIN = 6
"""Fewest tags to touch: three give the pose, three more show which of them lie elsewhere."""
OUTLIER = 0.003
"""Distance beyond which a touched centre and its tag's place do not agree [m]."""
_TILT_MAX_DEG = 2.0
"""Largest tilt between table and base that is a fit and not a mistake [deg]."""
_INLIER_SHARE_MIN = 0.6
_SPREAD_MIN = 0.1
"""Smallest extent of the touched tags across their longest line [m]."""

Point = tuple[float, float, float]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tag:
    """One tag that lies on the table.

    Attributes:
        id: Number of the tag.
        x: Place of its centre [m].
        y: Place of its centre [m].
        yaw: Clockwise turn, seen from above; at zero its upper edge points along y, away from the
            robot [rad].
        size: Length of a side of its black square [m].
    """

    id: int
    x: float
    y: float
    yaw: float = 0.0
    size: float = 0.1

    def __post_init__(self):
        check_count("tag id", self.id, 0, max(TAG_COUNTS.values()) - 1)
        check_ranges(
            self,
            {
                "x": (-10.0, 10.0, "m"),
                "y": (-10.0, 10.0, "m"),
                "yaw": (-2.0 * math.pi, 2.0 * math.pi, "rad"),
                "size": (0.01, 1.0, "m"),
            },
            f"tag {self.id}",
        )

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners of the black square, clockwise from its upper left [m], shape [4, 3]."""
        half = self.size / 2
        local = np.array([[-half, half], [half, half], [half, -half], [-half, -half]])
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        # Clockwise, seen from above with x to the right and y up.
        xy = local @ np.array([[c, -s], [s, c]]) + [self.x, self.y]
        return np.column_stack([xy, np.zeros(4)])


@dataclasses.dataclass(frozen=True, kw_only=True)
class EndTag:
    """A tag that lies flat on the cable's free end.

    Attributes:
        id: Number of the tag.
        size: Length of a side of its black square [m].
        family: Family of the tag; one of few cells is read when it is small.
        height: Height of the tag above the table [m]; the cable's diameter if None.
    """

    id: int
    size: float = 0.03
    family: str = "4X4_50"
    height: float | None = None

    def __post_init__(self):
        object.__setattr__(self, "family", tag_family(self.family))
        check_count("end_tag id", self.id, 0, TAG_COUNTS[self.family] - 1)
        check_number("end_tag size", self.size, 0.005, 0.2, "m")
        check_number("end_tag height", self.height or 0.0, 0.0, 0.5, "m")


@dataclasses.dataclass(frozen=True, kw_only=True)
class TagLayout:
    """All tags on a table.

    Attributes:
        tags: One entry per tag.
        family: Family of the tags, a key of `TAG_COUNTS`.
    """

    tags: tuple[Tag, ...]
    family: str = FAMILY

    def __post_init__(self):
        object.__setattr__(self, "family", tag_family(self.family))
        ids = [tag.id for tag in self.tags]
        for tag_id in ids:
            check_count(f"tag id of {self.family}", tag_id, 0, TAG_COUNTS[self.family] - 1)
        if len(ids) < 4:
            raise InputError(f"a layout needs at least 4 tags, not {len(ids)}")
        if doubled := sorted({i for i in ids if ids.count(i) > 1}):
            raise InputError(f"a layout names tag {doubled[0]} twice")

    @property
    def corners(self) -> dict[int, NDArray[np.float64]]:
        """Corners of each tag by its number [m], shape [4, 3]."""
        return {tag.id: tag.corners for tag in self.tags}

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, which `from_dict` reads."""
        rows = [
            {
                "id": tag.id,
                "x": float(tag.x),
                "y": float(tag.y),
                "yaw_deg": min(max(math.degrees(tag.yaw), -360.0), 360.0),
                "size": float(tag.size),
            }
            for tag in self.tags
        ]
        return {"family": self.family, "tags": rows}

    @classmethod
    def from_dict(cls, values: Any, family: str = FAMILY) -> "TagLayout":
        """Make a layout from plain values: a list of tags, or tags and their family."""
        values = values if isinstance(values, Mapping) else {"tags": values}
        values = check_keys(values, {"family", "tags"}, "a tag layout", required={"tags"})
        if not isinstance(values["tags"], list):
            raise InputError(f"tags must be a list, not {str(values['tags'])[:40]!r}")
        keys, tags = {"id", "x", "y", "yaw_deg", "size"}, []
        for row in values["tags"]:
            row = check_keys(row, keys, "a tag", required={"id", "x", "y"})
            yaw_deg = check_number("yaw_deg", row.pop("yaw_deg", 0.0), -360.0, 360.0, "deg")
            tags.append(Tag(**row, yaw=math.radians(yaw_deg)))
        return cls(tags=tuple(tags), family=values.get("family", family))

    def save(self, path: pathlib.Path) -> None:
        """Write the layout as YAML, for a person to edit."""
        write_text(path, yaml.safe_dump(self.to_dict(), sort_keys=False))

    @classmethod
    def load(cls, path: pathlib.Path, family: str = FAMILY) -> "TagLayout":
        """Read a layout; `family` is that of a file which names none.

        Raises:
            InputError: There is no such file, or it is no layout; says what is wrong with it.
        """
        try:
            return cls.from_dict(read_yaml(path), family)
        except (OSError, InputError) as error:
            where = "" if str(path) in str(error) else f"{path}: "
            raise InputError(f"tag layout {where}{error}") from None


def tag_family(name: Any) -> str:
    """Return the family that a name means: APRILTAG_36h11, tag36h11 and 36h11 are one.

    Raises:
        InputError: There is no such family; names those that there are.
    """
    plain = {re.sub(r"^(apriltag_|aruco_mip_)", "", key.lower()): key for key in TAG_COUNTS}
    wanted = re.sub(r"^(dict_)?(apriltag_?|tag_?|aruco_mip_)?", "", str(name).strip().lower())
    if wanted not in plain:
        raise InputError(f"tag family {str(name)[:40]!r} must be one of {', '.join(TAG_COUNTS)}")
    return plain[wanted]


def default_layout(workspace: Workspace | None = None, family: str = FAMILY) -> TagLayout:
    """Return tags of 10 cm, or less on a small table, along its edges and clear of the robot.

    The paper's table, which is the default, has eleven.
    """
    workspace = workspace or Workspace()
    right = workspace.half_width - _EDGE_X
    near, far = workspace.y_min + _EDGE_Y, workspace.y_max - _EDGE_Y

    def edge(start: float, end: float) -> list[float]:
        count = max(round(abs(end - start) / _SPACING), 1) + 1
        # Whole centimetres are easier to measure.
        return np.round(np.linspace(start, end, count), 2).tolist()

    across, along = edge(-right, right), edge(far, near)
    places = [(x, along[0]) for x in across]
    places += [(x, y) for y in along[1:-1] for x in (across[0], across[-1])]
    places += [(x, along[-1]) for x in across]
    places = [(x, y) for x, y in places if math.hypot(x, y) >= _ROBOT_RADIUS]
    # Smaller on a small table, so that they do not overlap.
    size = min(Tag.size, 0.6 * min(across[1] - across[0], along[0] - along[1]))
    tags = tuple(Tag(id=i, x=x, y=y, size=size) for i, (x, y) in enumerate(places))
    return TagLayout(tags=tags, family=family)


@dataclasses.dataclass(frozen=True, kw_only=True)
class TableFit:
    """Pose of the robot's base at the table.

    Attributes:
        base_height: Height of the base above the table's surface [m].
        base_yaw_deg: Turn of the base about the vertical, positive to the right [deg].
        axis_xy: Point at which the axis of the first joint meets the table, in the frame in which
            the tags were measured [m].
        tilt_deg: Angle between that axis and the table's vertical [deg].
        residuals: Distance between where each tag was touched and where the fit puts it, by its
            number [m]; with the outliers.
        outliers: Numbers of tags that do not agree with the others, and were left out.
        rms: Root mean square of the other residuals [m].
        layout: Tags with the axis as their origin, as the lab file needs them.
    """

    base_height: float
    base_yaw_deg: float
    axis_xy: tuple[float, float]
    tilt_deg: float
    residuals: dict[int, float]
    outliers: tuple[int, ...]
    rms: float
    layout: TagLayout


def read_touches(path: pathlib.Path) -> dict[int, Point]:
    """Return touched points from a CSV file with the columns tag, x_m, y_m, z_m."""
    points: dict[int, Point] = {}
    for number, row in enumerate(read_csv(path, ("tag", "x_m", "y_m", "z_m")), start=2):
        try:
            tag_id = int(row["tag"])
            point = float(row["x_m"]), float(row["y_m"]), float(row["z_m"])
        except ValueError:
            raise InputError(f"line {number} of {path} holds something else than numbers") from None
        if tag_id in points:
            raise InputError(f"line {number} of {path} touches tag {tag_id} again")
        points[tag_id] = point
    return points


def fit_table(layout: TagLayout, touched: Mapping[int, Point]) -> TableFit:
    """Fit the robot's base to touched tags.

    The pose on which most tags agree is found from all sets of three (least median of squares), so
    that tags which lie elsewhere do not pull at it; those that agree are then fitted together.

    Args:
        layout: Tags as they were measured with a tape [m].
        touched: Points in the controller's base frame by the number of the tag [m]. The active tool
            centre point must be the tip that touches.

    Raises:
        InputError: Too few tags, in a line, too many outliers, or a table that is not level.
    """
    known = {tag.id: np.array([tag.x, tag.y, 0.0]) for tag in layout.tags}
    if unknown := sorted(set(touched) - set(known)):
        raise InputError(f"tag {unknown[0]} was touched, but the layout has no such tag")
    ids = sorted(touched)
    if len(ids) < TOUCH_COUNT_MIN:
        raise InputError(f"{len(ids)} tags were touched: at least {TOUCH_COUNT_MIN} are needed")
    places = np.array([known[i] for i in ids])
    points = np.array([touched[i] for i in ids], dtype=float)
    if points.shape != (len(ids), 3) or not np.all(np.isfinite(points)):
        raise InputError("each touched point must be three finite numbers")
    _check_spread(places)
    residuals = _consensus(points, places)
    agree = residuals <= OUTLIER
    outliers = tuple(i for i, ok in zip(ids, agree, strict=True) if not ok)
    if agree.sum() < max(_INLIER_SHARE_MIN * len(ids), 4):
        raise InputError(
            f"the touched tags do not agree: {len(outliers)} of {len(ids)} are more than "
            f"{1e3 * OUTLIER:g} mm off the others. Is the tool centre point that of the tip, and "
            "were the tags measured from the robot's axis?"
        )
    _check_spread(places[agree])
    R, t = rigid_fit(points[agree], places[agree])
    residuals = np.linalg.norm(points @ R.T + t - places, axis=1)
    axis = R[:, 2]
    tilt_deg = float(np.degrees(np.arccos(np.clip(axis[2], -1.0, 1.0))))
    if tilt_deg > _TILT_MAX_DEG:
        raise InputError(
            f"the table would be tilted by {tilt_deg:.1f} deg against the base, above "
            f"{_TILT_MAX_DEG:g} deg: was the tip on the table each time, and is the base upright?"
        )
    x, y, _ = t - axis * t[2] / axis[2]
    moved = tuple(dataclasses.replace(tag, x=tag.x - x, y=tag.y - y) for tag in layout.tags)
    return TableFit(
        base_height=float(t[2]),
        # The first row of the base's rotation is (-sin yaw, cos yaw, 0).
        base_yaw_deg=float(np.degrees(np.arctan2(-R[0, 0], R[0, 1]))),
        axis_xy=(float(x), float(y)),
        tilt_deg=tilt_deg,
        residuals=dict(zip(ids, residuals.tolist(), strict=True)),
        outliers=outliers,
        rms=float(np.sqrt(np.mean(residuals[agree] ** 2))),
        layout=dataclasses.replace(layout, tags=moved),
    )


def _check_spread(places: Array) -> None:
    """Refuse tags that lie in a line, about which the table could turn."""
    across = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)[1] / np.sqrt(len(places))
    if across < _SPREAD_MIN:
        raise InputError(
            f"the touched tags lie in a line to {across:.3f} m: touch some on both sides of it"
        )


def _consensus(points: Array, places: Array) -> Array:
    """Return the residuals of the pose on which most points agree [m], shape [point]."""

    def residuals_by(used: Any) -> Array:
        R, t = rigid_fit(points[used], places[used])
        return np.linalg.norm(points @ R.T + t - places, axis=1)

    threes = itertools.combinations(range(len(points)), 3)
    best = min((residuals_by(list(three)) for three in threes), key=np.median)
    # Three points alone are as inexact as a touch; those about the median give a better pose.
    return residuals_by(best <= max(OUTLIER, 2.5 * float(np.median(best))))


def rigid_fit(points: Array, places: Array) -> tuple[Array, Array]:
    """Return the rotation and translation that bring points nearest to places (Kabsch, 1976)."""
    middle, centre = points.mean(axis=0), places.mean(axis=0)
    U, _, Vt = np.linalg.svd((points - middle).T @ (places - centre))
    sign = np.sign(np.linalg.det(Vt.T @ U.T)) or 1.0
    R = Vt.T @ np.diag([1.0, 1.0, sign]) @ U.T
    return R, centre - R @ middle
