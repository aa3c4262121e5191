"""OpenCV, imported when it is needed and not before."""

import os
from typing import Any

from cablecast.errors import MissingExtraError


def load_cv2() -> Any:
    """Return the cv2 module, which complains about damaged videos to nobody but its caller.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    os.environ.setdefault("OPENCV_LOG_LEVEL", "FATAL")
    try:
        import cv2
    except ModuleNotFoundError:
        raise MissingExtraError("OpenCV", "camera", "the camera") from None
    return cv2
