"""Calibration casts that tell most of a cable's parameters."""

import dataclasses

import numpy as np
import pytest

from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import check_actions, feasible_uniform
from cablecast.setup import Setup
from cablecast.tuning import informative
from cablecast.tuning.informative import informative_actions
from cablecast.tuning.space import ParamPosterior
from cablecast.tuning.spread import EDGE

SETUP = Setup()
BELIEF = ParamPosterior.before_casts(SETUP.cable)


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(informative, "_POOL_COUNT", 40)
    monkeypatch.setattr(informative, "_DRAW_COUNT", 3)


@pytest.fixture(scope="module")
def engine():
    return EngineWarp(segment_count=10, dt=2e-3)


def spread_over_draws(actions, engine, draws, row):
    """Return how far tracks spread over draws, in which one parameter alone varies [m]."""
    points = np.tile(BELIEF.mean, (draws, 1))
    points[:, row] += BELIEF.deviation[row] * np.linspace(-1.0, 1.0, draws)
    params = BELIEF.space.to_params(np.repeat(np.clip(points, 0.0, 1.0), len(actions), axis=0))
    paths = cast_grip_paths(actions, SETUP)[np.tile(np.arange(len(actions)), draws)]
    xy = engine.rollout(SETUP.cable, params, paths, sample_dt=0.1).endpoint_xy
    return xy.reshape(draws, len(actions), -1, 2).std(axis=0).mean(axis=(1, 2))


def test_they_can_be_made_stay_on_the_table_and_are_the_same_for_a_seed(engine):
    actions = informative_actions(SETUP, 4, engine, seed=1)
    assert check_actions(actions, SETUP).mask.all()
    assert len(np.unique(actions, axis=0)) == 4
    np.testing.assert_array_equal(actions, informative_actions(SETUP, 4, engine, seed=1))
    # The choice goes on where a smaller one ended.
    np.testing.assert_array_equal(actions[:2], informative_actions(SETUP, 2, engine, seed=1))
    xy = engine.rollout(
        SETUP.cable, SETUP.cable.params, cast_grip_paths(actions, SETUP), sample_dt=0.1
    ).endpoint_xy
    assert SETUP.workspace.edge_distance(xy).min() > EDGE


def test_the_next_cast_tells_of_what_is_left_open(engine):
    # All is known but the bending stiffness: the cast follows it more than most do.
    row = SETUP.cable.params.names().index("bend_stiffness")
    known = np.full(10, 1e-8)
    known[row] = BELIEF.deviation[row] ** 2
    belief = dataclasses.replace(BELIEF, covariance=np.diag(known))
    (action,) = informative_actions(SETUP, 1, engine, belief)
    pool = feasible_uniform(40, SETUP, seed=1000)
    others = spread_over_draws(pool, engine, 5, row)
    own = spread_over_draws(action[None], engine, 5, row)[0]
    assert own > np.median(others)


def test_more_casts_than_safe_actions_are_refused(engine, monkeypatch):
    monkeypatch.setattr(informative, "EDGE", 0.7)
    with pytest.raises(InputError, match="stay on the table for all cables"):
        informative_actions(SETUP, 5, engine)
