"""The contract of policies: how targets are asked for, and what every plan answers."""

import numpy as np
import pytest
from tests.learning.synthetic_casts import linear_model

from cablecast.conventions import xy_to_polar
from cablecast.errors import InputError, JointLimitError
from cablecast.learning.policy import ForwardSearchPolicy, Plan, PolarCastingPolicy
from cablecast.motion.action import ACTION_SIZE
from cablecast.motion.trajectory import Trajectory
from cablecast.setup import Setup

SETUP = Setup(cable="cable_2")
CLOSE = 1e-12  # Double precision on values of the order of 1.
ACTION = [-0.6, 0.5, 0.55, 0.8, 1.0]


@pytest.fixture(scope="module", params=["forward search", "polar casting"])
def policy(request):
    if request.param == "forward search":
        return ForwardSearchPolicy.build(linear_model(setup=SETUP), 500)
    return PolarCastingPolicy(setup=SETUP)


def some_plan(**changes):
    targets = np.array([[0.4, 0.9], [-0.4, 0.9]])
    values = {
        "setup": SETUP,
        "target_xy": targets,
        "actions": np.tile(ACTION, (2, 1)),
        "predicted_xy": targets,
        "inside_coverage": np.array([True, False]),
    }
    return Plan(**values | changes)


def test_every_policy_names_itself_and_its_set_up(policy, request):
    assert policy.setup == SETUP
    assert policy.info["name"] == request.node.callspec.params["policy"]


def test_every_plan_has_one_motion_with_joints_per_target(policy):
    plan = policy.plan([[0.3, 1.1], [-0.3, 1.1], [0.0, 1.2]])
    assert len(plan) == len(plan.trajectories) == 3
    for trajectory in plan.trajectories:
        assert isinstance(trajectory, Trajectory)
        assert trajectory.joint_path is not None
        assert trajectory.joint_path.q.shape[1] == 6
    assert plan.trajectories is plan.trajectories
    assert plan.setup == SETUP
    assert plan.sensitivity.shape == plan.inside_coverage.shape == (3,)


def test_polar_targets_are_the_same_as_cartesian_ones(policy):
    plan = policy.plan(r=1.10, theta_deg=16.7)
    r, theta = xy_to_polar(plan.target_xy[0])
    assert (r, np.degrees(theta)) == pytest.approx((1.10, 16.7), abs=CLOSE)
    again = policy.plan(plan.target_xy)
    np.testing.assert_array_equal(again.predicted_xy, plan.predicted_xy)
    np.testing.assert_array_equal(again.actions, plan.actions)


def test_a_positive_angle_is_to_the_robots_right(policy):
    plan = policy.plan(r=1.1, theta_deg=[20.0, -20.0])
    assert plan.target_xy[0, 0] > 0 > plan.target_xy[1, 0]
    assert plan.predicted_xy[0, 0] > 0 > plan.predicted_xy[1, 0]


def test_one_radius_goes_with_many_angles_and_many_radii_with_one_angle(policy):
    assert len(policy.plan(r=1.1, theta_deg=[0.0, 10.0, 20.0])) == 3
    assert len(policy.plan(r=np.array([1.0, 1.1]), theta_deg=5)) == 2
    np.testing.assert_allclose(
        policy.plan(r=[1.0, 1.1], theta_deg=[0.0, 90 / 4]).target_xy[0], [0.0, 1.0], atol=CLOSE
    )


def test_no_targets_get_an_empty_plan(policy):
    plan = policy.plan(np.empty((0, 2)))
    assert (len(plan), plan.trajectories) == (0, ())


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({}, "either target_xy or r and theta_deg"),
        ({"r": 1.7, "theta_deg": 0.0}, "out of reach"),
        ({"target_xy": [[0.3, 1.1], [0.0, 1.53]]}, "off the table"),
    ],
    ids=str,
)
def test_every_policy_checks_its_targets(policy, asked, words):
    with pytest.raises(InputError, match=words):
        policy.plan(**asked)


def test_a_printed_plan_has_a_line_for_each_target_with_names_and_units():
    first, second = str(some_plan()).splitlines()
    assert first == (
        "target r = 0.985 m, theta = 24.0 deg: theta1 = -34.4 deg, theta2 = 28.6 deg, "
        "r2 = 0.550 m, psi = 45.8 deg, pace = 1.00; lands at r = 0.985 m, theta = 24.0 deg"
    )
    assert second.startswith("target r = 0.985 m, theta = -24.0 deg: ")


def test_a_plan_that_gives_its_motions_needs_no_actions():
    motions = some_plan().trajectories
    plan = some_plan(actions=np.array(np.nan), motions=motions)
    assert plan.trajectories == motions
    assert plan.actions.shape == (2, ACTION_SIZE)
    assert np.isnan(plan.actions).all()


def test_an_action_that_the_arm_cannot_follow_shows_when_its_motion_is_wanted():
    plan = some_plan(actions=np.tile([-0.6, 0.5, 1.5, 0.8, 1.0], (2, 1)))
    with pytest.raises(JointLimitError, match="cannot follow"):
        _ = plan.trajectories


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"actions": np.zeros((2, 3))}, r"actions has shape \(2, 3\)"),
        ({"predicted_xy": np.zeros((3, 2))}, "predicted_xy has shape"),
        ({"inside_coverage": np.ones(3, dtype=bool)}, "inside_coverage has shape"),
        ({"sensitivity": np.zeros(5)}, "sensitivity has shape"),
        ({"actions": np.array([ACTION, [np.nan] * 5])}, "neither an action nor a motion for .* 1"),
        ({"motions": ()}, "0 motions for 2 targets"),
    ],
    ids=str,
)
def test_a_plan_whose_parts_do_not_fit_is_refused(changes, words):
    with pytest.raises(InputError, match=words):
        some_plan(**changes)
