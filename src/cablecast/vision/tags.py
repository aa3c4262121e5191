"""OpenCV, imported when it is needed and not before.

Fiducial tags in pictures: drawing them to print, and finding them in an image.
"""

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

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


_PRINT_CELL = 40
"""Size of one of the ten cells of a printed tag with its white rim [px]."""


def tag_picture(tag_id: int, cell: int = _PRINT_CELL) -> NDArray[np.uint8]:
    """Draw a tag with its white rim: ten by ten cells, of which eight are the black square.

    Args:
        tag_id: Number of the tag.
        cell: Size of a cell [px].
    """
    cv2 = load_cv2()
    square = cv2.aruco.generateImageMarker(_dictionary(), tag_id, 8 * cell)
    return np.pad(square, cell, constant_values=255)


def detect_tags(image: NDArray[np.uint8]) -> dict[int, NDArray[np.float64]]:
    """Find tags in an image.

    Args:
        image: Grey or BGR.

    Returns:
        Corners of each tag by its number, clockwise from its upper left [px], shape [4, 2].
    """
    cv2 = load_cv2()
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    # The window grows with the tag, up to 6 px: at a tenth of a metre on 1080, 720 or 540 rows a
    # corner is then found to 0.24, 0.25 or 0.36 px, against 0.33, 0.89 or 0.82 with OpenCV's usual.
    parameters.cornerRefinementWinSize = 6
    parameters.relativeCornerRefinmentWinSize = 0.6
    parameters.cornerRefinementMaxIterations = 60
    parameters.cornerRefinementMinAccuracy = 0.005
    detector = cv2.aruco.ArucoDetector(_dictionary(), parameters)
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    corners, ids, _ = detector.detectMarkers(grey)
    if ids is None:
        return {}
    found: dict[int, NDArray[np.float64]] = {}
    doubled = set()
    for tag_id, quad in zip(ids.ravel().tolist(), corners, strict=True):
        if tag_id in found:
            doubled.add(tag_id)
        found[tag_id] = quad.reshape(4, 2).astype(np.float64)
    # A tag that is seen twice is not at one known place.
    return {tag_id: quad for tag_id, quad in found.items() if tag_id not in doubled}


def _dictionary():
    cv2 = load_cv2()
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
