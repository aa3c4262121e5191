import dataclasses
import functools

import numpy as np
import pytest
from tests.robot import ROBOT

from cablecast.arm.ur import ArmUR, ur_limits
from cablecast.errors import ActionError, InputError, JointLimitError
from cablecast.motion.action import ACTION_SIZE, ActionRanges, grid_actions, mirror_actions
from cablecast.motion.casting import Action, cast_grip_paths
from cablecast.motion.feasibility import (
    check_actions,
    feasible_actions,
    feasible_grid,
    feasible_ranges,
    feasible_uniform,
    uniform_actions,
)
from cablecast.motion.grip_path import GripPath
from cablecast.motion.limits import LIMIT_SHARE, check_grip_paths
from cablecast.motion.trajectory import plan_trajectory
from cablecast.setup import MotionConfig, Setup
from cablecast.workspace import Workspace

SETUP = Setup()
TURNED_UR5E = Setup(arm=ArmUR(model="ur5e", base_yaw_deg=40.0))
EASY = np.array([[-0.8, 0.8, 0.7, 1.0]])


def dense_peaks(actions, setup):
    """Peaks of all joints on 4,000 times of each motion, computed without the sampled check."""
    grip = cast_grip_paths(actions, setup)
    times = np.linspace(0.0, 1.0, 4000) * grip.duration[:, None]
    motion = setup.arm.inverse_motion(*(grip.evaluate(times, order) for order in range(3)))
    return np.stack(
        [np.max(np.abs(values), axis=1) for values in (motion.q, motion.qd, motion.qdd)], axis=1
    )


@pytest.mark.parametrize(
    "setup",
    [SETUP.with_motion(v_max=1.8), SETUP.with_motion(r0=2.0), TURNED_UR5E],
    ids=["fast", "far origin", "turned UR5e"],
)
def test_peaks_between_samples_stay_within_the_share_that_is_kept_free(setup):
    actions = grid_actions(feasible_ranges(setup), (3, 3, 3, 3))
    checked = check_actions(actions, setup, both_sides=False)
    reached = ~np.isnan(checked.peaks[:, 0, 0])
    dense = dense_peaks(actions[reached], setup)
    limits = setup.arm.limits.to_array()
    # Only peaks near a limit decide anything.
    near = dense > 0.6 * limits
    assert np.any(near)
    assert np.all(dense[near] * LIMIT_SHARE <= checked.peaks[reached][near])
    assert np.all(dense[checked.mask[reached]] <= limits)


def hold(radius, duration=1.0):
    return GripPath.hold([0.0, radius, SETUP.workspace.grip_height, 0.0, 0.0], duration)


def tight(kind, joint, share):
    """Return an arm whose limit of one joint is a share of what the easy action needs."""
    peak = check_actions(EASY, SETUP, both_sides=False).peaks[0]
    index = ("position", "velocity", "acceleration").index(kind)
    values = list(getattr(ur_limits(), kind))
    values[joint] = share * peak[index, joint] / LIMIT_SHARE
    return ArmUR(limits=dataclasses.replace(ur_limits(), **{kind: tuple(values)}))


@pytest.mark.parametrize("kind", ["position", "velocity", "acceleration"])
@pytest.mark.parametrize("joint", [0, 1, 2, 3, 5])
def test_the_joint_and_the_limit_that_break_are_named_with_value_and_bound(kind, joint):
    arm = tight(kind, joint, share=0.9)
    checked = check_actions(EASY, Setup(arm=arm), both_sides=False)
    assert checked.mask.tolist() == [False]
    (violation,) = checked.reasons[0]
    name = ("base", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3")[joint]
    assert violation.name == f"{name} {kind}"
    assert violation.value == pytest.approx(violation.bound / 0.9)
    assert checked.counts() == {f"{name} {kind}": 1}
    assert f"{name} {kind} {violation.value:.4g} rad" in checked.describe(0)
    generous = tight(kind, joint, share=1.1)
    assert check_actions(EASY, Setup(arm=generous), both_sides=False).mask.tolist() == [True]


def test_every_broken_limit_is_named_not_only_the_first():
    arm = ArmUR(
        limits=dataclasses.replace(ur_limits(), velocity=(0.1,) * 6, acceleration=(0.1,) * 6)
    )
    names = {v.name for v in check_actions(EASY, Setup(arm=arm)).reasons[0]}
    assert {"base velocity", "elbow velocity", "base acceleration", "wrist_3 acceleration"} <= names


def test_an_action_out_of_reach_is_rejected_for_its_reach_alone():
    far, near = [-0.8, 0.8, 1.1, 1.0], [-0.8, 0.8, 0.1, 1.0]
    checked = check_actions([far, *EASY, near], SETUP)
    assert checked.mask.tolist() == [False, True, False]
    assert checked.describe(1) == ""
    (too_far,), (too_near,) = checked.reasons[0], checked.reasons[2]
    assert too_far.name == too_near.name == "reach"
    assert too_far.value > too_far.bound
    assert too_near.value < too_near.bound
    assert "is above" in str(too_far)
    assert "is below" in str(too_near)


def test_r_max_of_the_workspace_bounds_the_grip():
    action = [[-0.8, 0.8, 0.75, 0.8]]
    checked = check_actions(action, Setup(workspace=Workspace(r_max=0.7)))
    (violation,) = checked.reasons[0]
    assert (violation.value, violation.bound) == (pytest.approx(0.75), pytest.approx(0.7))


def test_a_cast_behind_the_tables_near_edge_is_refused_and_says_so():
    wide = [[-0.8, 1.7, 0.6, 1.7]]
    (violation,) = check_actions(wide, SETUP).reasons[0]
    assert str(violation).startswith(
        f"table edge: y of the grip {0.6 * np.cos(1.7):.4g} m is below"
    )
    with pytest.raises(JointLimitError, match="table edge: y of the grip"):
        plan_trajectory(Action.from_array(wide[0]), SETUP)
    behind = Workspace(table_near_y=-0.2, table_depth=1.7)
    assert check_actions(wide, Setup(workspace=behind)).mask.tolist() == [True]


BOX_LOW, BOX_HIGH = (-0.97, 0.05, 0.0), (0.75, 0.97, 1.1)


def test_what_may_be_chosen_keeps_grip_and_flange_within_the_robots_box_on_both_sides():
    robot = dataclasses.replace(ROBOT, box_low=BOX_LOW, box_high=BOX_HIGH)
    setup = Setup(robot=robot)
    sweep = [[-0.8, 1.53, 0.6, 1.6]]
    (violation,) = check_actions(sweep, setup).reasons[0]
    assert violation.name == "robot box"
    assert str(violation).startswith("robot box: y of the grip 0.024")
    # With a cable that points ahead, the flange is nearer to the base than the grip.
    (violation,) = check_actions([[-1.5, 0.5, 0.6, 0.5]], setup).reasons[0]
    assert str(violation).startswith("robot box: y of the flange")
    actions = feasible_uniform(60, setup)
    places = []
    for side in (actions, mirror_actions(actions)):
        for action in side:
            q = plan_trajectory(Action.from_array(action), setup).joint_path.q
            places += [setup.arm.grip_pose(q)[:, :3], setup.arm.forward(q)[:, :3, 3]]
    places = np.concatenate(places)
    assert np.all(places >= BOX_LOW)
    assert np.all(places <= BOX_HIGH)
    # The box is used: the candidates come near its sides.
    assert np.abs(places[:, 0]).max() > 0.72
    assert places[:, 1].min() < 0.15


@pytest.mark.parametrize("setup", [SETUP, TURNED_UR5E], ids=["UR5", "turned UR5e"])
def test_an_action_and_its_mirror_image_are_accepted_or_rejected_together(setup):
    setup = setup.with_motion(v_max=1.8)
    actions = grid_actions(ActionRanges(), (5, 5, 4, 3))
    ours = check_actions(actions, setup)
    theirs = check_actions(mirror_actions(actions), setup)
    assert 0 < np.sum(ours.mask) < len(actions)
    np.testing.assert_array_equal(ours.mask, theirs.mask)
    one_side = check_actions(actions, setup, both_sides=False)
    other = check_actions(mirror_actions(actions), setup, both_sides=False)
    np.testing.assert_array_equal(ours.mask, one_side.mask & other.mask)
    np.testing.assert_allclose(ours.peaks, np.maximum(one_side.peaks, other.peaks), rtol=1e-9)


def test_a_ur5e_reaches_a_little_farther_than_a_ur5():
    # Flange radii of the stretched arms from their link lengths: 0.9184 and 0.9246 m.
    table = Workspace(r_max=1.0)
    ur5, ur5e = (Setup(workspace=table, arm=ArmUR(model=model)) for model in ("ur5", "ur5e"))
    for setup, flange_max in ((ur5, 0.9184), (ur5e, 0.9246)):
        beyond = flange_max + setup.arm.grip_offset + 0.001
        (violation,) = check_grip_paths(hold(beyond), setup).reasons[0]
        assert violation.name == "reach"
        assert violation.bound == pytest.approx(flange_max, abs=1e-4)
        assert check_grip_paths(hold(beyond - 0.002), setup).mask.tolist() == [True]


def test_a_turned_base_spends_its_turn_of_the_first_joints_range():
    limits = dataclasses.replace(ur_limits(), position=(1.5, *ur_limits().position[1:]))
    assert check_actions(EASY, Setup(arm=ArmUR(limits=limits))).mask.tolist() == [True]
    turned = check_actions(EASY, Setup(arm=ArmUR(limits=limits, base_yaw_deg=60.0)))
    (violation,) = turned.reasons[0]
    assert violation.name == "base position"


def test_a_batch_larger_than_a_chunk_is_checked_as_its_rows_are():
    actions = grid_actions(ActionRanges(), (7, 7, 4, 2))
    checked = check_actions(actions, SETUP)
    assert len(checked) == len(actions)
    for row in (0, 255, 256, len(actions) - 1):
        alone = check_actions(actions[row : row + 1], SETUP)
        np.testing.assert_allclose(alone.peaks[0], checked.peaks[row], rtol=1e-12)


def test_a_path_that_only_holds_its_pose_is_feasible():
    assert check_grip_paths(hold(0.6, duration=0.0), SETUP).mask.tolist() == [True]


def test_a_bad_action_is_refused():
    with pytest.raises(ActionError, match="action 1: theta1 = nan"):
        check_actions([*EASY, [np.nan, 0.5, 0.6, 0.5]], SETUP)


@pytest.mark.parametrize(("count", "v_max"), [(1, 1.5), (7, 1.5), (300, 2.5)])
def test_a_feasible_grid_has_exactly_as_many_feasible_actions_as_asked(count, v_max):
    # At 2.5 m/s many are rejected.
    setup = SETUP.with_motion(v_max=v_max)
    actions = feasible_grid(count, setup, seed=3)
    assert actions.shape == (count, ACTION_SIZE)
    assert len(np.unique(actions, axis=0)) == count
    assert np.all(check_actions(actions, setup).mask)
    assert np.all((actions[:, 0] < 0) & (actions[:, 1] > 0) & (actions[:, 3] >= actions[:, 1]))


def test_a_feasible_grid_is_the_same_for_the_same_seed_only():
    first, again, other = (feasible_grid(300, SETUP, seed=s) for s in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_actions_of_one_pace_are_a_grid_and_those_of_a_range_are_drawn_from_all_of_it():
    grid = feasible_actions(300, SETUP, feasible_ranges(SETUP), seed=3)
    np.testing.assert_array_equal(grid, feasible_grid(300, SETUP, seed=3))
    low, high = pace = (0.2, 1.25)
    actions = feasible_actions(300, SETUP, feasible_ranges(SETUP, pace=pace), seed=3)
    assert actions.shape == (300, ACTION_SIZE)
    assert np.all(check_actions(actions, SETUP).mask)
    paces = actions[:, 4]
    assert low <= paces.min() < low + 0.05
    # Few motions are feasible much faster than the paper's.
    assert 1.0 < paces.max() <= high
    again = feasible_actions(300, SETUP, feasible_ranges(SETUP, pace=pace), seed=3)
    np.testing.assert_array_equal(actions, again)


@pytest.mark.parametrize("pace", [(1.0, 1.0), (0.3, 1.1)])
def test_motions_are_found_with_reports_up_to_the_last_and_kept_for_the_next_call(pace):
    reports = []
    find = functools.partial(
        feasible_actions, 290, SETUP, feasible_ranges(SETUP, pace=pace), seed=9
    )
    first = find(progress=reports.append)
    assert reports[-1].done == reports[-1].total
    assert len(reports) > 1
    reports.clear()
    np.testing.assert_array_equal(find(progress=reports.append), first)
    assert reports == []


def test_a_feasible_grid_without_wrist_turns_is_a_grid_of_the_action_set_a1():
    actions = feasible_grid(100, SETUP, ActionRanges(wrist=(0.0, 0.0)))
    np.testing.assert_array_equal(actions[:, 3], actions[:, 1])


def test_a_feasible_grid_that_cannot_be_is_refused_with_the_cause():
    with pytest.raises(
        InputError, match=r"r2 from 1.50 to 2.00 m .*: 100 % break its reach, such as reach: radius"
    ):
        feasible_grid(10, SETUP, ActionRanges(r2=(1.5, 2.0)))
    with pytest.raises(InputError, match="count = 0"):
        feasible_grid(0, SETUP)


def test_uniform_actions_are_refused_where_the_arm_can_make_none():
    ranges = ActionRanges(theta1=(-1.4, -1.3), theta2=(1.3, 1.4), r2=(4.0, 4.5))
    with pytest.raises(InputError, match="none of"):
        feasible_uniform(3, SETUP, ranges)
    with pytest.raises(InputError, match="count = 0"):
        feasible_uniform(0, SETUP)


LABS = {
    "paper": Setup(),
    "far origin": Setup(motion=MotionConfig(r0=2.0)),
    "near gripper": Setup(
        workspace=Workspace(table_width=1.6, table_depth=1.2, reset_y=0.28, support_depth=0.1)
    ),
    "fast": Setup(motion=MotionConfig(v_max=1.8)),
}


@pytest.mark.parametrize("lab", LABS)
def test_the_ranges_hold_what_the_arm_can_do_and_little_else(lab):
    setup = LABS[lab]
    ranges = feasible_ranges(setup)
    rng = np.random.default_rng(0)
    box = np.array([ranges.theta1, ranges.theta2, ranges.r2, ranges.wrist])
    actions = uniform_actions(ranges, 400, rng)
    assert check_actions(actions, setup).mask.mean() > 0.2
    # Of the motions of a wider box that the arm can follow above the table, nearly all lie within.
    behind = setup.motion.r0 - setup.workspace.reset_y
    wide = np.radians([[-90, -1], [1, 90], [0, 0], [0, 90]])
    wide[2] = (0.35 + max(behind, 0.0), 0.94 + abs(behind))
    actions = rng.uniform(wide[:, 0], wide[:, 1], (2000, 4))
    actions[:, 3] += actions[:, 1]
    actions = actions[check_actions(actions, setup).mask]
    actions[:, 3] -= actions[:, 1]
    slack = 0.02 * np.ptp(box, axis=1)
    inside = (actions >= box[:, 0] - slack) & (actions <= box[:, 1] + slack)
    assert inside.all(axis=1).mean() > 0.8


def test_an_arm_that_can_follow_nothing_says_which_limit_forbids_it():
    limits = dataclasses.replace(SETUP.arm.limits, velocity=(0.05,) * 6)
    slow = ArmUR(limits=limits)
    with pytest.raises(InputError, match=r"reset_y = 0.6 m, r0 = 0.6 m .* % break its .* velocity"):
        feasible_ranges(Setup(arm=slow))
