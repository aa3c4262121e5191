"""Settings of a real camera, the section `camera` of a lab file, and what it cannot see."""

import dataclasses
import os
import pathlib
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.camera.lens import VIEW_BOUNDS_DEG, Lens
from cablecast.camera.tags import FAMILY, EndTag, TagLayout, tag_family
from cablecast.errors import InputError, check_count, check_keys, check_number, check_ranges

CLOCKS = ("device", "arrival")
"""Sources of frame times: the stamps of camera or stream, or the time at which frames arrive."""
SIDES = "right", "left"
"""Sides of the robot, as it looks ahead, on which a camera of swings may stand."""

MARKER_HUE = 122.0
"""Hue of green tape on a white table [deg]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """Settings of the camera above the table, or beside the plane of swings in the air.

    Attributes:
        source: Number of a device (0 is /dev/video0), path of a device or of a video file, or
            address of a network stream. There is no default.
        width: Width of the images that are asked for [px].
        height: Height of the images that are asked for [px].
        rate: Frames per second that are asked for [1/s].
        fourcc: Pixel format that is asked for, four letters; MJPG is what most USB cameras need for
            1080p at 60 frames/s.
        exposure: Time during which a frame is exposed [s]. It is set on a device, and stated for a
            stream, whose camera is set by its own means.
        focus: Focus of the lens in the units of its driver; unchanged if None. Autofocus is
            switched off in either case.
        clock: Source of frame times, one of `CLOCKS`.
        clock_offset: Time of the robot's clock when the camera's shows zero [s], from
            `cablecast camera sync`.
        clock_offset_sd: Standard deviation of that offset [s]; None before it was measured.
        row_time: Time by which each row is exposed later than the one above it [s]; 0 for a global
            shutter. A rolling shutter of 1080 rows that is read in 1/60 s has 1.5e-5 s.
        view_deg: Angle of view over the image's diagonal [deg], where no lens is given.
        lens: Lens, from `cablecast calibrate lens`; found from the tags if None.
        tags: Tags on the table; `default_layout` if None. On a wall behind the plane of swings, x
            is the distance ahead of the base's axis and y the height in the base frame.
        tag_family: Family of these tags, a key of `cablecast.camera.tags.TAG_COUNTS`; that of the
            layout where it names one.
        end_tag: Tag on the cable's free end, which is followed in place of the marker.
        marker: Length and width of the marker along and across the cable [m].
        marker_hue: Hue of the marker on a table that counts as grey; 120 is green [deg].
        films: Folder that keeps the film of each trial; none are kept if None.
        wall: Distance of that wall from the plane of swings [m]; None above a table.
        side: Side of the robot on which a camera of swings stands, one of `SIDES`.
    """

    source: str
    width: int = 1920
    height: int = 1080
    rate: float = 60.0
    fourcc: str = "MJPG"
    exposure: float = 0.001
    focus: float | None = None
    clock: str = "device"
    clock_offset: float = 0.0
    clock_offset_sd: float | None = None
    row_time: float = 0.0
    view_deg: float = 78.0
    lens: Lens | None = None
    tags: TagLayout | None = None
    tag_family: str = FAMILY
    end_tag: EndTag | None = None
    marker: tuple[float, float] = (0.038, 0.016)
    marker_hue: float = MARKER_HUE
    films: str | None = None
    wall: float | None = None
    side: str | None = None

    def __post_init__(self):
        if not isinstance(self.source, str) or not self.source.strip():
            raise InputError(
                f"camera source = {self.source!r} must be the number of a device, a path, or the "
                "address of a stream"
            )
        for name in ("width", "height"):
            check_count(f"camera {name}", getattr(self, name), 64, 16384)
        if not (isinstance(self.fourcc, str) and re.fullmatch(r"[ -~]{4}", self.fourcc)):
            raise InputError(f"camera fourcc = {self.fourcc!r} must be four letters, such as MJPG")
        if self.clock not in CLOCKS:
            raise InputError(f"camera clock = {self.clock!r} must be one of {', '.join(CLOCKS)}")
        check_ranges(
            self,
            {
                "rate": (1.0, 1000.0, "1/s"),
                "exposure": (1e-5, 0.1, "s"),
                "clock_offset": (-1e12, 1e12, "s"),
                "row_time": (0.0, 1e-3, "s"),
                "view_deg": (*VIEW_BOUNDS_DEG, "deg"),
                "marker_hue": (0.0, 360.0, "deg"),
            },
            "camera",
        )
        if self.focus is not None:
            check_number("camera focus", self.focus, 0.0, 1e6)
        if self.clock_offset_sd is not None:
            check_number("camera clock_offset_sd", self.clock_offset_sd, 0.0, 10.0, "s")
        if self.exposure * self.rate > 1.0:
            raise InputError(
                f"camera exposure = {self.exposure:g} s is longer than a frame at "
                f"{self.rate:g} frames/s"
            )
        lens = self.lens
        if lens is not None and (lens.width, lens.height) != (self.width, self.height):
            raise InputError(
                f"camera lens was calibrated for {lens.width} x {lens.height} px, but the camera "
                f"is asked for {self.width} x {self.height}"
            )
        family = self.tag_family if self.tags is None else self.tags.family
        object.__setattr__(self, "tag_family", tag_family(family))
        if (end := self.end_tag) is not None:
            # Dictionaries of one size begin alike: 4X4_50 and 4X4_100 have the same first tags.
            kin = {re.sub(r"_\d+$", "", name) for name in (end.family, self.tag_family)}
            if len(kin) == 1 and (self.tags is None or end.id in self.tags.corners):
                other = "take another number" if self.tags else "list the tags on the table as tags"
                raise InputError(
                    f"camera end_tag {end.id} of {end.family} may be mixed up with a tag on the "
                    f"table: {other}, or take another family"
                )
        if not isinstance(self.marker, (list, tuple)) or len(self.marker) != 2:
            raise InputError(f"camera marker = {self.marker!r} must be a length and a width")
        for value in self.marker:
            check_number("camera marker", value, 0.002, 0.5, "m")
        object.__setattr__(self, "marker", tuple(self.marker))
        self._check_wall()
        if self.films is not None and not (isinstance(self.films, str) and self.films.strip()):
            raise InputError(
                f"camera films = {str(self.films)[:60]!r} must be the path of a folder"
            )

    def _check_wall(self) -> None:
        """Refuse a wall without what else a camera of swings needs."""
        if (self.wall is None) != (self.side is None):
            raise InputError("camera wall and side belong together: both are of swings in the air")
        if self.wall is None:
            return
        check_number("camera wall", self.wall, 0.0, 10.0, "m")
        if self.side not in SIDES:
            raise InputError(f"camera side = {self.side!r} must be one of {', '.join(SIDES)}")
        if self.tags is None:
            raise InputError("camera tags: list the tags on the wall behind the plane of swings")
        if self.end_tag is not None:
            raise InputError("camera end_tag: a swung tag turns away, so wrap a marker instead")

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, which `from_dict` reads."""
        values = {
            **vars(self),
            "marker": list(self.marker),
            "lens": self.lens and self.lens.to_dict(),
            "end_tag": self.end_tag and dataclasses.asdict(self.end_tag),
            "tags": self.tags and self.tags.to_dict()["tags"],
        }
        return {name: value for name, value in values.items() if value is not None}

    @classmethod
    def from_dict(
        cls, values: Mapping[str, Any], folder: str | os.PathLike[str] | None = None
    ) -> "CameraSettings":
        """Make settings from plain values; missing keys but `source` take their defaults.

        Args:
            values: Settings by name; `tags` may be a list, or the path of a layout's file.
            folder: Folder to which the paths of a layout, of a video and of films are relative.

        Raises:
            InputError: A key is unknown or missing, or a value out of bounds.
        """
        known = {field.name for field in dataclasses.fields(cls)}
        values = check_keys(values, known, "camera", required={"source"})
        base = pathlib.Path(folder or ".")
        source = values["source"]
        if isinstance(source, int) and not isinstance(source, bool):
            values["source"] = str(source)
        elif isinstance(source, str) and "://" not in source and (base / source).is_file():
            values["source"] = str(base / source)
        family = values.get("tag_family", FAMILY)
        if isinstance(values.get("tags"), str):
            values["tags"] = TagLayout.load(base / values["tags"], family)
        elif "tags" in values:
            values["tags"] = TagLayout.from_dict(values["tags"], family)
        if isinstance(values.get("films"), str) and values["films"].strip():
            values["films"] = str((base / values["films"]).resolve())
        if "end_tag" in values:
            known = {field.name for field in dataclasses.fields(EndTag)}
            end = check_keys(values["end_tag"], known, "camera end_tag", required={"id"})
            values["end_tag"] = EndTag(**end)
        if "lens" in values:
            values["lens"] = Lens.from_dict(values["lens"])
        return cls(**values)


BLIND_COUNT_MAX = 100
"""Most blind places of a camera."""
_DISTANCE_MAX = 100.0
_ANGLE_COUNT = 72


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraSight:
    """Place of a camera, and places on the table where it cannot recognise the marker.

    Attributes:
        position: Place of the camera [m], shape [3].
        blind: x, y and radius [m] of circles in which a marker cannot be told from another thing of
            its colour, shape [place, 3].

    Raises:
        InputError: A value is not finite or out of bounds, or the camera is not above the table.
    """

    position: tuple[float, float, float]
    blind: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self):
        position = np.asarray(self.position, dtype=float)
        if position.shape != (3,) or not np.all(np.abs(position) <= _DISTANCE_MAX):
            raise InputError(
                f"camera position {self.position} must be three numbers within {_DISTANCE_MAX:g} m"
            )
        if position[2] <= 0.0:
            raise InputError(f"camera height {position[2]:g} m: it must be above the table")
        if len(self.blind) > BLIND_COUNT_MAX:
            raise InputError(f"{len(self.blind)} blind places: at most {BLIND_COUNT_MAX}")
        for place in self.blind:
            values = np.asarray(place, dtype=float)
            if values.shape != (3,) or not np.all(np.abs(values) <= _DISTANCE_MAX):
                raise InputError(
                    f"blind place {place} must be x, y and a radius within {_DISTANCE_MAX:g} m"
                )
            if values[2] <= 0.0:
                raise InputError(f"radius {values[2]:g} m of a blind place must be above 0")

    def is_blind_at(self, xy: ArrayLike) -> NDArray[np.bool_]:
        """Return at which places [m], shape [..., 2], the marker cannot be recognised, [...]."""
        places = np.asarray(xy, dtype=float)
        blind = np.zeros(places.shape[:-1], dtype=bool)
        for x, y, radius in self.blind:
            blind |= np.hypot(places[..., 0] - x, places[..., 1] - y) < radius
        return blind

    def seen_near(self, xy: ArrayLike, margin: float) -> NDArray[np.float64]:
        """Return the place nearest to xy that keeps a margin from blind ones [m], shape [2]."""
        place, blind = np.asarray(xy, dtype=float), np.reshape(self.blind, (-1, 3))
        turn = np.linspace(0.0, 2.0 * np.pi, _ANGLE_COUNT, endpoint=False)
        ring = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        # Of a circle's edge, the point straight ahead is the nearest one.
        ahead = place - blind[:, :2]
        ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)
        edges = [
            (x, y) + (radius + margin) * np.vstack([to, ring])
            for (x, y, radius), to in zip(blind, ahead, strict=True)
        ]
        points = np.vstack([place, *edges])
        apart = np.linalg.norm(points[:, None] - blind[:, :2], axis=-1) - blind[:, 2]
        free = points[np.all(apart > margin - 1e-9, axis=1)]
        if not len(free):
            return place
        return free[np.argmin(np.linalg.norm(free - place, axis=1))]
