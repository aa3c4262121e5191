"""Arm: what a robot arm answers to the rest of the library, and the limits of its joints.

The arm stands at the origin of the base frame (docs/conventions.md), `base_height` above the table,
and holds the cable with a gripper that points down.
"""

import abc
import dataclasses
import enum
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cablecast.conventions import Array
from cablecast.errors import IKError, InputError, check_keys, check_number, check_ranges


class LimitKind(enum.Enum):
    """Kind of limit that a motion can violate; the value is its unit."""

    REACH = "m"
    POSITION = "rad"
    VELOCITY = "rad/s"
    ACCELERATION = "rad/s²"


JOINT_LIMIT_KINDS = (LimitKind.POSITION, LimitKind.VELOCITY, LimitKind.ACCELERATION)


class LimitPeak(NamedTuple):
    """Joint beyond one of its limits, at the step where it is farthest beyond.

    `row` and `step` are indices of the motion and of its step, `value` has the sign of the motion.
    """

    kind: LimitKind
    row: tuple[int, ...]
    step: int
    joint: int
    value: float
    bound: float


def limit_violations(asked: Iterable[Array], bounds: Iterable[ArrayLike]) -> Iterator[LimitPeak]:
    """Yield every joint that is beyond a limit: by kind, then by motion and joint.

    Args:
        asked: Angles from the middle of the range [rad], rates [rad/s] and accelerations [rad/s²],
            or the first of these, shape [..., step, joint]. NaN is beyond no limit.
        bounds: Largest absolute value of each kind, shape [joint] or [].
    """
    for kind, values, bound in zip(JOINT_LIMIT_KINDS, asked, bounds, strict=False):
        over = np.abs(values) - bound
        for *row, joint in np.argwhere(np.max(over, axis=-2, initial=-np.inf) > 0.0).tolist():
            step = int(np.argmax(over[(*row, slice(None), joint)]))
            value = float(values[(*row, step, joint)])
            limit = float(np.broadcast_to(bound, values.shape[-1:])[joint])
            yield LimitPeak(kind, tuple(row), step, joint, value, limit)


_OVERTURN = 0.05
"""Largest turn of a standing cable beyond half a turn, at which casts may end [rad]."""

_LIMIT_BOUNDS = {
    "position": (30.0, "rad"),
    "middle": (30.0, "rad"),
    "velocity": (40.0, "rad/s"),
    "acceleration": (1000.0, "rad/s²"),
}
"""Largest limits that a joint may have, and their units: degrees are beyond them."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointLimits:
    """Limits of the joints, one value per joint.

    Attributes:
        position: Largest angle from the middle of the joint's range [rad].
        velocity: Largest speed [rad/s].
        acceleration: Largest acceleration [rad/s²].
        middle: Middle of each range [rad]; zeros where not given.
    """

    position: tuple[float, ...]
    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    middle: tuple[float, ...] = ()

    def __post_init__(self):
        if not self.middle and isinstance(self.position, tuple):
            object.__setattr__(self, "middle", (0.0,) * len(self.position))
        for field in dataclasses.fields(self):
            values = getattr(self, field.name)
            if not isinstance(values, tuple) or len(values) != len(self.position):
                raise InputError(
                    f"arm {field.name} limits {str(values)[:60]} must be one number per joint"
                )
            high, unit = _LIMIT_BOUNDS[field.name]
            low = -high if field.name == "middle" else 1e-3
            for value in values:
                check_number(f"arm {field.name} limit", value, low, high, unit)

    def to_dict(self) -> dict[str, list[float]]:
        """Return plain values for a config or YAML file."""
        values = {name: list(values) for name, values in dataclasses.asdict(self).items()}
        if not any(self.middle):
            del values["middle"]
        return values

    @classmethod
    def from_dict(
        cls,
        values: Mapping[str, Any],
        joint_count: int,
        defaults: Mapping[str, tuple[float, ...]] | None = None,
    ) -> "JointLimits":
        """Return limits from plain values, which replace the defaults."""
        known = {field.name for field in dataclasses.fields(cls)}
        rows = dict(defaults or {}) | {
            name: tuple(row) if isinstance(row, (list, tuple)) else row
            for name, row in check_keys(values, known, "arm limits").items()
        }
        for name, row in rows.items():
            if not isinstance(row, tuple) or len(row) != joint_count:
                raise InputError(f"arm {name} limits {str(row)[:60]} must be {joint_count} numbers")
        return cls(**check_keys(rows, known, "arm limits", required=known - {"middle"}))

    def to_array(self) -> Array:
        """Return position, velocity and acceleration limits, shape [3, joint]."""
        return np.array([self.position, self.velocity, self.acceleration])


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointMotion:
    """Joint angles with their time derivatives; NaN where a pose is out of reach.

    Attributes:
        q: Angles [rad], shape [..., joint].
        qd: Rates [rad/s], same shape.
        qdd: Accelerations [rad/s²], same shape.
        radius: Distance from the base axis of the flange or, if a UR tilts the gripper, of the
            first wrist joint [m], shape [...].
        radius_min: Smallest radius that the arm reaches at this height [m], shape [...].
        radius_max: Largest radius that the arm reaches at this height [m], shape [...].
        mirrored: Returns the motion for the poses mirrored about the workspace axis; None where
            they must be solved separately.
    """

    q: Array
    qd: Array
    qdd: Array
    radius: Array
    radius_min: Array
    radius_max: Array
    mirrored: "Callable[[], JointMotion] | None" = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Links:
    """Links of an arm as capsules about their axes.

    Attributes:
        names: Name of each link.
        ends: Both ends of each axis [m], shape [..., link, 2, 3]. The first two, from the table to
            the base and the base itself, do not move.
        drawn: Radii to draw [m], shape [link].
        safe: Radii to keep a distance from, rounded up [m], shape [link].
    """

    names: tuple[str, ...]
    ends: Array
    drawn: Array
    safe: Array


@dataclasses.dataclass(frozen=True, kw_only=True)
class Arm(abc.ABC):
    """A serial arm whose base axis is vertical.

    Attributes:
        model: Name of the arm.
        base_height: Height of the robot's base above the table's surface [m].
        base_yaw_deg: Rotation of the base about the vertical, positive to the right [deg].
        gripper_length: Distance from the flange down to the axis of the gripped cable [m].
        grip_offset: Distance along the cable from the flange axis to the point where the cable
            leaves the fingers [m].
        measured: Whether the values above were measured on the real robot. A motion for a robot is
            saved only if this is true.
        limits: Joint limits.
    """

    solves_exactly: ClassVar[bool] = False
    """Whether a formula gives the joints of a pose: a search for them takes far longer."""

    model: str
    base_height: float = 0.0
    base_yaw_deg: float = 0.0
    gripper_length: float = 0.17
    grip_offset: float = 0.022
    measured: bool = False
    # None of a joint: those of the model, as soon as the arm is made.
    limits: JointLimits = JointLimits(position=(), velocity=(), acceleration=())

    def __post_init__(self):
        check_ranges(
            self,
            {
                "base_height": (-1.0, 2.0, "m"),
                "base_yaw_deg": (-180.0, 180.0, "deg"),
                "gripper_length": (0.0, 1.0, "m"),
                "grip_offset": (0.0, 0.5, "m"),
            },
            "arm",
        )
        if not isinstance(self.measured, bool):
            raise InputError(f"arm measured = {self.measured!r} must be true or false")
        if not isinstance(self.limits, JointLimits):
            raise InputError(f"arm limits must be JointLimits, not {type(self.limits).__name__}")
        if len(self.limits.position) != len(self.joint_names):
            raise InputError(
                f"arm limits are those of {len(self.limits.position)} joints, the arm has "
                f"{len(self.joint_names)}"
            )

    @property
    @abc.abstractmethod
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints from the base on; the first turns the arm about the vertical."""

    @property
    @abc.abstractmethod
    def offsets_at_zero(self) -> tuple[Array, Array]:
        """Pose of the first joint in the base frame, shape [4, 4], and of each next frame.

        These are in the frame before them, with all joints at zero, shape [joint, 4, 4].
        """

    def frames(self, q: ArrayLike) -> list[Array]:
        """Return the poses of the joints and of the flange in the base frame.

        Args:
            q: Joint angles [rad], shape [..., joint].

        Returns:
            Poses of shape [..., 4, 4], one more than joints: joint k turns about z of frame k, and
            the last frame is the flange, whose z points out of it. The cable leaves along its -y.
        """
        q = np.asarray(q, dtype=float)
        first, offsets = self.offsets_at_zero
        c, s = np.cos(q)[..., None], np.sin(q)[..., None]
        steps = np.empty((*q.shape, 4, 4))
        steps[..., 0, :] = c * offsets[:, 0] - s * offsets[:, 1]
        steps[..., 1, :] = s * offsets[:, 0] + c * offsets[:, 1]
        steps[..., 2:, :] = offsets[:, 2:]
        frames = [np.broadcast_to(first, (*q.shape[:-1], 4, 4))]
        for joint in range(q.shape[-1]):
            frames.append(frames[-1] @ steps[..., joint, :, :])
        return frames

    @abc.abstractmethod
    def inverse_motion(
        self, poses: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike
    ) -> JointMotion:
        """Return joint angles along moving poses, with their rates and accelerations.

        Args:
            poses: x, y, z [m], yaw, pitch [rad], shape [..., 5].
            velocities: Their first derivatives, same shape.
            accelerations: Their second derivatives, same shape.

        Returns:
            Joint motion; NaN where a pose is out of reach.
        """

    @abc.abstractmethod
    def links(self, frames: list[Array]) -> Links:
        """Return the links at the poses that `frames` returned."""

    def self_pairs(self, names: tuple[str, ...]) -> list[tuple[str, str]]:
        """Return which of the moving links and the gripper can meet when the arm folds."""
        # Neighbours touch by construction, and often those next to them.
        return [(low, high) for at, low in enumerate(names) for high in names[at + 3 :]]

    @property
    def joint_count(self) -> int:
        """Number of joints, and of columns of `q` everywhere."""
        return len(self.joint_names)

    @property
    def base_yaw(self) -> float:
        """Rotation of the base about the vertical, positive to the right [rad]."""
        return float(np.radians(self.base_yaw_deg))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for a config or YAML file."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return values | {"limits": self.limits.to_dict()}

    def forward(self, q: ArrayLike) -> Array:
        """Return T_base_flange, shape [..., 4, 4], at joint angles [rad], shape [..., joint].

        z of the flange points out of it.
        """
        return self.frames(q)[-1]

    def grip_pose(self, q: ArrayLike) -> Array:
        """Return the pose of the gripped cable end at joint angles [rad], shape [..., joint].

        It is x, y, z [m], yaw, pitch [rad] as in a GripPath, shape [..., 5].
        """
        q = np.moveaxis(np.asarray(q, dtype=float), -1, 0)
        first, offsets = self.offsets_at_zero
        # From the gripper to the base: the poses of all frames take many times as long. The cable
        # leaves the fingers along -y of the flange, whose z points down.
        along: Any = (0.0, -1.0, 0.0)
        place: Any = (0.0, -self.grip_offset, self.gripper_length)
        for c, s, offset in zip(np.cos(q)[::-1], np.sin(q)[::-1], offsets[::-1], strict=True):
            place, along = _moved(offset, place, 1.0), _moved(offset, along, 0.0)
            place, along = ((c * x - s * y, s * x + c * y, z) for x, y, z in (place, along))
        place, along = _moved(first, place, 1.0), _moved(first, along, 0.0)
        yaw, pitch = np.arctan2(along[0], along[1]), np.arcsin(np.clip(along[2], -1.0, 1.0))
        return np.stack(np.broadcast_arrays(*place, yaw, pitch), axis=-1)

    def standing_pose(self, q: Array) -> Array:
        """Return `grip_pose`, shape [5], with the yaw that `inverse` brings back to the joints.

        A cable that was turned by half a turn to one side looks as if it were turned to the other.
        Joint angles [rad] have the shape [joint].
        """
        pose = self.grip_pose(q)
        if np.pi - abs(pose[3]) > _OVERTURN:
            return pose
        over = pose - [0.0, 0.0, 0.0, np.copysign(2.0 * np.pi, pose[3]), 0.0]
        still = np.zeros((2, 5))
        found = self.inverse_motion(np.stack([pose, over]), still, still).q
        off = np.nan_to_num(np.abs(found - q).max(axis=-1), nan=np.inf)
        return over if off[1] < off[0] else pose

    def inverse(self, poses: ArrayLike) -> Array:
        """Return joint angles that bring the gripped end to given poses.

        Args:
            poses: x, y, z [m], yaw, pitch [rad], shape [..., 5].

        Returns:
            Joint angles of a single branch [rad], shape [..., joint].

        Raises:
            IKError: A pose is out of reach.
        """
        poses = np.asarray(poses, dtype=float)
        still = np.zeros_like(poses)
        motion = self.inverse_motion(poses, still, still)
        bad = ~np.all(np.isfinite(motion.q), axis=-1)
        if np.any(bad):
            radius, low, high = (
                float(values[bad][0])
                for values in (motion.radius, motion.radius_min, motion.radius_max)
            )
            place = f"the grip at x, y, z = {poses[bad][0][:3].round(4).tolist()} m"
            if low <= radius <= high:
                raise IKError(f"the arm cannot turn the cable so far at {place}")
            raise IKError(
                f"the arm does not reach {place}: its {self._radius_of(poses)} would be "
                f"{radius:.4f} m from the base axis, outside [{low:.4f}, {high:.4f}]"
            )
        return motion.q

    def _radius_of(self, poses: Array) -> str:
        """Return the name of the part that the radius of a motion belongs to."""
        return "flange"


def jacobian(frames: list[Array], points: Array) -> Array:
    """Return how points of the flange, shape [..., 3], move and turn with the joints.

    Returns:
        Rows for velocity and angular velocity, shape [..., 6, joint].
    """
    axes = np.stack([T[..., :3, 2] for T in frames[:-1]], axis=-2)
    places = np.stack([T[..., :3, 3] for T in frames[:-1]], axis=-2)
    rates = np.concatenate([np.cross(axes, points[..., None, :] - places), axes], axis=-1)
    return np.swapaxes(rates, -1, -2)


def _moved(T: Array, parts: Sequence[Any], share: float) -> list[Any]:
    """Return the coordinates of a place, or of a direction with a share of 0, moved by a pose."""
    return [
        sum((w * part for w, part in zip(row, parts, strict=False) if w), share * row[3])
        for row in T[:3]
    ]


def rod_ends(rods: list[tuple[Array, Array]]) -> Array:
    """Return both ends of each rod, shape [..., rod, 2, 3]."""
    return np.stack([np.stack(ends, axis=-2) for ends in rods], axis=-3)


def directions(poses: Array) -> tuple[Array, Array, Array, Array]:
    """Return unit vectors of grip poses along cable and tool, forward and right, [..., 3] each."""
    yaw, pitch = poses[..., 3], poses[..., 4]
    zero = np.zeros_like(yaw)
    forward = np.stack([np.sin(yaw), np.cos(yaw), zero], axis=-1)
    right = np.stack([np.cos(yaw), -np.sin(yaw), zero], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    cos_pitch, sin_pitch = np.cos(pitch)[..., None], np.sin(pitch)[..., None]
    along = cos_pitch * forward + sin_pitch * up
    tool = sin_pitch * forward - cos_pitch * up
    return along, tool, forward, right


def flange_motion(o: float, p: Array, v: Array, a: Array) -> tuple[Array, ...]:
    """Return x and y of the flange, `o` [m] behind the grip, each with two derivatives."""
    yaw, dyaw, ddyaw = p[..., 3], v[..., 3], a[..., 3]
    s, c = o * np.sin(yaw), o * np.cos(yaw)
    return (
        p[..., 0] - s,
        v[..., 0] - c * dyaw,
        a[..., 0] - c * ddyaw + s * dyaw**2,
        p[..., 1] - c,
        v[..., 1] + s * dyaw,
        a[..., 1] + s * ddyaw + c * dyaw**2,
    )


def polar_motion(
    x: Array, dx: Array, ddx: Array, y: Array, dy: Array, ddy: Array
) -> tuple[tuple[Array, Array, Array], tuple[Array, Array, Array], Array]:
    """Return the polar coordinates of a moving point.

    Returns:
        Its radius [m] and its azimuth, positive to the right [rad], each with two derivatives; and
        the square of the radius [m²].
    """
    rho2 = x * x + y * y
    rho = np.sqrt(rho2)
    drho = (x * dx + y * dy) / rho
    ddrho = (dx * dx + dy * dy + x * ddx + y * ddy - drho * drho) / rho
    azimuth = np.arctan2(x, y)
    dazimuth = (y * dx - x * dy) / rho2
    ddazimuth = (y * ddx - x * ddy - 2.0 * rho * drho * dazimuth) / rho2
    return (rho, drho, ddrho), (azimuth, dazimuth, ddazimuth), rho2
