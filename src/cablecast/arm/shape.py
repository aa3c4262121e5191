"""The arm and its gripper as capsules: to draw it, to tell what it hides, and what it comes near.

Links are capsules about the axes of the arm's parts.
"""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.robot import RobotConfig
from cablecast.arm.ur import ArmUR

Array = NDArray[np.float64]

_RADII = {
    "foot": (0.095, 0.095),
    "base": (0.075, 0.08),
    "shoulder": (0.062, 0.075),
    "upper arm": (0.056, 0.065),
    "elbow": (0.053, 0.06),
    "forearm": (0.043, 0.055),
    "wrist 1": (0.041, 0.05),
    "wrist 2": (0.041, 0.05),
    "wrist 3": (0.041, 0.05),
}
"""Radius of each link of a UR5, read off the maker's drawings, and rounded up, for distances to
keep [m]. The foot reaches from the table to the base, and is not the arm's own."""
_PALM_RADIUS, _FINGER_RADIUS = 0.036, 0.014
_PALM_SHARE = 0.6

GRIPPER_ROD_COUNT = 2
"""Number of capsules of the gripper, which are the last."""

# Neighbours touch by construction; these can meet when the arm folds.
_SELF_PAIRS = tuple(
    (low, high)
    for low in ("base", "shoulder", "upper arm")
    for high in ("wrist 2", "wrist 3", "gripper")
    if (low, high) != ("upper arm", "wrist 3")
)
_OVER_TABLE = ("upper arm", "elbow", "forearm", "wrist 1", "wrist 2", "wrist 3")


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArmShape:
    """Capsules at some instants.

    Attributes:
        ends: Both ends of each capsule's axis [m], shape [time, rod, 2, 3].
        radii: Radius of each [m], shape [rod].
    """

    ends: Array
    radii: Array


def arm_shape(q: ArrayLike, arm: ArmUR) -> ArmShape:
    """Return the arm as capsules: its links from the foot on, palm and fingers.

    Args:
        q: Joint angles [rad], shape [time, 6].
        arm: Model, mounting and gripper of the arm.
    """
    frames = arm.frames(q)
    flange = frames[6][..., :3, 3]
    down = frames[6][..., :3, 2]
    palm = flange + _PALM_SHARE * arm.gripper_length * down
    # The fingertips hold the cable a little above their ends.
    tip = flange + arm.gripper_length * down
    gripper = _pairs([(flange, palm), (palm, tip)])
    radii = [arm.links.girth * drawn for drawn, _ in _RADII.values()]
    return ArmShape(
        ends=np.concatenate([_links(arm, frames), gripper], axis=-3),
        # The gripper is the person's own.
        radii=np.array([*radii, _PALM_RADIUS, _FINGER_RADIUS]),
    )


def _links(arm: ArmUR, frames: list[Array]) -> Array:
    """Return both ends of each link [m], in the order of `_RADII`, shape [time, link, 2, 3]."""
    base, shoulder, elbow, wrist_1, wrist_2, wrist_3, flange = (T[..., :3, 3] for T in frames)
    across = frames[1][..., :3, 2]
    outer, inner = arm.links.upper_aside * across, arm.links.forearm_aside * across
    return _pairs(
        [
            (base * [1.0, 1.0, 0.0], base),
            (base, shoulder),
            (shoulder, shoulder + outer),
            (shoulder + outer, elbow + outer),
            (elbow + outer, elbow + inner),
            (elbow + inner, wrist_1 + inner),
            (wrist_1 + inner, wrist_2),
            (wrist_2, wrist_3),
            (wrist_3, flange),
        ]
    )


def _pairs(rods: list[tuple[Array, Array]]) -> Array:
    """Return both ends of each rod, shape [..., rod, 2, 3]."""
    return np.stack([np.stack(ends, axis=-2) for ends in rods], axis=-3)


def sight_clearance(points: Array, camera: ArrayLike, shape: ArmShape) -> Array:
    """Return the distance between the arm and the lines of sight to some points.

    Args:
        points: Points that the camera looks at [m], shape [time, 3].
        camera: Place of the camera [m], shape [3].
        shape: Arm at the same times.

    Returns:
        Smallest distance between each line of sight and the surface of a capsule, measured where
        the line passes it; negative where the arm hides the point [m], shape [time].
    """
    start, end = shape.ends[:, :, 0], shape.ends[:, :, 1]
    gap = segment_distance(start, end, np.asarray(camera, dtype=float), points[:, None, :])
    return np.min(gap - shape.radii, axis=-1)


def find_collision(arm: ArmUR, robot: RobotConfig, q: Array) -> str | None:
    """Return the first thing that a path comes too close to, or None.

    The gripper is one capsule from the flange to the grip. It works at the table, so that only its
    axis must stay above it.

    Args:
        arm: Geometry of the arm.
        robot: Clearance, tool radius and obstacles.
        q: Joint angles [rad], shape [step, 6].
    """
    # Both ends [m], shape [step, 2, 3], and radius [m] of each part that moves or may be met.
    frames = arm.frames(q)
    ends = np.moveaxis(_links(arm, frames), -3, 0)
    parts = {
        name: (axis, arm.links.girth * safe)
        for axis, (name, (_, safe)) in zip(ends, _RADII.items(), strict=True)
        if name != "foot"
    }
    grip = arm.grip_pose(q)[:, :3]
    parts["gripper"] = (np.stack([frames[6][:, :3, 3], grip], axis=-2), robot.tool_radius)
    for name in (*_OVER_TABLE, "gripper"):
        axis, radius = parts[name]
        bound = robot.clearance
        if name == "gripper":
            radius, bound = 0.0, 0.0
        height = np.min(axis[:, :, 2], axis=1) - radius
        if height.min() < bound:
            return _too_close(name, "the table", height, bound)
    for number, obstacle in enumerate(robot.obstacles):
        ends = np.array([obstacle.start, obstacle.end])
        for name, part in parts.items():
            gap = _gap(part, (ends, obstacle.radius))
            if gap.min() < robot.clearance:
                return _too_close(name, f"obstacle {number + 1}", gap, robot.clearance)
    for low, high in _SELF_PAIRS:
        gap = _gap(parts[low], parts[high])
        if gap.min() < robot.clearance:
            return _too_close(high, f"the {low}", gap, robot.clearance)
    return None


def _too_close(name: str, what: str, gap: Array, bound: float) -> str:
    step = int(np.argmin(gap))
    return f"at set point {step} the {name} is {gap[step]:.3f} m from {what}, less than {bound:g} m"


def _gap(part: tuple[Array, float], other: tuple[Array, float]) -> Array:
    """Return the distance between the surfaces of two capsules [m], shape [step]."""
    (a, radius), (b, other_radius) = part, other
    distance = segment_distance(a[..., 0, :], a[..., 1, :], b[..., 0, :], b[..., 1, :])
    return distance - radius - other_radius


def segment_distance(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return the distance between the segments ab and cd.

    Source: C. Ericson, "Real-Time Collision Detection", section 5.1.9.

    Args:
        a: Start of the first segment [m], shape [..., 3], as that of all four.
        b: End of the first segment [m].
        c: Start of the second segment [m].
        d: End of the second segment [m].

    Returns:
        Distance [m], shape [...].
    """
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (np.sum(x * y, axis=-1) for x, y in ((u, u), (v, v), (u, v)))
    uw, vw = np.sum(u * w, axis=-1), np.sum(v * w, axis=-1)
    tiny = 1e-15
    cross = uu * vv - uv * uv
    s = np.where(cross > tiny, (uv * vw - uw * vv) / np.maximum(cross, tiny), 0.0)
    s = np.clip(s, 0.0, 1.0)
    t = np.where(vv > tiny, (uv * s + vw) / np.maximum(vv, tiny), 0.0)
    t = np.clip(t, 0.0, 1.0)
    s = np.where(uu > tiny, (uv * t - uw) / np.maximum(uu, tiny), 0.0)
    s = np.clip(s, 0.0, 1.0)
    gap = w - t[..., None] * v + s[..., None] * u
    return np.sqrt(np.sum(gap * gap, axis=-1))
