"""`cablecast calibrate`: touched tags and pictures of a board become values in the lab file."""

import dataclasses
import io
import shlex
import types

import numpy as np
import pytest

from cablecast.arm.ur import ArmUR
from cablecast.camera.tags import default_layout, read_touches
from cablecast.cli import main
from cablecast.cli.calibrate import _ask_for_touches
from cablecast.errors import InputError
from cablecast.setup import load_setup

LAB = """\
# my lab
workspace:
  table_near_y: 0.0  # measured with a tape
arm:
  model: ur5e
  base_height: 0.15  # a guess
camera:
  source: 0
  width: 960
  height: 540
"""
ARM = ArmUR(model="ur5e", base_height=0.1832, base_yaw_deg=-31.5)
AXIS = np.array([0.004, -0.023])
# A tip is put on a tag's centre to a third of a millimetre; nine of them average most of it.
TOUCH_SD, PLACE_MAX, YAW_MAX_DEG = 0.0003, 0.001, 0.05


@pytest.fixture
def lab(tmp_path):
    file = tmp_path / "lab.yaml"
    file.write_text(LAB)
    return file


@pytest.fixture
def touched():
    """Return what the controller reports of the tags of a table before which it stands."""
    rng = np.random.default_rng(3)
    base = ARM.frames(np.zeros(6))[0]
    points = {}
    for tag in default_layout().tags:
        place = np.array([tag.x - AXIS[0], tag.y - AXIS[1], 0.0])
        points[tag.id] = base[:3, :3].T @ (place - base[:3, 3]) + rng.normal(0, TOUCH_SD, 3)
    # Somebody has moved one.
    points[6] += [0.0, 0.04, 0.0]
    return points


def calibrate_table(lab, touched, *more):
    """Run the verb with touched points in a file, and return its exit status."""
    rows = [f"{i},{x:.5f},{y:.5f},{z:.5f}" for i, (x, y, z) in touched.items()]
    file = lab.with_name("touched.csv")
    file.write_text("\n".join(["tag,x_m,y_m,z_m", *rows]))
    words = ["calibrate", "table", "--setup", str(lab), "--touched", str(file)]
    return main([*words, *more])


def check_lab(lab):
    setup = load_setup(lab)
    assert setup.arm.base_height == pytest.approx(ARM.base_height, abs=PLACE_MAX)
    assert setup.arm.base_yaw_deg == pytest.approx(ARM.base_yaw_deg, abs=YAW_MAX_DEG)
    assert setup.workspace.table_near_y == pytest.approx(-AXIS[1], abs=PLACE_MAX)
    assert setup.camera is not None
    assert setup.camera.tags is not None
    for tag, plan in zip(setup.camera.tags.tags, default_layout().tags, strict=True):
        np.testing.assert_allclose([tag.x, tag.y], [plan.x, plan.y] - AXIS, atol=PLACE_MAX)


@pytest.mark.parametrize("more", ["", "strike:\n  watch_time: 1.5\n"])
def test_touched_tags_become_the_place_of_the_robot_in_the_lab_file(lab, touched, more, capsys):
    lab.write_text(LAB + more)
    assert calibrate_table(lab, touched, "--no-write") == 0
    assert lab.read_text() == LAB + more
    assert calibrate_table(lab, touched) == 0
    printed = capsys.readouterr().out
    assert printed.count("lies elsewhere, and was left out") == 2
    assert "tag   6" in printed
    check_lab(lab)
    assert "# my lab" in lab.read_text()
    assert "# a guess" in lab.read_text()


def test_touches_with_the_tip_of_another_tool_are_refused(lab, touched, capsys):
    lifted = {tag_id: point + [0.0, 0.0, 0.1] for tag_id, point in touched.items()}
    assert calibrate_table(lab, lifted) == 2
    said = capsys.readouterr().err
    assert "the touches put the base 0.083 m above the table, and the lab file 0.150 m" in said
    assert lab.read_text() == LAB


def test_touched_points_may_be_typed_as_the_pendant_shows_them(lab, touched, monkeypatch, capsys):
    lines = {tag_id: "{:.2f} {:.2f} {:.2f}".format(*1e3 * p) for tag_id, p in touched.items()}
    # Tag 0 is typed wrongly first; tag 3 is left out.
    lines |= {0: "what?\nnan nan nan\n" + lines[0].replace(" ", ", "), 3: ""}
    monkeypatch.setattr("sys.stdin", io.StringIO("\n".join(lines.values()) + "\n"))
    assert main(["calibrate", "table", "--setup", str(lab)]) == 0
    assert capsys.readouterr().out.count("three numbers, please") == 2
    check_lab(lab)


def test_typed_points_that_the_fit_refuses_are_typed_once(lab, touched, monkeypatch, capsys):
    lines = [f"{1e3 * x:.2f} {1e3 * y:.2f} {1e3 * z + 100:.2f}" for x, y, z in touched.values()]
    monkeypatch.setattr("sys.stdin", io.StringIO("\n".join(lines) + "\n"))
    words = ["calibrate", "table", "--setup", str(lab)]
    assert main(words) == 2
    lab.write_text(lab.read_text().replace("base_height: 0.15", "base_height: 0.08"))
    said = capsys.readouterr().out
    words += ["--touched", said.rpartition("--touched ")[2].split(" gives")[0]]
    assert main(words) == 0
    # The tip was 10 cm above the tags.
    height = load_setup(lab).arm.base_height
    assert height == pytest.approx(ARM.base_height - 0.1, abs=PLACE_MAX)


def test_nobody_to_type_is_an_error_and_not_a_wait(lab, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    assert main(["calibrate", "table", "--setup", str(lab)]) == 2
    assert "--touched FILE" in capsys.readouterr().err
    assert lab.read_text() == LAB


def test_a_lab_without_a_camera_is_refused(tmp_path, capsys):
    file = tmp_path / "lab.yaml"
    file.write_text("{}")
    assert main(["calibrate", "table", "--setup", str(file)]) == 2
    assert "no section `camera`" in capsys.readouterr().err


def test_pictures_of_a_board_become_the_lens_in_the_lab_file(lab, tmp_path, capsys):
    cv2 = pytest.importorskip("cv2")
    from cablecast.rigs.virtual.camera import VirtualCamera, board_pictures
    from cablecast.rigs.virtual.config import CameraConfig
    from cablecast.vision.calibration import Board

    camera = VirtualCamera(dataclasses.replace(CameraConfig(), noise=0.0).resized(960))
    pictures = tmp_path / "board"
    pictures.mkdir()
    for index, picture in enumerate(board_pictures(camera, board=Board(legacy=True))[:8]):
        cv2.imwrite(str(pictures / f"{index}.png"), picture)
    assert main(["calibrate", "lens", "--setup", str(lab), "--pictures", str(pictures)]) == 0
    assert "older pattern" in capsys.readouterr().out
    settings = load_setup(lab).camera
    assert settings is not None
    assert settings.lens is not None
    # Eight pictures of half the usual size.
    np.testing.assert_allclose(settings.lens.focal, camera.view.lens.focal, rtol=5e-3)


def test_the_option_that_gives_typed_points_again_can_be_typed(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO("1 2 3\n"))
    file = tmp_path / "my lab-touched.csv"
    _ask_for_touches([7], file)
    said = capsys.readouterr().out.splitlines()[-1]
    assert shlex.split(said.partition("kept: ")[2])[:2] == ["--touched", str(file)]


def test_typing_that_was_stopped_goes_on_with_the_points_so_far(tmp_path, capsys, monkeypatch):
    file = tmp_path / "lab-touched.csv"
    file.write_text("tag,x_m,y_m,z_m\n7,9.0,9.0,9.0\n")

    def typed(text):
        monkeypatch.setattr("sys.stdin", io.StringIO(text))
        return _ask_for_touches([7, 8, 9], file)

    with pytest.raises(InputError):
        typed("1 2 3\n4 5 6\n")
    said = capsys.readouterr().out.splitlines()[-1]
    part = tmp_path / "lab-touched-part.csv"
    assert f"kept in {part}: the same command goes on" in said
    # What an earlier run kept to its end is not lost by one that was stopped.
    assert read_touches(file) == {7: (9.0, 9.0, 9.0)}
    # The second one is typed anew.
    assert typed("\n4 5 7\n7 8 9\n") == read_touches(file)
    assert read_touches(file) == {
        7: (1e-3, 2e-3, 3e-3),
        8: (4e-3, 5e-3, 7e-3),
        9: (7e-3, 8e-3, 9e-3),
    }
    said = capsys.readouterr().out
    assert "tag 7, x y z [mm] (1.00 2.00 3.00): " in said
    assert "tag 9, x y z [mm]: " in said
    assert not part.exists()


def test_typing_that_is_stopped_by_ctrl_c_says_where_its_points_lie(tmp_path, capsys, monkeypatch):
    def stop():
        raise KeyboardInterrupt

    lines = iter([lambda: "1 2 3\n", stop])
    monkeypatch.setattr("sys.stdin", types.SimpleNamespace(readline=lambda: next(lines)()))
    with pytest.raises(KeyboardInterrupt):
        _ask_for_touches([7, 8], tmp_path / "lab-touched.csv")
    assert f"kept in {tmp_path / 'lab-touched-part.csv'}" in capsys.readouterr().out
