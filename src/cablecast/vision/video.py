"""Video files: the frames of a recorded trial with their times, and writing such files."""

import dataclasses
import os
import pathlib
from collections.abc import Iterable, Iterator
from typing import Any

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
