"""The physics of EngineWarp against closed forms."""

import numpy as np
import pytest
from benchmarks.validation.scenes import (
    LENGTH,
    LOCKED,
    RADIUS,
    from_edges,
    make_cable,
    straight,
)

from cablecast.cable import Cable
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.grip_path import GripPath

GRAVITY = 9.81


def cable(**params) -> Cable:
    """Return a rope that slides and never rolls, on a table without friction."""
    return make_cable(**{"worksurface_friction": 0.0, "rolling_friction": LOCKED} | params)


def drive(start, velocity, duration, yaw=0.0, pitch=0.0):
    """Return a grip that moves at a constant velocity."""
    times = np.linspace(0.0, duration, 5)
    poses = np.zeros((5, 5))
    poses[:, :3] = np.asarray(start) + times[:, None] * np.asarray(velocity)
    poses[:, 3], poses[:, 4] = yaw, pitch
    return GripPath.fit(times, poses)


def engine(segment_count, **options) -> EngineWarp:
    return EngineWarp(segment_count=segment_count, precision="double", rest_speed=0.0, **options)


def energy(nodes, dt, c: Cable):
    """Kinetic and potential energy between samples [J], shape [step - 1]."""
    segment_count = nodes.shape[1] - 1
    mass = np.full(segment_count + 1, c.params.mass / segment_count)
    mass[-1] = mass[-1] / 2 + c.params.endpoint_mass
    mass[0] = 0.0
    v = np.diff(nodes, axis=0) / dt
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    kinetic = 0.5 * (mass * (v**2).sum(2)).sum(1)
    return kinetic + (mass * GRAVITY * middle[..., 2]).sum(1)


def test_a_cable_dragged_straight_is_pulled_with_the_friction_of_its_weight():
    # Tension changes nothing that we can see, but stopping the grip must stop the whole cable in
    # line: an inextensible straight cable cannot overtake its grip without buckling.
    c = cable(lateral_friction=1.0, worksurface_friction=0.4, bend_stiffness=1e-3)
    path = drive((0, 0, RADIUS), (0.0, -0.3, 0.0), 1.0)
    state = straight(20, (0, 0, RADIUS), (0, 1, 0), velocity=(0, -0.3, 0))
    rollout = engine(20).rollout(c, path, state, duration=1.0)
    nodes = rollout.final_state.positions[0]
    assert np.abs(nodes[:, 0]).max() < 1e-6
    np.testing.assert_allclose(nodes[-1, 1], -0.3 + LENGTH, atol=1e-6)


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_a_cable_sliding_sideways_stops_after_v_squared_over_2_mu_g(friction):
    # The far end and the grip both let the cable slide as a whole: with the grip moving at the
    # decelerating velocity itself, every node obeys v' = -mu g.
    speed = 1.0
    stop = speed / (friction * GRAVITY)
    times = np.linspace(0.0, stop, 200)
    poses = np.zeros((200, 5))
    poses[:, 0] = speed * times - 0.5 * friction * GRAVITY * times**2
    poses[:, 2] = RADIUS
    c = cable(lateral_friction=friction, worksurface_friction=1.0)
    state = straight(20, (0, 0, RADIUS), (0, 1, 0), velocity=(speed, 0, 0))
    rollout = engine(20).rollout(c, GripPath.fit(times, poses), state, duration=1.0)
    expected = speed**2 / (2 * friction * GRAVITY)
    # One step of 0.5 ms at 1 m/s is 0.5 mm; the scheme is second order, so 0.1 % remains.
    np.testing.assert_allclose(rollout.final_state.positions[0, :, 0], expected, rtol=1e-3)


def bent_cable_after_a_minute(params_of_cable, bend):
    """Nodes, each second for 61 s, of a cable that lies bent [m], shape [second, node, 3]."""
    c = cable(**params_of_cable)
    segment_count = 30
    angle = np.linspace(0.0, bend, segment_count)
    step = LENGTH / segment_count * np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    rollout = engine(segment_count).rollout(
        c,
        GripPath.hold([0, 0, RADIUS, 0, 0], 1.0),
        CableState.at_rest(from_edges(step, (0, 0, RADIUS))[None]),
        duration=61.0,
        sample_dt=1.0,
        record_nodes=True,
    )
    return rollout.nodes[0]


def test_a_cable_below_the_friction_limit_does_not_creep():
    # A bent cable at rest: bending pulls it straight with less than friction can hold.
    friction = {"lateral_friction": 1.0, "worksurface_friction": 0.4}
    nodes = bent_cable_after_a_minute({**friction, "bend_stiffness": 1e-4}, 0.8)
    # In the first second the free tip, bent more than its weight can hold, straightens.
    moved = np.linalg.norm(nodes[-1] - nodes[1], axis=1)
    assert moved.max() < 1e-4  # the bound that the design asks for: 0.1 mm in 60 s


def test_spinning_friction_alone_holds_a_bent_cable_without_creep():
    # Sliding costs nothing; a couple of up to sigma N keeps each segment from turning: more than
    # the bending moment at the free end.
    friction = {"lateral_friction": 0.0, "spinning_friction": 0.02, "bend_stiffness": 1e-4}
    held = bent_cable_after_a_minute(friction, 0.2)
    assert np.linalg.norm(held[-1] - held[0], axis=1).max() < 1e-4
    released = bent_cable_after_a_minute({**friction, "spinning_friction": 0.0}, 0.2)
    assert np.linalg.norm(released[-1] - released[0], axis=1).max() > 0.01


def test_a_cable_held_at_both_ends_hangs_in_a_catenary():
    segment_count, span = 60, 0.4
    c = cable(linear_damping=5.0)
    left, right = np.array([0.0, 0.0, 1.0]), np.array([span, 0.0, 1.0])
    # Start from a V of the right length.
    depth = np.sqrt((LENGTH / 2) ** 2 - (span / 2) ** 2)
    s = np.linspace(0.0, 1.0, segment_count + 1)[:, None]
    bottom = np.array([span / 2, 0.0, 1.0 - depth])
    positions = np.where(
        s <= 0.5, left + 2 * s * (bottom - left), bottom + (2 * s - 1) * (right - bottom)
    )
    rollout = engine(segment_count).rollout(
        c,
        GripPath.hold([*left, 0, 0], 1.0),
        CableState.at_rest(positions[None]),
        duration=8.0,
        far_path=GripPath.hold([*right, 0, 0], 1.0),
    )
    from scipy.optimize import brentq

    a = brentq(lambda a: 2 * a * np.sinh(span / (2 * a)) - LENGTH, 0.02, 10.0)
    nodes = rollout.final_state.positions[0]
    exact = a * np.cosh((nodes[:, 0] - span / 2) / a)
    exact += 1.0 - a * np.cosh(span / (2 * a))
    # The sag is 0.2 m; 60 chords follow the curve to 0.1 % of it.
    np.testing.assert_allclose(nodes[:, 2], exact, atol=2e-4)


def chain_frequencies(count):
    """Angular frequencies of a hanging chain, j_k / 2 sqrt(g / L), j_k the zeros of J0."""
    from scipy.special import jn_zeros

    return 0.5 * jn_zeros(0, count) * np.sqrt(GRAVITY / LENGTH)


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_a_hanging_chain_swings_in_its_modes_with_the_periods_of_bessel(mode):
    from scipy.special import j0

    segment_count = 60
    omega = chain_frequencies(3)[mode]
    c = cable()
    s = np.linspace(0.0, 1.0, segment_count + 1)
    shape = j0(2 * omega * np.sqrt(LENGTH / GRAVITY * (1 - s)))
    amplitude = 1e-3
    slope = np.diff(amplitude * shape) / (LENGTH / segment_count)
    step = LENGTH / segment_count * np.stack([slope, 0 * slope, -np.sqrt(1 - slope**2)], axis=1)
    positions = from_edges(step, (0, 0, 1.0))
    period = 2 * np.pi / omega
    rollout = engine(segment_count).rollout(
        c,
        GripPath.hold([0, 0, 1.0, 0, -np.pi / 2], 1.0),
        CableState.at_rest(positions[None]),
        duration=1.2 * period,
        sample_dt=2e-3,
    )
    x = rollout.endpoint_xyz[0, :, 0]
    fitted = period_of(rollout.times, x, omega)
    # The chain of 60 links is 0.2 % off in the third mode; amplitude adds less.
    assert abs(fitted / period - 1.0) < 5e-3


def period_of(times, x, omega):
    """Period of the cosine that fits best [s]."""
    from scipy.optimize import least_squares

    def residual(p):
        return p[0] * np.cos(p[1] * times) + p[2] * np.sin(p[1] * times) - x

    fit = least_squares(residual, [x[0], omega, 0.0], x_scale=[abs(x[0]), omega, abs(x[0])])
    return 2 * np.pi / fit.x[1]


@pytest.mark.parametrize("swing_deg", [1.0, 60.0])
def test_a_weight_on_a_light_cable_swings_as_a_pendulum(swing_deg):
    from scipy.special import ellipk

    c = cable(mass=5e-4, endpoint_mass=0.5)
    angle = np.radians(swing_deg)
    state = straight(10, (0, 0, 1.0), (np.sin(angle), 0, -np.cos(angle)))
    exact = 4 * np.sqrt(LENGTH / GRAVITY) * ellipk(np.sin(angle / 2) ** 2)
    rollout = engine(10).rollout(
        c,
        GripPath.hold([0, 0, 1.0, 0, -np.pi / 2], 1.0),
        state,
        duration=1.1 * exact,
        sample_dt=1e-3,
    )
    x = rollout.endpoint_xyz[0, :, 0]
    crossings = np.nonzero(np.diff(np.sign(x)))[0]
    times = rollout.times[crossings] + 1e-3 * x[crossings] / (x[crossings] - x[crossings + 1])
    # The cable's own mass is a thousandth of the weight.
    assert abs(2 * (times[1] - times[0]) / exact - 1.0) < 2e-3


def test_a_swinging_cable_gains_no_energy():
    c = cable(bend_stiffness=5e-4, endpoint_mass=0.01)
    state = straight(30, (0, 0, 2.0), (1, 0, 0))
    dt = 5e-4
    rollout = engine(30, dt=dt).rollout(
        c,
        GripPath.hold([0, 0, 2.0, np.pi / 2, 0], 1.0),
        state,
        duration=2.0,
        sample_dt=dt,
        record_nodes=True,
    )
    total = energy(rollout.nodes[0], dt, c)
    fall = (c.params.mass / 2 + c.params.endpoint_mass) * GRAVITY * LENGTH
    # Bending energy is left out of the balance, so the sum may only be lower than at the start.
    assert (total - total[0]).max() < 0.01 * fall


def test_a_clamped_rod_sags_as_the_heavy_elastica():
    stiffness = 0.05
    c = cable(bend_stiffness=stiffness, linear_damping=5.0, angular_damping=50.0)
    state = straight(40, (0, 0, 1.0), (1, 0, 0))
    rollout = engine(40).rollout(
        c, GripPath.hold([0, 0, 1.0, np.pi / 2, 0], 1.0), state, duration=6.0
    )
    weight = c.params.mass / LENGTH * GRAVITY
    from scipy.integrate import solve_bvp

    # Large deflections: EI phi'' = weight (L - s) cos(phi), phi(0) = 0, phi'(L) = 0.
    s = np.linspace(0, LENGTH, 101)
    solution = solve_bvp(
        lambda s, y: np.stack([y[1], -weight * (LENGTH - s) * np.cos(y[0]) / stiffness]),
        lambda a, b: np.array([a[0], b[1]]),
        s,
        np.zeros((2, 101)),
    )
    sag = abs(np.trapezoid(np.sin(solution.sol(np.linspace(0, LENGTH, 2001))[0]), dx=LENGTH / 2000))
    computed = 1.0 - rollout.final_state.positions[0, -1, 2]
    # Half cells at the clamp make 40 segments second order: 0.1 %.
    assert abs(computed / sag - 1.0) < 5e-3
