"""Frames of EngineWarp: twist, the far grip, cables that hang, and none of them near a table."""

import dataclasses

import numpy as np
import pytest
from benchmarks.validation.scenes import LENGTH, make_cable
from tests.engines.grips import smooth

from cablecast.engines import make_engine
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.engines.warp_.material import rest_bends
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath

SEGMENT_COUNT, MASS = 30, 0.03
DOWN = -0.5 * np.pi
CABLE = make_cable(
    twist_stiffness=1e-4,
    bend_stiffness=1e-2,
    mass=MASS,
    lateral_friction=0.5,
    worksurface_friction=0.5,
    angular_damping=50.0,
)
MIDDLES = (np.arange(SEGMENT_COUNT) + 0.5) / SEGMENT_COUNT


def straight(direction=(0.0, 1.0, 0.0)):
    """Return the nodes of a straight cable that begins at the origin [m], [1, node, 3]."""
    return np.linspace(0.0, LENGTH, SEGMENT_COUNT + 1)[:, None] * np.asarray(direction)[None, None]


def hold(position=(0.0, 0.0, 0.0), yaw=0.0, pitch=0.0):
    return GripPath.hold([*position, yaw, pitch], 0.1)


def moved(turn=None, **channels):
    """Return a grip whose channels follow functions of time for a second."""
    times = np.linspace(0.0, 1.0, 60)
    poses = np.zeros((60, 5))
    for name, values in channels.items():
        poses[:, ("x", "y", "z", "yaw", "pitch").index(name)] = values(times)
    return GripPath.fit(times, poses, None if turn is None else turn * smooth(times))


def play(cable, path, state, duration, gravity=0.0, precision="double", **options):
    # Few kernels, as each takes long to compile.
    engine = EngineWarp(
        segment_count=SEGMENT_COUNT, gravity=gravity, precision=precision, table=False
    )
    return engine.rollout(cable, path, state, duration, **options)


def test_a_cable_without_a_table_moves_as_one_high_above_it():
    nodes = straight((0.6, 0.0, 0.8))
    low = play(CABLE, hold(yaw=0.5), CableState.at_rest(nodes), 1.0, gravity=9.81)
    above = np.array([0.0, 0.0, 3.0])
    engine = EngineWarp(segment_count=SEGMENT_COUNT, precision="double", rest_speed=0.0)
    high = engine.rollout(CABLE, hold(above, yaw=0.5), CableState.at_rest(nodes + above), 1.0)
    assert low.endpoint_xyz[0, :, 2].min() < -0.3
    # The length solve stops at a tolerance, which rounding may cross.
    np.testing.assert_allclose(low.endpoint_xyz + above, high.endpoint_xyz, atol=1e-5)


def test_without_a_table_nothing_comes_to_rest():
    # So slow that a cable above a table would count as at rest.
    state = CableState.at_rest(straight())
    state.velocities[0, 1:, 0] = 1e-4 * np.linspace(0.0, 1.0, SEGMENT_COUNT)
    limp = CABLE.with_params(bend_stiffness=0.0, twist_stiffness=0.0, angular_damping=0.0)
    rollout = play(limp, hold(), state, 2.0)
    np.testing.assert_allclose(rollout.endpoint_xyz[0, -1, 0], 2e-4, rtol=0.01)


@pytest.mark.parametrize("start", ["even", "at the far end"])
def test_a_twisted_cable_between_two_grips_is_twisted_evenly(start):
    turn = 3.0
    state = CableState.at_rest(straight(), twist=turn)
    if start != "even":
        state = dataclasses.replace(state, roll=np.zeros_like(state.roll))
    rollout = play(CABLE, hold(), state, 2.0, far_path=hold((0.0, LENGTH, 0.0)))
    # What still swings after 2 s of damping at 25 1/s is nothing.
    np.testing.assert_allclose(rollout.final_state.roll[0], turn * MIDDLES, atol=1e-9)
    np.testing.assert_allclose(rollout.final_state.far_roll, turn, atol=1e-9)
    np.testing.assert_allclose(rollout.final_state.positions, straight(), atol=1e-9)


@pytest.mark.parametrize("far_turn", [0.0, 2.0])
def test_grips_that_roll_twist_the_cable_by_their_difference(far_turn):
    turn = 0.5
    far = moved(far_turn, y=lambda t: LENGTH + 0 * t)
    rollout = play(CABLE, moved(turn), CableState.at_rest(straight()), 3.0, far_path=far)
    # Counted from the grip.
    np.testing.assert_allclose(rollout.final_state.far_roll, far_turn - turn, atol=1e-6)
    expected = (far_turn - turn) * MIDDLES
    np.testing.assert_allclose(rollout.final_state.roll[0], expected, atol=1e-6)


def test_a_twisted_cable_goes_on_from_its_final_state():
    path, far = moved(1.0), moved(z=lambda t: -0.1 * smooth(t), y=lambda t: LENGTH - 0.05 * t)
    start = CableState.at_rest(straight(), twist=2.0)
    whole = play(CABLE, path, start, 3.0, far_path=far).final_state
    first = play(CABLE, path, start, 2.0, far_path=far).final_state
    last = hold(far.evaluate([1.0])[0, 0, :3])
    after = play(CABLE, hold(), first, 1.0, far_path=last).final_state
    np.testing.assert_allclose(after.far_roll, whole.far_roll, atol=1e-3)
    np.testing.assert_allclose(after.roll, whole.roll, atol=1e-3)
    np.testing.assert_allclose(after.positions, whole.positions, atol=1e-3)


def test_the_direction_of_the_far_grip_is_that_in_which_the_cable_arrives():
    # Clamped level at the grip and at a slope at the far end, no heights apart: a cubic.
    slope = 0.1
    span = LENGTH / (1.0 + slope**2 / 15.0)
    y = np.linspace(0.0, span, 400)
    cubic = slope * y**2 * (y - span) / span**2
    nodes = np.zeros((1, SEGMENT_COUNT + 1, 3))
    arc = np.append(0.0, np.cumsum(np.hypot(np.diff(y), np.diff(cubic))))
    at = np.linspace(0.0, arc[-1], SEGMENT_COUNT + 1)
    nodes[0, :, 1], nodes[0, :, 2] = np.interp(at, arc, y), 0.5 * np.interp(at, arc, cubic)
    damped = CABLE.with_params(linear_damping=5.0)
    far = hold((0.0, span, 0.0), pitch=np.arctan(slope))
    rollout = play(damped, hold(), CableState.at_rest(nodes), 4.0, far_path=far)
    final = rollout.final_state.positions[0]
    expected = np.interp(final[:, 1], y, cubic)
    # A fold of the far direction by half a turn would be off by metres; segments by 1e-3 of it.
    np.testing.assert_allclose(final[:, 2], expected, atol=0.03 * np.abs(cubic).max())


def test_a_scene_that_is_turned_to_hang_straight_down_moves_alike():
    # A curled, damped and twisted cable that nods and rolls: about the level, and about straight
    # down, through which its direction passes to and fro.
    cable = CABLE.with_params(angular_damping=5.0, rest_curvature=1.5, damping_time=0.01)
    results = []
    for pitch in (0.0, DOWN):
        turned = np.array(
            [
                [1.0, 0.0, 0.0],
                [0.0, np.cos(pitch), -np.sin(pitch)],
                [0.0, np.sin(pitch), np.cos(pitch)],
            ]
        )
        path = moved(2.0, pitch=lambda t, p=pitch: p + 0.3 * np.sin(7.0 * t))
        state = CableState.at_rest(straight() @ turned.T)
        rollout = play(cable, path, state, 2.0, precision="single")
        results.append((rollout.final_state.positions[0] @ turned, rollout.final_state.roll[0]))
    (level, roll), (hanging, hanging_roll) = results
    assert np.abs(level[:, 0]).max() > 0.02
    # Single precision, in other directions.
    np.testing.assert_allclose(hanging, level, atol=2e-4)
    np.testing.assert_allclose(hanging_roll, roll, atol=2e-3)


@pytest.mark.parametrize("pitch", [0.0, DOWN, 0.5 * np.pi])
def test_a_curl_has_a_side_however_the_cable_lies_at_the_grip(pitch):
    # To the left of the grip, along which the curl bends the cable, and elsewhere.
    path = hold(pitch=pitch)
    for direction in ((-1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (0.3, 0.2, -0.8)):
        nodes = straight(np.asarray(direction) / np.linalg.norm(direction))
        bends = rest_bends(nodes, np.zeros((1, SEGMENT_COUNT)), path, np.array([2.0]), 0.01)
        size = np.linalg.norm(bends[0, 1:-1], axis=1)
        np.testing.assert_allclose(size, 2.0 * 0.01**2, rtol=1e-9)
        np.testing.assert_allclose(bends[0] @ np.asarray(direction), 0.0, atol=1e-12)


@pytest.mark.parametrize(("level", "turn"), [(False, 0.0), (True, -2.0)])
def test_a_yaw_of_a_grip_that_points_straight_down_is_a_roll_or_nothing(level, turn):
    path = moved(yaw=lambda t: 2.0 * smooth(t), pitch=lambda t: DOWN + 0 * t)
    far = hold((0.0, 0.0, -LENGTH), pitch=DOWN)
    state = CableState.at_rest(straight((0.0, 0.0, -1.0)))
    rollout = play(CABLE, path.levelled() if level else path, state, 2.0, far_path=far)
    # Seen from the grip, which turned right-handed about the cable, the far end turned back.
    np.testing.assert_allclose(rollout.final_state.roll[0], turn * MIDDLES, atol=1e-6)
    np.testing.assert_allclose(rollout.final_state.positions, state.positions, atol=1e-9)


def test_engines_that_let_the_far_end_turn_refuse_a_twist():
    state = CableState.at_rest(straight() + [0.0, 0.0, 1.0], twist=1.0)
    engine = make_engine("mujoco", segment_count=SEGMENT_COUNT)
    near, far = hold((0.0, 0.0, 1.0)), hold((0.0, LENGTH, 1.0))
    with pytest.raises(InputError, match="lets the far end turn"):
        engine.rollout(CABLE, near, state, 0.1, far_path=far)


def lengths_and_diameters(cable=CABLE):
    """Return cables that differ in length and diameter."""
    return [
        dataclasses.replace(cable, length=length, diameter=diameter)
        for length, diameter in ((0.4, 0.01), (0.6, 0.004), (0.75, 0.02))
    ]


def test_a_cable_of_a_batch_is_cast_as_it_is_alone():
    limp = CABLE.with_params(bend_stiffness=5e-4, rolling_friction=1e-3, spinning_friction=1e-3)
    cables = lengths_and_diameters(limp)
    path = GripPath.fit(
        np.linspace(0.0, 0.5, 20),
        np.array(
            [
                [0.4 * smooth(2 * t), 0.6, 0.02, smooth(2 * t), 0.0]
                for t in np.linspace(0.0, 0.5, 20)
            ]
        ),
    )
    engine = EngineWarp(segment_count=20, dt=1e-3)
    together = engine.rollout(cables, path)
    for world, cable in enumerate(cables):
        alone = engine.rollout(cable, path)
        np.testing.assert_array_equal(together.endpoint_xyz[world], alone.endpoint_xyz[0])
        # Its own radius is the height at which it lies.
        lowest = together.final_state.positions[world, -1, 2]
        np.testing.assert_allclose(lowest, cable.radius, atol=2e-4)
    assert np.ptp(together.endpoint_xy[:, -1], axis=0).min() > 0.02


@pytest.mark.parametrize(
    ("cables", "message"),
    [
        ([], "needs a cable"),
        (lengths_and_diameters()[:2], "different numbers of worlds"),
        (
            [CABLE.with_params(damping_time=np.ones(3))] * 3,
            "parameters for each world",
        ),
    ],
)
def test_cables_that_make_no_batch_are_refused(cables, message):
    paths = GripPath.stack([hold()] * 3)
    with pytest.raises(InputError, match=message):
        EngineWarp().rollout(cables, paths)


def test_engines_of_one_cable_refuse_several():
    with pytest.raises(InputError, match="one cable at a time, not 3"):
        make_engine("mujoco").rollout(lengths_and_diameters(), hold())
