"""Calibration casts whose simulated landings are spread over the table."""

import dataclasses
import types

import numpy as np
import pytest

from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.motion.action import mirror_to_right
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import check_actions, feasible_uniform
from cablecast.setup import Setup
from cablecast.tuning.spread import EDGE, spread_actions
from cablecast.workspace import Workspace

SETUP = Setup()
COUNT = 5


@pytest.fixture(scope="module", autouse=True)
def fewer_actions():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cablecast.tuning.spread._POOL_COUNT", 800)
        yield


@pytest.fixture(scope="module")
def engine():
    return EngineWarp(segment_count=10, dt=2e-3)


@pytest.fixture(scope="module")
def actions(engine):
    return spread_actions(SETUP, COUNT, engine, seed=1)


def tracks(actions, engine):
    paths = cast_grip_paths(mirror_to_right(actions)[0], SETUP)
    return engine.rollout(SETUP.cable, paths, sample_dt=0.05).endpoint_xy


def nearest(xy):
    """Return the least distance between two of some points [m]."""
    apart = np.linalg.norm(xy[:, None] - xy, axis=-1)
    return float(np.min(apart[~np.eye(len(xy), dtype=bool)]))


def test_landings_lie_farther_apart_than_those_of_random_casts(actions, engine):
    spread = nearest(tracks(actions, engine)[:, -1])
    draws = [feasible_uniform(COUNT, SETUP, seed=seed) for seed in range(10)]
    assert spread > max(nearest(tracks(draw, engine)[:, -1]) for draw in draws)


def test_the_simulated_free_end_stays_on_the_table(actions, engine):
    assert SETUP.workspace.edge_distance(tracks(actions, engine)).min() > EDGE


def test_casts_go_to_the_right_and_to_the_left_by_turns(actions):
    np.testing.assert_array_equal(np.sign(actions[:, 1]), [1.0, -1.0, 1.0, -1.0, 1.0])


def test_the_arm_can_make_them(actions):
    assert check_actions(actions, SETUP).mask.all()


def test_the_same_seed_gives_the_same_actions_and_another_one_others(actions, engine):
    np.testing.assert_array_equal(spread_actions(SETUP, COUNT, engine, seed=1), actions)
    assert not np.array_equal(spread_actions(SETUP, COUNT, engine, seed=2), actions)


def test_a_cable_that_lands_at_one_place_cannot_be_spread():
    def rollout(cable, paths, sample_dt, edges):
        xy = np.tile([0.1, 0.9], (len(paths), 3, 1))
        return types.SimpleNamespace(endpoint_xy=xy)

    engine = types.SimpleNamespace(rollout=rollout)
    with pytest.raises(InputError, match="land at 1 places of the table, too few to spread 5"):
        spread_actions(SETUP, COUNT, engine)


def test_a_cable_that_lies_near_the_edge_after_the_reset_is_cast_all_the_same(engine):
    cable = dataclasses.replace(SETUP.cable, length=0.9)
    table = Workspace(table_width=1.6, table_depth=1.2, reset_y=0.27)
    setup = Setup(cable=cable, workspace=table)
    assert EDGE > 1.2 - 0.27 - 0.9
    actions = spread_actions(setup, 20, engine, seed=1)
    assert len(np.unique(mirror_to_right(actions)[0], axis=0)) == 20
