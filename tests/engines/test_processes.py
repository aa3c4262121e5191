"""PyBullet's worlds on a process for each core answer like one process, and simulate until rest."""

import numpy as np
import pytest

from cablecast.engines.spread import EngineSpread, spread
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.runs.workers import LOCAL, PROCESSES, run_tasks
from cablecast.setup import Setup

pytest.importorskip("pybullet")

from cablecast.engines.pybullet_ import EnginePybullet

SETUP = Setup()
# A cable that has come to rest moves no farther than this until the end of a rollout, 0.2 % of its
# length.
REST_TOLERANCE = 1.5e-3


def test_worlds_in_processes_are_the_worlds_of_this_one_to_the_bit():
    engine = EnginePybullet(segment_count=4)
    paths = cast_grip_paths(feasible_uniform(5, SETUP, seed=3), SETUP)
    handed_out = spread(engine, LOCAL)
    assert isinstance(handed_out, EngineSpread)
    here, there = (one.rollout(SETUP.cable, paths, duration=0.3) for one in (engine, handed_out))
    np.testing.assert_array_equal(here.endpoint_xyz, there.endpoint_xyz)


def test_an_error_in_a_process_is_raised_here():
    with pytest.raises(ZeroDivisionError):
        list(run_tasks(divmod, [(0, (1,))], PROCESSES, (0,)))


def test_a_process_that_ends_is_an_error():
    from cablecast.errors import CablecastError

    with pytest.raises(CablecastError, match="a process that simulates ended"):
        list(run_tasks(os_exit, [(0, ())], PROCESSES))


def os_exit():
    raise SystemExit(3)


def test_a_world_that_rests_is_simulated_no_further(monkeypatch):
    paths = cast_grip_paths(feasible_uniform(1, SETUP, seed=3), SETUP)
    engine = EnginePybullet(segment_count=6)
    shortened = engine.rollout(SETUP.cable, paths, duration=4.0)
    monkeypatch.setattr("cablecast.engines.pybullet_._REST_DISTANCE", 0.0)
    whole = engine.rollout(SETUP.cable, paths, duration=4.0)
    apart = np.abs(shortened.endpoint_xyz - whole.endpoint_xyz).max()
    assert 0.0 < apart < REST_TOLERANCE
