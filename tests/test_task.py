"""What a cast is aimed at, what of its path counts, and how an outcome is distributed."""

import dataclasses

import numpy as np
import pytest
import scipy.stats

from cablecast.cable import load_cable
from cablecast.conventions import mirror_xy
from cablecast.errors import InputError, TargetError
from cablecast.motion.joint_move import JointMoves, SwingPlane
from cablecast.setup import Setup, StrikeConfig
from cablecast.task import (
    LANDING,
    MISS_MEMORY,
    MISS_WEIGHT,
    SQUARE_MAX,
    STRIKE,
    Arrival,
    Expectation,
    Goal,
    MissLaw,
    Task,
    closest,
)
from cablecast.workspace import Workspace, load_targets

SETUP = Setup(cable=load_cable("cable_1"))
DRAW_COUNT = 200_000
# Four standard deviations of the share of so many draws, and of 48 shells that stand for them.
SHARE_TOLERANCE = 0.03


class Farthest(Task):
    """The largest distance from the robot's base that the free end reaches: one number."""

    name = "farthest"
    coordinates = ("r",)
    mirror = (1.0,)

    def scale(self, setup):
        return np.array([setup.cable.length])

    def values(self, setup, value=None, **forms):
        values = np.reshape(np.asarray(value, dtype=float), (-1, 1))
        if np.any(values > setup.workspace.reach(setup.cable.length)):
            raise TargetError("out of reach")
        return values

    def outcome(self, path_xy):
        return np.linalg.norm(path_xy, axis=-1).max(axis=-1, keepdims=True)

    def lost(self, path_xy, setup):
        return np.isnan(path_xy).any(axis=(-1, -2))


class InSpace(Farthest):
    """A point in space: three numbers."""

    name = "in space"
    coordinates = ("x", "y", "z")
    mirror = (-1.0, 1.0, 1.0)

    def scale(self, setup):
        return np.full(3, setup.cable.length)


def test_a_landing_is_the_last_point_of_a_path_and_lost_off_the_table():
    path = np.array(
        [[[0.0, 0.9], [0.3, 1.1]], [[0.0, 0.9], [0.3, 1.6]], [[0.0, 0.9], [np.nan] * 2]]
    )
    np.testing.assert_array_equal(LANDING.outcome(path)[:2], [[0.3, 1.1], [0.3, 1.6]])
    np.testing.assert_array_equal(LANDING.lost(path, SETUP), [False, True, True])


def test_a_miss_is_the_distance_in_cable_lengths_and_a_hit_within_the_tolerance():
    length = SETUP.cable.length
    (goal,) = LANDING.goals(SETUP, [0.3, 1.1], within_pct=5.0)
    outcomes = goal.value + length * np.array([[0.03, 0.04], [0.0301, 0.04], [np.nan, 0.0]])
    np.testing.assert_allclose(goal.miss(outcomes)[:2], [0.05, 0.0501], rtol=2e-3)
    np.testing.assert_array_equal(goal.hit(outcomes - [1e-6, 0.0]), [True, False, False])
    assert goal.is_same([0.3, 1.1])
    assert not goal.is_same([0.3, 1.101])


def test_the_mirror_image_of_a_cast_has_the_mirrored_outcome():
    side = np.array([-1.0, 1.0])
    path = np.array([[0.1, 0.5], [0.3, 1.1]]) * np.ones((2, 1, 1))
    mirrored = mirror_xy(path, side[:, None])
    for task in (LANDING, Farthest()):
        outcome = task.outcome(path)
        np.testing.assert_array_equal(task.mirrored(outcome, side), task.outcome(mirrored))
    np.testing.assert_array_equal(LANDING.side_of(LANDING.outcome(mirrored)), side)
    np.testing.assert_array_equal(Farthest().side_of([[0.9], [-0.9]]), [1.0, 1.0])


def test_outcomes_tolerances_and_probabilities_out_of_bounds_are_refused():
    with pytest.raises(InputError, match=r"landing have shape \(3,\): it must be \[\.\.\., 2\]"):
        LANDING.miss([1.0, 2.0, 3.0], [0.0, 0.0, 0.0], SETUP)
    with pytest.raises(InputError, match="within_pct"):
        LANDING.goals(SETUP, [0.3, 1.1], within_pct=0.0)
    for probability in (0.0, 1.0, np.nan):
        with pytest.raises(InputError, match="probability"):
            MissLaw().square(probability)


def test_a_task_of_ones_own_has_goals_misses_and_hits():
    task = Farthest()
    near, far = task.goals(SETUP, [0.9, 1.2], within_pct=10.0)
    path = np.array([[0.0, 0.5], [0.6, 0.8], [0.1, 0.7]])
    assert near.miss(task.outcome(path)) == pytest.approx(0.1 / SETUP.cable.length)
    assert not far.hit(task.outcome(path))
    with pytest.raises(TargetError):
        task.goals(SETUP, [9.0])


@pytest.mark.parametrize("task", [Farthest(), LANDING, InSpace()], ids=lambda task: task.name)
@pytest.mark.parametrize("offset", [0.0, 0.05])
def test_the_chance_to_hit_is_that_of_a_t_distribution_in_any_dimension(task, offset):
    count = len(task.coordinates)
    rng = np.random.default_rng(3)
    root = 0.04 * (np.eye(count) + 0.3 * rng.normal(size=(count, count)))
    value = np.full(count, 0.9)
    goal = Goal(task=task, setup=SETUP, value=value, within_pct=8.0)
    expected = Expectation(
        mean=value + offset,
        covariance=root @ root.T,
        law=MissLaw(scale=1.3, freedom=5.0),
        scatter=0.0,
    )
    shape = expected.spread * (5.0 - 2.0) / 5.0
    draws = scipy.stats.multivariate_t(expected.mean, shape, df=5.0, seed=rng).rvs(DRAW_COUNT)
    share = np.mean(goal.hit(np.reshape(draws, (-1, count))))
    assert expected.hit_chance(goal) == pytest.approx(share, abs=SHARE_TOLERANCE)


@pytest.mark.parametrize("dimension", [1, 2, 3, 5])
@pytest.mark.parametrize("probability", [0.1, 0.5, 0.9, 0.99])
def test_the_probability_of_a_region_inverts_its_square(probability, dimension):
    law = MissLaw.after([0.3, 4.0], dimension)
    square = law.square(probability, dimension)
    assert law.probability(square, dimension) == pytest.approx(probability)


def test_the_papers_targets_can_be_asked_for_and_none_beyond_the_side_of_a_turned_table():
    np.testing.assert_array_equal(LANDING.values(SETUP, load_targets()), load_targets())
    table = Workspace(table_width=2.0, table_depth=1.2, table_yaw_deg=90.0)
    turned = dataclasses.replace(SETUP, workspace=table)
    np.testing.assert_array_equal(LANDING.values(turned, [0.5, 1.2]), [[0.5, 1.2]])
    with pytest.raises(TargetError, match=r"\|x\| <= 0\.6 m and 0 <= y <= 2 m.*x = 0\.700"):
        LANDING.values(turned, [0.7, 1.0])


def test_radians_for_degrees_are_noticed_where_nobody_types_such_degrees():
    with pytest.warns(UserWarning, match=r"theta_deg = 0\.29147 .* rad would be 16\.7 degrees"):
        LANDING.values(SETUP, r=1.1, theta_deg=np.radians(16.7))
    for typed in (0.29, 1.5, 0.0, 16.7, np.degrees(0.29)):
        LANDING.values(SETUP, r=1.1, theta_deg=typed)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({}, "either target_xy or r and theta_deg"),
        ({"value": [0.0, 1.0], "r": 1.0, "theta_deg": 0.0}, "either target_xy or r"),
        ({"value": [0.0, 1.0], "r": 1.0}, "either target_xy or r"),
        ({"r": 1.0}, "both r and theta_deg"),
        ({"theta_deg": 1.0}, "both r and theta_deg"),
        ({"r": "far", "theta_deg": 1.0}, "r = 'far' must be numbers"),
        ({"r": [1.0, 1.1], "theta_deg": [0.0, 1.0, 2.0]}, "which do not match"),
        ({"r": [[1.0]], "theta_deg": 0.0}, r"it must be \[target\]"),
        ({"value": [0.0, 1.0, 2.0]}, r"shape \(3,\): it must be \[2\] or \[target, 2\]"),
        ({"value": np.zeros((1, 1, 2))}, r"it must be \[2\] or \[target, 2\]"),
        ({"value": "there"}, "target_xy = 'there' must be numbers"),
        ({"value": 1.0}, r"it must be \[2\]"),
    ],
    ids=str,
)
def test_targets_in_another_form_are_refused(asked, words):
    with pytest.raises(InputError, match=words) as caught:
        LANDING.values(SETUP, **asked)
    assert not isinstance(caught.value, TargetError)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"r": -1.0, "theta_deg": 180.0}, "r = -1 m must not be negative"),
        ({"r": np.nan, "theta_deg": 0.0}, "r = nan m, theta = 0 deg must be finite"),
        ({"r": 1.0, "theta_deg": np.inf}, "theta = inf deg must be finite"),
        ({"r": [1.0, np.inf], "theta_deg": 0.0}, "r = inf m"),
        ({"value": [np.nan, 1.0]}, "is not finite"),
        ({"value": [0.0, np.inf]}, "is not finite"),
        (
            {"value": [1.2, 1.2]},
            r"r = 1\.697 m, theta = 45\.0 deg is out of reach: r must be at most 1\.560 m",
        ),
        ({"r": 1.7, "theta_deg": 0.0}, "out of reach"),
        ({"value": [0.0, 1.55]}, r"off the table.*y = 1\.550"),
        ({"value": [1.4, 0.1]}, r"off the table.*x = 1\.400"),
        ({"value": [0.5, -0.1]}, "off the table"),
        ({"value": [[0.2, 1.0], [0.0, 9.0]]}, "out of reach"),
    ],
    ids=str,
)
def test_targets_that_no_motion_can_reach_are_refused(asked, words):
    with pytest.raises(TargetError, match=words):
        LANDING.values(SETUP, **asked)


LAWS = [MissLaw(), MissLaw.after([0.2, 5.0]), MissLaw.after([9.0] * 30)]


@pytest.mark.parametrize("probability", [0.1, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("law", LAWS)
def test_regions_are_those_of_a_t_distribution_with_the_stated_covariance(law, probability):
    # d' S^-1 d / 2 follows Fisher's F with 2 and n degrees of freedom, and the covariance is
    # S n / (n - 2).
    scale = (law.freedom - 2.0) / law.freedom
    expected = 2.0 * scale * scipy.stats.f.ppf(probability, 2, law.freedom)
    np.testing.assert_allclose(law.square(probability), expected, rtol=1e-12)


def test_a_miss_changes_the_belief_as_bayes_rule_says():
    """A whole cast's worth of misses: the marginal of an inverse gamma belief about the factor."""
    squares = [0.3, 4.0, 1.1, 2.0]
    prior, weight = MissLaw(), MISS_WEIGHT
    freedom, total = prior.freedom, prior.freedom - 2.0
    factors = np.geomspace(1e-4, 1e4, 20001)
    density = scipy.stats.invgamma.pdf(factors, freedom / 2, scale=total / 2)
    for square in squares:
        # A miss in the plane is Gaussian given the factor.
        density *= (np.exp(-0.5 * square / factors) / factors) ** weight
    mean = np.trapezoid(factors * density, factors) / np.trapezoid(density, factors)
    law = MissLaw.after(squares)
    np.testing.assert_allclose(law.scale, mean, rtol=1e-3)
    assert law.freedom == freedom + 2.0 * weight * len(squares)


def test_only_the_last_misses_count_and_a_wild_one_no_more_than_a_bound():
    assert MissLaw.after([100.0] * 5 + [1.0] * MISS_MEMORY) == MissLaw.after([1.0] * 20)
    assert MissLaw.after([1e6]) == MissLaw.after([SQUARE_MAX])
    assert MissLaw.after([SQUARE_MAX]).scale > MissLaw.after([0.9 * SQUARE_MAX]).scale
    # Misses of a usual size change nothing but how sure the law is.
    law = MissLaw.after([2.0] * 8)
    np.testing.assert_allclose(law.scale, 1.0)
    assert law.square(0.99) < MissLaw().square(0.99)


# Of 1,536 points in the plane.
SHARE_ERROR = 0.02


def test_the_distance_that_a_share_of_casts_is_within_belongs_to_the_chance_of_a_hit():
    (goal,) = LANDING.goals(SETUP, [0.3, 1.1], within_pct=8.0)
    covariance = np.array([[4e-4, 1e-4], [1e-4, 9e-4]])
    expected = Expectation(mean=goal.value + 0.03, covariance=covariance, scatter=0.01, failure=0.2)
    for share in (0.2, 0.5, 0.9):
        distance = expected.miss_within(goal, share)
        within = dataclasses.replace(goal, within_pct=100.0 * distance)
        assert expected.hit_chance(within) / 0.8 == pytest.approx(share, abs=SHARE_ERROR)


PATH = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [np.nan] * 3, [5.0, 5.0, 5.0]])


def test_a_strike_counts_the_point_of_the_path_closest_to_its_goal():
    goal = [0.4, 0.3, 0.0]
    np.testing.assert_allclose(STRIKE.outcome_at(PATH, goal), [0.4, 0.0, 0.0])
    distance, place = closest(PATH, goal)
    assert distance == pytest.approx(0.3)
    assert place == pytest.approx(0.4)
    miss = STRIKE.goals(SETUP, goal)[0].miss(STRIKE.outcome_at(PATH, goal))
    assert miss * SETUP.cable.length == pytest.approx(0.3)


def test_a_strike_counts_nothing_after_the_path_was_cut():
    assert closest(PATH, [5.0, 5.0, 5.0])[0] == pytest.approx(np.linalg.norm([4.0, 3.0, 5.0]))
    unseen = np.full((2, 5, 3), np.nan)
    unseen[1] = PATH
    np.testing.assert_array_equal(STRIKE.lost(unseen, SETUP), [True, False])
    assert np.isnan(STRIKE.outcome_at(unseen, [0.0, 0.0, 1.0])[0]).all()
    assert closest(unseen, [0.0, 0.0, 1.0])[0][0] == np.inf


def test_an_arrival_lacks_nothing_within_its_angle_and_above_its_speed():
    goal = (1.0, 1.0, 0.0)
    np.testing.assert_allclose(STRIKE.arrival(PATH, goal, 0.5), [0.0, 4.0, 0.0])
    ways = {8.0: 0.0, 15.0: 0.5 * 0.05, 30.0: 2.0 * 0.05}
    for angle, lacks in ways.items():
        way = (np.sin(np.radians(angle)), np.cos(np.radians(angle)), 0.0)
        found = Arrival(goal=goal, direction=way, dt=0.5)(PATH)
        assert found == pytest.approx(lacks)
    slow = Arrival(goal=goal, direction=(0.0, 1.0, 0.0), dt=0.5, least_speed=8.0)
    assert slow(PATH) == pytest.approx(0.5 * 0.05)
    assert slow(np.full((3, 3), np.nan)) == 0.05


def test_a_strike_has_no_outcome_without_a_goal():
    with pytest.raises(InputError, match="depends on its goal"):
        STRIKE.outcome(PATH)
    assert LANDING.outcome_at(PATH[:, :2], [9.0, 9.0]).tolist() == [5.0, 5.0]


@pytest.mark.parametrize("goal", [[1.0], [1.0, 2.0, 3.0, 4.0], "here", None])
def test_goals_of_a_strike_are_points_in_space(goal):
    with pytest.raises(InputError, match="target_xyz"):
        STRIKE.goals(SETUP, goal)
    with pytest.raises(TargetError, match="not finite"):
        STRIKE.goals(SETUP, [0.0, np.inf, 0.0])


def test_goals_of_a_strike_are_given_by_distance_ahead_and_height():
    setup = dataclasses.replace(SETUP, strike=StrikeConfig())
    plane = SwingPlane.of(JointMoves.of(setup))
    (goal,) = STRIKE.goals(setup, [1.2, 0.9])
    np.testing.assert_allclose(goal.value[1:], [1.2, 0.9])
    np.testing.assert_allclose(plane.coordinates(goal.value), [1.2, 0.9, 0.0], atol=1e-12)
    # A base that is turned by a right angle swings along x.
    turned = dataclasses.replace(
        setup, strike=StrikeConfig(start_deg=(-90.0, *StrikeConfig().start_deg[1:]))
    )
    (goal,) = STRIKE.goals(turned, [1.2, 0.9])
    assert abs(goal.value[0]) == pytest.approx(1.2)
    with pytest.raises(InputError, match="no strike section"):
        STRIKE.goals(SETUP, [1.2, 0.9])
    crossed = dataclasses.replace(setup, strike=StrikeConfig(joints=("base", "elbow")))
    with pytest.raises(InputError, match="not level and parallel"):
        STRIKE.goals(crossed, [1.2, 0.9])
