import numpy as np
import pytest

from cablecast.errors import IKError, InputError
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.grip_path import GripPath
from cablecast.motion.trajectory import JointPath, joint_path
from cablecast.setup import Setup

SETUP = Setup()
CONTROL_DT = SETUP.motion.control_dt
ACTIONS = np.array([[-1.0, 0.8, 0.7, 1.2], [-0.2, 1.3, 0.36, 2.8], [-1.3, 0.1, 0.8, 0.1]])


def cast(row):
    return cast_grip_paths(ACTIONS[row : row + 1], SETUP)


@pytest.mark.parametrize("row", range(len(ACTIONS)))
def test_the_gripper_is_on_its_path_at_every_tick(row):
    path = joint_path(cast(row), SETUP)
    reached = SETUP.arm.grip_pose(path.q)
    # Two closed forms in double precision.
    np.testing.assert_allclose(reached, cast(row).evaluate(path.times)[0], atol=1e-10)


@pytest.mark.parametrize("row", range(len(ACTIONS)))
def test_angles_follow_from_their_rates_without_jumps(row):
    path = joint_path(cast(row), SETUP)
    # The trapezoidal rule errs by dt³ / 12 times the jerk of a joint, below 2,000 rad/s³.
    step = CONTROL_DT * (path.qd[1:] + path.qd[:-1]) / 2
    np.testing.assert_allclose(np.diff(path.q, axis=0), step, atol=1e-4)


def test_ticks_are_a_control_cycle_apart_and_cover_the_motion():
    path = joint_path(cast(0), SETUP)
    np.testing.assert_allclose(np.diff(path.times), 1 / 125)
    duration = cast(0).duration[0]
    assert path.times[0] == 0.0
    assert path.times[-2] < duration <= path.times[-1]


def test_a_duration_of_whole_cycles_has_no_tick_more():
    grip = GripPath.hold([0.0, 0.6, 0.02, 0.0, 0.0], duration=25 * CONTROL_DT)
    assert len(joint_path(grip, SETUP).times) == 26


def test_a_joint_path_begins_and_ends_at_rest():
    path = joint_path(cast(0), SETUP)
    np.testing.assert_allclose(path.qd[[0, -1]], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("radius", "words"),
    [(0.95, r"0\.9500 m from the base: r_max is 0\.94"), (0.1, "does not reach")],
)
def test_a_path_out_of_reach_is_refused(radius, words):
    grip = GripPath.hold([0.0, radius, 0.02, 0.0, 0.0], duration=1.0)
    with pytest.raises(IKError, match=words):
        joint_path(grip, SETUP)


def test_several_grip_paths_at_once_are_refused():
    with pytest.raises(InputError, match="not from 3"):
        joint_path(cast_grip_paths(ACTIONS, SETUP), SETUP)


def test_a_joint_path_of_the_wrong_shape_is_refused():
    with pytest.raises(InputError, match="ticks require"):
        JointPath(times=np.arange(3.0), q=np.zeros((3, 6)), qd=np.zeros((2, 6)))
