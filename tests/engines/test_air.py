"""Swings in the air: viscous pendulums, falling chains, and a chain of capsules in MuJoCo."""

import numpy as np
import pytest
from benchmarks.validation.scenes import LENGTH, from_edges, hold, make_cable
from tests.engines.grips import smooth

from cablecast.cable import AIR_DENSITY, Cable, CableParams
from cablecast.conventions import GRAVITY
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.grip_path import GripPath

START = np.array([0.0, 0.0, 2.0])
DOWN = hold(START, pitch=-0.5 * np.pi)


def hanging_beam(stiffness, density, element_count=60):
    """Return mass, bending and tension matrices of a beam that hangs from a clamp.

    Cubic Hermite elements from the clamp down; the unknowns are the deflection and the slope at
    each node but the clamped one.
    """
    h = LENGTH / element_count
    points, weights = np.polynomial.legendre.leggauss(4)
    x, weights = 0.5 * (points + 1.0), 0.5 * weights * h
    shape = np.array(
        [1 - 3 * x**2 + 2 * x**3, h * (x - 2 * x**2 + x**3), 3 * x**2 - 2 * x**3, h * (x**3 - x**2)]
    )
    slope = np.array(
        [6 * x**2 - 6 * x, h * (1 - 4 * x + 3 * x**2), 6 * x - 6 * x**2, h * (3 * x**2 - 2 * x)]
    )
    bend = np.array([12 * x - 6, h * (6 * x - 4), 6 - 12 * x, h * (6 * x - 2)]) / h**2
    size = 2 * element_count + 2
    mass, bending, tension = np.zeros((3, size, size))
    for element in range(element_count):
        rows = slice(2 * element, 2 * element + 4)
        pull = density * GRAVITY * (LENGTH - (element + x) * h)
        mass[rows, rows] += density * (shape * weights) @ shape.T
        bending[rows, rows] += stiffness * (bend * weights) @ bend.T
        tension[rows, rows] += (slope / h * weights * pull) @ (slope / h).T
    return mass[2:, 2:], bending[2:, 2:], tension[2:, 2:]


@pytest.mark.parametrize("mode", [0, 1])
@pytest.mark.parametrize("damping_time", [0.02, 0.5])
def test_a_mode_of_a_hanging_cable_decays_as_viscosity_and_weight_let_it(mode, damping_time):
    from scipy.linalg import eigh, expm

    stiffness, density, count, amplitude = 1e-3, 0.05, 40, 5e-3
    mass, bending, tension = hanging_beam(stiffness, density)
    shape = eigh(bending + tension, mass)[1][:, mode]
    shape *= amplitude / shape[-2]
    # M x'' + (T K_bending) x' + (K_bending + K_tension) x = 0, from rest.
    inverse, size = np.linalg.inv(mass), len(mass)
    system = np.block(
        [
            [np.zeros((size, size)), np.eye(size)],
            [-inverse @ (bending + tension), -damping_time * inverse @ bending],
        ]
    )
    dt = 0.01
    step, state, exact = expm(system * dt), np.concatenate([shape, 0 * shape]), []
    for _ in range(101):
        exact.append(state[size - 2])
        state = step @ state
    deflection = np.interp(
        np.linspace(0.0, 1.0, count + 1), np.linspace(0.0, 1.0, 61), [0.0, *shape[::2]]
    )
    slopes = np.arcsin(np.diff(deflection) * count / LENGTH)
    edges = np.stack([np.sin(slopes), 0 * slopes, -np.cos(slopes)], axis=1) * LENGTH / count
    cable = make_cable(bend_stiffness=stiffness, mass=density * LENGTH, damping_time=damping_time)
    engine = EngineWarp(segment_count=count, table=False)
    start = CableState.at_rest(from_edges(edges, START)[None])
    rollout = engine.rollout(cable, DOWN, start, 1.0, dt)
    # The default step, and 40 segments.
    np.testing.assert_allclose(rollout.endpoint_xyz[0, :, 0], exact, rtol=0, atol=0.02 * amplitude)


def test_the_end_of_a_folded_chain_falls_faster_than_a_stone():
    # Calkin and March, Am. J. Phys. 57, 154 (1989): a chain of length L hangs from both ends side
    # by side, and one is let go. Its energy is kept, and half of what has fallen hangs still:
    # v^2 = 2 g y (1 - y / (2 L)) / (1 - y / L).
    from scipy.integrate import quad

    count, gap = 120, 4
    each = LENGTH / count
    half = (count - gap) // 2
    edges = np.zeros((count, 3))
    edges[:half, 2], edges[half : half + gap, 0], edges[half + gap :, 2] = -each, each, each
    state = CableState.at_rest(from_edges(edges, START)[None])
    engine = EngineWarp(segment_count=count, dt=1e-4, table=False)
    limp = make_cable(bend_stiffness=1e-8)
    rollout = engine.rollout(limp, DOWN, state, 0.3, 0.01)
    fallen = START[2] - rollout.endpoint_xyz[0, :, 2]
    share = fallen / LENGTH
    # What is left of the chain at the fold is as wide as the gap.
    shown = (share > 0.05) & (share < 0.85)

    def pace(y):
        return 1.0 / np.sqrt(2.0 * GRAVITY * y * (1.0 - y / (2.0 * LENGTH)) / (1.0 - y / LENGTH))

    times = np.array([quad(pace, 0.0, y)[0] for y in fallen[shown]])
    np.testing.assert_allclose(rollout.times[shown], times, rtol=0.02)
    stone = 0.5 * GRAVITY * rollout.times**2
    assert np.all(fallen[shown][-3:] > 1.05 * stone[shown][-3:])


STIFFNESS, VISCOSITY = 0.01 / 0.015, 0.005 / 0.015
"""Of a joint over the rope's density, in chains with a twenty-fourth of a metre between joints: the
rope of a published benchmark, whose damping time is half a second [m³/s², m³/s]."""


def capsule_chain(rope, count, density):
    """Return MuJoCo's model of a rope: capsules with two hinges a joint, the first one held.

    A carriage far heavier than the rope holds the first capsule by its middle, and moves in a
    plane; the rope ends with the last capsule.
    """
    import mujoco

    spacing = rope.length / (count - 0.5)
    mass = rope.params.mass / (count - 0.5)
    stiffness = rope.params.bend_stiffness / spacing
    capsule = (
        f'<geom type="capsule" fromto="{-spacing / 2} 0 0 {spacing / 2} 0 0" size="{rope.radius}" '
        f'mass="{mass}" contype="0" conaffinity="0"/>'
    )
    hinges = "".join(
        f'<joint type="hinge" pos="{-spacing / 2} 0 0" axis="{axis}" stiffness="{stiffness}" '
        f'damping="{stiffness * rope.params.damping_time}"/>'
        for axis in ("0 1 0", "0 0 1")
    )
    tail = "".join(f'<body pos="{spacing} 0 0">{hinges}{capsule}' for _ in range(count - 1))
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{STEP}" gravity="0 0 {-GRAVITY}" density="{density}"
        integrator="implicitfast"/><worldbody><body gravcomp="1">
        <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
        <joint type="hinge" axis="0 -1 0"/>
        <inertial pos="0 0 0" mass="{HEAVY}" diaginertia="{HEAVY} {HEAVY} {HEAVY}"/>
        <body>{capsule}{tail}{"</body>" * count}</body></worldbody></mujoco>"""
    )


STEP, EVERY, HEAVY = 2.5e-4, 40, 1e5


def drive(model, poses, spacing):
    """Return the end of the rope as the carriage follows poses x, z, pitch [m], [sample, 2]."""
    import mujoco

    data = mujoco.MjData(model)
    rates = np.gradient(poses, STEP, axis=0)
    accelerations = np.gradient(rates, STEP, axis=0)
    ends = []
    for step, (pose, rate, acceleration) in enumerate(
        zip(poses, rates, accelerations, strict=True)
    ):
        data.qpos[:3], data.qvel[:3] = pose, rate
        mujoco.mj_forward(model, data)
        if step % EVERY == 0:
            ends.append(data.xpos[-1] + 0.5 * spacing * data.xmat[-1, ::3])
        data.qfrc_applied[:3] = HEAVY * acceleration
        mujoco.mj_step(model, data)
    return np.array(ends)[:, [0, 2]]


def distance_from_mujoco(count, turn, with_air, segment_count=98):
    """Return the mean distance of the ends of a rope in both engines over two seconds [m].

    The grip points down, swings up by some angle [rad] within 0.6 s, and stays.
    """
    spacing, density = 1.0 / 24, 0.05
    rope = Cable(
        name="rope",
        length=24.5 * spacing,
        diameter=0.02 if with_air else 0.01,
        params=CableParams(
            bend_stiffness=STIFFNESS * density * spacing,
            mass=24.5 * density * spacing,
            damping_time=VISCOSITY / STIFFNESS,
        ),
    )
    chain = capsule_chain(rope, count, AIR_DENSITY * with_air)
    own = rope.length / (count - 0.5)
    if with_air:
        # A capsule drags as the box of its moments of inertia.
        inertia = chain.body_inertia[-1] / chain.body_mass[-1]
        width = np.sqrt(6.0 * inertia.min())
        along = np.sqrt(6.0 * (2.0 * inertia.max() - inertia.min()))
        drag = width * along / (rope.diameter * own)
        rope = rope.with_params(drag_coefficient=drag, drag_ratio=width / along)
    times = np.arange(0.0, 2.0, STEP)
    pitch = -0.5 * np.pi + turn * smooth(times / 0.6)
    poses = np.stack([0.6 * np.cos(pitch), 1.5 + 0.6 * np.sin(pitch), pitch], axis=1)
    ends = drive(chain, poses, own)
    level = 0.0 * times
    path = np.stack([level, poses[:, 0], poses[:, 1], level, pitch], axis=1)
    path = GripPath.fit(times[::20], path[::20])
    engine = EngineWarp(segment_count=segment_count, table=False, dt=STEP)
    state = CableState.hanging(rope, path, segment_count)
    ours = engine.rollout(rope, path, state, 2.0, EVERY * STEP).endpoint_xyz[0, : len(ends), 1:]
    return np.linalg.norm(ours - ends, axis=1).mean()


def test_chains_of_capsules_in_mujoco_come_nearer_as_they_are_refined():
    # MuJoCo's chains are of first order in their spacing: 2.2, 0.7 and 0.4 cm with 25, 50 and 100.
    coarse, fine = (distance_from_mujoco(count, 2.0, False) for count in (12, 25))
    assert fine < 0.03
    assert fine < 0.5 * coarse


def test_a_rope_is_dragged_as_a_chain_of_capsules_in_mujoco():
    assert distance_from_mujoco(25, 1.0, True) < 0.005


@pytest.mark.parametrize("damping_time", [0.02, 0.5])
def test_a_viscous_swing_converges_with_the_square_of_the_step(damping_time):
    cable = make_cable(bend_stiffness=1e-3, damping_time=damping_time, drag_coefficient=1.0)
    times = np.linspace(0.0, 0.6, 61)
    pitch = -0.5 * np.pi + 2.0 * smooth(times / 0.6)
    level = 0.0 * times
    path = [level, 0.6 * np.cos(pitch), 1.5 + 0.6 * np.sin(pitch), level, pitch]
    path = GripPath.fit(times, np.stack(path, axis=1))
    state = CableState.hanging(cable, path, 25)

    def end(dt):
        engine = EngineWarp(segment_count=25, table=False, dt=dt)
        return engine.rollout(cable, path, state, 1.5, 0.02).endpoint_xyz[0]

    truth = end(6.25e-5)
    coarse, fine = (np.linalg.norm(end(dt) - truth, axis=1).mean() for dt in (1e-3, 5e-4))
    assert coarse < 0.01 * LENGTH
    assert fine < 0.35 * coarse
