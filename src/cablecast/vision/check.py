"""Check of a camera: what was asked of it, what it is, and what to change; and a picture of it."""

import dataclasses
import itertools

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.lens import CameraView
from cablecast.camera.settings import CameraSettings
from cablecast.errors import CameraError, InputError
from cablecast.setup import Setup
from cablecast.vision.calibration import Calibration
from cablecast.vision.live import Brightness, CameraFacts, Frame, FrameWatch
from cablecast.vision.tags import detect_tags, load_cv2
from cablecast.vision.tracker import chroma_of, green_places, marker_mask, table_light
from cablecast.vision.trials import calibrate_camera, require_camera, tags_of
from cablecast.workspace import Workspace

_KEPT_COUNT = 8
"""Pictures that are kept, for the tags."""
_RATE_SHARE_MIN = 0.95
_EXPOSURE_CHANGE = 1.2
_DARK, _CLIPPED_MAX = 45.0, 0.05
_RMS_MAX, _RMS_MAX_PX = 0.003, 1.0
"""Misfit of the tags that is worth a word: above both, for small pictures are coarse [m], [px]."""
_MARKER_WIDTH_MIN = 5.5
"""Width from which on a marker in sight is found in every frame [px]; see test_small_marker.py."""
_COUNTED = 1e-6
"""Largest scatter of stamps that are counted and not measured [s]."""
_OPENING = 2.0
"""Latest first stamp of a stream whose stamps count from its opening [s]."""


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
        brightness: Brightness of the last picture.
        failure: What is wrong with the pictures (frozen, dark); None if nothing is.
        tags_seen: Numbers of the layout's tags that were seen.
        tag_count: Number of tags of the layout.
        calibration: Place of the camera; None where the tags do not determine it.
        calibration_error: Why they do not.
        px_per_m: Scale in the middle of the table [px/m]; NaN without a calibration.
        tip_speed: Speed of the cable's end for which the blur is stated [m/s].
        blur: Way of the end at that speed during one exposure [m].
        green: Things of the marker's colour on the table that are larger than it is, as x, y and
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
    brightness: Brightness
    failure: str | None
    tags_seen: tuple[int, ...]
    tag_count: int
    calibration: Calibration | None
    calibration_error: str | None
    px_per_m: float
    tip_speed: float
    blur: float
    green: NDArray[np.float64]
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
            said.append(f"the camera left out {self.missed_count} frames")
        if self.dropped_count:
            said.append(
                f"this computer dropped {self.dropped_count} frames: close other programs, or ask "
                "for fewer or smaller ones"
            )
        if asked.clock_offset_sd is None:
            said.append("the offset of its clock is unknown: run `cablecast camera sync`")
        return said

    def _picture_advice(self) -> list[str]:
        """Return advice about exposure, focus and light."""
        said = []
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

    def _place_advice(self) -> list[str]:
        """Return advice about tags and lens."""
        said, missing = [], self.tag_count - len(self.tags_seen)
        if self.calibration_error is not None:
            said.append(self.calibration_error)
        if missing and self.calibration is not None:
            said.append(f"{missing} of {self.tag_count} tags are not seen: clear what covers them")
        calibration = self.calibration
        width_px = self.px_per_m * self.settings.marker[1]
        if width_px < _MARKER_WIDTH_MIN:
            said.append(
                f"the marker is {width_px:.1f} px wide, and from {_MARKER_WIDTH_MIN:g} px on it is "
                "found in every frame: take larger pictures, a closer camera or a wider marker"
            )
        if calibration is not None and calibration.rejected_ids:
            said.append(
                f"tags {list(calibration.rejected_ids)} lie elsewhere than the layout says: "
                "measure them again"
            )
        coarse = calibration is not None and calibration.rms_px > _RMS_MAX_PX
        if calibration is not None and coarse and calibration.rms > _RMS_MAX:
            said.append(
                f"the tags fit to {1e3 * calibration.rms:.1f} mm only: measure them again, or let "
                "the robot touch them (`cablecast calibrate table`)"
            )
        for x, y, radius in self.green:
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
        self._setup = setup
        self._settings = require_camera(setup)
        self._facts = facts
        self._tip_speed = tip_speed
        self._watch = FrameWatch(self._settings.source)
        self._failure: str | None = None
        self._times: list[tuple[float, float]] = []
        self._images: list[NDArray[np.uint8]] = []

    def look(self, frame: Frame) -> None:
        """Look at the next frame."""
        self._times.append((frame.time, frame.arrival))
        self._images = [*self._images[-_KEPT_COUNT + 1 :], frame.image]
        try:
            self._watch.look(frame)
        except CameraError as error:
            self._failure = str(error)

    def report(self, dropped_count: int = 0) -> CameraReport:
        """Return what was found; `dropped_count` frames came too fast for this computer.

        Raises:
            InputError: Fewer than three frames were looked at.
        """
        if len(self._times) < 3:
            raise InputError(f"{len(self._times)} frames say nothing about a camera: at least 3")
        stamps, arrivals = (np.diff(column) for column in np.array(self._times).T)
        gaps = np.maximum(np.round(stamps / float(np.median(stamps))) - 1, 0)
        # Over the whole time: frames come in bursts, and a film counts in whole milliseconds.
        rate = (len(stamps) + float(gaps.sum())) / float(stamps.sum())
        arrival_rate = len(arrivals) / max(float(arrivals.sum()), 1e-9)
        counted = float(np.ptp(stamps)) < _COUNTED and self._times[0][0] < _OPENING
        pace = rate / arrival_rate if arrival_rate > 0 else 1.0
        calibration, refused, image = None, None, self._images[-1]
        ids, px_per_m, green = (), float("nan"), np.empty((0, 3))
        try:
            calibration = calibrate_camera(self._images, self._setup)
        except InputError as error:
            refused = str(error)
        if calibration is not None:
            ids = (*calibration.tag_ids, *calibration.rejected_ids)
            workspace, (length, _) = self._setup.workspace, self._settings.marker
            centre = (0.0, (workspace.y_min + workspace.y_max) / 2)
            px_per_m = calibration.view.pixels_per_metre(centre)
            light = table_light(image, calibration.view, workspace)
            mask = marker_mask(*chroma_of(image, self._settings.marker_hue, light), 45.0) > 0
            green = green_places(mask, calibration.view, workspace)
            green = green[green[:, 2] > length]
        exposure = self._facts.exposure
        return CameraReport(
            settings=self._settings,
            facts=self._facts,
            frame_count=len(self._times),
            rate=rate,
            arrival_rate=arrival_rate,
            missed_count=max(int(gaps.sum()) - dropped_count, 0),
            dropped_count=dropped_count,
            brightness=Brightness.of(image),
            failure=self._failure,
            tags_seen=tuple(sorted(ids)),
            tag_count=len(tags_of(self._setup).tags),
            calibration=calibration,
            calibration_error=refused,
            px_per_m=px_per_m,
            tip_speed=self._tip_speed,
            blur=self._tip_speed * (self._settings.exposure if exposure is None else exposure),
            green=green,
            image=image,
            counted_stamps=counted and self._facts.kind == "stream" and not 0.95 < pace < 1.05,
        )


_SEEN, _REFUSED, _EDGE, _AXIS = (60, 170, 0), (0, 0, 220), (200, 120, 0), (160, 0, 160)


def draw_report(report: CameraReport, workspace: Workspace) -> bytes:
    """Return the last picture of a check as PNG, with what was found and the table's edges."""
    cv2 = load_cv2()
    image = report.image.copy()
    rejected = () if report.calibration is None else report.calibration.rejected_ids
    for tag_id, quad in detect_tags(image, report.settings.tag_family).items():
        colour = _REFUSED if tag_id in rejected else _SEEN
        cv2.polylines(image, [np.round(quad).astype(np.int32)], True, colour, 2, cv2.LINE_AA)
        u, v = np.round(quad.max(axis=0)).astype(int).tolist()
        cv2.putText(image, str(tag_id), (u, v), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 2)
    if report.calibration is not None:
        view, w = report.calibration.view, workspace
        x, low, high = w.half_width, w.y_min, w.y_max
        _line(image, view, [(-x, low), (x, low), (x, high), (-x, high), (-x, low)], _EDGE)
        _line(image, view, [(0.0, low), (0.0, high)], _AXIS)
        _line(image, view, [(-x, w.reset_y), (x, w.reset_y)], _AXIS)
        turn = np.linspace(0.0, 2.0 * np.pi, 24)
        for x, y, radius in report.green:
            circle = np.column_stack([x + radius * np.cos(turn), y + radius * np.sin(turn)])
            _line(image, view, [(a, b) for a, b in circle.tolist()], _REFUSED)
    return cv2.imencode(".png", image)[1].tobytes()


def _line(
    image: np.ndarray,
    view: CameraView,
    corners: list[tuple[float, float]],
    colour: tuple[int, int, int],
) -> None:
    """Draw a line over the table, bent as the lens bends it."""
    cv2 = load_cv2()
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        share = np.linspace(0.0, 1.0, 40)
        points = np.column_stack([x0 + share * (x1 - x0), y0 + share * (y1 - y0), 0 * share])
        pixels = view.to_image(points)
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        cv2.polylines(image, [np.round(pixels).astype(np.int32)], False, colour, 2, cv2.LINE_AA)
