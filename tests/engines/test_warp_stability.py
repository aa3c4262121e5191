"""No silent failure: worlds follow their bending, and those whose energy grows are marked."""

import dataclasses

import numpy as np
import pytest
from benchmarks import energy

from cablecast.cable import CableParams, load_cable
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.engines.warp_ import constants as substeps
from cablecast.motion.grip_path import GripPath

CABLE = load_cable("cable_1")
UNDAMPED = dataclasses.replace(CABLE.params, linear_damping=0.0, angular_damping=0.0)
HEIGHT = 2.0


def let_go(params, duration, segment_count, **options):
    """Let a level cable go far above the table, and return the rollout of its swing."""
    nodes = np.zeros((1, segment_count + 1, 3)) + [0.0, 0.6, HEIGHT]
    nodes[0, :, 0] += np.linspace(0.0, CABLE.length, segment_count + 1)
    path = GripPath.hold([0.0, 0.6, HEIGHT, np.pi / 2, 0.0], 1.0)
    engine = EngineWarp(segment_count=segment_count, rest_speed=0.0)
    return engine.rollout(
        CABLE.with_params(params), path, CableState.at_rest(nodes), duration, **options
    )


@pytest.mark.parametrize(
    ("segment_count", "dt", "count", "materials"),
    [(20, 1e-3, 64, False), (50, 5e-4, 12, False), (100, 1e-3, 1, False), (28, 1e-3, 24, True)],
)
def test_no_world_of_the_search_space_grows_unmarked(segment_count, dt, count, materials):
    # `python -m benchmarks stability` plays 20,000 worlds at 28 resolutions.
    for index, name in enumerate(("cable_1", "cable_2", "cable_3")):
        cable, seed = load_cable(name), 10 + index
        marked, grown, _ = energy.scan(cable, segment_count, dt, count, seed, materials)
        assert grown == 0
        # A light end that whips may need a shorter step than bending does.
        assert marked <= max(1, 0.05 * count)


def test_an_undamped_swing_at_100_segments_gains_no_energy_in_ten_seconds():
    # Before worlds took substeps it gained a thousandfold.
    rollout = let_go(UNDAMPED, 10.0, 100, sample_dt=0.01, record_nodes=True)
    assert rollout.finite.all()
    heights = rollout.nodes[0, :, 1:, 2] - HEIGHT
    speeds = np.linalg.norm(np.diff(rollout.nodes[0], axis=0), axis=2) / 0.01
    # From level the free end falls no faster than a stone from twice the length of the cable.
    assert speeds.max() < 2.0 * np.sqrt(2.0 * 9.81 * 2.0 * CABLE.length)
    assert heights.mean(axis=1).max() < 1e-3


def test_a_gentle_undamped_swing_keeps_its_energy_and_a_whip_at_a_short_step():
    gentle = energy.swing_losses(CABLE, np.array([-np.pi / 4]), 50, 5e-4, 2.5)
    # Measured: less than 1e-4; the energy between samples is a mean over a window.
    assert abs(gentle[0]) < 5e-4
    coarse = energy.swing_losses(CABLE, np.zeros(1), 50, 5e-4, 2.5)[0]
    fine = energy.swing_losses(CABLE, np.zeros(1), 50, 1.25e-4, 2.5)[0]
    # Measured: 0.17 and 4e-4, docs/engine.md.
    assert abs(fine) < 0.01
    assert coarse > 10 * abs(fine)


def test_a_world_whose_step_is_too_long_is_marked(monkeypatch):
    monkeypatch.setattr(substeps, "MOST_FILTERED", 1e9)
    stiff = dataclasses.replace(UNDAMPED, bend_stiffness=2e-2)
    with np.errstate(invalid="ignore"):
        rollout = let_go(stiff, 2.0, 50, record_nodes=True)
    assert not rollout.finite[0]
    broken = np.isnan(rollout.endpoint_xyz[0]).all(axis=1)
    assert broken[-1]
    assert not broken[0]
    assert np.isnan(rollout.nodes[0, broken]).all()


def test_a_cable_that_lies_still_or_is_driven_hard_is_not_marked():
    lying = EngineWarp(segment_count=20).rollout(
        CABLE, GripPath.hold([0.0, 0.6, CABLE.radius, 0.0, 0.0], 1.0), duration=5.0
    )
    assert lying.finite.all()
    times = np.linspace(0.0, 8.0, 400)
    poses = np.zeros((400, 5)) + [0.0, 0.6, 1.0, 0.0, -np.pi / 2]
    poses[:, 0] = 0.2 * np.sin(12.0 * times) * np.minimum(times, 1.0)
    poses[:, 4] += 0.5 * np.sin(9.0 * times) * np.minimum(times, 1.0)
    nodes = np.zeros((1, 21, 3)) + [0.0, 0.6, 1.0]
    nodes[0, :, 2] -= np.linspace(0.0, CABLE.length, 21)
    shaken = EngineWarp(segment_count=20).rollout(
        CABLE, GripPath.fit(times, poses), CableState.at_rest(nodes), duration=8.0
    )
    # The gripper puts in many times what the cable holds, and friction and damping take it.
    assert shaken.finite.all()


@pytest.mark.parametrize(
    ("damping_time", "bearable"),
    [(0.0, substeps.MOST_FILTERED), (0.1, substeps.MOST_FILTERED - substeps.MOST_SPRING)],
)
def test_substeps_bring_the_fastest_wave_below_the_limit(damping_time, bearable):
    dt = 5e-4
    fastest = np.geomspace(1.0, 1e11, 200)
    counts = substeps.substep_counts(fastest, np.full(200, damping_time), dt)
    assert np.all(fastest * (dt / counts) ** 2 <= bearable * 1.001)
    # No more than half too many.
    needed = np.ceil(np.sqrt(fastest * dt**2 / bearable))
    assert np.all(counts <= np.maximum(1.5 * needed, 1))


def test_a_world_with_substeps_depends_on_no_other_world():
    values = np.repeat(CABLE.params.to_array()[None], 20, axis=0)
    values[:, CableParams.names().index("bend_stiffness")] = np.geomspace(1e-5, 1e-2, 20)
    params = CableParams.from_array(values)
    path = GripPath.hold([0.0, 0.6, 0.3, 0.0, 0.3], 0.2)
    engine = EngineWarp(segment_count=20, dt=1e-3)
    options = {"duration": 0.3, "record_nodes": True}
    whole = engine.rollout(CABLE.with_params(params), path, **options)
    for world in (0, 12, 19):
        alone = engine.rollout(
            CABLE.with_params(CableParams.from_array(values[world])), path, **options
        )
        np.testing.assert_array_equal(whole.nodes[world], alone.nodes[0])
        np.testing.assert_array_equal(
            whole.final_state.velocities[world], alone.final_state.velocities[0]
        )
