"""The arm and its gripper as capsules: to draw it, what it hides, and what it comes near."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from cablecast.arm.base import Arm, rod_ends
from cablecast.arm.robot import RobotConfig
from cablecast.conventions import Array

_PALM_RADIUS, _FINGER_RADIUS = 0.036, 0.014
_PALM_SHARE = 0.6

GRIPPER_ROD_COUNT = 2
"""Number of capsules of the gripper, which are the last."""

STANDING = 2
"""Number of links from the base on that stand over the table in any posture."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArmShape:
    """Capsules at some instants.

    Attributes:
        ends: Both ends of each capsule's axis [m], shape [time, rod, 2, 3].
        radii: Radius of each [m], shape [rod].
    """

    ends: Array
    radii: Array


def arm_shape(q: ArrayLike, arm: Arm) -> ArmShape:
    """Return the arm as capsules: its links from the foot on, palm and fingers.

    Joint angles [rad] have the shape [time, joint].
    """
    frames = arm.frames(q)
    links = arm.links(frames)
    flange = frames[-1][..., :3, 3]
    down = frames[-1][..., :3, 2]
    palm = flange + _PALM_SHARE * arm.gripper_length * down
    # The fingertips hold the cable a little above their ends.
    tip = flange + arm.gripper_length * down
    gripper = rod_ends([(flange, palm), (palm, tip)])
    return ArmShape(
        ends=np.concatenate([links.ends, gripper], axis=-3),
        # The gripper is the person's own.
        radii=np.array([*links.drawn, _PALM_RADIUS, _FINGER_RADIUS]),
    )


def sight_clearance(points: Array, camera: ArrayLike, shape: ArmShape) -> Array:
    """Return the distance between the arm and the lines of sight to points [m], shape [time, 3].

    It is the smallest from each line to the surface of a capsule, measured where the line passes
    it, and negative where the arm hides the point [m], shape [time].
    """
    start, end = shape.ends[:, :, 0], shape.ends[:, :, 1]
    gap = segment_distance(start, end, np.asarray(camera, dtype=float), points[:, None, :])
    return np.min(gap - shape.radii, axis=-1)


def find_collision(
    arm: Arm, robot: RobotConfig, q: Array, floor: float | None = None
) -> str | None:
    """Return the first thing that a path comes too close to, or None.

    The gripper is one capsule from the flange to the grip. It works at the table, so that only its
    axis must stay above it. Without a table there is a floor at some height [m]. Joint angles [rad]
    have the shape [step, joint].
    """
    parts = _parts(arm, q, robot.tool_radius)
    for name in list(parts)[STANDING:]:
        axis, radius = parts[name]
        bound = robot.clearance
        if name == "gripper":
            radius, bound = 0.0, 0.0
        height = np.min(axis[:, :, 2], axis=1) - radius - (floor or 0.0)
        if height.min() < bound:
            return _too_close(name, "the table" if floor is None else "the floor", height, bound)
    for number, obstacle in enumerate(robot.obstacles):
        ends = np.array([obstacle.start, obstacle.end])
        for name, part in parts.items():
            gap = _gap(part, (ends, obstacle.radius))
            if gap.min() < robot.clearance:
                return _too_close(name, f"obstacle {number + 1}", gap, robot.clearance)
    for (low, high), gap in self_gaps(arm, q, robot.tool_radius).items():
        if gap.min() < robot.clearance:
            return _too_close(high, f"the {low}", gap, robot.clearance)
    return None


def self_gaps(arm: Arm, q: Array, tool_radius: float = 0.04) -> dict[tuple[str, str], Array]:
    """Return the distances between parts of an arm that can meet when it folds.

    Those between the surfaces of two parts [m] have the shape [step], by their names. The gripper
    is a capsule from the flange to the grip, of the tool's radius [m].
    """
    parts = _parts(arm, q, tool_radius)
    return {
        (low, high): _gap(parts[low], parts[high]) for low, high in arm.self_pairs(tuple(parts))
    }


def _parts(arm: Arm, q: Array, tool_radius: float) -> dict[str, tuple[Array, float]]:
    """Return both ends [m], [step, 2, 3], and radius [m] of each part that moves or may be met."""
    frames = arm.frames(q)
    links = arm.links(frames)
    ends = np.moveaxis(links.ends, -3, 0)[1:]
    parts = dict(zip(links.names[1:], zip(ends, links.safe[1:], strict=True), strict=True))
    grip = arm.grip_pose(q)[:, :3]
    return parts | {"gripper": (np.stack([frames[-1][:, :3, 3], grip], axis=-2), tool_radius)}


def _too_close(name: str, what: str, gap: Array, bound: float) -> str:
    step = int(np.argmin(gap))
    return f"at set point {step} the {name} is {gap[step]:.3f} m from {what}, less than {bound:g} m"


def _gap(part: tuple[Array, float], other: tuple[Array, float]) -> Array:
    """Return the distance between the surfaces of two capsules [m], shape [step]."""
    (a, radius), (b, other_radius) = part, other
    distance = segment_distance(a[..., 0, :], a[..., 1, :], b[..., 0, :], b[..., 1, :])
    return distance - radius - other_radius


def segment_distance(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return the distance [m], shape [...], between the segments ab and cd, ends [m], [..., 3].

    Source: C. Ericson, "Real-Time Collision Detection", section 5.1.9.
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
