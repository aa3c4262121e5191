"""Whole scenes with EngineWarp: lifting the cable, letting it hang, swinging."""

import numpy as np
import pytest
from tests.engines.grips import smooth

from cablecast.cable import load_cable
from cablecast.engines.base import reset_state
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.grip_path import GripPath

# As much damping as three seconds of hanging need to settle.
CABLE = load_cable("cable_1").with_params(linear_damping=1.5)
GRIP_HEIGHT = 0.02


def glide(start, end, duration):
    """Return a grip that moves from one pose to another, at rest at both ends."""
    times = np.linspace(0.0, duration, 60)
    share = smooth(times / duration)
    start, end = np.asarray(start, float), np.asarray(end, float)
    return GripPath.fit(times, start + share[:, None] * (end - start))


def run(path, state, duration, **options):
    engine = EngineWarp(precision="double", **options)
    return engine.rollout(CABLE, path, state, duration=duration)


@pytest.fixture(scope="module")
def lifted():
    """Return the cable after a lift straight up from the reset state and three seconds to hang."""
    low, high = [0, 0.6, GRIP_HEIGHT, 0, 0], [0, 0.6, 0.9, 0, -np.pi / 2]
    path = glide(low, high, 2.0)
    state = reset_state(CABLE, path, EngineWarp().segment_count)
    return run(path, state, 2.0 + 8.0)


def test_a_lifted_cable_comes_to_hang_straight_below_the_grip(lifted):
    nodes = lifted.final_state.positions[0]
    np.testing.assert_allclose(nodes[-1, 2], 0.9 - CABLE.length, atol=2e-3)
    assert np.linalg.norm(nodes[-1, :2] - [0, 0.6]) < 0.01
    assert lifted.finite.all()


def test_a_cast_in_the_vertical_plane_lays_the_cable_out_in_front(lifted):
    # Pull back, swing forward, lower the grip: polar casting.
    times = np.array([0.0, 0.4, 1.0, 1.25, 1.6, 2.0, 2.4])
    y = np.array([0.6, 0.3, 0.9, 0.9, 0.9, 0.9, 0.9])
    z = np.array([0.9, 0.9, 0.85, 0.7, 0.35, 0.1, GRIP_HEIGHT])
    pitch = np.radians([-90, -90, -60, -20, 0, 0, 0])
    poses = np.stack([0 * y, y, z, 0 * y, pitch], axis=1)
    rollout = run(GripPath.fit(times, poses), lifted.final_state, 4.0)
    nodes = rollout.final_state.positions[0]
    assert np.abs(nodes[:, 0]).max() < 1e-6  # the swing stays in its plane
    assert nodes[-1, 2] < 2 * CABLE.radius  # the free end lies on the table
    assert nodes[-1, 1] > 0.9 + 0.5 * CABLE.length  # far in front of the grip
