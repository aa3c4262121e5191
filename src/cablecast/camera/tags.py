"""Fiducial tags on the table: where they lie.

Tags are AprilTags of the family 36h11. tools/make_tags.py writes pictures of those that a layout
asks for, to print, and the layout as a file to edit.
"""

import dataclasses
import math
import pathlib
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from cablecast.checks import check_count, check_keys, check_number, check_ranges
from cablecast.errors import InputError
from cablecast.files import write_text
from cablecast.reading import read_yaml
from cablecast.workspace import Workspace

TAG_COUNT_MAX = 587
"""Number of tags in the family."""
_EDGE_X, _EDGE_Y = 0.105, 0.10
"""Distance of the outer tags' centres from the table's edges along x and y [m]."""
_SPACING = 0.65
"""Usual distance between tags along an edge [m]."""
_SIZE = 0.1
"""Usual side of a tag's black square [m]."""
_ROBOT_RADIUS = 0.3
"""Distance from the base within which the robot stands on the tags [m]."""


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
        check_count("tag id", self.id, 0, TAG_COUNT_MAX - 1)
        check_ranges(
            self,
            {
                "x": (-10.0, 10.0, "m"),
                "y": (-10.0, 10.0, "m"),
                "yaw": (-10.0, 10.0, "rad"),
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
class TagLayout:
    """All tags on a table.

    Attributes:
        tags: One entry per tag.
    """

    tags: tuple[Tag, ...]

    def __post_init__(self):
        ids = [tag.id for tag in self.tags]
        if len(ids) < 4:
            raise InputError(f"a layout needs at least 4 tags, not {len(ids)}")
        if doubled := sorted({i for i in ids if ids.count(i) > 1}):
            raise InputError(f"a layout names tag {doubled[0]} twice")

    def corners_of(self, tag_id: int) -> NDArray[np.float64] | None:
        """Return the corners of a tag [m], shape [4, 3]; None if the layout has no such tag."""
        for tag in self.tags:
            if tag.id == tag_id:
                return tag.corners
        return None

    def to_rows(self) -> list[dict[str, Any]]:
        """Return plain values, which `from_rows` reads."""
        return [
            {
                "id": tag.id,
                "x": float(tag.x),
                "y": float(tag.y),
                "yaw_deg": math.degrees(tag.yaw),
                "size": float(tag.size),
            }
            for tag in self.tags
        ]

    @classmethod
    def from_rows(cls, rows: Any) -> "TagLayout":
        """Make a layout from plain values.

        Raises:
            InputError: The rows describe no layout.
        """
        if not isinstance(rows, list):
            raise InputError(f"tags must be a list, not {str(rows)[:40]!r}")
        return cls(tags=tuple(_tag_from_row(row) for row in rows))

    def save(self, path: pathlib.Path) -> None:
        """Write the layout as YAML, for a person to edit."""
        write_text(path, yaml.safe_dump({"tags": self.to_rows()}, sort_keys=False))

    @classmethod
    def load(cls, path: pathlib.Path) -> "TagLayout":
        """Read a layout.

        Raises:
            InputError: There is no such file, or it is no layout; says what is wrong with it.
        """
        try:
            values = read_yaml(path)
        except (OSError, InputError) as error:
            text = str(error)
            where = "" if str(path) in text else f"{path}: "
            raise InputError(f"tag layout {where}{text}") from None
        rows = values.get("tags")
        if not isinstance(rows, list):
            raise InputError(f"tag layout {path} must hold a list named `tags`")
        try:
            return cls.from_rows(rows)
        except InputError as error:
            raise InputError(f"tag layout {path}: {error}") from None


def _tag_from_row(row: Any) -> Tag:
    """Return the tag that one entry of a layout's file describes."""
    row = check_keys(row, {"id", "x", "y", "yaw_deg", "size"}, "a tag", required={"id", "x", "y"})
    yaw_deg = check_number("yaw_deg", row.pop("yaw_deg", 0.0), -360.0, 360.0, "deg")
    return Tag(**row, yaw=math.radians(yaw_deg))


def default_layout(workspace: Workspace | None = None) -> TagLayout:
    """Return tags of 10 cm, or less on a small table, along its edges and clear of the robot.

    Args:
        workspace: Gives the table's size and place; the paper's table, which has eleven tags, where
            None.
    """
    workspace = workspace or Workspace()
    right = workspace.half_width - _EDGE_X
    near, far = workspace.y_min + _EDGE_Y, workspace.y_max - _EDGE_Y
    # Whole centimetres are easier to measure.
    across = np.round(np.linspace(-right, right, _edge_count(2 * right)), 2).tolist()
    along = np.round(np.linspace(far, near, _edge_count(far - near)), 2).tolist()
    places = [(x, along[0]) for x in across]
    places += [(x, y) for y in along[1:-1] for x in (across[0], across[-1])]
    places += [(x, along[-1]) for x in across]
    places = [(x, y) for x, y in places if math.hypot(x, y) >= _ROBOT_RADIUS]
    # Smaller on a small table, so that they do not overlap.
    size = min(_SIZE, 0.6 * min(across[1] - across[0], along[0] - along[1]))
    return TagLayout(tags=tuple(Tag(id=i, x=x, y=y, size=size) for i, (x, y) in enumerate(places)))


def _edge_count(length: float) -> int:
    """Return the number of tags along an edge, at least one at each end."""
    return max(round(length / _SPACING), 1) + 1
