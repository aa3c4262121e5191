"""The endpoint's track: the marker in every frame, near where it is expected or anywhere.

Nothing is made up: a frame in which the marker is not seen, or not enough of it, gives NaN.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.camera.lens import CameraView
from cablecast.checks import check_count, check_ranges
from cablecast.errors import InputError
from cablecast.track import EndpointTrack
from cablecast.tracking.marker import MarkerConfig, Patch, find_patches, green_mask
from cablecast.tracking.samples import track_samples
from cablecast.workspace import Workspace

_GRID = 1.0
"""Change of the marker's seen width by the grid of pixels and the compression of colours [px]: its
area in compressed frames changed by up to 13, 11 and 4 % where it was 6, 8 and 12 px wide."""
Window = tuple[int, int, int, int]
"""A piece of a frame: left, top, right, bottom [px], the last two excluded."""
_BLUR_SMALL = 4.0
"""Length of a trace below which the marker looks as it does at rest [px]."""
Grab = Callable[[Window], NDArray[np.uint8]]
"""Function that returns a piece of the current frame, BGR."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrackerConfig:
    """Settings of the tracker.

    Attributes:
        marker: Looks of the marker.
        marker_z: Height of the marker's middle above the table while it lies there [m].
        sample_dt: Time between samples of the track [s]; the paper's camera analysis takes 100 ms.
        exposure_max: Longest exposure of a frame that is expected, which bounds the blur [s].
        speed_max: Largest speed of the endpoint [m/s].
        acceleration_max: Largest acceleration of the endpoint [m/s²].
        search_period: Frames between searches of the whole image while the marker is lost; between
            them it is searched where it was expected.
        start_radius: Largest distance of the first endpoint from where it is expected [m].
        edge_tolerance: Distance beyond the edge at which an endpoint is off the table [m].
        row_time: Time by which each row is exposed later than the one above it [s]; 0 for a global
            shutter.
    """

    marker: MarkerConfig = dataclasses.field(default_factory=MarkerConfig)
    marker_z: float = 0.005
    sample_dt: float = 0.1
    exposure_max: float = 1 / 120
    speed_max: float = 15.0
    acceleration_max: float = 400.0
    search_period: int = 3
    start_radius: float = 0.15
    edge_tolerance: float = 0.005
    row_time: float = 0.0

    def __post_init__(self):
        check_count("tracker search_period", self.search_period, 1, 1000)
        check_ranges(
            self,
            {
                "marker_z": (-0.1, 0.5, "m"),
                "sample_dt": (0.005, 10.0, "s"),
                "exposure_max": (0.0, 0.1, "s"),
                "speed_max": (0.1, 100.0, "m/s"),
                "acceleration_max": (1.0, 1e5, "m/s²"),
                "start_radius": (0.01, 5.0, "m"),
                "edge_tolerance": (0.0, 0.2, "m"),
                "row_time": (0.0, 1e-3, "s"),
            },
            "tracker",
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Seen:
    """The marker in one frame."""

    frame: int
    time: float
    pixel: NDArray[np.float64]
    xy: NDArray[np.float64]


class EndpointTracker:
    """Follows the green marker through the frames of one trial.

    Args:
        view: Calibrated camera.
        workspace: Gives the table's edges.
        config: Settings of the tracker.
        start_xy: Approximate endpoint at the beginning, where it is known [m], shape [2]: it tells
            the marker from other green things.
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
        self._greenness: float | None = None
        self._area = 0.0
        self._still_green: NDArray[np.bool_] | None = None
        lens = view.lens
        self._frame: Window = (0, 0, lens.width, lens.height)
        centre = (0.0, (workspace.y_min + workspace.y_max) / 2)
        self._px_per_m = view.pixels_per_metre(centre, self.config.marker_z)
        marker = self.config.marker
        # Where a small marker lies on the grid of pixels changes its area by a pixel of its width.
        self._area_min = min(marker.area_min, 1.0 - _GRID / (marker.width * self._px_per_m))

    def update(self, time: float, grab: Grab) -> NDArray[np.float64]:
        """Look at the next frame, and return the endpoint in it.

        Args:
            time: Middle of the exposure of the frame's middle row [s]; must rise.
            grab: Returns pieces of the frame. The tracker asks for no more than it looks at.

        Returns:
            Endpoint on the table [m], shape [2]; NaN if it was not seen.
        """
        if self._times and time <= self._frame_time:
            raise InputError(f"frame times must rise: {time} s follows {self._frame_time} s")
        frame, self._frame_time = len(self._times), time
        patch = None
        if not self._seen:
            patch = self._first(grab) if frame % self.config.search_period == 0 else None
        else:
            lost_count = frame - 1 - self._seen[-1].frame
            patch = self._near(time, lost_count, grab)
            if patch is None and lost_count % self.config.search_period == 0:
                patch = self._anywhere(time, grab)
        if patch is None:
            return self._add(time, np.full(2, np.nan))
        xy = self.view.to_table(patch.pixel, self.config.marker_z)
        self._seen.append(_Seen(frame=frame, time=time, pixel=patch.pixel, xy=xy))
        # Rows below the middle one are exposed later.
        time += self.config.row_time * (float(patch.pixel[1]) - (self._frame[3] - 1) / 2)
        self._learn(patch)
        return self._add(time, xy)

    def _add(self, time: float, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Keep the endpoint of a frame, and return it."""
        # The row of one frame and that of the next may come close in time, but not change places.
        last = self._times[-1] if self._times else -np.inf
        self._times.append(max(time, float(np.nextafter(last, np.inf))))
        self._xy.append(xy)
        return xy

    def _learn(self, patch: Patch) -> None:
        """Learn how green and how large the marker is here and now."""
        if self._greenness is None:
            self._greenness, self._area = patch.greenness, patch.area
            return
        # Light and background change slowly against the frame rate.
        self._greenness += 0.2 * (patch.greenness - self._greenness)
        # The area at rest only grows, when what covered the marker has gone: an arm that creeps
        # over it must not make it believed smaller.
        if patch.area > self._area and self._blur_px() < _BLUR_SMALL:
            self._area += 0.2 * (patch.area - self._area)

    def _blur_px(self) -> float:
        """Return the length of the marker's trace if it moves as it last did [px]."""
        if len(self._seen) < 2:
            return 0.0
        before, last = self._seen[-2:]
        speed = float(np.linalg.norm(last.pixel - before.pixel)) / (last.time - before.time)
        return speed * self.config.exposure_max

    def track(self, duration: float | None = None, begin: float = 0.0) -> EndpointTrack:
        """Return the track so far, one sample every `sample_dt` since the motion began.

        Args:
            duration: Time of the last sample [s]; by default that of the last frame.
            begin: Time at which the motion began, in the clock of the frames [s].

        Raises:
            InputError: There are no frames at or after the beginning of the motion.
        """
        times, xy = self.frames
        times = times - begin
        if not len(times) or times[-1] < 0:
            raise InputError("there is no frame at or after the beginning of the motion")
        dt = self.config.sample_dt
        end = times[-1] if duration is None else duration
        sample_times = np.arange(int(np.floor(end / dt + 1e-6)) + 1, dtype=np.float64) * dt
        endpoint_xy, status = track_samples(
            times, xy, sample_times, self.workspace, self.config.edge_tolerance
        )
        return EndpointTrack(times=sample_times, endpoint_xy=endpoint_xy, status=status)

    @property
    def still_green(self) -> NDArray[np.bool_] | None:
        """Pixels where something green lies that is not the marker, shape [v, u]."""
        return self._still_green

    @property
    def frames(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Time of every frame [s], shape [frame], and the endpoint in it [m], shape [frame, 2].

        With a rolling shutter the time is that of the row in which the marker was seen.
        """
        return np.array(self._times), np.array(self._xy).reshape(-1, 2)

    def _first(self, grab: Grab) -> Patch | None:
        """Return the marker in the first frame that shows it.

        Whatever else is green then lies still, and is no marker later either.
        """
        config = self.config.marker
        expected = config.area * self._px_per_m**2
        candidates = []
        for patch in self._patches(self._frame, grab):
            # Between a pale and a vivid green; the marker's own is known after this.
            if not 40.0 * expected < patch.greenness < 420.0 * expected:
                continue
            if not 0.85 < patch.area / expected < 1.6:
                continue
            if self._shaped(patch, blur_px=0.0):
                candidates.append(patch)
        if candidates:
            pixels = np.array([patch.pixel for patch in candidates])
            if self._start_xy is None:
                # Nothing is known but the size: the patch that is most like a vivid marker.
                misfit = [abs(np.log(p.greenness / (190.0 * expected))) for p in candidates]
            else:
                xy = self.view.to_table(pixels, self.config.marker_z)
                misfit = np.linalg.norm(xy - self._start_xy, axis=1)
                # While the arm hides the marker, another green thing is not it.
                keep = misfit <= self.config.start_radius
                candidates = [patch for patch, ok in zip(candidates, keep, strict=True) if ok]
                misfit = misfit[keep]
            candidates = [candidates[i] for i in np.argsort(misfit)]
        if self._still_green is None:
            mask = green_mask(grab(self._frame), config) > 0
            if candidates:
                left, top, right, bottom = candidates[0].box
                mask[top:bottom, left:right] = False
            self._still_green = mask
        return candidates[0] if candidates else None

    def _predict(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Predict the marker's place [px], its speed [px/s], and the error of both [px]."""
        last = self._seen[-1]
        velocity = np.zeros(2)
        if len(self._seen) > 1:
            before = self._seen[-2]
            velocity = (last.pixel - before.pixel) / (last.time - before.time)
        dt = time - last.time
        radius = 0.5 * self.config.acceleration_max * self._px_per_m * dt * dt
        return (
            last.pixel + velocity * dt,
            velocity,
            radius + 0.35 * float(np.linalg.norm(velocity)) * dt,
        )

    def _near(self, time: float, lost_count: int, grab: Grab) -> Patch | None:
        """Return the marker where it is expected, if it is there."""
        # A long time after it was seen, it is where it was or anywhere.
        if lost_count <= 3:
            centre, velocity, radius = self._predict(time)
        else:
            centre, velocity, radius = self._seen[-1].pixel, np.zeros(2), 60.0
        exposure = self.config.exposure_max
        speed = float(np.linalg.norm(velocity))
        half = self.config.marker.length * self._px_per_m + 10.0
        half += min(radius, 250.0) + speed * exposure / 2
        blur_px = min(2.0 * speed * exposure + 8.0, self._blur_max)
        left, top = np.floor(centre - half).astype(int)
        right, bottom = np.ceil(centre + half).astype(int) + 1
        window = (
            max(int(left), 0),
            max(int(top), 0),
            min(int(right), self._frame[2]),
            min(int(bottom), self._frame[3]),
        )
        if window[0] >= window[2] or window[1] >= window[3]:
            return None
        return self._choose(self._patches(window, grab), centre, half, window, blur_px)

    def _anywhere(self, time: float, grab: Grab) -> Patch | None:
        """Return the marker from anywhere that it could have reached since it was seen."""
        last = self._seen[-1]
        reach = self.config.speed_max * (time - last.time) * self._px_per_m + 40.0
        patches = self._patches(self._frame, grab)
        return self._choose(patches, last.pixel, reach, self._frame, self._blur_max)

    @property
    def _blur_max(self) -> float:
        """Longest trace of the marker in a frame [px]."""
        return self.config.speed_max * self.config.exposure_max * self._px_per_m

    def _patches(self, window: Window, grab: Grab) -> list[Patch]:
        """Return the green patches of a piece of the frame that do not lie on other green."""
        patches = find_patches(grab(window), self.config.marker, (window[0], window[1]))
        still = self._still_green
        if still is None:
            return patches
        u_max, v_max = self._frame[2] - 1, self._frame[3] - 1

        def lies_on_green(patch: Patch) -> bool:
            u, v = np.round(patch.pixel).astype(int)
            return bool(still[min(max(v, 0), v_max), min(max(u, 0), u_max)])

        return [patch for patch in patches if not lies_on_green(patch)]

    def _choose(
        self,
        patches: list[Patch],
        centre: NDArray[np.float64],
        radius: float,
        window: Window,
        blur_px: float,
    ) -> Patch | None:
        """Return the patch that looks most like the marker, if any does."""
        config = self.config.marker
        best, best_score = None, np.inf
        for patch in patches:
            share = patch.greenness / (self._greenness or patch.greenness)
            if not config.share_min <= share <= config.share_max:
                continue
            # The share tells little of a marker that is slowly covered: it changes with the light.
            moved = float(np.linalg.norm(patch.pixel - self._seen[-1].pixel))
            slow = self._blur_px() < _BLUR_SMALL and moved < 2.0 * _BLUR_SMALL
            if slow and patch.area < self._area_min * self._area:
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
            score += abs(patch.hue_deg - config.hue_deg) / config.hue_tolerance_deg
            if score < best_score:
                best, best_score = patch, score
        return best

    def _shaped(self, patch: Patch, blur_px: float) -> bool:
        """Return whether a patch is as large as the marker can look."""
        config = self.config.marker
        if abs(patch.hue_deg - config.hue_deg) > config.hue_tolerance_deg:
            return False
        # Deviation of an even bar is its length over the root of 12; a pixel more for the lens.
        longest = (config.length * self._px_per_m + blur_px) / np.sqrt(12.0) * 1.3 + 1.0
        widest = (config.length * self._px_per_m) / np.sqrt(12.0) * 1.15 + 1.0
        return patch.extent[0] <= longest and patch.extent[1] <= widest
