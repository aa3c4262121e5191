"""The arm and its gripper as a few rounded rods: to draw it, and to tell what it hides."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.ur import ArmUR

# Radii of a UR5, read off the maker's drawings [m].
_SOCKET_RADIUS, _BASE_RADIUS, _SHOULDER_RADIUS = 0.095, 0.075, 0.062
_UPPER_RADIUS, _ELBOW_RADIUS, _FOREARM_RADIUS, _WRIST_RADIUS = 0.056, 0.053, 0.043, 0.041
_GRIPPER_RADIUS, _FINGER_RADIUS = 0.036, 0.014
_PALM_SHARE = 0.6

GRIPPER_ROD_COUNT = 2
"""Number of rods of the gripper, which are the last."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArmShape:
    """Rounded rods at some instants.

    Attributes:
        ends: Both ends of each rod's axis [m], shape [time, rod, 2, 3].
        radii: Radius of each rod [m], shape [rod].
    """

    ends: NDArray[np.float64]
    radii: NDArray[np.float64]


def arm_shape(q: ArrayLike, arm: ArmUR) -> ArmShape:
    """Return the arm as rods.

    Args:
        q: Joint angles [rad], shape [time, 6].
        arm: Model, mounting and gripper of the arm.
    """
    links = arm.links
    frames = arm.frames(q)
    base, shoulder, elbow, wrist_1, wrist_2, wrist_3, flange = (T[..., :3, 3] for T in frames)
    across = frames[1][..., :3, 2]
    down = frames[6][..., :3, 2]
    floor = base * [1.0, 1.0, 0.0]
    upper_start = shoulder + links.upper_aside * across
    upper_end = elbow + links.upper_aside * across
    fore_start = elbow + links.forearm_aside * across
    fore_end = wrist_1 + links.forearm_aside * across
    palm = flange + _PALM_SHARE * arm.gripper_length * down
    # The fingertips hold the cable a little above their ends.
    tip = flange + arm.gripper_length * down
    rods = [
        (floor, base, _SOCKET_RADIUS),
        (base, shoulder, _BASE_RADIUS),
        (shoulder, upper_start, _SHOULDER_RADIUS),
        (upper_start, upper_end, _UPPER_RADIUS),
        (upper_end, fore_start, _ELBOW_RADIUS),
        (fore_start, fore_end, _FOREARM_RADIUS),
        (fore_end, wrist_2, _WRIST_RADIUS),
        (wrist_2, wrist_3, _WRIST_RADIUS),
        (wrist_3, flange, _WRIST_RADIUS),
        (flange, palm, _GRIPPER_RADIUS),
        (palm, tip, _FINGER_RADIUS),
    ]
    ends = np.stack([np.stack([start, end], axis=-2) for start, end, _ in rods], axis=-3)
    radii = np.array([radius for _, _, radius in rods])
    # The gripper is the person's own.
    radii[:-GRIPPER_ROD_COUNT] *= links.girth
    return ArmShape(ends=ends, radii=radii)


def sight_clearance(
    points: NDArray[np.float64], camera: ArrayLike, shape: ArmShape
) -> NDArray[np.float64]:
    """Return the distance between the arm and the lines of sight to some points.

    Args:
        points: Points that the camera looks at [m], shape [time, 3].
        camera: Place of the camera [m], shape [3].
        shape: Arm at the same times.

    Returns:
        Smallest distance between each line of sight and the surface of a rod, measured where the
        line passes the rod; negative where the arm hides the point [m], shape [time].
    """
    p = np.asarray(camera, dtype=float)
    u = (points - p)[:, None, :]
    start = shape.ends[:, :, 0]
    v = shape.ends[:, :, 1] - start
    w = p - start
    # Closest points of two segments (parameters s along the sight, t along the rod): the line
    # solution, with t clipped to the rod, then s for that t, clipped to the sight.
    a, b, c = (np.sum(x * y, axis=-1) for x, y in ((u, u), (u, v), (v, v)))
    d, e = np.sum(u * w, axis=-1), np.sum(v * w, axis=-1)
    determinant = np.maximum(a * c - b * b, 1e-12)
    t = np.clip((a * e - b * d) / determinant, 0.0, 1.0)
    s = np.clip((b * t - d) / a, 0.0, 1.0)
    t = np.clip((b * s + e) / np.maximum(c, 1e-12), 0.0, 1.0)
    gap = w + s[..., None] * u - t[..., None] * v
    return np.min(np.sqrt(np.sum(gap * gap, axis=-1)) - shape.radii, axis=-1)
