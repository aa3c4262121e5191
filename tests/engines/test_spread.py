"""An engine that hands its worlds out in parts answers like the engine itself, to the bit."""

import dataclasses

import numpy as np
import pytest

from cablecast.engines.spread import EngineSpread
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.rigs.engine import RigEngine
from cablecast.setup import Setup
from cablecast.tuning.space import SearchSpace

SETUP = Setup()
CABLE = SETUP.cable
WORLDS = 11


@pytest.fixture(scope="module")
def engine():
    return EngineWarp(segment_count=10, dt=2e-3)


def handed_out(engine, world_count):
    """Return the engine in parts of some worlds, each played by an engine made anew."""
    return EngineSpread(engine, "local", world_count)


def other_cables(count):
    space = SearchSpace.for_cable(CABLE)
    unit = np.random.default_rng(4).uniform(size=(count, space.dimension))
    return CABLE.with_params(space.to_params(unit))


def same(one, other):
    return all(
        np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
        for name in ("times", "endpoint_xyz", "finite", "nodes")
        if getattr(one, name) is not None
    )


@pytest.mark.parametrize("world_count", [1, 4])
@pytest.mark.parametrize("shared", ["nothing", "parameters", "motion"])
def test_parts_together_are_the_whole(engine, world_count, shared):
    paths = cast_grip_paths(feasible_uniform(WORLDS, SETUP, seed=3), SETUP)
    cable = other_cables(WORLDS)
    if shared == "parameters":
        cable = CABLE.with_params(damping_time=np.linspace(0.01, 0.05, WORLDS))
    if shared == "motion":
        paths = paths[2:3]
        lengths = np.linspace(0.5, 0.7, WORLDS)
        cable = [
            dataclasses.replace(CABLE, length=length, params=cable.params.rows(world))
            for world, length in enumerate(lengths)
        ]
    # Motions end at different times: the longest says when all rollouts do.
    assert shared == "motion" or np.ptp(paths.duration) > 0.01
    whole = engine.rollout(cable, paths, record_nodes=True)
    parts = handed_out(engine, world_count).rollout(cable, paths, record_nodes=True)
    assert same(whole, parts)
    state = whole.final_state
    later = {"initial_state": state, "duration": 0.2}
    assert same(
        engine.rollout(cable, paths, **later),
        handed_out(engine, world_count).rollout(cable, paths, **later),
    )


def test_bad_arguments_are_refused_before_anything_travels(engine):
    paths = cast_grip_paths(feasible_uniform(3, SETUP, seed=3), SETUP)
    with pytest.raises(InputError, match="different numbers of worlds"):
        handed_out(engine, 1).rollout(other_cables(2), paths)


def test_an_engine_that_cannot_be_made_anew_is_refused(engine):
    with pytest.raises(InputError, match="this process only"):
        EngineSpread(RigEngine(engine, SETUP), "local")
