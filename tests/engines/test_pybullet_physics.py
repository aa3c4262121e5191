"""The paper's simulator against closed forms, as far as its solver reaches."""

import numpy as np
import pytest
from benchmarks.validation.scenes import LENGTH, MASS, RADIUS, make_cable, straight
from benchmarks.validation.shape import heavy_elastica
from tests.engines.grips import sweep

from cablecast.cable import load_cable
from cablecast.motion.grip_path import GripPath

pytest.importorskip("pybullet")

from cablecast.engines.pybullet_ import DEFAULT_DT, EnginePybullet

GRAVITY = 9.81
# Distance of 18 rigid segments from the continuum at these bends, 0.4 %, and some margin.
ELASTICA_TOLERANCE = 0.01 * LENGTH
# Each capsule stops with an iterative solver's error of its own, and the cable buckles a little.
SLIDE_TOLERANCE = 0.05


def test_a_cantilever_sags_as_the_heavy_elastica():
    stiffness, count = 3e-3, 18
    cable = make_cable(bend_stiffness=stiffness, linear_damping=4.0, angular_damping=50.0)
    expected = heavy_elastica(stiffness, MASS * GRAVITY / LENGTH)[-1] + [0.0, 2.0]
    # At 1/480 s the joints of so stiff a cable would be softened.
    rollout = EnginePybullet(count, DEFAULT_DT / 2).rollout(
        cable,
        GripPath.hold([0, 0, 2.0, 0, 0], 1.0),
        straight(count, (0, 0, 2.0), (0, 1, 0)),
        duration=4.0,
    )
    np.testing.assert_allclose(rollout.endpoint_xyz[0, -1, 1:], expected, atol=ELASTICA_TOLERANCE)
    assert abs(rollout.endpoint_xyz[0, -1, 0]) < 1e-6


def test_a_sliding_cable_stops_after_v_squared_over_2_mu_g():
    lateral, surface = 0.8, 0.5
    cable = make_cable(
        bend_stiffness=3e-4,
        twist_stiffness=3e-4,
        lateral_friction=lateral,
        worksurface_friction=surface,
    )
    friction, speed = lateral * surface, 1.0
    times = np.linspace(0.0, speed / (friction * GRAVITY), 100)
    poses = np.zeros((100, 5))
    poses[:, 0] = speed * times - 0.5 * friction * GRAVITY * times**2
    poses[:, 2] = RADIUS
    state = straight(18, (0, 0, RADIUS), (0, 1, 0), (speed, 0.0, 0.0))
    rollout = EnginePybullet().rollout(
        cable, GripPath.fit(times, poses), state, duration=times[-1] + 0.3
    )
    expected = speed**2 / (2.0 * friction * GRAVITY)
    moved = rollout.final_state.positions[0, :, 0]
    np.testing.assert_allclose(moved, expected, rtol=SLIDE_TOLERANCE)


def test_the_far_half_of_a_cable_hangs_lower_the_heavier_its_endpoint():
    cable = make_cable(bend_stiffness=3e-3, linear_damping=4.0, endpoint_mass=np.array([0.0, 0.1]))
    rollout = EnginePybullet().rollout(
        cable,
        GripPath.hold([0, 0, 2.0, 0, 0], 1.0),
        straight(18, (0, 0, 2.0), (0, 1, 0)),
        duration=3.0,
    )
    assert rollout.endpoint_xyz[1, -1, 2] < rollout.endpoint_xyz[0, -1, 2] - 0.01


@pytest.mark.parametrize("stiffness", [0.0, 0.1])
def test_the_softest_and_the_stiffest_cable_stay_finite_at_the_papers_step(stiffness):
    cable = load_cable("cable_1").with_params(
        bend_stiffness=stiffness, twist_stiffness=10.0 * stiffness
    )
    path = sweep(0.8, 0.4)
    rollout = EnginePybullet().rollout(cable, path, duration=0.8)
    assert rollout.finite.all()
    # Nothing has been torn off: the endpoint is where a cable of this length can reach.
    grip = path.evaluate([0.4])[0, 0, :3]
    reach = np.linalg.norm(rollout.final_state.positions[0] - grip, axis=-1)
    assert reach.max() < cable.length * 1.001
