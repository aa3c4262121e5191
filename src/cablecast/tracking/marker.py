"""Green patches of an image, one of which may be the marker.

A patch is found by thresholds in HSV. It is judged and located by its greenness, 2 G - R - B, in
which a motion blur over grey or white ground changes nothing but the spread: the sum over the patch
stays, and so does the centroid, which is the marker's place in the middle of the exposure.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.checks import check_ranges
from cablecast.tracking.opencv import load_cv2


@dataclasses.dataclass(frozen=True, kw_only=True)
class MarkerConfig:
    """Looks of the marker.

    Attributes:
        length: Length of the marker along the cable [m].
        width: Width of the marker across the cable [m].
        hue_deg: Hue on the colour wheel; green is 120 [deg].
        hue_tolerance_deg: Largest change of the hue by the light [deg].
        saturation_min: Smallest saturation of its pixels, of 255; low enough for a blurred one.
        value_min: Smallest brightness of its pixels, of 255.
        greenness_min: Smallest 2 G - R - B of its pixels.
        share_min: Share of the marker's greenness that must be seen; with less of it in sight its
            centroid is not its middle.
        area_min: Share of its area that must be seen while it hardly moves.
        share_max: Largest greenness of a patch that may be the marker, as a multiple of its own.
    """

    length: float = 0.038
    width: float = 0.016
    hue_deg: float = 122.0
    hue_tolerance_deg: float = 32.0
    saturation_min: int = 38
    value_min: int = 35
    greenness_min: float = 26.0
    share_min: float = 0.75
    area_min: float = 0.88
    share_max: float = 1.6

    def __post_init__(self):
        check_ranges(
            self,
            {
                "length": (0.002, 0.5, "m"),
                "width": (0.002, 0.5, "m"),
                "hue_deg": (0.0, 360.0, "deg"),
                "hue_tolerance_deg": (1.0, 90.0, "deg"),
                "saturation_min": (0, 255, ""),
                "value_min": (0, 255, ""),
                "greenness_min": (1.0, 500.0, ""),
                "share_min": (0.05, 1.0, ""),
                "area_min": (0.05, 1.0, ""),
                "share_max": (1.0, 20.0, ""),
            },
            "marker",
        )

    @property
    def area(self) -> float:
        """Area of the marker seen from above, round at both ends [m²]."""
        straight = max(self.length - self.width, 0.0)
        return straight * self.width + np.pi / 4 * self.width**2


@dataclasses.dataclass(frozen=True, kw_only=True)
class Patch:
    """A green patch of an image.

    Attributes:
        pixel: Centroid, weighted by greenness [px], shape [2].
        greenness: Sum of 2 G - R - B over the patch.
        area: Area at full greenness, which does not depend on the light, as long as the patch is
            not blurred [px²].
        hue_deg: Mean hue [deg].
        extent: Standard deviation of the greenness along the longer and the shorter axis [px].
        box: Left, top, right and bottom in the frame [px], the last two excluded.
        touches_edge: Whether it reaches the edge of the piece of image that was searched.
    """

    pixel: NDArray[np.float64]
    greenness: float
    area: float
    hue_deg: float
    extent: tuple[float, float]
    box: tuple[int, int, int, int]
    touches_edge: bool


def green_mask(image: NDArray[np.uint8], config: MarkerConfig) -> NDArray[np.uint8]:
    """Return 255 at pixels of the marker's colour and next to them, else 0, shape [v, u]."""
    cv2 = load_cv2()
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    # OpenCV halves hues, so that 360 degrees fit into a byte.
    low = max(round((config.hue_deg - config.hue_tolerance_deg) / 2), 0)
    high = min(round((config.hue_deg + config.hue_tolerance_deg) / 2), 179)
    mask = cv2.inRange(hsv, (low, config.saturation_min, config.value_min), (high, 255, 255))
    if not mask.any():
        return mask
    # Noise makes single green pixels on dark ground; a blurred marker has holes.
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    return cv2.dilate(mask, np.ones((5, 5), np.uint8))


def find_patches(
    image: NDArray[np.uint8], config: MarkerConfig, corner: tuple[int, int] = (0, 0)
) -> list[Patch]:
    """Return all patches of the marker's colour.

    Args:
        image: Piece of a frame, BGR, shape [v, u, 3].
        config: Looks of the marker.
        corner: Place of the piece's upper left pixel in the frame, u and v [px].
    """
    cv2 = load_cv2()
    if image.size == 0:
        return []
    mask = green_mask(image, config)
    if not mask.any():
        return []
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    height, width = mask.shape
    patches = []
    for label in range(1, count):
        left, top, w, h, area = (int(value) for value in stats[label])
        if area < 20:
            continue
        window = slice(top, top + h), slice(left, left + w)
        piece = image[window].astype(np.float32)
        inside = labels[window] == label
        greenness = 2.0 * piece[..., 1] - piece[..., 0] - piece[..., 2]
        greenness = np.where(inside & (greenness > config.greenness_min), greenness, 0.0)
        total = float(greenness.sum())
        if total <= 0:
            continue
        v, u = np.mgrid[top : top + h, left : left + w]
        mean_u, mean_v = float((greenness * u).sum() / total), float((greenness * v).sum() / total)
        du, dv = u - mean_u, v - mean_v
        spread = np.array(
            [
                [(greenness * du * du).sum(), (greenness * du * dv).sum()],
                [(greenness * du * dv).sum(), (greenness * dv * dv).sum()],
            ]
        )
        small, large = np.sqrt(np.maximum(np.linalg.eigvalsh(spread / total), 0.0))
        vivid = float(np.quantile(greenness[greenness > 0], 0.85))
        mean_colour = (piece * greenness[..., None]).sum(axis=(0, 1)) / total
        patches.append(
            Patch(
                pixel=np.array([mean_u + corner[0], mean_v + corner[1]]),
                greenness=total,
                area=total / vivid,
                hue_deg=_hue_deg(mean_colour),
                extent=(float(large), float(small)),
                box=(left + corner[0], top + corner[1], left + w + corner[0], top + h + corner[1]),
                touches_edge=left == 0 or top == 0 or left + w == width or top + h == height,
            )
        )
    return patches


def _hue_deg(bgr: NDArray[np.floating]) -> float:
    """Return the hue of a colour whose largest part is green [deg]."""
    blue, green, red = (float(value) for value in bgr)
    span = max(green - min(red, blue), 1e-6)
    return 120.0 + 60.0 * (blue - red) / span
