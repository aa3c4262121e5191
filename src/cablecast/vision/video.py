"""Video files: the frames of a recorded trial with their times, and writing such files.

Matroska: the container in which JPEG pictures carry their own times, in files and in streams.

OpenCV writes no time stamps into the videos it makes, and a plain JPEG stream has none. This writer
does the least that FFmpeg, and with it OpenCV, reads: one track of pictures, each in a cluster of
its own. Identifiers and layout follow RFC 8794 (EBML) and RFC 9559 (Matroska).
"""

import dataclasses
import os
import pathlib
import struct
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.vision.tags import load_cv2

Image = NDArray[np.uint8]

RATE_MIN, RATE_MAX = 5.0, 1000.0
"""Smallest and largest frame rate of a camera [1/s]; anything else is a damaged header."""


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

    Args:
        path: Video file.

    Returns:
        Its header, and its frames one after another: the time since the first frame [s], and the
        frame, BGR, shape [v, u, 3].

    Raises:
        InputError: There is no such file, it is no video, or it is damaged.
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
        while True:
            ok, image = capture.read()
            if not ok:
                break
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


def write_video(path: pathlib.Path, frames: Iterable[Image], rate: float) -> int:
    """Write frames to an MP4 file.

    Args:
        path: Video file; its folder is created.
        frames: Frames, BGR, all of one size.
        rate: Frames per second [1/s].

    Returns:
        Number of frames written.

    Raises:
        InputError: There are no frames, or the file cannot be written.
    """
    cv2 = load_cv2()
    path.parent.mkdir(parents=True, exist_ok=True)
    # Not complete until renamed, like every file that cablecast writes.
    part = path.with_name(f".{path.stem}.part{path.suffix or '.mp4'}")
    writer, count = None, 0
    try:
        for frame in frames:
            if writer is None:
                size = (frame.shape[1], frame.shape[0])
                writer = cv2.VideoWriter(
                    str(part), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*"mp4v"), rate, size
                )
                if not writer.isOpened():
                    raise InputError(f"{path} cannot be written")
            writer.write(frame)
            count += 1
        if writer is None:
            raise InputError(f"there are no frames to write to {path}")
        writer.release()
        os.replace(part, path)
    finally:
        if writer is not None:
            writer.release()
        part.unlink(missing_ok=True)
    return count


MIME = "video/x-matroska"

_TICK_NS = 1000
"""Unit of the time stamps [ns]."""
_EBML, _SEGMENT, _INFO, _TRACKS, _CLUSTER = (
    bytes.fromhex(name) for name in ("1A45DFA3", "18538067", "1549A966", "1654AE6B", "1F43B675")
)
_UNKNOWN_SIZE = b"\x01" + b"\xff" * 7
"""Size of a segment that goes on until the file or the stream ends."""


def encode_jpeg(image: NDArray[np.uint8], quality: int = 92) -> bytes:
    """Return a picture as JPEG.

    Args:
        image: Picture, BGR.
        quality: Quality from 1 to 100.
    """
    cv2 = load_cv2()
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def header(width: int, height: int, rate: float) -> bytes:
    """Return what stands before the first picture.

    Args:
        width: Width of the pictures [px].
        height: Height of the pictures [px].
        rate: Usual number of pictures per second [1/s].
    """
    ebml = _element("4286", _number(1)) + _element("42F7", _number(1))
    ebml += _element("42F2", _number(4)) + _element("42F3", _number(8))
    ebml += _element("4282", b"matroska")
    ebml += _element("4287", _number(4)) + _element("4285", _number(2))
    info = _element("2AD7B1", _number(_TICK_NS))
    info += _element("4D80", b"cablecast") + _element("5741", b"cablecast")
    video = _element("B0", _number(width)) + _element("BA", _number(height))
    track = _element("D7", _number(1)) + _element("73C5", _number(1)) + _element("83", _number(1))
    track += _element("86", b"V_MJPEG") + _element("9C", _number(0))
    track += _element("23E383", _number(round(1e9 / rate))) + _element("E0", video)
    opening = _element(_EBML, ebml) + _SEGMENT + _UNKNOWN_SIZE
    return opening + _element(_INFO, info) + _element(_TRACKS, _element("AE", track))


def picture(jpeg: bytes, time: float) -> bytes:
    """Return one picture with its time.

    Args:
        jpeg: Picture as JPEG.
        time: Time of the picture, not negative [s].

    Raises:
        InputError: The time is negative, or not finite.
    """
    if not 0.0 <= time < 1e12:
        raise InputError(f"time of a picture = {time} s is outside [0, 1e12]")
    block = b"\x81" + struct.pack(">hB", 0, 0x80) + jpeg
    ticks = _number(round(time * 1e9 / _TICK_NS))
    return _element(_CLUSTER, _element("E7", ticks) + _element("A3", block))


class FilmWriter:
    """Writes frames with their times to a file, which has its name only once it is whole.

    Args:
        path: File to write, ending in .mkv.
        rate: Usual number of frames per second [1/s].
    """

    def __init__(self, path: pathlib.Path, rate: float):
        self.path = path
        self.rate = rate
        self.frame_count = 0
        self._part = path.with_name(f".{path.name}.part")
        self._file: BinaryIO | None = None
        self._start = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close(whole=kind is None)

    def write(self, image: NDArray[np.uint8], time: float) -> None:
        """Add a frame.

        Args:
            image: Frame, BGR, shape [v, u, 3].
            time: Time of the frame, counted from that of the first [s].
        """
        if self._file is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._part.open("wb")
            self._file.write(header(image.shape[1], image.shape[0], self.rate))
            self._start = time
        self._file.write(picture(encode_jpeg(image), time - self._start))
        self.frame_count += 1

    def close(self, whole: bool = True) -> None:
        """Finish the file.

        Args:
            whole: Whether it shall be kept.
        """
        if self._file is None:
            return
        self._file.close()
        self._file = None
        if whole:
            self._part.replace(self.path)
        else:
            self._part.unlink(missing_ok=True)


def _element(name: str | bytes, content: bytes) -> bytes:
    """Return an element: its identifier, its size in eight bytes, its content."""
    identifier = name if isinstance(name, bytes) else bytes.fromhex(name)
    return identifier + ((1 << 56) | len(content)).to_bytes(8, "big") + content


def _number(value: int) -> bytes:
    return value.to_bytes(8, "big")
