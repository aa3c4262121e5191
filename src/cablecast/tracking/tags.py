"""Fiducial tags on the table: where they lie, and where an image shows them.

Tags are AprilTags of the family 36h11. `python -m cablecast.tracking.tags` writes pictures of
those that a layout asks for, to print, and the layout as a file to edit.
"""

import dataclasses
import pathlib
from collections.abc import Mapping

import numpy as np
import yaml
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.files import write_bytes, write_text
from cablecast.tracking.opencv import load_cv2

TAG_COUNT_MAX = 587
"""Number of tags in the family."""
_PRINT_CELL = 40
"""Size of one of the ten cells of a printed tag with its white rim [px]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tag:
    """One tag that lies on the table.

    Attributes:
        id: Number of the tag.
        x: Its centre [m].
        y: Its centre [m].
        yaw: How far it is turned clockwise, seen from above; at zero its upper edge points along y,
            away from the robot [rad].
        size: Length of a side of its black square [m].
    """

    id: int
    x: float
    y: float
    yaw: float = 0.0
    size: float = 0.1

    def __post_init__(self):
        if not (isinstance(self.id, int) and 0 <= self.id < TAG_COUNT_MAX):
            raise InputError(f"tag id = {self.id!r} is outside [0, {TAG_COUNT_MAX - 1}]")
        for name, low, high in (
            ("x", -10.0, 10.0),
            ("y", -10.0, 10.0),
            ("yaw", -10.0, 10.0),
            ("size", 0.01, 1.0),
        ):
            value = getattr(self, name)
            if not isinstance(value, (int, float)) or not low <= value <= high:
                raise InputError(f"tag {self.id}: {name} = {value!r} is outside [{low}, {high}]")

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
        """Corners of a tag [m], shape [4, 3]; None if the layout has no such tag."""
        for tag in self.tags:
            if tag.id == tag_id:
                return tag.corners
        return None

    def save(self, path: pathlib.Path) -> None:
        """Write the layout as YAML."""
        rows = [
            {
                "id": tag.id,
                "x": float(tag.x),
                "y": float(tag.y),
                "yaw_deg": float(np.degrees(tag.yaw)),
                "size": float(tag.size),
            }
            for tag in self.tags
        ]
        write_text(path, yaml.safe_dump({"tags": rows}, sort_keys=False))

    @classmethod
    def load(cls, path: pathlib.Path) -> "TagLayout":
        """Read a layout.

        Raises:
            InputError: There is no such file, or it is no layout; says what is wrong with it.
        """
        try:
            values = yaml.safe_load(path.read_text())
        except (OSError, yaml.YAMLError, UnicodeDecodeError) as error:
            raise InputError(
                f"tag layout {path} cannot be read: {str(error).splitlines()[0]}"
            ) from None
        rows = values.get("tags") if isinstance(values, Mapping) else None
        if not isinstance(rows, list):
            raise InputError(f"tag layout {path} must hold a list named `tags`")
        known = {"id", "x", "y", "yaw_deg", "size"}
        tags = []
        for row in rows:
            if not isinstance(row, Mapping) or not {"id", "x", "y"} <= set(row) <= known:
                raise InputError(
                    f"tag layout {path}: {row!r} must give id, x, y and may give yaw_deg, size"
                )
            row = dict(row)
            yaw_deg = row.pop("yaw_deg", 0.0)
            if not isinstance(yaw_deg, (int, float)):
                raise InputError(f"tag layout {path}: yaw_deg = {yaw_deg!r} is not a number")
            tags.append(Tag(**row, yaw=float(np.radians(yaw_deg))))
        return cls(tags=tuple(tags))


def default_layout() -> TagLayout:
    """Eleven tags of 10 cm along the edges of the paper's table, clear of the robot."""
    places = [(x, 1.40) for x in (-1.27, -0.64, 0.0, 0.64, 1.27)]
    places += [(-1.27, 0.75), (1.27, 0.75)]
    places += [(x, 0.10) for x in (-1.27, -0.64, 0.64, 1.27)]
    return TagLayout(tags=tuple(Tag(id=i, x=x, y=y) for i, (x, y) in enumerate(places)))


def tag_picture(tag_id: int, cell: int = _PRINT_CELL) -> NDArray[np.uint8]:
    """A tag with its white rim: ten by ten cells, of which eight are the black square.

    Args:
        tag_id: Number of the tag.
        cell: Size of a cell [px].
    """
    cv2 = load_cv2()
    square = cv2.aruco.generateImageMarker(_dictionary(), tag_id, 8 * cell)
    return np.pad(square, cell, constant_values=255)


def detect_tags(image: NDArray[np.uint8]) -> dict[int, NDArray[np.float64]]:
    """Find tags in an image.

    Args:
        image: Grey or BGR.

    Returns:
        For each tag its corners, clockwise from its upper left [px], shape [4, 2].
    """
    cv2 = load_cv2()
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.cornerRefinementWinSize = 4
    parameters.cornerRefinementMaxIterations = 60
    parameters.cornerRefinementMinAccuracy = 0.005
    detector = cv2.aruco.ArucoDetector(_dictionary(), parameters)
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    corners, ids, _ = detector.detectMarkers(grey)
    if ids is None:
        return {}
    found: dict[int, NDArray[np.float64]] = {}
    doubled = set()
    for tag_id, quad in zip(ids.ravel().tolist(), corners, strict=True):
        if tag_id in found:
            doubled.add(tag_id)
        found[tag_id] = quad.reshape(4, 2).astype(np.float64)
    # A tag that is seen twice is not at one known place.
    return {tag_id: quad for tag_id, quad in found.items() if tag_id not in doubled}


def _dictionary():
    cv2 = load_cv2()
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


def main() -> None:
    """Write the tags of the default layout to print, and the layout to edit."""
    import argparse

    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=pathlib.Path, help="folder to write to")
    out = parser.parse_args().out
    cv2 = load_cv2()
    layout = default_layout()
    for tag in layout.tags:
        encoded = cv2.imencode(".png", tag_picture(tag.id))[1]
        write_bytes(out / f"tag-{tag.id:02}.png", encoded.tobytes())
    layout.save(out / "tags.yaml")
    print(f"{len(layout.tags)} tags and tags.yaml are in {out}: print them so that the black")
    print(f"square measures {100 * layout.tags[0].size:g} cm, and put your own places in tags.yaml")


if __name__ == "__main__":
    main()
