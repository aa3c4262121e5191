"""An attachment that is a body: its closed forms, and where it is a point mass again."""

import dataclasses

import numpy as np
import pytest

from cablecast.cable import PAPER_PARAMS, Cable, CableParams, load_cable
from cablecast.conventions import GRAVITY
from cablecast.engines.base import CableState, reset_state
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.grip_path import GripPath
from cablecast.setup import Setup

LENGTH, ARM = 0.3, 0.06
BARE = dict.fromkeys(PAPER_PARAMS, 0.0)


def held_cable(arm, friction_ratio=1.0, **values):
    material = {"attachment_arm": arm, "attachment_friction_ratio": friction_ratio}
    params = CableParams(**(BARE | values | material))
    return Cable(name="rod", length=LENGTH, diameter=0.002, params=params)


def free_engine(segment_count, dt):
    return EngineWarp(
        segment_count=segment_count, dt=dt, precision="double", table=False, rest_speed=0.0
    )


def level(count):
    """Return a level cable a metre above the table at rest, and its grip."""
    positions = np.zeros((1, count + 1, 3))
    positions[0, :, 1], positions[0, :, 2] = np.linspace(0.0, LENGTH, count + 1), 1.0
    return CableState.at_rest(positions), GripPath.hold(np.array([0.0, 0.0, 1.0, 0.0, 0.0]), 1.0)


def slack(cable, count):
    """Return a slack cable on the table at rest, out to one side and back, and its grip."""
    s = np.linspace(0.0, LENGTH, count + 1)
    positions = np.zeros((1, count + 1, 3))
    positions[0, :, 0] = 0.6 * np.minimum(s, LENGTH - s)
    positions[0, :, 1], positions[0, :, 2] = 0.8 * s, cable.radius
    path = GripPath.hold(np.array([0.0, 0.0, cable.radius, 0.6, 0.0]), 0.1)
    return CableState.at_rest(positions), path


def chain_frequencies(masses, lengths):
    """Return the frequencies of a hanging chain of point masses [rad/s], the lowest first."""
    tension = GRAVITY * np.cumsum(masses[::-1])[::-1] / lengths
    stiffness = np.diag(tension + np.append(tension[1:], 0.0))
    stiffness -= np.diag(tension[1:], 1) + np.diag(tension[1:], -1)
    return np.sqrt(np.sort(np.linalg.eigvals(stiffness / masses[:, None]).real))


def test_hanging_attachment_swings_like_a_rod_on_a_thread():
    # A rod of mass m and length 3/2 arm is m/4 at the thread's end and 3 m/4 an arm beyond it.
    count, mass, end = 12, 1e-3, 0.02
    cable = held_cable(ARM, mass=mass, endpoint_mass=end)
    s = np.linspace(0.0, LENGTH, count + 1)
    positions = np.zeros((1, count + 1, 3))
    # Straight, at a small angle: the first two modes hold nearly all of the energy.
    angle = 0.01
    positions[0, :, 0], positions[0, :, 2] = s * np.sin(angle), 1.0 - s * np.cos(angle)
    down = GripPath.hold(np.array([0.0, 0.0, 1.0, 0.0, -np.pi / 2]), 1.0)
    rollout = free_engine(count, 5e-4).rollout(
        cable, down, CableState.at_rest(positions), duration=4.0, sample_dt=2e-3
    )
    masses = np.append(np.full(count, mass / count), 0.75 * end)
    masses[-2] = 0.5 * mass / count + 0.25 * end
    lengths = np.append(np.full(count, LENGTH / count), ARM)
    expected = chain_frequencies(masses, lengths)
    waves = expected * rollout.times[:, None]
    design = np.concatenate([np.cos(waves), np.sin(waves)], axis=1)
    x = rollout.endpoint_xyz[0, :, 0]
    left = x - design @ np.linalg.lstsq(design, x, rcond=None)[0]
    assert np.std(left) < 0.01 * np.std(x)
    # A point mass swings otherwise.
    other = chain_frequencies(np.append(masses[:-2], masses[-2:].sum()), lengths[:-1])
    assert abs(other[0] / expected[0] - 1.0) > 0.02


@pytest.mark.parametrize("count", [8, 12])
def test_weight_of_the_attachment_bends_a_cantilever(count):
    stiffness, mass, end = 0.05, 5e-4, 4e-3
    state, path = level(count)
    sag = []
    for arm in (0.0, ARM):
        cable = held_cable(
            arm, mass=mass, endpoint_mass=end, bend_stiffness=stiffness, linear_damping=5.0
        )
        rollout = free_engine(count, 5e-4).rollout(cable, path, state, duration=5.0, sample_dt=0.5)
        sag.append(1.0 - rollout.endpoint_xyz[0, -1, 2])
    # A force F at the end, and the couple 3/4 F arm: F l^3 / (3 EI) + 3/4 F arm l^2 / (2 EI).
    force = end * GRAVITY
    by_force = force * LENGTH**3 / (3.0 * stiffness)
    by_cable = mass * GRAVITY * LENGTH**3 / (8.0 * stiffness)
    by_couple = 0.75 * force * ARM * LENGTH**2 / (2.0 * stiffness)
    assert sag[0] == pytest.approx(by_force + by_cable, rel=0.01)
    assert sag[1] - sag[0] == pytest.approx(by_couple, rel=0.02)


def test_worlds_with_and_without_an_arm_share_a_batch():
    cable = load_cable("cable_1")
    actions_path = GripPath.hold(np.array([0.0, 0.42, 0.02, 0.0, 0.0]), 0.2)
    engine = EngineWarp(segment_count=20, dt=1e-3)

    def play(arms):
        attached = cable.with_params(attachment_arm=np.array(arms))
        return engine.rollout(attached, actions_path, duration=0.6)

    both = play([0.0, 0.03, 0.02])
    for world, arm in enumerate([0.0, 0.03, 0.02]):
        alone = play([arm])
        np.testing.assert_allclose(both.endpoint_xyz[world], alone.endpoint_xyz[0], atol=1e-6)
    assert both.final_state.positions.shape == (3, 21, 3)


def test_a_held_far_end_has_no_arm():
    cable = load_cable("cable_1")
    near = GripPath.hold(np.array([0.0, 0.0, 0.3, 0.0, 0.0]), 0.1)
    far = GripPath.hold(np.array([0.0, 0.5, 0.3, 0.0, 0.0]), 0.1)
    state = reset_state(cable, near, 20)
    positions = np.array(state.positions)
    s = np.linspace(0.0, 1.0, 21)
    positions[0, :, 1], positions[0, :, 2] = 0.5 * s, 0.3 - 0.7 * s * (1.0 - s)
    state = dataclasses.replace(state, positions=positions)
    ends = [
        EngineWarp(segment_count=20, dt=1e-3, table=False)
        .rollout(
            cable.with_params(attachment_arm=arm),
            near,
            state,
            duration=0.3,
            far_path=far,
        )
        .final_state.positions
        for arm in (0.0, 0.03)
    ]
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize("arm", [0.0, ARM])
@pytest.mark.parametrize("ratio", [0.5, 2.0])
def test_an_attachment_slides_to_rest_by_its_own_friction(arm, ratio):
    count, friction, speed = 12, 0.4, 0.4
    cable = held_cable(
        arm,
        ratio,
        mass=5e-4,
        endpoint_mass=0.2,
        lateral_friction=friction,
        worksurface_friction=1.0,
        # A lever far above the radius: nothing rolls.
        rolling_friction=0.1,
    )
    # The cable is light beside what it holds.
    state, path = slack(cable, count)
    # An attachment moves on as the cable's last segment does.
    state.velocities[0, -2:, 1] = speed
    engine = EngineWarp(segment_count=count, dt=2e-4, precision="double")
    rollout = engine.rollout(cable, path, state, duration=1.0)
    way = rollout.endpoint_xyz[0, -1] - rollout.endpoint_xyz[0, 0]
    expected = speed**2 / (2.0 * friction * ratio * GRAVITY)
    assert way[1] == pytest.approx(expected, rel=0.02)
    assert abs(way[0]) < 0.02 * expected


def test_spinning_friction_stops_a_turning_attachment():
    # A rod of mass m turns about its centre: I = 3/16 m arm², and the couple is mu' m g.
    count, end, lever, rate = 12, 0.2, 5e-3, 6.0
    cable = held_cable(ARM, mass=5e-4, endpoint_mass=end, spinning_friction=lever)
    state, path = slack(cable, count)
    engine = EngineWarp(segment_count=count, dt=1e-4, precision="double", rest_speed=0.0)
    last = state.positions[0, -1] - state.positions[0, -2]
    axis = last / np.linalg.norm(last)
    across = np.array([-axis[1], axis[0], 0.0])
    # The engine continues the line of the last two nodes to the tip, velocities too. About the
    # centre, 3/4 of an arm beyond the joint, the joint moves back as the tip moves on.
    segment = LENGTH / count
    state.velocities[0, -1] = -0.75 * ARM * rate * across
    state.velocities[0, -2] = state.velocities[0, -1] - segment * rate * across
    rollout = engine.rollout(cable, path, state, duration=0.2, sample_dt=5e-3)
    way = (rollout.endpoint_xyz[0] - rollout.endpoint_xyz[0, 0]) @ across
    slowing = lever * GRAVITY / (3.0 / 16.0 * ARM**2)
    angle = rate**2 / (2.0 * slowing)
    assert way[-1] == pytest.approx(-0.75 * ARM * np.sin(angle), rel=0.03)


def test_landings_do_not_depend_on_the_segments_beside_an_attachment():
    # At 100 segments the attachment is seven times as long as they are.
    setup = Setup(cable=load_cable("cable_1").with_params(attachment_arm=0.0434))
    paths = cast_grip_paths(feasible_uniform(24, setup, seed=3), setup)
    landings = [
        EngineWarp(segment_count=count, dt=2.5e-4).rollout(setup.cable, paths).endpoint_xy[:, -1]
        for count in (60, 100)
    ]
    apart = np.linalg.norm(landings[1] - landings[0], axis=1) / setup.cable.length
    assert np.median(apart) < 0.01
    assert np.quantile(apart, 0.75) < 0.02
