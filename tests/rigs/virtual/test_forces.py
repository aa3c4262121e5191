"""Forces beside MuJoCo's: the table's uneven face, and what the cable remembers."""

import dataclasses

import numpy as np
import pytest

from cablecast.cable import Attachment, load_cable
from cablecast.rigs.virtual._hidden import HiddenTable, hidden_cable, hidden_table
from cablecast.rigs.virtual.forces import CELL, GRAVITY, LabForces, friction_map
from cablecast.rigs.virtual.scene import CableMotion, build_scene
from cablecast.workspace import Workspace

COUNT = 21
WORKSPACE = Workspace()
EVEN = friction_map(HiddenTable(seed=0, wear=0.0, board=0.0, seam=0.0), Workspace())
# At 1 m/s the correction has lost (0.01 m/s)² / 2 of itself to the rule that fades it out at rest.
FADING = 1e-4
# A rod of 16 segments bends by chords of an arc.
ARC_TOLERANCE = 0.02
WORLD = np.array([0])


def factor_at(surface, xy):
    """Return the friction of some places of a table as a multiple of the mean."""
    index = np.floor((xy - surface.origin) / CELL).astype(int)
    index = np.clip(index, 0, np.array(surface.factors.shape) - 1)
    return surface.factors[index[..., 0], index[..., 1]]


@pytest.fixture
def cable():
    return load_cable("cable_1")


@pytest.fixture
def truth(cable):
    return dataclasses.replace(hidden_cable(cable, 0, {}), drag=0.0, linear_damping=0.0, curl=0.0)


def lying(cable, speed=(0.0, 0.0), roll_rate=0.0):
    """Return a straight cable along y on the table, moving as a whole."""
    vertices = np.zeros((1, COUNT, 3))
    vertices[0, :, 1] = 0.6 + np.linspace(0.0, cable.length, COUNT)
    vertices[..., 2] = cable.radius
    velocity = np.zeros_like(vertices)
    velocity[..., :2] = speed
    rolls = np.zeros((1, COUNT - 2))
    return CableMotion(
        vertices=vertices, velocity=velocity, roll=rolls, roll_rate=rolls + roll_rate
    )


def forces(cable, truth, friction_map=EVEN, curl=None):
    masses = np.full(COUNT, truth.mass / (COUNT - 1))
    arc = np.linspace(0.0, cable.length, COUNT)
    curl = np.zeros((1, 2, COUNT - 2)) if curl is None else curl
    return LabForces(cable, truth, friction_map, arc, masses, np.array([truth.friction]), curl)


def weight(truth):
    return GRAVITY * truth.mass / (COUNT - 1)


def test_nothing_pulls_at_a_straight_cable_at_rest(cable, truth):
    assert np.all(forces(cable, truth).evaluate(lying(cable), WORLD, 0.002) == 0.0)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_cable_slides_more_easily_along_than_across(cable, truth, sign):
    pull = truth.grain * truth.friction * weight(truth)
    along = forces(cable, truth).evaluate(lying(cable, (0.0, sign * 1.0)), WORLD, 0.002)
    across = forces(cable, truth).evaluate(lying(cable, (sign * 1.0, 0.0)), WORLD, 0.002)
    np.testing.assert_allclose(along[0, :, 1], sign * pull, rtol=FADING)
    np.testing.assert_allclose(across[0, :, 0], -sign * pull, rtol=FADING)
    np.testing.assert_allclose(along[0, :, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(across[0, :, 1], 0.0, atol=1e-12)


def test_a_cable_that_rolls_without_sliding_feels_no_friction(cable, truth):
    rolling = lying(cable, (0.5, 0.0), roll_rate=0.5 / cable.radius)
    force = forces(cable, truth).evaluate(rolling, WORLD, 0.002)
    np.testing.assert_allclose(force, 0.0, atol=1e-9)


def test_rough_places_brake_more_than_smooth_ones_and_none_brakes_a_cable_in_the_air(cable, truth):
    surface = friction_map(HiddenTable(seed=0), WORKSPACE)
    motion = lying(cable, (0.0, 1.0))
    force = forces(cable, truth, surface).evaluate(motion, WORLD, 0.002)[0, :, 1]
    factor = factor_at(surface, motion.vertices[0, 2:, :2])
    expected = -truth.friction * (factor * (1 - truth.grain) - 1) * weight(truth)
    np.testing.assert_allclose(force, expected, rtol=FADING, atol=1e-9)
    assert np.ptp(force) > 0.02 * truth.friction * weight(truth)
    motion.vertices[..., 2] += 0.01
    assert np.all(forces(cable, truth, surface).evaluate(motion, WORLD, 0.002) == 0.0)


def test_friction_never_pushes_a_cable_on(cable, truth):
    # MuJoCo's own friction and the correction together still brake, at every place.
    surface = friction_map(HiddenTable(seed=0), WORKSPACE)
    low = surface.factors.min() * (1 - truth.grain)
    assert low > 0.5


def test_a_curl_is_a_pair_of_end_moments_without_any_force_or_torque_in_sum(cable, truth):
    curl = np.zeros((1, 2, COUNT - 2))
    curl[:, 0, 8:14] = 2.0
    motion = lying(cable)
    force = forces(cable, truth, curl=curl).evaluate(motion, WORLD, 0.0)[0]
    assert np.abs(force).max() > 0.0
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-12)
    torque = np.cross(motion.vertices[0, 2:], force).sum(axis=0)
    np.testing.assert_allclose(torque, 0.0, atol=1e-12)


def test_a_gentle_bend_is_forgotten_and_a_sharp_one_leaves_part_of_itself(cable, truth):
    arc = np.linspace(0.0, cable.length, COUNT)
    for curvature, remembers in (
        (0.8 * truth.yield_curvature, False),
        (1.5 * truth.yield_curvature, True),
    ):
        motion = lying(cable)
        angle = curvature * (arc[1:] - arc[1] / 2)
        motion.vertices[0, 1:, 0] = np.cumsum(arc[1] * np.sin(angle))
        motion.vertices[0, 1:, 1] = 0.6 + np.cumsum(arc[1] * np.cos(angle))
        model = forces(cable, truth)
        for _ in range(5000):
            model.evaluate(motion, WORLD, 0.002)
        left = np.abs(model.curl[0, 0])
        if remembers:
            # What is held long enough yields until the rest is elastic.
            bend = 2.0 * np.tan(curvature * arc[1] / 2) / arc[1]
            np.testing.assert_allclose(left, bend - truth.yield_curvature, rtol=1e-3)
            np.testing.assert_allclose(model.curl[0, 1], 0.0, atol=1e-9)
        else:
            assert np.all(left == 0.0)


@pytest.mark.parametrize("roll", [0.0, np.pi / 2])
def test_a_weightless_cable_rests_on_the_arc_of_its_curl_and_the_arc_turns_with_its_roll(
    cable, truth, roll
):
    mujoco = pytest.importorskip("mujoco")
    bare = dataclasses.replace(cable, attachment=Attachment.NONE)
    # Stiff and damped enough to be at rest after four seconds.
    truth = dataclasses.replace(
        truth, bend_stiffness=0.02, linear_damping=6.0, endpoint_mass=0.0, yield_curvature=1e3
    )
    scene = build_scene(bare, truth, Workspace(grip_height=0.5), 16, 1e-3)
    scene.model.opt.gravity[:] = 0.0
    # Without twist the roll stays where it is put.
    scene.model.flex_bending[1:].reshape(-1, 10)[:, 8] = 0.0
    data = mujoco.MjData(scene.model)
    rolls, rates = scene.roll_slices
    data.qpos[rolls] = roll
    curl = np.zeros((1, 2, len(scene.arc_lengths) - 2))
    curl[:, 0] = 1.5
    model = LabForces(
        bare, truth, EVEN, scene.arc_lengths, scene.masses, np.array([truth.friction]), curl
    )
    for _ in range(2000):
        mujoco.mj_kinematics(scene.model, data)
        mujoco.mj_flex(scene.model, data)
        vertices = data.flexvert_xpos[None]
        velocity = np.zeros_like(vertices)
        velocity[0, 2:] = data.qvel[scene.vertex_slice].reshape(-1, 3)
        motion = CableMotion(
            vertices=vertices.copy(),
            velocity=velocity,
            roll=data.qpos[rolls][None].copy(),
            roll_rate=data.qvel[rates][None].copy(),
        )
        force = model.evaluate(motion, WORLD, 0.002)
        data.qfrc_applied[scene.vertex_slice] = force.ravel()
        mujoco.mj_step(scene.model, data, 2)
    ends = np.diff(data.flexvert_xpos, axis=0)[[1, -1]]
    ends /= np.linalg.norm(ends, axis=1, keepdims=True)
    angle = np.arccos(ends[0] @ ends[1])
    expected = 1.5 * (cable.length - scene.arc_lengths[1])
    # The last edge's direction is that of its middle.
    assert angle == pytest.approx(expected * (1 - 1 / 16), rel=ARC_TOLERANCE)
    aside = np.abs(data.flexvert_xpos[-1] - data.flexvert_xpos[0])[[0, 2]]
    bent, straight = aside if roll == 0.0 else aside[::-1]
    assert bent > 0.1
    assert straight < 0.02


def some_places(count=4000, seed=0):
    rng = np.random.default_rng(seed)
    half = WORKSPACE.table_width / 2
    return np.stack([rng.uniform(-half, half, count), rng.uniform(0, 1.5, count)], axis=1)


def test_friction_differs_from_place_to_place_by_some_per_cent_about_its_mean():
    factors = factor_at(friction_map(hidden_table(0, {}), WORKSPACE), some_places())
    assert abs(factors.mean() - 1.0) < 0.1
    assert 0.03 < factors.std() < 0.2
    assert factors.min() > 0.5


def test_a_table_is_the_same_for_its_seed_and_another_for_another():
    one, again, other = (friction_map(hidden_table(s, {}), WORKSPACE).factors for s in (0, 0, 1))
    np.testing.assert_array_equal(one, again)
    assert np.abs(one - other).max() > 0.05


def test_friction_is_smooth_within_a_board_and_steps_only_at_seams():
    table = dataclasses.replace(hidden_table(0, {}), board=0.0, seam=0.0)
    factors = friction_map(table, WORKSPACE).factors
    # Neighbouring cells are 5 mm apart, a fiftieth of the wear's length.
    assert np.abs(np.diff(factors, axis=0)).max() < 0.02


def test_a_cable_feels_more_friction_on_a_seam():
    flat = HiddenTable(seed=0, wear=0.0, board=0.0)
    factors = friction_map(flat, WORKSPACE).factors
    np.testing.assert_allclose(np.unique(factors), [1.0, 1.0 + flat.seam])
    on_seams = np.mean(factors > 1.0)
    expected = sum(flat.seam_width / size for size in flat.board_size)
    assert on_seams == pytest.approx(expected, rel=0.3)


def test_the_face_of_a_table_moves_and_turns_with_it():
    table, usual = hidden_table(0, {}), friction_map(hidden_table(0, {}), WORKSPACE)
    moved = friction_map(table, Workspace(table_near_y=-0.5))
    turned = friction_map(table, Workspace(table_yaw_deg=90.0))
    rng = np.random.default_rng(0)
    places = np.stack([rng.uniform(-1.37, 1.37, 500), rng.uniform(0.01, 1.49, 500)], axis=1)
    expected = factor_at(usual, places)
    np.testing.assert_array_equal(factor_at(moved, places - [0.0, 0.5]), expected)
    # Turned to the right about its middle, at y = 0.75 m before and 1.375 m after.
    x, y = places.T
    there = factor_at(turned, np.stack([y - 0.75, 1.375 - x], axis=1))
    # A place near the rim of a cell may fall into the next one, 5 mm away, or onto a seam.
    same = np.isclose(there, expected, rtol=0.02)
    assert same.mean() > 0.95


@pytest.mark.parametrize("place", [9.0, -9.0, np.nan])
def test_a_cable_beyond_the_table_or_nowhere_does_not_break_the_map(cable, truth, place):
    motion = lying(cable, (0.0, 1.0))
    motion.vertices[..., 0] = place
    force = forces(cable, truth, friction_map(hidden_table(0, {}), WORKSPACE))
    pull = force.evaluate(motion, WORLD, 0.002)
    assert np.isfinite(pull).all() == np.isfinite(place)
