import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cablecast.motion.action import ActionRanges, grid_actions, mirror_actions
from cablecast.motion.casting import cast_grip_paths, plan_sweeps
from cablecast.motion.feasibility import feasible_ranges, uniform_actions
from cablecast.setup import MotionConfig, Setup

SETUP = Setup()
CONFIG, WORKSPACE = SETUP.motion, SETUP.workspace
# What the grip path promises of its distance to the polar path [m]: a hundredth of the width of
# the thinnest cable, far below what a robot can follow.
PATH_ERROR = 1e-6
# Double precision over the few dozen operations of a profile and a polynomial.
EXACT = 1e-9
# The velocity of a quintic piece errs by about its path error over a tenth of its length [m/s].
SPEED_ERROR = 2e-4

CONFIGS = [
    CONFIG,
    MotionConfig(v_max=0.5),
    MotionConfig(v_max=2.5),
    MotionConfig(r0=2.0),
    MotionConfig(jerk=15.0),
    MotionConfig(jerk=250.0),
]


def dense_times(paths, count=1500):
    return np.linspace(0.0, 1.0, count) * paths.duration[:, None]


def random_actions(count, seed, config=CONFIG):
    ranges = feasible_ranges(Setup(motion=config))
    return uniform_actions(ranges, count, np.random.default_rng(seed))


@pytest.mark.parametrize("config", CONFIGS, ids=str)
def test_the_grip_path_follows_the_exact_polar_path(config):
    actions = np.concatenate(
        [
            grid_actions(feasible_ranges(Setup(motion=config)), (3, 3, 3, 2)),
            random_actions(20, 0, config),
        ]
    )
    polar = plan_sweeps(actions, Setup(motion=config))
    grip = cast_grip_paths(actions, Setup(motion=config))
    times = dense_times(polar)
    (xy, velocity, *_), _ = polar.motion(times)
    yaw = polar.angles(times)[1][0]
    poses, rates = grip.evaluate(times), grip.evaluate(times, 1)
    assert np.max(np.linalg.norm(poses[..., :2] - xy, axis=-1)) < PATH_ERROR
    # Yaw is itself a polynomial on every piece.
    np.testing.assert_allclose(poses[..., 3], yaw, atol=EXACT)
    assert np.max(np.abs(rates[..., :2] - velocity)) < SPEED_ERROR
    np.testing.assert_array_equal(poses[..., 2], WORKSPACE.grip_height)
    np.testing.assert_array_equal(poses[..., 4], 0.0)


@pytest.mark.parametrize("pace", [0.2, 0.7, 1.25])
def test_another_pace_goes_along_the_same_path_and_takes_as_much_longer(pace):
    actions = random_actions(20, 5)
    paced = np.column_stack([actions[:, :4], np.full(len(actions), pace)])
    usual, other = cast_grip_paths(actions, SETUP), cast_grip_paths(paced, SETUP)
    np.testing.assert_allclose(other.duration * pace, usual.duration, rtol=EXACT)
    poses, others = (grip.evaluate(dense_times(grip)) for grip in (usual, other))
    # Both follow the same polar path to within the promise.
    np.testing.assert_allclose(others[..., :2], poses[..., :2], atol=2.0 * PATH_ERROR)
    np.testing.assert_allclose(others[..., 2:], poses[..., 2:], atol=EXACT)


def test_few_pieces_are_needed():
    grip = cast_grip_paths(grid_actions(ActionRanges(), (6, 6, 4, 4)), SETUP)
    assert grip.coefficients.shape[1] <= 30


def test_a_cast_begins_at_rest_at_the_reset_position():
    grip = cast_grip_paths(random_actions(10, 1), SETUP)
    start = np.tile([0.0, WORKSPACE.reset_y, WORKSPACE.grip_height, 0.0, 0.0], (10, 1))
    np.testing.assert_allclose(grip.evaluate([0.0])[:, 0], start, atol=EXACT)
    np.testing.assert_allclose(grip.evaluate([0.0], 1), 0.0, atol=EXACT)


@pytest.mark.parametrize("config", [CONFIG, MotionConfig(r0=2.0)], ids=str)
def test_a_cast_ends_at_rest_at_r2_and_theta2_with_the_cable_along_psi(config):
    actions = random_actions(10, 2, config)
    grip = cast_grip_paths(actions, Setup(motion=config))
    theta2, r2, psi = actions[:, 1], actions[:, 2], actions[:, 3]
    end = grip.evaluate(grip.duration[:, None] + [0.0, 3.0])
    for pose in (end[:, 0], end[:, 1]):
        np.testing.assert_allclose(pose[:, 0], r2 * np.sin(theta2), atol=EXACT)
        origin = WORKSPACE.reset_y - config.r0
        np.testing.assert_allclose(pose[:, 1], origin + r2 * np.cos(theta2), atol=EXACT)
        np.testing.assert_allclose(pose[:, 3], psi, atol=EXACT)
    np.testing.assert_allclose(grip.evaluate(grip.duration[:, None], 1), 0.0, atol=1e-8)


def test_the_arc_rests_at_theta1_and_turns_there():
    actions = random_actions(20, 3)
    polar = plan_sweeps(actions, SETUP)
    turn = polar.first.duration[:, None]
    (theta, rate, acceleration), _ = polar.angles(turn + np.array([-1e-9, 0.0, 1e-9]))
    np.testing.assert_allclose(theta, actions[:, :1].repeat(3, axis=1), atol=EXACT)
    # A nanosecond away the jerk of 100 rad/s³ has made 1e-7 rad/s² at most.
    np.testing.assert_allclose(rate, 0.0, atol=EXACT)
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-6)
    (_, before, _), _ = polar.angles(turn - 0.05)
    (_, after, _), _ = polar.angles(turn + 0.05)
    assert np.all(before < 0)
    assert np.all(after > 0)


def test_the_radius_keeps_moving_through_the_turn():
    actions = random_actions(20, 4)
    polar = plan_sweeps(actions, SETUP)
    _, rate, *_ = polar.radius(polar.first.duration[:, None])
    assert np.all(np.sign(rate[:, 0]) == np.sign(actions[:, 2] - CONFIG.r0))


def test_the_wrist_turns_during_the_second_arc_only():
    actions = random_actions(20, 5)
    polar = plan_sweeps(actions, SETUP)
    first = np.linspace(0.0, 1.0, 30) * polar.first.duration[:, None]
    theta, yaw = polar.angles(first)
    np.testing.assert_array_equal(theta[0], yaw[0])
    (theta, _, _), (yaw, _, _) = polar.angles(polar.duration[:, None])
    np.testing.assert_allclose(yaw - theta, (actions[:, 3] - actions[:, 1])[:, None], atol=EXACT)


def test_a_wrist_that_needs_longer_than_the_arc_ends_the_motion():
    actions = np.array([[-0.1, 0.1, 0.6, 0.1], [-0.1, 0.1, 0.6, 1.7]])
    polar = plan_sweeps(actions, SETUP)
    np.testing.assert_allclose(polar.arc_duration, polar.arc_duration[0])
    assert polar.duration[0] == polar.arc_duration[0]
    assert polar.duration[1] > polar.arc_duration[1] + 0.1


@settings(max_examples=60, deadline=None)
@given(
    theta1=st.floats(-2.0, -0.01),
    theta2=st.floats(0.01, 2.0),
    r2=st.floats(0.1, 2.4),
    wrist=st.floats(0.0, 1.0),
    v_max=st.floats(0.3, 3.0),
    r0=st.floats(0.3, 2.0),
    jerk=st.floats(5.0, 300.0),
)
def test_the_speed_of_the_grip_never_exceeds_v_max(theta1, theta2, r2, wrist, v_max, r0, jerk):
    config = MotionConfig(v_max=v_max, r0=r0, jerk=jerk)
    action = np.array([[theta1, theta2, r2, theta2 + wrist]])
    polar = plan_sweeps(action, Setup(motion=config))
    speed = np.linalg.norm(polar.motion(dense_times(polar, 400))[0][1], axis=-1)
    assert np.max(speed) <= v_max * (1 + EXACT)


def test_a_long_arc_at_constant_radius_runs_at_v_max():
    polar = plan_sweeps([[-1.2, 1.2, CONFIG.r0, 1.2]], SETUP)
    speed = np.linalg.norm(polar.motion(dense_times(polar))[0][1], axis=-1)
    assert np.max(speed) == pytest.approx(CONFIG.v_max, rel=EXACT)


def test_mirrored_actions_make_mirrored_grip_paths_to_the_last_bit():
    actions = random_actions(50, 6)
    right = cast_grip_paths(actions, SETUP).mirrored()
    left = cast_grip_paths(mirror_actions(actions), SETUP)
    np.testing.assert_array_equal(left.knots, right.knots)
    np.testing.assert_array_equal(left.coefficients, right.coefficients)


def test_a_batch_is_the_same_as_its_rows_one_by_one():
    # More rows than are converted at a time.
    actions = random_actions(2100, 7)
    batch = cast_grip_paths(actions, SETUP)
    for row in (0, 1, 2047, 2048, 2099):
        alone = cast_grip_paths(actions[row : row + 1], SETUP)
        times = np.linspace(0.0, alone.duration[0] + 0.5, 40)
        np.testing.assert_array_equal(batch[row].evaluate(times), alone.evaluate(times))
