"""Check of a camera: what was asked of it, what it is, and what to change; and a picture of it."""

import dataclasses
import itertools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.camera.lens import CameraView
from cablecast.camera.settings import CameraSettings
from cablecast.errors import CameraError, InputError
from cablecast.setup import Setup
from cablecast.vision.calibration import Calibration
from cablecast.vision.live import SHARPNESS_MIN, Brightness, CameraFacts, Frame, FrameWatch
from cablecast.vision.plane import SeenPlane
from cablecast.vision.tags import detect_tags, load_cv2
from cablecast.vision.tracker import (
    Chroma,
    MarkerConfig,
    green_places,
    hue_apart,
    pick_marker,
    table_light,
)
from cablecast.vision.trials import calibrate_camera, require_camera

_ROW_COUNT, _COLUMN_STEP = 60, 8
"""Rows whose brightness is kept, and distance of the pixels that it is the mean of [px]."""
_KEPT_COUNT = 8
"""Pictures that are kept, for the tags."""
_LAMP_RATES, _LAMP_SPREAD, _LAMP_STEPS = (100.0, 120.0), 0.006, 25
"""Rates at which lamps on the mains flicker [1/s], how far these stray [-], and rates tried."""
_FLICKER_MIN, _FLICKER_MAX = 0.05, 0.5
"""Amplitudes of a flicker that is reported, and that the tracker evens out [-]."""
_BAND_STEPS, _BAND_GAIN, _BAND_ERROR = 40, 1.5, 0.2
"""Row times that are tried for bands, the gain in amplitude that shows these, and the difference of
the time to read a frame that is reported [share of the time between two frames]."""
_DRIFT_MIN = 0.03
"""Change of a colour over a check that is reported [-]."""
_REPEATED_MIN = 0.02
"""Share of repeated frames that is reported [-]."""
_RATE_SHARE_MIN = 0.95
_EXPOSURE_CHANGE = 1.2
_DARK, _CLIPPED_MAX = 45.0, 0.05
_REFOCUSED = 0.8
"""Least share of its sharpness that stays while a lens keeps its focus [-]."""
_RMS_MAX, _RMS_MAX_PX = 0.003, 1.0
"""Misfit of the tags that is reported: above both, for small pictures are coarse [m], [px]."""
_MARKER_WIDTH_MIN = 5.5
"""Width from which on a marker in sight is found in every frame [px]; see test_small_marker.py."""
_TAG_WIDTH_MIN = 18.0
"""Width from which on nearly every tag of 4x4 cells is read [px]; see tools/measure_tags.py."""
_HUE_OFF_DEG = 30.0
"""Distance of the marker's hue from the one in the lab file that is reported [deg]."""
_COUNTED = 1e-6
"""Largest scatter of stamps that are counted and not measured [s]."""
_OPENING = 2.0
"""Latest first stamp of a stream whose stamps count from its opening [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Flicker:
    """Flicker of lamps on the mains.

    Attributes:
        rate: Rate of the flicker, twice the mains' frequency [1/s].
        amplitude: Amplitude, relative to the mean brightness [-].
        row_time: Time between the exposures of two rows, by the bands of a rolling shutter [s];
            None without bands.
    """

    rate: float
    amplitude: float
    row_time: float | None


def find_flicker(
    times: NDArray[np.float64], rows: NDArray[np.float64], row_step: int
) -> Flicker | None:
    """Return the flicker that frames show, however slowly they are taken; None without any.

    A lamp's phase at the time of each frame tells its rate, whatever beat it makes with the frames.
    What stands still in all frames is the scene's: a beat of nothing is not seen.

    Args:
        times: Times of the frames [s], shape [frame].
        rows: Brightness of every row_step-th row, shape [frame, row].
        row_step: Distance of these rows [px].
    """
    bright = np.log(np.maximum(rows, 1.0))
    rest = bright - bright.mean(axis=0)
    mean = rest.mean(axis=1)
    # What drifts is no flicker.
    rest = rest - np.polyval(np.polyfit(times, mean, 1), times)[:, None]
    dt = float(np.median(np.diff(times)))
    from_middle = row_step * (np.arange(rows.shape[1]) - (rows.shape[1] - 1) / 2)
    row_times = np.linspace(0.0, dt / (row_step * rows.shape[1]), _BAND_STEPS)
    found = []
    for lamp in _LAMP_RATES:
        for rate in lamp * np.linspace(1 - _LAMP_SPREAD, 1 + _LAMP_SPREAD, _LAMP_STEPS):
            by_time = np.exp(-2j * np.pi * rate * times) @ rest / len(times)
            turns = np.exp(-2j * np.pi * rate * np.outer(row_times, from_middle))
            amplitudes = 2.0 * np.abs(turns @ by_time) / rows.shape[1]
            place, best = int(amplitudes.argmax()), float(amplitudes.max())
            row_time = float(row_times[place]) if best > _BAND_GAIN * amplitudes[0] else None
            found.append(Flicker(rate=lamp, amplitude=best, row_time=row_time))
    strongest = max(found, key=lambda flicker: flicker.amplitude)
    return strongest if strongest.amplitude > _FLICKER_MIN else None


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraReport:
    """State of a camera.

    Attributes:
        settings: What was asked of it.
        facts: What it answers.
        frame_count: Frames that were looked at.
        rate: Frames per second by their times [1/s].
        arrival_rate: Frames per second by their arrival [1/s].
        missed_count: Frames that the camera left out, by the gaps between the times.
        dropped_count: Frames that this computer was too slow to take.
        repeated_count: Frames that were sent twice.
        flicker: Flicker of the lamps; None where there is none.
        drift: Change of blue, green and red against their mean from begin to end [-], shape [3].
        duration: Time that was looked at [s].
        brightness: Brightness of the last picture.
        refocused: Sharpness of the least sharp picture as a share of that of a focused lens, or of
            the sharpest if none was focused [-].
        failure: What is wrong with the pictures (frozen, dark); None if nothing is.
        tags_seen: Numbers of the layout's tags that were seen.
        tag_count: Number of tags of the layout.
        calibration: Place of the camera; None where the tags do not determine it.
        calibration_error: Why they do not.
        px_per_m: Scale in the middle of the table [px/m]; NaN without a calibration.
        tip_speed: Speed of the cable's end for which the blur is stated [m/s].
        blur: Way of the end at that speed during one exposure [m].
        marker: Marker that lies where a reset lays it; None if none does.
        marker_error: Why what is coloured there is none; None if nothing is.
        same_coloured: Things of the marker's colour on the table that are larger, as x, y and
            radius [m], shape [place, 3].
        image: Last picture.
        counted_stamps: Whether the stamps of a stream are counted from its opening, and not
            measured: FFmpeg does that for a stream without any, at another pace than frames come.
    """

    settings: CameraSettings
    facts: CameraFacts
    frame_count: int
    rate: float
    arrival_rate: float
    missed_count: int
    dropped_count: int
    repeated_count: int
    flicker: Flicker | None
    drift: NDArray[np.float64]
    duration: float
    brightness: Brightness
    refocused: float
    failure: str | None
    tags_seen: tuple[int, ...]
    tag_count: int
    calibration: Calibration | None
    calibration_error: str | None
    px_per_m: float
    tip_speed: float
    blur: float
    marker: MarkerConfig | None
    marker_error: str | None
    same_coloured: NDArray[np.float64]
    image: NDArray[np.uint8]
    counted_stamps: bool

    def advice(self) -> list[str]:
        """Return what to change, most urgent first; nothing where all is well."""
        return [*self._format_advice(), *self._picture_advice(), *self._place_advice()]

    def _format_advice(self) -> list[str]:
        """Return advice about format, rate and clock."""
        asked, facts, said = self.settings, self.facts, []
        if self.failure is not None:
            said.append(self.failure)
        if (facts.width, facts.height) != (asked.width, asked.height):
            said.append(
                f"the pictures have {facts.width} x {facts.height} px: set width and height to "
                "these, or ask for a size that the camera has"
            )
        if facts.kind == "device" and facts.fourcc != asked.fourcc:
            said.append(f"the pixel format is {facts.fourcc or 'unknown'}, not {asked.fourcc}")
        rate = self.arrival_rate if self.counted_stamps else self.rate
        if rate < _RATE_SHARE_MIN * asked.rate:
            said.append(
                f"{rate:.1f} frames/s come instead of {asked.rate:g}: switch automatic exposure "
                "off, shorten the exposure, or take a faster port"
            )
        if self.counted_stamps and asked.clock == "device":
            said.append(
                f"the stamps count {self.rate:.1f} frames/s while {self.arrival_rate:.1f} arrive: "
                "they are made up, so set `clock: arrival`"
            )
        if self.missed_count:
            said.append(
                f"the camera left out {self.missed_count} frames: take a faster port, or ask for "
                "fewer or smaller ones"
            )
        if self.dropped_count:
            said.append(
                f"this computer dropped {self.dropped_count} frames: close other programs, or ask "
                "for fewer or smaller ones"
            )
        if self.repeated_count > _REPEATED_MIN * self.frame_count:
            said.append(
                f"{self.repeated_count} of {self.frame_count} frames are the one before again: the "
                "camera is slower than it says, so ask for a lower rate, or shorten the exposure"
            )
        if asked.clock_offset_sd is None:
            said.append("the offset of its clock is unknown: run `cablecast camera sync`")
        return said

    def _picture_advice(self) -> list[str]:
        """Return advice about exposure, focus and light."""
        said = self._light_advice()
        if self.facts.auto_exposure:
            said.append("exposure is automatic: switch it off with the camera's own tool")
        exposure, asked = self.facts.exposure, self.settings.exposure
        if exposure is not None and not 1 / _EXPOSURE_CHANGE < exposure / asked < _EXPOSURE_CHANGE:
            said.append(
                f"the exposure is {1e3 * exposure:.2f} ms, not {1e3 * asked:.2f} ms: "
                "set `exposure` to a value that the camera takes"
            )
        if self.facts.autofocus:
            said.append("focus is automatic: switch it off with the camera's own tool")
        elif self.refocused < _REFOCUSED:
            said.append(
                f"the focus changed in {self.duration:.1f} s, to {100 * self.refocused:.0f} % of "
                "the sharpness: switch automatic focus off"
            )
        if self.brightness.sharpness < SHARPNESS_MIN:
            said.append("the picture is blurred: focus the lens on the table, and clean it")
        length = self.settings.marker[0]
        if self.blur > length:
            said.append(
                f"a tip at {self.tip_speed:g} m/s smears {1e3 * self.blur:.0f} mm, more than the "
                f"marker's {1e3 * length:.0f} mm: landings stay exact, but tracks to tune with "
                "want 1/1000 s and more light"
            )
        if self.brightness.mean < _DARK:
            said.append(f"the picture is dark ({self.brightness.mean:.0f} of 255): more light")
        if self.brightness.clipped > _CLIPPED_MAX:
            said.append(
                f"{100 * self.brightness.clipped:.0f} % of the picture is saturated: less light, "
                "gain or exposure"
            )
        return said

    def _light_advice(self) -> list[str]:
        """Return advice about flicker, bands and white balance."""
        said, flicker, asked = [], self.flicker, self.settings
        if flicker is not None:
            period = 1.0 / flicker.rate
            known = "which the tracker evens out"
            if flicker.amplitude > _FLICKER_MAX:
                known = "more than the +-50 % that the tracker evens out"
            said.append(
                f"lamps flicker with {flicker.rate:g} Hz, +-{100 * flicker.amplitude:.0f} % from "
                f"frame to frame, {known}. Lamps without flicker or daylight end it; an exposure "
                f"of {1e3 * period:.1f} ms, too, but a tip at {self.tip_speed:g} m/s would smear "
                f"{1e3 * period * self.tip_speed:.0f} mm"
            )
            read = (flicker.row_time or 0.0) * self.facts.height * self.rate
            told = asked.row_time * self.facts.height * self.rate
            if flicker.row_time is not None and abs(read - told) > _BAND_ERROR:
                said.append(
                    "bands roll through the picture, for the shutter exposes row after row: set "
                    f"`row_time: {flicker.row_time:.2g}` in place of {asked.row_time:.2g}"
                )
        worst = int(np.argmax(np.abs(self.drift)))
        if self.facts.auto_balance:
            said.append("white balance is automatic: switch it off with the camera's own tool")
        elif abs(self.drift[worst]) > _DRIFT_MIN:
            said.append(
                f"{('blue', 'green', 'red')[worst]} changed by {100 * self.drift[worst]:+.0f} % in "
                f"{self.duration:.1f} s: switch automatic white balance off"
            )
        return said

    def _place_advice(self) -> list[str]:
        """Return advice about tags and lens."""
        said, missing = [], self.tag_count - len(self.tags_seen)
        if self.calibration_error is not None:
            said.append(self.calibration_error)
        if missing and self.calibration is not None:
            said.append(f"{missing} of {self.tag_count} tags are not seen: clear what covers them")
        width_px = self.px_per_m * self.settings.marker[1]
        if (end := self.settings.end_tag) is not None:
            width_px = self.px_per_m * end.size
            if width_px < _TAG_WIDTH_MIN:
                said.append(
                    f"the tag on the cable's end is {width_px:.0f} px wide, and from "
                    f"{_TAG_WIDTH_MIN:g} px on it is read: take larger pictures or a larger tag"
                )
        elif width_px < _MARKER_WIDTH_MIN:
            said.append(
                f"the marker is {width_px:.1f} px wide, and from {_MARKER_WIDTH_MIN:g} px on it is "
                "found in every frame: take larger pictures, a closer camera or a wider marker"
            )
        if (calibration := self.calibration) is not None:
            if calibration.rejected_ids:
                said.append(
                    f"tags {list(calibration.rejected_ids)} lie elsewhere than the layout says: "
                    "measure them again"
                )
            if calibration.rms_px > _RMS_MAX_PX and calibration.rms > _RMS_MAX:
                said.append(
                    f"the tags fit to {1e3 * calibration.rms:.1f} mm only: measure them again, or "
                    "let the robot touch them (`cablecast calibrate table`)"
                )
        asked = self.settings.marker_hue
        if self.marker_error is not None:
            said.append(self.marker_error)
        elif self.marker and abs(hue_apart(self.marker.hue, asked)) > _HUE_OFF_DEG:
            said.append(
                f"the marker has a hue of {self.marker.hue:.0f} deg, and {asked:.0f} is looked "
                "for: let `cablecast camera check --pick` learn it"
            )
        for x, y, radius in self.same_coloured:
            said.append(
                f"something of the marker's colour, {200 * radius:.0f} cm wide, lies at x, y = "
                f"{x:.2f}, {y:.2f} m: what lands on it is not seen, so clear it away"
            )
        if self.settings.lens is None:
            said.append("the lens is guessed: show it a board (`cablecast calibrate lens`)")
        return said


class CameraCheck:
    """Looks at frames, and reports on the camera and on the blur at a speed of the tip [m/s]."""

    def __init__(self, setup: Setup, facts: CameraFacts, tip_speed: float = 5.0):
        self._settings = require_camera(setup)
        self._plane = SeenPlane.of(setup)
        self._facts = facts
        self._tip_speed = tip_speed
        self._watch = FrameWatch(self._settings.source)
        self._failure: str | None = None
        self._times: list[tuple[float, float]] = []
        self._images: list[NDArray[np.uint8]] = []
        self._rows: list[NDArray[np.float64]] = []
        self._repeated_count = 0
        self._sharpness: list[float] = []

    def look(self, frame: Frame) -> None:
        """Look at the next frame."""
        self._times.append((frame.time, frame.arrival))
        self._images = [*self._images[-_KEPT_COUNT + 1 :], frame.image]
        self._row_step = max(1, frame.image.shape[0] // _ROW_COUNT)
        self._rows.append(frame.image[:: self._row_step, ::_COLUMN_STEP].mean(axis=1))
        try:
            self._repeated_count += not self._watch.look(frame)
        except CameraError as error:
            self._failure = str(error)
        if self._watch.now is not None:
            self._sharpness.append(self._watch.now.sharpness)

    def report(self, dropped_count: int = 0) -> CameraReport:
        """Return what was found; `dropped_count` frames came too fast for this computer.

        Raises:
            InputError: Fewer than three frames were looked at.
        """
        if len(self._times) < 3:
            raise InputError(f"{len(self._times)} frames say nothing about a camera: at least 3")
        times, arrivals = np.array(self._times).T
        stamps = np.diff(times)
        gaps = np.maximum(np.round(stamps / float(np.median(stamps))) - 1, 0)
        # Over the whole time: frames come in bursts, and a film counts in whole milliseconds.
        rate = (len(stamps) + float(gaps.sum())) / float(stamps.sum())
        arrival_rate = len(stamps) / max(float(arrivals[-1] - arrivals[0]), 1e-9)
        counted = float(np.ptp(stamps)) < _COUNTED and float(times[0]) < _OPENING
        calibration, refused, image = None, None, self._images[-1]
        ids, px_per_m, same = (), float("nan"), np.empty((0, 3))
        marker, unmarked = None, None
        try:
            calibration = calibrate_camera(self._images, self._settings, self._plane)
        except InputError as error:
            refused = str(error)
        if calibration is not None:
            ids = (*calibration.tag_ids, *calibration.rejected_ids)
            plane, (length, _) = self._plane, self._settings.marker
            workspace, z = plane.area, plane.height
            centre = (0.0, (workspace.y_min + workspace.y_max) / 2)
            px_per_m = calibration.view.pixels_per_metre(centre, z)
            light = table_light(image, calibration.view, workspace)
            mask = Chroma.of(image, self._settings.marker_hue, light).mask(45.0) > 0
            same = green_places(mask, calibration.view, workspace)
            # The marker itself is none of them.
            end = calibration.view.to_image(np.array([*plane.start, z]))
            apart = np.linalg.norm(same[:, :2] - calibration.view.to_table(end), axis=1)
            same = same[(same[:, 2] > length) & ~(apart < same[:, 2])]
            try:
                if self._settings.end_tag is None:
                    marker = pick_marker(image, calibration.view, workspace, plane.start, z)
            except InputError as error:
                unmarked = str(error)
        exposure = self._facts.exposure
        rows = np.array(self._rows)
        tints = rows.mean(axis=1) / rows.mean(axis=(1, 2))[:, None].clip(1.0)
        count = max(len(tints) // 5, 1)
        return CameraReport(
            settings=self._settings,
            facts=self._facts,
            frame_count=len(self._times),
            rate=rate,
            arrival_rate=arrival_rate,
            missed_count=max(int(gaps.sum()) - dropped_count, 0),
            dropped_count=dropped_count,
            repeated_count=self._repeated_count,
            flicker=find_flicker(times - times[0], rows.mean(axis=-1), self._row_step),
            drift=np.median(tints[-count:], axis=0) / np.median(tints[:count], axis=0) - 1.0,
            duration=float(times[-1] - times[0]),
            brightness=Brightness.of(image),
            refocused=min(self._sharpness) / min(max(self._sharpness), SHARPNESS_MIN),
            failure=self._failure,
            tags_seen=tuple(sorted(ids)),
            tag_count=len(self._plane.tags.tags),
            calibration=calibration,
            calibration_error=refused,
            px_per_m=px_per_m,
            tip_speed=self._tip_speed,
            blur=self._tip_speed * (self._settings.exposure if exposure is None else exposure),
            marker=marker,
            marker_error=unmarked,
            same_coloured=same,
            image=image,
            counted_stamps=counted
            and self._facts.kind == "stream"
            and not 0.95 < rate / arrival_rate < 1.05,
        )


_SEEN, _REFUSED, _EDGE, _AXIS = (60, 170, 0), (0, 0, 220), (200, 120, 0), (160, 0, 160)


def draw_report(report: CameraReport, plane: SeenPlane) -> bytes:
    """Return the last picture of a check as PNG, with what was found and the plane's lines."""
    cv2 = load_cv2()
    image = report.image.copy()
    rejected = () if report.calibration is None else report.calibration.rejected_ids
    for tag_id, quad in detect_tags(image, report.settings.tag_family).items():
        colour = _REFUSED if tag_id in rejected else _SEEN
        cv2.polylines(image, [np.round(quad).astype(np.int32)], True, colour, 2, cv2.LINE_AA)
        u, v = np.round(quad.max(axis=0)).astype(int).tolist()
        cv2.putText(image, str(tag_id), (u, v), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 2)
    if report.calibration is not None:
        view = report.calibration.view
        for colour, line in zip((_EDGE, _AXIS, _AXIS), plane.lines, strict=False):
            _line(image, view, line, colour)
        turn = np.linspace(0.0, 2.0 * np.pi, 24)
        for x, y, radius in report.same_coloured:
            ring = x + radius * np.cos(turn), y + radius * np.sin(turn), np.zeros(len(turn))
            circle = np.column_stack(ring)
            _line(image, view, circle, _REFUSED)
    return cv2.imencode(".png", image)[1].tobytes()


def _line(
    image: np.ndarray, view: CameraView, corners: ArrayLike, colour: tuple[int, int, int]
) -> None:
    """Draw a line through points [m], shape [point, 3], bent as the lens bends it."""
    cv2 = load_cv2()
    for start, end in itertools.pairwise(np.asarray(corners, dtype=float)):
        pixels = view.to_image(np.linspace(start, end, 40))
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        cv2.polylines(image, [np.round(pixels).astype(np.int32)], False, colour, 2, cv2.LINE_AA)
