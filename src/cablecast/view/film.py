"""Films of casts: one HTML file to turn and zoom, an MP4 or a GIF; no display is needed."""

import dataclasses
import io
import pathlib
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cablecast.checks import check_count, check_number
from cablecast.errors import InputError, MissingExtraError
from cablecast.files import write_bytes, write_text
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.setup import Setup
from cablecast.view.palette import DARK, LIGHT, PURPLE
from cablecast.view.picture import Painter, Shot
from cablecast.view.shapes import viewpoint

if TYPE_CHECKING:
    from PIL import Image

KINDS = (".html", ".mp4", ".gif")
REST = 1.2
"""Time that a cable at rest is shown before the next cast [s]."""

_GIF_COLORS = 96
_SIZE_MAX = 3840
_CAST_COUNT_MAX = 200


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilmConfig:
    """Size and speed of a film.

    Attributes:
        width: Width [pixel], even.
        height: Height [pixel], even.
        frames_per_second: Frames a second.
        speed: Shown seconds per second: 0.5 is slow motion.
        dark: True for dark colours.
    """

    width: int = 960
    height: int = 540
    frames_per_second: int = 25
    speed: float = 1.0
    dark: bool = False

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
    config: FilmConfig | None = None,
    progress: ProgressCallback | None = None,
) -> None:
    """Write casts, one after another, as one file.

    Args:
        path: File to write; its ending says the kind: .html, .mp4 or .gif.
        setup: Set-up with table, arm and cable.
        shots: Casts in order.
        config: Size and speed.
        progress: Told how many frames are done.

    Raises:
        InputError: The ending is unknown, or there is nothing to film.
        MissingExtraError: A library of the film is not installed.
    """
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise InputError(f"{path} ends in {kind!r}: a film ends in one of {', '.join(KINDS)}")
    check_count("casts to film", len(shots), 1, _CAST_COUNT_MAX)
    config = config or FilmConfig()
    if kind == ".html":
        write_text(path, film_html(setup, shots, config, progress))
        return
    frames = film_frames(setup, shots, config, progress)
    encode = mp4_bytes if kind == ".mp4" else gif_bytes
    write_bytes(path, encode(frames, config))


def frame_times(shot: Shot, config: FilmConfig) -> np.ndarray:
    """Return the times of the frames of a cast [s], with those of its rest, shape [frame]."""
    step = config.speed / config.frames_per_second
    end = shot.cast.duration + config.speed * REST
    return np.arange(0.0, end + 1e-9, step)


def film_frames(
    setup: Setup,
    shots: Sequence[Shot],
    config: FilmConfig,
    progress: ProgressCallback | None = None,
) -> "Iterator[Image.Image]":
    """Yield the pictures of a film; see `write_film`."""
    painter = Painter(setup, config.width, config.height, dark=config.dark)
    times = [frame_times(shot, config) for shot in shots]
    total, done, report = sum(map(len, times)), 0, progress or ignore
    for number, shot in enumerate(shots):
        same = [one for one in shots[:number] if _same_target(one, shot)]
        for time in times[number]:
            yield painter.frame(shot, float(time), same)
            done += 1
            report(Progress(task="Filming", done=done, total=total, unit="frames"))


def gif_bytes(frames: "Iterator[Image.Image]", config: FilmConfig) -> bytes:
    """Return pictures as one GIF with one palette, which stores only what changes."""
    from PIL import Image

    first = next(frames)
    palette = first.quantize(_GIF_COLORS, method=Image.Quantize.MEDIANCUT)

    def reduced() -> "Iterator[Image.Image]":
        for frame in frames:
            yield frame.quantize(palette=palette, dither=Image.Dither.NONE)

    buffer = io.BytesIO()
    # The format counts in hundredths of a second.
    palette.save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=reduced(),
        duration=10 * round(100 / config.frames_per_second),
        loop=0,
        optimize=True,
        disposal=1,
    )
    return buffer.getvalue()


def mp4_bytes(frames: "Iterator[Image.Image]", config: FilmConfig) -> bytes:
    """Return pictures as one MP4 (H.264), which every browser plays.

    Raises:
        MissingExtraError: PyAV is not installed.
    """
    try:
        import av
    except ImportError:
        raise MissingExtraError("av", "view", "an MP4 film") from None
    buffer = io.BytesIO()
    with av.open(buffer, "w", format="mp4") as container:
        stream: Any = container.add_stream("libx264", rate=config.frames_per_second)
        stream.width, stream.height, stream.pix_fmt = config.width, config.height, "yuv420p"
        stream.options = {"crf": "21", "preset": "veryfast"}
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_image(frame)))
        container.mux(stream.encode())
    return buffer.getvalue()


def film_html(
    setup: Setup,
    shots: Sequence[Shot],
    config: FilmConfig,
    progress: ProgressCallback | None = None,
) -> str:
    """Return casts as one HTML file that holds all that it needs: to turn, zoom and play.

    Raises:
        MissingExtraError: viser is not installed.
    """
    from cablecast.view.figure import Figure
    from cablecast.view.scene import Marks, Room
    from cablecast.view.serving import start_server, stop_server

    server = start_server("127.0.0.1", 0)
    try:
        camera = server.initial_camera
        camera.position, camera.look_at, camera.fov = viewpoint(setup)
        paint = DARK if config.dark else LIGHT
        Room(server, setup, paint)
        marks = Marks(server, setup)
        solid = Figure(server, "/solid", setup, paint.cable, paint=paint)
        ghost = Figure(server, "/ghost", setup, PURPLE, opacity=0.5, with_arm=False)
        solid.show(shots[0].cast, 0.0)
        serializer = server.get_scene_serializer()
        times = [frame_times(shot, config) for shot in shots]
        total, done, report = sum(map(len, times)), 0, progress or ignore
        for shot, shot_times in zip(shots, times, strict=True):
            if shot.target_xy is not None:
                marks.target(shot.target_xy)
            ghost.visible = shot.other is not None
            for time in shot_times:
                solid.show(shot.cast, float(time))
                if shot.other is not None:
                    ghost.show(shot.other, float(time))
                serializer.insert_sleep(1.0 / config.frames_per_second)
                done += 1
                report(Progress(task="Filming", done=done, total=total, unit="frames"))
        return serializer.as_html(dark_mode=config.dark)
    finally:
        stop_server(server)


def _same_target(one: Shot, other: Shot) -> bool:
    if one.target_xy is None or other.target_xy is None:
        return False
    return bool(np.allclose(one.target_xy, other.target_xy, atol=1e-6))
