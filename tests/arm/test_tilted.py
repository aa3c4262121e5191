"""The arm with a gripper that tilts in the vertical plane of its cable."""

import numpy as np
import pytest

from cablecast.arm.ur import ArmUR, tilted_motion
from cablecast.errors import IKError

# Both sides are closed forms in double precision, with chains of a few dozen operations.
EXACT = 1e-9
# Central differences of angles with a step of 1e-5 s: truncation and rounding are both near 1e-8,
# which the closeness to the stretched arm magnifies.
DIFFERENCE = 5e-5

ARM = ArmUR()
ARMS = (ARM, ArmUR(base_yaw_deg=30.0), ArmUR(model="ur5e", base_yaw_deg=-90.0))


def random_poses(count=300, tilt=1.2, seed=0, arm=ARM):
    rng = np.random.default_rng(seed)
    radius, theta = rng.uniform(0.35, 0.75, count), rng.uniform(-1.2, 1.2, count)
    columns = radius * np.sin(theta), radius * np.cos(theta), rng.uniform(0.05, 0.35, count)
    yaw, pitch = theta + rng.uniform(-1, 1, count), tilt * rng.uniform(-1, 1, count)
    poses = np.stack([*columns, yaw, pitch], axis=-1)
    still = np.zeros_like(poses)
    return poses[np.isfinite(tilted_motion(arm, poses, still, still).q[:, 0])]


def swing(times):
    """Poses that move in every channel at once, tilting to both sides, shape [step, 5]."""
    radius, theta = 0.5 + 0.1 * np.sin(2.0 * times), 0.6 * np.sin(1.5 * times)
    height, pitch = 0.3 + 0.1 * np.sin(3.0 * times), 0.8 * np.sin(2.5 * times)
    yaw = theta + 0.4 * np.sin(times)
    return np.stack([radius * np.sin(theta), radius * np.cos(theta), height, yaw, pitch], axis=-1)


@pytest.mark.parametrize("arm", ARMS, ids=str)
def test_forward_undoes_inverse_for_tilted_grippers(arm):
    poses = random_poses(arm=arm)
    assert len(poses) > 200
    np.testing.assert_allclose(arm.grip_pose(arm.inverse(poses)), poses, atol=EXACT)


@pytest.mark.parametrize("arm", ARMS, ids=str)
def test_without_tilt_both_forms_are_the_same_branch(arm):
    rng = np.random.default_rng(1)
    poses = random_poses(tilt=0.0, arm=arm)
    rates, bends = rng.normal(size=(2, *poses.shape))
    rates[:, 4] = bends[:, 4] = 0.0
    closed = arm.inverse_motion(poses, rates, bends)
    general = tilted_motion(arm, poses, rates, bends)
    for name in ("q", "qd", "qdd"):
        np.testing.assert_allclose(getattr(general, name), getattr(closed, name), atol=EXACT)


@pytest.mark.parametrize("model", ["ur5", "ur5e"])
def test_the_inverse_of_a_tilted_gripper_is_a_solution_of_the_analytic_library(model):
    library, arm = getattr(pytest.importorskip("ur_analytic_ik"), model), ArmUR(model=model)
    to_ours = np.array([[0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, arm.base_height], [0, 0, 0, 1.0]])
    for row in arm.inverse(random_poses(count=60, arm=arm)):
        flange = np.linalg.solve(to_ours, arm.forward(row))
        found = [np.ravel(solution) for solution in library.inverse_kinematics(flange)]
        turns = [np.abs((f - row + np.pi) % (2 * np.pi) - np.pi).max() for f in found]
        # The library loses half the digits in its arc cosines.
        assert min(turns) < 1e-6


def test_joint_rates_and_accelerations_are_derivatives_of_the_joint_angles():
    times, h = np.linspace(0.0, 3.0, 150), 1e-5

    def rate(at):
        return (swing(at + 1e-4) - swing(at - 1e-4)) / 2e-4

    def bend(at):
        return (swing(at + 1e-4) - 2 * swing(at) + swing(at - 1e-4)) / 1e-8

    def qd(at):
        return ARM.inverse_motion(swing(at), rate(at), np.zeros((len(at), 5))).qd

    motion = ARM.inverse_motion(swing(times), rate(times), bend(times))
    angles = (ARM.inverse(swing(times + h)) - ARM.inverse(swing(times - h))) / (2 * h)
    np.testing.assert_allclose(motion.qd, angles, atol=DIFFERENCE)
    # Second differences of poses in double precision are exact to about 1e-7 / s².
    rates = (qd(times + h) - qd(times - h)) / (2 * h)
    np.testing.assert_allclose(motion.qdd, rates, atol=20 * DIFFERENCE)


def test_a_tilted_pose_out_of_reach_is_refused_by_its_wrist():
    with pytest.raises(IKError, match=r"first wrist joint would be 1\.\d+ m"):
        ARM.inverse([0.0, 1.0, 0.3, 0.0, -0.5])
