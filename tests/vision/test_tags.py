"""Tags of any family, in either orientation, on drawn and on real pictures."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("cv2")

from tools.measure_tags import corner_errors, drawn_picture, measure, real_pictures

from cablecast.camera.lens import CameraView, Lens
from cablecast.camera.tags import TAG_COUNTS, default_layout, tag_family
from cablecast.errors import InputError
from cablecast.vision.calibration import calibrate_view
from cablecast.vision.tags import detect_tags, load_cv2, tag_cells, tag_picture

# Corners against those of the AprilTag library: half a pixel is asked for, 0.1 px was measured.
LIBRARY_MEDIAN = 0.2
# Corners of a drawn tag from 20 px on, blurred and noisy: 0.08 px (rms) were measured.
DRAWN_RMS = 0.15
# A camera's place from exact tags, which a wrong orientation moves by centimetres [m].
PLACE = 0.003

LENS = Lens(width=1280, height=720, focal=(900.0, 900.0), centre=(639.5, 359.5))
VIEW = CameraView(
    lens=LENS, rotation=((1, 0, 0), (0, -1, 0), (0, 0, -1)), position=(0.05, 0.8, 2.1)
)
LAYOUT = default_layout()
cv2 = load_cv2()


def table_picture(layout, turned):
    """Draw the tags of a layout as a camera sees them, turned by 180 degrees or not."""
    image = np.full((LENS.height, LENS.width), 190, np.uint8)
    for tag in layout.tags:
        cell = 12
        picture = np.rot90(tag_picture(tag.id, cell, layout.family), 2 * turned).copy()
        near, far = cell - 0.5, picture.shape[0] - cell - 0.5
        source = np.array([[near, near], [far, near], [far, far], [near, far]], np.float32)
        H = cv2.getPerspectiveTransform(source, VIEW.to_image(tag.corners).astype(np.float32))
        size = (LENS.width, LENS.height)
        cover = cv2.warpPerspective(np.full_like(picture, 255), H, size) > 127
        image[cover] = cv2.warpPerspective(picture, H, size, flags=cv2.INTER_AREA)[cover]
    return cv2.GaussianBlur(image, (0, 0), 0.8)


@pytest.mark.parametrize(
    ("family", "turned"),
    [
        ("APRILTAG_36h11", True),
        ("APRILTAG_16h5", False),
        ("4X4_50", False),
        ("4X4_50", True),
        ("ARUCO_MIP_36h12", True),
    ],
)
def test_tags_of_either_orientation_give_the_camera_s_place_and_it_is_said(family, turned):
    layout = dataclasses.replace(LAYOUT, family=family)
    found = calibrate_view([table_picture(layout, turned)], layout, lens=LENS)
    assert found.turned == turned
    assert len(found.tag_ids) == len(layout.tags)
    np.testing.assert_allclose(found.view.position, VIEW.position, atol=PLACE)


def test_a_moved_tag_is_found_out_among_turned_ones():
    tags = list(LAYOUT.tags)
    tags[3] = dataclasses.replace(tags[3], x=tags[3].x + 0.04)
    layout = dataclasses.replace(LAYOUT, tags=tuple(tags))
    found = calibrate_view([table_picture(LAYOUT, True)], layout, lens=LENS)
    assert found.turned
    assert found.rejected_ids == (3,)


def test_tags_of_another_family_are_named():
    layout = dataclasses.replace(LAYOUT, tags=LAYOUT.tags[:5])
    picture = table_picture(dataclasses.replace(layout, family="5X5_50"), False)
    with pytest.raises(InputError, match=r"0 of the layout's 5 tags .* some of 5X5_50 are seen"):
        calibrate_view([picture], layout, lens=LENS)


def test_no_tag_of_real_pictures_is_missed_that_the_april_tag_library_finds():
    pictures = list(real_pictures().values())
    missed, errors = measure(pictures, detect_tags)
    assert sum(len(tags) for _, tags in pictures) == 50
    assert missed == 0
    assert np.median(errors) < LIBRARY_MEDIAN


@pytest.mark.parametrize("family", ["APRILTAG_36h11", "4X4_50"])
@pytest.mark.parametrize("size", [24, 45, 110])
def test_corners_of_drawn_tags_are_exact(family, size):
    errors = []
    for seed in range(4):
        image, truth = drawn_picture(size, seed, family)
        found = detect_tags(image, family)
        errors += [corner_errors(found[tag_id], quad) for tag_id, quad in truth.items()]
    assert np.sqrt(np.mean(np.square(errors))) < DRAWN_RMS


def test_the_families_are_those_of_opencv():
    for family, count in TAG_COUNTS.items():
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{family}"))
        assert len(dictionary.bytesList) == count
        assert tag_cells(family) == dictionary.markerSize + 2


@pytest.mark.parametrize(
    ("name", "family"),
    [
        ("tag36h11", "APRILTAG_36h11"),
        ("DICT_APRILTAG_36H11", "APRILTAG_36h11"),
        ("dict_4x4_50", "4X4_50"),
        ("aruco_original", "ARUCO_ORIGINAL"),
    ],
)
def test_a_family_has_the_names_that_people_give_it(name, family):
    assert tag_family(name) == family


def test_a_family_that_is_none_is_refused_with_those_that_are():
    with pytest.raises(InputError, match=r"'3X3_50' must be one of 4X4_50, .*APRILTAG_36h11"):
        dataclasses.replace(LAYOUT, family="3X3_50")
    tags = (*LAYOUT.tags, dataclasses.replace(LAYOUT.tags[0], id=40))
    with pytest.raises(InputError, match=r"tag id of APRILTAG_16h5 = 40 .*29"):
        dataclasses.replace(LAYOUT, tags=tags, family="16h5")
