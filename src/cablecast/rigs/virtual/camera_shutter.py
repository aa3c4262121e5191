"""Rolling shutter of the virtual camera: each row of a frame is exposed a little later."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cablecast.rigs.virtual.camera_drawing import Drawing

_BAND_ROWS = 12
"""Rows that are drawn as of one instant [px]: at 15 us a row and 5 m/s, half of them are 0.5 mm."""


class RollingDrawing:
    """Everything that moves in one frame, drawn band by band at the bands' own times.

    Args:
        draw: Makes the drawing of an instant, given the middle of its exposure [s].
        time: Middle of the exposure of the frame's middle row [s].
        row_time: Time by which each row is exposed later than the one above it [s].
        height: Height of the frame [px].
    """

    def __init__(self, draw: Callable[[float], Drawing], time: float, row_time: float, height: int):
        self._draw = draw
        self._time = time
        self._row_time = row_time
        self._height = height
        self._bands: dict[int, Drawing] = {}

    def paint(
        self, canvas: NDArray[np.uint8], corner: tuple[int, int], on_table: NDArray[np.bool_]
    ) -> None:
        """Draw into a piece of the background; see `Drawing.paint`."""
        bottom = corner[1] + len(canvas)
        for band in range(corner[1] // _BAND_ROWS, -(-bottom // _BAND_ROWS)):
            first = max(band * _BAND_ROWS, corner[1])
            rows = slice(first - corner[1], min((band + 1) * _BAND_ROWS, bottom) - corner[1])
            self._band(band).paint(canvas[rows], (corner[0], first), on_table[rows])

    def _band(self, band: int) -> Drawing:
        """Return the drawing of a band."""
        if band not in self._bands:
            middle = (band + 0.5) * _BAND_ROWS - 0.5
            later = self._row_time * (middle - (self._height - 1) / 2)
            self._bands[band] = self._draw(self._time + later)
        return self._bands[band]
