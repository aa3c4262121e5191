import dataclasses

import numpy as np
import pytest

from cablecast.arm.ur import ArmUR
from cablecast.errors import InputError
from cablecast.motion.joint_move import JointMoves, Stick, grip_path_of_joints, knot_times

START = tuple(np.radians([0.0, -70.0, 150.0, -170.0, -90.0, 0.0]).tolist())
MOVES = JointMoves(
    arm=ArmUR(model="ur5"),
    stick=Stick(length=0.5),
    start=START,
    joints=(2, 3),
    low=(1.0, *np.radians([-60.0, 60.0])),
    high=(3.0, *np.radians([-180.0, -120.0])),
)
UNIT = np.array([[0.0, 0.5, 0.1], [0.7, 0.2, 0.9], [1.0, 1.0, 0.5]])
# Rounding of a sum of a few angles.
ROUNDING = 1e-9
# A cubic spline through samples every 10 ms, where the acceleration jumps at the ends of ramps.
SPLINE_TOLERANCE = 2e-4


def test_a_move_starts_at_rest_and_ends_at_rest_where_it_should():
    end = float(MOVES.duration(UNIT).max()) + 0.1
    q, qd = MOVES.angles(UNIT, [0.0, end])
    np.testing.assert_allclose(q[:, 0], np.tile(START, (3, 1)))
    turned = q[:, 1] - q[:, 0]
    np.testing.assert_allclose(turned[:, [2, 3]], MOVES.values(UNIT)[:, 1:], atol=ROUNDING)
    np.testing.assert_allclose(turned[:, [0, 1, 4, 5]], 0.0)
    np.testing.assert_allclose(qd, 0.0, atol=ROUNDING)


def test_the_joint_that_moves_most_has_the_speed_of_the_move():
    times = np.arange(0.0, 4.0, 1e-3)
    _, qd = MOVES.angles(UNIT, times)
    np.testing.assert_allclose(np.abs(qd).max(axis=(1, 2)), MOVES.values(UNIT)[:, 0])


def test_rates_are_the_derivatives_of_angles():
    times = np.arange(0.0, 4.0, 1e-3)
    q, qd = MOVES.angles(UNIT, times)
    # The middle of a step, for an acceleration of 30 rad/s² that jumps within it.
    slope, middle = np.diff(q, axis=1) / 1e-3, 0.5 * (qd[:, 1:] + qd[:, :-1])
    np.testing.assert_allclose(slope, middle, atol=30.0 * 1e-3)


def test_a_grip_path_follows_the_end_of_the_stick_and_its_direction():
    path = MOVES.grip_path(UNIT, 2.0)
    times = np.arange(0.0, 2.0, 3e-3)
    flange = MOVES.arm.frames(MOVES.angles(UNIT, times)[0])[-1]
    pose = path.evaluate(times)
    root = flange[..., :3, 3] + 0.5 * flange[..., :3, 2]
    np.testing.assert_allclose(pose[..., :3], root, atol=SPLINE_TOLERANCE)
    yaw, pitch = pose[..., 3], pose[..., 4]
    along = np.stack(
        [np.sin(yaw) * np.cos(pitch), np.cos(yaw) * np.cos(pitch), np.sin(pitch)], axis=-1
    )
    np.testing.assert_allclose(along, flange[..., :3, 2], atol=SPLINE_TOLERANCE)


def test_a_swing_in_a_plane_keeps_its_yaw_and_passes_straight_up_without_a_jump():
    times = knot_times(2.0)
    q = np.tile(START, (1, len(times), 1))
    q[0, :, 3] -= np.linspace(0.0, 1.5 * np.pi, len(times))
    pose = grip_path_of_joints(times, q, MOVES.arm, MOVES.stick).evaluate(times)[0]
    assert np.ptp(pose[:, 3]) < SPLINE_TOLERANCE
    assert np.abs(np.diff(pose[:, 4])).max() < 0.03
    assert np.ptp(pose[:, 4]) == pytest.approx(1.5 * np.pi, abs=SPLINE_TOLERANCE)


def test_a_turn_of_the_last_joint_turns_the_grip_about_the_cable():
    times = knot_times(1.0)
    q = np.tile(START, (1, len(times), 1))
    q[0, :, 5] += np.linspace(0.0, 1.2, len(times))
    path = grip_path_of_joints(times, q, MOVES.arm, MOVES.stick)
    assert path.roll is not None
    assert path.roll[0, -1, 0] == pytest.approx(1.2 * (1 - 1 / (len(times) - 1)), abs=1e-6)


def test_moves_beyond_the_limits_of_the_arm_are_not_feasible():
    slow = dataclasses.replace(MOVES, ramp_time=0.3)
    assert slow.feasible([[0.0, 0.0, 0.6]])[0]
    peaks = MOVES.violations([[1.0, 0.0, 0.6]])
    assert {peak.joint for peak in peaks} == {2}
    assert not MOVES.feasible([[1.0, 0.0, 0.6]])[0]


def test_bad_moves_are_refused_in_words():
    with pytest.raises(InputError, match="has 5 angles, ur5 6 joints"):
        dataclasses.replace(MOVES, start=START[:5])
    with pytest.raises(InputError, match="must be some of 0 to 5"):
        dataclasses.replace(MOVES, joints=(2, 6))
    with pytest.raises(InputError, match="a speed and 2 turns"):
        dataclasses.replace(MOVES, low=(1.0, 0.0))
