"""Blind places: where the tracker cannot tell the marker from other green things."""

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.sight import BLIND_COUNT_MAX, CameraSight
from cablecast.tracking.tracker import EndpointTracker


def sight_of(tracker: EndpointTracker) -> CameraSight:
    """Return what the camera of a tracker cannot see.

    Args:
        tracker: Tracker; one that has not seen a frame knows of no blind places.
    """
    places = sorted(blind_places(tracker).tolist(), key=lambda place: -place[2])
    return CameraSight(
        position=tracker.view.position,
        blind=tuple((x, y, radius) for x, y, radius in places[:BLIND_COUNT_MAX]),
    )


def blind_places(tracker: EndpointTracker) -> NDArray[np.float64]:
    """Return circles around the green things that a tracker saw on the table in its first picture.

    Args:
        tracker: Tracker.

    Returns:
        x, y and radius [m], shape [place, 3].
    """
    from scipy.ndimage import find_objects, label

    if tracker.still_green is None:
        return np.empty((0, 3))
    labels, _ = label(tracker.still_green)  # pyright: ignore[reportGeneralTypeIssues]
    half = tracker.config.marker.length / 2
    places = []
    for window in find_objects(labels):
        rows, columns = window
        corners = [(columns.start, rows.start), (columns.stop, rows.stop)]
        a, b = tracker.view.to_table(np.array(corners, dtype=float))
        # A circle of the box's area, and what of the marker reaches into it.
        radius = np.sqrt(abs((b[0] - a[0]) * (b[1] - a[1])) / np.pi) + half
        if tracker.workspace.on_table((a + b) / 2):
            places.append([*((a + b) / 2), radius])
    return np.array(places).reshape(-1, 3)
