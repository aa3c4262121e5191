"""The arm as capsules: where they are, what they hide, and what they come near."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.robot import ROBOT

from cablecast.arm.shape import (
    ArmShape,
    arm_shape,
    find_collision,
    segment_distance,
    sight_clearance,
)
from cablecast.arm.ur import ArmUR

ARM = ArmUR()


def joints_at(theta, reach, arm=ARM):
    return arm.inverse(np.array([[reach * np.sin(theta), reach * np.cos(theta), 0.02, theta, 0.0]]))


@pytest.mark.parametrize(
    "arm", [ARM, ArmUR(model="ur5e", base_height=0.1, base_yaw_deg=90.0)], ids=["ur5", "ur5e"]
)
def test_capsules_join_one_another_from_the_table_to_where_the_gripper_holds_the_cable(arm):
    q = joints_at(0.4, 0.7, arm)
    ends = arm_shape(q, arm).ends[0]
    np.testing.assert_allclose(ends[1:, 0], ends[:-1, 1], atol=1e-9)
    assert ends[0, 0, 2] == 0.0
    # The cable leaves the fingers beside their axis.
    distance = np.linalg.norm(ends[-1, 1] - arm.grip_pose(q[0])[:3])
    assert distance == pytest.approx(arm.grip_offset, abs=1e-9)


def test_a_line_of_sight_is_measured_from_a_capsule_s_surface():
    rod = np.array([[[[-1.0, 0.0, 0.5], [1.0, 0.0, 0.5]]]])
    shape = ArmShape(ends=rod, radii=np.array([0.04]))
    beside = sight_clearance(np.array([[0.0, 0.3, 0.0]]), [0.0, 0.3, 2.0], shape)
    below = sight_clearance(np.array([[0.2, 0.0, 0.0]]), [0.2, 0.0, 2.0], shape)
    past_the_end = sight_clearance(np.array([[1.5, 0.0, 0.0]]), [1.5, 0.0, 2.0], shape)
    np.testing.assert_allclose([beside[0], below[0]], [0.26, -0.04], atol=1e-12)
    np.testing.assert_allclose(past_the_end, [0.46], atol=1e-12)


@pytest.mark.parametrize(
    ("q", "words"),
    [
        ([0.0, 0.35, -0.3, 0.0, -1.5, 0.0], "from the table, less than 0.01 m"),
        ([0.0, -1.5, 2.9, 0.3, -1.5, 0.0], "m from the (base|shoulder|upper arm), less than"),
    ],
)
def test_an_arm_that_leans_onto_the_table_or_itself_is_found(q, words):
    assert find_collision(ARM, ROBOT, joints_at(0.0, 0.6)) is None
    found = find_collision(ARM, ROBOT, np.array([q]))
    assert found is not None
    assert re.search(words, found)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12))
def test_the_distance_of_segments_is_that_of_their_nearest_points(values):
    a, b, c, d = np.array(values).reshape(4, 1, 3)
    u = np.linspace(0, 1, 60)
    one, other = a + u[:, None] * (b - a), c + u[:, None] * (d - c)
    nearest = np.linalg.norm(one[:, None] - other[None], axis=-1).min()
    found = segment_distance(a, b, c, d)[0]
    # The grid of points is coarser than the segments.
    step = max(np.linalg.norm(b - a), np.linalg.norm(d - c)) / 59
    assert found <= nearest + 1e-9
    assert found >= nearest - 2 * step
