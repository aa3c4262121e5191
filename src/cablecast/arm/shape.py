"""The arm and its gripper as a few rounded rods: to draw it, and to tell what it hides.

Distances between the arm, its gripper, the table and obstacles, all as capsules.

Links are capsules about the axes of the arm's parts. Radii are measured on the maker's drawings of
a UR5 and rounded up.
"""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.kinematics import ArmGeometry
from cablecast.arm.robot import Obstacle, RobotConfig
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
