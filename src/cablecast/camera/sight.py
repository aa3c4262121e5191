"""CameraSight: what a camera over the table cannot see, as far as it is known before a cast."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.errors import InputError

BLIND_COUNT_MAX = 100
"""Most blind places of a camera."""
_DISTANCE_MAX = 100.0
_ANGLE_COUNT = 72


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraSight:
    """Place of a camera, and places on the table where it cannot tell the marker.

    Attributes:
        position: Place of the camera [m], shape [3].
        blind: x, y and radius [m] of circles in which a marker is not told from something else of
            its colour, shape [place, 3].

    Raises:
        InputError: A value is not finite or out of bounds, or the camera is not above the table.
    """

    position: tuple[float, float, float]
    blind: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self):
        position = np.asarray(self.position, dtype=float)
        if position.shape != (3,) or not np.all(np.abs(position) <= _DISTANCE_MAX):
            raise InputError(
                f"camera position {self.position} must be three numbers within {_DISTANCE_MAX:g} m"
            )
        if position[2] <= 0.0:
            raise InputError(f"camera height {position[2]:g} m: it must be above the table")
        if len(self.blind) > BLIND_COUNT_MAX:
            raise InputError(f"{len(self.blind)} blind places: at most {BLIND_COUNT_MAX}")
        for place in self.blind:
            values = np.asarray(place, dtype=float)
            if values.shape != (3,) or not np.all(np.abs(values) <= _DISTANCE_MAX):
                raise InputError(
                    f"blind place {place} must be x, y and a radius within {_DISTANCE_MAX:g} m"
                )
            if values[2] <= 0.0:
                raise InputError(f"radius {values[2]:g} m of a blind place must be above 0")

    def is_blind_at(self, xy: ArrayLike) -> NDArray[np.bool_]:
        """Return where the marker is not told from something else, shape [...].

        Args:
            xy: Places on the table [m], shape [..., 2].
        """
        places = np.asarray(xy, dtype=float)
        blind = np.zeros(places.shape[:-1], dtype=bool)
        for x, y, radius in self.blind:
            blind |= np.hypot(places[..., 0] - x, places[..., 1] - y) < radius
        return blind

    def seen_near(self, xy: ArrayLike, margin: float) -> NDArray[np.float64]:
        """Return the nearest place that no blind one reaches within a margin [m], shape [2].

        Args:
            xy: Place on the table [m], shape [2].
            margin: Distance to keep from blind places [m].
        """
        place, blind = np.asarray(xy, dtype=float), np.reshape(self.blind, (-1, 3))
        turn = np.linspace(0.0, 2.0 * np.pi, _ANGLE_COUNT, endpoint=False)
        ring = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        # Of a circle's edge, the point straight ahead is the nearest one.
        ahead = place - blind[:, :2]
        ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)
        edges = [
            (x, y) + (radius + margin) * np.vstack([to, ring])
            for (x, y, radius), to in zip(blind, ahead, strict=True)
        ]
        points = np.vstack([place, *edges])
        apart = np.linalg.norm(points[:, None] - blind[:, :2], axis=-1) - blind[:, 2]
        free = points[np.all(apart > margin - 1e-9, axis=1)]
        if not len(free):
            return place
        return free[np.argmin(np.linalg.norm(free - place, axis=1))]
