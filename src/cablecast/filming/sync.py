"""ClockCamera: a camera of trials that compares its clock with the robot's instead of tracking."""

import threading
import time

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import CameraError
from cablecast.filming.clock import ClockOffset, controller_shift
from cablecast.filming.gripper import SeenMotion, sync_by_motion
from cablecast.filming.live import LiveCamera
from cablecast.filming.trials import CameraOfTrials
from cablecast.motion.joint_path import JointPath
from cablecast.setup import Setup
from cablecast.track import EndpointTrack, TrialStatus
from cablecast.tracking.trial_camera import TrialTiming

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
