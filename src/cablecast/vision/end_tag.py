"""The endpoint's track by a tag that lies flat on the cable's free end."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.camera.lens import CameraView
from cablecast.camera.settings import CameraSettings
from cablecast.camera.tags import EndTag
from cablecast.vision.tags import detect_tags
from cablecast.vision.tracker import EndpointTracker, Grab, TrackerConfig
from cablecast.workspace import Workspace

_SIZE_SHARE = 0.75
"""Smallest ratio between the side of the tag and that of one which may be it: dictionaries of few
cells are read into other things."""
_LOOK = 0.25
"""Distance from where it was seen last within which the tag is looked for first [m]."""


class TagTracker(EndpointTracker):
    """Follows a tag through the frames of one trial; its centre is the endpoint.

    A frame in which the tag is blurred by more than a cell, or covered, gives no point.
    """

    def __init__(self, view: CameraView, workspace: Workspace, tag: EndTag, config: TrackerConfig):
        super().__init__(view, workspace, config)
        self._tag = tag
        self._turns: list[float] = []

    @property
    def turns(self) -> NDArray[np.float64]:
        """Turn of the tag since it was seen first, clockwise from above [rad], shape [frame].

        NaN in frames that do not show it.
        """
        turns = np.array(self._turns)
        seen = np.isfinite(turns)
        unwrapped = np.unwrap(turns[seen])
        turns[seen] = unwrapped - unwrapped[:1]
        return turns

    def update(self, time: float, grab: Grab) -> NDArray[np.float64]:
        """Look at the next frame, and return the endpoint in it [m], shape [2]; NaN if not seen."""
        self._begin_frame(time)
        windows = [self._frame]
        if self._seen:
            half = (_LOOK + self._tag.size) * self._px_per_m
            near = self._around(self._seen[-1].pixel, half)
            if near[2] - near[0] > 16 and near[3] - near[1] > 16:
                windows.insert(0, near)
        found = (self._find(grab(window), window[:2]) for window in windows)
        pixel, turn = next((one for one in found if one is not None), (None, np.nan))
        self._turns.append(turn)
        return self._record(time, pixel)

    def _find(
        self, image: NDArray[np.uint8], corner: ArrayLike
    ) -> tuple[NDArray[np.float64], float] | None:
        """Return centre [px] and direction [rad] of the tag in a piece of the frame, or None.

        Args:
            image: The piece.
            corner: Its left upper corner u, v [px].
        """
        quad = detect_tags(image, self._tag.family).get(self._tag.id)
        if quad is None:
            return None
        quad = quad + np.asarray(corner)
        places = self.view.to_table(quad, self.config.marker_z)
        sides = np.linalg.norm(np.roll(places, -1, axis=0) - places, axis=1)
        share = float(np.mean(sides)) / self._tag.size
        if not _SIZE_SHARE < share < 1.0 / _SIZE_SHARE:
            return None
        # Where the diagonals meet: the centre, also in perspective.
        (a, b, c, d) = quad
        share = np.linalg.solve(np.stack([c - a, b - d], axis=-1), b - a)[0]
        x, y = places[0] - places[3]
        return a + share * (c - a), float(np.arctan2(x, y))


def make_tracker(
    view: CameraView,
    workspace: Workspace,
    cable: Cable,
    settings: CameraSettings | None,
    config: TrackerConfig,
    start_xy: ArrayLike,
) -> EndpointTracker:
    """Return the tracker of the tag that a lab file names, or else of the marker."""
    tag = None if settings is None else settings.end_tag
    if tag is None:
        return EndpointTracker(view, workspace, config, start_xy)
    height = 2.0 * cable.radius if tag.height is None else tag.height
    config = dataclasses.replace(config, marker_z=height)
    return TagTracker(view, workspace, tag, config)
