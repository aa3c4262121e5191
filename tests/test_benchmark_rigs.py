"""The rigs of benchmarks cast, and draw other chances for each cast at a target."""

import numpy as np
import pytest
from benchmarks.places import RIGS, Luck, equal_casts, open_rig

import cablecast as cc
from cablecast.motion.action import Action
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.trajectory import plan_trajectory

SETUP = cc.Setup()


@pytest.mark.parametrize("name", RIGS)
def test_every_rig_of_the_benchmarks_casts_with_the_luck_of_a_target(name):
    motion = plan_trajectory(Action.from_array(feasible_uniform(1, SETUP, seed=3)[0]), SETUP)
    with open_rig(name, 0, SETUP) as rig:
        first, second = equal_casts(Luck(rig, 1000), motion, 2)
        again = equal_casts(Luck(rig, 1000), motion, 1)[0]
    np.testing.assert_array_equal(again, first)
    # The engine draws nothing by chance.
    assert (name == "engine") == bool(np.array_equal(first, second, equal_nan=True))
