"""Paths built from moves in a vertical plane that turns about the base."""

import numpy as np
import pytest

from cablecast.errors import InputError
from cablecast.motion.grip_path import PIECE_DURATION, PlanePath

START = [0.3, 0.5, 0.02, 0.9, 0.0]
# Quintics over a tenth of a second leave the exact curve by the sixth power of the angle turned.
TURNING = 1e-6


def whole_path():
    path = PlanePath(START).move(1.0, height=0.15).move(2.0, azimuth=0.0, radius=0.48, turn=0.0)
    path.hold(0.5).through([0.5, 0.9, 1.4], radius=[0.4, 0.7, 0.8], pitch=[-0.3, 0.4, 0.0])
    return path.grip_path()


def test_a_path_begins_where_it_is_told_and_ends_at_its_goal():
    path = whole_path()
    poses = path.evaluate([0.0, path.duration[0]])[0]
    np.testing.assert_allclose(poses[0], START, atol=1e-12)
    np.testing.assert_allclose(poses[1], [0.0, 0.8, 0.15, 0.0, 0.0], atol=1e-12)


def test_moves_begin_and_end_at_rest():
    ends = whole_path().evaluate([0.0, 1.0, 3.0, 3.5, 4.9], 1)[0]
    np.testing.assert_allclose(ends, 0.0, atol=1e-12)


def test_velocities_are_the_derivatives_of_poses():
    path, h = whole_path(), 1e-6
    times = np.linspace(h, path.duration[0] - h, 500)
    rate = (path.evaluate(times + h) - path.evaluate(times - h)) / (2 * h)
    # Central differences of poses of 1 m in double precision.
    np.testing.assert_allclose(path.evaluate(times, 1), rate, atol=1e-8)


def test_a_turning_plane_is_followed_on_its_circle():
    # The smoothest move peaks at 15/8 of its mean speed: here 2 rad/s.
    path = PlanePath([0.0, 0.6, 0.1, 0.0, 0.0]).move(15 / 16, azimuth=1.0).grip_path()
    poses = path.evaluate(np.linspace(0.0, path.duration[0], 1000))[0]
    assert np.max(np.abs(path.evaluate([path.duration[0] / 2], 1)[0, 0, 3] - 2.0)) < 1e-6
    np.testing.assert_allclose(np.hypot(poses[:, 0], poses[:, 1]), 0.6, atol=TURNING)
    np.testing.assert_allclose(np.arctan2(poses[:, 0], poses[:, 1]), poses[:, 3], atol=TURNING)


def test_a_spline_passes_its_points_at_their_times():
    path = PlanePath(START).through([0.4, 1.1], radius=[0.5, 0.7], height=[0.3, 0.1]).grip_path()
    poses = path.evaluate([0.4, 1.1])[0]
    np.testing.assert_allclose(np.hypot(*poses[:, :2].T), [0.5, 0.7], atol=1e-12)
    np.testing.assert_allclose(poses[:, 2], [0.3, 0.1], atol=1e-12)
    assert np.max(np.diff(path.knots)) <= PIECE_DURATION + 1e-12


def test_times_that_do_not_rise_and_empty_paths_are_refused():
    with pytest.raises(InputError, match=r"times \[0\.5, 0\.4\] must ascend"):
        PlanePath(START).through([0.5, 0.4], radius=[0.5, 0.6])
    with pytest.raises(InputError, match="at least one move"):
        PlanePath(START).grip_path()
