"""Materials that damp, curl and yield, against closed forms."""

import dataclasses

import numpy as np
import pytest
from benchmarks.validation import scenes
from benchmarks.validation.scenes import LENGTH, make_cable
from tests.engines.grips import smooth

from cablecast.cable import Cable
from cablecast.engines import make_engine
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath

DENSITY, HEIGHT = 0.05, 2.0
# A pull that sags the cantilever by a few hundredths of its length [m/s²].
GENTLE_PULL = 0.5
SEGMENT_COUNT = 30
# First solution of cos(x) cosh(x) = -1: the first mode of a cantilever.
FIRST_MODE = 1.8751041
START = (0.0, 0.0, HEIGHT)
CABLE = make_cable(
    twist_stiffness=2e-3,
    bend_stiffness=5e-2,
    mass=DENSITY * LENGTH,
    lateral_friction=0.5,
    worksurface_friction=0.5,
)


def first_mode(amplitude):
    """Return a cantilever along y, bent into its first mode [m], shape [1, node, 3]."""
    s = np.linspace(0.0, LENGTH, SEGMENT_COUNT + 1)
    a, k = FIRST_MODE, FIRST_MODE / LENGTH
    share = (np.cosh(a) + np.cos(a)) / (np.sinh(a) + np.sin(a))
    x = np.cosh(k * s) - np.cos(k * s) - share * (np.sinh(k * s) - np.sin(k * s))
    slopes = np.arcsin(np.diff(x * amplitude / x[-1]) / (LENGTH / SEGMENT_COUNT))
    nodes = np.zeros((1, SEGMENT_COUNT + 1, 3))
    nodes[0, :, 2] = HEIGHT
    nodes[0, 1:, 0] = np.cumsum(np.sin(slopes)) * LENGTH / SEGMENT_COUNT
    nodes[0, 1:, 1] = np.cumsum(np.cos(slopes)) * LENGTH / SEGMENT_COUNT
    return nodes


def swing(cable, nodes, duration, path=None, **options):
    engine = EngineWarp(segment_count=SEGMENT_COUNT, rest_speed=0.0, gravity=0.0)
    path = GripPath.hold([*START, 0.0, 0.0], 0.1) if path is None else path
    return engine.rollout(cable, path, CableState.at_rest(nodes), duration, 0.004, **options)


def straight():
    return scenes.straight(SEGMENT_COUNT, START, (0.0, 1.0, 0.0)).positions


@pytest.mark.parametrize("damping_time", [0.005, 0.05, 1.0])
def test_a_mode_of_bending_decays_as_that_of_kelvins_and_voigts_solid(damping_time):
    amplitude = 0.01
    rollout = swing(CABLE.with_params(damping_time=damping_time), first_mode(amplitude), 2.0)
    # x'' = -w² (x + T x') from rest.
    w = FIRST_MODE**2 * np.sqrt(CABLE.params.bend_stiffness / DENSITY / LENGTH**4)
    system = np.array([[0.0, 1.0], [-(w**2), -(w**2) * damping_time]])
    roots, modes = np.linalg.eig(system)
    weights = np.linalg.solve(modes, [amplitude, 0.0])
    exact = np.real(np.exp(np.outer(rollout.times, roots)) @ (modes[0] * weights))
    # The frequency of 30 segments is 0.2 % off, which 3 swings add up.
    np.testing.assert_allclose(rollout.endpoint_xyz[0, :, 0], exact, atol=0.02 * amplitude)
    # It would be off by far more if nothing damped it.
    undamped = amplitude * np.cos(w * rollout.times)
    assert np.abs(exact - undamped).max() > 0.2 * amplitude


def test_a_mode_of_torsion_decays_as_that_of_kelvins_and_voigts_solid():
    damping_time, amplitude = 2e-3, 0.2
    cable = CABLE.with_params(damping_time=damping_time)
    middles = (np.arange(SEGMENT_COUNT) + 0.5) / SEGMENT_COUNT
    state = dataclasses.replace(
        CableState.at_rest(straight()), roll=amplitude * np.sin(0.5 * np.pi * middles)[None]
    )
    # The clamped-free mode: inertia of a solid cylinder, w = pi / (2 L) sqrt(GJ / (rho I)).
    inertia = 0.5 * DENSITY * cable.radius**2
    w = 0.5 * np.pi / LENGTH * np.sqrt(CABLE.params.twist_stiffness / inertia)
    decay = 0.5 * damping_time * w**2
    engine = EngineWarp(segment_count=SEGMENT_COUNT, dt=2.5e-5, rest_speed=0.0, gravity=0.0)
    end = 0.02
    rollout = engine.rollout(cable, GripPath.hold([*START, 0.0, 0.0], 0.1), state, end, end)
    free = np.sqrt(w**2 - decay**2 + 0j)
    share = np.exp(-decay * end) * (np.cos(free * end) + decay / free * np.sin(free * end))
    # Backward Euler damps by w² dt / 2 beside, 1 % of this decay.
    expected = state.roll[0] * share.real
    np.testing.assert_allclose(rollout.final_state.roll[0], expected, atol=0.02 * amplitude)


def test_a_bent_cable_that_is_turned_with_both_grips_feels_no_dashpot():
    # An arc in a vertical plane is at rest between grips along its tangents, and a turn about the
    # vertical neither bends nor twists it, however slowly twist follows a torque.
    arc, turn, time = 1.0, 1.2, 1.0
    s = np.linspace(0.0, arc, SEGMENT_COUNT + 1)
    radius = LENGTH / arc
    side, nodes = radius * np.sin(s), straight()
    nodes[0, :, 1], nodes[0, :, 2] = side, HEIGHT - radius * (1.0 - np.cos(s))
    times = np.linspace(0.0, time, 61)
    yaw = turn * smooth(times / time)

    def grip(node, pitch):
        x, y, z = side[node] * np.sin(yaw), side[node] * np.cos(yaw), 0 * yaw + nodes[0, node, 2]
        return GripPath.fit(times, np.stack([x, y, z, yaw, 0 * yaw + pitch], axis=1)).levelled()

    cable = CABLE.with_params(damping_time=0.3, twist_stiffness=5e-3, bend_stiffness=5e-3)
    halfway = swing(cable, nodes, 0.5 * time, grip(0, 0.0), far_path=grip(-1, -arc)).final_state
    # A dashpot between spins alone, without the holonomy, would roll the middle by 0.02 rad.
    assert np.abs(halfway.roll).max() < 0.003


def curled(curvature):
    """Return a curled cable in air that soon brings it to rest."""
    return CABLE.with_params(rest_curvature=curvature, damping_time=0.05, linear_damping=3.0)


def test_a_curled_cable_that_nothing_bends_is_an_arc_to_the_left():
    curvature = 2.0
    cable = curled(curvature)
    rollout = swing(cable, straight(), 5.0)
    end = [-(1 - np.cos(curvature * LENGTH)) / curvature, np.sin(curvature * LENGTH) / curvature]
    # 30 segments are a polygon: off by l² curvature² / 24.
    np.testing.assert_allclose(rollout.endpoint_xyz[0, -1, :2], end, atol=1e-3)
    assert rollout.finite.all()


def test_a_curl_rolls_with_the_gripper():
    curvature = 2.0
    cable = curled(curvature)
    times = np.linspace(0.0, 1.0, 30)
    poses = np.tile([*START, 0.0, 0.0], (30, 1))
    path = GripPath.fit(times, poses, 0.5 * np.pi * smooth(times))
    rollout = swing(cable, straight(), 5.0, path)
    side = (1 - np.cos(curvature * LENGTH)) / curvature
    # A quarter of a turn about +y takes the left, -x, to the top.
    np.testing.assert_allclose(rollout.endpoint_xyz[0, -1, [0, 2]], [0.0, HEIGHT + side], atol=2e-3)


def test_each_world_may_have_a_material_of_its_own():
    times = np.array([0.0, 0.01, 0.05])
    together = swing(CABLE.with_params(damping_time=times), first_mode(0.01), 0.5)
    for world, time in enumerate(times):
        alone = swing(CABLE.with_params(damping_time=float(time)), first_mode(0.01), 0.5)
        offset = together.endpoint_xyz[world] - alone.endpoint_xyz[0]
        # Rounding alone: kernels with and without memory add up in another order.
        assert np.abs(offset).max() < 2e-6


def sagging(cable, duration):
    """Return how far the end of a cantilever hangs down, after 3 s and at the end [m]."""
    slow = cable.with_params(linear_damping=0.5)
    engine = EngineWarp(segment_count=SEGMENT_COUNT, rest_speed=0.0, gravity=GENTLE_PULL)
    path = GripPath.hold([*START, 0.0, 0.0], 0.1)
    state = CableState.at_rest(straight())
    rollout = engine.rollout(slow, path, state, duration, 1.0)
    return HEIGHT - rollout.endpoint_xyz[:, [3, -1], 2]


@pytest.mark.parametrize("curvature", [0.02, 0.05])
def test_a_cantilever_that_yields_under_its_weight_creeps(curvature):
    damping_time, time = 0.05, 2.0
    cable = CABLE.with_params(damping_time=damping_time, yield_curvature=curvature, yield_time=time)
    before, after = sagging(cable, 6.0)[0]
    # Statics tell the elastic curvature, w x² / (2 EI) at x from the end. All beyond the yield
    # curvature goes over into the cable's shape, and lowers the end by x. The damping adds its
    # time.
    stiffness, load = CABLE.params.bend_stiffness, DENSITY * GENTLE_PULL
    start = np.sqrt(2.0 * stiffness * curvature / load)
    rate = load * (LENGTH**4 - start**4) / (8.0 * stiffness)
    rate = (rate - curvature * (LENGTH**2 - start**2) / 2.0) / (time + damping_time)
    assert (after - before) / 3.0 == pytest.approx(rate, rel=0.01)


def test_a_cable_springs_back_from_bends_below_its_yield_curvature():
    # A cable that is let go swings to twice the bend in which it comes to rest, and a little more.
    greatest = 2.2 * DENSITY * GENTLE_PULL * LENGTH**2 / (2.0 * CABLE.params.bend_stiffness)
    elastic, yielding, over = (
        sagging(CABLE.with_params(damping_time=0.05, yield_curvature=curvature), 4.0)[0]
        for curvature in (0.0, greatest, 0.3 * greatest)
    )
    # Rounding alone.
    np.testing.assert_allclose(yielding, elastic, atol=2e-6)
    assert over[1] > elastic[1] + 1e-4


def test_a_material_is_written_with_its_cable_and_read_again():
    cable = CABLE.with_params(
        damping_time=0.02,
        yield_curvature=20.0,
        yield_time=0.3,
        drag_coefficient=1.0,
        friction_ratio=0.5,
    )
    assert Cable.from_dict(cable.to_dict()) == cable
    assert cable.to_dict()["params"]["yield_time"] == 0.3
    assert "yield_time" not in CABLE.to_dict()["params"]


@pytest.mark.parametrize("name", ["damping_time", "drag_coefficient", "friction_ratio"])
def test_engines_without_a_material_refuse_it(name):
    cable = CABLE.with_params(**{name: 0.2})
    with pytest.raises(InputError, match="knows no material"):
        make_engine("mujoco").rollout(cable, GripPath.hold([0.0, 0.5, 0.005, 0.0, 0.0], 0.1))
