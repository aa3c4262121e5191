"""Chance that a cast has no landing: off the table, or where the camera cannot see the marker."""

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.shape import ArmShape, arm_shape, sight_clearance
from cablecast.camera.sight import CameraSight
from cablecast.motion.cast import cast_grip_paths
from cablecast.setup import Setup

CAMERA_HEIGHT = 2.2
"""Height of a camera above the middle of the table, where its place is not known [m]."""

MARKER_RADIUS = 0.015
"""Distance from the arm's outline at which a marker of usual size is half hidden [m]."""

# Points that stand for a round normal distribution: shares of equal probability, each at the
# distance from the middle that halves it.
_RINGS, _SPOKES = 4, 8


def lost_chance(
    actions: NDArray[np.float64],
    landing_xy: NDArray[np.float64],
    deviation: NDArray[np.float64],
    setup: Setup,
    sight: CameraSight | None = None,
) -> NDArray[np.float64]:
    """Return the chance that a landing lies off the table, or is not seen.

    What the resting arm hides is not seen, and what lies in a blind place of the camera.

    Args:
        actions: Actions on either side, shape [action, 4].
        landing_xy: Their expected landings [m], shape [action, 2].
        deviation: Standard deviation of the landings along each axis [m], shape [action].
        setup: Set-up with the arm and the table.
        sight: Limits of the camera's sight; those of a camera above the middle of the table,
            without blind places, where None.

    Returns:
        Chance [-], shape [action]. An arm that cannot follow an action hides nothing.
    """
    paths = cast_grip_paths(actions, setup)
    poses = paths.evaluate(paths.duration[:, None])[:, 0]
    still = np.zeros_like(poses)
    q = setup.arm.inverse_motion(poses, still, still).q
    points = landing_xy[:, None] + deviation[:, None, None] * _unit_points()
    count = points.shape[1]
    ground = np.concatenate([points, np.zeros((*points.shape[:2], 1))], axis=-1)
    table = setup.workspace
    if sight is None:
        middle = 0.5 * (table.y_min + table.y_max)
        sight = CameraSight(position=(0.0, middle, CAMERA_HEIGHT))
    shape = arm_shape(q, setup.arm)
    each = ArmShape(ends=np.repeat(shape.ends, count, axis=0), radii=shape.radii)
    clearance = sight_clearance(ground.reshape(-1, 3), sight.position, each).reshape(-1, count)
    unseen = (clearance < MARKER_RADIUS) | sight.is_blind_at(points)
    return np.mean(unseen | ~table.on_table(points), axis=1)


def _unit_points() -> NDArray[np.float64]:
    """Return points of a round normal distribution of deviation 1, shape [point, 2]."""
    share = (np.arange(_RINGS) + 0.5) / _RINGS
    radius = np.sqrt(-2.0 * np.log1p(-share))
    # Every other ring is turned by half a spoke.
    turn = (np.arange(_SPOKES) + 0.5 * (np.arange(_RINGS)[:, None] % 2)) * 2.0 * np.pi / _SPOKES
    ring = radius[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return ring.reshape(-1, 2)
