"""What `aim` prints can be pasted into a shell."""

import pathlib
import re
import shlex
import types

import numpy as np

from cablecast.aiming.config import AimConfig
from cablecast.cli.aim import Aim, _view_command
from cablecast.cli.options import TargetOptions, polar_text
from cablecast.cli.strike import strike_targets
from cablecast.cli.tries import TableTries
from cablecast.evaluation.evaluate import rounded_cells
from cablecast.report.words import distance_text, place_text
from cablecast.setup import Setup
from cablecast.task import LANDING, Expectation


def test_the_next_command_names_folders_with_spaces_whole():
    out, lab = pathlib.Path("my runs/it's"), pathlib.Path("the lab.yaml")
    words = shlex.split(_view_command(Aim(setup=lab, out=out, candidate_count=77, fast=True)))
    assert words[:4] == ["cablecast", "view", "--rig", "virtual"]
    assert words[words.index("--setup") + 1] == str(lab)
    assert words[words.index("--out") + 1] == str(out)
    assert words[words.index("--candidate-count") + 1] == "77"
    assert words[-1] == "--fast"


def test_a_target_that_is_out_of_reach_counts_among_those_that_were_asked_for(capsys):
    hit = types.SimpleNamespace(landed=True, miss_pct=1.0, hit=True)
    result = types.SimpleNamespace(
        target_xy=np.array([[0.1, 1.0]]),
        casts=[[hit]],
        stops=[""],
        hit=np.array([True]),
        session=types.SimpleNamespace(setup=Setup()),
    )
    TableTries(result.session).print_result(result, beyond_count=1)
    assert "1 of 2 targets were hit; 1 is out of reach." in capsys.readouterr().out


def test_a_target_that_needs_no_cast_is_said_with_the_reason(capsys):
    (hit, used) = goals = LANDING.goals(Setup(), [[0.1, 1.0], [0.2, 1.0]])
    casts = [types.SimpleNamespace(hit=number == 2, try_number=number) for number in (1, 2)]
    session = types.SimpleNamespace(
        setup=Setup(),
        config=AimConfig(tries=1),
        goals=lambda targets: goals,
        is_done=lambda value: True,
        casts_at=lambda value: casts if hit.is_same(value) else casts[:1],
    )
    tries = TableTries(session)
    for goal in session.goals(None):
        tries.print_done(goal)
    said = capsys.readouterr().out
    assert f"target    {polar_text(hit.value)}\n          hit before, by try 2" in said
    assert f"target    {polar_text(used.value)}\n          its only try was made before" in said


def test_a_target_that_is_given_twice_counts_once():
    polar, cartesian = ((1.1, -0.0), (1.0, 5.0), (1.1, 0.0), (1.0, 5.0)), ((0.0, 1.1), (0.2, 1.1))
    targets = TargetOptions(target=polar, target_xy=cartesian).targets(Setup())
    np.testing.assert_allclose(targets[[0, 2]], [[0.0, 1.1], [0.2, 1.1]])
    assert len(targets) == 3
    assert len(TargetOptions().targets(Setup())) == 0
    assert len(strike_targets(Aim(target=((1.2, 0.9), (1.2, 0.9))))) == 1


def test_half_and_nine_of_ten_are_stated_to_the_same_digit():
    (goal,) = LANDING.goals(Setup(), [0.1, 1.0])
    expected = Expectation(mean=goal.value, covariance=3e-5 * np.eye(2), scatter=0.01)
    proposal = types.SimpleNamespace(goal=goal, setup=Setup(), expected=expected)
    numbers = re.findall(r"[\d.]+ cm", distance_text(proposal))
    assert [len(number.partition(".")[2]) for number in numbers] == [4, 4]


def test_a_place_a_hair_left_of_the_middle_is_not_at_minus_zero():
    place = np.array([-1e-5, 1.0])
    assert polar_text(place) == "r = 1.000 m, theta = 0.0 deg (x = 0.000 m, y = 1.000 m)"
    assert place_text(place) == "1.00 m, 0°"
    assert str(rounded_cells(place)) == "[0.0, 1.0]"
