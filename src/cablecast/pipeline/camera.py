"""Verbs of the camera: check_camera, sync_camera, sync_film, calibrate_table, calibrate_lens_of."""

import dataclasses
import itertools
import pathlib
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import Arm
from cablecast.camera.lens import CameraView
from cablecast.camera.tags import Point, TableFit, fit_table
from cablecast.errors import CameraError, InputError, check_count, check_number
from cablecast.files import read_numbers
from cablecast.motion.casting import Action
from cablecast.motion.joint_move import JointMoves
from cablecast.motion.trajectory import JointPath, plan_trajectory
from cablecast.rigs.arm_swing import make_arm
from cablecast.rigs.base import Rig
from cablecast.runs.progress import Progress, ProgressCallback, show
from cablecast.setup import Setup, load_setup, update_lab_file
from cablecast.vision.calibration import (
    BOARD_CORNERS_MIN,
    Board,
    LensFit,
    calibrate_lens,
    find_board,
)
from cablecast.vision.check import CameraCheck, CameraReport
from cablecast.vision.clock import CastClock, ClockOffset
from cablecast.vision.live import LiveCamera
from cablecast.vision.plane import SeenPlane
from cablecast.vision.trials import (
    ClockCamera,
    TrialCamera,
    calibrate_camera,
    require_camera,
    tags_of,
)
from cablecast.vision.video import read_pictures, read_video

SYNC_ACTION = Action(-0.5, 0.5, 0.6, 0.5)
"""Cast by which the clocks are compared: to the left, and as far to the right."""
AXIS_OFFSET_MAX = 0.01
"""Distance of the robot's axis from the table's middle line that is not reported [m]."""

_CALIBRATION_FRAMES = 8
_BOARD_MOVE, _BOARD_STILL = 0.08, 1.0
"""Way of a board between two pictures of it, as a share of the image's width; and longest way of a
corner from one frame to the next of a board that is held still [px]."""
_HEIGHT_OFF_MAX = 0.05
"""Largest difference of the base's height from that of the lab file that is no other tool [m]."""


def check_camera(setup: Setup, *, seconds: float = 3.0, tip_speed: float = 5.0) -> CameraReport:
    """Look for a time [s] at what a camera sends, and compare it with what was asked.

    The blur is stated for a speed of the cable's end [m/s].

    Raises:
        CameraError: There is no camera, or it cannot be opened.
        InputError: A value is out of bounds, or the camera sent too little.
        MissingExtraError: OpenCV is not installed.
    """
    check_number("seconds", seconds, 0.2, 600.0, "s")
    check_number("tip_speed", tip_speed, 0.1, 50.0, "m/s")
    with LiveCamera(require_camera(setup)) as camera:
        check = CameraCheck(setup, camera.facts, tip_speed)
        start: float | None = None
        for frame in camera:
            start = frame.time if start is None else start
            check.look(frame)
            if frame.time >= start + seconds:
                break
        return check.report(camera.dropped_count)


def sync_camera(
    setup: Setup, make_rig: Callable[[Setup, TrialCamera], Rig] | None = None
) -> ClockOffset:
    """Measure the offset between the clocks of robot and camera with one motion.

    It is `SYNC_ACTION` over a table, and the middle move of a strike section before its camera.

    Raises:
        CameraError: The camera failed, or the cast was aborted.
        InputError: The motion was not seen.
        RigError: The rig failed.
    """
    action = SYNC_ACTION
    if SeenPlane.of(setup).in_air:
        moves = JointMoves.of(setup)
        action = moves.move(np.full(moves.size, 0.5))
    else:
        setup = dataclasses.replace(setup, strike=None)
    trajectory = plan_trajectory(action, setup)
    with ClockCamera(setup) as camera:
        rig = (make_rig or make_arm)(setup, camera)
        try:
            rig.reset()
            track = rig.execute(trajectory)
        finally:
            rig.close()
        if camera.found is None:
            raise CameraError(
                f"the cast was aborted, so that the clocks could not be compared: {track.note}"
            )
        return camera.found


def sync_film(setup: Setup, film: pathlib.Path, log: pathlib.Path) -> ClockOffset:
    """Measure the time of the robot's clock at the first frame of a film of a swing.

    The log is a CSV file of the robot's report: time_s [s] and the joints from q1 on [rad].

    Raises:
        InputError: A file makes no sense, or the motion was too short, or not seen.
    """
    settings, reported = require_camera(setup), read_log(log, setup.arm)
    frames = read_video(film)[1]
    first = [image for _, image in itertools.islice(frames, _CALIBRATION_FRAMES)]
    plane = SeenPlane.of(setup)
    view = plane.base_view(calibrate_camera(first, settings, plane).view)
    return film_offset(film, reported, setup.arm, view, settings.row_time)


def film_offset(
    film: pathlib.Path,
    reported: JointPath,
    arm: Arm,
    view: CameraView,
    row_time: float = 0.0,
    pace: float = 1.0,
) -> ClockOffset:
    """Return the time of the robot's clock at a film's first frame, a second of which took a pace.

    Raises:
        InputError: The motion was too short or not seen, or it was as long as another pace has it.
    """
    info, frames = read_video(film)
    clock = CastClock(info.width, row_time)
    for time, image in frames:
        clock.keep(image, pace * time)
    return clock.sync(reported, arm, view)


def read_log(path: pathlib.Path, arm: Arm) -> JointPath:
    """Return the joints that a robot reported in a CSV file."""
    columns = ("time_s", *(f"q{joint}" for joint in range(1, arm.joint_count + 1)))
    values = np.array(read_numbers(path, columns, 2))
    times, q = values[:, 0], values[:, 1:]
    if np.any(np.diff(times) <= 0):
        raise InputError(f"the times in {path} do not rise")
    return JointPath(times=times, q=q, qd=np.gradient(q, times, axis=0))


def calibrate_table(
    lab_file: pathlib.Path, touched: Mapping[int, Point], *, write: bool = True
) -> TableFit:
    """Find where the robot stands at the table, and write it into the lab file.

    The touched points are in the controller's base frame, by the number of the tag [m]. Written are
    `base_height` and `base_yaw_deg` of the arm, `table_near_y` of the workspace, and the `tags` of
    the camera, all from the axis of the robot's first joint.

    Raises:
        InputError: The touches give no pose or another height of the base than the lab file, or
            this would make no sense.
    """
    setup = load_setup(lab_file)
    if require_camera(setup).wall is not None:
        raise InputError("the camera of swings sees no table: measure the tags on its wall by tape")
    fit = fit_table(tags_of(setup), touched)
    off = fit.base_height - setup.arm.base_height
    if not write:
        return fit
    if abs(off) > _HEIGHT_OFF_MAX:
        # Touches with the tip of another tool agree as well, at another height.
        raise InputError(
            f"the touches put the base {fit.base_height:.3f} m above the table, and the lab file "
            f"{setup.arm.base_height:.3f} m: is the active TCP that of the tip that touched? If it "
            "is, measure base_height with a tape, write it into the lab file, and run this again"
        )
    rows = [
        {name: value if name == "id" else round(value, 5) for name, value in row.items()}
        for row in fit.layout.to_dict()["tags"]
    ]
    changes = {
        "arm": {
            "base_height": round(fit.base_height, 5),
            "base_yaw_deg": round(fit.base_yaw_deg, 3),
        },
        "workspace": {"table_near_y": round(setup.workspace.table_near_y - fit.axis_xy[1], 5)},
        "camera": {"tags": rows, "tag_family": fit.layout.family},
    }
    update_lab_file(lab_file, changes)
    return fit


def calibrate_lens_of(
    lab_file: pathlib.Path,
    *,
    board: Board | None = None,
    pictures: pathlib.Path | None = None,
    count: int = 15,
    write: bool = True,
    progress: ProgressCallback = show,
) -> LensFit:
    """Find the lens of the camera from a board, and write it into the lab file.

    Without a folder of pictures, `count` of them are taken from the camera, whenever the board is
    held still at a new place.

    Raises:
        CameraError: The camera failed.
        InputError: Too few pictures show the board, or they are of another size.
    """
    settings = require_camera(load_setup(lab_file))
    board = board or Board()
    if pictures is not None:
        images = read_pictures(pictures)
    else:
        check_count("pictures of a board", count, 5, 200)
        # A lens of another size must not stop a new calibration.
        with LiveCamera(dataclasses.replace(settings, lens=None)) as camera:
            images = _gather_boards(camera, board, count, progress)
    fit = calibrate_lens(images, board)
    if (fit.lens.width, fit.lens.height) != (settings.width, settings.height):
        raise InputError(
            f"the pictures have {fit.lens.width} x {fit.lens.height} px, but the lab file asks the "
            f"camera for {settings.width} x {settings.height}"
        )
    if write:
        update_lab_file(lab_file, {"camera": {"lens": fit.lens.to_dict()}})
    return fit


def _gather_boards(
    camera: LiveCamera, board: Board, count: int, progress: ProgressCallback
) -> list[NDArray[np.uint8]]:
    """Return pictures that show a board, in either pattern, at places apart from one another."""
    patterns = [dataclasses.replace(board, legacy=legacy) for legacy in (False, True)]
    images: list[NDArray[np.uint8]] = []
    places: list[NDArray[np.float64]] = []
    before = np.empty((0, 2))
    for frame in camera:
        corners = max((find_board(frame.image, pattern)[0] for pattern in patterns), key=len)
        if len(corners) < BOARD_CORNERS_MIN:
            continue
        last, before = before, corners.reshape(-1, 2)
        # A board that moves is blurred, and a rolling shutter bends it.
        is_still = len(last) == len(before) and np.abs(before - last).max() < _BOARD_STILL
        if not is_still:
            continue
        place = before.mean(axis=0)
        move = _BOARD_MOVE * frame.image.shape[1]
        if any(np.linalg.norm(place - other) < move for other in places):
            continue
        images.append(frame.image)
        places.append(place)
        progress(Progress(task="Pictures of the board", done=len(images), total=count))
        if len(images) >= count:
            break
    return images
