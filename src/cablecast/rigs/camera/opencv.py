"""OpenCV, imported when it is needed and not before."""

from typing import Any

from cablecast.errors import MissingExtraError


def load_cv2() -> Any:
    """The cv2 module.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """
    try:
        import cv2
    except ModuleNotFoundError:
        raise MissingExtraError("OpenCV", "camera", "the camera") from None
    return cv2
