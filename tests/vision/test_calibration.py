"""Tags, boards, and the calibration that follows from their pictures."""

import dataclasses
import re

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.camera.tags import Tag, TagLayout, default_layout
from cablecast.errors import InputError
from cablecast.rigs.virtual.camera import VirtualCamera, board_pictures
from cablecast.rigs.virtual.config import CameraConfig
from cablecast.vision.calibration import Board, Calibration, calibrate_lens, calibrate_view
from cablecast.vision.tags import detect_tags, tag_picture
from cablecast.workspace import Workspace

# Tags are stuck with 1 mm of error each, and eleven of them average most of it.
TABLE_RMS = 1.5e-3
# Without a known lens, its distortion follows the tags' errors, too.
TAGS_ONLY_RMS = 2.5e-3
FOCAL_RELATIVE = 1e-3


@pytest.fixture(scope="module")
def empty(virtual_camera):
    return virtual_camera.empty_frame(seed=3)


def table_error(calibration, camera, z):
    """Distance on the table between where points are and where the calibration has them [m]."""
    x, y = np.meshgrid(np.linspace(-1.3, 1.3, 15), np.linspace(0.05, 1.45, 9))
    points = np.stack([x, y, np.full_like(x, z)], axis=-1)
    found = calibration.view.to_table(camera.view.to_image(points), z)
    return np.linalg.norm(found - points[..., :2], axis=-1)


def test_board_and_tags_tell_where_points_of_the_table_are(calibration, virtual_camera):
    for z in (0.0, 0.0055, 0.05):
        error = table_error(calibration, virtual_camera, z)
        assert np.sqrt(np.mean(error**2)) < TABLE_RMS
    assert calibration.tag_ids == tuple(range(11))


def test_a_board_tells_the_focal_length(virtual_camera):
    fit = calibrate_lens(board_pictures(virtual_camera), Board())
    np.testing.assert_allclose(fit.lens.focal, virtual_camera.view.lens.focal, rtol=FOCAL_RELATIVE)
    assert fit.rms_px < 0.5
    assert not fit.board.legacy


def test_a_board_of_the_older_pattern_is_read_and_named():
    small = VirtualCamera(dataclasses.replace(CameraConfig(), noise=0.0).resized(960))
    pictures = board_pictures(small, board=Board(legacy=True))
    fit = calibrate_lens(pictures, Board())
    assert fit.board.legacy
    # Half the pixels: corners are half as exact with OpenCV 5, and a third with 4.
    np.testing.assert_allclose(fit.lens.focal, small.view.lens.focal, rtol=3 * FOCAL_RELATIVE)
    # Its corners are others than those of the pattern of today.
    assert np.any(Board(legacy=True).picture(8) != Board().picture(8))


def test_tags_alone_do_for_points_near_the_table(empty, virtual_camera):
    calibration = calibrate_view([empty], virtual_camera.layout)
    error = table_error(calibration, virtual_camera, 0.0055)
    assert np.sqrt(np.mean(error**2)) < TAGS_ONLY_RMS


def test_a_tag_that_was_moved_is_found_out(empty, virtual_camera, calibration):
    tags = list(virtual_camera.layout.tags)
    tags[2] = dataclasses.replace(tags[2], x=tags[2].x + 0.03)
    layout = TagLayout(tags=tuple(tags))
    found = calibrate_view([empty], layout, lens=calibration.view.lens)
    assert found.rejected_ids == (2,)
    assert np.sqrt(np.mean(table_error(found, virtual_camera, 0.0) ** 2)) < TABLE_RMS


def test_a_picture_without_the_tags_of_the_table_is_refused():
    with pytest.raises(InputError, match=r"0 of the layout's 11 tags .* at least 4"):
        calibrate_view([np.zeros((480, 640, 3), np.uint8)], default_layout())


def test_pictures_without_a_board_are_refused():
    with pytest.raises(InputError, match="0 of 6 pictures"):
        calibrate_lens([np.zeros((480, 640, 3), np.uint8)] * 6, Board())


def test_a_calibration_survives_its_file_and_what_is_none_is_refused(calibration, tmp_path):
    file = tmp_path / "calibration.json"
    calibration.save(file)
    assert Calibration.load(file) == calibration
    for text in ("", "[1]", '{"view": 3}'):
        file.write_text(text)
        with pytest.raises(InputError, match=r"calibration\.json is no calibration"):
            Calibration.load(file)


def test_a_turned_tag_has_its_corners_where_a_picture_shows_them():
    # A layout with y up and the picture's v down: a quarter turn clockwise takes the upper left
    # corner to the upper right.
    tag, turned = Tag(id=5, x=0.3, y=0.4), Tag(id=5, x=0.3, y=0.4, yaw=np.pi / 2)
    np.testing.assert_allclose(turned.corners[0], tag.corners[1], atol=1e-12)
    picture = np.pad(tag_picture(5, cell=8), 30, constant_values=255)
    upright, clockwise = detect_tags(picture)[5], detect_tags(np.rot90(picture, -1).copy())[5]
    np.testing.assert_allclose(clockwise[0], upright[1], atol=0.6)


def test_a_layout_survives_its_file(tmp_path):
    layout = TagLayout(tags=(*default_layout().tags, Tag(id=40, x=0.1, y=0.9, yaw=0.25, size=0.07)))
    layout.save(tmp_path / "tags.yaml")
    loaded = TagLayout.load(tmp_path / "tags.yaml")
    for tag, again in zip(layout.tags, loaded.tags, strict=True):
        assert dataclasses.astuple(again) == pytest.approx(dataclasses.astuple(tag))


@pytest.mark.parametrize(
    ("text", "fragment"),
    [
        ("tags: 3", "tags must be a list"),
        ("tags: [{id: 1, x: 0}]", "lacks the keys ['y']"),
        ("tags: [{id: 1, x: 0, y: 0, colour: red}]", "unknown keys ['colour']"),
        ("tags: [{id: 1, x: 0, y: 0, yaw_deg: left}]", "yaw_deg = 'left' is not a number"),
        ("tags: [{id: 9999, x: 0, y: 0}]", "9999"),
        ("tags: [{id: 1, x: far, y: 0}]", "far"),
        ("tags: [{id: 1, x: 0, y: 0}, {id: 1, x: 0, y: 1}]", "at least 4"),
        ("tags: [", "not plain YAML"),
        (None, "no file"),
    ],
)
def test_a_layout_that_says_nonsense_or_is_missing_is_refused(text, fragment, tmp_path):
    file = tmp_path / "tags.yaml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(InputError, match=re.escape(fragment)):
        TagLayout.load(file)


def test_the_layout_of_the_paper_s_table_has_eleven_tags_along_its_edges():
    places = [(tag.x, tag.y) for tag in default_layout().tags]
    assert len(places) == 11
    assert places[:5] == [(-1.27, 1.4), (-0.64, 1.4), (0.0, 1.4), (0.64, 1.4), (1.27, 1.4)]
    assert (0.0, 0.1) not in places, "the robot stands there"


@pytest.mark.parametrize(
    "workspace",
    [
        Workspace(table_yaw_deg=90.0),
        Workspace(table_width=1.2, table_depth=0.9, table_near_y=0.4),
        Workspace(table_width=4.0, table_depth=3.0, table_near_y=-1.0),
        Workspace(table_width=0.4, table_depth=0.4, table_near_y=0.4),
    ],
    ids=["turned", "small", "around the robot", "tiny"],
)
def test_the_tags_of_any_table_lie_on_it_apart_and_clear_of_the_robot(workspace):
    tags = default_layout(workspace).tags
    for tag in tags:
        assert workspace.on_table(tag.corners[:, :2]).all()
        assert np.hypot(tag.x, tag.y) > 0.2
    centres = np.array([[tag.x, tag.y] for tag in tags])
    apart = np.linalg.norm(centres[:, None] - centres, axis=-1)[~np.eye(len(tags), dtype=bool)]
    # A tag with its white rim is 1.25 times as wide as its square.
    assert apart.min() > 1.25 * tags[0].size


def test_the_tags_to_print_are_those_of_the_layout_beside_them(tmp_path, capsys):
    import cv2
    from tools.make_tags import main

    main([str(tmp_path)])
    layout = TagLayout.load(tmp_path / "tags.yaml")
    assert "measures 10 cm" in capsys.readouterr().out
    for tag in layout.tags:
        picture = cv2.imread(str(tmp_path / f"tag-{tag.id:02}.png"))
        assert list(
            detect_tags(np.pad(picture, ((9, 9), (9, 9), (0, 0)), constant_values=255))
        ) == [tag.id]
