import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cablecast.arm.ur import ARM_MODELS, ArmUR
from cablecast.errors import IKError, InputError, UnknownNameError

# Both sides are closed forms in double precision, with chains of a few dozen operations.
EXACT = 1e-12
# Central differences with a step of 1e-5 s: truncation and rounding are both near 1e-8, which
# the closeness to the stretched arm magnifies.
DIFFERENCE = 2e-5

ARM = ArmUR()
# Those that the library has.
MODELS = ARM_MODELS[:6]
# Mountings that an error of sign or a swapped link length would tell apart.
ARMS = (
    ARM,
    ArmUR(base_yaw_deg=30.0),
    ArmUR(model="ur5e"),
    ArmUR(model="ur5e", base_yaw_deg=-90.0, base_height=0.1, gripper_length=0.2),
    ArmUR(model="ur10e", base_yaw_deg=90.0),
)
# Pose in our base frame of the base frame of ur-analytic-ik, whose arm points along -x.
T_OURS = np.array([[0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, ARM.base_height], [0, 0, 0, 1.0]])


def poses(radius, theta, yaw, height=0.02):
    columns = np.broadcast_arrays(radius * np.sin(theta), radius * np.cos(theta), height, yaw, 0.0)
    return np.stack(columns, axis=-1)


def turned_to(angles, reference):
    """Return the same angles, each within half a turn of a reference."""
    return reference + (angles - reference + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.parametrize("model", MODELS)
def test_forward_kinematics_equals_the_analytic_library(model):
    library = getattr(pytest.importorskip("ur_analytic_ik"), model)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (100, 6))
    reference = np.stack([T_OURS @ np.asarray(library.forward_kinematics(*row)) for row in q])
    np.testing.assert_allclose(ArmUR(model=model).forward(q), reference, atol=EXACT)


@pytest.mark.parametrize("model", MODELS)
def test_the_inverse_is_one_of_the_solutions_of_the_analytic_library(model):
    library = getattr(pytest.importorskip("ur_analytic_ik"), model)
    arm, rng = ArmUR(model=model), np.random.default_rng(1)
    reach = (arm.lengths.upper_arm + arm.lengths.forearm) / (
        ARM.lengths.upper_arm + ARM.lengths.forearm
    )
    radius = reach * rng.uniform(0.3, 0.9, 50)
    q = arm.inverse(poses(radius, rng.uniform(-1.4, 1.4, 50), 0.3))
    for row in q:
        flange = np.linalg.solve(T_OURS, arm.forward(row))
        found = [np.ravel(solution) for solution in library.inverse_kinematics(flange)]
        errors = [np.max(np.abs(turned_to(solution, row) - row)) for solution in found]
        # The library loses half the digits in its arc cosines.
        assert min(errors) < 1e-6


@settings(max_examples=60, deadline=None)
@given(
    radius=st.floats(0.175, 0.918),
    theta=st.floats(-2.0, 2.0),
    turn=st.floats(-2.0, 2.0),
    height=st.floats(0.018, 0.022),
)
def test_forward_undoes_inverse_all_over_the_table(radius, theta, turn, height):
    # The radius is the flange's, whose reach does not depend on where the cable leaves.
    pose = poses(radius, theta, theta + turn, height)
    pose[:2] += ARM.grip_offset * np.array([np.sin(theta + turn), np.cos(theta + turn)])
    back = ARM.grip_pose(ARM.inverse(pose))
    back[3] = turned_to(back[3], pose[3])
    np.testing.assert_allclose(back, pose, atol=1e-9)


@pytest.mark.parametrize("arm", ARMS, ids=str)
def test_forward_undoes_inverse_with_every_model_and_mounting(arm):
    rng = np.random.default_rng(3)
    radius, theta, turn = rng.uniform(0.3, 0.85, 200), *rng.uniform(-1.4, 1.4, (2, 200))
    pose = poses(radius, theta, theta + turn, rng.uniform(0.01, 0.1, 200))
    back = arm.grip_pose(arm.inverse(pose))
    back[:, 3] = turned_to(back[:, 3], pose[:, 3])
    np.testing.assert_allclose(back, pose, atol=1e-9)


def test_a_base_turned_to_the_right_carries_the_grip_to_the_right():
    ahead = ARM.inverse(poses(0.6, 0.0, 0.3))
    turned = ArmUR(base_yaw_deg=90.0).grip_pose(ahead)
    np.testing.assert_allclose(turned, poses(0.6, np.pi / 2, np.pi / 2 + 0.3), atol=1e-9)


def test_the_first_joint_alone_makes_up_for_a_turned_base():
    times = np.linspace(0.0, 2.0, 50)
    turned = ArmUR(base_yaw_deg=30.0).inverse(winding(times)) - ARM.inverse(winding(times))
    expected = np.tile([np.radians(30.0), 0, 0, 0, 0, 0], (50, 1))
    np.testing.assert_allclose(turned, expected, atol=EXACT)


def test_the_arm_reaches_from_a_fifth_of_a_metre_to_the_r_max_of_the_paper():
    q = ARM.inverse(poses(np.array([0.2, 0.94]), 0.0, 0.0))
    assert q[0, 2] > np.radians(150), "the elbow must be folded close to the base"
    assert q[1, 2] < np.radians(5), "the elbow must be all but straight at r_max"
    with pytest.raises(IKError, match=r"flange would be 0\.92\d\d m"):
        ARM.inverse(poses(0.95, 0.0, 0.0))
    with pytest.raises(IKError, match="does not reach"):
        ARM.inverse(poses(0.17, 0.0, 0.0))


def test_the_tool_points_down_and_the_elbow_stays_above_the_shoulder():
    q = ARM.inverse(poses(np.linspace(0.25, 0.93, 30), 0.4, 0.9))
    np.testing.assert_allclose(ARM.forward(q)[:, :3, 2], [[0, 0, -1]] * 30, atol=EXACT)
    assert np.all(q[:, 1] < 0), "the upper arm rises"
    assert np.all(q[:, 2] > 0), "the elbow bends down"


def test_the_base_joint_turns_one_to_one_with_theta_at_constant_radius():
    theta = np.linspace(-1.4, 1.4, 20)
    q = ARM.inverse(poses(0.6, theta, theta))
    np.testing.assert_allclose(np.diff(q[:, 0]), -np.diff(theta), atol=EXACT)
    np.testing.assert_allclose(q[:, 1:], np.broadcast_to(q[0, 1:], (20, 5)), atol=EXACT)


def winding(times):
    """Poses that move in radius, angle, height and yaw at once, as [step, 5]."""
    radius = 0.55 + 0.25 * np.sin(2.0 * times)
    theta, height = 0.9 * np.sin(3.0 * times), 0.05 + 0.03 * np.sin(5.0 * times)
    return poses(radius, theta, theta + 0.6 * np.sin(4.0 * times + 1.0), height)


@pytest.mark.parametrize("arm", ARMS, ids=str)
def test_rates_and_accelerations_are_the_derivatives_of_the_angles(arm):
    times, h = np.linspace(0.0, 2.0, 200), 1e-5

    def differences(function):
        before, here, after = (function(times + step) for step in (-h, 0.0, h))
        return here, (after - before) / (2 * h)

    def rate(at):
        return (winding(at + 1e-4) - winding(at - 1e-4)) / 2e-4

    def bend(at):
        return (winding(at + 1e-4) - 2 * winding(at) + winding(at - 1e-4)) / 1e-8

    motion = arm.inverse_motion(winding(times), rate(times), bend(times))
    _, qd = differences(lambda at: arm.inverse(winding(at)))
    _, qdd = differences(
        lambda at: arm.inverse_motion(winding(at), rate(at), np.zeros((len(at), 5))).qd
    )
    np.testing.assert_allclose(motion.qd, qd, atol=DIFFERENCE)
    # Second differences of poses in double precision are exact to about 1e-7 / s².
    np.testing.assert_allclose(motion.qdd, qdd, atol=50 * DIFFERENCE)


def test_joint_angles_do_not_jump_along_a_path_that_turns_far_to_both_sides():
    times = np.linspace(0.0, 4.0, 4000)
    q = ARM.inverse(winding(times))
    assert np.max(np.abs(np.diff(q, axis=0))) < 0.02, "10 rad/s at most over a step of 1 ms"


@pytest.mark.parametrize("arm", ARMS, ids=str)
def test_the_mirrored_joint_motion_is_that_of_the_mirrored_poses(arm):
    times = np.linspace(0.0, 2.0, 50)
    rng = np.random.default_rng(2)
    rates, bends = rng.uniform(-1, 1, (2, 50, 5))
    flip = np.array([-1.0, 1, 1, -1, 1])
    ours = arm.inverse_motion(winding(times), rates, bends).mirrored()
    reference = arm.inverse_motion(winding(times) * flip, rates * flip, bends * flip)
    for name in ("q", "qd", "qdd"):
        np.testing.assert_allclose(
            getattr(ours, name), getattr(reference, name), rtol=1e-9, atol=1e-9
        )


def test_a_pose_out_of_reach_is_marked_and_spoils_no_other():
    batch = poses(np.array([0.6, 1.2, 0.05, 0.7]), 0.0, 0.0)
    motion = ARM.inverse_motion(batch, np.zeros((4, 5)), np.zeros((4, 5)))
    np.testing.assert_array_equal(np.isnan(motion.q).all(axis=1), [False, True, True, False])
    np.testing.assert_array_equal(motion.q[[0, 3]], ARM.inverse(batch[[0, 3]]))


def test_an_arm_survives_the_way_through_plain_values():
    for arm in ARMS:
        assert ArmUR.from_dict(arm.to_dict()) == arm


def test_an_arm_of_an_unknown_model_is_refused_with_the_known_ones():
    with pytest.raises(UnknownNameError, match="unknown arm model 'ur40': one of ur3, ur3e, ur5"):
        ArmUR(model="ur40")
    with pytest.raises(UnknownNameError, match=r"numbers of the ur15 are not known.*URDF"):
        ArmUR(model="ur15")


def test_a_gripper_of_impossible_length_is_refused():
    with pytest.raises(InputError, match=r"gripper_length = -0\.1 m is outside"):
        ArmUR(gripper_length=-0.1)
