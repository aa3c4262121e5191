"""Verbs of the camera: check_camera, sync_camera and sync_film."""

import itertools
import pathlib
import threading
from collections.abc import Callable

import numpy as np

from cablecast.arm.limits import JOINT_COUNT
from cablecast.checks import check_number
from cablecast.errors import CameraError, InputError
from cablecast.filming.check import CameraCheck, CameraReport
from cablecast.filming.clock import ClockOffset
from cablecast.filming.gripper import SeenMotion, sync_by_motion
from cablecast.filming.live import LiveCamera
from cablecast.filming.trials import calibrate_camera, require_camera
from cablecast.motion.joint_path import JointPath
from cablecast.pipeline.places import require
from cablecast.reading import read_csv
from cablecast.setup import Setup
from cablecast.tracking.video import read_video

_CALIBRATION_FRAMES = 8
_AFTER = 0.3
"""Time for which the camera films on when the arm has stopped [s]."""
_LOG_COLUMNS = ("time_s", *(f"q{joint}" for joint in range(1, JOINT_COUNT + 1)))


def check_camera(setup: Setup, *, seconds: float = 3.0, tip_speed: float = 5.0) -> CameraReport:
    """Look at what a camera sends, and compare it with what was asked.

    Args:
        setup: Set-up with the section `camera`.
        seconds: Time to look, by the camera's clock [s].
        tip_speed: Speed of the cable's end for which the blur is stated [m/s].

    Raises:
        CameraError: There is no camera, or it cannot be opened.
        InputError: A value is out of bounds, or the camera sent too little.
        MissingExtraError: OpenCV is not installed.
    """
    require("the camera", "cv2")
    check_number("seconds", seconds, 0.2, 600.0, "s")
    check_number("tip_speed", tip_speed, 0.1, 50.0, "m/s")
    with LiveCamera(require_camera(setup)) as camera:
        check = CameraCheck(setup, camera.facts, tip_speed)
        begin: float | None = None
        for frame in camera:
            begin = frame.time if begin is None else begin
            check.look(frame)
            if frame.time >= begin + seconds:
                break
        return check.report(camera.dropped_count)


def sync_camera(setup: Setup, move: Callable[[], JointPath]) -> ClockOffset:
    """Measure the offset between the clocks of robot and camera while the arm swings.

    Args:
        setup: Set-up with the section `camera`.
        move: Swings the arm in sight of the camera, and returns its joints as reported, with times
            by the controller's clock.

    Raises:
        CameraError: The camera failed.
        InputError: The motion was too short, or not seen.
    """
    require("the camera", "cv2")
    settings = require_camera(setup)
    with LiveCamera(settings) as camera:
        frames = itertools.islice(camera, _CALIBRATION_FRAMES)
        view = calibrate_camera([frame.image for frame in frames], setup).view
        filming = _Filming(camera, SeenMotion(settings.row_time))
        try:
            reported = move()
        finally:
            seen = filming.end()
    return sync_by_motion(seen, reported, setup.arm, view)


def sync_film(setup: Setup, film: pathlib.Path, log: pathlib.Path) -> ClockOffset:
    """Measure the offset of the clocks from a film of a swing, and the robot's log of it.

    Args:
        setup: Set-up with the section `camera`.
        film: Film, whose times count from its first frame.
        log: CSV file of the robot's report: time_s [s] and q1 to q6 [rad].

    Returns:
        Time of the robot's clock at the film's first frame.

    Raises:
        InputError: A file makes no sense, or the motion was too short, or not seen.
    """
    require("the camera", "cv2")
    settings, reported = require_camera(setup), read_log(log)
    seen, first = SeenMotion(settings.row_time), []
    for time, image in read_video(film)[1]:
        if len(first) < _CALIBRATION_FRAMES:
            first.append(image)
        seen.look(image, time)
    view = calibrate_camera(first, setup).view
    return sync_by_motion(seen, reported, setup.arm, view)


def read_log(path: pathlib.Path) -> JointPath:
    """Return the joints that a robot reported.

    Args:
        path: CSV file with the columns time_s [s] and q1 to q6 [rad].

    Raises:
        InputError: There is no such file, or it is no such log.
    """
    rows = read_csv(path, _LOG_COLUMNS)
    try:
        values = np.array([[float(row[name]) for name in _LOG_COLUMNS] for row in rows])
    except ValueError:
        raise InputError(f"{path} holds something else than numbers") from None
    if len(values) < 2 or not np.all(np.isfinite(values)):
        raise InputError(f"{path} must hold at least two rows of finite numbers")
    if np.any(np.diff(values[:, 0]) <= 0):
        raise InputError(f"the times in {path} do not rise")
    q = values[:, 1:]
    qd = np.gradient(q, values[:, 0], axis=0)
    return JointPath(times=values[:, 0], q=q, qd=qd)


class _Filming:
    """Looks at frames in a thread while the arm moves.

    Args:
        camera: Camera to read.
        seen: Motion to add to.
    """

    def __init__(self, camera: LiveCamera, seen: SeenMotion):
        self._camera, self._seen = camera, seen
        self._done, self._begun = threading.Event(), threading.Event()
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self._begun.wait()

    def end(self) -> SeenMotion:
        """Film on for a moment, and return what was seen."""
        self._done.set()
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self._seen

    def _run(self) -> None:
        end = np.inf
        try:
            for frame in self._camera:
                self._seen.look(frame.image, frame.time)
                self._begun.set()
                if self._done.is_set():
                    end = min(end, frame.time + _AFTER)
                if frame.time > end:
                    return
            raise CameraError(f"camera source {self._camera.settings.source} has ended")
        except Exception as error:
            self._error = error
        finally:
            self._begun.set()
