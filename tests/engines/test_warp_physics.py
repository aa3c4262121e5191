"""The physics of EngineWarp on a table, beside the closed forms of docs/validation.md."""

import numpy as np
from benchmarks.validation.case import make_warp
from benchmarks.validation.scenes import LENGTH, LOCKED, RADIUS, hold, make_cable, planar, straight

from cablecast.engines.base import CableState
from cablecast.motion.grip_path import GripPath


def test_a_cable_dragged_lengthwise_stops_in_line_with_its_grip():
    # Tension changes nothing that we can see, but stopping the grip must stop the whole cable in
    # line: an inextensible straight cable cannot overtake its grip without buckling.
    cable = make_cable(lateral_friction=0.4, rolling_friction=LOCKED, bend_stiffness=1e-3)
    times = np.linspace(0.0, 1.0, 5)
    poses = np.zeros((5, 5))
    poses[:, 1], poses[:, 2] = -0.3 * times, RADIUS
    state = straight(20, (0, 0, RADIUS), (0, 1, 0), velocity=(0, -0.3, 0))
    rollout = make_warp(20, 5e-4).rollout(cable, GripPath.fit(times, poses), state, duration=1.0)
    nodes = rollout.final_state.positions[0]
    assert np.abs(nodes[:, 0]).max() < 1e-6
    np.testing.assert_allclose(nodes[-1, 1], -0.3 + LENGTH, atol=1e-6)


def test_spinning_friction_alone_holds_a_bent_cable_without_creep():
    # Sliding costs nothing; a couple of up to sigma N keeps each segment from turning: more than
    # the bending moment at the free end.
    cable = make_cable(
        spinning_friction=np.array([0.02, 0.0]), rolling_friction=LOCKED, bend_stiffness=1e-4
    )
    grip = (0.0, 0.0, RADIUS)
    start = planar(np.linspace(0.0, 0.2, 30), grip, "yx")
    rollout = make_warp(30, 5e-4).rollout(
        cable, hold(grip), CableState.at_rest(start[None]), duration=61.0
    )
    moved = np.linalg.norm(rollout.final_state.positions - start, axis=2).max(axis=1)
    assert moved[0] < 1e-4
    assert moved[1] > 0.01
