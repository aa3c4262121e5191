"""Forces that EngineWarp records: tension along the cable, and the pull on its grippers."""

import numpy as np
import pytest
from benchmarks.validation.scenes import LENGTH, MASS, make_cable
from scipy.optimize import brentq

from cablecast.conventions import GRAVITY
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.grip_path import GripPath

WEIGHT = 0.012
CABLE = make_cable(
    twist_stiffness=1e-3,
    bend_stiffness=1e-4,
    endpoint_mass=WEIGHT,
    lateral_friction=0.5,
    worksurface_friction=0.5,
)
COUNT = 40
ALONG = np.linspace(0.0, LENGTH, COUNT + 1)
MIDDLES = 0.5 * (ALONG[1:] + ALONG[:-1])


def engine(**options):
    return EngineWarp(segment_count=COUNT, dt=5e-4, precision="double", table=False, **options)


def hold(position=(0.0, 0.0, 0.0), pitch=0.0):
    return GripPath.hold([*position, 0.0, pitch], 0.1)


def test_a_hanging_cable_pulls_at_each_place_with_the_weight_below_it():
    nodes = np.zeros((1, COUNT + 1, 3))
    nodes[0, :, 2] = -ALONG
    rollout = engine().rollout(
        CABLE,
        hold(pitch=-0.5 * np.pi),
        CableState.at_rest(nodes),
        duration=0.3,
        record_forces=True,
    )
    forces = rollout.forces
    assert np.isnan(forces.grip[:, 0]).all()
    assert forces.far_grip is None
    # Nothing moves: what is left is rounding and the compliance of the length solve.
    below = WEIGHT + MASS * (1.0 - MIDDLES / LENGTH)
    np.testing.assert_allclose(forces.tension[0, -1], GRAVITY * below, rtol=1e-6)
    np.testing.assert_allclose(
        forces.grip[0, -1], [0, 0, -GRAVITY * (MASS + WEIGHT)], rtol=1e-6, atol=1e-9
    )


def test_a_whirling_cable_pulls_as_its_mass_goes_round():
    rate, radius, duration = 6.0, 0.3, 1.5
    nodes, velocities = np.zeros((2, 1, COUNT + 1, 3))
    nodes[0, :, 1] = radius + ALONG
    velocities[0, :, 0] = rate * (radius + ALONG)
    roll = np.zeros((1, COUNT))
    state = CableState(positions=nodes, velocities=velocities, roll=roll, roll_rate=roll)
    times = np.linspace(0.0, duration, 201)
    sin, cos, one = np.sin(rate * times), np.cos(rate * times), np.ones_like(times)
    channels = (
        (radius * sin, radius * cos, 0 * one, rate * times, 0 * one),
        (radius * rate * cos, -radius * rate * sin, 0 * one, rate * one, 0 * one),
        (-radius * rate**2 * sin, -radius * rate**2 * cos, 0 * one, 0 * one, 0 * one),
    )
    poses, rates, accelerations = (np.stack(rows, axis=1)[None] for rows in channels)
    path = GripPath.from_hermite(times[None], poses, rates, accelerations)
    rollout = engine(gravity=0.0).rollout(CABLE, path, state, duration=1.0, record_forces=True)

    def beyond(s):
        """Integral of mass times its distance from the axis, from s to the end, times rate^2."""
        rope = MASS / LENGTH * (radius * (LENGTH - s) + 0.5 * (LENGTH**2 - s**2))
        return rate**2 * (rope + WEIGHT * (radius + LENGTH))

    # Chords of a line that stays straight: only segments and step are finite. Measured: 2e-4.
    np.testing.assert_allclose(rollout.forces.tension[0, -1], beyond(MIDDLES), rtol=1e-3)
    outward = np.array([np.sin(rate * rollout.times[-1]), np.cos(rate * rollout.times[-1]), 0.0])
    np.testing.assert_allclose(rollout.forces.grip[0, -1] @ outward, beyond(0.0), rtol=1e-3)


def test_two_grippers_share_the_weight_and_bear_the_pull_of_a_catenary():
    span = 0.4
    # Half the length is a sinh(half the span / a).
    a = brentq(lambda a: a * np.sinh(0.5 * span / a) - 0.5 * LENGTH, 0.05, 1.0)
    s = ALONG - 0.5 * LENGTH
    nodes = np.zeros((1, COUNT + 1, 3))
    nodes[0, :, 1] = a * np.arcsinh(s / a) + 0.5 * span
    nodes[0, :, 2] = np.hypot(s, a) - np.hypot(0.5 * LENGTH, a)
    slope = np.arctan2(0.5 * LENGTH, a)
    soft = CABLE.with_params(bend_stiffness=1e-7, twist_stiffness=0.0, linear_damping=2.0)
    rollout = engine().rollout(
        soft,
        hold(pitch=-slope),
        CableState.at_rest(nodes),
        duration=4.0,
        far_path=hold((0.0, span, 0.0), pitch=slope),
        record_forces=True,
    )
    forces, density = rollout.forces, MASS / LENGTH
    pull, weight = GRAVITY * density * a, 0.5 * GRAVITY * MASS
    # Damping takes a share of dt / s from gravity itself, and the nodes are a chain's.
    np.testing.assert_allclose(forces.grip[0, -1], [0.0, pull, -weight], rtol=3e-3, atol=1e-6)
    np.testing.assert_allclose(forces.far_grip[0, -1], [0.0, -pull, -weight], rtol=3e-3, atol=1e-6)
    tension = GRAVITY * density * np.hypot(MIDDLES - 0.5 * LENGTH, a)
    np.testing.assert_allclose(forces.tension[0, -1], tension, rtol=3e-3)


def test_along_a_bent_rod_the_tension_is_the_weight_below_as_far_as_it_points_down():
    stiff = CABLE.with_params(bend_stiffness=5e-3, linear_damping=5.0, angular_damping=50.0)
    nodes = np.zeros((1, COUNT + 1, 3))
    nodes[0, :, 1] = ALONG
    rollout = engine().rollout(
        stiff,
        hold(),
        CableState.at_rest(nodes),
        duration=6.0,
        record_forces=True,
        record_nodes=True,
    )
    edges = np.diff(rollout.nodes[0, -1], axis=0)
    fall = -edges[:, 2] / np.linalg.norm(edges, axis=1)
    assert fall[-1] > 0.5  # It is bent.
    below = GRAVITY * (WEIGHT + MASS * (1.0 - MIDDLES / LENGTH))
    # At the clamp the rod is level, and bears its weight across itself.
    np.testing.assert_allclose(rollout.forces.tension[0, -1], below * fall, atol=0.01 * below[0])
    np.testing.assert_allclose(
        rollout.forces.grip[0, -1], [0, 0, -GRAVITY * (MASS + WEIGHT)], rtol=0.02, atol=1e-3
    )


def test_the_force_on_a_moving_grip_is_what_changes_the_momentum_of_the_cable():
    times = np.linspace(0.0, 0.8, 80)
    poses = np.zeros((80, 5))
    poses[:, 0] = 0.15 * np.sin(5.0 * times) ** 2
    poses[:, 2] = 0.1 * (1.0 - np.cos(7.0 * times))
    nodes = np.zeros((1, COUNT + 1, 3))
    nodes[0, :, 1] = ALONG
    dt = 5e-4
    path = GripPath.fit(times, poses)
    rollout = engine().rollout(
        CABLE.with_params(angular_damping=20.0),
        path,
        CableState.at_rest(nodes, twist=2.0),
        duration=0.7,
        sample_dt=dt,
        record_forces=True,
        record_nodes=True,
    )
    mass = np.full(COUNT + 1, MASS / COUNT)
    mass[[0, -1]] *= 0.5
    mass[-1] += WEIGHT
    acceleration = np.diff(rollout.nodes[0], 2, axis=0) / dt**2
    momentum = np.einsum("n,tnc->tc", mass, acceleration)
    momentum[:, 2] += GRAVITY * mass.sum()
    # Second differences end with the step of the force; single steps are rough, ten of them not.
    smooth = np.ones(20) / 20.0
    for axis in range(3):
        expected = np.convolve(momentum[10:, axis], smooth, "valid")
        found = np.convolve(-rollout.forces.grip[0, 12:, axis], smooth, "valid")
        np.testing.assert_allclose(found, expected, atol=0.02 * np.abs(momentum).max())


def test_forces_are_recorded_where_they_are_asked_for_and_change_no_motion():
    cables = [CABLE, CABLE.with_params(mass=0.1)]
    paths = GripPath.stack([hold(), hold()])
    nodes = np.zeros((1, COUNT + 1, 3))
    nodes[0, :, 1] = ALONG
    batch = (cables, paths, CableState.at_rest(nodes))
    plain = engine().rollout(*batch, duration=0.3)
    asked = engine().rollout(*batch, duration=0.3, record_forces=True)
    assert plain.forces is None
    np.testing.assert_array_equal(asked.endpoint_xyz, plain.endpoint_xyz)
    assert asked.forces.tension.shape == (2, len(asked.times), COUNT)
    assert (asked.forces.grip[1, 1:, 2] < asked.forces.grip[0, 1:, 2]).mean() > 0.6


@pytest.mark.parametrize(("stiffness", "warned"), [(1e-3, False), (3e-2, True)])
def test_a_cable_so_stiff_that_rounding_competes_with_friction_is_warned_of(
    stiffness, warned, recwarn
):
    cable = CABLE.with_params(bend_stiffness=stiffness)
    coarse = EngineWarp(segment_count=50)
    coarse.rollout(cable, hold((0.0, 0.6, 0.02)), duration=0.01)
    assert [("may creep" in str(w.message)) for w in recwarn] == [True] * warned
    # A fit's worlds, double precision and a cable in the air are left alone.
    many = cable.with_params(mass=np.full(2, MASS))
    coarse.rollout(many, hold((0.0, 0.6, 0.02)), duration=0.01)
    EngineWarp(segment_count=50, precision="double").rollout(
        cable, hold((0.0, 0.6, 0.02)), duration=0.01
    )
    assert len(recwarn) == int(warned)


def test_single_precision_lets_a_bent_cable_creep_where_it_warns_and_double_holds_it():
    share, friction, mass = 0.95, 0.25, 0.02
    stiffness = np.array([3e-3, 3e-2])
    # Bent so little that friction along a seventh of the cable holds the moment.
    bend = share * friction * mass * GRAVITY * LENGTH**2 * 0.15**2 / 2.0 / stiffness
    angles = bend[:, None] * np.linspace(0.0, 1.0, 50)
    edges = np.stack([np.sin(angles), np.cos(angles), 0 * angles], axis=2) * LENGTH / 50
    nodes = np.pad(np.cumsum(edges, axis=1), ((0, 0), (1, 0), (0, 0)))
    nodes[..., 2] = CABLE.radius
    cables = CABLE.with_params(
        bend_stiffness=stiffness,
        mass=np.full(2, mass),
        endpoint_mass=np.zeros(2),
        rolling_friction=np.full(2, 0.1),
    )
    moved = {}
    for precision in ("single", "double"):
        rollout = EngineWarp(50, 5e-4, precision=precision, rest_speed=0.0).rollout(
            cables,
            hold((0.0, 0.0, CABLE.radius)),
            CableState.at_rest(nodes),
            duration=3.0,
            sample_dt=1.0,
            record_nodes=True,
        )
        shift = np.linalg.norm(rollout.nodes[:, -1] - rollout.nodes[:, 2], axis=2)
        moved[precision] = shift.max(axis=1)
    # Rounding is 0.06 and 0.64 of friction.
    assert moved["single"][0] < 1e-6
    assert moved["single"][1] > 5e-6
    assert moved["double"].max() < 1e-7
