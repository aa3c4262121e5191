"""Picture of a check: tags, the table's edges and axes drawn into what the camera saw."""

import itertools

import numpy as np

from cablecast.camera.lens import CameraView
from cablecast.filming.check import CameraReport
from cablecast.tracking.opencv import load_cv2
from cablecast.tracking.tags import detect_tags
from cablecast.workspace import Workspace

_SEEN, _REFUSED, _EDGE, _AXIS = (60, 170, 0), (0, 0, 220), (200, 120, 0), (160, 0, 160)


def draw_report(report: CameraReport, workspace: Workspace) -> bytes:
    """Return the last picture of a check as PNG, with what was found in it.

    Args:
        report: Report with its picture.
        workspace: Gives the table's edges.
    """
    cv2 = load_cv2()
    image = report.image.copy()
    rejected = () if report.calibration is None else report.calibration.rejected_ids
    for tag_id, quad in detect_tags(image).items():
        colour = _REFUSED if tag_id in rejected else _SEEN
        cv2.polylines(image, [np.round(quad).astype(np.int32)], True, colour, 2, cv2.LINE_AA)
        u, v = np.round(quad.max(axis=0)).astype(int).tolist()
        cv2.putText(image, str(tag_id), (u, v), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 2)
    if report.calibration is not None:
        view, w = report.calibration.view, workspace
        x, low, high = w.half_width, w.y_min, w.y_max
        _line(image, view, [(-x, low), (x, low), (x, high), (-x, high), (-x, low)], _EDGE)
        _line(image, view, [(0.0, low), (0.0, high)], _AXIS)
        _line(image, view, [(-x, w.reset_y), (x, w.reset_y)], _AXIS)
        turn = np.linspace(0.0, 2.0 * np.pi, 24)
        for x, y, radius in report.green:
            circle = np.column_stack([x + radius * np.cos(turn), y + radius * np.sin(turn)])
            _line(image, view, [(a, b) for a, b in circle.tolist()], _REFUSED)
    return cv2.imencode(".png", image)[1].tobytes()


def _line(
    image: np.ndarray,
    view: CameraView,
    corners: list[tuple[float, float]],
    colour: tuple[int, int, int],
) -> None:
    """Draw a line over the table, bent as the lens bends it."""
    cv2 = load_cv2()
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        share = np.linspace(0.0, 1.0, 40)
        points = np.column_stack([x0 + share * (x1 - x0), y0 + share * (y1 - y0), 0 * share])
        pixels = view.to_image(points)
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        cv2.polylines(image, [np.round(pixels).astype(np.int32)], False, colour, 2, cv2.LINE_AA)
