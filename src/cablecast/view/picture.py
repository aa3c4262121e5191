"""Pictures of the table without a display: a pinhole camera and a painter, in pure Pillow.

Far things are painted first. That is exact enough for an arm above a table with a cable on it, and
needs no graphics driver.
"""

import dataclasses
import functools
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import MissingExtraError
from cablecast.setup import Setup
from cablecast.view.palette import DARK, INK, LIGHT, PURPLE, VERMILLION, Color
from cablecast.view.shapes import (
    CABLE_RADIUS_MIN,
    arm_rods,
    circle,
    level,
    reach_arc,
    table_lines,
    viewpoint,
)
from cablecast.view.shown import ShownCast

if TYPE_CHECKING:
    from PIL import Image

Array = NDArray[np.float64]

_SAMPLES = 2  # Pixels are painted this much finer along each side, then averaged.
_SHADOW = 60  # Darkness of shadows, of 255.
_SHADOW_SLOPE = np.array([0.12, 0.05, -1.0])  # Shift per height of what casts a shadow.
_NEAR = 0.05  # Nothing nearer to the camera is drawn [m].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Camera:
    """Pinhole camera.

    Attributes:
        position: Place [m], shape [3].
        look_at: Point in the middle of the picture [m], shape [3].
        fov: Vertical field of view [rad].
        width: Width of the picture [pixel].
        height: Height of the picture [pixel].
    """

    position: Array
    look_at: Array
    fov: float
    width: int
    height: int

    @property
    def focal_length(self) -> float:
        """Focal length [pixel]."""
        return self.height / 2 / float(np.tan(self.fov / 2))

    def project(self, points: Array) -> tuple[Array, Array]:
        """Return where points are seen.

        Args:
            points: Points [m], shape [..., 3].

        Returns:
            Columns and rows [pixel], shape [..., 2], and depths [m], shape [...].
        """
        offset = np.asarray(points, dtype=float) - self.position
        right, down, forward = self._axes
        depth = np.maximum(offset @ forward, _NEAR)
        scale = self.focal_length / depth
        column = self.width / 2 + scale * (offset @ right)
        row = self.height / 2 + scale * (offset @ down)
        return np.stack([column, row], axis=-1), depth

    @functools.cached_property
    def _axes(self) -> tuple[Array, Array, Array]:
        forward = self.look_at - self.position
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right = right / np.linalg.norm(right)
        return right, np.cross(forward, right), forward


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """One cast to be filmed.

    Attributes:
        cast: Cast in blue, solid.
        other: Second cast in purple, thin, e.g. what was expected; none where None.
        target_xy: Target [m], shape [2]; none where None.
        caption: Line below the picture while the cast plays.
        result: Line below the picture once the cable rests.
    """

    cast: ShownCast
    other: ShownCast | None = None
    target_xy: Array | None = None
    caption: str = ""
    result: str = ""


class Painter:
    """Paints frames of casts at one table.

    Args:
        setup: Set-up with table, arm and cable.
        width: Width of the pictures [pixel].
        height: Height of the pictures [pixel].
        dark: True for dark colours.

    Raises:
        MissingExtraError: Pillow is not installed.
    """

    def __init__(self, setup: Setup, width: int, height: int, *, dark: bool = False):
        self._image, self._draw, self._font, self._chops = _pillow()
        self.setup = setup
        self.size = (width, height)
        position, look_at, fov = viewpoint(setup)
        self._camera = Camera(
            position=position,
            look_at=look_at,
            fov=fov,
            width=_SAMPLES * width,
            height=_SAMPLES * height,
        )
        self._paint = DARK if dark else LIGHT
        self._backdrop = self._painted_backdrop()

    def frame(self, shot: Shot, time: float, tries: list[Shot] | None = None) -> "Image.Image":
        """Return the picture of a cast at a time.

        Args:
            shot: Cast.
            time: Time [s]; beyond the end of the cast the cable rests.
            tries: Earlier casts, whose landings are marked.
        """
        image = self._backdrop.copy()
        pen = self._draw.Draw(image, "RGBA")
        if shot.target_xy is not None:
            self._mark_target(pen, shot.target_xy)
        for earlier in tries or []:
            self._dot(pen, np.append(earlier.cast.endpoint_xy[-1], 0.01), 0.012, (123, 135, 148))
        self._trail(pen, shot.cast.trail(time), self._paint.cable)
        nodes, q = shot.cast.nodes_at(time), shot.cast.joints_at(time)
        self._cast_shadow(image, nodes, q)
        if shot.other is not None:
            ghost = shot.other.nodes_at(time)
            if ghost is not None:
                self._cable(pen, ghost, PURPLE, 0.6)
        if nodes is not None:
            self._cable(pen, nodes, self._paint.cable, 1.0)
        tip = nodes[-1] if nodes is not None else np.append(shot.cast.endpoint_at(time), 0.01)
        if np.all(np.isfinite(tip)):
            self._dot(pen, tip, 0.016, self._paint.cable)
        if q is not None:
            self._arm(pen, q)
        if time >= shot.cast.duration:
            self._mark_miss(pen, shot)
        self._write(pen, shot.result if time >= shot.cast.duration else shot.caption)
        return image.resize(self.size, self._image.Resampling.BOX)

    def _painted_backdrop(self) -> "Image.Image":
        paint, table = self._paint, self.setup.workspace
        image = self._image.new("RGB", (self._camera.width, self._camera.height), paint.page)
        pen = self._draw.Draw(image, "RGBA")
        x, y0 = table.half_width, table.y_min
        top = self._table_top()
        front = np.array([[-x, y0, 0.0], [x, y0, 0.0], [x, y0, -0.04], [-x, y0, -0.04]])
        self._polygon(pen, front, paint.side)
        self._polygon(pen, top, paint.table)
        for line in table_lines(self.setup, 0.25, 0.0):
            self._line(pen, line, paint.line, 0.5)
        for segment in reach_arc(self.setup, 0.0):
            self._line(pen, segment, paint.joint, 1.0)
        return image

    def _table_top(self) -> Array:
        table = self.setup.workspace
        x, y0, y1 = table.half_width, table.y_min, table.y_max
        return np.array([[-x, y0, 0.0], [x, y0, 0.0], [x, y1, 0.0], [-x, y1, 0.0]])

    def _arm(self, pen: Any, q: Array) -> None:
        rods = arm_rods(q, self.setup.arm)
        starts, ends = self._camera.project(rods.starts), self._camera.project(rods.ends)
        order = np.argsort(-(starts[1] + ends[1]))
        for rod in order:
            segment = np.stack([rods.starts[rod], rods.ends[rod]])
            radius = float(rods.radii[rod])
            # From the rim to the light: a rod looks round.
            for share, light in ((1.0, 0.62), (0.86, 0.82), (0.6, 0.95), (0.3, 1.04)):
                color = tuple(min(255, round(light * value)) for value in self._paint.arm)
                self._capsule(pen, segment, share * radius, (*color, 255))
            for end in segment:
                for share, light in ((0.8, 0.8), (0.5, 1.0)):
                    color = tuple(min(255, round(light * value)) for value in self._paint.joint)
                    if radius > 0.03:
                        self._disc(pen, end, share * radius, (*color, 255))

    def _cable(self, pen: Any, nodes: Array, color: Color, share: float) -> None:
        radius = share * max(self.setup.cable.radius, CABLE_RADIUS_MIN)
        dark = tuple(round(0.65 * value) for value in color)
        for scale, paint in ((1.0, dark), (0.6, color)):
            for segment in np.stack([nodes[:-1], nodes[1:]], axis=1):
                self._capsule(pen, segment, scale * radius, (*paint, round(255 * share)))

    def _cast_shadow(self, image: "Image.Image", nodes: Array | None, q: Array | None) -> None:
        """Darken the table below the arm and the cable, once where shadows overlap."""
        mask = self._image.new("L", image.size, 0)
        pen = self._draw.Draw(mask)
        parts: list[tuple[Array, float]] = []
        if q is not None:
            rods = arm_rods(q, self.setup.arm)
            ends = np.stack([rods.starts, rods.ends], axis=1)
            parts += list(zip(ends, rods.radii.tolist(), strict=True))
        if nodes is not None:
            parts += [(pair, CABLE_RADIUS_MIN) for pair in np.stack([nodes[:-1], nodes[1:]], 1)]
        for segment, radius in parts:
            # A lamp high to the left: shadows fall to the right by a share of the height.
            ground = segment + segment[:, 2:] * _SHADOW_SLOPE
            self._capsule(pen, ground, float(radius), _SHADOW)
        table = self._image.new("L", image.size, 0)
        self._polygon(self._draw.Draw(table), self._table_top(), _SHADOW)
        image.paste((20, 18, 16), mask=self._chops.darker(mask, table))

    def _trail(self, pen: Any, points: Array, color: Color) -> None:
        if len(points) > 1:
            path, _ = self._camera.project(level(points, 0.002))
            pen.line([tuple(p) for p in path], fill=(*color, 110), width=round(1.2 * _SAMPLES))

    def _mark_target(self, pen: Any, xy: Array) -> None:
        for radius in (0.02, 0.045):
            for segment in circle(xy, radius, 0.0):
                self._line(pen, segment, VERMILLION, 1.6)
        for offset in ([0.065, 0.0], [0.0, 0.065]):
            ends = level(np.stack([xy - offset, xy + np.array(offset)]), 0.0)
            self._line(pen, ends, VERMILLION, 1.6)

    def _mark_miss(self, pen: Any, shot: Shot) -> None:
        landed = shot.cast.endpoint_xy[-1]
        if shot.target_xy is None or not np.all(np.isfinite(landed)):
            return
        ends = level(np.stack([shot.target_xy, landed]), 0.004)
        self._line(pen, ends, INK if self._paint is LIGHT else (240, 240, 240), 1.6)
        self._dot(pen, np.append(landed, 0.01), 0.016, INK)

    def _write(self, pen: Any, text: str) -> None:
        if text:
            place = (self._camera.width / 2, self._camera.height * 0.94)
            font = self._font.load_default(size=_SAMPLES * max(12, self.size[1] // 30))
            pen.text(place, text, fill=self._paint.text, font=font, anchor="mm")

    def _dot(self, pen: Any, point: Array, radius: float, color: Color) -> None:
        self._disc(pen, point, radius, (*(round(0.6 * value) for value in color), 255))
        self._disc(pen, point, 0.7 * radius, (*color, 255))

    def _disc(self, pen: Any, point: Array, radius: float, fill: tuple[int, ...]) -> None:
        (x, y), depth = self._camera.project(point)
        size = self._camera.focal_length * radius / float(depth)
        pen.ellipse([x - size, y - size, x + size, y + size], fill=fill)

    def _capsule(self, pen: Any, segment: Array, radius: float, fill: Any) -> None:
        path, depths = self._camera.project(segment)
        sizes = self._camera.focal_length * radius / depths
        pen.line([tuple(p) for p in path], fill=fill, width=max(1, round(2 * float(sizes.mean()))))
        if isinstance(fill, int) or fill[3] == 255:
            for (x, y), size in zip(path, sizes, strict=True):
                pen.ellipse([x - size, y - size, x + size, y + size], fill=fill)

    def _line(self, pen: Any, segment: Array, color: Color, width: float) -> None:
        path, _ = self._camera.project(segment)
        pen.line([tuple(p) for p in path], fill=color, width=max(1, round(width * _SAMPLES)))

    def _polygon(self, pen: Any, points: Array, color: Any) -> None:
        path, _ = self._camera.project(points)
        pen.polygon([tuple(p) for p in path], fill=color)


def _pillow() -> tuple[Any, Any, Any, Any]:
    try:
        from PIL import Image, ImageChops, ImageDraw, ImageFont
    except ImportError:
        raise MissingExtraError("Pillow", "view", "films") from None
    return Image, ImageDraw, ImageFont, ImageChops
