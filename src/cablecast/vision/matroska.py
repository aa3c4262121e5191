"""Matroska: the container in which JPEG pictures carry their own times, in files and in streams.

OpenCV writes no time stamps into the videos it makes, and a plain JPEG stream has none. This writer
does the least that FFmpeg, and with it OpenCV, reads: one track of pictures, each in a cluster of
its own. Identifiers and layout follow RFC 8794 (EBML) and RFC 9559 (Matroska).
"""

import pathlib
import struct
from types import TracebackType
from typing import BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.vision.tags import load_cv2

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
