"""`cablecast camera`: the page of a check, and the offset of two clocks from a film."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.cli import main
from cablecast.motion.trajectory import JointPath
from cablecast.rigs.virtual.camera import VirtualCamera
from cablecast.rigs.virtual.config import CameraConfig
from cablecast.rigs.virtual.drawing import FilmedTrial
from cablecast.setup import Setup, load_setup
from cablecast.vision.video import FilmWriter, read_video

RATE, WIDTH, HEIGHT = 30.0, 640, 360
OFFSET = 812.3456
# From a swing of a second and a half in small pictures with the usual noise.
OFFSET_MAX, SD_MAX = 0.003, 0.005


@pytest.fixture(scope="module")
def camera():
    config = dataclasses.replace(CameraConfig(), frame_rate=RATE, exposure=0.002)
    return VirtualCamera(config.resized(WIDTH))


def lab(folder, source, **values):
    lines = [f"  {name}: {value}" for name, value in values.items()]
    head = [f"  source: {source}", f"  width: {WIDTH}", f"  height: {HEIGHT}", f"  rate: {RATE}"]
    (folder / "lab.yaml").write_text("\n".join(["camera:", *head, *lines]) + "\n")
    return folder / "lab.yaml"


@pytest.fixture(scope="module")
def still(camera, tmp_path_factory):
    """Return a folder with a film of the empty table, of which the camera left out two frames."""
    folder = tmp_path_factory.mktemp("still")
    with FilmWriter(folder / "still.mkv", RATE) as film:
        for index in (0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 12):
            film.write(camera.empty_frame(seed=index), index / RATE)
    return folder


def test_a_check_says_on_one_page_what_is_and_what_to_change(still, capsys):
    file = lab(still, "still.mkv", exposure=1 / 120)
    picture = still / "check.png"
    arguments = ["--setup", str(file), "--seconds", "0.38", "--picture", str(picture)]
    assert main(["camera", "check", *arguments]) == 3
    page = capsys.readouterr().out
    assert len(page.splitlines()) < 40
    assert "30.00" in page
    assert "2 by the camera, 0 by this computer" in page
    # 5 m/s for 1/120 s.
    assert "41.7 mm at 5 m/s" in page
    assert "smears 42 mm, more than the marker's 38 mm" in page
    assert "the camera left out 2 frames" in page
    assert "run `cablecast camera sync`" in page
    assert "`cablecast calibrate lens`" in page
    # A cloth.
    assert "something of the marker's colour" in page
    assert "at x, y = -1.08, 0.4" in page
    assert picture.read_bytes()[:4] == b"\x89PNG"


def cleared(camera, seed):
    """Return a picture of the empty table without the green cloth at its left edge."""
    image = camera.empty_frame(seed=seed).copy()
    corners = np.array([[-1.25, 0.27, 0.0], [-0.9, 0.57, 0.0]])
    (left, bottom), (right, top) = np.round(camera.view.to_image(corners)).astype(int)
    image[top:bottom, left:right] = image[top - 2, left]
    return image


def test_a_camera_as_it_should_be_needs_no_change(camera, tmp_path, capsys):
    with FilmWriter(tmp_path / "still.mkv", RATE) as film:
        for index in range(8):
            film.write(cleared(camera, index), index / RATE)
    # So small a picture asks for a wide marker.
    known = {"marker": "[0.07, 0.03]", "clock_offset_sd": 0.001}
    file = lab(tmp_path, "still.mkv", exposure=0.001, **known)
    from cablecast.setup import update_lab_file

    update_lab_file(file, {"camera": {"lens": camera.view.lens.to_dict()}})
    assert main(["camera", "check", "--setup", str(file), "--seconds", "0.22"]) == 0
    assert "nothing to change" in capsys.readouterr().out


def test_a_dark_and_frozen_camera_is_told_so(tmp_path, capsys):
    with FilmWriter(tmp_path / "dark.mkv", RATE) as film:
        for index in range(8):
            film.write(np.full((HEIGHT, WIDTH, 3), 3, np.uint8), index / RATE)
    file = lab(tmp_path, "dark.mkv")
    assert main(["camera", "check", "--setup", str(file), "--seconds", "0.22"]) == 3
    page = capsys.readouterr().out
    assert "is frozen" in page
    assert "the picture is dark (3 of 255)" in page
    assert "0 of the layout's 11 tags" in page


@pytest.fixture(scope="module")
def swing(camera, tmp_path_factory):
    """Return a folder with a film of the swinging arm, and the robot's log of it."""
    folder = tmp_path_factory.mktemp("swing")
    setup = Setup()
    times = np.arange(0.0, 2.2, 0.008)
    inside = np.clip((times - 0.3) / 1.6, 0.0, 1.0)
    theta = 0.35 * np.sin(np.pi * inside) ** 2 * np.sin(4 * np.pi * inside)
    r = np.full_like(times, 0.7)
    poses = np.column_stack([r * np.sin(theta), r * np.cos(theta), 0 * r + 0.02, theta, 0 * r])
    q = setup.arm.inverse(poses)
    path = JointPath(times=times, q=q, qd=np.gradient(q, times, axis=0))
    share = np.linspace(0, 1, 8)[:, None]
    nodes = poses[:, None, :3] + share * np.array([0.0, 0.5, -0.015])
    trial = FilmedTrial(cable=setup.cable, times=times, nodes=nodes, joint_path=path, arm=setup.arm)
    film = camera.film(trial, seed=4)
    with FilmWriter(folder / "swing.mkv", RATE) as writer:
        for frame in range(film.LEAD, film.frame_count):
            writer.write(film.frame(frame), film.time(frame))
    rows = [
        ",".join(f"{x:.6f}" for x in (t + OFFSET, *row)) for t, row in zip(times, q, strict=True)
    ]
    (folder / "log.csv").write_text("\n".join(["time_s,q1,q2,q3,q4,q5,q6", *rows]))
    return folder


def sync(folder, file, *more):
    paths = ["--film", str(folder / "swing.mkv"), "--log", str(folder / "log.csv")]
    return main(["camera", "sync", "--setup", str(file), *paths, *more])


def test_the_offset_of_the_clocks_is_found_from_the_swinging_arm(swing, capsys):
    file = lab(swing, 0)
    assert sync(swing, file, "--begin", "3.0") == 0
    settings = load_setup(file).camera
    assert settings is not None
    assert settings.clock_offset == pytest.approx(OFFSET - 3.0, abs=OFFSET_MAX)
    assert settings.clock_offset_sd is not None
    assert 0 < settings.clock_offset_sd < SD_MAX
    assert "standard deviation" in capsys.readouterr().out


@pytest.mark.parametrize(("slower", "true"), [(1.0, None), (2.0, 30), (0.5, 30)])
def test_a_track_with_a_log_has_its_time_and_a_film_of_another_rate_is_refused(
    swing, tmp_path, capsys, slower, true
):
    _, frames = read_video(swing / "swing.mkv")
    with FilmWriter(tmp_path / "film.mkv", RATE / slower) as writer:
        for time, image in frames:
            writer.write(image, slower * time)
    lines = (swing / "log.csv").read_text().splitlines()
    rows = (line.partition(",") for line in lines[1:])
    later = [f"{float(time) - OFFSET - 0.25:.6f},{rest}" for time, _, rest in rows]
    (tmp_path / "log.csv").write_text("\n".join([lines[0], *later]))
    arguments = ["track", str(tmp_path / "film.mkv"), "--log", str(tmp_path / "log.csv")]
    arguments += ["--out", str(tmp_path / "out")]
    if true is None:
        assert main(arguments) == 0
        first = (tmp_path / "out" / "frames.csv").read_text().splitlines()[1]
        # The film starts a quarter of a second before the log's time 0.
        assert float(first.split(",")[1]) == pytest.approx(-0.25, abs=OFFSET_MAX)
        return
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert f"filmed with about {true} frames/s, and stored as {RATE / slower:.0f}?" in said
    if slower > 1.0:
        # The true rate is believed.
        assert main([*arguments, "--rate", str(true)]) == 0


def test_a_log_of_another_motion_is_refused(swing, tmp_path, capsys):
    lines = (swing / "log.csv").read_text().splitlines()
    still = lines[1].split(",")[1:]
    rows = [",".join([line.split(",")[0], *still]) for line in lines[1:]]
    (tmp_path / "log.csv").write_text("\n".join([lines[0], *rows]))
    (tmp_path / "swing.mkv").symlink_to(swing / "swing.mkv")
    assert sync(tmp_path, lab(tmp_path, 0)) == 2
    assert "the gripper moved 0.000 m" in capsys.readouterr().err


def test_a_log_that_counts_from_another_day_is_refused(swing, tmp_path, capsys):
    lines = (swing / "log.csv").read_text().splitlines()
    rows = (line.partition(",") for line in lines[1:])
    later = [f"{float(time) + 1000.0:.6f},{rest}" for time, _, rest in rows]
    (tmp_path / "log.csv").write_text("\n".join([lines[0], *later]))
    words = ["--log", str(tmp_path / "log.csv"), "--out", str(tmp_path / "out")]
    assert main(["track", str(swing / "swing.mkv"), *words]) == 2
    assert "let the log count from the start of the motion" in capsys.readouterr().err


def test_sync_without_its_files_says_what_it_needs(tmp_path, capsys):
    assert main(["camera", "sync", "--setup", str(lab(tmp_path, 0))]) == 2
    assert "needs a film of the swinging arm" in capsys.readouterr().err
