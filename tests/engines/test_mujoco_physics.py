"""The physics of EngineMujoco against closed forms."""

import dataclasses

import numpy as np
import pytest
from benchmarks.validation.scenes import LENGTH, MASS, RADIUS, make_cable, straight
from benchmarks.validation.shape import heavy_elastica

from cablecast.motion.grip_path import GripPath

mujoco = pytest.importorskip("mujoco")

from cablecast.engines.mujoco_ import EngineMujoco  # noqa: E402

GRAVITY = 9.81


def sideways(distance_at, duration) -> GripPath:
    """Return a grip that lies on the table and moves along x by a law."""
    times = np.linspace(0.0, duration, 200)
    poses = np.zeros((200, 5))
    poses[:, 0] = distance_at(times)
    poses[:, 2] = RADIUS
    return GripPath.fit(times, poses)


def test_a_clamped_cable_hangs_as_the_heavy_elastica():
    bend_stiffness = 2e-2
    c = make_cable(bend_stiffness=bend_stiffness, linear_damping=5.0, angular_damping=50.0)
    path = GripPath.hold([0, 0, 2, 0, 0], 1.0)
    rollout = EngineMujoco(24).rollout(c, path, straight(24, (0, 0, 2.0), (0, 1, 0)), duration=5.0)
    tip = rollout.endpoint_xyz[0, -1, 1:] - [0.0, 2.0]
    expected = heavy_elastica(bend_stiffness, MASS * GRAVITY / LENGTH)[-1]
    assert expected[1] < -0.2  # it does hang far
    # Half a cell at the clamp makes the error second order in the segment: 0.05 % at 24.
    np.testing.assert_allclose(tip, expected, atol=1e-3 * LENGTH)


def test_a_cable_sliding_sideways_stops_after_v_squared_over_2_mu_g():
    speed, friction = 1.0, 0.4
    stop = speed / (friction * GRAVITY)
    # Some bending keeps neighbours together, which hop by a millimetre at their own instants each.
    c = make_cable(lateral_friction=friction, bend_stiffness=1e-3)
    path = sideways(lambda t: speed * t - 0.5 * friction * GRAVITY * t**2, stop)
    state = straight(12, (0, 0, RADIUS), (0, 1, 0), (speed, 0, 0))
    engine = EngineMujoco(12, 2.5e-4, rolling=False)
    rollout = engine.rollout(c, path, state, duration=0.4)
    expected = speed**2 / (2 * friction * GRAVITY)
    moved = rollout.final_state.positions[0, :, 0]
    np.testing.assert_allclose(moved, expected, rtol=5e-3)


def test_a_cable_pushed_sideways_ends_up_rolling_at_two_thirds_of_its_speed():
    speed, friction = 0.6, 0.4
    slip = speed / 3 / (friction * GRAVITY)

    def moved(t):
        sliding = speed * t - 0.5 * friction * GRAVITY * t**2
        rolling = speed * slip - 0.5 * friction * GRAVITY * slip**2 + 2 / 3 * speed * (t - slip)
        return np.where(t < slip, sliding, rolling)

    c = make_cable(lateral_friction=friction)
    state = straight(10, (0, 0, RADIUS), (0, 1, 0), (speed, 0, 0))
    rollout = EngineMujoco(10, 2.5e-4).rollout(
        c, sideways(moved, 0.25), state, duration=0.25, sample_dt=0.05
    )
    final = rollout.final_state
    # The path's spline smooths the corner at the end of slipping, which leaves 1 %. MuJoCo
    # turns a segment by what touches its near node, which is the grip for the first; the last node
    # has half a segment's mass and turns a whole one.
    np.testing.assert_allclose(final.velocities[0, 1:-2, 0], 2 / 3 * speed, rtol=0.02)
    np.testing.assert_allclose(final.roll_rate[0, 1:-2], 2 / 3 * speed / RADIUS, rtol=0.02)


def test_a_twisted_cable_swings_at_its_torsional_frequency():
    # Clamped and free: the first mode is sin(pi s / 2 L) at pi / (2 L) sqrt(GJ / (I / L)).
    segment_count, stiffness = 24, 3e-4
    c = make_cable(twist_stiffness=stiffness)
    inertia = 0.5 * MASS / LENGTH * RADIUS**2
    period = 4.0 * LENGTH / np.sqrt(stiffness / inertia)
    middle = (np.arange(segment_count) + 0.5) / segment_count
    state = straight(segment_count, (0, 0, 1.0), (0, 1, 0))
    mode = 0.3 * np.sin(0.5 * np.pi * middle)[None]
    state = dataclasses.replace(state, roll=mode)
    path = GripPath.hold([0, 0, 1, 0, 0], 1.0)
    engine = EngineMujoco(segment_count, period / 2000, gravity=0.0)
    rollout = engine.rollout(c, path, state, duration=period / 4, sample_dt=period / 4)
    final = rollout.final_state
    # The implicit step takes a fraction pi^2 dt / (2 period) = 0.25 % of the swing.
    assert np.abs(final.roll).max() < 0.01 * mode.max()
    np.testing.assert_allclose(final.roll_rate, -2 * np.pi / period * mode, rtol=0.01)


def test_a_stopped_cable_can_be_taken_up_again():
    # MuJoCo counts the roll from frames of its own, which begin anew with the second rollout.
    c = make_cable(bend_stiffness=3e-4, twist_stiffness=3e-4, lateral_friction=0.4)
    times = np.linspace(0.0, 1.0, 80)
    poses = np.zeros((80, 5))
    poses[:, 0] = 0.3 * np.sin(np.pi * times) ** 2
    poses[:, 3] = 1.2 * np.sin(np.pi * times) ** 2
    poses[:, 2] = 0.03
    engine = EngineMujoco(12)
    path = GripPath.fit(times, poses)
    whole = engine.rollout(c, path, duration=0.6)
    half = engine.rollout(c, path, duration=0.5)
    assert np.abs(half.final_state.roll).max() > 0.05
    later = np.linspace(0.5, 1.0, 80)
    rest = GripPath.fit(later - 0.5, path.evaluate(later)[0])
    again = engine.rollout(c, rest, half.final_state, duration=0.1)
    np.testing.assert_allclose(again.endpoint_xyz[0, -1], whole.endpoint_xyz[0, -1], atol=1e-4)


def test_a_world_that_blows_up_leaves_no_log_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    c = make_cable(bend_stiffness=3e-4)
    state = straight(6, (0, 0, 0.1), (0, 1, 0), (1e9, 0.0, 1e9))
    path = GripPath.hold([0, 0, 0.1, 0, 0], 1.0)
    rollout = EngineMujoco(6).rollout(c, path, state, duration=0.2)
    assert not rollout.finite[0]
    assert np.isnan(rollout.endpoint_xyz[0, -1]).all()
    assert list(tmp_path.iterdir()) == []
    assert mujoco.get_mju_user_warning() is None
