"""Contact of cables with the arm, found after a rollout: nodes against capsules."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def first_contact(
    nodes: NDArray[np.float64],
    ends: NDArray[np.float64],
    radii: ArrayLike,
    cable_radius: ArrayLike,
    first_node: ArrayLike = 1,
) -> NDArray[np.int_]:
    """Return the first sample at which each cable touches a capsule.

    No engine simulates such a contact: what follows it is not what the cable does.

    Args:
        nodes: Shapes [m], shape [world, step, node, 3], as `Rollout.nodes`.
        ends: Both ends of each capsule's axis at the same times [m], shape [world or 1, step, rod,
            2, 3], as those of `cablecast.arm.shape.ArmShape`.
        radii: Radius of each capsule [m], one or shape [rod].
        cable_radius: Radius of the cable [m], one or shape [world].
        first_node: First node that counts, one or shape [rod]: those before it lie beside the grip
            and may touch what holds them.

    Returns:
        Indices of samples, the number of samples where there is no contact, shape [world].
    """
    rod_count = ends.shape[2]
    radii = np.broadcast_to(np.asarray(radii, dtype=float), rod_count)
    first_nodes = np.broadcast_to(first_node, rod_count)
    reach = np.broadcast_to(np.asarray(cable_radius, dtype=float), len(nodes))
    touches = np.zeros(nodes.shape[:2], dtype=bool)
    for rod, (radius, first) in enumerate(zip(radii, first_nodes, strict=True)):
        start, end = ends[:, :, rod, 0], ends[:, :, rod, 1]
        middle, half = 0.5 * (start + end), 0.5 * np.linalg.norm(end - start, axis=-1)
        # Few nodes are within the ball about a capsule.
        offset = nodes[:, :, first:] - middle[:, :, None]
        ball = (half + radius + reach[:, None])[..., None]
        near = np.nonzero(np.einsum("wsnx,wsnx->wsn", offset, offset) < ball**2)
        row = (np.minimum(near[0], len(ends) - 1), near[1])
        axis = (end - start)[row]
        square = np.maximum(np.sum(axis * axis, axis=-1), 1e-18)
        way = np.sum(axis * offset[near], axis=-1) / square
        apart = offset[near] - np.clip(way, -0.5, 0.5)[:, None] * axis
        hit = np.linalg.norm(apart, axis=-1) < radius + reach[near[0]]
        touches[near[0][hit], near[1][hit]] = True
    steps = np.argmax(touches, axis=1)
    return np.where(touches.any(axis=1), steps, nodes.shape[1])
