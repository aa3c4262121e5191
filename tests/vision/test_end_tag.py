"""A tag that lies flat on the cable's end is followed in place of a marker."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.camera.lens import CameraView, Lens
from cablecast.camera.settings import CameraSettings
from cablecast.camera.tags import FAMILY, EndTag, default_layout
from cablecast.cast import TrialStatus
from cablecast.errors import InputError
from cablecast.pipeline.track_video import track_video
from cablecast.setup import Setup
from cablecast.vision.end_tag import TagTracker, make_tracker
from cablecast.vision.tags import load_cv2, tag_picture
from cablecast.vision.tracker import TrackerConfig, grab_of
from cablecast.vision.video import FilmWriter

cv2 = load_cv2()
LENS = Lens(width=1920, height=1080, focal=(1250.0, 1250.0), centre=(959.5, 539.5))
VIEW = CameraView(
    lens=LENS, rotation=((1, 0, 0), (0, -1, 0), (0, 0, -1)), position=(0.05, 0.8, 1.9)
)
SETUP = Setup()
HEIGHT = 2 * SETUP.cable.radius
# Centre of a tag of 20 px or more: corners are found to 0.1 px, a pixel is 1.5 mm [m].
PLACE = 0.5e-3
# Through the compression of a film, and a camera that was found from drawn tags [m].
FILM_PLACE = 2e-3


def stick(image, tag_id, family, corners):
    """Draw a tag into a picture at its corners [m], shape [4, 3]."""
    cell = 12
    picture = tag_picture(tag_id, cell, family)
    near, far = cell - 0.5, picture.shape[0] - cell - 0.5
    source = np.array([[near, near], [far, near], [far, far], [near, far]], np.float32)
    fine, (u, v) = 4, np.floor(VIEW.to_image(corners).mean(axis=0)).astype(int) - 60
    pixels = (VIEW.to_image(corners) - (u, v) + 0.5) * fine - 0.5
    H = cv2.getPerspectiveTransform(source, pixels.astype(np.float32))
    part = image[v : v + 120, u : u + 120]
    size = (part.shape[1] * fine, part.shape[0] * fine)
    cover, drawn = (
        cv2.resize(cv2.warpPerspective(p, H, size), part.shape[1::-1], interpolation=cv2.INTER_AREA)
        for p in (np.full(picture.shape, 1.0, np.float32), picture.astype(np.float32))
    )
    part[:] = np.round(part * (1 - cover) + drawn)


@pytest.fixture(scope="module")
def table():
    image = np.full((LENS.height, LENS.width), 170, np.uint8)
    for tag in default_layout().tags:
        stick(image, tag.id, "APRILTAG_36h11", tag.corners)
    return image


def swing(time):
    """Place of the end [m] and its turn [rad]: it swings, and comes to rest after a second."""
    phase = np.pi * min(time, 1.0)
    return np.array([0.5 * np.cos(phase), 0.7 + 0.3 * np.sin(phase)]), 0.6 * phase


def frame(table, time, tag, covered=False):
    image = table.copy()
    (x, y), turn = swing(time)
    half = tag.size / 2 * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
    c, s = np.cos(turn), np.sin(turn)
    xy = half @ np.array([[c, -s], [s, c]]) + [x, y]
    if not covered:
        stick(image, tag.id, tag.family, np.column_stack([xy, np.full(4, HEIGHT)]))
    image = cv2.GaussianBlur(image, (0, 0), 0.7)
    noise = np.random.default_rng(int(1e3 * time)).normal(0.0, 2.0, image.shape)
    image = np.clip(image + noise, 0, 255).astype(np.uint8)
    return np.repeat(image[..., None], 3, axis=-1)


@pytest.mark.parametrize(
    ("family", "size", "height"),
    [
        ("4X4_50", 0.02, 1.35),
        ("APRILTAG_16h5", 0.03, 1.9),
    ],
)
def test_the_tag_s_centre_is_followed_at_its_height_and_gaps_stay_gaps(
    family, size, height, monkeypatch
):
    view = dataclasses.replace(VIEW, position=(*VIEW.position[:2], height))
    monkeypatch.setattr("tests.vision.test_end_tag.VIEW", view)
    table = np.full((LENS.height, LENS.width), 170, np.uint8)
    tag = EndTag(id=17, size=size, family=family)
    settings = CameraSettings(source="0", end_tag=tag)
    tracker = make_tracker(view, SETUP.workspace, SETUP.cable, settings, TrackerConfig(), (0, 1))
    assert isinstance(tracker, TagTracker)
    for k in range(8):
        image = frame(table, k / 7, tag, covered=k == 5)
        tracker.update(k / 7, grab_of(image))
    xy = tracker.frames[1]
    assert np.isnan(xy[5]).all()
    truth = np.array([swing(k / 7)[0] for k in range(8)])
    seen = np.isfinite(xy[:, 0])
    assert seen.sum() == 7
    assert np.linalg.norm(xy[seen] - truth[seen], axis=1).max() < PLACE


def test_another_tag_of_that_number_and_another_size_is_not_followed(table):
    tag = EndTag(id=17, size=0.03)
    larger = dataclasses.replace(tag, size=0.06)
    tracker = TagTracker(VIEW, SETUP.workspace, larger, TrackerConfig(marker_z=HEIGHT))
    image = frame(table, 0.0, tag)
    assert np.isnan(tracker.update(0.0, grab_of(image))).all()


def test_a_film_is_tracked_by_the_tag_that_the_lab_file_names(table, tmp_path):
    tag = EndTag(id=17, size=0.04)
    camera = CameraSettings(source="0", end_tag=tag)
    setup = dataclasses.replace(SETUP, camera=camera)
    writer = FilmWriter(tmp_path / "film.mkv", 10.0)
    for k in range(14):
        writer.write(frame(table, k / 10, tag), k / 10)
    writer.close()
    found = track_video(tmp_path / "film.mkv", setup)
    assert found.track.status is TrialStatus.OK
    truth = np.array([swing(time)[0] for time in found.track.times])
    errors = np.linalg.norm(found.track.endpoint_xy - truth, axis=1)
    assert np.isfinite(errors).mean() > 0.9
    assert np.nanmax(errors) < FILM_PLACE


def test_advice_about_an_end_tag_like_those_on_the_table_can_be_followed():
    values = {"source": "0", "end_tag": {"id": 3, "family": FAMILY}}
    tags = default_layout().to_dict()["tags"]
    with pytest.raises(InputError, match="list the tags on the table as tags, or take"):
        CameraSettings.from_dict(values)
    with pytest.raises(InputError, match="take another number, or take another family"):
        CameraSettings.from_dict(values | {"tags": tags})
    assert CameraSettings.from_dict(
        values | {"tags": tags, "end_tag": {"id": len(tags), "family": FAMILY}}
    )


def test_an_end_tag_of_a_lab_file_survives_and_nonsense_is_refused():
    values = {"source": "0", "end_tag": {"id": 3, "family": "tag16h5", "size": 0.02}}
    settings = CameraSettings.from_dict(values)
    assert settings.end_tag == EndTag(id=3, size=0.02, family="APRILTAG_16h5")
    assert CameraSettings.from_dict(settings.to_dict()) == settings
    for end, words in [
        ({"size": 0.02}, "lacks the keys"),
        ({"id": 60}, "end_tag id = 60"),
        ({"id": 1, "size": 3}, "end_tag size = 3 m"),
        ({"id": 1, "colour": "red"}, "unknown keys"),
        ({"id": 1, "family": "36h11"}, "may be mixed up with a tag on the table"),
    ]:
        with pytest.raises(InputError, match=words):
            CameraSettings.from_dict({"source": "0", "end_tag": end})
