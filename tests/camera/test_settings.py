"""The section `camera` of a lab file."""

import dataclasses

import pytest

from cablecast.camera.lens import Lens
from cablecast.camera.settings import CameraSettings
from cablecast.camera.tags import default_layout
from cablecast.errors import InputError
from cablecast.setup import Setup, load_setup, save_setup

LENS = Lens(
    width=1920, height=1080, focal=(1366.0, 1365.0), centre=(960.0, 540.0), distortion=(-0.06,) * 5
)
FULL = CameraSettings(
    source="http://127.0.0.1:8080/camera.nut",
    exposure=0.002,
    focus=30.0,
    clock="arrival",
    clock_offset=-3.25,
    clock_offset_sd=0.001,
    row_time=1.5e-5,
    lens=LENS,
    tags=default_layout(),
    marker=(0.04, 0.02),
    films="/films",
)


@pytest.mark.parametrize("camera", [CameraSettings(source="0"), FULL], ids=["default", "full"])
def test_a_camera_survives_its_lab_file(camera, tmp_path):
    setup = Setup(camera=camera)
    save_setup(setup, tmp_path / "lab.yaml")
    assert load_setup(tmp_path / "lab.yaml") == setup


def test_paths_are_relative_to_the_lab_file(tmp_path):
    default_layout().save(tmp_path / "tags.yaml")
    (tmp_path / "film.mp4").write_bytes(b"")
    file = tmp_path / "lab.yaml"
    file.write_text("camera: {source: film.mp4, tags: tags.yaml, films: films}\n")
    camera = load_setup(file).camera
    assert camera is not None
    assert camera.source == str(tmp_path / "film.mp4")
    assert camera.tags == default_layout()
    assert camera.films == str(tmp_path.resolve() / "films")


def test_a_device_may_be_given_by_its_number(tmp_path):
    file = tmp_path / "lab.yaml"
    file.write_text("camera: {source: 2}\n")
    assert load_setup(file).camera == CameraSettings(source="2")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{}", r"camera lacks the keys \['source'\]"),
        ("{source: ''}", "camera source = ''"),
        ("{source: true}", "camera source = True"),
        ("{source: 0, colour: red}", "unknown keys"),
        ("{source: 0, fourcc: MJPEG}", "camera fourcc = 'MJPEG' must be four letters"),
        ("{source: 0, exposure: 0.05}", "longer than a frame at 60"),
        ("{source: 0, exposure: 8}", r"camera exposure = 8 s is outside \[1e-05, 0.1\]"),
        ("{source: 0, clock: wall}", "camera clock = 'wall' must be one of device, arrival"),
        ("{source: 0, films: 3}", "camera films = '3' must be the path of a folder"),
        ("{source: 0, row_time: -1}", "camera row_time = -1 s"),
        ("{source: 0, tags: [1]}", "a tag must be a mapping"),
        ("{source: 0, tags: 7}", "tags must be a list"),
        ("{source: 0, tags: none.yaml}", r"no file .*none\.yaml"),
        ("{source: 0, lens: {width: 640}}", "lens lacks the keys"),
        ("{source: 0, lens: {width: a, height: 1, focal: 1, centre: 1}}", "lens width = 'a'"),
        ("{source: 0, marker: 3}", "camera marker = 3 must be a length and a width"),
        ("{source: 0, marker: [3]}", "must be a length and a width"),
        ("{source: 0, marker: [3, x]}", "camera marker"),
    ],
)
def test_a_camera_that_makes_no_sense_is_refused_with_the_lab_file(text, words, tmp_path):
    file = tmp_path / "lab.yaml"
    file.write_text(f"camera: {text}\n")
    with pytest.raises(InputError, match=words) as caught:
        load_setup(file)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_a_lens_of_another_image_size_is_refused():
    with pytest.raises(InputError, match="calibrated for 1920 x 1080 px"):
        dataclasses.replace(FULL, width=1280, height=720)
