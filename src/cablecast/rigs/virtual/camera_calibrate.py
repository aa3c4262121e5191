"""Calibrates the virtual camera as a person does the real one: a board, then the tags."""

import numpy as np
from numpy.typing import NDArray

from cablecast.rigs.virtual.camera import VirtualCamera
from cablecast.rigs.virtual.camera_config import Mount
from cablecast.vision.calibration import Board, Calibration, calibrate_lens, calibrate_view
from cablecast.vision.tags import load_cv2

_BOARD_COUNT = 12
_EMPTY_COUNT = 3


def board_pictures(
    camera: VirtualCamera, seed: int = 0, board: Board | None = None
) -> list[NDArray[np.uint8]]:
    """Draw pictures of a calibration board, held over the table at several angles.

    Args:
        camera: Camera to hold the board before.
        seed: Seed of the board's places and of the noise.
        board: Board to hold; the default one where None.
    """
    cv2 = load_cv2()
    rng = np.random.default_rng([seed, 41])
    board, mount = board or Board(), Mount.over(camera.workspace)
    pictures = []
    for index in range(_BOARD_COUNT):
        # Face up, tilted by up to half a radian, anywhere from just above the table to halfway up.
        R = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3))[0] @ np.diag([1.0, -1.0, -1.0])
        across, along = rng.uniform(-0.8, 0.8), rng.uniform(-0.4, 0.4)
        up = rng.uniform(0.5, 1.3)
        if mount.quarter_turns:
            across, along = along, across
        centre = np.array(
            [mount.scale * across, mount.centre_y + mount.scale * along, mount.scale * up]
        )
        pictures.append(camera.board_frame(board, R, centre, seed + index))
    return pictures


def calibrate_virtual_camera(camera: VirtualCamera, seed: int = 0) -> Calibration:
    """Return a calibration from rendered pictures alone.

    Args:
        camera: Camera to calibrate.
        seed: Seed of the board's places and of the noise.
    """
    lens = calibrate_lens(board_pictures(camera, seed), Board()).lens
    frames = [camera.empty_frame(seed + 1000 + index) for index in range(_EMPTY_COUNT)]
    return calibrate_view(frames, camera.layout, lens=lens)
