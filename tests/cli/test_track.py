"""`cablecast track` on a rendered video."""

import csv
import dataclasses
import json
import pathlib
import re
import shlex
import types

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.cli import main
from cablecast.cli.track import Track
from cablecast.setup import Setup

# What the project asks of the tracker [m]; with tags alone the lens is known less well.
ERROR_RMS = 3e-3
START = 12 / 60
# The shift is whole; an encoded film puts a tag's centre to some hundredths of a pixel.
SHIFT_PX, SHIFT_TOLERANCE = np.hypot(25, 10), 0.3


@pytest.fixture(scope="module")
def film():
    """Return a short made-up motion, filmed."""
    from cablecast.rigs.virtual.camera import VirtualCamera
    from cablecast.rigs.virtual.config import CameraConfig
    from cablecast.rigs.virtual.drawing import FilmedTrial

    times = np.arange(36) * 0.01
    u = np.clip(times / 0.3, 0, 1)
    path = np.array([0.0, 1.22]) + (u**3 * (10 - 15 * u + 6 * u * u))[:, None] * [0.5, -0.2]
    share = np.linspace(0, 1, 10)[:, None]
    xy = np.array([0.0, 0.6]) + share * (path[:, None] - np.array([0.0, 0.6]))
    nodes = np.concatenate([xy, np.full((*xy.shape[:2], 1), 0.0055)], axis=-1)
    trial = FilmedTrial(cable=Setup().cable, times=times, nodes=nodes, joint_path=None)
    return VirtualCamera(CameraConfig().resized(1280)).film(trial, seed=6)


@pytest.fixture(scope="module")
def folder(film, tmp_path_factory) -> pathlib.Path:
    """Return a video of it with the layout of the tags, and what tracking it with these wrote."""
    from cablecast.vision.video import write_video

    folder = tmp_path_factory.mktemp("film")
    frames = (film.frame(i) for i in range(film.frame_count))
    write_video(folder / "trial.mp4", frames, 60.0)
    film.camera.layout.save(folder / "tags.yaml")
    arguments = ["--tags", str(folder / "tags.yaml"), "--out", str(folder / "out")]
    assert main(["track", str(folder / "trial.mp4"), *arguments, "--start", f"{START:.4f}"]) == 0
    return folder


def rows(file):
    return list(csv.DictReader(file.open()))


def refused(arguments, capsys) -> str:
    assert main(["track", *(str(argument) for argument in arguments)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert "Traceback" not in "".join(lines)
    return lines[-1]


def test_a_video_becomes_the_track_that_was_filmed(film, folder):
    samples = rows(folder / "out" / "track.csv")
    assert [float(row["time_s"]) for row in samples] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    seen = [row for row in rows(folder / "out" / "frames.csv") if row["x_m"]]
    times, *found = np.array([[float(row[x]) for x in ("time_s", "x_m", "y_m")] for row in seen]).T
    truth = film.trial.shape_at(times)[:, -1, :2]
    error = np.linalg.norm(np.transpose(found) - truth, axis=1)
    assert np.sqrt(np.mean(error**2)) < ERROR_RMS
    assert len(seen) == film.frame_count


def test_the_run_folder_says_how_the_trial_ended_and_how_far_its_tags_are_off(folder):
    metrics = json.loads((folder / "out" / "metrics.json").read_text())
    assert metrics["status"] == "ok"
    assert metrics["final_xy"] == pytest.approx([0.5, 1.02], abs=ERROR_RMS)
    assert metrics["tags_used"] == 11
    assert metrics["tags_off_px"] < SHIFT_TOLERANCE
    assert metrics["tags_off_mm"] < 4.0 * SHIFT_TOLERANCE
    assert metrics["tags_moved"] == ""
    assert (folder / "out" / "track.png").stat().st_size > 10_000
    assert json.loads((folder / "out" / "config.json").read_text())["command"] == "track"


def test_a_stored_calibration_takes_the_place_of_the_tags(folder, tmp_path, capsys):
    calibration = folder / "out" / "calibration.json"
    arguments = ["--calibration", str(calibration), "--out", str(tmp_path / "again")]
    assert main(["track", str(folder / "trial.mp4"), *arguments, "--start", f"{START:.4f}"]) == 0
    assert "ok: " in capsys.readouterr().out
    first, again = (rows(f / "track.csv") for f in (folder / "out", tmp_path / "again"))
    assert first == again


def changed(folder, path, change):
    """Write the film again, each frame changed by its place in the film from 0 to 1."""
    from cablecast.vision.video import read_video, write_video

    info, frames = read_video(folder / "trial.mp4")
    pictures = (change(image, i / info.frame_count) for i, (_, image) in enumerate(frames))
    write_video(path, pictures, 60.0)
    return path


def bumped(image):
    return np.roll(image, (10, 25), axis=(0, 1))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda image, share: bumped(image), r"camera was moved: 11 tags .* at the start of"),
        (lambda image, share: image if share < 0.3 else bumped(image), r"11 tags .* in the middle"),
        (lambda image, share: image if share < 0.7 else bumped(image), r"11 tags .* at the end"),
        (lambda image, share: image[::-1, ::-1], r"at the start of .* are turned by 180 deg"),
        (lambda image, share: 0 * image, r"only 0 of 11 tags are still seen at the start"),
    ],
)
def test_a_film_whose_tags_are_not_where_the_calibration_saw_them_is_refused(
    folder, change, words, tmp_path, capsys
):
    film = changed(folder, tmp_path / "bumped.mp4", change)
    calibration = ["--calibration", folder / "out" / "calibration.json"]
    said = refused([film, *calibration, "--out", tmp_path / "out"], capsys)
    assert re.search(words, said)
    if "camera was moved" in said:
        px, mm = re.search(r"([\d.]+) px \(([\d.]+) mm on the table\)", said).groups()
        assert float(px) == pytest.approx(SHIFT_PX, abs=SHIFT_TOLERANCE)
        assert 45 < float(mm) < 90
    assert not (tmp_path / "out" / "metrics.json").exists()


def test_a_single_tag_that_was_moved_is_named(folder, tmp_path, capsys):
    file = tmp_path / "calibration.json"
    values = json.loads((folder / "out" / "calibration.json").read_text())
    values["corners"]["3"] = [[u + 8.0, v] for u, v in values["corners"]["3"]]
    file.write_text(json.dumps(values))
    said = refused([folder / "trial.mp4", "--calibration", file, "--out", tmp_path / "a"], capsys)
    assert re.search(r"tags \[3\] were moved since .* \(3 by 8\.\d px, \d+\.\d mm\)", said)
    del values["corners"]
    file.write_text(json.dumps(values))
    said = refused([folder / "trial.mp4", "--calibration", file, "--out", tmp_path / "a"], capsys)
    assert "does not say where it saw the tags" in said


def test_the_camera_of_a_lab_file_tells_what_no_option_says(film, folder, tmp_path, capsys):
    layout = film.camera.layout
    moved = [dataclasses.replace(tag, x=tag.x + 0.03) for tag in layout.tags]
    dataclasses.replace(layout, tags=tuple(moved)).save(tmp_path / "moved.yaml")
    camera = "camera: {source: 0, width: 1280, height: 720, tags: moved.yaml}\n"
    (tmp_path / "lab.yaml").write_text(camera)
    words = ["--setup", str(tmp_path / "lab.yaml"), "--out", str(tmp_path / "out"), "--end", "0.2"]
    assert main(["track", str(folder / "trial.mp4"), *words, "--start", f"{START:.4f}"]) == 0
    here, there = (rows(f / "track.csv") for f in (tmp_path / "out", folder / "out"))
    assert [row["time_s"] for row in here] == [row["time_s"] for row in there[:3]]
    shifts = [float(a["x_m"]) - float(b["x_m"]) for a, b in zip(here, there, strict=False)]
    np.testing.assert_allclose(shifts, 0.03, atol=1e-3)
    again = [folder / "trial.mp4", *words, "--start", f"{START:.4f}"]
    (tmp_path / "lab.yaml").write_text(camera.replace("}", ", rate: 30}"))
    assert main(["track", *map(str, again)]) == 0
    assert "already done, nothing changed" in capsys.readouterr().err
    (tmp_path / "lab.yaml").write_text(camera.replace("}", ", marker_hue: 20}"))
    assert "camera.marker_hue is" in refused(again, capsys)


def test_slow_motion_that_the_phone_names_is_asked_about(folder, tmp_path, capsys):
    import av

    named = tmp_path / "phone.mp4"
    options = {"movflags": "use_metadata_tags"}
    with (
        av.open(str(folder / "trial.mp4")) as source,
        av.open(str(named), "w", options=options) as copy,
    ):
        copy.metadata["com.android.capture.fps"] = "240.0"
        stream = copy.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                copy.mux(packet)
    arguments = [named, "--calibration", folder / "out" / "calibration.json"]
    said = refused([*arguments, "--out", tmp_path / "a"], capsys)
    assert "was taken with 240 frames/s, and is stored with 60: say --rate 240" in said
    arguments += ["--out", tmp_path / "b", "--rate", "240", "--start", str(START / 4)]
    assert main(["track", *(str(argument) for argument in arguments)]) == 0
    times = [float(row["time_s"]) for row in rows(tmp_path / "b" / "frames.csv")]
    np.testing.assert_allclose(np.diff(times), 1 / 240, atol=2e-5)


def test_tags_that_were_moved_are_other_tags(folder, tmp_path, capsys):
    video, tags = folder / "trial.mp4", tmp_path / "tags.yaml"
    text = (folder / "tags.yaml").read_text()
    tags.write_text(text)
    arguments = [video, "--tags", tags, "--out", folder / "out", "--start", f"{START:.4f}"]
    assert main(["track", *map(str, arguments)]) == 0
    assert "already done, nothing changed" in capsys.readouterr().err
    tags.write_text(text + "# The same path, another content.\n")
    assert "tags_sha256 is" in refused(arguments, capsys)


def test_bad_films_calibrations_and_layouts_are_refused(folder, tmp_path, capsys):
    video, bad, none = folder / "trial.mp4", tmp_path / "bad.yaml", tmp_path / "none"
    bad.write_text("tags: []")
    for words, said in (
        ([bad], "no video that can be read"),
        ([none], "there is no video"),
        ([video, "--tags", bad], "at least 4"),
        ([video, "--calibration", bad], "is no calibration"),
        ([video, "--calibration", bad, "--tags", bad], "give either"),
        ([video, "--board", none], "no such folder"),
        ([video, "--start", "-1"], "[0, 3600]"),
    ):
        assert said in refused([*words, "--out", tmp_path / "out"], capsys)
    assert not (tmp_path / "out").exists()


def test_the_command_that_imports_what_was_tracked_can_be_typed_whatever_its_files_are_called():
    verb = Track(videos=(), setup=pathlib.Path("my lab/lab.yaml"))
    command = verb._import_command(pathlib.Path("my films/casts.csv"))
    words = ["import", "my films/casts.csv", "--setup", "my lab/lab.yaml"]
    assert shlex.split(command) == ["cablecast", *words]


def test_one_film_of_a_hand_is_said_to_be_one_cast(tmp_path, monkeypatch, capsys):
    found = types.SimpleNamespace(metrics={})
    monkeypatch.setattr("cablecast.pipeline.track_video.track_video", lambda *_, **__: found)
    monkeypatch.setattr("cablecast.pipeline.track_video.join_casts", lambda *_: 1)
    monkeypatch.setattr("cablecast.cli.track._print_result", lambda *_: None)
    Track(videos=(pathlib.Path("a.mp4"),), grip_hue=10.0, out=tmp_path).run()
    said = capsys.readouterr().out
    assert f"1 cast of cable_1 is in {tmp_path / 'casts.csv'}" in said
