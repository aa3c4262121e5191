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
from cablecast.motion.polar import (
    PullReach,
    cast_paces,
    highest_lift,
    plan_reset,
    polar_config,
    reset_pose,
    swing_path,
)
from cablecast.motion.trajectory import plan_trajectory
from cablecast.pipeline import check
from cablecast.pipeline.check import is_better
from cablecast.setup import PolarCastConfig, Swing, load_setup
from cablecast.tuning import swing

# Three generations in place of eighty, and 40 casts that a laboratory is judged by in place of 400.
FEW, CASTS = 3, 40
LIGHT = {"name": "tube", "kind": "hose", "length": 0.476, "diameter": 0.0019, "mass": 0.00129}
TABLE = {"table_width": 1.4, "table_depth": 1.1, "table_near_y": 0.18}
LAB = {"cable": LIGHT, "workspace": TABLE, "arm": {"model": "ur3", "base_height": 0.1}}


@pytest.fixture(scope="module", autouse=True)
def little_work():
    caches = check._believed, check._polar_landings
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(swing, "GENERATIONS", FEW)
        for name, value in (
            ("CAST_COUNT", CASTS),
            ("CALM_COUNT", CASTS),
            ("POLAR_STEP", (0.3, 0.3)),
        ):
            patch.setattr(check, f"_{name}", value)
        patch.setattr(check, "_possible", lambda setup: [])
        for cache in caches:
            cache.cache_clear()
        yield
    for cache in caches:
        cache.cache_clear()


@pytest.fixture(scope="module")
def tuned(little_work) -> tuple[cc.Setup, cc.Setup]:
    setup = cc.Setup.from_dict(LAB)
    return setup, cc.tune_swing(setup)


@pytest.fixture
def command_finds_it(tuned, monkeypatch):
    """Let the command look for no swing anew."""
    monkeypatch.setattr(check, "tune_swing", lambda *_, **__: tuned[1])


def test_it_lays_the_cable_straighter_than_the_standard_swing(tuned):
    old, new = (cc.check(setup, changes=False) for setup in tuned)
    assert old.reset_offset > 0.5 * tuned[0].cable.length
    assert new.reset_offset < 0.7 * old.reset_offset
    assert is_better(new, old)
    assert not is_better(old, new)
    assert "--tune-swing" in old.swing_words
    assert "--tune-swing" not in new.swing_words
    # What lays the cable out counts before how straight it lies.
    straight = dataclasses.replace(new, reset_offset=0.01, lays_out=False)
    folded = dataclasses.replace(new, reset_offset=tuned[0].cable.length, lays_out=True)
    assert is_better(straight, folded)
    assert is_better(dataclasses.replace(straight, lays_out=True), straight)
    assert not is_better(dataclasses.replace(straight, reset_offset=math.inf), folded)


def test_the_arm_follows_it_and_the_gripper_stays_above_the_table(tuned):
    _, setup = tuned
    plan_reset(reset_pose(setup.workspace), setup)
    config = polar_config(setup)
    path = swing_path(setup.workspace.reset_y, setup.workspace.reset_y, setup, config)
    assert check_grip_paths(path, setup).mask.all()
    poses = path.evaluate(np.linspace(0.0, path.duration[0], 500))[0]
    assert poses[:, 2].min() > setup.workspace.grip_height - 1e-3
    assert (poses[:, 2] + 0.25 * np.cos(poses[:, 4])).min() > 0.1


def test_polar_casts_begin_at_the_pace_at_which_it_was_found(tuned):
    standard, own = (cast_paces(setup) for setup in tuned)
    assert standard[0] == 0.9
    assert own[0] == 1.0
    assert set(own) == set(standard)
    plan_trajectory(PullReach.of(tuned[1]).ahead(own[0]), tuned[1])


def test_the_same_seed_finds_the_same_swing_and_ignores_files_beside_it(
    tuned, tmp_path, monkeypatch
):
    setup, found = tuned
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cma_signals.in").write_text('{"timeout": 0}')
    before = np.random.get_state()[1].copy()
    assert cc.tune_swing(setup) == found
    np.testing.assert_array_equal(np.random.get_state()[1], before)


def test_a_swing_of_the_same_length_serves_a_short_table():
    # The gripper comes down nearer, after the same swing out.
    setup = cc.Setup()
    near, far = (swing_path(radius, 0.6, setup, PolarCastConfig()) for radius in (0.6, 0.88))
    reach = [path.evaluate(np.arange(0.0, 1.6, 0.01))[0, :, 1].max() for path in (near, far)]
    assert reach[0] == pytest.approx(reach[1], abs=0.06)
    assert GripPath.stack([near, far]).duration[0] > 2.0


def test_check_writes_it_into_the_lab_file_and_keeps_the_rest(
    tuned, command_finds_it, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    lab = tmp_path / "lab.yaml"
    cc.save_setup(cc.Setup.from_dict(LAB), lab)
    before = lab.read_text() + "# by hand\n"
    lab.write_text(before)
    assert main(["check", "--setup", str(lab), "--tune-swing"]) == 0
    printed = capsys.readouterr().out
    assert f"the new one of {lab}, section `polar`" in printed
    assert before.rstrip("\n") in lab.read_text()
    assert load_setup(lab) == tuned[1]
    assert polar_config(tuned[1]) == tuned[1].polar
    # What is no better than it leaves the file alone.
    text = lab.read_text()
    assert main(["check", "--setup", str(lab), "--tune-swing"]) == 0
    assert "none is better" in capsys.readouterr().out
    assert lab.read_text() == text


def test_a_swing_that_is_looked_for_in_vain_is_not_advised_again(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(check, "check_tuned", lambda *_, **__: None)
    lab = tmp_path / "lab.yaml"
    cc.save_setup(cc.Setup.from_dict(LAB), lab)
    assert main(["check", "--setup", str(lab), "--tune-swing"]) == 0
    printed = capsys.readouterr().out
    assert f"none is better than that of {lab}, which the arm cannot follow" in printed
    assert "--tune-swing" not in printed


def test_check_says_where_it_would_write(capsys):
    assert main(["check", "--cable", "cable_2", "--tune-swing"]) == 2
    assert "--tune-swing writes to a lab file: give --setup" in capsys.readouterr().err


def test_settings_survive_a_lab_file_and_bad_ones_are_named(tmp_path):
    own = PolarCastConfig(hang_radius=0.5, swing=Swing(draw_back=0.1, radii=(0.4, 1.2)))
    setup = dataclasses.replace(cc.Setup(), polar=own)
    cc.save_setup(setup, tmp_path / "lab.yaml")
    assert load_setup(tmp_path / "lab.yaml") == setup
    assert setup.to_settings()["polar"] == setup.to_dict()["polar"]
    assert setup.to_dict()["polar"]["swing"]["radii"] == [0.4, 1.2]
    wrong = [
        ({"hang_radius": 9.0}, "polar hang_radius = 9 m"),
        ({"arc_share": 0}, "polar arc_share = 0 is outside"),
        ({"swing": {"radii": [1.0]}}, r"polar swing radii = \[1.0\] must be a list of 2 numbers"),
        ({"swing": {"pitches": [0, 0, math.nan]}}, "polar swing pitches"),
        ({"swing": {"durations": [20, 1, 1, 1]}}, "polar swing durations = 20 s is outside"),
        ({"swing": {"radius": 1.0}}, "radius"),
        ({"swing": []}, "swing"),
        ({"height": 1.0}, "height"),
    ]
    for values, message in wrong:
        with pytest.raises(cc.CablecastError, match=message):
            cc.Setup.from_dict({"polar": values})


@pytest.mark.parametrize("model", ["ur3e", "ur10e", "ur20"])
def test_a_key_written_by_hand_leaves_the_others_as_the_arm_needs_them(model):
    lab = {"arm": {"model": model}, "polar": {"pull_speed": 0.1}}
    setup = cc.Setup.from_dict(lab)
    expected = PolarCastConfig.of_reach(setup.workspace)
    assert setup.polar == dataclasses.replace(expected, pull_speed=0.1)
    assert cc.Setup.from_dict({**lab, "polar": None}).polar is None


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"rise_radius": 2.0}, "the arm cannot follow this reset"),
        (
            {"swing": {"durations": [2, 2, 2, 2], "heights": [1, 0, 0], "pitches": [0, 0, 0]}},
            "z of",
        ),
    ],
)
def test_a_path_that_no_arm_should_make_is_refused(values, words):
    setup = cc.Setup.from_dict({"polar": values})
    with pytest.raises(JointLimitError, match=words):
        plan_reset(reset_pose(setup.workspace), setup)


def test_no_rest_at_all_is_a_reset_too():
    setup = cc.Setup.from_dict({"polar": {"hang_time": 0, "settle_time": 0}})
    reset = plan_reset(reset_pose(setup.workspace), setup)
    assert reset.duration < plan_reset(reset_pose(setup.workspace), cc.Setup()).duration - 3.0


def test_a_lab_file_that_cannot_be_changed_loses_nothing(
    command_finds_it, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    lab = tmp_path / "lab.yaml"
    lab.write_text(str(LAB))
    assert main(["check", "--setup", str(lab), "--tune-swing"]) == 2
    printed = capsys.readouterr()
    assert "cannot be changed: write each section on lines of its own" in printed.err
    assert "durations:" in printed.out
    assert lab.read_text() == str(LAB)


def test_no_swing_is_tuned_for_strikes():
    with pytest.raises(cc.CablecastError, match="has a strike section"):
        cc.tune_swing(dataclasses.replace(cc.Setup(), strike=cc.StrikeConfig()))


def test_no_swing_is_kept_that_a_real_arm_would_refuse(monkeypatch):
    def refuse(*_: object) -> None:
        raise JointLimitError("too close to the camera post")

    setup = load_setup(pathlib.Path(__file__).parents[2] / "examples" / "robot.yaml")
    free = highest_lift(setup, reset_pose(setup.workspace)[None], lambda path: True)
    # Below a beam the cable is lifted less high.
    values = setup.to_dict()
    values["robot"]["obstacles"] = [
        {"start": [-1, 0.35, 0.95], "end": [1, 0.35, 0.95], "radius": 0.03}
    ]
    values["polar"] = {"hang_time": 2.0, "pull_speed": 0.05}
    below = cc.tune_swing(cc.Setup.from_dict(values), seed=1).polar
    assert free is not None
    assert below is not None
    assert below.hang_height_max < free.hang_height_max
    # Times of rest and of the pull are kept.
    assert (below.hang_time, below.pull_speed) == (2.0, 0.05)
    monkeypatch.setattr(swing, "follow", refuse)
    with pytest.raises(cc.CablecastError, match=r"the ur5e cannot lift \w+"):
        cc.tune_swing(setup)


def test_an_arm_whose_joints_are_searched_for_is_refused():
    class Searched(cc.ArmUR):
        solves_exactly = False

    setup = dataclasses.replace(cc.Setup(), arm=Searched())
    with pytest.raises(cc.CablecastError, match="for ur5 the search would take hours"):
        cc.tune_swing(setup)


def test_another_cable_than_the_file_s_has_the_standard_swing(tmp_path):
    own = dataclasses.replace(cc.Setup(), polar=PolarCastConfig(hang_radius=0.5))
    cc.save_setup(own, tmp_path / "lab.yaml")
    assert load_lab(tmp_path / "lab.yaml", None).polar == own.polar
    assert load_lab(tmp_path / "lab.yaml", "cable_1").polar == own.polar
    assert load_lab(tmp_path / "lab.yaml", "cable_2").polar is None
    assert own.with_cable("cable_1") == own
    assert own.with_cable("cable_2") == cc.Setup(cable="cable_2", workspace=own.workspace)
