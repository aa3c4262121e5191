"""OpenCV, imported when it is needed, and fiducial tags: drawn to print, found in an image."""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.tags import FAMILY, TAG_COUNTS
from cablecast.errors import MissingExtraError


def load_cv2() -> Any:
    """Return the cv2 module, which prints nothing about damaged videos."""
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


def tag_picture(tag_id: int, cell: int = 40, family: str = FAMILY) -> NDArray[np.uint8]:
    """Draw a tag with its white rim of one cell [px]; its black square has `tag_cells` cells."""
    cv2 = load_cv2()
    square = cv2.aruco.generateImageMarker(dictionary_of(family), tag_id, tag_cells(family) * cell)
    return np.pad(square, cell, constant_values=255)


def tag_cells(family: str) -> int:
    """Return the number of cells along a side of a family's black square."""
    return dictionary_of(family).markerSize + 2


def detect_tags(image: NDArray[np.uint8], family: str = FAMILY) -> dict[int, NDArray[np.float64]]:
    """Return the tags of a family in a grey or BGR image by their numbers.

    Returns:
        Corners of each, clockwise from its upper left [px], shape [4, 2].
    """
    cv2 = load_cv2()
    grey, parameters = to_grey(image), cv2.aruco.DetectorParameters()
    # OpenCV's default settings miss small tags; `tools/measure_tags.py` has the comparison.
    parameters.errorCorrectionRate = 0.9
    parameters.adaptiveThreshWinSizeStep = 4
    parameters.perspectiveRemovePixelPerCell = 5
    detector = cv2.aruco.ArucoDetector(dictionary_of(family), parameters)
    corners, ids, _ = detector.detectMarkers(grey)
    if ids is None:
        return {}
    numbers = ids.ravel().tolist()
    quads = _fit_edges(grey, np.reshape(corners, (-1, 4, 2)), tag_cells(family))
    # A tag that is seen twice has no single place.
    return {
        tag_id: quad
        for tag_id, quad in zip(numbers, quads, strict=True)
        if numbers.count(tag_id) == 1
    }


def family_seen(images: Sequence[NDArray[np.uint8]]) -> str | None:
    """Return the family of most tags in some pictures; None where fewer than four are seen."""
    counts = {f: sum(len(detect_tags(image, f)) for image in images) for f in TAG_COUNTS}
    # Dictionaries of one size begin alike: the smallest that has all the tags is named.
    best = max(counts, key=lambda f: (counts[f], -TAG_COUNTS[f]))
    return best if counts[best] >= 4 else None


def _fit_edges(
    grey: NDArray[np.uint8], corners: NDArray[np.floating], cell_count: int
) -> NDArray[np.float64]:
    """Return corners as the intersections of lines fitted to the black squares' edges [px].

    Args:
        grey: Picture, shape [v, u].
        corners: Corners as they were found, clockwise, shape [tag, 4, 2].
        cell_count: Number of cells along a side.

    Returns:
        Corners, shape [tag, 4, 2]; as they were found where no edges fit.
    """
    cv2 = load_cv2()
    quads = found = corners.astype(np.float64)
    picture, along = grey.astype(np.float32), np.linspace(0.12, 0.88, 12)
    for _ in range(2):
        sides = np.roll(quads, -1, axis=1) - quads
        lengths = np.linalg.norm(sides, axis=-1, keepdims=True)
        normals = np.stack([sides[..., 1], -sides[..., 0]], axis=-1) / lengths
        # Half the steps look into the black cell, half into the rim: no farther than these reach.
        reach = np.clip(0.8 / cell_count * lengths.min(axis=1, keepdims=True), 1.0, 4.0)
        steps = reach * np.linspace(-1.0, 1.0, 19)
        points = quads[:, :, None] + along[:, None] * sides[:, :, None]
        points = points[:, :, :, None] + steps[..., None, :, None] * normals[:, :, None, None]
        u, v = np.moveaxis(points.astype(np.float32), -1, 0).reshape(2, -1, 19)
        values = cv2.remap(picture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        slopes = np.diff(values.reshape(points.shape[:-1]), axis=-1)
        outwards = np.sign(slopes.sum(axis=(1, 2, 3), keepdims=True))
        weights = np.maximum(slopes * outwards, 0.0) ** 2 + 1e-9
        weight = weights.sum(axis=-1)
        middles = ((steps[..., 1:] + steps[..., :-1]) / 2)[..., None, :]
        offsets = (weights * middles).sum(axis=-1) / weight
        # A line through the edge's places, each with the weight of its contrast.
        total = weight.sum(axis=-1)
        centre = (weight * along).sum(axis=-1) / total
        arm = along - centre[..., None]
        mean = (weight * offsets).sum(axis=-1) / total
        slope = (weight * arm * offsets).sum(axis=-1) / (weight * arm * arm).sum(axis=-1)
        start = quads + normals * (mean - slope * centre)[..., None]
        ways = sides + normals * slope[..., None]
        before, way = np.roll(start, 1, axis=1), np.roll(ways, 1, axis=1)
        share = _cross(start - before, ways) / _cross(way, ways)
        quads = before + share[..., None] * way
        moved = np.linalg.norm(quads - found, axis=-1).max(axis=1)[:, None, None]
        quads = np.where(moved <= 1.5 * reach, quads, found)
    return quads


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def dictionary_of(family: str) -> Any:
    """Return OpenCV's dictionary of a family."""
    cv2 = load_cv2()
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{family}"))
