"""Lenses from a board: determined by the pictures, or refused with those that are missing."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.camera.lens import CameraView, Lens
from cablecast.camera.tags import default_layout
from cablecast.errors import InputError
from cablecast.pipeline.camera import _gather_boards
from cablecast.rigs.virtual.camera import VirtualCamera
from cablecast.rigs.virtual.config import CameraConfig
from cablecast.runs.progress import ignore
from cablecast.vision import calibration
from cablecast.vision.calibration import Board, calibrate_lens, fit_lens
from cablecast.vision.tags import load_cv2

cv2 = load_cv2()
LENS = Lens(
    width=1920,
    height=1080,
    focal=(1360.0, 1360.0),
    centre=(970.0, 530.0),
    distortion=(-0.1, 0.05, 0.0005, -0.0003, 0.0),
)
BOARD = Board()
BOUND = calibration.EDGE_SD_MAX
CORNERS = np.array(BOARD.to_opencv().getChessboardCorners())
VIEW = CameraView(
    lens=LENS, rotation=((1, 0, 0), (0, -1, 0), (0, 0, -1)), position=(0.0, 0.75, 1.9)
)
# Scatter of a corner of a real board [px].
NOISE = 0.2
# An error beyond so many standard deviations is no scatter.
SD_COUNT = 4.0
# Of the way from the picture's middle to its edges, at which people hold a board: so far that the
# pictures determine the lens, and so little that they do not.
HALF_WAY, LITTLE = 0.5, 0.3
# What a lens that is not refused costs on the table, and 5 cm above it [m].
COST = 1e-3


def seen(rng, turn, place):
    """Corners of the board, turned (a rotation vector) at a place before the camera [m]."""
    points = (CORNERS - CORNERS.mean(axis=0)) @ cv2.Rodrigues(np.array(turn, float))[0].T + place
    pixels = LENS.distort(points[:, :2] / points[:, 2:])
    ids = np.flatnonzero(np.all((pixels > 5) & (pixels < [1914, 1074]), axis=1))
    pixels = pixels[ids] + rng.normal(0.0, NOISE, (len(ids), 2))
    return pixels[:, None].astype(np.float32), ids[:, None].astype(np.int32)


def anywhere(rng, far=1.6):
    z = rng.uniform(0.5 * far, far)
    return [rng.uniform(-0.5, 0.5) * z, rng.uniform(-0.25, 0.25) * z, z]


def tilted(rng, largest=0.6):
    return [*rng.uniform(-largest, largest, 2), 0.0]


SETS = {
    "all face the camera": lambda r: [seen(r, [0, 0, 0], anywhere(r)) for _ in range(10)],
    "facing and still": lambda r: [seen(r, [0, 0, 0], [0, 0, 0.7]) for _ in range(10)],
    "facing and rolled": lambda r: [seen(r, [0, 0, a], [0, 0, 0.7]) for a in np.linspace(0, 3, 10)],
    "one tilt": lambda r: [seen(r, [0.5, 0, 0], anywhere(r)) for _ in range(10)],
    "tilted by 5 degrees": lambda r: [seen(r, tilted(r, 0.08), anywhere(r)) for _ in range(10)],
    "tiny in the middle": lambda r: [seen(r, tilted(r), [0, 0, 5.0]) for _ in range(10)],
    "far away": lambda r: [seen(r, tilted(r), anywhere(r, 8.0)) for _ in range(10)],
    "one picture": lambda r: [seen(r, tilted(r), anywhere(r))],
    "one picture ten times": lambda r: 10 * [seen(r, tilted(r), anywhere(r))],
    "a single row": lambda r: [
        (corners[20:30], ids[20:30])
        for corners, ids in (seen(r, tilted(r), [0, 0, 1.0]) for _ in range(10))
    ],
    "two pictures by turns": lambda r: 5 * [seen(r, tilted(r), anywhere(r)) for _ in range(2)],
    "tilted about one axis": lambda r: [
        seen(r, [a, 0, 0], anywhere(r)) for a in np.linspace(-0.6, 0.6, 10)
    ],
    "in one half": lambda r: [
        seen(r, tilted(r), [r.uniform(-0.9, -0.3), r.uniform(-0.2, 0.2), 1.2]) for _ in range(10)
    ],
    "tilted, but never near the edges": lambda r: [
        seen(r, tilted(r), [r.uniform(-0.15, 0.15), r.uniform(-0.1, 0.1), r.uniform(1.4, 1.8)])
        for _ in range(20)
    ],
    "as it should be": lambda r: [seen(r, tilted(r), anywhere(r)) for _ in range(12)],
}
HONEST = ("tilted about one axis", "in one half", "as it should be")


def held(rng, reach, count=15):
    """Boards that fill a quarter to half of the picture, up to a share of the way to its edges."""
    half = np.array([LENS.width, LENS.height]) / 2 / LENS.focal
    places = []
    for z in rng.uniform(0.9, 1.7, count):
        places.append([*(rng.uniform(-reach, reach, 2) * half * z), z])
    return [seen(rng, tilted(rng, 0.5), place) for place in places]


def cost(lens):
    """Return the largest rms error over the table with a lens, at heights up to 5 cm [m]."""
    points = np.concatenate([tag.corners for tag in default_layout().tags])
    rvec, tvec = cv2.solvePnP(
        points, VIEW.to_image(points), lens.matrix, np.array(lens.distortion)
    )[1:]
    R = cv2.Rodrigues(rvec)[0]
    view = CameraView(
        lens=lens, rotation=tuple(map(tuple, R)), position=tuple((-R.T @ tvec).ravel())
    )
    x, y = np.meshgrid(np.linspace(-1.2, 1.2, 15), np.linspace(0.05, 1.4, 9))
    errors = []
    for z in (0.0, 0.0055, 0.05):
        found = view.to_table(VIEW.to_image(np.stack([x, y, np.full_like(x, z)], axis=-1)), z)
        errors.append(np.sqrt(np.mean((found[..., 0] - x) ** 2 + (found[..., 1] - y) ** 2)))
    return max(errors)


@pytest.mark.parametrize("name", SETS)
def test_a_set_of_pictures_gives_a_lens_that_it_determines_or_none(name):
    found = SETS[name](np.random.default_rng(1))
    size = (LENS.width, LENS.height)
    if name not in HONEST:
        with pytest.raises(
            InputError,
            match=r"20 to 40 degrees|are needed|in all corners|picture's edge, above \d\.\d\d px",
        ):
            fit_lens(found, BOARD, size)
        return
    fit = fit_lens(found, BOARD, size)
    assert np.abs(np.subtract(fit.lens.focal, LENS.focal)).max() < SD_COUNT * fit.focal_sd
    assert np.abs(np.subtract(fit.lens.centre, LENS.centre)).max() < SD_COUNT * fit.centre_sd
    misses = np.abs(np.subtract(fit.lens.distortion, LENS.distortion))
    assert np.all(misses < SD_COUNT * np.array(fit.distortion_sd))
    assert cost(fit.lens) < COST


def test_boards_held_on_half_the_way_to_the_edges_give_a_lens():
    for seed in range(2):
        boards = held(np.random.default_rng(seed), HALF_WAY)
        fit = fit_lens(boards, BOARD, (LENS.width, LENS.height))
        assert cost(fit.lens) < COST


def test_a_lens_that_the_bound_at_the_edge_refuses_would_be_off_on_the_table(monkeypatch):
    monkeypatch.setattr(calibration, "EDGE_SD_MAX", np.inf)
    size, refused = (LENS.width, LENS.height), []
    for seed in range(6):
        fit = fit_lens(held(np.random.default_rng(seed), LITTLE), BOARD, size)
        if fit.edge_sd > BOUND * LENS.width:
            refused.append(cost(fit.lens))
    assert np.median(refused) > COST


@pytest.fixture(scope="module")
def photograph():
    """Return a function that photographs a board that faces the camera, at a place [m]."""
    camera = VirtualCamera(dataclasses.replace(CameraConfig(), noise=0.0).resized(960))
    down = np.diag([1.0, -1.0, -1.0])
    return lambda board, x=0.0, z=0.8: camera.board_frame(board, down, [x, 0.75, z], 0)


def test_drawn_pictures_of_a_board_that_faces_the_camera_are_refused(photograph):
    rng = np.random.default_rng(5)
    pictures = [photograph(BOARD, rng.uniform(-0.7, 0.7), rng.uniform(0.4, 1.2)) for _ in range(6)]
    with pytest.raises(InputError, match=r"do not determine the lens.*tilted by [01] to"):
        calibrate_lens(pictures, BOARD)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tag": 0.07}, r"tag = 0.07 m must be smaller than its squares of 0.06 m"),
        ({"row_count": 1}, "row_count = 1"),
        ({"square": -1.0}, "square = -1"),
        ({"family": "4X4_50", "column_count": 30, "row_count": 30}, "450 tags, and 4X4_50 only 50"),
    ],
)
def test_a_board_that_cannot_be_printed_is_refused(changes, words):
    with pytest.raises(InputError, match=words):
        dataclasses.replace(BOARD, **changes)


def test_a_board_of_another_family_is_named(photograph):
    # Each tag is looked up in every family; there are 11 more on the table.
    board = Board(column_count=7, row_count=4, family="5X5_100")
    pictures = [photograph(board)]
    with pytest.raises(InputError, match=r"0 of 1 pictures .* 4X4_100: they show tags of 5X5"):
        calibrate_lens(pictures, BOARD)
    with pytest.raises(InputError, match="1 of 1 pictures show the board"):
        calibrate_lens(pictures, board)


def test_a_board_of_other_squares_is_told_from_one_of_another_family(photograph):
    pictures = [photograph(Board(column_count=8, row_count=6))] * 4
    words = r"0 of 4 .* 11 x 8 squares, but 24 tags of 4X4_100 .* 0 to 23: .* about 48 squares"
    with pytest.raises(InputError, match=words):
        calibrate_lens(pictures, BOARD)


def test_a_board_is_taken_only_while_it_is_held_still(photograph):
    first, second, third = (SimpleNamespace(image=photograph(BOARD, x)) for x in (-0.3, 0.0, 0.3))
    assert _gather_boards([first, second, third, second], BOARD, 3, ignore) == []
    held = _gather_boards([first, first, second, third, third, third], BOARD, 3, ignore)
    assert [image is first.image for image in held] == [True, False]
