"""The way back from wherever the arm stands, checked before anything moves."""

import dataclasses

import numpy as np
import pytest

from cablecast.arm.ur import ArmUR
from cablecast.errors import JointLimitError, RigError
from cablecast.motion.polar import reset_pose
from cablecast.rigs.arm import APPROACH_SPEED, reset_motions
from cablecast.setup import Setup


def test_a_reset_from_where_a_cast_begins_starts_there_and_ends_there(twin_setup, home):
    way, reset = reset_motions(home, twin_setup)
    np.testing.assert_allclose(way.q[-1], home, atol=1e-6)
    np.testing.assert_allclose(reset.q[-1], home, atol=1e-6)


def test_a_gripper_that_a_hand_left_askew_first_goes_slowly_to_a_place_above_the_table(
    twin_setup, home
):
    askew = home + [0.1, -0.2, 0.1, 0.1, -0.1, 0.2]
    way, reset = reset_motions(askew, twin_setup)
    np.testing.assert_allclose(way.q[0], askew, atol=1e-6)
    np.testing.assert_allclose(way.q[-1], reset.q[0], atol=1e-12)
    assert np.abs(way.qd).max() <= APPROACH_SPEED * 1.001
    assert twin_setup.arm.grip_pose(way.q[-1])[2] > 0.2
    np.testing.assert_allclose(reset.q[-1], home, atol=1e-6)


@pytest.mark.parametrize("yaw_deg", [180.02, -180.02])
def test_a_cable_that_a_cast_left_turned_by_half_a_turn_and_a_little_is_taken_back(
    twin_setup, home, yaw_deg
):
    x, yaw = np.copysign(0.5, yaw_deg), np.radians(yaw_deg)
    start = twin_setup.arm.inverse(np.array([x, 0.35, 0.02, yaw, 0.0]))
    way, reset = reset_motions(start, twin_setup)
    np.testing.assert_allclose(way.q[-1], start, atol=1e-6)
    np.testing.assert_allclose(reset.q[-1], home, atol=1e-6)


@pytest.mark.parametrize("joint", range(6))
def test_an_arm_that_is_wound_up_or_folded_otherwise_is_left_to_a_person(twin_setup, home, joint):
    folded = home.copy()
    folded[joint] += -2.0 if joint in (1, 2) else 2 * np.pi * -np.sign(home[joint] or 1.0)
    with pytest.raises(RigError, match="bring it there by hand"):
        reset_motions(folded, twin_setup)


def test_a_way_that_would_touch_something_is_refused_before_anything_moves(twin_setup, home):
    low = dataclasses.replace(twin_setup.robot, box_high=(0.97, 0.97, 0.5))
    with pytest.raises(JointLimitError, match="robot box: z of the flange"):
        reset_motions(home, dataclasses.replace(twin_setup, robot=low))


def test_a_ur10e_comes_back_from_beside_as_from_before_it(twin_setup):
    workspace = dataclasses.replace(twin_setup.workspace, r_max=1.2, reset_y=0.76)
    robot = dataclasses.replace(
        twin_setup.robot, box_low=(-1.25, 0.05, 0.0), box_high=(1.25, 1.25, 1.5)
    )
    arm = ArmUR(model="ur10e", base_height=0.126, measured=True)
    large = Setup(cable=twin_setup.cable, workspace=workspace, arm=arm, robot=robot)
    for place in (reset_pose(workspace), [0.8, 0.7, 0.02, 1.0, 0.0]):
        start = arm.inverse(np.asarray(place, dtype=float))
        _, reset = reset_motions(start, large)
        np.testing.assert_allclose(arm.grip_pose(reset.q[-1]), reset_pose(workspace), atol=1e-6)
