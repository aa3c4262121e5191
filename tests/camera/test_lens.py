"""The mapping between table and image."""

import numpy as np
import pytest

from cablecast.camera.lens import CameraView, Lens
from cablecast.errors import InputError

LENS = Lens(
    width=1920,
    height=1080,
    focal=(1366.0, 1350.0),
    centre=(965.0, 530.0),
    distortion=(-0.08, 0.03, 6e-4, -4e-4, -0.002),
)
# Turned half a degree about each axis: no symmetry hides a wrong sign.
ROTATION = (
    (0.9999238, 0.0087265, 0.0087265),
    (0.0088023, -0.9999235, -0.0086885),
    (0.0086500, 0.0087646, -0.9999242),
)
# Newton's method stops at rounding.
ROUNDING_PX = 1e-6
# OpenCV's own iteration stops earlier than ours.
OPENCV_PX = 1e-3


def view() -> CameraView:
    u, _, vt = np.linalg.svd(np.array(ROTATION))
    rotation = tuple(tuple(row) for row in (u @ vt).tolist())
    return CameraView(lens=LENS, rotation=rotation, position=(0.05, 0.7, 2.2))


def grid(z=0.0):
    x, y = np.meshgrid(np.linspace(-1.3, 1.3, 9), np.linspace(0.05, 1.45, 7))
    return np.stack([x, y, np.full_like(x, z)], axis=-1)


@pytest.mark.parametrize("z", [0.0, 0.0055, -0.3, 0.4])
def test_a_point_of_any_level_comes_back_from_the_image(z):
    points = grid(z)
    np.testing.assert_allclose(
        view().to_table(view().to_image(points), z), points[..., :2], atol=1e-9
    )


def test_the_distortion_is_that_of_opencv():
    cv2 = pytest.importorskip("cv2")
    camera = view()
    R = np.array(camera.rotation)
    rvec = cv2.Rodrigues(R)[0]
    tvec = -R @ np.array(camera.position)
    theirs, _ = cv2.projectPoints(
        grid().reshape(-1, 3), rvec, tvec, LENS.matrix, np.array(LENS.distortion)
    )
    ours = camera.to_image(grid()).reshape(-1, 2)
    np.testing.assert_allclose(ours, theirs.reshape(-1, 2), atol=OPENCV_PX)


def test_undistorting_undoes_distorting():
    ideal = np.random.default_rng(0).uniform(-0.7, 0.7, (100, 2))
    np.testing.assert_allclose(LENS.undistort(LENS.distort(ideal)), ideal, atol=ROUNDING_PX / 1000)


def test_a_higher_point_seems_to_lie_farther_out():
    camera = view()
    low, high = (camera.to_table(camera.to_image([1.2, 1.2, z]), 0.0) for z in (0.0, 0.05))
    centre = np.array(camera.position[:2])
    assert np.linalg.norm(high - centre) > np.linalg.norm(low - centre) + 0.01


def test_what_lies_behind_the_camera_is_not_in_the_image():
    assert np.isnan(view().to_image([0.0, 0.7, 3.0])).all()


def test_the_scale_is_focal_length_over_distance():
    scale = view().pixels_per_metre((0.05, 0.7))
    # Focal lengths of 1366 and 1350 px at 2.2 m; distortion is small near the axis.
    assert scale == pytest.approx(np.sqrt(1366 * 1350) / 2.2, rel=0.01)


def test_a_data_sheet_gives_a_focal_length():
    lens = Lens.from_view(1920, 1080, np.radians(78))
    corner = lens.undistort([0.0, 0.0])
    assert 2 * np.degrees(np.arctan(np.linalg.norm(corner))) == pytest.approx(78, abs=0.1)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"focal": (0.0, 1.0)}, "focal"),
        ({"width": 2}, "width"),
        ({"distortion": (0.0, np.nan, 0.0, 0.0, 0.0)}, "distortion"),
    ],
    ids=["no focal length", "no width", "NaN"],
)
def test_an_impossible_lens_is_refused(change, word):
    values = {"width": 640, "height": 480, "focal": (500.0, 500.0), "centre": (320.0, 240.0)}
    with pytest.raises(InputError, match=word):
        Lens(**values | change)


def test_a_mirroring_camera_is_refused():
    with pytest.raises(InputError, match="mirror"):
        CameraView(lens=LENS, rotation=((1, 0, 0), (0, 1, 0), (0, 0, -1)), position=(0.0, 0.0, 2.0))
