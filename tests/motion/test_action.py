import dataclasses

import numpy as np
import pytest

from cablecast.errors import ActionError, InputError
from cablecast.motion.action import (
    ACTION_SIZE,
    PSI_MAX,
    ActionRanges,
    action_rows,
    check_action_values,
    grid_actions,
    mirror_actions,
    mirror_to_right,
)
from cablecast.motion.casting import Action
from cablecast.setup import MotionConfig


def test_an_action_survives_the_way_through_an_array():
    action = Action(-0.5, 0.7, 0.6, 1.1, 0.4)
    assert Action.from_array(action.to_array()) == action


def test_without_psi_the_cable_ends_along_theta2():
    assert Action(-0.5, 0.7, 0.6).to_array()[3] == 0.7
    assert Action.from_array([-0.5, 0.7, 0.6]) == Action(-0.5, 0.7, 0.6)


def test_mirroring_changes_the_sign_of_every_angle_and_keeps_radius_and_pace():
    action = Action(-0.5, 0.7, 0.6, 1.1, 0.4)
    assert action.mirrored() == Action(0.5, -0.7, 0.6, -1.1, 0.4)
    assert action.mirrored().mirrored() == action
    assert Action(-0.5, 0.7, 0.6).mirrored() == Action(0.5, -0.7, 0.6)
    np.testing.assert_array_equal(
        mirror_actions(action.to_array()[None])[0], action.mirrored().to_array()
    )


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((np.nan, 0.5, 0.6, 0.5), "theta1 = nan must be a finite number"),
        ((-0.5, 0.5, np.inf, 0.5), "r2 = inf must be a finite number"),
        ((0.5, 0.5, 0.6, 0.5), "must have opposite signs"),
        ((-0.5, -0.5, 0.6, -0.5), "must have opposite signs"),
        ((0.0, 0.5, 0.6, 0.5), r"\|theta1\| = 0 deg is outside \[0\.5, 120\] deg"),
        ((-0.5, 2.2, 0.6, 2.2), r"\|theta2\| = 126\.1 deg is outside"),
        ((-0.5, 0.5, -0.6, 0.5), r"r2 = -0\.6 m is outside \[0\.05, 5\] m"),
        ((-0.5, 0.5, 0.6, 0.4), r"psi = 22\.92 deg must lie between theta2 = 28\.65 deg and 180"),
        ((0.5, -0.5, 0.6, 0.5), r"psi = 28\.65 deg must lie between theta2 = -28\.65 deg and -180"),
        ((-0.5, 0.5, 0.6, 3.2), r"psi = 183\.3 deg must lie between"),
        ((-0.5, 0.5, 0.6, 0.5, 0.01), r"pace = 0\.01 is outside \[0\.05, 3\]"),
        ((-0.5, 0.5, 0.6, 0.5, 3.5), r"pace = 3\.5 is outside \[0\.05, 3\]"),
        ((-0.5, 0.5, 0.6, 0.5, np.nan), "pace = nan must be a finite number"),
    ],
)
def test_a_bad_action_is_refused_with_its_value_and_bound(values, message):
    with pytest.raises(ActionError, match=message):
        Action(*values)


def test_a_bad_row_of_a_batch_is_named():
    actions = np.tile([-0.5, 0.5, 0.6, 0.5], (4, 1))
    actions[2, 2] = 9.0
    with pytest.raises(ActionError, match="action 2: r2 = 9 m"):
        check_action_values(actions)


@pytest.mark.parametrize("shape", [(5,), (2, 3), (2, 6), (0, 4), (0, 5)])
def test_a_batch_of_the_wrong_shape_is_refused(shape):
    with pytest.raises(ActionError, match="must be"):
        check_action_values(np.full(shape, 0.5))


def test_an_action_that_is_no_number_is_refused():
    with pytest.raises(ActionError, match="not a number"):
        Action("left", 0.5, 0.6)  # pyright: ignore[reportArgumentType]


def test_a_grid_holds_every_combination_once_and_all_of_them_are_valid():
    actions = grid_actions(ActionRanges(), (4, 3, 5, 2))
    assert actions.shape == (4 * 3 * 5 * 2, ACTION_SIZE)
    assert len(np.unique(actions, axis=0)) == len(actions)
    check_action_values(actions)
    assert np.all(actions[:, 0] < 0)
    assert np.all(actions[:, 1] > 0)
    assert np.all(actions[:, 3] >= actions[:, 1])


def test_a_grid_reaches_both_ends_of_each_range():
    ranges = ActionRanges(pace=(0.2, 1.25))
    actions = grid_actions(ranges, (3, 3, 3, 3, 3))
    actions[:, 3] -= actions[:, 1]
    for values, (low, high) in zip(actions.T, ranges.to_array(), strict=True):
        np.testing.assert_allclose([values.min(), values.max()], [low, high], atol=1e-12)


def test_a_grid_of_three_counts_has_no_wrist_turn():
    actions = grid_actions(ActionRanges(), (3, 3, 3))
    np.testing.assert_array_equal(actions[:, 3], actions[:, 1])


def test_a_batch_without_a_pace_is_the_papers():
    actions = np.array([[-0.4, 0.6, 0.5, 0.7], [-0.3, 0.5, 0.6, 0.9]])
    for rows in (action_rows(actions), check_action_values(actions)):
        np.testing.assert_array_equal(rows[:, :4], actions)
        np.testing.assert_array_equal(rows[:, 4], 1.0)
    assert Action.from_array(actions[0]).pace == 1.0
    grid = grid_actions(ActionRanges(pace=(0.2, 1.25)), (2, 2, 2, 2))
    np.testing.assert_array_equal(grid[:, 4], 1.0)


@pytest.mark.parametrize("counts", [(3, 3), (3, 0, 3), (1, 2, 3, 4, 5, 6)])
def test_a_grid_without_three_to_five_positive_counts_is_refused(counts):
    with pytest.raises(InputError, match="three, four or five positive"):
        grid_actions(ActionRanges(), counts)


def test_ranges_that_do_not_rise_or_leave_their_bounds_are_refused():
    with pytest.raises(ActionError, match="range of r2"):
        ActionRanges(r2=(0.8, 0.3))
    with pytest.raises(ActionError, match=r"range of pace .* within \[0\.05, 3\]"):
        ActionRanges(pace=(0.01, 1.0))
    with pytest.raises(ActionError, match="range of theta1"):
        ActionRanges(theta1=(-0.5, 0.5))
    with pytest.raises(ActionError, match=f"at most {PSI_MAX:.4g}"):
        ActionRanges(theta2=(0.1, 2.0), wrist=(0.0, 2.0))


@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(MotionConfig)])
@pytest.mark.parametrize("value", [-1.0, 0.0, np.nan, np.inf, "fast"])
def test_a_system_parameter_out_of_bounds_is_refused(field, value):
    with pytest.raises(InputError, match=f"{field} = "):
        MotionConfig(**{field: value})


def test_actions_mirrored_to_the_right_know_the_side_that_brings_them_back():
    actions = np.array([[-0.4, 0.6, 0.5, 0.7, 1.0], [0.3, -0.5, 0.6, -0.9, 0.4]])
    right, side = mirror_to_right(actions)
    np.testing.assert_array_equal(right, [[-0.4, 0.6, 0.5, 0.7, 1.0], [-0.3, 0.5, 0.6, 0.9, 0.4]])
    np.testing.assert_array_equal(side, [1.0, -1.0])
    np.testing.assert_array_equal(mirror_actions(right, side), actions)
