"""Cameras that film the trials of a rig: what a rig asks of one, and the camera of a lab file."""

import dataclasses
import pathlib
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.settings import CameraSettings, CameraSight
from cablecast.camera.tags import TagLayout
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.errors import CameraError
from cablecast.motion.trajectory import JointPath
from cablecast.setup import Setup
from cablecast.vision.calibration import Calibration, calibrate_view, check_tags
from cablecast.vision.clock import CastClock, ClockOffset, controller_shift
from cablecast.vision.end_tag import make_tracker
from cablecast.vision.grip import is_held, turned_into_sight
from cablecast.vision.live import Brightness, Frame, FrameWatch, LiveCamera
from cablecast.vision.plane import SeenPlane
from cablecast.vision.tags import detect_tags
from cablecast.vision.tracker import (
    EndpointTracker,
    MarkerConfig,
    TrackerConfig,
    grab_of,
    sight_of,
)
from cablecast.vision.video import FilmWriter

_CALIBRATION_FRAMES = 8
_CHECK_FRAMES = 6
_LOCATE_FRAMES = 3
_APART_MAX = 60.0
"""Largest distance of two times of one trial by both clocks, if these have been compared [s]."""
_LATENCY_MAX = 0.25
"""Longest way of a frame from the sensor to this process [s]."""
_CLOCK_OFF, _CLOCK_REACH = 0.008, 1.0
"""Offset of the clocks in a cast that is no error of what was seen, and largest one that is looked
for [s]: the delay of a camera changed by up to 900 ms from start to start."""
_CLOCK_CLEAR, _CLOCK_SD_MAX, _CLOCK_UNSEEN = 0.7, 0.004, 0.35
"""Share of what was seen, and largest standard deviation [s], with which an offset is clear; and
share below which the arm was not seen."""
_LOCATE_RADIUS = 0.5
"""Distance from where the endpoint is expected within which it is looked for [m]."""
_AFTER = 0.3
"""Time for which the clocks' cast is filmed on when the arm has stopped [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrialTiming:
    """When a trial took place, by the clock of the arm's controller and by that of this computer.

    Attributes:
        start_time: Start of the motion by the controller's clock [s].
        end_time: End of the trial, when the cable has had time to come to rest, by the controller's
            clock [s].
        clock_pairs: Times of reports by the controller's clock, and the times at which they arrived
            by `time.monotonic` of this computer [s], shape [report, 2].
        joint_path: Joints as the arm reported them, with times since `start_time`; None where it
            reports none.
    """

    start_time: float
    end_time: float
    clock_pairs: NDArray[np.float64]
    joint_path: JointPath | None = None

    @property
    def reported(self) -> JointPath | None:
        """Joints as the arm reported them, with times by the controller's clock."""
        path = self.joint_path
        return path and dataclasses.replace(path, times=path.times + self.start_time)


@runtime_checkable
class TrialCamera(Protocol):
    """Camera over the table, which films one trial at a time.

    The order is check, then for each trial start, stop or cancel; `locate` may come at any time
    between two trials. A camera that cannot go on raises RigError with one line that says what to
    do.

    Attributes:
        description: Kind and settings of the camera, as plain values for a dataset card.
    """

    description: dict[str, Any]

    def check(self, after: float | None = None) -> None:
        """Check that frames arrive, are fresh and as exposed as before, and that no tag moved.

        Args:
            after: Time by the controller's clock from which on frames count [s]; from now on where
                None, which is only as fresh as the way of a frame from the sensor is short.
        """
        ...

    def start(self) -> None:
        """Start to film: the motion starts after this returns."""
        ...

    def stop(self, timing: TrialTiming) -> EndpointTrack:
        """End the film, and return the endpoint's track.

        The frames from `timing.start_time` to `timing.end_time` count. This waits until the last of
        them has arrived. Samples are 100 ms apart since the motion began; the joint path is that of
        `timing`.
        """
        ...

    def cancel(self) -> None:
        """Drop the film of a trial that was aborted; harmless where none runs."""
        ...

    def locate(self, after: float | None = None) -> NDArray[np.float64] | None:
        """Return where the endpoint is now [m], shape [2]; None where it is not seen."""
        ...

    def close(self) -> None:
        """Release the device; may be called twice."""
        ...


class CameraOfTrials:
    """The camera of a lab file, as a `TrialCamera`.

    Args:
        setup: Set-up with the section `camera`. Where that names a folder for films, each trial's
            film is kept there, named after the time at which the camera was opened and a number.

    Raises:
        CameraError: There is no camera, or it cannot be opened.
        InputError: It does not see the tags of the layout.
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, setup: Setup):
        self.setup = setup
        self.settings = require_camera(setup)
        self.plane = SeenPlane.of(setup)
        self._opened_at = time.strftime("%Y%m%d-%H%M%S")
        self._film_count = 0
        self._filming: _Filming | None = None
        # First picture of a trial, and the joints in it.
        self._before: tuple[NDArray[np.uint8] | None, NDArray[np.float64] | None] = (None, None)
        self._last_xy: NDArray[np.float64] | None = None
        self._camera = LiveCamera(self.settings)
        try:
            images = [frame.image for frame in self._fresh(_CALIBRATION_FRAMES)]
            self.calibration = calibrate_camera(images, self.settings, self.plane)
        except BaseException:
            self._camera.close()
            raise
        self.base_view = self.plane.base_view(self.calibration.view)
        self._tracker = self._new_tracker(self.plane.start)
        # Nothing lies still where a cable swings.
        in_air = self.plane.in_air
        self._sight = None if in_air else CameraSight(position=self.base_view.position)
        self._reference = Brightness.of(images[-1])
        self.description: dict[str, Any] = {
            "camera": self._camera.facts.kind,
            **self.settings.to_dict(),
            "calibration_rms_mm": 1e3 * self.calibration.rms,
            "tags_used": len(self.calibration.tag_ids),
            "tags_rejected": list(self.calibration.rejected_ids),
            "tags_turned": self.calibration.turned,
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def check(self, after: float | None = None) -> None:
        """Check that frames arrive, are fresh and as exposed as before, and that no tag moved."""
        watch = FrameWatch(self.settings.source, self._reference)
        frames = self._fresh(_CHECK_FRAMES, after)
        for frame in frames:
            watch.look(frame)
        seen = detect_tags(frames[-1].image, self.calibration.family)
        advice = "Start anew, so that it is calibrated in its new place"
        shift = check_tags([seen], self.calibration, "", advice)
        if shift.moved:
            raise CameraError(
                f"tags {list(shift.moved)} were moved since the camera was calibrated "
                f"({shift.moved_words}): put them back, or measure their new places and start anew"
            )

    def start(self) -> None:
        """Start to film: the motion starts after this returns."""
        writer = None
        if self.settings.films is not None:
            name = f"{self._opened_at}-{self._film_count:04}.mkv"
            writer = FilmWriter(pathlib.Path(self.settings.films) / name, self.settings.rate)
            self._film_count += 1
        self._tracker = tracker = self._new_tracker(self.plane.start)
        self._cast_clock = clock = CastClock(self._camera.facts.width, self.settings.row_time)
        watch = FrameWatch(self.settings.source, self._reference)
        self._before = (None, None)

        def look(frame: Frame) -> None:
            if self._before[0] is None:
                self._before = (frame.image, None)
            # One that the driver repeats shows the marker where it was.
            if watch.look(frame):
                tracker.update(frame.time, grab_of(frame.image))
                clock.keep(frame.image, frame.time)
            if writer is not None:
                writer.write(frame.image, frame.time)

        self._film(look, writer)

    def stop(self, timing: TrialTiming) -> EndpointTrack:
        """End the film, and return the endpoint's track.

        Raises:
            CameraError: The film was not started, or the camera failed while it filmed.
        """
        filming, self._filming = self._filming, None
        if filming is None:
            raise CameraError("the camera was not started before the motion")
        # Times of frames and of the controller differ by this.
        shift = self.settings.clock_offset
        if self.settings.clock == "arrival":
            shift -= controller_shift(timing.clock_pairs)
        start, end = timing.start_time - shift, timing.end_time - shift
        latest = filming.latest
        if latest is not None and abs(apart := latest.time - start) > _APART_MAX:
            filming.drop()
            raise CameraError(
                f"the clocks of robot and camera are {abs(apart):.0f} s apart: one was started "
                "anew, or they were never compared. Run `cablecast camera sync`"
            )
        # A sample at the very end lies between two frames, with a shutter that rolls.
        last, late, note = end + 1.5 / self.settings.rate, 0.0, None

        def is_last(frame: Frame) -> bool:
            nonlocal late, note
            if note is None and frame.time > last:
                late, note = self._check_clock(timing, shift)
            return note is not None and frame.time > last + late

        filming.finish(is_last)
        if filming.latest is not None:
            self._latest = filming.latest.image
        if not self.plane.in_air:
            self._sight = sight_of(self._tracker)
        if timing.joint_path is not None:
            self._before = (self._before[0], timing.joint_path.q[0])
        duration = timing.end_time - timing.start_time
        track = self.plane.track(self._tracker, duration, start + late)
        if track.status is TrialStatus.OCCLUDED and filming.dropped_count:
            raise CameraError(
                f"the endpoint was lost, and {filming.dropped_count} frames of this cast found no "
                "room in the memory of this computer: close other programs, or ask the camera for "
                "fewer frames or pixels"
            )
        xy = self._tracker.frames[1]
        seen = xy[np.isfinite(xy).all(axis=1)]
        self._last_xy = seen[-1] if len(seen) else None
        return dataclasses.replace(track, joint_path=timing.joint_path, note=note or "")

    def _check_clock(self, timing: TrialTiming, shift: float) -> tuple[float, str]:
        """Return by how much later by the camera's clock the cast began than was believed [s].

        The arm is in the picture, and its way is known: so each cast compares the clocks. The
        second says what was corrected; it is empty where they agree.
        """
        if (reported := timing.reported) is None:
            return 0.0, ""
        arm, view = self.setup.arm, self.base_view
        found = self._cast_clock.compare(reported, arm, view, shift, _CLOCK_REACH)
        if found is None:
            return 0.0, ""
        known = self.settings.clock_offset_sd or 0.0
        if abs(found.offset) < max(_CLOCK_OFF, 3.0 * float(np.hypot(found.sd, known))):
            return 0.0, ""
        off = f"the camera's clock is off by {1e3 * found.offset:+.0f} ms in this cast"
        if found.explained > _CLOCK_CLEAR and found.sd < _CLOCK_SD_MAX:
            return -found.offset, f"{off}, +- {1e3 * found.sd:.0f} ms: corrected"
        if found.explained < _CLOCK_UNSEEN:
            # Something else is seen there; that says nothing about clocks.
            return 0.0, ""
        raise CameraError(
            f"{off}, but only {100 * found.explained:.0f} % of what moved agrees with that: run "
            "`cablecast camera sync`, and repeat the cast"
        )

    def into_sight(self, q: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the joints that turn the jaws in their place until the camera sees ahead of them.

        None where no turn does; `q` are the joints of the standing arm [rad], shape [joint].
        """
        return turned_into_sight(q, self.setup.arm, self.base_view)

    def holds_cable(self, q: NDArray[np.float64], after: float) -> bool | None:
        """Return whether the jaws still hold the cable after the last trial.

        None where the camera cannot tell; `q` are the joints of the standing arm [rad], shape
        [joint], and `after` is as in `check`.
        """
        (image, start), arm = self._before, self.setup.arm
        if image is None or start is None:
            return None
        now = self._fresh(1, after)[-1].image
        return is_held((image, now), np.array([start, q]), arm, self.base_view)

    def cancel(self) -> None:
        """Drop the film of a trial that was aborted; harmless where none runs."""
        filming, self._filming = self._filming, None
        if filming is not None:
            filming.drop()

    def locate(self, after: float | None = None) -> NDArray[np.float64] | None:
        """Return where the endpoint is now [m], shape [2] or [3]; None where it is not seen.

        It is looked for about its place after a reset, then about where it was seen last.
        """
        frames = self._fresh(_LOCATE_FRAMES, after)
        for place in (self.plane.start, self._last_xy):
            if place is None:
                continue
            tracker = self._new_tracker(place, start_radius=_LOCATE_RADIUS)
            xy = [tracker.update(frame.time, grab_of(frame.image)) for frame in frames][-1]
            if np.isfinite(xy).all():
                return self.plane.points(xy)
        return None

    def picture(self) -> NDArray[np.uint8]:
        """Return the latest picture that was read, BGR, shape [v, u, 3]; from any thread."""
        filming = self._filming
        latest = None if filming is None else filming.latest
        return self._latest if latest is None else latest.image

    def sight(self) -> CameraSight | None:
        """Return what the camera cannot see of a table: blind places after the first trial."""
        return self._sight

    def close(self) -> None:
        """Release the device; may be called twice."""
        self.cancel()
        self._camera.close()

    def _film(self, look: Callable[[Frame], object], writer: FilmWriter | None = None) -> None:
        """Start to film, and wait for the first frame."""
        self.cancel()
        self._filming = _Filming(self._camera, look, writer)
        try:
            self._filming.wait_started()
        except BaseException:
            # No caller ends a film that was not started.
            self.cancel()
            raise

    def _fresh(self, count: int, after: float | None = None) -> list[Frame]:
        """Return the next frames, and none that has waited; see `TrialCamera.check`."""
        if self._filming is not None:
            raise CameraError("the camera films a trial: end it first")
        since = None
        if self.settings.clock == "device" and after is not None:
            since = after - self.settings.clock_offset
        # Without a time, what is on its way through cable and network shows what was.
        arrived = time.monotonic() + _LATENCY_MAX
        frames: list[Frame] = []
        while len(frames) < count and (frame := self._camera.read()) is not None:
            if since is not None and abs(frame.time - since) > _APART_MAX:
                since = None
            fresh = frame.arrival > arrived if since is None else frame.time > since
            if fresh or self._camera.facts.kind == "file":
                frames.append(frame)
        if len(frames) < count:
            raise CameraError(f"camera source {self.settings.source} has ended")
        self._latest = frames[-1].image
        return frames

    def _new_tracker(self, start_xy: NDArray[np.float64], **changes: Any) -> EndpointTracker:
        length, width = self.settings.marker
        config = TrackerConfig(
            marker=MarkerConfig(length=length, width=width, hue=self.settings.marker_hue),
            marker_z=self.plane.height,
            exposure_max=self.settings.exposure,
            row_time=self.settings.row_time,
            **changes,
        )
        view, area = self.calibration.view, self.plane.area
        return make_tracker(view, area, self.setup.cable, self.settings, config, start_xy)


class ClockCamera(CameraOfTrials):
    """The camera of a lab file, for the one trial that compares its clock with the robot's.

    Attributes:
        found: Offset of the clocks; None until a trial was filmed to its end.
    """

    found: ClockOffset | None = None

    def start(self) -> None:
        """Start to film."""
        self._cast_clock = clock = CastClock(self._camera.facts.width, self.settings.row_time)
        self._film(lambda frame: clock.keep(frame.image, frame.time))

    def stop(self, timing: TrialTiming) -> EndpointTrack:
        """End the film, and compare the clocks.

        Raises:
            CameraError: The camera failed, or the robot reported no joints.
            InputError: The robot moved otherwise than was seen.
        """
        filming, reported = self._filming, timing.reported
        if filming is None or reported is None:
            self.cancel()
            raise CameraError("clocks are compared by a motion that both camera and robot record")
        self._filming = None
        # Frames that wait to be looked at are of before, however many they are.
        until = time.monotonic() + _AFTER
        filming.finish(lambda frame: frame.arrival >= until)
        found = self._cast_clock.sync(reported, self.setup.arm, self.base_view)
        if self.settings.clock == "arrival":
            # The delay of the robot's own reports is measured anew in each trial.
            shift = controller_shift(timing.clock_pairs)
            found = dataclasses.replace(found, offset=found.offset + shift)
        self.found = found
        return EndpointTrack.unseen(TrialStatus.ABORTED)

    def _fresh(self, count: int, after: float | None = None) -> list[Frame]:
        # The offset is not known yet: frames count by their arrival.
        return super()._fresh(count)


class _Filming:
    """A thread that shows frame after frame to a function, and its film.

    No frame is lost where the function is slower than the camera: it catches up after the motion.
    """

    def __init__(
        self, camera: LiveCamera, look: Callable[[Frame], object], writer: FilmWriter | None
    ):
        self._camera, self._look, self._writer = camera, look, writer
        self._dropped_before = 0
        self.latest: Frame | None = None
        self._is_last: Callable[[Frame], bool] = lambda frame: False
        self._error: Exception | None = None
        self._started = threading.Event()
        # A join that was interrupted counts as done in Python before 3.13, however long it runs on.
        self._ended = threading.Event()
        camera.keep(every=True)
        camera.skip()
        threading.Thread(target=self._run, daemon=True).start()

    def wait_started(self) -> None:
        """Wait until the first frame has come; raise what kept it from coming."""
        self._started.wait()
        if self._error is not None:
            raise self._error

    @property
    def dropped_count(self) -> int:
        """Frames of this film that this computer had no memory for."""
        return self._camera.dropped_count - self._dropped_before

    def finish(self, is_last: Callable[[Frame], bool]) -> None:
        """Film on to the last frame, which may have come long ago, and raise what went wrong."""
        self._is_last = is_last
        try:
            self._ended.wait()
            if self._error is not None:
                raise self._error
        except BaseException:
            # An interrupted film would read the frames of the next trial.
            self.drop()
            raise
        if self._writer is not None:
            self._writer.close()

    def drop(self) -> None:
        """End the film, and forget it."""
        self._is_last = lambda frame: True
        self._ended.wait()
        if self._writer is not None:
            self._writer.close(whole=False)

    def _run(self) -> None:
        try:
            for frame in self._camera:
                if self.latest is None:
                    self._dropped_before = self._camera.dropped_count
                self.latest = frame
                self._look(frame)
                self._started.set()
                if self._is_last(frame):
                    return
            raise CameraError(f"camera source {self._camera.settings.source} has ended")
        except Exception as error:
            self._error = error
        finally:
            self._camera.keep(every=False)
            self._started.set()
            self._ended.set()


def require_camera(setup: Setup) -> CameraSettings:
    """Return the camera of a set-up."""
    if setup.camera is None:
        raise CameraError("the lab file has no section `camera`: name its source there")
    return setup.camera


def calibrate_camera(
    images: list[NDArray[np.uint8]], settings: CameraSettings, plane: SeenPlane
) -> Calibration:
    """Return where a camera is, from the tags in its pictures.

    Raises:
        InputError: Too few tags are seen, or they are not where the layout has them.
    """
    view = float(np.radians(settings.view_deg))
    return calibrate_view(images, plane.tags, lens=settings.lens, diagonal_view=view)


def tags_of(setup: Setup) -> TagLayout:
    """Return the tags that the camera of a set-up sees, in the coordinates of `SeenPlane`."""
    return SeenPlane.of(setup).tags
