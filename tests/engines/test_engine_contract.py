"""What every engine must do, whatever it is made of."""

import dataclasses
import functools
import subprocess
import sys

import numpy as np
import pytest
from tests.engines.grips import sweep

from cablecast.cable import CableParams, load_cable
from cablecast.engines import ENGINE_NAMES, make_engine
from cablecast.engines.base import CableState, reset_state
from cablecast.errors import InputError, MissingExtraError, UnknownNameError
from cablecast.motion.grip_path import GripPath

SEGMENT_COUNT = 10
SAMPLE_DT = 0.1
DURATION = 0.6
"""Long enough for the sweep below to move the endpoint by decimetres [s]."""

# A hand that is a driven body lags a little; EngineWarp computes in single precision by default.
GRIP_TOLERANCE = 5e-4
# EngineWarp holds lengths to 1e-3 and the articulated body exactly; MuJoCo's are stiff springs.
LENGTH_TOLERANCE = 5e-3
# PyBullet's iterative solver leaves the point constraint of the far end a little open.
FAR_TOLERANCE = 5e-3
# Below this speed a node on the table counts as at rest: Bullet's friction is regularised [m/s].
REST_SPEED = 5e-3
# Contacts solved one after the other break the symmetry of the last bits, and the motion makes more
# of it; Bullet's solver stops early, and its friction pyramid has axes of its own [m].
MIRROR_TOLERANCE = {"warp": 1e-4, "mujoco": 2e-3, "pybullet": 3e-2}

CABLE = load_cable("cable_1")


@functools.cache
def engine(name: str):
    pytest.importorskip(name)
    return make_engine(name, segment_count=SEGMENT_COUNT)


@pytest.fixture(params=ENGINE_NAMES)
def name(request) -> str:
    engine(request.param)
    return request.param


@functools.cache
def swept(name: str):
    """Two sweeps and a still grip, shared by the tests that only look."""
    paths = GripPath.stack([sweep(0.5), sweep(-0.3), sweep(0.0)])
    rollout = engine(name).rollout(
        CABLE, paths, duration=DURATION, sample_dt=SAMPLE_DT, record_nodes=True
    )
    return paths, rollout


def test_a_rollout_has_one_row_per_world_and_one_column_per_sample(name):
    _, rollout = swept(name)
    node_count = SEGMENT_COUNT + 1
    # The step need not divide the sample interval, but comes within half a step of it.
    np.testing.assert_allclose(np.diff(rollout.times), SAMPLE_DT, atol=1.1e-3)
    assert rollout.times[0] == 0.0
    assert rollout.times[-1] >= DURATION - SAMPLE_DT / 2
    assert rollout.nodes.shape == (3, len(rollout.times), node_count, 3)
    assert rollout.final_state.velocities.shape == (3, node_count, 3)
    assert rollout.final_state.roll.shape == (3, SEGMENT_COUNT)
    assert rollout.finite.tolist() == [True, True, True]
    np.testing.assert_array_equal(rollout.endpoint_xyz, rollout.nodes[:, :, -1])
    np.testing.assert_allclose(rollout.final_state.positions, rollout.nodes[:, -1], atol=1e-6)


def test_the_default_duration_is_the_longest_motion_and_two_seconds(name):
    path = GripPath.stack([sweep(0.0, 0.2), sweep(0.0, 0.1)])
    rollout = engine(name).rollout(CABLE, path)
    assert rollout.times[-1] == pytest.approx(2.2, abs=SAMPLE_DT)
    assert rollout.nodes is None


def test_the_reset_state_is_the_default_initial_state(name):
    paths, rollout = swept(name)
    state = reset_state(CABLE, paths, SEGMENT_COUNT)
    # An articulated body loses what the stretch of the given state differs from zero.
    np.testing.assert_allclose(rollout.nodes[:, 0], state.positions, atol=1e-5)


def test_the_near_end_follows_the_grip_path(name):
    paths, rollout = swept(name)
    expected = paths.evaluate(rollout.times)[..., :3]
    np.testing.assert_allclose(rollout.nodes[:, :, 0], expected, atol=GRIP_TOLERANCE)


def test_segments_keep_their_length(name):
    _, rollout = swept(name)
    lengths = np.linalg.norm(np.diff(rollout.nodes, axis=2), axis=-1)
    np.testing.assert_allclose(lengths, CABLE.length / SEGMENT_COUNT, rtol=LENGTH_TOLERANCE)


def test_a_sweep_throws_the_endpoint_and_a_still_grip_leaves_it(name):
    _, rollout = swept(name)
    moved = np.linalg.norm(rollout.endpoint_xy[:, -1] - rollout.endpoint_xy[:, 0], axis=1)
    assert moved[0] > 0.1
    assert moved[1] > 0.03
    # The descent from the grip is that of a continuous beam, and settles by a millimetre or so.
    assert moved[2] < 5e-3


def test_shared_arguments_are_the_same_as_repeated_ones(name):
    path = sweep(0.4)
    values = np.tile(CABLE.params.to_array(), (2, 1))
    state = reset_state(CABLE, path, SEGMENT_COUNT)
    twice = CableState(
        **{f.name: np.repeat(getattr(state, f.name), 2, axis=0) for f in dataclasses.fields(state)}
    )
    options = {"duration": 0.3, "sample_dt": SAMPLE_DT}
    shared = engine(name).rollout(CABLE, path, **options)
    repeated = engine(name).rollout(
        CABLE.with_params(CableParams.from_array(values)),
        GripPath.stack([path, path]),
        twice,
        **options,
    )
    assert len(shared.endpoint_xyz) == 1
    for world in range(2):
        np.testing.assert_array_equal(repeated.endpoint_xyz[world], shared.endpoint_xyz[0])


def test_parameters_of_each_world_count_for_it_alone(name):
    values = np.tile(CABLE.params.to_array(), (2, 1))
    values[1, CableParams.names().index("mass")] *= 4.0
    values[1, CableParams.names().index("bend_stiffness")] *= 2.0
    params = CableParams.from_array(values)
    path = sweep(0.4)
    both = engine(name).rollout(CABLE.with_params(params), path, duration=0.4)
    for world in range(2):
        alone = engine(name).rollout(
            CABLE.with_params(CableParams.from_array(values[world])), path, duration=0.4
        )
        np.testing.assert_array_equal(both.endpoint_xyz[world], alone.endpoint_xyz[0])
    assert np.linalg.norm(both.endpoint_xyz[0, -1] - both.endpoint_xyz[1, -1]) > 1e-3


def test_the_same_input_gives_the_same_output(name):
    paths, rollout = swept(name)
    again = engine(name).rollout(CABLE, paths, duration=DURATION, sample_dt=SAMPLE_DT)
    np.testing.assert_array_equal(again.endpoint_xyz, rollout.endpoint_xyz)


def test_a_mirrored_motion_has_a_mirrored_outcome(name):
    paths, rollout = swept(name)
    mirrored = engine(name).rollout(CABLE, paths.mirrored(), duration=DURATION, sample_dt=SAMPLE_DT)
    expected = rollout.endpoint_xyz * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(mirrored.endpoint_xyz, expected, atol=MIRROR_TOLERANCE[name])


def test_the_endpoint_comes_to_rest(name):
    rollout = engine(name).rollout(CABLE, sweep(0.4), duration=1.6)
    moved = np.linalg.norm(rollout.endpoint_xyz[0, -1] - rollout.endpoint_xyz[0, -2])
    assert moved < REST_SPEED * SAMPLE_DT
    assert abs(rollout.endpoint_xyz[0, -1, 2] - CABLE.radius) < 2e-3


def test_an_initial_state_is_taken_up_with_its_velocities(name):
    # Free flight: the whole cable and the grip move at the same velocity, far above the table.
    velocity = np.array([0.5, 0.2, 0.0])
    times = np.linspace(0.0, 0.3, 20)
    fall = -0.5 * 9.81 * times**2
    poses = np.zeros((20, 5))
    poses[:, :3] = np.array([0.0, 0.6, 2.0]) + times[:, None] * velocity
    poses[:, 2] += fall
    params = dataclasses.replace(CABLE.params, linear_damping=0.0)
    path = GripPath.fit(times, poses)
    nodes = np.zeros((1, SEGMENT_COUNT + 1, 3)) + poses[0, :3]
    nodes[0, :, 1] += np.linspace(0.0, CABLE.length, SEGMENT_COUNT + 1)
    state = dataclasses.replace(
        CableState.at_rest(nodes), velocities=np.zeros_like(nodes) + velocity
    )
    rollout = engine(name).rollout(
        CABLE.with_params(params), path, state, duration=0.3, sample_dt=0.1, record_nodes=True
    )
    moved = path.evaluate(rollout.times)[:, :, None, :3] - poses[0, :3]
    # Bullet's first step of a free fall is off by half a step, 1/480 s x 3 m/s x 1/2.
    inside = rollout.times <= 0.3 + 1e-9
    expected = (nodes[:, None] + moved)[:, inside]
    np.testing.assert_allclose(rollout.nodes[:, inside], expected, atol=5e-3)


def test_a_held_far_end_follows_its_own_path(name):
    path = GripPath.hold([0.0, 0.6, 0.3, 0.0, 0.0], 0.3)
    times = np.linspace(0.0, 0.3, 20)
    poses = np.zeros((20, 5))
    poses[:, :3] = [0.0, 0.6 + CABLE.length, 0.3]
    poses[:, 1] -= 0.1 * (1.0 - np.cos(np.pi * times / 0.3)) / 2
    far = GripPath.fit(times, poses)
    nodes = np.zeros((1, SEGMENT_COUNT + 1, 3)) + [0.0, 0.6, 0.3]
    nodes[0, :, 1] += np.linspace(0.0, CABLE.length, SEGMENT_COUNT + 1)
    rollout = engine(name).rollout(
        CABLE, path, CableState.at_rest(nodes), duration=0.3, far_path=far
    )
    expected = far.evaluate(rollout.times)[..., :3]
    np.testing.assert_allclose(rollout.endpoint_xyz, expected, atol=FAR_TOLERANCE)


def test_a_world_that_is_not_finite_is_marked_and_spoils_no_other(name):
    paths, good = swept(name)
    state = reset_state(CABLE, paths, SEGMENT_COUNT)
    state.positions[1, 4] = np.nan
    rollout = engine(name).rollout(CABLE, paths, state, duration=DURATION, sample_dt=SAMPLE_DT)
    assert rollout.finite.tolist() == [True, False, True]
    assert np.isnan(rollout.endpoint_xyz[1, 1:]).all()
    np.testing.assert_array_equal(rollout.endpoint_xyz[[0, 2]], good.endpoint_xyz[[0, 2]])


def test_arguments_of_different_sizes_are_refused(name):
    values = np.tile(CABLE.params.to_array(), (2, 1))
    paths = GripPath.stack([sweep(0.1)] * 3)
    with pytest.raises(InputError, match="different numbers of worlds"):
        engine(name).rollout(CABLE.with_params(CableParams.from_array(values)), paths, duration=0.1)


def test_an_initial_state_with_other_segments_is_refused(name):
    state = reset_state(CABLE, sweep(0.1), SEGMENT_COUNT + 1)
    with pytest.raises(InputError, match="segments"):
        engine(name).rollout(CABLE, sweep(0.1), state, duration=0.1)


@pytest.mark.parametrize(
    "options",
    [{"duration": 0.0}, {"duration": np.inf}, {"duration": 0.1, "sample_dt": -0.1}],
    ids=str,
)
def test_a_duration_or_interval_out_of_bounds_is_refused(name, options):
    with pytest.raises(InputError, match=r"(duration|sample_dt) = .* s is outside"):
        engine(name).rollout(CABLE, sweep(0.1), **options)


@pytest.mark.parametrize("options", [{"segment_count": 1}, {"dt": 0.0}, {"dt": 1.0}])
def test_a_count_or_step_out_of_bounds_is_refused(name, options):
    with pytest.raises(InputError, match="outside"):
        make_engine(name, **options)


def test_an_engine_that_does_not_exist_is_refused_with_those_that_do():
    with pytest.raises(UnknownNameError, match="warp, mujoco, pybullet"):
        make_engine("bullet")


@pytest.mark.parametrize("name", ["mujoco", "pybullet"])
def test_an_engine_whose_library_is_missing_says_what_to_install(name, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, f"{name}.batch", None)
    with pytest.raises(MissingExtraError, match=rf"cablecast\[{name}\]"):
        make_engine(name)


@pytest.mark.parametrize("name", ["mujoco", "pybullet"])
def test_only_the_fast_engine_runs_on_another_device(name):
    with pytest.raises(InputError, match="cpu only"):
        make_engine(name, device="cuda")


def test_naming_the_engines_imports_none_of_their_libraries():
    code = (
        "import sys, cablecast.engines\n"
        "print(sorted({'warp', 'mujoco', 'pybullet'} & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
