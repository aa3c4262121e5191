"""Blind places: where the tracker cannot tell the marker from other green things."""

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.lens import CameraView
from cablecast.camera.sight import BLIND_COUNT_MAX, CameraSight
from cablecast.tracking.tracker import EndpointTracker
from cablecast.workspace import Workspace


def sight_of(tracker: EndpointTracker) -> CameraSight:
    """Return what the camera of a tracker cannot see.

    Args:
        tracker: Tracker; one that has not seen a frame knows of no blind places.
    """
    mask, blind = tracker.still_green, np.empty((0, 3))
    if mask is not None:
        # Some of the marker reaches into what it lies beside.
        half = tracker.config.marker.length / 2
        blind = green_places(mask, tracker.view, tracker.workspace) + [0.0, 0.0, half]
    return CameraSight(
        position=tracker.view.position,
        blind=tuple((x, y, radius) for x, y, radius in blind[:BLIND_COUNT_MAX].tolist()),
    )


def green_places(
    mask: NDArray[np.bool_], view: CameraView, workspace: Workspace
) -> NDArray[np.float64]:
    """Return circles around the green things on the table, the largest first.

    Args:
        mask: True where a pixel is green, shape [v, u].
        view: Calibrated camera.
        workspace: Gives the table's edges.

    Returns:
        x, y and radius [m], shape [place, 3]: a circle of the area of the box about each.
    """
    from scipy.ndimage import find_objects, label

    labels, _ = label(mask)  # pyright: ignore[reportGeneralTypeIssues]
    places = []
    for rows, columns in find_objects(labels):
        corners = [(columns.start, rows.start), (columns.stop, rows.stop)]
        a, b = view.to_table(np.array(corners, dtype=float))
        radius = np.sqrt(abs((b[0] - a[0]) * (b[1] - a[1])) / np.pi)
        if workspace.on_table((a + b) / 2):
            places.append([*((a + b) / 2), radius])
    places.sort(key=lambda place: -place[2])
    return np.array(places).reshape(-1, 3)
