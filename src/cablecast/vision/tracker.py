"""The endpoint's track: the marker in every frame, near where it is expected or anywhere.

The marker is recognised and located by its chroma along its own hue: for green that is
2 G - R - B. In it a motion blur over grey ground changes nothing but the spread: the sum over the
patch stays, and so does the centroid, which is the marker's place in the middle of the exposure.

Light is taken out first. The table counts as grey, so that a colour cast does not change a hue; and
each frame is brought to the brightness and colour of the first one by what lies about the marker
and does not move. What had the marker's colour in the first frame is subtracted. Nothing is made
up: a frame in which the marker is not seen, or not enough of it, gives NaN.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.camera.lens import CameraView
from cablecast.camera.settings import BLIND_COUNT_MAX, MARKER_HUE, CameraSight
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.errors import InputError
from cablecast.vision.tags import load_cv2
from cablecast.workspace import Workspace

Window = tuple[int, int, int, int]
"""A piece of a frame: left, top, right, bottom [px], the last two excluded."""
Grab = Callable[[Window], NDArray[np.uint8]]
"""Function that returns a piece of the current frame, BGR."""

_HUE_FIRST_DEG, _HUE_DEG = 45.0, 30.0
"""Largest distance of the marker's hue in the first frame from what it is said to be, and of later
hues from that one [deg]: tape and tape, lamp and lamp differ."""
_HUE_APART_DEG, _HUE_APART_MIN = 20.0, 12.0
"""Least difference between the hues of marker and cable that is asked for, and from which on they
are told apart [deg]: drawn ones are followed in every frame from 13 on, and picked from 20 on."""
_HUE_BIN_DEG, _HUE_PIXELS = 4, 20
"""Width of the bins in which the hues of a piece are counted [deg], and fewest pixels of one."""
_HUE_AKIN_DEG = 60.0
"""Distance from the marker's hue within which a thing's chroma along it counts [deg]."""
_NOISE_FACTOR = 3.5
"""Least chroma of the marker's pixels, in standard deviations of that of the table about it."""
_CHROMA_MIN, _VIVID_MIN = 10.0, 25.0
"""Least chroma of a pixel, and of a marker's vivid parts, where there is almost no noise."""
_CLIPPED, _DARK = 250, 20
"""Values of pixels from which on, and below which, they tell little about the light."""
_FAIR_MIN = 0.3
"""Share of pixels between these two that suffices to tell the light."""
_GAIN_MIN, _GAIN_MAX = 0.1, 10.0
"""Brightness of a frame as a multiple of the first one's, beyond which nothing is seen in it."""
_GAIN_BIN, _GAIN_NEAR = 0.03, 0.08
"""Width of the bins of the logarithm of brightness, and of the peak in it that is unmoved table."""
_TINT_RATE = 1.0
"""Fastest change of the light's colour, in its logarithm [1/s]."""
_PICK_RADIUS, _PICK_AREA, _PICK_BLUR = 0.15, (0.5e-4, 60e-4), 1.3
"""Distance from where a marker is said to lie within which it is looked for [m], its area [m²], and
the variance that lens and pixels add to it [px²]."""
_SAMPLE_COUNT = 3_000
"""Pixels of a piece from which its light and its noise are found."""
_SHARE_MIN, _SHARE_MAX = 0.75, 1.6
_SHARE_BANDS, _SHARE_ROUGH = 0.6, 2.4
"""Chroma of a patch that may be the marker, as a multiple of the marker's own: least and most; and
least among the bands of a rolling shutter, most there or where white is saturated. With less of it
in sight its centroid is not its middle."""
_BAND_MIN = 0.2
"""Range of the logarithm of brightness over the rows of a piece from which on there are bands."""
_AREA_MIN, _AREA_ROUGH = 0.88, 0.12
"""Share of the marker's area that must be seen while it barely moves, and how much less where the
light is known roughly."""
_GRID = 1.0
"""Change of the marker's seen width by the grid of pixels and the compression of colours [px]: its
area in compressed frames changed by up to 13, 11 and 4 % where it was 6, 8 and 12 px wide."""
_BLUR_SMALL = 4.0
"""Length of a trace below which the marker looks as it does at rest [px]."""
_SPEED_MAX, _ACCELERATION_MAX = 15.0, 400.0
"""Largest speed [m/s] and acceleration [m/s²] of the endpoint."""
_SCALE_MAX = 5.0
"""Largest scale of the picture at a place of the table over that at its centre, or under it [-]."""
_SEARCH_PERIOD = 3
"""Frames between searches of the whole image while the marker is lost; between them it is searched
where it was expected."""
_SAMPLE_DT = 0.1
"""Time between samples of the track [s], as in the paper's camera analysis."""
_EDGE_TOLERANCE = 0.005
"""Distance beyond the table's edge at which an endpoint is off the table [m]."""
_REST_TIME, _REST_DISTANCE, _REST_FRAMES = 0.15, 0.005, 3
"""An endpoint that was seen in so many of the last frames [s], all this near to each other [m],
rests there, whether or not the very last one shows it."""
_BRINK = 0.03
"""Distance from the table's left, right or far edge within which what vanishes fell over it [m]."""


def grab_of(image: NDArray[np.uint8]) -> Grab:
    """Return the function that returns pieces of a frame which is there whole."""
    return lambda window: image[window[1] : window[3], window[0] : window[2]]


@dataclasses.dataclass(frozen=True, kw_only=True)
class MarkerConfig:
    """Size and colour of the marker.

    Attributes:
        length: Length of the marker along the cable [m].
        width: Width of the marker across the cable [m].
        hue: Hue of the marker on a table that counts as grey [deg].
    """

    length: float = 0.038
    width: float = 0.016
    hue: float = MARKER_HUE

    @property
    def area(self) -> float:
        """Area of the marker seen from above, round at both ends [m²]."""
        straight = max(self.length - self.width, 0.0)
        return straight * self.width + np.pi / 4 * self.width**2


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Patch:
    """A patch of the marker's colour.

    Attributes:
        pixel: Centroid, weighted by chroma [px], shape [2].
        chroma: Sum of the chroma over the patch, in the light of the first frame.
        vivid: Chroma of its most vivid parts.
        area: Area at that chroma, which does not depend on the light, as long as the patch is not
            blurred [px²].
        hue_off: Mean hue, from the one that is looked for [deg].
        extent: Standard deviation of the chroma along the longer and the shorter axis [px].
        box: Window that holds it.
        touches_edge: Whether it reaches the edge of the piece of image that was searched.
    """

    pixel: NDArray[np.float64]
    chroma: float
    vivid: float
    area: float
    hue_off: float
    extent: tuple[float, float]
    box: Window
    touches_edge: bool


def _stride(image: NDArray[np.generic]) -> int:
    """Return every which row and column of a picture makes a sample of it."""
    return max(1, int(np.sqrt(image.shape[0] * image.shape[1] / _SAMPLE_COUNT)))


def table_light(
    image: NDArray[np.uint8], view: CameraView, workspace: Workspace
) -> NDArray[np.float64]:
    """Return the colour of the light, blue, green and red about 1 [-], by the table as grey."""
    stride = _stride(image)
    v, u = np.mgrid[0 : image.shape[0] : stride, 0 : image.shape[1] : stride]
    on_table = workspace.on_table(view.to_table(np.stack([u, v], axis=-1).astype(float)))
    pixels = load_cv2().blur(image, (3, 3))[::stride, ::stride].astype(float)
    fair = (pixels < _CLIPPED).all(axis=-1) & (pixels > _DARK).all(axis=-1)
    # Where the table is saturated, what lies about it must do.
    seen = fair & on_table
    if seen.sum() < _FAIR_MIN / 6 * on_table.sum():
        seen = fair
    colour = np.median(pixels[seen], axis=0) if seen.any() else np.ones(3)
    return colour / colour.mean()


def chroma_axes(hue_deg: float) -> NDArray[np.float64]:
    """Return the weights of blue, green and red that give the chroma along and across a hue.

    Grey has none of either. Along a hue of 120 degrees it is 2 G - R - B. Shape [2, 3].
    """
    angle = np.radians(hue_deg - np.array([240.0, 120.0, 0.0]))
    return 2.0 * np.stack([np.cos(angle), -np.sin(angle)])


def hue_apart(hue_deg: float, other_deg: float) -> float:
    """Return by how much a hue lies ahead of another one [deg], in [-180, 180)."""
    return (hue_deg - other_deg + 180.0) % 360.0 - 180.0


class Chroma(NamedTuple):
    """Chroma of each pixel of a picture, shape [v, u].

    Attributes:
        seen: Chroma by which a marker is seen: that along its hue, or along the nearest one in
            which the cable beside it has none, so that both may have nearly the same hue.
        along: Chroma along the marker's hue.
        across: Chroma across the marker's hue.
        noise: Standard deviation of the first.
    """

    seen: NDArray[np.float32]
    along: NDArray[np.float32]
    across: NDArray[np.float32]
    noise: float

    @classmethod
    def of(
        cls,
        image: NDArray[np.floating | np.uint8],
        hue_deg: float,
        light: NDArray[np.float64] | float = 1.0,
        cable_deg: float | None = None,
    ) -> "Chroma":
        """Return the chroma of a picture in a light whose colour is that of `table_light`."""
        weights, apart = chroma_axes(hue_deg), hue_apart(hue_deg, cable_deg or 0.0)
        if cable_deg is not None and _HUE_APART_MIN < abs(apart) < 90.0:
            seen = chroma_axes(cable_deg + float(np.copysign(90.0, apart)))[:1]
            weights = np.concatenate([seen, weights])
        both = load_cv2().transform(image.astype(np.float32), (weights / light).astype(np.float32))
        seen, along, across = both[..., 0], both[..., -2], both[..., -1]
        stride = _stride(both)
        # A saturated channel spreads the table, which is no noise.
        fair = (image[::stride, ::stride] < _CLIPPED).all(axis=-1)
        sample = seen[::stride, ::stride]
        sample = sample[fair] if fair.mean() > _FAIR_MIN / 3 else sample
        # Of most pixels, whatever the others are.
        noise = 1.4826 * float(np.median(np.abs(sample - np.median(sample))))
        return cls(seen, along, across, noise)

    @property
    def least(self) -> float:
        """Least chroma of the marker's pixels."""
        return max(_NOISE_FACTOR * self.noise, _CHROMA_MIN)

    def mask(self, hue_tolerance: float) -> NDArray[np.uint8]:
        """Return 255 at pixels of the hue within a tolerance [deg] and next to them, else 0."""
        cv2 = load_cv2()
        mask = (self.seen > self.least).astype(np.uint8) * np.uint8(255)
        if not mask.any():
            return mask
        aside = np.float32(np.tan(np.radians(hue_tolerance))) * self.along
        mask[np.abs(self.across) > aside + np.float32(_NOISE_FACTOR * self.noise)] = 0
        # Noise makes single coloured pixels on dark ground; a blurred marker has holes.
        mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
        return cv2.dilate(mask, np.ones((5, 5), np.uint8))


def hues_of(
    image: NDArray[np.floating | np.uint8], light: NDArray[np.float64] | float = 1.0
) -> list[float]:
    """Return the hues of the coloured things in a piece of a picture, most common first [deg]."""
    chroma = Chroma.of(image, 0.0, light)
    vivid = np.hypot(chroma.along, chroma.across) > max(1.5 * chroma.least, _VIVID_MIN)
    if not vivid.any():
        return []
    hues = np.degrees(np.arctan2(chroma.across[vivid], chroma.along[vivid])) % 360.0
    count = np.bincount((hues / _HUE_BIN_DEG).astype(int), minlength=360 // _HUE_BIN_DEG)
    smooth = np.convolve(np.pad(count, 2, mode="wrap"), [1.0, 2.0, 3.0, 2.0, 1.0], mode="valid") / 3
    higher = np.maximum(np.roll(smooth, 1), np.roll(smooth, -1))
    peaks = np.flatnonzero((smooth >= higher) & (smooth > _HUE_PIXELS))
    peaks = peaks[np.argsort(-smooth[peaks])]
    near = ((hues - _HUE_BIN_DEG * (peaks[:, None] + 0.5) + 180.0) % 360.0) - 180.0
    within = np.abs(near) < 2 * _HUE_BIN_DEG
    middles = _HUE_BIN_DEG * (peaks + 0.5) + (near * within).sum(axis=1) / within.sum(axis=1)
    return [float(hue) % 360.0 for hue in middles]


def _find_patches(
    seen: Chroma, still: NDArray[np.float32] | None, hue_tolerance: float, corner: tuple[int, int]
) -> list[_Patch]:
    """Return all patches of the marker's colour in a piece of a frame, by its corner u, v [px].

    The chroma that was there in the first frame is subtracted.
    """
    cv2 = load_cv2()
    new = seen.seen if still is None else seen.seen - still
    along = new if seen.seen is seen.along else seen.along
    mask = seen._replace(seen=new, along=along).mask(hue_tolerance)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    height, width = mask.shape
    patches = []
    for label in range(1, count):
        left, top, w, h, area = (int(value) for value in stats[label])
        if area < 20:
            continue
        window = slice(top, top + h), slice(left, left + w)
        inside = (labels[window] == label) & (new[window] > seen.least)
        chroma = np.where(inside, new[window], 0.0).astype(float)
        total = float(chroma.sum())
        moments = cv2.moments(chroma)
        middle = np.array([moments["m10"], moments["m01"]]) / total
        mixed = moments["mu11"]
        spread = np.array([[moments["mu20"], mixed], [mixed, moments["mu02"]]])
        small, large = np.sqrt(np.maximum(np.linalg.eigvalsh(spread / total), 0.0))
        vivid = float(np.quantile(chroma[chroma > 0], 0.85))
        aside = (seen.across[window] * chroma).sum() / (seen.along[window] * chroma).sum()
        patches.append(
            _Patch(
                pixel=middle + (left, top) + corner,
                chroma=total,
                vivid=vivid,
                area=total / vivid,
                hue_off=float(np.degrees(np.arctan(aside))),
                extent=(float(large), float(small)),
                box=(left + corner[0], top + corner[1], left + w + corner[0], top + h + corner[1]),
                touches_edge=left == 0 or top == 0 or left + w == width or top + h == height,
            )
        )
    return patches


class _Light:
    """Light of each frame, compared with that of the first one.

    Args:
        image: First frame, BGR, shape [v, u, 3].
        colour: Colour of its light.
        by_rows: Whether each row has a light of its own, as with a rolling shutter.
    """

    def __init__(self, image: NDArray[np.uint8], colour: NDArray[np.float64], by_rows: bool):
        self.first, self.colour = image, colour
        self._by_rows = by_rows
        self._rows = np.zeros(len(image))
        if by_rows:
            # The first frame has bands of its own, by which it would be compared with.
            grey = image[:, ::8].astype(np.float32).mean(axis=-1)
            self._rows = _row_medians(np.log(grey + 0.5))
            self._rows -= np.median(self._rows)
        self._tint, self._time, self.is_clipped = np.zeros(3), -np.inf, False
        self.has_bands = False

    def even(
        self, piece: NDArray[np.uint8], window: Window, time: float
    ) -> NDArray[np.float32] | None:
        """Return a piece of a frame as the first frame's light, made white, would show it.

        None where it is too dark or too bright to be compared.
        """
        left, top, right, bottom = window
        stride = _stride(piece)
        # Means of neighbours, since noise makes saturated pixels look as if they were not.
        now, then = (
            load_cv2().blur(part, (3, 3))[::stride, ::stride].astype(np.float32)
            for part in (piece, self.first[top:bottom, left:right])
        )
        fair = (then > _DARK).all(axis=-1)
        unclipped = fair & (now < _CLIPPED).all(axis=-1) & (then < _CLIPPED).all(axis=-1)
        self.is_clipped = bool((fair & ~unclipped).mean() > _FAIR_MIN / 3)
        if unclipped.mean() > _FAIR_MIN and not self._by_rows:
            fair = unclipped
        if fair.mean() < _FAIR_MIN / 3:
            return None
        change = np.log((now + 0.5) / (then + 0.5))
        grey = np.where(fair, change.mean(axis=-1), np.nan)
        rows = np.zeros(len(grey))
        if self._by_rows:
            rows = _row_medians(grey)
            self.has_bands = float(np.ptp(rows)) > _BAND_MIN
            grey = grey - rows[:, None]
        # What moved is some of the piece; the table is what changed alike.
        peak = _peak(grey[fair])
        alike = np.abs(grey - peak) < _GAIN_NEAR
        gain = float(np.median(grey[alike])) if alike.any() else peak
        # A saturated channel hides a colour: then it is the one that was seen last.
        plain, tint = alike & unclipped, self._tint
        if plain.mean() > _FAIR_MIN / 30:
            tint = np.median(change[plain], axis=0)
            tint = tint - tint.mean()
            if np.isfinite(self._time):
                most = _TINT_RATE * (time - self._time) + 0.005
                tint = np.clip(tint, self._tint - most, self._tint + most)
        self._tint, self._time = tint, time
        at = np.interp(np.arange(piece.shape[0]), stride * np.arange(len(rows)), rows) + gain
        if not np.log(_GAIN_MIN) < np.median(at) < np.log(_GAIN_MAX):
            return None
        brightness = np.exp(at + self._rows[top:bottom]).astype(np.float32)[:, None, None]
        return piece / (brightness * (np.exp(tint) * self.colour).astype(np.float32))


def _row_medians(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return medians of rows, smooth from row to row; NaN values do not count, shape [v]."""
    from scipy.ndimage import median_filter

    known = np.isfinite(values).sum(axis=1) > 4
    if not known.any():
        return np.zeros(len(values))
    medians = np.nanmedian(values[known], axis=1)
    at = np.arange(len(values))
    return median_filter(np.interp(at, at[known], medians), size=9, mode="nearest")


def _peak(values: NDArray[np.floating]) -> float:
    """Return where most of some values lie."""
    edge = np.log(_GAIN_MAX) + 1.0
    count, edges = np.histogram(values, np.arange(-edge, edge, _GAIN_BIN))
    smooth = np.convolve(count, [1.0, 2.0, 1.0], mode="same")
    return float(edges[int(smooth.argmax())] + _GAIN_BIN / 2)


def sample_path(
    times: NDArray[np.float64], xy: NDArray[np.float64], sample_times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return positions [m], shape [sample, 2], from those of the frames next to each.

    A sample that falls on a frame is that frame's. One between two frames lies on the line between
    them, and is NaN if either is NaN or they are more than two frames apart.
    """
    if not len(times):
        return np.full((len(sample_times), 2), np.nan)
    frame_dt = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    after = np.searchsorted(times, sample_times)
    gaps = np.diff(times, prepend=-np.inf, append=np.inf)[after]
    between = np.stack([np.interp(sample_times, times, column) for column in xy.T], axis=-1)
    between[gaps >= 1.5 * frame_dt] = np.nan
    # Not all pairs of a sample and a frame: a film may last an hour.
    sides = np.clip([after - 1, after], 0, len(times) - 1)
    apart = np.abs(times[sides] - sample_times)
    nearest = np.take_along_axis(sides, apart.argmin(axis=0)[None], axis=0)[0]
    is_on_frame = apart.min(axis=0) <= 0.05 * frame_dt + 1e-9
    return np.where(is_on_frame[:, None], xy[nearest], between)


def track_samples(
    times: NDArray[np.float64],
    xy: NDArray[np.float64],
    sample_times: NDArray[np.float64],
    workspace: Workspace,
) -> tuple[NDArray[np.float64], TrialStatus]:
    """Return the samples of a track [m], shape [sample, 2], and how its trial ended.

    No landing hangs on a single frame: where the last sample is missing, it is the place at which
    the endpoint rested in the frames before it.

    Args:
        times: Times of the frames, rising [s], shape [frame].
        xy: Positions in the frames, NaN where not seen [m], shape [frame, 2].
        sample_times: Times of the samples, rising [s], shape [sample].
        workspace: Gives the table's edges.
    """
    samples = sample_path(times, xy, sample_times)
    if len(samples) and np.isnan(samples[-1]).any():
        samples[-1] = _resting_place(times, xy, float(sample_times[-1]))
    return samples, trial_status(times, xy, samples, workspace)


def _resting_place(
    times: NDArray[np.float64], xy: NDArray[np.float64], end: float
) -> NDArray[np.float64]:
    """Return where the endpoint rested shortly before a time [m], NaN where it did not, [2]."""
    late = (times <= end) & (times >= end - _REST_TIME) & np.isfinite(xy).all(axis=1)
    if np.count_nonzero(late) < _REST_FRAMES or np.ptp(xy[late], axis=0).max() > _REST_DISTANCE:
        return np.full(2, np.nan)
    return np.median(xy[late], axis=0)


def trial_status(
    times: NDArray[np.float64],
    xy: NDArray[np.float64],
    endpoint_xy: NDArray[np.float64],
    workspace: Workspace,
) -> TrialStatus:
    """Return how a trial ended, from what was seen.

    Off the table is an endpoint that was seen last beyond the edge, on its way over it, or so near
    to it that nothing else can have hidden it: no arm reaches there. Occluded is any other that was
    not seen at the end. One that swept past the edge and came back has landed. Arguments are those
    of `track_samples`, and its samples [m], shape [sample, 2].
    """
    seen = np.flatnonzero(np.isfinite(xy).all(axis=1))
    if not len(seen):
        return TrialStatus.OCCLUDED
    last = xy[seen[-1]]
    # A point pulled towards the table by the tolerance must lie on it.
    centre = np.array([0.0, (workspace.y_min + workspace.y_max) / 2])
    if not workspace.on_table(last - np.clip(last - centre, -_EDGE_TOLERANCE, _EDGE_TOLERANCE)):
        return TrialStatus.OFF_TABLE
    if np.isfinite(endpoint_xy[-1]).all():
        return TrialStatus.OK
    # The near edge does not count: there the arm is in the way.
    to_edge = min(workspace.half_width - abs(last[0]), workspace.y_max - last[1])
    if to_edge < _BRINK:
        return TrialStatus.OFF_TABLE
    if len(seen) > 1 and seen[-1] < len(times) - 1:
        a, b = seen[-2:]
        velocity = (xy[b] - xy[a]) / (times[b] - times[a])
        # Two more frames at the speed at which it was seen last.
        ahead = last + velocity * 2 * (times[b + 1] - times[b])
        if not workspace.on_table(ahead):
            return TrialStatus.OFF_TABLE
    return TrialStatus.OCCLUDED


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrackerConfig:
    """Settings of the tracker.

    Attributes:
        marker: Size of the marker.
        marker_z: Height of the marker's middle above the table while it lies there [m].
        exposure_max: Longest exposure of a frame that is expected, which bounds the blur [s].
        start_radius: Largest distance of the first endpoint from where it is expected [m].
        row_time: Time by which each row is exposed later than the one above it [s]; 0 for a global
            shutter.
    """

    marker: MarkerConfig = dataclasses.field(default_factory=MarkerConfig)
    marker_z: float = 0.005
    exposure_max: float = 1 / 120
    start_radius: float = 0.15
    row_time: float = 0.0


@dataclasses.dataclass(frozen=True)
class _Seen:
    """The marker in one frame."""

    frame: int
    time: float
    pixel: NDArray[np.float64]


class EndpointTracker:
    """Follows the marker through the frames of one trial.

    Args:
        view: Calibrated camera.
        workspace: Gives the table's edges.
        config: Settings of the tracker.
        start_xy: Approximate endpoint in the first frame [m], shape [2], which separates the marker
            from other things of its colour; None where unknown.
    """

    def __init__(
        self,
        view: CameraView,
        workspace: Workspace,
        config: TrackerConfig | None = None,
        start_xy: ArrayLike | None = None,
    ):
        self.view = view
        self.workspace = workspace
        self.config = TrackerConfig() if config is None else config
        self._start_xy = None if start_xy is None else np.asarray(start_xy, dtype=float)
        self._seen: list[_Seen] = []
        self._times: list[float] = []
        self._frame_time = -np.inf
        self._xy: list[NDArray[np.float64]] = []
        self._chroma: float | None = None
        self._area = 0.0
        self._hue, self._hue_tolerance = self.config.marker.hue, _HUE_FIRST_DEG
        self._cable: float | None = None
        self._light: _Light | None = None
        self._still_chroma: NDArray[np.float32] | None = None
        # Pixels where something of the marker's colour lies that is not it, shape [v, u].
        self.still_green: NDArray[np.bool_] | None = None
        lens = view.lens
        self._frame: Window = (0, 0, lens.width, lens.height)
        centre = (0.0, (workspace.y_min + workspace.y_max) / 2)
        self._px_per_m = view.pixels_per_metre(centre, self.config.marker_z)
        marker = self.config.marker
        # Where a small marker lies on the grid of pixels changes its area by a pixel of its width.
        self._area_min = min(_AREA_MIN, 1.0 - _GRID / (marker.width * self._px_per_m))

    def update(self, time: float, grab: Grab) -> NDArray[np.float64]:
        """Look at the next frame, and return the endpoint in it [m], shape [2]; NaN if not seen.

        Args:
            time: Middle of the exposure of the frame's middle row [s]; must rise.
            grab: Returns pieces of the frame. The tracker asks for no more than it looks at.
        """
        self._begin_frame(time)
        frame, patch = len(self._times), None
        if not self._seen:
            if frame % _SEARCH_PERIOD == 0:
                patch = self._first(time, grab)
                if self._light is not None and (self._still_chroma is None or patch is not None):
                    self._look_at_still(self._light, patch)
        else:
            lost_count = frame - 1 - self._seen[-1].frame
            patch = self._near(time, lost_count, grab)
            if patch is None and lost_count % _SEARCH_PERIOD == 0:
                patch = self._anywhere(time, grab)
        xy = self._record(time, None if patch is None else patch.pixel)
        if patch is not None:
            self._adapt(patch)
        return xy

    def _begin_frame(self, time: float) -> None:
        """Refuse a frame that is not later than the one before."""
        if self._times and time <= self._frame_time:
            raise InputError(f"frame times must rise: {time} s follows {self._frame_time} s")
        self._frame_time = time

    def _record(self, time: float, pixel: NDArray[np.float64] | None) -> NDArray[np.float64]:
        """Keep where the endpoint was seen in the next frame, and return it [m], shape [2]."""
        xy = np.full(2, np.nan)
        if pixel is not None:
            xy = self.view.to_table(pixel, self.config.marker_z)
            self._seen.append(_Seen(len(self._times), time, pixel))
            # Rows below the middle one are exposed later.
            time += self.config.row_time * (float(pixel[1]) - (self._frame[3] - 1) / 2)
        # The row of one frame and that of the next may come close in time, but not change places.
        last = self._times[-1] if self._times else -np.inf
        self._times.append(max(time, float(np.nextafter(last, np.inf))))
        self._xy.append(xy)
        return xy

    def _adapt(self, patch: _Patch) -> None:
        """Adapt to how vivid and how large the marker is here and now."""
        if self._chroma is None:
            self._chroma, self._area = patch.chroma, patch.area
            return
        # What light and background leave of a change is slow against the frame rate.
        self._chroma += 0.2 * (patch.chroma - self._chroma)
        # The area at rest only grows, when what covered the marker has gone: an arm that creeps
        # over it must not make it believed smaller.
        if patch.area > self._area and self._blur_px < _BLUR_SMALL:
            self._area += 0.2 * (patch.area - self._area)

    @property
    def _velocity(self) -> NDArray[np.float64]:
        """Velocity of the marker in the picture when it was seen last [px/s], shape [2]."""
        if len(self._seen) < 2:
            return np.zeros(2)
        before, last = self._seen[-2:]
        return (last.pixel - before.pixel) / (last.time - before.time)

    @property
    def _blur_px(self) -> float:
        """Length of the marker's trace if it moves as it last did [px]."""
        return float(np.linalg.norm(self._velocity)) * self.config.exposure_max

    def track(self, duration: float | None = None, start: float = 0.0) -> EndpointTrack:
        """Return the track so far, one sample every 100 ms since the motion began.

        Args:
            duration: Time of the last sample [s]; by default that of the last frame.
            start: Time at which the motion began, in the clock of the frames [s].
        """
        times, xy = self.frames
        times = times - start
        if not len(times) or times[-1] < 0:
            raise InputError("there is no frame at or after the start of the motion")
        end = times[-1] if duration is None else duration
        count = int(np.floor(end / _SAMPLE_DT + 1e-6)) + 1
        sample_times = np.arange(count, dtype=np.float64) * _SAMPLE_DT
        endpoint_xy, status = track_samples(times, xy, sample_times, self.workspace)
        return EndpointTrack(times=sample_times, endpoint_xy=endpoint_xy, status=status)

    @property
    def frames(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Time of every frame [s], shape [frame], and the endpoint in it [m], shape [frame, 2].

        With a rolling shutter the time is that of the row in which the marker was seen.
        """
        return np.array(self._times), np.array(self._xy).reshape(-1, 2)

    def _first(self, time: float, grab: Grab) -> _Patch | None:
        """Return the marker in the first frame that shows it.

        Whatever else has its colour then lies still, and is no marker later either.
        """
        window, start_xy = self._frame, self._start_xy
        if start_xy is not None:
            reach = self.config.start_radius + self.config.marker.length
            about = np.array([[0, 0, 0], [-1, -1, 0], [-1, 1, 0], [1, -1, 0], [1, 1, 0]])
            centre = np.array([*start_xy, self.config.marker_z])
            pixels = self.view.to_image(centre + reach * about)
            window = self._around(pixels[0], float(np.abs(pixels[1:] - pixels[0]).max()))
        found = self._candidate(window, time, grab)
        if found is None and (even := self._even(window, time, grab)) is not None:
            # It may have run together with a cable of nearly its hue.
            for self._cable in hues_of(even):
                if (found := self._candidate(window, time, grab)) is not None:
                    break
            else:
                self._cable = None
        if found is not None:
            self._hue, self._hue_tolerance = self._hue + found.hue_off, _HUE_DEG
            if self._cable is None and (cable := self._hue_beside(found, time, grab)) is not None:
                self._cable = cable
                found = self._candidate(window, time, grab) or found
        return found

    def _candidate(self, window: Window, time: float, grab: Grab) -> _Patch | None:
        """Return what looks like the marker at first, by its hue to 30 or 45 degrees."""
        expected, first = self.config.marker.area * self._px_per_m**2, self._hue_tolerance
        for self._hue_tolerance in (_HUE_DEG, first):
            candidates = []
            for patch in self._patches(window, time, grab):
                if 0.85 < patch.area / expected < 1.6 and self._shaped(patch, blur_px=0.0):
                    # By size alone, the marker is the most vivid patch.
                    misfit = -patch.vivid
                    if self._start_xy is not None:
                        xy = self.view.to_table(patch.pixel, self.config.marker_z)
                        misfit = float(np.linalg.norm(xy - self._start_xy))
                        # While the arm hides the marker, another thing of its colour is not it.
                        if misfit > self.config.start_radius:
                            continue
                    candidates.append((misfit, patch))
            if candidates:
                return min(candidates, key=lambda pair: pair[0])[1]
        return None

    def _hue_beside(self, patch: _Patch, time: float, grab: Grab) -> float | None:
        """Return the hue of the cable at the marker's end [deg]; None where it is grey."""
        cv2, half = load_cv2(), 1.5 * self.config.marker.length * self._px_per_m
        window = self._around(patch.pixel, half)
        if (even := self._even(window, time, grab)) is None:
            return None
        chroma = Chroma.of(cv2.blur(even, (3, 3)), self._hue)
        mask = (np.hypot(chroma.along, chroma.across) > chroma.least).astype(np.uint8)
        labels = cv2.connectedComponents(mask)[1]
        left, top, right, bottom = np.subtract(patch.box, np.tile(window[:2], 2))
        inside = labels[top:bottom, left:right]
        beside = np.isin(labels, np.unique(inside[inside > 0]))
        beside[top:bottom, left:right] = False
        if beside.sum() < _HUE_PIXELS:
            return None
        off = np.arctan2(chroma.across[beside].sum(), chroma.along[beside].sum())
        return (self._hue + float(np.degrees(off))) % 360.0

    def _look_at_still(self, light: _Light, marker: _Patch | None) -> None:
        """Keep what has the marker's colour in the first frame, and is not the marker."""
        chroma = Chroma.of(light.first, self._hue, light.colour, self._cable)
        # What is barely of its hue would still be added to a marker beside it.
        akin, mask = (
            chroma.mask(tolerance) > 0 for tolerance in (_HUE_AKIN_DEG, self._hue_tolerance)
        )
        if marker is not None and self._still_chroma is None:
            left, top, right, bottom = marker.box
            akin[top:bottom, left:right] = mask[top:bottom, left:right] = False
        elif self._still_chroma is not None and self.still_green is not None:
            akin &= self._still_chroma > 0
            mask &= self.still_green
        self.still_green = mask
        still = load_cv2().blur(chroma.seen, (3, 3))
        self._still_chroma = np.where(akin, np.maximum(still, 1e-3), 0.0).astype(np.float32)

    def _near(self, time: float, lost_count: int, grab: Grab) -> _Patch | None:
        """Return the marker where it is expected, if it is there."""
        last, exposure = self._seen[-1], self.config.exposure_max
        centre, speed, radius = last.pixel, 0.0, 60.0
        # A long time after it was seen, it is where it was or anywhere.
        if lost_count <= 3:
            dt, velocity = time - last.time, self._velocity
            centre, speed = last.pixel + velocity * dt, float(np.linalg.norm(velocity))
            radius = 0.5 * _ACCELERATION_MAX * self._px_per_m * dt * dt + 0.35 * speed * dt
        half = self.config.marker.length * self._px_per_m + 10.0
        half += min(radius, 250.0) + speed * exposure / 2
        blur_px = min(2.0 * speed * exposure + 8.0, self._blur_max)
        window = self._around(centre, half)
        return self._choose(self._patches(window, time, grab), centre, half, window, blur_px)

    def _around(self, centre: NDArray[np.float64], half: float) -> Window:
        """Return the window of the frame about a place, which is empty beyond its edges [px]."""
        size = self._frame[2:]
        left, top = np.clip(np.floor(centre - half).astype(int), 0, size).tolist()
        high = np.ceil(centre + half).astype(int) + 1
        right, bottom = np.clip(high, (left, top), size).tolist()
        return left, top, right, bottom

    def _anywhere(self, time: float, grab: Grab) -> _Patch | None:
        """Return the marker from anywhere that it could have reached since it was seen."""
        last = self._seen[-1]
        reach = _SPEED_MAX * (time - last.time) * self._px_per_m + 40.0
        patches = self._patches(self._frame, time, grab)
        return self._choose(patches, last.pixel, reach, self._frame, self._blur_max)

    @property
    def _blur_max(self) -> float:
        """Longest trace of the marker in a frame [px]."""
        return _SPEED_MAX * self.config.exposure_max * self._px_per_m

    def _patches(self, window: Window, time: float, grab: Grab) -> list[_Patch]:
        """Return the patches of the marker's colour in a piece that do not lie on other ones."""
        if (even := self._even(window, time, grab)) is None:
            return []
        chroma = Chroma.of(even, self._hue, cable_deg=self._cable)
        left, top, right, bottom = window
        still = None
        if self._still_chroma is not None:
            still = self._still_chroma[top:bottom, left:right]
        patches = _find_patches(chroma, still, self._hue_tolerance, (left, top))
        least = max(_VIVID_MIN, 1.5 * chroma.least)
        green, last = self.still_green, np.array(self._frame[2:]) - 1
        if green is not None:
            at = [np.clip(np.round(patch.pixel).astype(int), 0, last) for patch in patches]
            patches = [patch for patch, (u, v) in zip(patches, at, strict=True) if not green[v, u]]
        return [self._as_amid_table(patch) for patch in patches if patch.vivid > least]

    def _as_amid_table(self, patch: _Patch) -> _Patch:
        """Return a patch as large as it would look at the table's centre.

        Seen at a slant, or near the edge of a wide lens, the same marker is smaller elsewhere.
        """
        z = self.config.marker_z
        place = self.view.to_table(patch.pixel, z)
        here = self.view.pixels_per_metre(place, z) if np.isfinite(place).all() else np.nan
        scale = self._px_per_m / here if here > 0.0 else np.nan
        # What is seen beyond the horizon, or nearly, is no marker on the table.
        if not 1.0 / _SCALE_MAX < scale < _SCALE_MAX:
            return patch
        return dataclasses.replace(
            patch,
            chroma=scale**2 * patch.chroma,
            area=scale**2 * patch.area,
            extent=(scale * patch.extent[0], scale * patch.extent[1]),
        )

    def _even(self, window: Window, time: float, grab: Grab) -> NDArray[np.float32] | None:
        """Return a piece as the first frame's light, made white, shows it; None if it is dark."""
        if self._light is None:
            first = grab(self._frame).copy()
            colour = table_light(first, self.view, self.workspace)
            self._light = _Light(first, colour, self.config.row_time > 0)
        piece = grab(window)
        return self._light.even(piece, window, time) if piece.size else None

    def _choose(
        self,
        patches: list[_Patch],
        centre: NDArray[np.float64],
        radius: float,
        window: Window,
        blur_px: float,
    ) -> _Patch | None:
        """Return the patch that looks most like the marker, if any does."""
        best, best_score = None, np.inf
        for patch in patches:
            share = patch.chroma / (self._chroma or patch.chroma)
            # Where white is saturated, the light is brighter than it seems, and bands show roughly.
            light = self._light
            rough = light is not None and (light.is_clipped or light.has_bands)
            low = _SHARE_BANDS if light is not None and light.has_bands else _SHARE_MIN
            if not low <= share <= (_SHARE_ROUGH if rough else _SHARE_MAX):
                continue
            # The share says little of a marker that is slowly covered: it changes with the light.
            moved = float(np.linalg.norm(patch.pixel - self._seen[-1].pixel))
            slow = self._blur_px < _BLUR_SMALL and moved < 2.0 * _BLUR_SMALL
            least = self._area_min - (_AREA_ROUGH if rough else 0.0)
            if slow and patch.area < least * self._area:
                continue
            # What the window cuts off may be the marker's other half.
            if patch.touches_edge and window != self._frame:
                continue
            if not self._shaped(patch, blur_px):
                continue
            distance = float(np.linalg.norm(patch.pixel - centre))
            if distance > radius:
                continue
            score = abs(np.log(share)) + distance / (radius + 1.0)
            score += abs(patch.hue_off) / self._hue_tolerance
            if score < best_score:
                best, best_score = patch, score
        return best

    def _shaped(self, patch: _Patch, blur_px: float) -> bool:
        """Return whether a patch is as large as the marker can look."""
        if abs(patch.hue_off) > self._hue_tolerance:
            return False
        # Deviation of an even bar is its length over the root of 12; a pixel more for the lens.
        length = self.config.marker.length * self._px_per_m
        longest = (length + blur_px) / np.sqrt(12.0) * 1.3 + 1.0
        widest = length / np.sqrt(12.0) * 1.15 + 1.0
        return patch.extent[0] <= longest and patch.extent[1] <= widest


def pick_marker(
    image: NDArray[np.uint8],
    view: CameraView,
    workspace: Workspace,
    at: ArrayLike,
    z: float = 0.0,
) -> MarkerConfig | None:
    """Return hue and size of the marker that lies at a place of the table in a picture.

    Args:
        image: Picture, BGR, shape [v, u, 3].
        view: Calibrated camera.
        workspace: Gives the table, which counts as grey.
        at: Place near the marker's middle [m], shape [2].
        z: Height of that place above the table [m].

    Returns:
        The marker; None where nothing is coloured.

    Raises:
        InputError: Nothing that is coloured there is of a marker's size.
    """
    place = np.asarray(at, dtype=float)
    light, px_per_m = table_light(image, view, workspace), view.pixels_per_metre(place, z)
    u, v = view.to_image(np.array([*place, z])).tolist()
    if not np.isfinite([u, v, px_per_m]).all():
        raise InputError(f"x, y = {place[0]:.2f}, {place[1]:.2f} m is not before the camera")
    half = _PICK_RADIUS * px_per_m
    left, top = max(int(u - half), 0), max(int(v - half), 0)
    piece = image[top : max(int(v + half), 0), left : max(int(u + half), 0)]
    if not piece.size or not (hues := hues_of(piece, light)):
        return None
    found: list[tuple[float, float, _Patch]] = []
    for hue in hues:
        apart = {cable: abs(hue_apart(hue, cable)) for cable in hues if cable != hue}
        # By what sets it off from the cable, or where nothing of nearly its hue lies about, as is.
        for cable in (*(c for c, away in apart.items() if _HUE_APART_MIN < away < 90.0), None):
            chroma = Chroma.of(piece, hue, light, cable)
            known = len(found)
            for patch in _find_patches(chroma, None, _HUE_DEG, (left, top)):
                area = patch.area / px_per_m**2
                fits = _PICK_AREA[0] < area < _PICK_AREA[1] and not patch.touches_edge
                if fits and patch.vivid > _VIVID_MIN and abs(patch.hue_off) < 2 * _HUE_BIN_DEG:
                    distance = float(np.linalg.norm(view.to_table(patch.pixel, z) - place))
                    found.append((distance, hue + patch.hue_off, patch))
            if len(found) > known:
                break
    if not found:
        raise InputError(
            f"all that is coloured within {100 * _PICK_RADIUS:.0f} cm of x, y = {place[0]:.2f}, "
            f"{place[1]:.2f} m has a hue of {hues[0]:.0f} deg, and none of it is of a marker's "
            f"size: if the cable has that hue, wrap tape of another that is at least "
            f"{_HUE_APART_DEG:g} deg away, best of {(hues[0] + 180) % 360:.0f} deg, around its end"
        )
    _, hue, patch = min(found, key=lambda row: row[0])
    # A bar with round ends, as wide as its variance says without that of lens and pixels.
    along, across = (max(extent**2 - _PICK_BLUR, 0.1) for extent in patch.extent)
    width_m = float(np.sqrt(13.0 * across)) / px_per_m
    length_m = float(np.sqrt(12.0 * along)) / px_per_m + 0.2 * width_m
    return MarkerConfig(length=max(length_m, width_m), width=width_m, hue=hue % 360.0)


def sight_of(tracker: EndpointTracker) -> CameraSight:
    """Return what the camera of a tracker cannot see; no blind places before its first frame."""
    mask, blind = tracker.still_green, np.empty((0, 3))
    if mask is not None:
        # Part of the marker reaches into what it lies beside.
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

    Returns:
        x, y and radius [m], shape [place, 3]: a circle of the area of the box about each.
    """
    from scipy.ndimage import find_objects, label

    labels, _ = label(mask)  # pyright: ignore[reportGeneralTypeIssues]
    places = []
    for rows, columns in find_objects(labels):
        left, right, top, bottom = columns.start, columns.stop, rows.start, rows.stop
        corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
        box = view.to_table(np.array(corners, dtype=float))
        centre, (a, b) = box.mean(axis=0), box[2:] - box[:2]
        # Twice the area is the cross product of the diagonals, however the camera is turned.
        radius = np.sqrt(abs(a[0] * b[1] - a[1] * b[0]) / (2.0 * np.pi))
        if workspace.on_table(centre):
            places.append([*centre, radius])
    places.sort(key=lambda place: -place[2])
    return np.array(places).reshape(-1, 3)
