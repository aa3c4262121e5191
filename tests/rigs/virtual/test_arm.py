"""The arm of the virtual laboratory: late, springy, and near its limits never quite the same."""

import dataclasses

import numpy as np
import pytest

from cablecast.arm.ur import ArmUR
from cablecast.motion.casting import Action
from cablecast.motion.grip_path import GripPath
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.rigs.virtual._hidden import HiddenArm
from cablecast.rigs.virtual.arm import REPORT_DT, LiveArm, move_arm
from cablecast.rigs.virtual.config import TrialNoise
from cablecast.rigs.virtual.trials import Trial
from cablecast.setup import Setup

DT = 1e-3
SETUP = Setup()
SILENT = Trial.draw(TrialNoise.none(), 0, 0)
# A servo that follows within its torque settles on its last set point.
SETTLED = 1e-4
# Turns a base joint's amount into millimetres that the cable would not notice.
UNNOTICED = np.radians(0.03)
# As small a change as would be told apart from the measured scatter.
NOTICED = np.radians(0.3)


def cast(v_max, setup=SETUP):
    action = Action(np.radians(-50), np.radians(45), 0.6)
    return plan_trajectory(action, setup.with_motion(v_max=v_max))


def play(trajectories, trials, servos=None, arm=SETUP.arm):
    steps = round(max(t.duration for t in trajectories) / DT) + 600
    return move_arm(trajectories, trials, arm, servos or HiddenArm(), DT, steps)


def test_an_arm_that_is_told_to_stand_stands():
    workspace = SETUP.workspace
    pose = [0.0, workspace.reset_y, workspace.grip_height, 0.0, 0.0]
    hold = Trajectory(action=None, grip_path=GripPath.hold(pose, 1.0), joint_path=None)
    motion = play([hold], [SILENT])[0]
    np.testing.assert_allclose(motion.poses, np.broadcast_to(pose, motion.poses.shape))
    assert motion.joint_path is None


def test_each_joint_lags_its_set_points_and_settles_on_the_last():
    trajectory = cast(1.5)
    motion = play([trajectory], [SILENT])[0]
    report, command = motion.joint_path, trajectory.joint_path
    np.testing.assert_allclose(report.q[-1], command.q[-1], atol=5 * SETTLED)
    np.testing.assert_allclose(np.diff(report.times), REPORT_DT)
    base = np.interp(command.times, report.times, report.q[:, 0])
    lag = np.argmax([np.corrcoef(command.q[: len(base) - k, 0], base[k:])[0, 1] for k in range(20)])
    assert 0.01 < lag * REPORT_DT < 0.08


@pytest.mark.parametrize(
    "arm", [ArmUR(), ArmUR(model="ur5e", base_height=0.12, base_yaw_deg=90.0)], ids=["ur5", "ur5e"]
)
def test_the_gripper_is_where_the_joints_of_this_very_arm_are(arm):
    trajectory = cast(1.5, Setup(arm=arm))
    motion = play([trajectory], [SILENT], arm=arm)[0]
    there = motion.poses[:: round(REPORT_DT / DT)][: len(motion.joint_path.times)]
    np.testing.assert_allclose(arm.grip_pose(motion.joint_path.q), there, atol=1e-9)
    # It ends where the motion ends, whatever the arm and its mounting.
    end = trajectory.grip_path.evaluate([trajectory.duration])[0, 0]
    np.testing.assert_allclose(motion.poses[-1], end, atol=5 * SETTLED)


def test_a_gripper_that_turns_past_half_a_turn_does_not_spin_back():
    action = Action(np.radians(-50), np.radians(45), 0.6, np.radians(179.9))
    trajectory = plan_trajectory(action, SETUP)
    q = trajectory.joint_path.q.copy()
    q[:, 5] += 0.1 * (q[:, 5] - q[0, 5])
    farther = dataclasses.replace(trajectory.joint_path, q=q)
    trajectory = dataclasses.replace(trajectory, joint_path=farther)
    motion = play([trajectory], [SILENT])[0]
    assert np.abs(motion.poses[:, 3]).max() > np.pi
    assert np.abs(np.diff(motion.poses[:, 3])).max() < 0.02
    live = LiveArm(SETUP, trajectory.joint_path.q[0])
    yaw = []
    for q in trajectory.joint_path.q:
        live.command(q)
        yaw.append(live.advance(8)[-1, 3])
    assert np.abs(yaw).max() > np.pi
    assert np.abs(np.diff(yaw)).max() < 0.1


def test_a_step_of_a_set_point_is_answered_as_a_second_order_system_with_a_dead_time():
    # A path that creeps and then jumps by a milliradian within one cycle, far within the torque.
    trajectory = cast(1.2)
    path = trajectory.joint_path
    q = np.repeat(path.q[:1], 100, axis=0)
    q[10:, 5] += 1e-3
    jump = dataclasses.replace(path, times=np.arange(100) * REPORT_DT, q=q, qd=np.zeros_like(q))
    servos = HiddenArm(feedforward=0.0)
    still = Trajectory(
        action=None,
        grip_path=GripPath.hold(trajectory.grip_path.evaluate([0.0])[0, 0], 99 * REPORT_DT),
        joint_path=jump,
    )
    report = play([still], [SILENT], servos)[0].joint_path
    omega, zeta = 2 * np.pi * servos.frequency[5], servos.damping_ratio[5]
    t = np.maximum(report.times - 9.5 * REPORT_DT - servos.delay[5], 0.0)
    swing = omega * np.sqrt(1 - zeta**2)
    expected = 1 - np.exp(-zeta * omega * t) * (
        np.cos(swing * t) + zeta * omega / swing * np.sin(swing * t)
    )
    # The jump is spread over one cycle: compare where the response is slow.
    late = report.times > 10 * REPORT_DT + 0.05
    np.testing.assert_allclose((report.q[late, 5] - q[0, 5]) / 1e-3, expected[late], atol=0.02)


@pytest.mark.parametrize(("v_max", "differs"), [(1.2, False), (1.8, True)])
def test_a_weaker_motor_changes_only_motions_near_its_limit(v_max, differs):
    trajectory = cast(v_max)
    trials = [dataclasses.replace(SILENT, torque_factor=f) for f in (1.06, 0.94)]
    strong, weak = (motion.joint_path.q[:, 0] for motion in play([trajectory] * 2, trials))
    change = np.abs(strong - weak).max()
    assert change > NOTICED if differs else change < UNNOTICED


def test_late_set_points_and_other_servos_change_the_motion_a_little():
    trajectory = cast(1.5)
    for noise in (TrialNoise(latency=0.002), TrialNoise(servo=0.02)):
        quiet = dataclasses.replace(TrialNoise.none(), latency=noise.latency, servo=noise.servo)
        trials = [Trial.draw(quiet, 0, index) for index in range(2)]
        one, two = (motion.poses for motion in play([trajectory] * 2, trials))
        apart = np.linalg.norm((one - two)[:, :2], axis=1).max()
        assert 1e-5 < apart < 0.02


def test_a_trial_does_not_depend_on_the_trials_beside_it():
    slow, fast = cast(1.2), cast(1.8)
    trials = [Trial.draw(TrialNoise(), 0, index) for index in range(3)]
    steps = round(fast.duration / DT) + 600
    together = move_arm([fast, slow, fast], trials, SETUP.arm, HiddenArm(), DT, steps)
    alone = move_arm([slow], trials[1:2], SETUP.arm, HiddenArm(), DT, steps)
    np.testing.assert_array_equal(together[1].poses, alone[0].poses)
    np.testing.assert_array_equal(together[1].joint_path.q, alone[0].joint_path.q)


def test_a_gripper_without_joints_lags_and_settles_too():
    trajectory = cast(1.2)
    bare = Trajectory(action=None, grip_path=trajectory.grip_path, joint_path=None)
    poses = play([bare], [SILENT])[0].poses
    command = bare.grip_path.evaluate(np.arange(len(poses)) * DT)[0]
    assert np.abs(poses - command).max() > 0.01
    np.testing.assert_allclose(poses[-1], command[-1], atol=5 * SETTLED)
