"""The reset: an arm path that leaves the cable straight in front of the robot."""

import dataclasses

import numpy as np
import pytest

from cablecast.cable import CABLE_NAMES
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.action import ActionRanges
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.grip_path import GripPath
from cablecast.motion.limits import LIMIT_SHARE, check_grip_paths
from cablecast.motion.polar import (
    PolarCastConfig,
    PullReach,
    plan_reset,
    polar_config,
    reset_path,
    reset_pose,
)
from cablecast.motion.trajectory import plan_trajectory
from cablecast.setup import Setup

SETUP = Setup()
CASTS = cast_grip_paths(feasible_uniform(8, SETUP, ranges=ActionRanges()), SETUP)
ENDS = CASTS.evaluate(CASTS.duration[:, None])[:, 0]

# Shares of the cable's length. What a drag does not straighten is the slack that the swing left and
# the descent from the gripper; what it does not align is how the cable swung when it was cast.
SHORT = 0.005
ASIDE_MEDIAN = 0.02
ASIDE_LARGEST = 0.05
BOW = 0.02


@pytest.mark.parametrize("name", CABLE_NAMES)
def test_a_reset_leads_from_any_end_of_a_cast_to_the_reset_pose_within_all_limits(name):
    setup = Setup(cable=name)
    paths = [reset_path(end, setup) for end in ENDS]
    for end, path in zip(ENDS, paths, strict=True):
        poses = path.evaluate([0.0, path.duration[0]])[0]
        np.testing.assert_allclose(poses[0], end, atol=1e-9)
        np.testing.assert_allclose(poses[1], reset_pose(setup.workspace), atol=1e-9)
    assert check_grip_paths(GripPath.stack(paths), setup).mask.all()


def test_the_cable_hangs_clear_of_the_table_for_three_seconds():
    cable = SETUP.cable
    path = reset_path(ENDS[0], SETUP)
    times = np.arange(0.0, path.duration[0], 0.01)
    pose, rate = path.evaluate(times)[0], path.evaluate(times, 1)[0]
    hanging = pose[:, 2] > cable.length + cable.attachment_length
    still = np.all(np.abs(rate) < 1e-9, axis=1)
    assert np.sum(hanging & still) * 0.01 == pytest.approx(3.0, abs=0.05)


def test_the_gripper_and_the_wrist_above_it_keep_off_the_table():
    path = reset_path(ENDS[0], Setup(cable="cable_2"))
    poses = path.evaluate(np.linspace(0.0, path.duration[0], 2000))[0]
    assert np.min(poses[:, 2]) >= SETUP.workspace.grip_height - 1e-6
    # The fingers and the flange reach a quarter of a metre back along the tilted tool.
    assert np.min(poses[:, 2] + 0.25 * np.cos(poses[:, 4])) > 0.1


def test_the_joint_path_leads_the_gripper_along_the_path_without_jumps():
    trajectory = plan_reset(ENDS[1], SETUP)
    joints = trajectory.joint_path
    assert joints is not None
    assert trajectory.action is None
    steps = np.abs(np.diff(joints.q, axis=0)).max()
    assert steps <= LIMIT_SHARE * np.pi * SETUP.motion.control_dt + 1e-9
    poses = trajectory.grip_path.evaluate(joints.times)[0]
    np.testing.assert_allclose(SETUP.arm.grip_pose(joints.q), poses, atol=1e-9)


@pytest.mark.parametrize("name", CABLE_NAMES)
def test_a_simulated_reset_leaves_the_cable_straight_behind_the_grip(name):
    setup = Setup(cable=name)
    cable = setup.cable
    # The engine's cable ends at the endpoint; with the attachment it is as long as the real one.
    whole = dataclasses.replace(
        cable, length=cable.length + cable.attachment_length, attachment_length=0.0
    )
    engine = EngineWarp(segment_count=30, dt=1e-3)
    thrown = engine.rollout(whole, CASTS).final_state
    path = GripPath.stack([reset_path(end, setup) for end in ENDS])
    state = engine.rollout(whole, path, thrown).final_state
    nodes = (state.positions - state.positions[:, :1])[..., :2] / whole.length
    aside, ahead = np.abs(nodes[:, -1, 0]), nodes[:, -1, 1]
    scattered = (thrown.positions[:, -1, :2] - thrown.positions[:, 0, :2]) / whole.length
    assert np.std(scattered, axis=0).max() > 0.2, "the casts before leave it anywhere"
    assert np.all(ahead > 1.0 - SHORT - aside**2)
    assert np.median(aside) < ASIDE_MEDIAN
    assert np.max(aside) < ASIDE_LARGEST
    bow = nodes[..., 0] - nodes[:, -1:, 0] * nodes[..., 1] / nodes[:, -1:, 1]
    assert np.max(np.abs(bow)) < BOW
    # The few stiff millimetres between the grip and the table may still tremble.
    assert np.max(np.abs(state.velocities[:, -1])) < 1e-3


@pytest.mark.parametrize(
    ("model", "length"),
    [("ur5", 0.5), ("ur5e", 0.35), ("ur10e", 0.5), ("ur16e", 0.35), ("ur20", 0.5), ("ur30", 0.35)],
)
def test_every_arm_but_the_smallest_makes_the_reset_of_a_rope_and_polar_casts(model, length):
    rope = {"name": "rope", "kind": "rope", "length": length, "diameter": 0.008, "mass": 0.02}
    table = {"table_width": 2.75, "table_depth": 2.75, "table_near_y": 0.0}
    arm = {"model": model, "base_height": 0.1}
    setup = Setup.from_dict({"cable": rope, "workspace": table, "arm": arm})
    plan_reset(reset_pose(setup.workspace), setup)
    plan_trajectory(PullReach.of(setup).ahead(0.9), setup)


def test_an_arm_that_follows_the_reset_of_the_paper_keeps_it():
    assert polar_config(SETUP) == PolarCastConfig()


def test_a_wrist_too_near_to_the_base_is_named_by_its_distance():
    tilted = GripPath.hold([0.0, 0.15, 0.3, 0.0, 0.5], 1.0)
    found = check_grip_paths(tilted, SETUP)
    (reason,) = found.reasons[0]
    assert reason.what == "reach: radius"
    assert reason.value < reason.bound == pytest.approx(SETUP.arm.lengths.d4)
