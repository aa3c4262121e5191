"""Cables that hang at rest from a grip of any pose."""

import numpy as np
import pytest
from benchmarks.validation.scenes import LENGTH, RADIUS, make_cable

from cablecast.cable import Cable, CableParams
from cablecast.engines.base import GRAVITY, CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.grip_path import GripPath

SEGMENT_COUNT = 30
ENGINE = EngineWarp(segment_count=SEGMENT_COUNT, table=False, precision="double")
PITCHES = np.array([-2.0, -0.5 * np.pi, -1.0, 0.0, 1.0, 0.5 * np.pi, 2.0, 3.0])
START = np.array([0.3, -0.2, 1.5])


def grips(pitches, yaw=0.4):
    return GripPath.stack([GripPath.hold([*START, yaw, pitch], 0.1) for pitch in pitches])


@pytest.mark.parametrize("bend_stiffness", [1e-5, 1e-3, 3e-2])
def test_a_hanging_cable_stays_where_it_is(bend_stiffness):
    cable = make_cable(bend_stiffness=bend_stiffness, endpoint_mass=0.01)
    state = CableState.hanging(cable, grips(PITCHES), SEGMENT_COUNT)
    rollout = ENGINE.rollout(cable, grips(PITCHES), state, 1.0)
    # The engine takes the angle of a sharp bend from a series that ends.
    np.testing.assert_allclose(
        rollout.final_state.positions, state.positions, rtol=0, atol=3e-4 * LENGTH
    )
    assert rollout.finite.all()


def test_a_soft_cable_hangs_plumb_below_a_bend_as_long_as_its_weight_makes_it():
    stiffness = 1e-4
    cable = make_cable(bend_stiffness=stiffness)
    state = CableState.hanging(cable, grips([0.0]), 200)
    # The elastica under a tension T: EI phi'^2 / 2 = T (1 - cos phi) with phi the angle from plumb,
    # 90 degrees at the grip. With phi' = 2 sin(phi / 2) / reach its end lies 2 reach sin 45 aside,
    # and 2 reach (1 - cos 45) higher than straight down.
    tension = GRAVITY * float(cable.params.mass)
    reach = np.sqrt(stiffness / tension)
    aside = np.linalg.norm(state.positions[0, -1, :2] - START[:2])
    # Within the bend the tension falls by a share of reach over length.
    assert aside == pytest.approx(np.sqrt(2.0) * reach, rel=2.0 * reach / LENGTH)
    assert START[2] - state.positions[0, -1, 2] == pytest.approx(
        LENGTH - (2.0 - np.sqrt(2.0)) * reach, rel=1e-3
    )


def test_each_world_hangs_by_its_own_numbers():
    stiffnesses = np.array([1e-5, 1e-2])
    both = make_cable(bend_stiffness=stiffnesses)
    together = CableState.hanging(both, grips([0.5, 0.5]), SEGMENT_COUNT)
    for world, stiffness in enumerate(stiffnesses):
        alone = CableState.hanging(
            make_cable(bend_stiffness=float(stiffness)), grips([0.5]), SEGMENT_COUNT
        )
        np.testing.assert_array_equal(together.positions[world], alone.positions[0])
    lengths = [
        Cable(
            name="test",
            length=length,
            diameter=2 * RADIUS,
            params=CableParams(bend_stiffness=1e-3, mass=0.05),
        )
        for length in (0.5, 1.6)
    ]
    state = CableState.hanging(lengths, grips([-0.5 * np.pi]), SEGMENT_COUNT)
    np.testing.assert_allclose(START[2] - state.positions[:, -1, 2], [0.5, 1.6], atol=1e-9)
