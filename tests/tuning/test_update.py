"""A few new casts move fitted parameters, without those that they were fitted to."""

import dataclasses

import numpy as np
import pytest

from cablecast.engines.warp_ import EngineWarp
from cablecast.setup import Setup
from cablecast.tuning.ensemble import WIDENING, ParamUpdate
from cablecast.tuning.fit import FitConfig, TrackFit
from cablecast.tuning.space import Gaussian, ParamPrior, SearchSpace
from cablecast.tuning.tracks import TrackObjective
from cablecast.tuning.tune import fit_params

CONFIG = FitConfig(
    start_count=2,
    rough_iterations=6,
    kept_start_count=1,
    coarse_iterations=1,
    fine_iterations=1,
    # The cable of the updates has no material.
    materials=(),
    ensemble_iterations=0,
    seed=1,
)
ROUNDING = 1e-12


@pytest.fixture(scope="module")
def engine():
    return EngineWarp(segment_count=10, dt=2e-3)


@pytest.fixture(scope="module")
def new(engine, cable, good):
    return TrackObjective(engine, cable, good[np.array([3])])


def updated(objective, posterior, params):
    """Return parameters after one step towards the tracks of an objective."""
    update = ParamUpdate(objective.engine, objective.cable, posterior, params)
    return update.params_after(objective.tracks)


@pytest.fixture(scope="module")
def posterior(engine, cable, few):
    return fit_params(Setup(cable=cable), few, None, (engine,) * 3, CONFIG).posterior


def slipped(params):
    """Return parameters of a cable that rubs less."""
    return dataclasses.replace(params, lateral_friction=0.9 * float(params.lateral_friction))


def test_the_step_follows_a_new_cast_more_closely(posterior, engine, cable, good):
    before = slipped(posterior.params)
    shares = []
    for number in range(3, len(good)):
        new = TrackObjective(engine, cable, good[np.array([number])])
        after = updated(new, posterior, before)
        shares.append(new.distances(after).loss[0] / new.distances(before).loss[0])
    # How far a single step leads depends on the last digits of the fit.
    assert np.median(shares) < 0.7
    assert max(shares) <= 1.0


def test_what_earlier_casts_told_surely_is_kept(posterior, new):
    before = slipped(posterior.params)
    sure = dataclasses.replace(posterior, covariance=1e-8 * posterior.covariance)
    after = updated(new, sure, before)
    np.testing.assert_allclose(after.to_array(), before.to_array(), rtol=1e-4)


def test_a_step_that_helps_nothing_is_not_taken(posterior, engine, cable, good):
    # A cast that the parameters follow exactly.
    tracks = good[np.array([3])]
    params = posterior.params
    xy, _ = TrackObjective(engine, cable, tracks).tracks_of(params)
    exact = dataclasses.replace(
        tracks, endpoint_xy=np.where(tracks.compared[..., None], xy[0, :, :-1], np.nan)
    )
    after = updated(TrackObjective(engine, cable, exact), posterior, params)
    np.testing.assert_allclose(after.to_array(), params.to_array(), rtol=1e-9)


class _Counting:
    """An engine that counts the worlds that it simulates."""

    def __init__(self, engine):
        self.engine, self.worlds = engine, 0

    def __getattr__(self, name):
        return getattr(self.engine, name)

    def rollout(self, cable, grip_path, *rest, **options):
        self.worlds += len(grip_path)
        return self.engine.rollout(cable, grip_path, *rest, **options)


def test_a_step_towards_several_casts_is_that_of_a_fit_to_them(posterior, engine, cable, good):
    three = good[np.array([3, 4, 5])]
    before = slipped(posterior.params)
    after = updated(TrackObjective(engine, cable, three), posterior, before)
    point = posterior.space.to_unit(before)
    precision = np.linalg.inv(WIDENING**2 * posterior.covariance)
    belief = Gaussian(mean=point, precision=precision)
    fit = TrackFit(TrackObjective(engine, cable, three), posterior.space, belief)
    state = fit.step(fit.start(point[None], posterior.misfit))
    # Casts that are simulated alone differ from those in a batch by rounding.
    apart = np.linalg.norm(posterior.space.to_unit(after) - state.points[0])
    assert apart < 0.01 * np.linalg.norm(state.points[0] - point)


def test_a_cast_is_simulated_once_for_all_steps_that_it_has_a_part_in(
    posterior, engine, cable, good
):
    counting = _Counting(engine)
    update = ParamUpdate(counting, cable, posterior, slipped(posterior.params))
    first = update.params_after(good[np.array([3, 4])])
    once = counting.worlds
    update.params_after(good[np.array([4, 5])])
    # One new cast in place of two, at the start and at nine parameters beside it.
    assert counting.worlds - once == once - 10
    again = update.params_after(good[np.array([3, 4])])
    np.testing.assert_array_equal(again.to_array(), first.to_array())


def test_a_belief_without_correlation_is_a_prior(cable):
    prior = ParamPrior.for_cable(cable, SearchSpace.for_cable(cable))
    same = Gaussian(mean=prior.mean, precision=np.diag(prior.deviation**-2.0))
    points = prior.draw(5, seed=2)
    np.testing.assert_allclose(same.cost(points), prior.cost(points), rtol=ROUNDING)
    for point in points:
        np.testing.assert_allclose(same.slope(point), prior.slope(point), rtol=ROUNDING)
    np.testing.assert_array_equal(same.precision, prior.precision)


def test_the_slope_of_a_correlated_belief_is_that_of_its_cost():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(10, 10))
    belief = Gaussian(mean=rng.normal(size=10), precision=root @ root.T)
    point, step = rng.normal(size=10), 1e-6
    ends = point + step * np.concatenate([np.eye(10), -np.eye(10)])
    costs = belief.cost(ends)
    slope = (costs[:10] - costs[10:]) / (2.0 * step)
    np.testing.assert_allclose(belief.slope(point), slope, rtol=1e-5, atol=1e-6)
    assert belief.cost(belief.mean[None]) == 0.0
