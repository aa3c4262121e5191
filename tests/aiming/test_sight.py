"""The arm hides what lies below it, and what falls off the table is not seen."""

import numpy as np
import pytest

from cablecast.aiming.propose import _unit_points, lost_chance
from cablecast.camera.settings import CameraSight
from cablecast.motion.casting import cast_grip_paths
from cablecast.setup import Setup

SETUP = Setup(cable="cable_1")
ACTIONS = np.radians([[-40.0, 40.0, 0.0, 60.0]]) + [0.0, 0.0, 0.7, 0.0]
PATH = cast_grip_paths(ACTIONS, SETUP)
GRIP_XY = PATH.evaluate(PATH.duration[:, None])[:, 0, :2]


def chance(landing_xy, deviation, sight=None):
    return lost_chance(PATH, landing_xy, np.array([deviation]), SETUP, sight)[0]


def test_a_landing_below_the_forearm_is_hidden_and_one_beyond_the_gripper_is_seen():
    assert chance(0.8 * GRIP_XY, 0.001) == 1.0
    assert chance(1.5 * GRIP_XY, 0.001) == 0.0


def test_the_less_sure_a_landing_is_the_less_surely_it_is_hidden():
    sure, vague = chance(0.8 * GRIP_XY, 0.01), chance(0.8 * GRIP_XY, 0.15)
    assert 0.05 < vague < 0.7 < sure


def test_an_arm_that_cannot_follow_hides_nothing():
    beyond = cast_grip_paths(ACTIONS + [0.0, 0.0, 0.9, 0.0], SETUP)
    assert lost_chance(beyond, GRIP_XY, np.array([0.01]), SETUP) == 0.0


def test_what_lands_where_the_camera_is_blind_is_lost_half_the_time_at_its_edge():
    spot = np.array([[-0.9, 1.1]])
    blind = CameraSight(position=(0.0, 0.7, 2.2), blind=((-0.9, 1.1, 0.3),))
    assert chance(spot, 0.02) == 0.0
    assert chance(spot, 0.02, blind) == 1.0
    assert chance(spot + [0.3, 0.0], 0.02, blind) == pytest.approx(0.5, abs=0.1)
    assert chance(spot + [0.4, 0.0], 0.02, blind) == 0.0


def test_a_camera_aside_looks_below_the_forearm_and_not_behind_it():
    below = 0.8 * GRIP_XY
    # Seen from the side of the base's first quadrant, the raised arm stands beyond the landing.
    near = CameraSight(position=(*(below[0] + [-1.0, 1.0]), 0.6))
    assert chance(below, 0.001) == 1.0
    assert chance(below, 0.001, near) == 0.0


def test_a_landing_at_an_edge_is_lost_half_the_time_and_at_a_corner_three_times_of_four():
    table = SETUP.workspace
    right, far = table.half_width, table.y_max
    # The ring of points that is cut has eight of them: one of 32 may lie on the edge itself.
    for xy, expected in [((right, 1.2), 0.5), ((0.9, far), 0.5), ((right, far), 0.75)]:
        assert chance(np.array([xy]), 0.02) == pytest.approx(expected, abs=0.1)
    assert chance(np.array([[right + 0.1, 1.2]]), 0.02) == 1.0
    assert chance(np.array([[right - 0.1, 1.2]]), 0.02) == 0.0


def test_the_points_stand_for_a_normal_distribution():
    points = _unit_points()
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)
    # The farthest ones stand for a tail that goes on without bounds.
    assert np.mean(points**2) == pytest.approx(1.0, abs=0.15)
