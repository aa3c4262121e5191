"""Films of casts: one HTML file to turn and zoom, an MP4 or a GIF; no display is needed.

The pictures of MP4 and GIF are painted by Pillow, far things first. That is exact enough for an arm
above a table with a cable on it, and needs no graphics driver.
"""

import dataclasses
import io
import pathlib
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from cablecast.camera.lens import CameraView, Lens
from cablecast.errors import InputError, MissingExtraError, check_count, check_number
from cablecast.files import write_bytes, write_text
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.setup import Setup
from cablecast.view.look import Shot
from cablecast.view.scene import Figure, TargetScene, start_server, stop_server
from cablecast.view.shapes import (
    ARM,
    BLUE,
    CABLE_RADIUS_MIN,
    GREY,
    INK,
    JOINT,
    PURPLE,
    SKY,
    TABLE,
    TABLE_LINE,
    TABLE_SIDE,
    VERMILLION,
    WHITE,
    Array,
    Color,
    Rods,
    arm_rods,
    level,
    polyline,
    reach_arc,
    table_lines,
    target_marks,
    viewpoint,
)
from cablecast.vision.video import write_video

try:
    from PIL import Image, ImageChops, ImageDraw, ImageFont
except ImportError:
    raise MissingExtraError("Pillow", "view", "films") from None

KINDS = (".html", ".mp4", ".gif")

REST = 1.2
"""Time that a cable at rest is shown before the next cast [s]."""

SAMPLES = 2
"""Pixels are painted this much finer along each side, then averaged."""

_GIF_COLORS = 96
_GIF_RATE_MAX = 50  # Browsers show a shorter frame of a GIF for a tenth of a second.
_SWATCH = 20  # Height of the colours that the palette must hold [pixel].
_SIZE_MAX = 3840
CAST_COUNT_MAX = 200
_JOINT_RADIUS_MIN = 0.03  # Joints of thinner rods, those of the fingers, are not marked [m].
_SHADOW = 60  # Darkness of shadows, of 255.
_SHADOW_SLOPE = np.array([0.12, 0.05, -1.0])  # Shift per height of what casts a shadow.


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilmConfig:
    """Size [pixel], in even numbers, and speed of a film; a speed of 0.5 is slow motion."""

    width: int = 960
    height: int = 540
    frames_per_second: int = 25
    speed: float = 1.0

    def __post_init__(self):
        for name in ("width", "height"):
            if check_count(name, getattr(self, name), 64, _SIZE_MAX) % 2:
                raise InputError(f"{name} = {getattr(self, name)} must be even: films have no odd")
        check_count("frames_per_second", self.frames_per_second, 1, 60)
        check_number("speed", self.speed, 0.01, 10.0)


def write_film(
    path: pathlib.Path,
    setup: Setup,
    shots: Sequence[Shot],
    config: FilmConfig,
    progress: ProgressCallback = ignore,
) -> None:
    """Write casts, one after another, as one file, whose ending says the kind.

    Raises:
        InputError: The ending is unknown, or there is nothing to film.
        MissingExtraError: A library of the film is not installed.
    """
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise InputError(f"{path} ends in {kind!r}: a film ends in one of {', '.join(KINDS)}")
    check_count("casts to film", len(shots), 1, CAST_COUNT_MAX)
    if kind == ".html":
        write_text(path, film_html(setup, shots, config, progress))
    else:
        painter = Painter(setup, config.width, config.height)
        shown = instants([shot.cast.duration for shot in shots], config, progress)
        frames = (painter.frame(shots[n], time, _tries_before(shots, n)) for n, time in shown)
        write_frames(path, frames, config)


def write_frames(path: pathlib.Path, frames: Iterator[Image.Image], config: FilmConfig) -> None:
    """Write pictures as a GIF or an MP4, by the ending of the path."""
    if path.suffix.lower() == ".gif":
        check_count("frames_per_second of a GIF", config.frames_per_second, 1, _GIF_RATE_MAX)
        write_bytes(path, gif_bytes(frames, config))
    else:
        # OpenCV's order of colours.
        pictures = (np.asarray(frame)[..., ::-1] for frame in frames)
        write_video(path, pictures, config.frames_per_second)


def frame_times(duration: float, config: FilmConfig) -> np.ndarray:
    """Return the times of the frames of a cast that lasts some time [s], with those of its rest."""
    step = config.speed / config.frames_per_second
    end = duration + config.speed * REST
    return np.arange(0.0, end + 1e-9, step)


def camera_behind_robot(
    setup: Setup, width: int, height: int, aspect: float | None = None, *, panel: bool = False
) -> CameraView:
    """Return the camera of a picture [pixel] at the `viewpoint` for its aspect [-] or another."""
    position, look_at, fov = viewpoint(setup, aspect or width / height, panel=panel)
    forward = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    x, y, z = np.stack([right, np.cross(forward, right), forward]).tolist()
    focal = height / 2 / float(np.tan(fov / 2))
    lens = Lens(width=width, height=height, focal=(focal, focal), centre=(width / 2, height / 2))
    return CameraView(lens=lens, rotation=(x, y, z), position=tuple(position.tolist()))


class Painter:
    """Paints pictures [pixel] of casts at one table."""

    def __init__(self, setup: Setup, width: int, height: int):
        self.setup = setup
        self.size = (width, height)
        self._view = camera_behind_robot(setup, SAMPLES * width, SAMPLES * height)
        self._backdrop = self._painted_backdrop()

    def frame(self, shot: Shot, time: float, tries: Sequence[Shot] = ()) -> Image.Image:
        """Return the picture of a cast at a time [s], with the landings of earlier tries.

        Beyond the end of the cast the cable rests.
        """
        image = self._backdrop.copy()
        pen = ImageDraw.Draw(image, "RGBA")
        if shot.target_xy is not None:
            for segment in target_marks(shot.target_xy, 0.0):
                self._line(pen, segment, VERMILLION, 1.6)
        for earlier in tries:
            if _has_landing(earlier):
                self._dot(pen, np.append(earlier.cast.path[-1], 0.01), 0.012, GREY)
        if len(trail := shot.cast.trail(time)) > 1:
            self._line(pen, level(trail, 0.002), (*BLUE, 110), 1.2)
        nodes, q = shot.cast.nodes_at(time), shot.cast.joints_at(time)
        rods = None if q is None else arm_rods(q, self.setup.arm)
        self._cast_shadow(image, nodes, rods)
        if shot.other is not None and (ghost := shot.other.nodes_at(time)) is not None:
            self._cable(pen, ghost, PURPLE, thin=True)
        if nodes is not None:
            self._cable(pen, nodes, BLUE)
        tip = shot.cast.tip_at(time)
        if np.all(np.isfinite(tip)):
            self._dot(pen, tip, 0.016, BLUE)
        if rods is not None:
            self._arm(pen, rods)
        if time >= shot.cast.duration:
            self._mark_miss(pen, shot)
        self._write(pen, shot.result if time >= shot.cast.duration else shot.caption)
        return image.resize(self.size, Image.Resampling.BOX)

    def _painted_backdrop(self) -> Image.Image:
        image = Image.new("RGB", (self._view.lens.width, self._view.lens.height), WHITE)
        pen = ImageDraw.Draw(image, "RGBA")
        top = self._table_top()
        front = np.concatenate([top[:2], top[1::-1] - [0.0, 0.0, 0.04]])
        self._polygon(pen, front, TABLE_SIDE)
        self._polygon(pen, top, TABLE)
        for line in table_lines(self.setup, 0.0):
            self._line(pen, line, TABLE_LINE, 0.5)
        for segment in reach_arc(self.setup, 0.0):
            self._line(pen, segment, JOINT, 1.0)
        return image

    def _table_top(self) -> Array:
        table = self.setup.workspace
        x, y0, y1 = table.half_width, table.y_min, table.y_max
        return np.array([[-x, y0, 0.0], [x, y0, 0.0], [x, y1, 0.0], [-x, y1, 0.0]])

    def _arm(self, pen: Any, rods: Rods) -> None:
        for rod in np.argsort(-self._depth(rods.ends).sum(axis=1)):
            segment, radius = rods.ends[rod], float(rods.radii[rod])
            # From the rim to the light: a rod looks round.
            for share, light in ((1.0, 0.62), (0.86, 0.82), (0.6, 0.95), (0.3, 1.04)):
                self._capsule(pen, segment, share * radius, _lit(ARM, light))
            for end in segment if radius > _JOINT_RADIUS_MIN else ():
                for share, light in ((0.8, 0.8), (0.5, 1.0)):
                    self._disc(pen, end, share * radius, _lit(JOINT, light))

    def _cable(self, pen: Any, nodes: Array, color: Color, *, thin: bool = False) -> None:
        radius = max(self.setup.cable.radius, CABLE_RADIUS_MIN)
        for share, light in ((0.6, 1.0),) if thin else ((1.0, 0.65), (0.6, 1.0)):
            for segment in polyline(nodes):
                self._capsule(pen, segment, share * radius, _lit(color, light))

    def _cast_shadow(self, image: Image.Image, nodes: Array | None, rods: Rods | None) -> None:
        """Darken the table below the arm and the cable, once where shadows overlap."""
        mask = Image.new("L", image.size, 0)
        pen = ImageDraw.Draw(mask)
        parts: list[tuple[Array, float]] = []
        if rods is not None:
            parts += zip(rods.ends, rods.radii.tolist(), strict=True)
        if nodes is not None:
            parts += [(pair, CABLE_RADIUS_MIN) for pair in polyline(nodes)]
        for segment, radius in parts:
            # A lamp high to the left: shadows fall to the right by a share of the height.
            ground = segment + segment[:, 2:] * _SHADOW_SLOPE
            self._capsule(pen, ground, radius, _SHADOW)
        table = Image.new("L", image.size, 0)
        self._polygon(ImageDraw.Draw(table), self._table_top(), _SHADOW)
        image.paste((20, 18, 16), mask=ImageChops.darker(mask, table))

    def _mark_miss(self, pen: Any, shot: Shot) -> None:
        landed = shot.cast.path[-1]
        if shot.target_xy is None or not _has_landing(shot):
            return
        ends = level(np.stack([shot.target_xy, landed]), 0.004)
        self._line(pen, ends, INK, 1.6)
        self._dot(pen, np.append(landed, 0.01), 0.016, INK)

    def _write(self, pen: Any, text: str) -> None:
        if text:
            place = (self._view.lens.width / 2, self._view.lens.height * 0.94)
            font = ImageFont.load_default(size=SAMPLES * max(12, self.size[1] // 30))
            # The arm of a polar cast reaches behind it.
            rim: dict[str, Any] = {"stroke_width": 2 * SAMPLES, "stroke_fill": WHITE}
            pen.text(place, text, fill=INK, font=font, anchor="mm", **rim)

    def _depth(self, points: Array) -> Array:
        """Return the distances of points along the view [m], shape [...]."""
        return (points - np.array(self._view.position)) @ np.array(self._view.rotation[2])

    def _dot(self, pen: Any, point: Array, radius: float, color: Color) -> None:
        self._disc(pen, point, radius, _lit(color, 0.6))
        self._disc(pen, point, 0.7 * radius, _lit(color, 1.0))

    def _disc(self, pen: Any, point: Array, radius: float, fill: tuple[int, ...]) -> None:
        x, y = self._view.to_image(point)
        size = self._view.lens.focal[0] * radius / float(self._depth(point))
        pen.ellipse([x - size, y - size, x + size, y + size], fill=fill)

    def _capsule(self, pen: Any, segment: Array, radius: float, fill: Any) -> None:
        path = self._view.to_image(segment)
        sizes = self._view.lens.focal[0] * radius / self._depth(segment)
        pen.line([tuple(p) for p in path], fill=fill, width=max(1, round(2 * float(sizes.mean()))))
        for (x, y), size in zip(path, sizes, strict=True):
            pen.ellipse([x - size, y - size, x + size, y + size], fill=fill)

    def _line(self, pen: Any, points: Array, color: tuple[int, ...], width: float) -> None:
        path = self._view.to_image(points)
        pen.line([tuple(p) for p in path], fill=color, width=max(1, round(width * SAMPLES)))

    def _polygon(self, pen: Any, points: Array, color: Any) -> None:
        path = self._view.to_image(points)
        pen.polygon([tuple(p) for p in path], fill=color)


def _lit(color: Color, light: float) -> Color:
    """Return a colour in more or less light."""
    red, green, blue = (min(255, round(light * value)) for value in color)
    return red, green, blue


def instants(
    durations: Sequence[float], config: FilmConfig, progress: ProgressCallback
) -> Iterator[tuple[int, float]]:
    """Yield the number of the cast and its time [s] for each frame, and report those done.

    `durations` are those of the casts [s].
    """
    times = [frame_times(duration, config) for duration in durations]
    total, done = sum(map(len, times)), 0
    for number, shot_times in enumerate(times):
        for time in shot_times:
            yield number, float(time)
            done += 1
            progress(Progress(task="Filming", done=done, total=total, unit="frames"))


def _has_landing(shot: Shot) -> bool:
    """Return whether a cast has a landing to draw: one off the table may be seen to its end."""
    return shot.landed and bool(np.all(np.isfinite(shot.cast.path[-1])))


def _tries_before(shots: Sequence[Shot], number: int) -> list[Shot]:
    """Return the earlier casts at the target of a cast; none if it has no target."""
    target = shots[number].target_xy
    if target is None:
        return []
    return [
        one
        for one in shots[:number]
        if one.target_xy is not None and np.allclose(one.target_xy, target, atol=1e-6)
    ]


def gif_bytes(frames: Iterator[Image.Image], config: FilmConfig) -> bytes:
    """Return pictures as one GIF with one palette, which stores only what changes."""
    first = next(frames)
    # What is drawn in these may cover little of the first picture, or come later.
    colors = Image.new("RGB", (4, 1))
    colors.putdata([PURPLE, VERMILLION, BLUE, SKY])
    sample = Image.new("RGB", (first.width, first.height + _SWATCH))
    sample.paste(first)
    sample.paste(colors.resize((first.width, _SWATCH), Image.Resampling.NEAREST), (0, first.height))
    palette = sample.quantize(_GIF_COLORS, method=Image.Quantize.MEDIANCUT)

    def reduced(number: int, frame: Image.Image) -> Image.Image:
        found = frame.quantize(palette=palette, dither=Image.Dither.NONE)
        # The format counts in hundredths of a second, so frames differ by one of them.
        start, end = (round(100 * at / config.frames_per_second) for at in (number, number + 1))
        found.info["duration"] = 10 * (end - start)
        return found

    buffer = io.BytesIO()
    reduced(0, first).save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=(reduced(*row) for row in enumerate(frames, 1)),
        loop=0,
        optimize=True,
        disposal=1,
    )
    return buffer.getvalue()


def film_html(
    setup: Setup, shots: Sequence[Shot], config: FilmConfig, progress: ProgressCallback
) -> str:
    """Return casts as one HTML file that holds all that it needs: to turn, zoom and play."""
    server = start_server("127.0.0.1", 0)
    try:
        camera = server.initial_camera
        camera.position, camera.look_at, camera.fov = viewpoint(setup)
        table = TargetScene.of(server, setup)
        solid = Figure(server, "/solid", setup, BLUE)
        ghost = Figure(server, "/ghost", setup, PURPLE, opacity=0.5, with_arm=False)
        solid.show(shots[0].cast, 0.0)
        serializer = server.get_scene_serializer()
        durations = [shot.cast.duration for shot in shots]
        for number, time in instants(durations, config, progress):
            shot = shots[number]
            if time == 0.0:
                ghost.visible = shot.other is not None
                table.clear()
                if shot.target_xy is not None:
                    table.target(shot.target_xy)
            solid.show(shot.cast, time)
            if shot.other is not None:
                ghost.show(shot.other, time)
            serializer.insert_sleep(1.0 / config.frames_per_second)
        return serializer.as_html()
    finally:
        stop_server(server)
