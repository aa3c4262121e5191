"""CameraOfTrials: films the trials of a rig with a real camera, and tracks the endpoint in them.

ClockCamera: a camera of trials that compares its clock with the robot's instead of tracking.
"""

import pathlib
import threading
import time
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.settings import CameraSettings, CameraSight
from cablecast.camera.tags import TagLayout, default_layout
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.errors import CameraError
from cablecast.motion.trajectory import JointPath
from cablecast.setup import Setup
from cablecast.vision.calibration import Calibration, calibrate_view
from cablecast.vision.clock import ClockOffset, SeenMotion, controller_shift, sync_by_motion
from cablecast.vision.live import Brightness, Frame, FrameWatch, LiveCamera
from cablecast.vision.tags import detect_tags
from cablecast.vision.tracker import (
    EndpointTracker,
    MarkerConfig,
    TrackerConfig,
    TrialTiming,
    sight_of,
)
from cablecast.vision.video import FilmWriter

_CALIBRATION_FRAMES = 8
_CHECK_FRAMES = 6
_LOCATE_FRAMES = 3
_TAG_MOVE_MAX = 3.0
"""Longest way of a tag's centre since the calibration that is no move, but noise [px]."""
_APART_MAX = 60.0
"""Largest distance of two times of one trial by both clocks, if these have been compared [s]."""
_LATENCY_MAX = 0.25
"""Longest way of a frame from the sensor to this process [s]."""
_LOCATE_RADIUS = 0.5
"""Distance from where the endpoint is expected within which it is looked for [m]."""


class CameraOfTrials:
    """The camera of a lab file behind the protocol `TrialCamera`.

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
        self._opened_at = time.strftime("%Y%m%d-%H%M%S")
        self._film_count = 0
        self._filming: _Filming | None = None
        self._last_xy: NDArray[np.float64] | None = None
        self._camera = LiveCamera(self.settings)
        try:
            images = [frame.image for frame in self._fresh(_CALIBRATION_FRAMES)]
            self.calibration = calibrate_camera(images, setup)
        except BaseException:
            self._camera.close()
            raise
        self._sight = CameraSight(position=self.calibration.view.position)
        self._latest = images[-1]
        self._usual = Brightness.of(images[-1])
        self._tags = detect_tags(images[-1])
        self.description: dict[str, Any] = {
            "camera": self._camera.facts.kind,
            **self.settings.to_dict(),
            "calibration_rms_mm": 1e3 * self.calibration.rms,
            "tags_used": len(self.calibration.tag_ids),
            "tags_rejected": list(self.calibration.rejected_ids),
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def check(self, after: float | None = None) -> None:
        """Check that frames arrive, are fresh and as exposed as before, and that no tag moved.

        Args:
            after: Time by the controller's clock from which on frames count [s]; from now on where
                None.

        Raises:
            CameraError: The camera cannot see a trial; says what to do.
        """
        watch = FrameWatch(self.settings.source, self._usual)
        frames = self._fresh(_CHECK_FRAMES, after)
        for frame in frames:
            watch.look(frame)
        seen = detect_tags(frames[-1].image)
        common = sorted(set(seen) & set(self._tags))
        moved = [
            tag_id
            for tag_id in common
            if np.linalg.norm(np.mean(seen[tag_id] - self._tags[tag_id], axis=0)) > _TAG_MOVE_MAX
        ]
        if len(moved) > len(common) / 2:
            raise CameraError(
                f"the camera was moved: {len(moved)} of {len(common)} tags are seen elsewhere. "
                "Start anew, so that it is calibrated in its new place"
            )
        if moved:
            raise CameraError(
                f"tags {moved} were moved since the camera was calibrated: put them back, or "
                "measure their new places and start anew"
            )

    def start(self) -> None:
        """Begin to film: the motion starts after this returns."""
        self.cancel()
        self._camera.skip()
        writer = None
        if self.settings.films is not None:
            name = f"{self._opened_at}-{self._film_count:04}.mkv"
            writer = FilmWriter(pathlib.Path(self.settings.films) / name, self.settings.rate)
            self._film_count += 1
        workspace = self.setup.workspace
        start_xy = (0.0, workspace.reset_y + self.setup.cable.length)
        watch = FrameWatch(self.settings.source, self._usual)
        self._filming = _Filming(self._camera, self._tracker(start_xy), watch, writer)
        try:
            self._filming.wait_begun()
        except BaseException:
            # Nobody ends a film that was not begun.
            self.cancel()
            raise

    def stop(self, timing: TrialTiming) -> EndpointTrack:
        """End the film, and return the endpoint's track.

        Args:
            timing: Begin and end of the trial.

        Raises:
            CameraError: The film was not begun, or the camera failed while it filmed.
        """
        filming, self._filming = self._filming, None
        if filming is None:
            raise CameraError("the camera was not started before the motion")
        # Times of frames and of the controller differ by this.
        shift = self.settings.clock_offset
        if self.settings.clock == "arrival":
            shift -= controller_shift(timing.clock_pairs)
        begin = timing.start_time - shift
        if abs(apart := filming.last_time - begin) > _APART_MAX:
            filming.drop()
            raise CameraError(
                f"the clocks of robot and camera are {abs(apart):.0f} s apart: one was started "
                "anew, or they were never compared. Run `cablecast camera sync`"
            )
        tracker = filming.finish(timing.end_time - shift)
        if filming.latest is not None:
            self._latest = filming.latest
        self._sight = sight_of(tracker)
        track = tracker.track(timing.end_time - timing.start_time, begin)
        seen = tracker.frames[1]
        seen = seen[np.isfinite(seen).all(axis=1)]
        self._last_xy = seen[-1] if len(seen) else None
        return EndpointTrack(
            times=track.times,
            endpoint_xy=track.endpoint_xy,
            status=track.status,
            joint_path=timing.joint_path,
        )

    def cancel(self) -> None:
        """Drop the film of a trial that was aborted; harmless where none runs."""
        filming, self._filming = self._filming, None
        if filming is not None:
            filming.drop()

    def locate(self, after: float | None = None) -> NDArray[np.float64] | None:
        """Return where the endpoint is now [m], shape [2]; None where it is not seen.

        It is looked for about its place after a reset, then about where it was seen last.

        Args:
            after: Time by the controller's clock from which on frames count [s]; from now on where
                None.
        """
        frames = self._fresh(_LOCATE_FRAMES, after)
        workspace = self.setup.workspace
        places = [np.array([0.0, workspace.reset_y + self.setup.cable.length])]
        places += [] if self._last_xy is None else [self._last_xy]
        for place in places:
            tracker = self._tracker(place, start_radius=_LOCATE_RADIUS)
            for frame in frames:
                xy = _look(tracker, frame)
            if np.isfinite(xy).all():
                return xy
        return None

    def picture(self) -> NDArray[np.uint8]:
        """Return the latest picture that was read, BGR, shape [v, u, 3]; from any thread."""
        filming = self._filming
        latest = None if filming is None else filming.latest
        return self._latest if latest is None else latest

    def sight(self) -> CameraSight:
        """Return what the camera cannot see: blind places are known after the first trial."""
        return self._sight

    def close(self) -> None:
        """Let go of the device; it may be called twice."""
        self.cancel()
        self._camera.close()

    def _fresh(self, count: int, after: float | None = None) -> list[Frame]:
        """Return the next frames, and none that has waited.

        Args:
            count: Number of frames.
            after: Time by the controller's clock from which on frames count [s].
        """
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
        if frames:
            self._latest = frames[-1].image
        return frames

    def _tracker(self, start_xy: Any, **changes: Any) -> EndpointTracker:
        length, width = self.settings.marker
        config = TrackerConfig(
            marker=MarkerConfig(length=length, width=width),
            marker_z=self.setup.cable.radius,
            exposure_max=self.settings.exposure,
            row_time=self.settings.row_time,
            **changes,
        )
        return EndpointTracker(self.calibration.view, self.setup.workspace, config, start_xy)


class _Filming:
    """One film while it is made: a thread that reads frames and tracks the marker in them.

    Args:
        camera: Camera to read.
        tracker: Tracker to show the frames to.
        watch: Watch to show them to.
        writer: Keeps the frames; None to keep none.
    """

    def __init__(
        self,
        camera: LiveCamera,
        tracker: EndpointTracker,
        watch: FrameWatch,
        writer: FilmWriter | None,
    ):
        self._camera, self._tracker, self._watch, self._writer = camera, tracker, watch, writer
        self.last_time = -np.inf
        self.latest: NDArray[np.uint8] | None = None
        self._until = np.inf
        self._error: BaseException | None = None
        self._begun = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def wait_begun(self) -> None:
        """Wait until the first frame has come.

        Raises:
            CameraError: None came.
        """
        self._begun.wait()
        if self._error is not None:
            self._raise()

    def finish(self, until: float) -> EndpointTracker:
        """Wait for the frames up to some time, and return the tracker that has seen them.

        Args:
            until: Time in the camera's clock [s].

        Raises:
            CameraError: The camera failed.
        """
        self._until = until
        self._thread.join()
        if self._error is not None:
            self._raise()
        if self._writer is not None:
            self._writer.close()
        return self._tracker

    def drop(self) -> None:
        """End the film, and forget it."""
        self._until = -np.inf
        self._thread.join()
        if self._writer is not None:
            self._writer.close(whole=False)

    def _raise(self) -> None:
        self.drop()
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        try:
            while (frame := self._camera.read()) is not None:
                self.last_time, self.latest = frame.time, frame.image
                self._watch.look(frame)
                _look(self._tracker, frame)
                if self._writer is not None:
                    self._writer.write(frame.image, frame.time)
                self._begun.set()
                # A sample at the very end lies between two frames, with a shutter that rolls.
                if frame.time > self._until + 1.5 / self._camera.settings.rate:
                    return
            raise CameraError(f"camera source {self._camera.settings.source} has ended")
        except Exception as error:
            self._error = error
        finally:
            self._begun.set()


def require_camera(setup: Setup) -> CameraSettings:
    """Return the camera of a set-up.

    Raises:
        CameraError: It has none.
    """
    if setup.camera is None:
        raise CameraError("the lab file has no section `camera`: name its source there")
    return setup.camera


def calibrate_camera(images: list[NDArray[np.uint8]], setup: Setup) -> Calibration:
    """Return where the camera of a set-up is, from the tags in its pictures.

    Args:
        images: Pictures from the unmoved camera.
        setup: Set-up with the section `camera`.

    Raises:
        InputError: Too few tags are seen, or they are not where the layout has them.
    """
    settings = require_camera(setup)
    view = float(np.radians(settings.view_deg))
    return calibrate_view(images, tags_of(setup), lens=settings.lens, diagonal_view=view)


def tags_of(setup: Setup) -> TagLayout:
    """Return the tags on the table of a set-up."""
    tags = None if setup.camera is None else setup.camera.tags
    return default_layout(setup.workspace) if tags is None else tags


def _look(tracker: EndpointTracker, frame: Frame) -> NDArray[np.float64]:
    """Show a frame to a tracker, and return the endpoint in it."""
    image = frame.image
    return tracker.update(frame.time, lambda w: image[w[1] : w[3], w[0] : w[2]])


_AFTER = 0.3
"""Time for which the camera films on when the arm has stopped [s]."""


class ClockCamera(CameraOfTrials):
    """The camera of a lab file, for the one trial that compares its clock with the robot's.

    It does not know the offset yet, and so goes by the arrival of frames where a trial camera goes
    by the robot's times.

    Args:
        setup: Set-up with the section `camera`.
    """

    def __init__(self, setup: Setup):
        super().__init__(setup)
        self._motion: _MotionFilm | None = None
        self._found: ClockOffset | None = None

    def found(self) -> ClockOffset:
        """Return the offset of the clocks.

        Raises:
            CameraError: No trial was filmed to its end.
        """
        if self._found is None:
            raise CameraError("the cast was aborted, so that the clocks could not be compared")
        return self._found

    def check(self, after: float | None = None) -> None:
        """Check the camera; see `CameraOfTrials.check`."""
        super().check()

    def locate(self, after: float | None = None) -> NDArray[np.float64] | None:
        """Return where the endpoint is; see `CameraOfTrials.locate`."""
        return super().locate()

    def start(self) -> None:
        """Begin to film."""
        self.cancel()
        self._camera.skip()
        self._motion = _MotionFilm(self._camera, SeenMotion(self.settings.row_time))

    def stop(self, timing: TrialTiming) -> EndpointTrack:
        """End the film, and compare the clocks.

        Args:
            timing: Begin and end of the trial, with the joints as the robot reported them.

        Raises:
            CameraError: The camera failed, or the robot reported no joints.
            InputError: The robot moved otherwise than was seen.
        """
        motion, self._motion = self._motion, None
        path = timing.joint_path
        if motion is None or path is None:
            raise CameraError("clocks are compared by a motion that both camera and robot tell of")
        seen = motion.end()
        reported = JointPath(times=path.times + timing.start_time, q=path.q, qd=path.qd)
        found = sync_by_motion(seen, reported, self.setup.arm, self.calibration.view)
        if self.settings.clock == "arrival":
            # What the arrivals of the robot's own reports tell is measured anew in each trial.
            shift = controller_shift(timing.clock_pairs)
            found = ClockOffset(
                offset=found.offset + shift,
                sd=found.sd,
                explained=found.explained,
                frame_count=found.frame_count,
            )
        self._found = found
        return EndpointTrack(
            times=np.zeros(1), endpoint_xy=np.full((1, 2), np.nan), status=TrialStatus.ABORTED
        )

    def cancel(self) -> None:
        """Drop the film."""
        super().cancel()
        motion, self._motion = getattr(self, "_motion", None), None
        if motion is not None:
            motion.drop()


class _MotionFilm:
    """Looks at frames in a thread while the arm moves.

    Args:
        camera: Camera to read.
        seen: Motion to add to.
    """

    def __init__(self, camera: LiveCamera, seen: SeenMotion):
        self._camera, self._seen = camera, seen
        self._done, self._begun = threading.Event(), threading.Event()
        self._until = -np.inf
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self._begun.wait()

    def end(self) -> SeenMotion:
        """Film on for a moment, and return what was seen.

        Frames that wait to be looked at are of before, however many they are.
        """
        self._until = time.monotonic() + _AFTER
        self._done.set()
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self._seen

    def drop(self) -> None:
        """End the film at once."""
        self._done.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            for frame in self._camera:
                self._seen.look(frame.image, frame.time)
                self._begun.set()
                if self._done.is_set() and frame.arrival >= self._until:
                    return
            raise CameraError(f"camera source {self._camera.settings.source} has ended")
        except Exception as error:
            self._error = error
        finally:
            self._begun.set()
