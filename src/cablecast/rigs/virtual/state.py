"""The cable in MuJoCo's state: how it is laid down, where its vertices are, how they move."""

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


def lay_down(
    scene: Scene,
    qpos: NDArray[np.float64],
    pose: NDArray[np.float64],
    shape: NDArray[np.float64],
    tip_roll: float,
) -> None:
    """Put the hand and a cable where a reset left them.

    Args:
        scene: Model that the state belongs to.
        qpos: Positions of all joints of one world, which are filled, shape [joint position].
        pose: Pose of the grip: x, y, z [m], yaw, pitch [rad], shape [5].
        shape: Vertices of the cable [m], shape [vertex, 3].
        tip_roll: Turn of the lying attachment about the cable [rad].
    """
    qpos[:HAND_DOF_COUNT] = pose - scene.hand_origin
    qpos[scene.vertex_slice] = (shape[2:] - scene.vertex_origin).ravel()
    if not scene.has_tip:
        return
    ahead = shape[-1] - shape[-2]
    # A hook's bend comes down from above: its other side would begin within the table.
    yaw, roll = -np.arctan2(ahead[0], ahead[1]) / 2, -abs(tip_roll) / 2
    # Turned about its own y, the cable's axis, and then about z.
    qpos[scene.tip_slice] = [
        np.cos(yaw) * np.cos(roll),
        -np.sin(yaw) * np.sin(roll),
        np.cos(yaw) * np.sin(roll),
        np.sin(yaw) * np.cos(roll),
    ]


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
