import numpy as np
import pytest
from scipy.signal import lfilter

from cablecast.errors import InputError
from cablecast.motion.casting import Action
from cablecast.motion.measured import grip_path_from_joints
from cablecast.motion.trajectory import JointPath, plan_trajectory
from cablecast.setup import Setup

SETUP = Setup()
# Encoders of a UR5 resolve about 1e-5 rad; five times that at up to 0.94 m is 0.05 mm.
ENCODER_NOISE = 5e-5
# A tenth of a millimetre is a sixtieth of a per cent of the cable.
POSITION_TOLERANCE = 1e-4
YAW_TOLERANCE = 2e-4
# Of 1.5 m/s; differentiating the raw samples would be off by 5e-5 m / 8 ms = 6 mm/s at every one.
VELOCITY_TOLERANCE = 0.01
# The commanded paths have about thirty pieces; engines are as fast with as many.
PIECE_COUNT_MAX = 60
# Landings of two paths that agree to a tenth of a millimetre, in metres.
LANDING_TOLERANCE = 0.003


@pytest.fixture(scope="module", params=[(-60, 45, 0.7, 90), (-15, 70, 0.5, 70)])
def trajectory(request):
    theta1, theta2, r2, psi = request.param
    action = Action(np.radians(theta1), np.radians(theta2), r2, np.radians(psi))
    return plan_trajectory(action, SETUP)


def measured(trajectory, *, rate=125.0, noise=0.0, hold=1.0, lag=0.0, seed=0):
    """Return the joints of a motion as an arm with a lag reports them, and the true grip poses."""
    fine = np.arange(0.0, trajectory.duration + hold, 1e-3)
    arm = SETUP.arm
    q = arm.inverse(trajectory.grip_path.evaluate(fine)[0])
    if lag:
        decay = np.exp(-1e-3 / lag)
        for _ in range(2):  # Twice a first order is a critically damped second order.
            q = q[0] + lfilter([1.0 - decay], [1.0, -decay], q - q[0], axis=0)
    pick = np.round(np.arange(0.0, fine[-1], 1.0 / rate) / 1e-3).astype(int)
    times = fine[pick]
    seen = q[pick] + np.random.default_rng(seed).normal(scale=noise, size=(len(pick), 6))
    path = JointPath(times=times, q=seen, qd=np.zeros_like(seen))
    return path, fine, arm.grip_pose(q)


@pytest.mark.parametrize("lag", [0.0, 0.02])
@pytest.mark.parametrize("rate", [125.0, 500.0])
@pytest.mark.parametrize("noise", [0.0, ENCODER_NOISE])
def test_the_fit_of_noisy_joints_is_the_path_that_the_arm_moved(trajectory, rate, noise, lag):
    path, times, poses = measured(trajectory, rate=rate, noise=noise, lag=lag)
    fit = grip_path_from_joints(path, SETUP.arm)
    error = fit.evaluate(times)[0] - poses
    assert np.abs(error[:, :3]).max() < POSITION_TOLERANCE
    assert np.abs(error[:, 3:]).max() < YAW_TOLERANCE
    velocity = np.gradient(poses[:, :2], times, axis=0)
    off = np.linalg.norm(fit.evaluate(times, 1)[0][:, :2] - velocity, axis=1)
    assert np.sqrt(np.mean(off**2)) < VELOCITY_TOLERANCE
    assert fit.coefficients.shape[1] <= PIECE_COUNT_MAX


def test_the_path_starts_and_ends_at_rest_and_lasts_no_longer_than_the_motion(trajectory):
    path, *_ = measured(trajectory, noise=ENCODER_NOISE, hold=3.0)
    fit = grip_path_from_joints(path, SETUP.arm)
    ends = np.array([0.0, fit.duration[0]])
    np.testing.assert_allclose(fit.evaluate(ends, 1)[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(fit.evaluate(ends, 2)[0], 0.0, atol=1e-7)
    assert trajectory.duration <= fit.duration[0] < trajectory.duration + 0.3


def test_samples_at_uneven_times_fit_as_well(trajectory):
    path, times, poses = measured(trajectory, rate=250.0, noise=ENCODER_NOISE)
    keep = np.random.default_rng(1).random(len(path.times)) < 0.6
    keep[0] = True
    thinned = JointPath(times=path.times[keep], q=path.q[keep], qd=path.qd[keep])
    error = grip_path_from_joints(thinned, SETUP.arm).evaluate(times)[0] - poses
    # Two of five samples are missing, some of them in a row.
    assert np.abs(error[:, :3]).max() < 1.5 * POSITION_TOLERANCE


def test_a_report_that_stops_while_the_arm_moves_is_fitted_as_far_as_it_goes(trajectory):
    path, times, poses = measured(trajectory)
    half = len(path.times[path.times < trajectory.duration / 2])
    cut = JointPath(times=path.times[:half], q=path.q[:half], qd=path.qd[:half])
    inside = times <= cut.times[-1]
    error = grip_path_from_joints(cut, SETUP.arm).evaluate(times)[0] - poses
    assert np.abs(error[inside, :3]).max() < POSITION_TOLERANCE


def test_an_arm_that_keeps_still_gives_a_path_that_keeps_still():
    q = np.tile(SETUP.arm.inverse(np.array([0.0, 0.6, 0.02, 0.0, 0.0])), (50, 1))
    fit = grip_path_from_joints(
        JointPath(times=0.008 * np.arange(50), q=q, qd=np.zeros_like(q)), SETUP.arm
    )
    np.testing.assert_allclose(
        fit.evaluate(np.linspace(0, 1, 20))[0], [[0.0, 0.6, 0.02, 0.0, 0.0]] * 20, atol=1e-9
    )


def test_the_cable_lands_where_the_true_path_throws_it(trajectory):
    from cablecast.cable import load_cable
    from cablecast.engines.warp_ import EngineWarp
    from cablecast.motion.grip_path import GripPath

    cable = load_cable("cable_1")
    path, *_ = measured(trajectory, noise=ENCODER_NOISE)
    both = GripPath.stack([trajectory.grip_path, grip_path_from_joints(path, SETUP.arm)])
    rollout = EngineWarp(segment_count=20).rollout(
        cable, both, duration=float(both.duration.max()) + 3.0
    )
    true, fitted = rollout.endpoint_xy[:, -1]
    assert np.linalg.norm(true - rollout.endpoint_xy[0, 0]) > 0.3
    assert np.linalg.norm(fitted - true) < LANDING_TOLERANCE


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t, q: (t[:5], q[:5]), "5 samples"),
        (lambda t, q: (np.where(np.arange(len(t)) == 7, t[6], t), q), "ascending times, but"),
        (lambda t, q: (t, np.where(np.arange(len(t))[:, None] == 3, np.nan, q)), "finite"),
    ],
    ids=["few", "equal times", "NaN"],
)
def test_joints_that_are_no_measurement_are_refused(trajectory, change, words):
    path = trajectory.joint_path
    times, q = change(path.times, path.q)
    with pytest.raises(InputError, match=words):
        grip_path_from_joints(JointPath(times=times, q=q, qd=np.zeros_like(q)), SETUP.arm)
