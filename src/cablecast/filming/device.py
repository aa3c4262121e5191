"""Opening a camera with OpenCV: what is asked of it, and what it says it does.

The order is that of Linux cameras (V4L2): pixel format, size and rate one after another, since each
bounds the next; automatic exposure is switched through its automatic state, without which some
drivers ignore the value.
"""

import dataclasses
import re
from collections.abc import Callable
from typing import Any

from cablecast.camera.settings import CameraSettings
from cablecast.errors import CameraError
from cablecast.tracking.opencv import load_cv2

OPEN_TIMEOUT = 10.0
"""Time within which a camera or stream must open [s]."""

_SILENCE_MAX = 60.0
"""Time without data after which a stream is given up for good [s]. Who waits for a frame says much
sooner that none comes, and may try again when they come."""

V4L2_EXPOSURE_UNIT = 1e-4
"""Unit of the exposure time of V4L2 [s]."""

_AUTO_EXPOSURE_ON, _AUTO_EXPOSURE_OFF = 3.0, 1.0
"""V4L2's numbers for automatic and manual exposure."""
_DEVICE = re.compile(r"(?:/dev/video)?(\d+)")


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraFacts:
    """Answer of a camera to what was asked of it.

    Attributes:
        kind: "device", "file" or "stream".
        backend: Name of OpenCV's backend.
        width: Width of its images [px].
        height: Height of its images [px].
        rate: Frames per second that it states [1/s]; 0 where unknown.
        fourcc: Pixel format; empty where unknown.
        exposure: Exposure [s]; None where it cannot be asked.
        auto_exposure: Whether exposure is automatic; None where it cannot be asked.
        autofocus: Whether focus is automatic; None where it cannot be asked.
        focus: Focus in the units of the driver; None where it cannot be asked.
    """

    kind: str
    backend: str
    width: int
    height: int
    rate: float
    fourcc: str = ""
    exposure: float | None = None
    auto_exposure: bool | None = None
    autofocus: bool | None = None
    focus: float | None = None


def source_kind(source: str) -> str:
    """Return "device", "file" or "stream".

    >>> [source_kind(s) for s in ("0", "/dev/video2", "rtsp://host/1", "film.mp4")]
    ['device', 'device', 'stream', 'file']
    """
    if _DEVICE.fullmatch(source.strip()):
        return "device"
    return "stream" if "://" in source else "file"


def open_capture(
    settings: CameraSettings, capture: Callable[..., Any] | None = None
) -> tuple[Any, CameraFacts]:
    """Open a camera, ask it for its settings, and read them back.

    Args:
        settings: Source and settings.
        capture: Makes the capture; OpenCV's `VideoCapture` where None.

    Returns:
        The capture, and the camera's answers.

    Raises:
        CameraError: The source cannot be opened.
    """
    cv2 = load_cv2()
    make = cv2.VideoCapture if capture is None else capture
    source, kind = settings.source.strip(), source_kind(settings.source)
    timeout_ms = int(1e3 * OPEN_TIMEOUT)
    try:
        if kind == "device":
            match = _DEVICE.fullmatch(source)
            opened = make(int(match.group(1)) if match else source, cv2.CAP_V4L2)
        elif kind == "stream":
            limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, timeout_ms]
            limits += [cv2.CAP_PROP_READ_TIMEOUT_MSEC, int(1e3 * _SILENCE_MAX)]
            opened = make(source, cv2.CAP_FFMPEG, limits)
        else:
            opened = make(source, cv2.CAP_FFMPEG)
    except cv2.error as error:
        raise CameraError(f"camera source {source}: {' '.join(str(error).split())}") from None
    if not opened.isOpened():
        raise CameraError(f"camera source {source} cannot be opened: {_ADVICE[kind]}")
    if kind == "device":
        _configure(opened, settings)
    return opened, read_back(opened, kind)


_ADVICE = {
    "device": "is it plugged in, is its number right, and does no other program use it?",
    "stream": "is the camera switched on, and is its address right?",
    "file": "there is no such video, or it cannot be read",
}


def _configure(capture: Any, settings: CameraSettings) -> None:
    """Ask a device for its settings, in the order in which each bounds the next."""
    cv2 = load_cv2()
    capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter_fourcc(*settings.fourcc))
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, settings.width)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, settings.height)
    capture.set(cv2.CAP_PROP_FPS, settings.rate)
    capture.set(cv2.CAP_PROP_AUTOFOCUS, 0)
    if settings.focus is not None:
        capture.set(cv2.CAP_PROP_FOCUS, settings.focus)
    capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _AUTO_EXPOSURE_ON)
    capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _AUTO_EXPOSURE_OFF)
    capture.set(cv2.CAP_PROP_EXPOSURE, round(settings.exposure / V4L2_EXPOSURE_UNIT))


def read_back(capture: Any, kind: str) -> CameraFacts:
    """Return what a camera says of itself.

    Args:
        capture: Open capture.
        kind: Kind of its source.
    """
    cv2 = load_cv2()
    code = int(capture.get(cv2.CAP_PROP_FOURCC))
    letters = bytes((code >> shift) & 0xFF for shift in (0, 8, 16, 24))
    facts = CameraFacts(
        kind=kind,
        backend=str(capture.getBackendName()),
        width=int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
        height=int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        rate=max(float(capture.get(cv2.CAP_PROP_FPS)), 0.0),
        fourcc=letters.decode("ascii", "replace").strip("\0") if code > 0 else "",
    )
    if kind != "device":
        return facts
    exposure = float(capture.get(cv2.CAP_PROP_EXPOSURE))
    automatic = float(capture.get(cv2.CAP_PROP_AUTO_EXPOSURE))
    autofocus = float(capture.get(cv2.CAP_PROP_AUTOFOCUS))
    focus = float(capture.get(cv2.CAP_PROP_FOCUS))
    # What a driver does not know it answers with 0 or -1.
    return dataclasses.replace(
        facts,
        exposure=exposure * V4L2_EXPOSURE_UNIT if exposure > 0 else None,
        auto_exposure=automatic == _AUTO_EXPOSURE_ON if automatic > 0 else None,
        autofocus=autofocus > 0 if autofocus >= 0 else None,
        focus=focus if focus >= 0 else None,
    )
