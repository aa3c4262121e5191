"""Verbs of the camera: check_camera, sync_camera and sync_film."""

import pathlib
from collections.abc import Callable

import numpy as np

from cablecast.arm.ur import JOINT_COUNT
from cablecast.errors import InputError, check_number
from cablecast.files import read_csv
from cablecast.motion.action import Action
from cablecast.motion.trajectory import JointPath, plan_trajectory
from cablecast.pipeline.places import require
from cablecast.rigs.base import Rig
from cablecast.setup import Setup
from cablecast.vision.check import CameraCheck, CameraReport
from cablecast.vision.clock import ClockOffset, SeenMotion, sync_by_motion
from cablecast.vision.live import LiveCamera
from cablecast.vision.tracker import TrialCamera
from cablecast.vision.trials import calibrate_camera, require_camera
from cablecast.vision.video import read_video

SYNC_ACTION = Action(-0.5, 0.5, 0.6, 0.5)
"""Cast by which the clocks are compared: to the left, and as far to the right."""

_CALIBRATION_FRAMES = 8
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


def sync_camera(setup: Setup, make_rig: Callable[[TrialCamera], Rig]) -> ClockOffset:
    """Measure the offset between the clocks of robot and camera with one cast of the robot.

    Args:
        setup: Set-up with the section `camera`.
        make_rig: Makes the rig that uses a camera; it is reset, and casts straight ahead.

    Raises:
        CameraError: The camera failed.
        InputError: The motion was not seen.
        RigError: The rig failed.
    """
    from cablecast.vision.trials import ClockCamera

    require("the camera", "cv2")
    trajectory = plan_trajectory(SYNC_ACTION, setup)
    with ClockCamera(setup) as camera:
        rig = make_rig(camera)
        try:
            rig.reset()
            rig.execute(trajectory)
        finally:
            rig.close()
        return camera.found()


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
