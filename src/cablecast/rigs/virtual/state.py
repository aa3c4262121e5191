"""The cable in MuJoCo's state: where its vertices are, and how they move."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.conventions import tangent
from cablecast.rigs.virtual.scene import HAND_DOF_COUNT, Scene


@dataclasses.dataclass(frozen=True, kw_only=True)
class CableMotion:
    """Positions and velocities of a batch of cables.

    Attributes:
        vertices: Positions up to the endpoint [m], shape [world, vertex, 3].
        velocity: Velocities of the vertices [m/s], same shape.
        roll: Roll angle of each edge but the gripped one [rad], shape [world, edge - 1].
        roll_rate: Rate of that angle [rad/s], same shape.
    """

    vertices: NDArray[np.float64]
    velocity: NDArray[np.float64]
    roll: NDArray[np.float64]
    roll_rate: NDArray[np.float64]


def cable_vertices(scene: Scene, qpos: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the positions of all vertices up to the endpoint [m], shape [world, vertex, 3].

    Args:
        scene: Model that the state belongs to.
        qpos: Positions of all joints, shape [world, joint position].
    """
    count = len(qpos)
    vertices = np.empty((count, len(scene.arc_lengths), 3))
    pose = qpos[:, :HAND_DOF_COUNT] + scene.hand_origin
    vertices[:, 0] = pose[:, :3]
    vertices[:, 1] = pose[:, :3] + scene.arc_lengths[1] * tangent(pose[:, 3], pose[:, 4])
    free = qpos[:, scene.vertex_slice].reshape(count, -1, 3)
    np.add(free, scene.vertex_origin, out=vertices[:, 2:])
    return vertices


def cable_motion(scene: Scene, qpos: NDArray[np.float64], qvel: NDArray[np.float64]) -> CableMotion:
    """Return positions and velocities of the cables.

    Args:
        scene: Model that the state belongs to.
        qpos: Positions of all joints, shape [world, joint position].
        qvel: Velocities of all joints, shape [world, joint velocity].
    """
    rolls, roll_rates = scene.roll_slices
    vertices = cable_vertices(scene, qpos)
    velocity = np.empty_like(vertices)
    # The gripped edge is as short as the jaws: what its turn adds is left out.
    velocity[:, :2] = qvel[:, None, :3]
    velocity[:, 2:] = qvel[:, scene.vertex_slice].reshape(len(qpos), -1, 3)
    return CableMotion(
        vertices=vertices, velocity=velocity, roll=qpos[:, rolls], roll_rate=qvel[:, roll_rates]
    )
