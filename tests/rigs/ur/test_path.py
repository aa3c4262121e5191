"""No set point that is sent leaves a limit or the box, whatever is asked for."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cablecast.arm.robot import Obstacle, RobotConfig
from cablecast.arm.ur import ArmUR
from cablecast.errors import CablecastError, InputError, JointLimitError
from cablecast.motion.action import Action
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.polar import plan_reset, reset_pose
from cablecast.motion.trajectory import plan_trajectory
from cablecast.rigs.ur.agent import BEAT_REGISTER
from cablecast.rigs.ur.program import SetPoints, check_path, joint_move, motion_program
from cablecast.rigs.ur.twin.controller import TwinLimits
from cablecast.rigs.ur.twin.urscript import Program
from cablecast.setup import Setup

DT = 0.008
# Six decimals of an angle in a program.
ROUNDING = 1e-6


@pytest.fixture(scope="module")
def robot_setup() -> Setup:
    return Setup(
        arm=ArmUR(measured=True),
        robot=RobotConfig(
            address="127.0.0.1",
            payload_mass=0.95,
            payload_cog=(0.0, 0.0, 0.06),
            box_low=(-0.97, 0.05, 0.0),
            box_high=(0.97, 0.97, 1.1),
            obstacles=(Obstacle(start=(1.3, 0.75, 0.0), end=(1.3, 0.75, 2.0), radius=0.03),),
        ),
    )


@pytest.fixture(scope="module")
def home(robot_setup):
    return robot_setup.arm.inverse(np.asarray(reset_pose(robot_setup.workspace), dtype=float))


def sent(points, setup):
    """Read back the set points of the program that would be sent."""
    beats = itertools.count()
    instant = {
        "read_input_integer_register": lambda i: next(beats) if i == BEAT_REGISTER else 0,
        "write_output_integer_register": lambda index, value: None,
    }
    program = Program(motion_program("cast", points, setup.robot, 1))
    commands = program.run(instant, {"servoj", "stopj"})
    return np.array([values[0] for name, values, _ in commands if name == "servoj"])


def assert_within(q, setup):
    """Check set points against the twin's limits and the lab file, not by check_path."""
    limits = TwinLimits(setup, DT)
    for row in q:
        assert limits.violation(row) is None
    arm, robot = setup.arm, setup.robot
    assert np.all(np.abs(q) <= np.array(arm.limits.position) - robot.position_margin)
    assert np.all(np.abs(np.diff(q, axis=0)) / DT <= np.array(arm.limits.velocity) * 1.01)
    grip = arm.grip_pose(q)[:, :3]
    assert np.all(grip >= np.array(robot.box_low) - 1e-6)
    assert np.all(grip <= np.array(robot.box_high) + 1e-6)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_no_cast_that_is_sent_exceeds_a_limit_or_leaves_the_box(robot_setup, seed):
    (values,) = feasible_uniform(1, robot_setup, seed=seed)
    points = SetPoints(plan_trajectory(Action.from_array(values), robot_setup).joint_path.q, DT)
    try:
        check_path(points, robot_setup, "cast")
    except JointLimitError:
        return
    q = sent(points, robot_setup)
    np.testing.assert_allclose(q[-len(points.q) + 1 :], points.q[1:], atol=ROUNDING)
    assert_within(q, robot_setup)


angle = st.floats(-4.0, 4.0)


@settings(max_examples=100, deadline=None)
@given(theta1=angle, theta2=angle, r2=st.floats(-1.0, 3.0), psi=angle)
def test_an_action_that_no_arm_can_make_is_never_sent(robot_setup, theta1, theta2, r2, psi):
    try:
        path = plan_trajectory(Action(theta1, theta2, r2, psi), robot_setup).joint_path
        points = SetPoints(path.q, DT)
        check_path(points, robot_setup, "cast")
    except CablecastError:
        return
    assert_within(sent(points, robot_setup), robot_setup)


@settings(max_examples=3, deadline=None)
@given(x=st.floats(-0.7, 0.7), y=st.floats(0.2, 0.9), z=st.floats(0.02, 0.3), yaw=st.floats(-1, 1))
def test_no_reset_that_is_sent_exceeds_a_limit_or_leaves_the_box(robot_setup, x, y, z, yaw):
    try:
        path = plan_reset([x, y, z, yaw, 0.0], robot_setup).joint_path
        points = SetPoints(path.q, DT)
        check_path(points, robot_setup, "reset")
    except CablecastError:
        return
    assert_within(sent(points, robot_setup), robot_setup)


@settings(max_examples=25, deadline=None)
@given(change=st.lists(st.floats(-3.5, 3.5), min_size=6, max_size=6), speed=st.floats(0.8, 6.0))
def test_no_way_in_joint_space_that_is_sent_exceeds_a_limit_or_leaves_the_box(
    robot_setup, home, change, speed
):
    try:
        points = joint_move(home, home + np.array(change), speed, DT)
        check_path(points, robot_setup, "way")
    except CablecastError:
        return
    assert_within(sent(points, robot_setup), robot_setup)


@settings(max_examples=30, deadline=None)
@given(factor=st.floats(0.1, 1.0))
def test_a_slowed_path_goes_the_same_way_no_faster(robot_setup, factor):
    path = plan_trajectory(Action(-0.7, 0.6, 0.65, 1.0), robot_setup).joint_path
    fast = SetPoints(path.q, DT)
    slow = fast.slowed(factor)
    np.testing.assert_allclose(slow.q[[0, -1]], fast.q[[0, -1]], atol=1e-9)
    peak = np.abs(np.diff(fast.q, axis=0)).max() / DT
    assert np.abs(np.diff(slow.q, axis=0)).max() / DT <= factor * peak * 1.01


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ([7.0, 0, 0, 0, 0, 0], "base at .* rad is beyond 6.233 rad"),
        ([0, 0, 0, 0, 0, 2.9], "wrist_3 turning at .* is beyond 3.145 rad/s"),
        ([2.0, 0, 0, 0, 0, 0], "outside the box"),
        ([0, 1.0, 0, 0, 0, 0], "outside the box"),
    ],
)
def test_a_path_that_is_refused_names_joint_value_and_bound(robot_setup, home, change, words):
    speed = 5.5 if "turning" in words else 1.0
    points = joint_move(home, home + np.array(change), speed, DT)
    with pytest.raises(JointLimitError, match=words):
        check_path(points, robot_setup, "the way")


def test_a_jump_is_refused_by_its_acceleration(robot_setup, home):
    q = np.repeat(home[None], 20, axis=0)
    q[10:, 0] += 0.01
    with pytest.raises(JointLimitError, match="speeding up at"):
        check_path(SetPoints(q, DT), robot_setup, "the way")


def test_an_obstacle_in_the_way_is_named(robot_setup, home):
    post = Obstacle(start=(0.0, 0.4, 0.0), end=(0.0, 0.4, 1.5), radius=0.05)
    robot = dataclasses.replace(robot_setup.robot, obstacles=(post,))
    still = SetPoints(np.repeat(home[None], 2, axis=0), DT)
    check_path(still, robot_setup, "standing")
    blocked = dataclasses.replace(robot_setup, robot=robot)
    with pytest.raises(JointLimitError, match="from obstacle 1, less than"):
        check_path(still, blocked, "standing")


def test_set_points_of_a_rate_that_no_controller_has_are_refused():
    with pytest.raises(InputError, match=r"control_dt = 0\.01 s of a robot must be one of"):
        SetPoints(np.zeros((3, 6)), 0.01)


def test_a_set_up_without_a_robot_is_refused(robot_setup, home):
    points = SetPoints(np.repeat(home[None], 2, axis=0), DT)
    with pytest.raises(InputError, match="no robot section"):
        check_path(points, dataclasses.replace(robot_setup, robot=None), "standing")
