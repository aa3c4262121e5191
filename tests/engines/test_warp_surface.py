"""Drag of the air and friction with a grain, against closed forms."""

import numpy as np
import pytest
from benchmarks.validation import scenes
from benchmarks.validation.scenes import LENGTH, LOCKED, RADIUS, make_cable
from tests.engines.grips import sweep

from cablecast.cable import AIR_DENSITY
from cablecast.engines.base import GRAVITY
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.grip_path import GripPath

MASS, SEGMENT_COUNT = 0.02, 20
FRICTION = 0.4
# A lever of rolling friction far above the radius: segments slide and do not roll.
CABLE = make_cable(
    bend_stiffness=1e-4, mass=MASS, lateral_friction=FRICTION, rolling_friction=LOCKED
)
DRAG = 1.2
K = 0.5 * AIR_DENSITY * DRAG * 2.0 * RADIUS * LENGTH / MASS
"""Deceleration of the cable across itself over the square of its speed [1/m]."""
HEIGHT = 10.0
"""Height of a grip that falls and never reaches the table [m]."""
ALONG, ACROSS = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])


def follow(law, duration, height=0.0):
    """Return a grip that follows a law of motion [m], [step] to [step, 3], for a time [s]."""
    return scenes.fitted(lambda times: law(times) + [0.0, 0.0, height], duration)


def moving(velocity, height=0.0, direction=ALONG):
    """Return a straight cable that moves as a whole [m/s]."""
    return scenes.straight(SEGMENT_COUNT, (0.0, 0.0, height), direction, velocity)


def made_of(drag=1e-9, ratio=1.0 + 1e-6):
    """Return a cable of which both differ from nothing: one kernel for all, as each takes long."""
    return CABLE.with_params(drag_coefficient=drag, friction_ratio=ratio)


def fly(cable, law, state, duration, gravity=0.0, record_forces=False, **options):
    engine = EngineWarp(segment_count=SEGMENT_COUNT, gravity=gravity, rest_speed=0.0, **options)
    # The last sample may lie behind the end of the motion.
    path = follow(law, duration + 0.2, HEIGHT)
    return engine.rollout(cable, path, state, duration, record_forces=record_forces)


def test_a_level_cable_that_falls_reaches_its_terminal_velocity():
    terminal = np.sqrt(GRAVITY / K)
    duration = 2.0 * terminal / GRAVITY

    def law(t):
        return -(np.log(np.cosh(GRAVITY * t / terminal)) / K)[:, None] * np.array([0.0, 0.0, 1.0])

    rollout = fly(made_of(DRAG), law, moving(np.zeros(3), HEIGHT), duration, GRAVITY)
    fallen = HEIGHT + law(rollout.times[-1:])[0, 2]
    # Every node falls as the grip does: they would bend the cable by a metre without drag.
    np.testing.assert_allclose(rollout.final_state.positions[0, :, 2], fallen, atol=1e-3)
    speed = terminal * np.tanh(GRAVITY * rollout.times[-1] / terminal)
    np.testing.assert_allclose(rollout.final_state.velocities[0, 1:, 2], -speed, rtol=1e-3)
    assert speed > 0.95 * terminal


def test_a_cable_that_flies_across_itself_slows_down_as_one_over_the_time():
    speed, duration = 8.0, 1.0

    def law(t):
        return (np.log1p(K * speed * t) / K)[:, None] * ACROSS

    # Without bending, which would ask for shorter steps.
    limp = made_of(DRAG).with_params(bend_stiffness=0.0)
    errors = []
    for dt in (1e-2, 5e-3):
        rollout = fly(limp, law, moving(speed * ACROSS, HEIGHT), duration, dt=dt)
        expected = law(rollout.times[-1:])[0, 0]
        errors.append(np.abs(rollout.final_state.positions[0, 1:, 0] - expected).max())
    assert law(np.array([duration]))[0, 0] < 0.85 * speed * duration
    assert errors[1] < 1e-3
    # What is left is of the second order.
    assert errors[1] < 0.35 * errors[0]


@pytest.mark.parametrize("ratio", [0.02, 0.27, 1.0])
def test_a_hanging_cable_that_falls_along_itself_reaches_its_terminal_velocity(ratio):
    terminal = np.sqrt(GRAVITY / (ratio * K))
    duration = 0.5

    def law(t):
        return -(np.log(np.cosh(GRAVITY * t / terminal)) / (ratio * K))[:, None] * np.array(
            [0, 0, 1]
        )

    # Without bending, which would hold it in the direction of a grip that is level.
    cable = made_of(DRAG).with_params(drag_ratio=ratio, bend_stiffness=0.0)
    hanging = moving(np.zeros(3), HEIGHT, [0.0, 0.0, -1.0])
    rollout = fly(cable, law, hanging, duration, GRAVITY, record_forces=True, precision="double")
    fallen = HEIGHT + law(rollout.times[-1:])[0, 2]
    np.testing.assert_allclose(rollout.final_state.positions[0, -1, 2], fallen - LENGTH, atol=1e-4)
    # Segments keep their length whatever drags: a wrong law would show in the tension alone.
    tension = rollout.forces.tension[0, 1:]
    # What the fit of the path of the grip leaves.
    assert np.abs(tension).max() < 1e-5 * MASS * GRAVITY


def test_an_attachment_is_slowed_by_the_air_on_its_half_cell_alone():
    # A weight on a cable without stiffness that hangs: only the tension of the weight counts, so
    # that a wind across, seen from a grip at a steady speed, hangs it at tan(a) = drag / weight.
    speed, weight = 6.0, 0.5
    heavy = made_of(DRAG).with_params(mass=5e-4, endpoint_mass=weight, bend_stiffness=0.0)

    def law(t):
        return (speed * t)[:, None] * ACROSS

    state = moving(speed * ACROSS, HEIGHT, [0.0, 0.0, -1.0])
    rollout = fly(heavy, law, state, 6.0, GRAVITY, precision="double")
    swing = 0.5 * AIR_DENSITY * DRAG * 2.0 * RADIUS * LENGTH * speed**2 / 2.0 / (weight * GRAVITY)
    # It swings about this angle from zero to twice.
    lags = (speed * rollout.times - rollout.endpoint_xyz[0, :, 0]) / LENGTH
    assert lags.min() >= 0.0
    assert lags.max() < 2.1 * swing
    assert lags.mean() == pytest.approx(swing, rel=0.05)


def slide(ratio, velocity, law, duration):
    cable = made_of(ratio=ratio)
    state = moving(velocity, RADIUS)
    engine = EngineWarp(segment_count=SEGMENT_COUNT, rest_speed=0.0)
    path = follow(law, duration, RADIUS)
    return engine.rollout(cable, path, state, duration + 0.2)


@pytest.mark.parametrize(("direction", "factor"), [(ALONG, 0.5), (ALONG, 2.0), (ACROSS, 2.0)])
def test_a_cable_slides_as_far_along_and_across_as_each_friction_lets_it(direction, factor):
    speed = 1.0
    deceleration = FRICTION * GRAVITY * (factor if direction is ALONG else 1.0)
    stop = speed / deceleration

    def law(t):
        return (speed * t - 0.5 * deceleration * t**2)[:, None] * direction

    rollout = slide(factor, speed * direction, law, stop)
    nodes = rollout.final_state.positions[0] - [0.0, 0.0, RADIUS]
    distance = speed**2 / (2.0 * deceleration)
    expected = np.linspace(0.0, LENGTH, SEGMENT_COUNT + 1)[:, None] * ALONG + distance * direction
    # Along, a free end that slowed down less would push the cable out of line, if by little.
    np.testing.assert_allclose(nodes, expected, atol=1e-3 * distance)


def test_a_cable_that_slides_askew_turns_to_where_friction_is_less():
    # Friction against S S s / |S s|: the parts of the slip shrink as s_along = s_across^(ratio²).
    ratio, speed = 0.5, 1.0
    from scipy.integrate import solve_ivp

    def rates(t, y):
        v = y[2:]
        size = np.hypot(v[0], ratio * v[1])
        return [*v, *(-FRICTION * GRAVITY * np.array([v[0], ratio**2 * v[1]]) / size)]

    start = [0.0, 0.0, 0.8 * speed, 0.6 * speed]
    solution = solve_ivp(rates, (0.0, 0.2), start, rtol=1e-9, atol=1e-12, dense_output=True)
    across, along = solution.y[2:, -1]
    np.testing.assert_allclose(along / 0.6, (across / 0.8) ** (ratio**2), rtol=1e-6)

    def law(t):
        x, y = solution.sol(t)[:2]
        return np.stack([x, y, 0.0 * x], axis=-1)

    cable = made_of(ratio=ratio)
    engine = EngineWarp(segment_count=SEGMENT_COUNT, rest_speed=0.0)
    state = moving([start[2], start[3], 0.0], RADIUS)
    rollout = engine.rollout(cable, follow(law, 0.2, RADIUS), state, 0.19)
    velocities = rollout.final_state.velocities[0, 1:, :2]
    expected = np.broadcast_to(solution.sol(rollout.times[-1] - 2.5e-4)[2:], velocities.shape)
    np.testing.assert_allclose(velocities, expected, atol=2e-3)


def cast(material=None, count=8, **options):
    """Return landings of some swings of a cable with a material."""
    paths = [sweep(angle, 0.6) for angle in np.linspace(-1.0, 1.0, count)]
    cable = CABLE.with_params(rolling_friction=1e-3, twist_stiffness=1e-4, **(material or {}))
    engine = EngineWarp(segment_count=SEGMENT_COUNT, dt=1e-3, **options)
    return engine.rollout(cable, GripPath.stack(paths))


def test_a_cable_with_a_grain_lands_elsewhere_and_does_not_creep():
    plain = cast().endpoint_xy[:, -1]
    ratios = np.linspace(0.3, 3.0, 8)
    grained = cast(dict(friction_ratio=ratios, drag_coefficient=1.0), rest_speed=0.0)
    assert grained.finite.all()
    moved = np.linalg.norm(grained.endpoint_xy[:, -1] - grained.endpoint_xy[:, -6], axis=1)
    assert moved.max() < 1e-5
    assert np.linalg.norm(grained.endpoint_xy[:, -1] - plain, axis=1).max() > 0.01


def test_a_material_that_does_nothing_changes_no_bit():
    plain = cast().endpoint_xyz
    np.testing.assert_array_equal(cast(dict(friction_ratio=1.0)).endpoint_xyz, plain)
    # A world with neither in a batch with both differs by rounding alone.
    mixed = dict(
        friction_ratio=np.array([1.0] * 7 + [0.5]), drag_coefficient=np.array([0.0] * 7 + [1.0])
    )
    offset = cast(mixed).endpoint_xyz[:7] - plain[:7]
    assert np.median(np.abs(offset)) < 1e-6
    assert np.abs(offset).max() < 1e-3
