"""An ensemble of simulators tells which casts to trust, and the aimer follows it."""

import dataclasses

import numpy as np
import pytest
from tests.aiming.formula_rig import LENGTH, SETUP, make_policy

from cablecast.aiming.predictor import Beliefs, LandingPredictor
from cablecast.aiming.propose import NEXT_NEAR, expected_loss, propose
from cablecast.conventions import mirror_xy
from cablecast.engines.dynamics import Dynamics
from cablecast.motion.action import mirror_actions, mirror_to_right
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.task import LANDING
from cablecast.tuning.landings import (
    FACTORS,
    OWN_MISS,
    SPREAD_FACTOR,
    TYPICAL_DISTANCES,
    LandingEstimate,
    estimate_landings,
    miss_factor,
    miss_sizes,
)
from cablecast.tuning.tuned import Tuned

COARSE, FINE = (12, 2e-3), (20, 1e-3)
ACTIONS = mirror_to_right(feasible_uniform(3, SETUP, seed=5))[0]


NEW = feasible_uniform(1, SETUP, seed=6)


def tracks_to(ends):
    """Return tracks of one cast in several simulators that end at some places."""
    return np.linspace([0.0, 0.5], ends, 5).swapaxes(0, 1)[:, None]


def estimate_of(tracks, friction_xy=((0.0, 1.0), (0.0, 1.0)), expected=None):
    """Return the estimate of one cast that lands somewhere with less and more friction."""
    first = tracks[0, :, -1]
    return estimate_landings(
        LENGTH * tracks,
        SETUP,
        landing_xy=LENGTH * (first if expected is None else np.array([expected])),
        friction_xy=LENGTH * np.array(friction_xy)[:, None],
    )


def predictor_of(policy, ensemble=None):
    """Return the predictor of a policy before any cast."""
    predictor = LandingPredictor.of(Beliefs(policy=policy))
    return dataclasses.replace(predictor, ensemble=ensemble)


def simulators(members, best, coarse=COARSE, fine=FINE):
    """Return simulators of cables of which nothing else is known."""
    return Tuned(
        setup=SETUP,
        dynamics=best,
        members=tuple(members),
        resolution=fine,
        member_resolution=coarse,
    )


def goal_at(xy):
    """Return the goal of a landing at a place [m]."""
    return LANDING.goals(SETUP, xy)[0]


class _Assumed:
    """An ensemble that knows casts that swing back by less than 0.5 rad, and shifts all.

    Where no model is given, casts have no landing in the best simulator.
    """

    factor = 1.0

    def __init__(self, model=None, shift=(0.0, 0.0), leaves_from=-10.0):
        self.model, self.shift, self.leaves_from = model, np.array(shift), leaves_from

    def landings(self, actions, side, task):
        spreads = np.where(actions[:, 0] > -0.5, 0.02, 0.2)
        landing_xy = np.full((len(actions), 2), np.nan)
        if self.model is not None:
            landing_xy = self.model.predict(actions) + LENGTH * self.shift
        return LandingEstimate(
            landing_xy=landing_xy,
            frictions=np.zeros(len(actions)),
            spreads=spreads,
            leaving=np.where(actions[:, 0] < self.leaves_from, 1.0, 0.0),
        )


class _Sliding(_Assumed):
    """Casts that swing back by 0.5 rad or more slide far: friction moves their landings."""

    def landings(self, actions, side, task):
        found = super().landings(actions, side, task)
        slides = np.where(actions[:, 0] > -0.5, 0.05, 2.0)
        return dataclasses.replace(found, frictions=slides, spreads=np.full(len(actions), 0.02))


@pytest.fixture(scope="module")
def policy():
    return make_policy()


@pytest.fixture
def ensemble():
    params = SETUP.cable.params
    slippery = dataclasses.replace(params, lateral_friction=0.8 * params.lateral_friction)
    members = [
        Dynamics(params=params),
        Dynamics(params=slippery),
        Dynamics(params=dataclasses.replace(params, drag_coefficient=1.1)),
    ]
    return simulators(members, members[0])


def test_expected_landing_and_spread():
    ends = tracks_to([[0.0, 1.0], [0.2, 1.0], [0.1, 1.3]])
    said = estimate_of(ends, expected=(0.05, 1.2))
    np.testing.assert_allclose(said.landing_xy, [[LENGTH * 0.05, LENGTH * 1.2]])
    # Half of the mean squared distance from (0.1, 1.1): 0.02, 0.02 and 0.04.
    np.testing.assert_allclose(said.sizes, np.hypot(OWN_MISS, SPREAD_FACTOR * np.sqrt(0.04 / 3)))


def test_simulators_are_trusted_as_they_follow_their_own_casts():
    low, high = TYPICAL_DISTANCES
    assert miss_factor(low, 5) == miss_factor(high, 5) == 1.0
    assert miss_factor(1.5 * high, 5) == pytest.approx(2.25)
    assert miss_factor(0.5 * low, 5) == pytest.approx(0.25)
    # Not for certain, however close they are, and not without end, however far.
    assert (miss_factor(0.0, 5), miss_factor(1.0, 5)) == FACTORS
    # Fewer casts than a fit has numbers to find are followed closely, whatever they are.
    assert miss_factor(0.5 * low, 2) == 1.0
    assert miss_factor(1.5 * high, 2) == pytest.approx(2.25)
    spreads = np.array([0.0, 0.1])
    np.testing.assert_allclose(miss_sizes(spreads), np.hypot(OWN_MISS, SPREAD_FACTOR * spreads))


def test_the_friction_moves_a_landing_from_less_to_more():
    here = tracks_to([[0.0, 1.0]] * 2)
    said = estimate_of(here, [(0.0, 1.04), (0.0, 1.0)])
    # From 8 % less to 8 % more.
    np.testing.assert_allclose(said.frictions, 0.04 / 0.16)
    np.testing.assert_allclose(said.sizes, OWN_MISS)
    broken = estimate_of(here, [(np.nan, np.nan), (0.0, 1.0)])
    np.testing.assert_allclose(broken.frictions, 1.0 / 0.16)


def test_a_simulation_that_broke_off_is_trusted_no_further_than_a_cable_length():
    tracks = tracks_to([[0.0, 1.0], [np.nan, np.nan], [0.0, 1.0]])
    said = estimate_of(tracks)
    np.testing.assert_allclose(said.sizes, np.hypot(OWN_MISS, SPREAD_FACTOR * np.sqrt(1.0 / 6)))
    said = estimate_of(tracks[1:2])
    assert np.all(np.isnan(said.landing_xy))
    assert np.all(np.isfinite(said.sizes))


def test_it_counts_the_simulators_in_which_the_free_end_leaves_the_table():
    tracks = tracks_to([[0.0, 1.0]] * 4)
    assert estimate_of(tracks).leaving == 0.0
    tracks[1, 0, 1] = [0.0, (SETUP.workspace.y_min - 0.01) / LENGTH]
    assert estimate_of(tracks).leaving == 0.25
    tracks[2, 0, 2] = [(SETUP.workspace.half_width + 0.01) / LENGTH, 0.5]
    assert estimate_of(tracks).leaving == 0.5


def test_what_was_simulated_once_is_not_simulated_again(ensemble, monkeypatch):
    first = ensemble.landings(ACTIONS)
    simulated = []
    tracks = Tuned.tracks

    def counted(self, actions, side, members, engine=None):
        simulated.append((engine is self.engine, len(members), len(actions)))
        return tracks(self, actions, side, members, engine)

    monkeypatch.setattr(Tuned, "tracks", counted)
    new = np.concatenate([ACTIONS[::-1], NEW, NEW])
    again = ensemble.landings(new)
    # The best; three simulators, and the first with less and more friction.
    assert sorted(simulated, key=lambda one: one[1]) == [(True, 1, 1), (False, 5, 1)]
    np.testing.assert_array_equal(again.landing_xy[:3], first.landing_xy[::-1])
    np.testing.assert_array_equal(again.sizes[:3], first.sizes[::-1])
    np.testing.assert_array_equal(again.leaving[:3], first.leaving[::-1])
    np.testing.assert_array_equal(again.landing_xy[3], again.landing_xy[4])


@pytest.mark.parametrize("target", [(0.3, 1.1), (-0.3, 1.1), (0.1, 1.2)])
def test_of_casts_to_one_place_those_are_chosen_that_friction_hardly_moves(policy, target):
    predictor = predictor_of(policy, _Sliding(policy.model))
    proposal = propose(predictor, goal_at(target))
    assert abs(proposal.action.theta1) < 0.5
    # Equal casts of the others scatter by more than a hit allows.
    wild = predictor.predict([[-0.7, 0.6, 0.55, 1.0, 1.0]])[2]
    assert proposal.expected.scatter < 0.01 * LENGTH < 0.03 * LENGTH < wild[0]


def test_where_only_wild_casts_reach_one_is_made_all_the_same():
    calm = expected_loss(np.array([0.12]), np.array([1e-4]), np.zeros(1), NEXT_NEAR)
    wild = expected_loss(np.zeros(1), np.array([0.04**2]), np.zeros(1), NEXT_NEAR)
    assert wild < calm


def test_the_expected_landing_is_that_at_full_resolution(ensemble, policy):
    first = ensemble.members[:1]
    fine = simulators(first, first[0], FINE).tracks(ACTIONS)[0, :, -1]
    said = ensemble.landings(ACTIONS)
    np.testing.assert_allclose(said.landing_xy, fine, rtol=0, atol=1e-12)
    assert np.all(said.sizes > OWN_MISS)
    # Whatever the network says of it.
    expected, _, _ = predictor_of(policy, ensemble).predict(ACTIONS)
    np.testing.assert_allclose(expected, fine, rtol=0, atol=1e-9)
    alone = simulators(first, first[0], COARSE, COARSE).landings(ACTIONS)
    np.testing.assert_allclose(alone.sizes, OWN_MISS)


def test_a_cast_without_a_landing_in_the_simulator_lands_where_the_network_says(policy):
    expected, _, _ = predictor_of(policy, _Assumed()).predict(ACTIONS)
    # The network's single precision rounds a batch otherwise than its rows.
    np.testing.assert_allclose(expected, policy.model.predict(ACTIONS), rtol=0, atol=1e-6)


def test_a_fit_that_follows_its_casts_badly_widens_what_is_stated_and_nothing_else(policy):
    close, poor = _Assumed(policy.model), _Assumed(policy.model)
    poor.factor = 2.0
    one, other = predictor_of(policy, close), predictor_of(policy, poor)
    for first, second in zip(
        one.expected(one.evaluate(ACTIONS, np.ones(len(ACTIONS))))[1:],
        other.expected(other.evaluate(ACTIONS, np.ones(len(ACTIONS))))[1:],
        strict=True,
    ):
        np.testing.assert_array_equal(first, second)
    (xy, covariance, scatter), (same, wide, equal) = one.predict(ACTIONS), other.predict(ACTIONS)
    np.testing.assert_array_equal(xy, same)
    np.testing.assert_array_equal(scatter, equal)
    # The scatter of equal casts is no wider.
    traces = [np.trace(each, axis1=1, axis2=2) - 2.0 * scatter**2 for each in (covariance, wide)]
    np.testing.assert_allclose(traces[1], 4.0 * traces[0])


def test_the_friction_moves_landings_as_two_simulators_say(ensemble):
    first = ensemble.members[0]
    friction = first.params.lateral_friction
    ends = []
    for factor in np.exp([-0.08, 0.08]):
        params = dataclasses.replace(first.params, lateral_friction=friction * factor)
        one = Dynamics(params=params)
        other = simulators([one], one)
        ends.append(other.tracks(ACTIONS)[0, :, -1])
    expected = np.linalg.norm(ends[1] - ends[0], axis=1) / LENGTH / 0.16
    np.testing.assert_allclose(ensemble.landings(ACTIONS).frictions, expected)
    assert np.all(expected > 0.1)


def test_a_curled_cable_is_simulated_on_the_side_that_it_is_cast_to():
    curled = Dynamics(params=SETUP.cable.with_params(rest_curvature=0.6 / LENGTH).params)
    ensemble = simulators([curled], curled, COARSE, COARSE)
    side = np.array([1.0, -1.0, -1.0])
    seen = ensemble.tracks(ACTIONS, side)[0, :, -1]
    paths = cast_grip_paths(mirror_actions(ACTIONS, side), SETUP)
    real = curled.rollout(ensemble.member_engine, SETUP, paths).endpoint_xy[:, -1]
    np.testing.assert_allclose(mirror_xy(seen, side), real, rtol=0, atol=1e-3)
    said = ensemble.landings(ACTIONS, side)
    np.testing.assert_allclose(said.landing_xy, seen, rtol=0, atol=1e-9)
    # What is known of one side is not taken for the other.
    other = ensemble.landings(ACTIONS, -side)
    assert np.all(np.linalg.norm(other.landing_xy - said.landing_xy, axis=1) > 1e-3 * LENGTH)


def test_the_aimer_prefers_casts_that_the_ensemble_agrees_on(policy):
    targets = np.array([[0.3, 1.1], [-0.25, 1.15], [0.5, 1.05], [-0.5, 1.1]])
    predictors = predictor_of(policy), predictor_of(policy, _Assumed())
    swings = [
        [abs(propose(one, goal_at(xy)).action.theta1) for xy in targets] for one in predictors
    ]
    assert max(swings[1]) < 0.5
    assert max(swings[0]) > 0.5


def test_casts_that_leave_the_table_in_the_ensemble_give_way_to_others(policy):
    targets = np.array([[0.3, 1.1], [-0.25, 1.15], [0.5, 1.05], [-0.5, 1.1]])
    predictor = predictor_of(policy, _Assumed(leaves_from=-0.2))
    proposals = [propose(predictor, goal_at(xy)) for xy in targets]
    assert max(abs(proposal.action.theta1) for proposal in proposals) < 0.2
    assert max(proposal.expected.failure for proposal in proposals) < 0.1


def test_the_simulated_landing_is_expected_on_both_sides(policy):
    predictor = predictor_of(policy, _Assumed(policy.model, shift=(0.05, -0.03)))
    for side in (1.0, -1.0):
        choice = propose(predictor, goal_at([side * 0.3, 1.1]))
        plain, _, _ = predictor_of(policy).predict(choice.action.to_array())
        shift = LENGTH * np.array([side * 0.05, -0.03])
        np.testing.assert_allclose(choice.expected.mean, plain[0] + shift, atol=1e-9)
        np.testing.assert_allclose(choice.expected.mean, [side * 0.3, 1.1], atol=0.02)
