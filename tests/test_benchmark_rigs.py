"""The rigs of benchmarks cast, and draw other chances for each cast at a target."""

import functools

import numpy as np
import pytest
from benchmarks import places, strange_rig
from benchmarks.capsule_chain import CapsuleChain
from benchmarks.places import RIGS, Luck, equal_casts, open_rig
from benchmarks.strange_rig import StrangeRig
from benchmarks.uneven import STILL, after_correction, linear, stencils

import cablecast as cc
from cablecast.motion.casting import Action
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.trajectory import plan_trajectory
from cablecast.rigs.virtual import VirtualConfig

SETUP = cc.Setup()


@pytest.mark.parametrize("name", RIGS)
def test_every_rig_of_the_benchmarks_casts_with_the_luck_of_a_target(name, monkeypatch):
    monkeypatch.setattr(strange_rig, "CapsuleChain", lambda: CapsuleChain(segment_count=8))
    coarse = functools.partial(VirtualConfig, segment_count=8, dt=2e-3)
    monkeypatch.setattr(places, "VirtualConfig", coarse)
    motion = plan_trajectory(Action.from_array(feasible_uniform(1, SETUP, seed=3)[0]), SETUP)
    with open_rig(name, 0, SETUP) as rig:
        first, second = equal_casts(Luck(rig, 1000), motion, 2)
        again = equal_casts(Luck(rig, 1000), motion, 1)[0]
    np.testing.assert_array_equal(again, first)
    # The engine draws nothing by chance.
    assert (name == "engine") == bool(np.array_equal(first, second, equal_nan=True))


def test_a_cast_on_a_patchy_table_has_the_mean_friction_of_its_way():
    rest, along = (StrangeRig(SETUP, along=choice) for choice in (False, True))
    way = np.array([[0.0, 0.6], [0.2, 0.8], [0.2, 1.0]])
    frictions = [rest._friction_of(place[None]) for place in way]
    assert rest._friction_of(way) == frictions[-1]
    lengths = (np.hypot(0.2, 0.2), 0.2)
    means = (np.mean(frictions[:2]), np.mean(frictions[1:]))
    assert along._friction_of(way) == pytest.approx(np.average(means, weights=lengths))
    # A cable that does not move has the friction of its place.
    assert along._friction_of(way[[2, 2]]) == pytest.approx(frictions[-1])


def test_what_a_correction_leaves_by_a_jacobian_that_is_half_as_large_again():
    jacobian = np.array([[1.0, 0.0, 2.0], [0.0, 3.0, 0.0]])
    assert after_correction(jacobian, 1.5 * jacobian) == pytest.approx((0.5, 0.5))


def test_uneven_friction_changes_how_a_landing_follows_the_action():
    even, uneven = (
        StrangeRig(SETUP, scatter=STILL, unevenness=unevenness) for unevenness in (0.0, 0.08)
    )
    pairs = [(linear(even, actions), linear(uneven, actions)) for actions in stencils(SETUP, 2, 0)]
    known = [(a[1:].T, b[1:].T) for a, b in pairs if a is not None and b is not None]
    assert known
    for smooth, rough in known:
        assert after_correction(smooth, smooth) == pytest.approx((0.0, 0.0), abs=1e-9)
        assert after_correction(smooth, rough)[0] > 0.0
