"""Films of strikes, from the side: the plane of the swing with arm, stick, cable and target."""

import math
import pathlib
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from cablecast.cast import Cast
from cablecast.data.dataset import StoredSettings
from cablecast.data.store import CastStore
from cablecast.errors import DatasetError, InputError, check_count
from cablecast.motion.joint_move import JointMoves, SwingPlane, swing_shape
from cablecast.motion.trajectory import joints_at
from cablecast.pipeline.aim import SESSION_FOLDER
from cablecast.report.strike_page import plane_text
from cablecast.report.words import miss_text
from cablecast.runs.folder import RunFolder
from cablecast.runs.progress import ProgressCallback, ignore
from cablecast.setup import Setup
from cablecast.task import STRIKE
from cablecast.view.film import CAST_COUNT_MAX, SAMPLES, FilmConfig, instants, write_frames
from cablecast.view.shapes import ARM, BLUE, GREY, INK, SKY, VERMILLION, WHITE, Array, Color

STRIKE_KINDS = (".mp4", ".gif")

_MARGIN = 0.15  # About arm, targets and paths [m].
_ARM_TIMES = 16  # Times at which the arm of a cast is looked at to have it in the picture.
_DOT = 0.022  # Radius of the tip, and of a target's inner ring [m].


def strikes_in(folder: pathlib.Path) -> list[Cast]:
    """Return the casts of a folder of `aim`, if they are strikes; none otherwise.

    Raises:
        DatasetError: They are strikes, but none was made yet.
        DamagedFileError: A file is not what was written.
    """
    run = RunFolder.read(folder / SESSION_FOLDER)
    if run is None or "strike" not in run.config.get("settings", {}):
        return []
    setup = StoredSettings(run.config, str(folder)).setup
    casts = CastStore(setup, run.path, STRIKE).casts
    if not casts:
        raise DatasetError(f"{folder} holds no swing yet")
    return casts


def write_strike_film(
    path: pathlib.Path,
    casts: Sequence[Cast],
    config: FilmConfig,
    progress: ProgressCallback = ignore,
) -> None:
    """Write strikes, one after another, as an MP4 or a GIF.

    Raises:
        InputError: It is to be an HTML file, or there is nothing to film.
    """
    if path.suffix.lower() not in STRIKE_KINDS:
        raise InputError("a film of strikes ends in .mp4 or .gif")
    check_count("swings to film", len(casts), 1, CAST_COUNT_MAX)
    painter = _Painter(casts, config)
    durations = [float(cast.track.times[-1]) for cast in casts]
    shown = instants(durations, config, progress)
    write_frames(path, (painter.frame(casts[number], time) for number, time in shown), config)


class _Painter:
    """Paints the plane of the swing, so large that all of some casts is in it."""

    def __init__(self, casts: Sequence[Cast], config: FilmConfig):
        self.size = (config.width, config.height)
        first = casts[0].goal
        if first is None:
            raise InputError("only swings that were aimed at a target are filmed")
        self.setup: Setup = first.setup
        self.moves = JointMoves.of(self.setup)
        self.plane = SwingPlane.of(self.moves)
        places = [self._arm(np.array(self.moves.start)).reshape(-1, 2)]
        for cast in casts:
            if (joints := cast.track.joint_path or cast.joint_path) is not None:
                times = np.linspace(0.0, float(cast.track.times[-1]), _ARM_TIMES)
                places.append(self._arm(joints_at(joints, times)).reshape(-1, 2))
            path = self.plane.coordinates(cast.track.path)[:, :2]
            places += [path[np.isfinite(path[:, 0])], self._goal(cast)[None]]
        low, high = (extreme(np.concatenate(places), axis=0) for extreme in (np.min, np.max))
        low, high = low - _MARGIN, high + _MARGIN
        self._scale = SAMPLES * float(np.min(np.array(self.size) * [1.0, 0.88] / (high - low)))
        self._middle = (low + high) / 2.0

    def frame(self, cast: Cast, time: float) -> Image.Image:
        """Return the picture of a cast at a time [s]; it stays as it was at the end."""
        width, height = self.size
        image = Image.new("RGB", (SAMPLES * width, SAMPLES * height), WHITE)
        pen = ImageDraw.Draw(image)
        track = cast.track
        joints = track.joint_path or cast.joint_path
        if joints is not None:
            q = joints_at(joints, [min(time, float(track.times[-1]))])[0]
            shape = swing_shape(q, self.moves.arm, self.moves.stick)
            for ends, radius in zip(self._arm(q), shape.radii, strict=True):
                self._line(pen, ends, ARM, 2.0 * radius)
        goal, radius = self._goal(cast), 0.0
        if cast.goal is not None:
            radius = cast.goal.within_pct / 100.0 * self.setup.cable.length
        self._ring(pen, goal, radius, VERMILLION)
        self._ring(pen, goal, 0.15 * _DOT, VERMILLION)
        path = self.plane.coordinates(track.path)[:, :2]
        seen = np.isfinite(path[:, 0])
        until = seen & (track.times <= time)
        if until.sum() > 1:
            self._line(pen, path[until], SKY, 0.008)
        if track.nodes is not None:
            # As old as the tip: the last one so far.
            step = max(int(np.searchsorted(track.times, time, side="right")) - 1, 0)
            self._line(pen, self.plane.coordinates(track.nodes[step])[:, :2], INK, 0.012)
        if until.any():
            self._dot(pen, path[until][-1], BLUE)
        over = time > float(track.times[-1])
        if over and np.isfinite(cast.outcome).all():
            self._dot(pen, self.plane.coordinates(cast.outcome)[:2], BLUE if cast.hit else GREY)
        words = f"{plane_text(cast.target_xy, self.plane)}, try {cast.try_number}"
        if over:
            words += f": {'hit, ' * cast.hit}{miss_text(cast)}"
            words += " off" * math.isfinite(cast.miss_pct)
        font = ImageFont.load_default(size=SAMPLES * max(12, height // 30))
        pen.text((SAMPLES * width / 2, SAMPLES * height * 0.95), words, INK, font, anchor="mm")
        return image.resize(self.size, Image.Resampling.BOX)

    def _arm(self, q: Array) -> Array:
        """Return the ends of arm and stick in the plane [m], shape [rod, 2, 2]."""
        ends = swing_shape(q, self.moves.arm, self.moves.stick).ends
        return self.plane.coordinates(ends)[..., :2]

    def _goal(self, cast: Cast) -> Array:
        return self.plane.coordinates(cast.target_xy)[:2]

    def _pixels(self, places: Array) -> Array:
        middle = SAMPLES * np.array(self.size) * [0.5, 0.46]
        return middle + self._scale * (np.asarray(places) - self._middle) * [1.0, -1.0]

    def _line(self, pen: ImageDraw.ImageDraw, places: Array, color: Color, width: float) -> None:
        points = [tuple(point) for point in self._pixels(places).tolist()]
        size = max(1, round(self._scale * width))
        pen.line(points, fill=color, width=size, joint="curve")
        for x, y in points[:: max(len(points) - 1, 1)]:
            pen.ellipse([x - size / 2, y - size / 2, x + size / 2, y + size / 2], fill=color)

    def _dot(self, pen: ImageDraw.ImageDraw, place: Array, color: Color) -> None:
        x, y = self._pixels(place).tolist()
        size = self._scale * _DOT
        pen.ellipse([x - size, y - size, x + size, y + size], fill=color)

    def _ring(self, pen: ImageDraw.ImageDraw, place: Array, radius: float, color: Color) -> None:
        x, y = self._pixels(place).tolist()
        size = max(self._scale * radius, 2.0)
        pen.ellipse([x - size, y - size, x + size, y + size], outline=color, width=2 * SAMPLES)
