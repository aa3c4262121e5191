import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cablecast.errors import InputError, JointLimitError
from cablecast.motion.action import ActionRanges
from cablecast.motion.casting import Action, cast_grip_paths
from cablecast.motion.feasibility import feasible_grid
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.setup import Setup
from cablecast.workspace import Workspace

SETUP = Setup()
# The speed of the grip path errs by this much from the polar path's [m/s], see test_cast.py.
SPEED_ERROR = 2e-4


@settings(max_examples=150, deadline=None)
@given(
    theta1=st.floats(-2.0, -0.01),
    theta2=st.floats(0.01, 1.5),
    r2=st.floats(0.15, 1.0),
    wrist=st.floats(0.0, 1.6),
    v_max=st.floats(0.5, 3.0),
    jerk=st.floats(10.0, 300.0),
    r0=st.floats(0.4, 2.0),
    mirror=st.booleans(),
)
def test_no_trajectory_ever_exceeds_a_limit(theta1, theta2, r2, wrist, v_max, jerk, r0, mirror):
    setup = SETUP.with_motion(v_max=v_max, jerk=jerk, r0=r0)
    action = Action(theta1, theta2, r2 + r0 - 0.6 if r0 > 0.6 else r2, theta2 + wrist)
    if mirror:
        action = action.mirrored()
    try:
        trajectory = plan_trajectory(action, setup)
    except JointLimitError:
        return
    path = trajectory.joint_path
    assert path is not None
    position, velocity, acceleration = SETUP.arm.limits.to_array()
    assert np.all(np.abs(path.q) <= position)
    assert np.all(np.abs(path.qd) <= velocity)
    assert np.all(np.abs(np.diff(path.q, axis=0)) <= velocity * setup.motion.control_dt)
    assert np.all(np.abs(np.diff(path.qd, axis=0)) <= acceleration * setup.motion.control_dt)
    poses, rates = (trajectory.grip_path.evaluate(path.times, order)[0] for order in (0, 1))
    assert np.max(np.hypot(rates[:, 0], rates[:, 1])) <= v_max + SPEED_ERROR
    assert np.max(np.hypot(poses[:, 0], poses[:, 1])) <= SETUP.workspace.r_max


def test_a_peak_between_the_samples_of_the_check_is_found_in_the_set_points():
    """The shoulder passes close to the base, where its acceleration peaks for a moment."""
    around = Workspace(table_near_y=-1.0, table_depth=3.0)
    setup = Setup(workspace=around).with_motion(v_max=0.5, jerk=10.0, r0=0.875)
    action = Action(-2.0, 0.84375, 0.425390625, 1.71875)
    with pytest.raises(JointLimitError, match=r"set points ask for shoulder acceleration"):
        plan_trajectory(action, setup)


def test_every_action_of_a_feasible_grid_can_be_planned_on_both_sides():
    setup = SETUP.with_motion(v_max=1.8)
    for row in feasible_grid(60, setup, seed=1):
        action = Action.from_array(row)
        for side in (action, action.mirrored()):
            assert plan_trajectory(side, setup).joint_path is not None


def test_a_trajectory_is_the_grip_path_of_its_action():
    action = Action(-0.8, 0.9, 0.7, 1.5)
    trajectory = plan_trajectory(action, SETUP)
    assert trajectory.action == action
    reference = cast_grip_paths(action.to_array()[None], SETUP)
    np.testing.assert_array_equal(trajectory.grip_path.coefficients, reference.coefficients)
    assert trajectory.duration == reference.duration[0]


def test_a_motion_that_the_arm_cannot_follow_is_refused_by_name_value_and_bound():
    fast = SETUP.with_motion(v_max=3.0)
    with pytest.raises(JointLimitError, match=r"base velocity \d\.\d+ rad/s is above 3\.079 rad/s"):
        plan_trajectory(Action(-1.2, 1.2, 0.5), fast)
    with pytest.raises(JointLimitError, match=r"reach: radius 1\.\d+ m is above"):
        plan_trajectory(Action(-1.2, 1.2, 1.2), SETUP)


def test_a_trajectory_of_several_paths_is_refused():
    grid = np.tile(Action(-0.5, 0.5, 0.6).to_array(), (2, 1))
    with pytest.raises(InputError, match="one grip path, not 2"):
        Trajectory(action=None, grip_path=cast_grip_paths(grid, SETUP), joint_path=None)


def test_casts_last_between_half_a_second_and_three():
    ranges = ActionRanges()
    slowest = Action(ranges.theta1[0], ranges.theta2[1], ranges.r2[1])
    quickest = Action(ranges.theta1[1], ranges.theta2[0], SETUP.motion.r0)
    assert plan_trajectory(slowest, SETUP).duration < 3.0
    assert plan_trajectory(quickest, SETUP).duration > 0.5
