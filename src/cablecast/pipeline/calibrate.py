"""Calibration verbs: calibrate_table and calibrate_lens_of, which write into the lab file."""

import dataclasses
import pathlib
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.tags import Point, TableFit, fit_table
from cablecast.errors import InputError, check_count
from cablecast.pipeline.places import require
from cablecast.pipeline.track_video import read_pictures
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.setup import load_setup, update_lab_file
from cablecast.vision.calibration import (
    BOARD_CORNERS_MIN,
    Board,
    LensFit,
    calibrate_lens,
    find_board,
)
from cablecast.vision.live import Frame, LiveCamera
from cablecast.vision.trials import require_camera, tags_of

AXIS_OFFSET_MAX = 0.01
"""Distance of the robot's axis from the table's middle line that is not worth a word [m]."""

_BOARD_MOVE = 0.08
"""Way of a board between two pictures of it, as a share of the image's width."""


def calibrate_table(
    lab_file: pathlib.Path, touched: Mapping[int, Point], *, write: bool = True
) -> TableFit:
    """Find where the robot stands at the table, and write it into the lab file.

    Written are `base_height` and `base_yaw_deg` of the arm, `table_near_y` of the workspace, and
    the `tags` of the camera, all from the axis of the robot's first joint.

    Args:
        lab_file: Lab file with the section `camera`, whose tags were measured with a tape.
        touched: Points in the controller's base frame by the number of the tag [m].
        write: Whether to write into the lab file.

    Raises:
        InputError: The touches tell no pose, or the lab file would make no sense.
    """
    setup = load_setup(lab_file)
    require_camera(setup)
    fit = fit_table(tags_of(setup), touched)
    if write:
        near_y = round(setup.workspace.table_near_y - fit.axis_xy[1], 5)
        rows = [
            {name: round(float(value), 5) if name != "id" else value for name, value in row.items()}
            for row in fit.layout.to_rows()
        ]
        changes = {
            "arm": {
                "base_height": round(fit.base_height, 5),
                "base_yaw_deg": round(fit.base_yaw_deg, 3),
            },
            "workspace": {"table_near_y": near_y},
            "camera": {"tags": rows},
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
    progress: ProgressCallback | None = None,
) -> LensFit:
    """Find the lens of the camera from a board, and write it into the lab file.

    Args:
        lab_file: Lab file with the section `camera`.
        board: Board that is shown; the default one where None, in either pattern.
        pictures: Folder of pictures of it; taken from the camera where None, whenever the board is
            held still at a new place.
        count: Pictures to take from the camera.
        write: Whether to write into the lab file.
        progress: Told how many pictures are taken.

    Raises:
        CameraError: The camera failed.
        InputError: Too few pictures show the board, or they are of another size.
    """
    require("the camera", "cv2")
    setup = load_setup(lab_file)
    settings = require_camera(setup)
    board = board or Board()
    if pictures is not None:
        images = read_pictures(pictures)
    else:
        check_count("pictures of a board", count, 5, 200)
        # A lens of another size must not stop a new calibration.
        with LiveCamera(dataclasses.replace(settings, lens=None)) as camera:
            images = gather_boards(camera, board, count, progress or ignore)
    fit = calibrate_lens(images, board)
    size = (fit.lens.width, fit.lens.height)
    if size != (settings.width, settings.height):
        raise InputError(
            f"the pictures have {size[0]} x {size[1]} px, but the lab file asks the camera for "
            f"{settings.width} x {settings.height}"
        )
    if write:
        update_lab_file(lab_file, {"camera": {"lens": fit.lens.to_dict()}})
    return fit


def gather_boards(
    frames: Iterable[Frame], board: Board, count: int, progress: ProgressCallback = ignore
) -> list[NDArray[np.uint8]]:
    """Return pictures that show a board at places apart from one another.

    Args:
        frames: Frames of a camera.
        board: Board that is shown, in either pattern.
        count: Pictures to take.
        progress: Told how many pictures are taken.
    """
    patterns = [dataclasses.replace(board, legacy=legacy) for legacy in (False, True)]
    images: list[NDArray[np.uint8]] = []
    places: list[NDArray[np.float64]] = []
    for frame in frames:
        corners = max((find_board(frame.image, pattern)[0] for pattern in patterns), key=len)
        if len(corners) < BOARD_CORNERS_MIN:
            continue
        place = corners.reshape(-1, 2).mean(axis=0)
        move = _BOARD_MOVE * frame.image.shape[1]
        if any(np.linalg.norm(place - other) < move for other in places):
            continue
        images.append(frame.image)
        places.append(place)
        progress(Progress(task="Pictures of the board", done=len(images), total=count))
        if len(images) >= count:
            break
    return images
