"""No set point that is sent leaves a limit or the box, whatever is asked for."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.robot import ROBOT

from cablecast.arm.robot import Obstacle
from cablecast.arm.ur import ArmUR
from cablecast.errors import CablecastError, InputError, JointLimitError
from cablecast.motion.casting import Action
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.polar import plan_reset, reset_pose
from cablecast.motion.trajectory import JointPath, plan_trajectory
from cablecast.rigs.path import JointCurve, check_path, straight_move
from cablecast.rigs.ur.program import PROGRAM_SIZE_MAX, motion_program
from cablecast.rigs.ur.rtde import BEAT
from cablecast.rigs.ur.twin.controller import TwinLimits
from cablecast.rigs.ur.twin.urscript import Program
from cablecast.setup import Setup

DT = 0.008
POST = Obstacle(start=(1.3, 0.75, 0.0), end=(1.3, 0.75, 2.0), radius=0.03)
# What a person would not see: a tenth of a millimetre at the end of the arm.
DEVIATION_MAX = 1e-4
# The arithmetic of the same cubics in another order.
ROUNDING = 1e-9


@pytest.fixture(scope="module")
def robot_setup() -> Setup:
    return Setup(
        arm=ArmUR(measured=True),
        robot=dataclasses.replace(ROBOT, obstacles=(POST,)),
    )


@pytest.fixture(scope="module")
def home(robot_setup):
    return robot_setup.arm.inverse(np.asarray(reset_pose(robot_setup.workspace), dtype=float))


def standing(q):
    return JointCurve(np.array([0.0, DT]), np.stack([q, q]), np.zeros((2, 6)))


def sent(curve, setup, dt=DT):
    """Read back the set points that a controller makes of the program that would be sent."""
    beats = itertools.count()
    beat = setup.robot.input_register + BEAT
    instant = {
        "read_input_integer_register": lambda i: next(beats) if i == beat else 0,
        "write_output_integer_register": lambda index, value: None,
        "get_steptime": lambda: dt,
        "get_actual_joint_positions": lambda: curve.q[0].tolist(),
        "floor": math.floor,
    }
    program = Program(motion_program("cast", curve, setup.robot, 1))
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


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_no_cast_that_is_sent_exceeds_a_limit_or_leaves_the_box(robot_setup, seed):
    (values,) = feasible_uniform(1, robot_setup, seed=seed)
    path = plan_trajectory(Action.from_array(values), robot_setup).joint_path
    curve = JointCurve.fit(path)
    try:
        check_path(curve, robot_setup, "cast")
    except JointLimitError:
        return
    q = sent(curve, robot_setup)
    np.testing.assert_allclose(q[-len(path.q) + 1 :], path.q[1:], atol=DEVIATION_MAX)
    assert_within(q, robot_setup)


angle = st.floats(-4.0, 4.0)


@settings(max_examples=100, deadline=None)
@given(theta1=angle, theta2=angle, r2=st.floats(-1.0, 3.0), psi=angle)
def test_an_action_that_no_arm_can_make_is_never_sent(robot_setup, theta1, theta2, r2, psi):
    try:
        path = plan_trajectory(Action(theta1, theta2, r2, psi), robot_setup).joint_path
        points = JointCurve.fit(path)
        check_path(points, robot_setup, "cast")
    except CablecastError:
        return
    assert_within(sent(points, robot_setup), robot_setup)


@settings(max_examples=3, deadline=None)
@given(x=st.floats(-0.7, 0.7), y=st.floats(0.2, 0.9), z=st.floats(0.02, 0.3), yaw=st.floats(-1, 1))
def test_no_reset_that_is_sent_exceeds_a_limit_or_leaves_the_box(robot_setup, x, y, z, yaw):
    try:
        path = plan_reset([x, y, z, yaw, 0.0], robot_setup).joint_path
        points = JointCurve.fit(path)
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
        points = straight_move(home, home + np.array(change), speed)
        check_path(points, robot_setup, "way")
    except CablecastError:
        return
    assert_within(sent(points, robot_setup), robot_setup)


@pytest.mark.parametrize(
    ("kind", "control_dt"),
    [("cast", 0.008), ("cast", 0.002), ("reset", 0.008), ("rehearsal", 0.002)],
)
def test_a_program_of_any_motion_is_short_and_true_to_its_plan(robot_setup, kind, control_dt):
    setup = robot_setup.with_motion(control_dt=control_dt)
    if kind == "reset":
        path = plan_reset([-0.4, 0.6, 0.02, 0.3, 0.0], setup).joint_path
    else:
        path = plan_trajectory(Action(-0.7, 0.6, 0.65, 1.0), setup).joint_path
    curve = JointCurve.fit(path)
    slowness = 4 if kind == "rehearsal" else 1
    curve = curve.slowed(slowness)
    check_path(curve, setup, kind)
    q = sent(curve, setup, control_dt)
    hold = len(q) - round(curve.duration / control_dt)
    np.testing.assert_array_equal(q[:hold], np.repeat(curve.q[:1], hold, axis=0))
    planned = q[hold - 1 :: slowness][: len(path.q)]
    np.testing.assert_allclose(planned, path.q[: len(planned)], atol=DEVIATION_MAX)
    np.testing.assert_allclose(
        q[hold:], curve.evaluate(np.arange(1, len(q) - hold + 1) * control_dt), atol=ROUNDING
    )
    np.testing.assert_array_equal(q[-1], curve.q[-1])
    assert len(motion_program(kind, curve, setup.robot, 1)) <= PROGRAM_SIZE_MAX


def test_angles_and_rates_run_on_from_piece_to_piece(robot_setup):
    curve = JointCurve.fit(plan_reset([-0.4, 0.6, 0.02, 0.3, 0.0], robot_setup).joint_path)
    h = 1e-6
    before, at, after = (curve.evaluate(curve.times[1:-1] + dt) for dt in (-h, 0.0, h))
    # The second difference of a path whose rate jumped by 1e-4 rad/s would be 1e-10.
    np.testing.assert_allclose(after - 2 * at + before, 0.0, atol=5e-11)
    np.testing.assert_allclose(at, curve.q[1:-1], atol=1e-12)
    np.testing.assert_array_equal(curve.qd[[0, -1]], 0.0)


def test_a_path_of_too_many_pieces_is_refused_by_the_size_of_its_program(robot_setup, home):
    count = 400
    curve = JointCurve(np.arange(count) * DT, np.repeat(home[None], count, 0), np.zeros((count, 6)))
    with pytest.raises(InputError, match=r"has \d+ bytes, more than 20000"):
        motion_program("cast", curve, robot_setup.robot, 1)


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
    points = straight_move(home, home + np.array(change), speed)
    with pytest.raises(JointLimitError, match=words):
        check_path(points, robot_setup, "the way")


def test_a_jump_is_refused_by_its_acceleration(robot_setup, home):
    q = np.repeat(home[None], 20, axis=0)
    q[10:, 0] += 0.01
    jump = JointCurve(np.arange(20) * DT, q, np.zeros((20, 6)))
    with pytest.raises(JointLimitError, match="speeding up at"):
        check_path(jump, robot_setup, "the way")


def test_an_obstacle_in_the_way_is_named(robot_setup, home):
    post = Obstacle(start=(0.0, 0.4, 0.0), end=(0.0, 0.4, 1.5), radius=0.05)
    robot = dataclasses.replace(robot_setup.robot, obstacles=(post,))
    still = standing(home)
    check_path(still, robot_setup, "standing")
    blocked = dataclasses.replace(robot_setup, robot=robot)
    with pytest.raises(JointLimitError, match="from obstacle 1, less than"):
        check_path(still, blocked, "standing")


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ([0.0, 0.008, 0.016, 0.024, 1.0], "at even times"),
        ([0.0, 0.01, 0.02], r"control_dt = 0\.01 s of a robot must divide"),
    ],
)
def test_set_points_of_a_rate_that_no_controller_has_are_refused(times, words):
    q = np.zeros((len(times), 6))
    with pytest.raises(InputError, match=words):
        JointCurve.fit(JointPath(times=np.array(times), q=q, qd=q))


def test_a_set_up_without_a_robot_is_refused(robot_setup, home):
    points = standing(home)
    with pytest.raises(InputError, match="no robot section"):
        check_path(points, dataclasses.replace(robot_setup, robot=None), "standing")
