"""Films: OpenCV reads them, PyAV writes them, as MP4 or as JPEG pictures with their own times."""

import dataclasses
import os
import pathlib
from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError, MissingExtraError
from cablecast.vision.tags import load_cv2

Image = NDArray[np.uint8]

RATE_MIN, RATE_MAX = 5.0, 1000.0
"""Smallest and largest frame rate of a camera [1/s]; anything else is a damaged header."""
_PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
_MICROSECOND = Fraction(1, 1_000_000)


@dataclasses.dataclass(frozen=True, kw_only=True)
class VideoInfo:
    """Header of a video file.

    Attributes:
        width: Width of its frames [px].
        height: Height of its frames [px].
        rate: Frames per second [1/s].
        frame_count: Number of frames; 0 where the header does not say.
    """

    width: int
    height: int
    rate: float
    frame_count: int


def read_video(path: pathlib.Path) -> tuple[VideoInfo, Iterator[tuple[float, Image]]]:
    """Open a video.

    Returns:
        Its header, and its frames one after another: the time since the first frame [s], and the
        frame, BGR, shape [v, u, 3].
    """
    cv2 = load_cv2()
    if not path.is_file():
        raise InputError(f"there is no video {path}")
    # The only reader of files that says nothing on its own: others print to the terminal.
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise InputError(f"{path} is no video that can be read")
    rate = float(capture.get(cv2.CAP_PROP_FPS))
    if not RATE_MIN <= rate <= RATE_MAX:
        raise InputError(
            f"{path} says it has {rate:g} frames/s, outside [{RATE_MIN:g}, {RATE_MAX:g}]"
        )
    info = VideoInfo(
        width=int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
        height=int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        rate=rate,
        frame_count=max(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0),
    )
    return info, _frames(capture, path, info)


def _frames(capture: Any, path: pathlib.Path, info: VideoInfo) -> Iterator[tuple[float, Image]]:
    """Yield the frames of an opened video with their times."""
    cv2 = load_cv2()
    count, start, last = 0, 0.0, -1.0
    try:
        while (image := capture.read()[1]) is not None:
            stamp = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
            if count == 0:
                start = stamp
            time = stamp - start
            # Some containers keep no time stamps; then frames come at the rate of the header.
            if count and not last < time < last + 100.0 / info.rate:
                time = last + 1.0 / info.rate
            last = time
            count += 1
            yield time, image
    finally:
        capture.release()
    if count == 0:
        raise InputError(f"{path} holds no frame that can be read")
    # Headers count one or two frames that never come; half a second of them is damage.
    if count < info.frame_count - max(2, info.rate / 2):
        raise InputError(f"{path} is damaged: {count} of its {info.frame_count} frames can be read")


def capture_rate(path: pathlib.Path) -> float | None:
    """Return the frames per second with which a phone says that it filmed; None without a word.

    Slow motion is often stored at another rate than it was taken with.
    """
    try:
        with _load_av().open(str(path)) as container:
            return float(container.metadata["com.android.capture.fps"])
    except (MissingExtraError, KeyError, ValueError, OSError):
        return None


def read_pictures(folder: pathlib.Path) -> list[Image]:
    """Return the pictures in a folder, by the order of their names."""
    if not folder.is_dir():
        raise InputError(f"board folder {folder}: there is no such folder")
    cv2 = load_cv2()
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in _PICTURE_SUFFIXES)
    images = [image for image in (cv2.imread(str(file)) for file in files) if image is not None]
    if not images:
        raise InputError(f"board folder {folder} holds no pictures")
    return images


def write_video(path: pathlib.Path, frames: Iterable[Image], rate: float) -> int:
    """Write frames, BGR, all of one size, to an MP4 file (H.264), and return their number.

    Every browser plays it.

    Raises:
        InputError: There are no frames.
        MissingExtraError: PyAV is not installed.
    """
    av = _load_av()
    count, stream = 0, None
    path.parent.mkdir(parents=True, exist_ok=True)
    # Not complete until renamed, like every file that cablecast writes.
    part = path.with_name(f".{path.stem}.part{path.suffix or '.mp4'}")
    try:
        with av.open(str(part), "w", format="mp4") as container:
            for frame in frames:
                if stream is None:
                    stream = container.add_stream("libx264", rate=_fraction(rate))
                    stream.height, stream.width = frame.shape[:2]
                    even = stream.height % 2 == stream.width % 2 == 0
                    stream.pix_fmt = "yuv420p" if even else "yuv444p"
                    stream.options = {"crf": "21", "preset": "veryfast"}
                picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="bgr24")
                container.mux(stream.encode(picture))
                count += 1
            if stream is not None:
                container.mux(stream.encode())
        if not count:
            raise InputError(f"there are no frames to write to {path}")
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    return count


def _load_av() -> Any:
    try:
        import av
    except ModuleNotFoundError:
        raise MissingExtraError("PyAV", "camera", "writing a film") from None
    return av


def _fraction(rate: float) -> Fraction:
    return Fraction(rate).limit_denominator(1001)


def encode_jpeg(image: Image) -> bytes:
    """Return a picture, BGR, as JPEG."""
    cv2 = load_cv2()
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()


class JpegMuxer:
    """Writes JPEG pictures with their own times, which OpenCV's writer cannot.

    Args:
        sink: Unbuffered binary file or connection to write to.
        container: "matroska", which every player knows and whose times are whole milliseconds; or
            "nut" for streams, whose times are whole microseconds: Matroska holds each picture back
            until the next one comes.
        width: Width of the pictures [px].
        height: Height of the pictures [px].
        rate: Typical number of pictures per second [1/s].
    """

    def __init__(self, sink: Any, container: str, width: int, height: int, rate: float):
        av = _load_av()
        options = {"flush_packets": "1"}
        if container == "matroska":
            # Nothing that is written at the end, and no picture waits for more than the next one:
            # what a killed process leaves can be read.
            options |= {"live": "1", "cluster_time_limit": "0"}
        self._packet = av.Packet
        self._container = av.open(sink, "w", format=container, container_options=options)
        self._stream = self._container.add_stream("mjpeg", rate=_fraction(rate))
        self._stream.width, self._stream.height = width, height
        self._stream.pix_fmt, self._stream.time_base = "yuvj420p", _MICROSECOND

    def write(self, jpeg: bytes, time: float) -> None:
        """Write a picture of a time, not negative [s]."""
        if not 0.0 <= time < 1e12:
            raise InputError(f"time of a picture = {time} s is outside [0, 1e12]")
        packet = self._packet(jpeg)
        packet.stream, packet.time_base = self._stream, _MICROSECOND
        packet.pts = packet.dts = round(time * 1e6)
        packet.is_keyframe = True
        self._container.mux(packet)

    def close(self) -> None:
        """Write what waits, but leave the sink open."""
        self._container.close()


class FilmWriter:
    """Writes frames with their times to a file, which has its name only once it is whole.

    Until then all frames but the last are in a hidden file next to it; a killed process leaves it.

    Args:
        path: File to write, ending in .mkv.
        rate: Typical number of frames per second [1/s].
    """

    def __init__(self, path: pathlib.Path, rate: float):
        self.path = path
        self.rate = rate
        self._part = path.with_name(f".{path.name}.part")
        self._file: Any = None
        self._muxer: JpegMuxer | None = None
        self._start = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        self.close(whole=kind is None)

    def write(self, image: Image, time: float) -> None:
        """Add a frame, BGR, of a time [s]; times are counted from the first."""
        if self._muxer is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._part.open("wb", buffering=0)
            height, width = image.shape[:2]
            self._muxer = JpegMuxer(self._file, "matroska", width, height, self.rate)
            self._start = time
        self._muxer.write(encode_jpeg(image), time - self._start)

    def close(self, whole: bool = True) -> None:
        """Finish the file, or remove it unless it is whole."""
        muxer, self._muxer, file, self._file = self._muxer, None, self._file, None
        if file is None:
            return
        if muxer is not None and whole:
            muxer.close()
        file.close()
        if muxer is not None and whole:
            self._part.replace(self.path)
        else:
            self._part.unlink(missing_ok=True)
