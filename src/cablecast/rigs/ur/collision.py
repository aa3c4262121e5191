"""Distances between the arm, its gripper, the table and obstacles, all as capsules.

Links are capsules about the axes of the arm's parts. Radii are measured on the maker's drawings of
a UR5 and rounded up.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.geometry import ArmGeometry
from cablecast.arm.robot import Obstacle, RobotConfig

Array = NDArray[np.float64]

_RADII = {
    "base": 0.08,
    "shoulder": 0.075,
    "upper arm": 0.065,
    "elbow": 0.06,
    "forearm": 0.055,
    "wrist 1": 0.05,
    "wrist 2": 0.05,
    "wrist 3": 0.05,
}
# Neighbours touch by construction; these can meet when the arm folds.
_SELF_PAIRS = tuple(
    (low, high)
    for low in ("base", "shoulder", "upper arm")
    for high in ("wrist 2", "wrist 3", "gripper")
    if (low, high) != ("upper arm", "wrist 3")
)
_OVER_TABLE = ("upper arm", "elbow", "forearm", "wrist 1", "wrist 2", "wrist 3")


@dataclasses.dataclass(frozen=True)
class Capsule:
    """A part of the arm along a path.

    Attributes:
        name: Name of the part.
        start: One end of its axis at each step [m], shape [step, 3].
        end: Other end of its axis at each step [m], shape [step, 3].
        radius: Radius [m].
    """

    name: str
    start: Array
    end: Array
    radius: float


def arm_capsules(arm: ArmGeometry, q: Array, tool_radius: float) -> list[Capsule]:
    """Return the parts of the arm along a path.

    Args:
        arm: Geometry of the arm.
        q: Joint angles [rad], shape [step, 6].
        tool_radius: Radius of gripper and cable grip [m].
    """
    frames = arm.frames(q)
    places = [frame[..., :3, 3] for frame in frames]
    axis = frames[1][..., :3, 2]
    links = arm.links
    outer, inner = links.upper_aside * axis, links.forearm_aside * axis
    flange = frames[6]
    tip = places[6] + arm.gripper_length * flange[..., :3, 2]
    tip = tip - arm.grip_offset * flange[..., :3, 1]
    ends = {
        "base": (places[0], places[1]),
        "shoulder": (places[1], places[1] + outer),
        "upper arm": (places[1] + outer, places[2] + outer),
        "elbow": (places[2] + outer, places[2] + inner),
        "forearm": (places[2] + inner, places[3] + inner),
        "wrist 1": (places[3] + inner, places[4]),
        "wrist 2": (places[4], places[5]),
        "wrist 3": (places[5], places[6]),
    }
    parts = [Capsule(name, *ends[name], links.girth * _RADII[name]) for name in ends]
    return [*parts, Capsule("gripper", places[6], tip, tool_radius)]


def find_collision(arm: ArmGeometry, robot: RobotConfig, q: Array) -> str | None:
    """Return the first thing that a path comes too close to, or None.

    The gripper itself works at the table, so that only its axis must stay above it.

    Args:
        arm: Geometry of the arm.
        robot: Clearance, tool radius and obstacles.
        q: Joint angles [rad], shape [step, 6].
    """
    capsules = {part.name: part for part in arm_capsules(arm, q, robot.tool_radius)}
    for name in _OVER_TABLE:
        part = capsules[name]
        height = np.minimum(part.start[:, 2], part.end[:, 2]) - part.radius
        if height.min() < robot.clearance:
            return _too_close(name, "the table", height, robot.clearance)
    gripper = capsules["gripper"]
    height = np.minimum(gripper.start[:, 2], gripper.end[:, 2])
    if height.min() < 0.0:
        return _too_close("gripper", "the table", height, 0.0)
    for number, obstacle in enumerate(robot.obstacles):
        for name, part in capsules.items():
            gap = _obstacle_gap(part, obstacle)
            if gap.min() < robot.clearance:
                return _too_close(name, f"obstacle {number + 1}", gap, robot.clearance)
    for low, high in _SELF_PAIRS:
        one, other = capsules[low], capsules[high]
        gap = segment_distance(one.start, one.end, other.start, other.end)
        gap = gap - one.radius - other.radius
        if gap.min() < robot.clearance:
            return _too_close(high, f"the {low}", gap, robot.clearance)
    return None


def _too_close(name: str, what: str, gap: Array, bound: float) -> str:
    step = int(np.argmin(gap))
    return f"at set point {step} the {name} is {gap[step]:.3f} m from {what}, less than {bound:g} m"


def _obstacle_gap(part: Capsule, obstacle: Obstacle) -> Array:
    start, end = (np.broadcast_to(p, part.start.shape) for p in (obstacle.start, obstacle.end))
    distance = segment_distance(part.start, part.end, start, end)
    return distance - part.radius - obstacle.radius


def segment_distance(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return the distance between the segments ab and cd.

    Source: C. Ericson, "Real-Time Collision Detection", section 5.1.9.

    Args:
        a: Begin of the first segment [m], shape [step, 3].
        b: End of the first segment [m], shape [step, 3].
        c: Begin of the second segment [m], shape [step, 3].
        d: End of the second segment [m], shape [step, 3].

    Returns:
        Distance [m], shape [step].
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
    gap = w + s[..., None] * u - t[..., None] * v
    return np.sqrt(np.sum(gap * gap, axis=-1))
