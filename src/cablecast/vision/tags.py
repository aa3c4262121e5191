"""OpenCV, imported when it is needed, and fiducial tags: drawn to print, found in an image."""

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import MissingExtraError


def load_cv2() -> Any:
    """Return the cv2 module, which prints nothing about damaged videos.

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


def to_grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a grey or BGR picture in grey, shape [v, u]."""
    cv2 = load_cv2()
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def tag_picture(tag_id: int, cell: int = 40) -> NDArray[np.uint8]:
    """Draw a tag with its white rim: ten by ten cells [px], of which eight are the black square."""
    cv2 = load_cv2()
    square = cv2.aruco.generateImageMarker(_dictionary(), tag_id, 8 * cell)
    return np.pad(square, cell, constant_values=255)


def detect_tags(image: NDArray[np.uint8]) -> dict[int, NDArray[np.float64]]:
    """Return the tags in a grey or BGR image by their numbers.

    Returns:
        Corners of each, clockwise from its upper left [px], shape [4, 2].
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
    corners, ids, _ = detector.detectMarkers(to_grey(image))
    if ids is None:
        return {}
    numbers = ids.ravel().tolist()
    # A tag that is seen twice has no single place.
    return {
        tag_id: quad.reshape(4, 2).astype(np.float64)
        for tag_id, quad in zip(numbers, corners, strict=True)
        if numbers.count(tag_id) == 1
    }


def _dictionary():
    cv2 = load_cv2()
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
