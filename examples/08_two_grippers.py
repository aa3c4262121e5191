"""A cable between two grippers: how it hangs, and how hard it pulls.

The direction of a grip is that of the cable: it leaves the near gripper along it, and arrives in
the far one along that of `far_path`. Both may move; here the far one comes nearer for a second.
"""

import dataclasses

import numpy as np

import cablecast as cc
from cablecast.engines.base import CableState
from cablecast.motion.grip_path import GripPath

HEIGHT, DISTANCE, NEARER = 1.0, 0.55, 0.35


def main(segment_count: int = 40) -> None:
    cable = cc.load_cable("cable_1")
    # A soft cable hangs like a chain; damping lets it come to rest.
    cable = cable.with_params(
        dataclasses.replace(
            cable.params, bend_stiffness=1e-6, endpoint_mass=0.0, linear_damping=3.0
        )
    )
    engine = cc.EngineWarp(segment_count, 5e-4, precision="double", table=False)

    # x, y, z [m], yaw and pitch [rad]: from straight ahead down, and up again at the far end.
    near = GripPath.hold([0.0, 0.0, HEIGHT, 0.0, -1.0], 1.0)
    times = np.linspace(0.0, 1.0, 20)
    eased = times**2 * (3.0 - 2.0 * times)
    poses = np.zeros((20, 5))
    poses[:, 1] = DISTANCE + (NEARER - DISTANCE) * eased
    poses[:, 2] = HEIGHT
    poses[:, 4] = 1.0
    far = GripPath.fit(times, poses)

    # It begins as two straight halves, a V between the grippers, at rest.
    half = 0.5 * cable.length
    depth = np.sqrt(half**2 - (0.5 * DISTANCE) ** 2)
    share = np.linspace(0.0, 1.0, segment_count + 1)
    nodes = np.zeros((1, segment_count + 1, 3))
    nodes[0, :, 1] = DISTANCE * share
    nodes[0, :, 2] = HEIGHT - depth * (1.0 - np.abs(2.0 * share - 1.0))

    rollout = engine.rollout(
        cable,
        near,
        CableState.at_rest(nodes),
        duration=6.0,
        far_path=far,
        record_nodes=True,
        record_forces=True,
    )
    sag = HEIGHT - rollout.nodes[0, -1, :, 2].min()
    pull = rollout.forces.grip[0, -1]

    # The catenary between the same points: half the length is a sinh(half the distance / a).
    low, high = 1e-3, 10.0
    for _ in range(60):
        a = 0.5 * (low + high)
        low, high = (a, high) if a * np.sinh(0.5 * NEARER / a) > half else (low, a)
    weight = 9.81 * cable.params.mass
    print(f"sag {100 * sag:.2f} cm; catenary {100 * (np.hypot(half, a) - a):.2f} cm")
    print(
        f"each gripper bears {-pull[2]:.3f} N and is pulled inwards with {pull[1]:.3f} N; "
        f"catenary {0.5 * weight:.3f} N and {weight * a / cable.length:.3f} N"
    )


if __name__ == "__main__":
    main()
