"""A swing of its own lays out a cable that the standard one folds, or that no reset could lift."""

import dataclasses
import math
import pathlib

import numpy as np
import pytest

import cablecast as cc
from cablecast.cli.main import main
from cablecast.cli.options import load_lab
from cablecast.errors import JointLimitError
from cablecast.motion.grip_path import GripPath
from cablecast.motion.limits import check_grip_paths
from cablecast.motion.polar import plan_reset, polar_config, reset_pose, swing_path
from cablecast.pipeline.check import is_better
from cablecast.setup import PolarCastConfig, Swing, load_setup
from cablecast.tuning import swing

# Three generations in place of eighty.
FEW = 3
LIGHT = {"name": "tube", "kind": "hose", "length": 0.476, "diameter": 0.0019, "mass": 0.00129}
TABLE = {"table_width": 1.4, "table_depth": 1.1, "table_near_y": 0.18}
LAB = {"cable": LIGHT, "workspace": TABLE, "arm": {"model": "ur3", "base_height": 0.1}}


@pytest.fixture(scope="module")
def tuned() -> tuple[cc.Setup, cc.Setup]:
    setup = cc.Setup.from_dict(LAB)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(swing, "GENERATIONS", FEW)
        return setup, cc.tune_swing(setup)


def test_it_lays_the_cable_straighter_than_the_standard_swing(tuned):
    old, new = (cc.check(setup, changes=False) for setup in tuned)
    assert old.reset_offset > 0.5 * tuned[0].cable.length
    assert new.reset_offset < 0.7 * old.reset_offset
    assert is_better(new, old)
    assert not is_better(old, new)
    assert "--tune-swing" in old.swing_words
    assert "--tune-swing" not in new.swing_words


def test_the_arm_follows_it_and_the_gripper_stays_above_the_table(tuned):
    _, setup = tuned
    plan_reset(reset_pose(setup.workspace), setup)
    config = polar_config(setup)
    path = swing_path(setup.workspace.reset_y, setup.workspace.reset_y, setup, config)
    assert check_grip_paths(path, setup).mask.all()
    poses = path.evaluate(np.linspace(0.0, path.duration[0], 500))[0]
    assert poses[:, 2].min() > setup.workspace.grip_height - 1e-3
    assert (poses[:, 2] + 0.25 * np.cos(poses[:, 4])).min() > 0.1


def test_the_same_seed_finds_the_same_swing(tuned, monkeypatch):
    setup, found = tuned
    before = np.random.get_state()[1].copy()
    monkeypatch.setattr(swing, "GENERATIONS", FEW)
    assert cc.tune_swing(setup) == found
    np.testing.assert_array_equal(np.random.get_state()[1], before)


def test_a_swing_of_the_same_length_serves_a_short_table():
    # The gripper comes down nearer, after the same swing out.
    setup = cc.Setup()
    near, far = (swing_path(radius, 0.6, setup, PolarCastConfig()) for radius in (0.6, 0.88))
    reach = [path.evaluate(np.arange(0.0, 1.6, 0.01))[0, :, 1].max() for path in (near, far)]
    assert reach[0] == pytest.approx(reach[1], abs=0.06)
    assert GripPath.stack([near, far]).duration[0] > 2.0


def test_check_writes_it_into_the_lab_file_and_keeps_the_rest(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(swing, "GENERATIONS", FEW)
    lab = tmp_path / "lab.yaml"
    cc.save_setup(cc.Setup.from_dict(LAB), lab)
    before = lab.read_text() + "# by hand\n"
    lab.write_text(before)
    assert main(["check", "--setup", str(lab), "--tune-swing"]) == 0
    printed = capsys.readouterr().out
    assert f"the new one of {lab}, section `polar`" in printed
    assert before.rstrip("\n") in lab.read_text()
    setup = load_setup(lab)
    assert setup.polar is not None
    assert polar_config(setup) == setup.polar
    # What is no better than it leaves the file alone.
    text = lab.read_text()
    assert main(["check", "--setup", str(lab), "--tune-swing"]) == 0
    assert "none is better" in capsys.readouterr().out
    assert lab.read_text() == text


def test_check_says_where_it_would_write(capsys):
    assert main(["check", "--cable", "cable_2", "--tune-swing"]) == 2
    assert "--tune-swing writes to a lab file: give --setup" in capsys.readouterr().err


def test_settings_survive_a_lab_file_and_bad_ones_are_named(tmp_path):
    own = PolarCastConfig(hang_radius=0.5, swing=Swing(draw_back=0.1, radii=(0.4, 1.2)))
    setup = dataclasses.replace(cc.Setup(), polar=own)
    cc.save_setup(setup, tmp_path / "lab.yaml")
    assert load_setup(tmp_path / "lab.yaml") == setup
    assert setup.to_dict()["polar"] == {
        "hang_radius": 0.5,
        "swing": {"draw_back": 0.1, "radii": [0.4, 1.2]},
    }
    assert setup.to_settings()["polar"] == setup.to_dict()["polar"]
    wrong = [
        ({"hang_radius": 9.0}, "polar hang_radius = 9 m"),
        ({"swing": {"radii": [1.0]}}, r"polar swing radii = \[1.0\] must be a list of 2 numbers"),
        ({"swing": {"pitches": [0, 0, math.nan]}}, "polar swing pitches"),
        ({"swing": {"radius": 1.0}}, "radius"),
        ({"height": 1.0}, "height"),
    ]
    for values, message in wrong:
        with pytest.raises(cc.CablecastError, match=message):
            cc.Setup.from_dict({"polar": values})


def test_no_swing_is_kept_that_a_real_arm_would_refuse(monkeypatch):
    def refuse(*_: object) -> None:
        raise JointLimitError("too close to the camera post")

    monkeypatch.setattr(swing, "GENERATIONS", FEW)
    setup = load_setup(pathlib.Path(__file__).parents[2] / "examples" / "robot.yaml")
    assert cc.tune_swing(setup).polar is not None
    monkeypatch.setattr(swing, "check_path", refuse)
    with pytest.raises(cc.CablecastError, match="can follow no swing of this cable"):
        cc.tune_swing(setup)


def test_an_arm_whose_joints_are_searched_for_is_refused():
    class Searched(cc.ArmUR):
        solves_exactly = False

    setup = dataclasses.replace(cc.Setup(), arm=Searched())
    with pytest.raises(cc.CablecastError, match="that would take hours for ur5"):
        cc.tune_swing(setup)


def test_another_cable_than_the_file_s_has_the_standard_swing(tmp_path):
    own = dataclasses.replace(cc.Setup(), polar=PolarCastConfig(hang_radius=0.5))
    cc.save_setup(own, tmp_path / "lab.yaml")
    assert load_lab(tmp_path / "lab.yaml", None).polar == own.polar
    assert load_lab(tmp_path / "lab.yaml", "cable_2").polar is None
