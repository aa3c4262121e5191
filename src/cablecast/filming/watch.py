"""FrameWatch: tells a camera that sees from one that is frozen, dark, or exposed anew.

A picture of a real sensor never repeats itself exactly, for its noise is new in every frame.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import CameraError
from cablecast.filming.live import Frame

_STRIDE = 8
"""Distance of the pixels that are compared [px]."""
_SAME_MAX = 4
"""Most frames in a row that may be equal: a driver may repeat a late one."""
_DARK_MAX = 12.0
"""Mean brightness, of 255, below which a picture shows nothing."""
_EXPOSURE_CHANGE = 1.45
"""Factor of brightness that daylight and lamps stay below in a session, and an exposure that was
set anew exceeds."""
_SHADE = 0.2
"""Share of the pixels that are darker than the one by which brightness is judged: white table may
be saturated, the floor and the tags' ink are not."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Brightness:
    """Brightness of a picture.

    Attributes:
        mean: Mean of all pixels, of 255.
        shade: Brightness of its darker parts, of 255.
        clipped: Share of the pixels that are saturated [-].
    """

    mean: float
    shade: float
    clipped: float

    @classmethod
    def of(cls, image: NDArray[np.uint8]) -> "Brightness":
        """Return the brightness of a picture, BGR, shape [v, u, 3]."""
        grey = image[::_STRIDE, ::_STRIDE].mean(axis=-1)
        return cls(
            mean=float(grey.mean()),
            shade=float(np.quantile(grey, _SHADE)),
            clipped=float(np.mean(grey >= 254.0)),
        )


class FrameWatch:
    """Looks at each frame for a camera that no longer sees.

    Args:
        source: Name of the camera in errors.
        usual: Brightness at the time of the calibration; not compared where None.
    """

    def __init__(self, source: str, usual: Brightness | None = None):
        self._source = source
        self._usual = usual
        self._last: NDArray[np.uint8] | None = None
        self._same_count = 0

    def look(self, frame: Frame) -> None:
        """Look at the next frame.

        Args:
            frame: Frame that follows the last.

        Raises:
            CameraError: The camera is frozen, dark, or was exposed anew; says what to do.
        """
        some = frame.image[::_STRIDE, ::_STRIDE]
        same = self._last is not None and np.array_equal(some, self._last)
        self._same_count = self._same_count + 1 if same else 0
        self._last = some
        where = f"camera source {self._source}"
        if self._same_count >= _SAME_MAX:
            raise CameraError(
                f"{where} is frozen: {self._same_count + 1} frames in a row are equal to the last "
                "bit. Plug it out and in again, and repeat the trial"
            )
        now = Brightness.of(frame.image)
        if now.mean < _DARK_MAX:
            raise CameraError(
                f"{where} is dark: its mean brightness is {now.mean:.0f} of 255. Switch on the "
                "light, take off the lens cap, and repeat the trial"
            )
        if self._usual is None:
            return
        change = now.shade / max(self._usual.shade, 1.0)
        if not 1 / _EXPOSURE_CHANGE < change < _EXPOSURE_CHANGE:
            raise CameraError(
                f"{where} is {change:.2f} times as bright as when it was calibrated: the light or "
                "the exposure has changed. Switch automatic exposure off, and start anew"
            )
