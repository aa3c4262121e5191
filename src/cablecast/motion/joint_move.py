"""Joint-space moves: a family of motions of any serial arm that holds a stick with a cable.

Some joints move from a posture at rest to another and stop there, all in the same phase: the joint
that moves most has the speed of the move, and speed up and slow down each take the same time
(movej of many controllers). The cable goes on at the end of the stick as the stick points.
"""

import dataclasses
import math
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.base import Arm, LimitPeak, limit_violations, rod_ends
from cablecast.arm.shape import ArmShape, self_gaps
from cablecast.conventions import Array
from cablecast.errors import InputError, check_number, check_ranges
from cablecast.motion.grip_path import GripPath
from cablecast.motion.trajectory import JointPath, check_set_points
from cablecast.setup import Setup

KNOT_DT = 0.01
"""Time between the knots of a grip path [s]: a tenth of a short ramp."""

TURN_NAMES = tuple(f"swing_turn_{number}" for number in range(1, 8))
"""Names of the turns of a move: an arm has at most seven joints."""

_PARALLEL = 0.02
"""Largest distance between the unit vectors of axes that count as parallel [-]."""
_UPRIGHT = 1e-4
"""Horizontal part of a direction below which its yaw is that of its neighbours [-]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stick:
    """A stick on the flange, along the flange's z, at whose end the cable goes on.

    Attributes:
        length: Distance from the flange to the cable's root [m].
        radius: Half its diameter [m].
    """

    length: float = 0.5
    radius: float = 0.01

    def __post_init__(self):
        check_ranges(self, {"length": (0.0, 2.0, "m"), "radius": (1e-3, 0.1, "m")}, "stick")

    def root(self, flange: Array) -> Array:
        """Return the cable's root [m], shape [..., 3], at poses of the flange, [..., 4, 4]."""
        return flange[..., :3, 3] + self.length * flange[..., :3, 2]


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointMoves:
    """The moves of an arm from a posture to others.

    Attributes:
        arm: Arm.
        stick: Stick on its flange.
        start: Posture at the start [rad], shape [joint].
        names: Names of the parameters, in the order of `low`: the speed, then each joint.
        joints: Numbers of the joints that move, from 0.
        low: Least speed of the joint that moves most [rad/s], and turn of each joint [rad], shape
            [1 + joint that moves].
        high: The largest of them. A turn may go from a positive number down to a negative one.
        ramp_time: Duration of speeding up and of slowing down [s].
    """

    arm: Arm
    stick: Stick
    start: tuple[float, ...]
    joints: tuple[int, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    ramp_time: float = 0.1

    def __post_init__(self):
        count = self.arm.joint_count
        if len(self.start) != count:
            raise InputError(
                f"the start of a joint move has {len(self.start)} angles, {self.arm.model} {count} "
                "joints"
            )
        if not self.joints or not all(0 <= joint < count for joint in self.joints):
            raise InputError(
                f"joints = {list(self.joints)} of a joint move must be some of 0 to {count - 1}"
            )
        for name in ("low", "high"):
            row = getattr(self, name)
            if len(row) != 1 + len(self.joints):
                raise InputError(
                    f"{name} of a joint move has {len(row)} numbers: it must be a speed and "
                    f"{len(self.joints)} turns"
                )
            check_number(f"{name} speed of a joint move", row[0], 1e-3, 40.0, "rad/s")
        check_number("ramp_time of a joint move", self.ramp_time, 1e-3, 10.0, "s")

    @classmethod
    def of(cls, setup: Setup) -> "JointMoves":
        """Return the moves of a laboratory in which cables are swung.

        Raises:
            InputError: The set-up has no strike section.
        """
        strike = setup.strike_section
        low, high = np.radians(np.array(strike.turns_deg, dtype=float).T).tolist()
        return cls(
            arm=setup.arm,
            stick=Stick(length=strike.stick_length, radius=strike.stick_radius),
            start=tuple(np.radians(strike.start_deg).tolist()),
            joints=tuple(setup.arm.joint_names.index(name) for name in strike.joints),
            low=(strike.speed[0], *low),
            high=(strike.speed[1], *high),
            ramp_time=strike.ramp_time,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return ("speed", *(self.arm.joint_names[joint] for joint in self.joints))

    @property
    def arm_with_stick(self) -> Arm:
        """The arm with the stick in place of its gripper, for checks of what it comes near."""
        return dataclasses.replace(self.arm, gripper_length=self.stick.length, grip_offset=0.0)

    @property
    def size(self) -> int:
        """Number of parameters of a move."""
        return 1 + len(self.joints)

    def values(self, unit: ArrayLike) -> Array:
        """Return speed [rad/s] and turns [rad], shape [..., parameter], of unit coordinates.

        Coordinates outside [0, 1] are clipped.
        """
        unit = np.clip(np.asarray(unit, dtype=float), 0.0, 1.0)
        low, high = np.array(self.low), np.array(self.high)
        return low + unit * (high - low)

    def move(self, unit: ArrayLike) -> "JointMove":
        """Return one move by its unit coordinates, shape [parameter]."""
        speed, *moved = self.values(unit).tolist()
        turns = np.zeros(len(TURN_NAMES))
        turns[list(self.joints)] = moved
        return JointMove(speed=speed, turns=tuple(turns.tolist()))

    def unit_of(self, move: "JointMove") -> Array:
        """Return the unit coordinates of a move, shape [parameter]; half where there is a choice.

        Raises:
            InputError: It is none of these moves.
        """
        values = np.array([move.speed, *(move.turns[joint] for joint in self.joints)])
        low, span = np.array(self.low), np.subtract(self.high, self.low)
        still = span == 0.0
        unit = np.where(still, 0.5, (values - low) / np.where(still, 1.0, span))
        others = np.delete(np.array(move.turns[: self.arm.joint_count]), list(self.joints))
        if np.any(np.abs(unit - 0.5) > 0.5 + 1e-6) or np.any(others != 0.0):
            raise InputError(f"{move} is beyond the ranges of speed and turns of the lab file")
        return np.clip(unit, 0.0, 1.0)

    def duration(self, unit: ArrayLike) -> Array:
        """Return the duration of moves [s], shape [...]."""
        values = self.values(unit)
        turn = np.abs(values[..., 1:]).max(axis=-1)
        return np.asarray(self.ramp_time + turn / values[..., 0], dtype=float)

    def angles(self, unit: ArrayLike, times: ArrayLike) -> tuple[Array, Array]:
        """Return set points [rad] and their rates [rad/s], both [move, step, joint].

        Args:
            unit: Unit coordinates of the moves, shape [move, parameter].
            times: Times since the start [s], shape [step].
        """
        values, t = self.values(unit), np.asarray(times, dtype=float)
        turn = np.abs(values[:, 1:]).max(axis=-1)
        rate = values[:, :1] / np.maximum(turn, 1e-9)[:, None]
        ramp, end = self.ramp_time, self.duration(unit)[:, None]
        up = np.clip(t / ramp, 0.0, 1.0)
        down = np.clip((t - (end - ramp)) / ramp, 0.0, 1.0)
        phase = rate * (0.5 * ramp * (up**2 - down**2) + np.clip(t - ramp, 0.0, end - ramp))
        moving = list(self.joints)
        q = np.broadcast_to(np.array(self.start), (*phase.shape, self.arm.joint_count)).copy()
        q[..., moving] += phase[..., None] * values[:, None, 1:]
        qd = np.zeros_like(q)
        qd[..., moving] = (rate * (up - down))[..., None] * values[:, None, 1:]
        return q, qd

    def violations(self, unit: ArrayLike) -> list[LimitPeak]:
        """Return what moves ask for beyond the limits of the arm, by kind, move and joint."""
        unit = np.atleast_2d(np.asarray(unit, dtype=float))
        times = np.arange(0.0, float(self.duration(unit).max()) + KNOT_DT, KNOT_DT)
        q, qd = self.angles(unit, times)
        asked = (q - self.arm.limits.middle, qd, np.diff(qd, axis=1) / KNOT_DT)
        return list(limit_violations(asked, self.arm.limits.to_array()))

    def feasible(self, unit: ArrayLike) -> NDArray[np.bool_]:
        """Return which moves are within limits, and of an arm that never meets itself, [move].

        The stick is the gripper's capsule of `self_gaps`.
        """
        unit = np.atleast_2d(np.asarray(unit, dtype=float))
        good = np.ones(len(unit), dtype=bool)
        for peak in self.violations(unit):
            good[peak.row[0]] = False
        arm = self.arm_with_stick
        times = np.arange(0.0, float(self.duration(unit).max()) + KNOT_DT, 2.0 * KNOT_DT)
        q = self.angles(unit, times)[0].reshape(-1, arm.joint_count)
        for gap in self_gaps(arm, q, self.stick.radius).values():
            good &= gap.reshape(len(unit), -1).min(axis=1) > 0.0
        return good

    def grip_path(self, unit: ArrayLike, duration: float) -> GripPath:
        """Return the paths of the cable's root for a time [s], one for each move."""
        times = knot_times(duration)
        q, _ = self.angles(np.atleast_2d(np.asarray(unit, dtype=float)), times)
        return grip_path_of_joints(times, q, self.arm, self.stick)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SwingPlane:
    """Vertical plane in which moves of parallel joints swing a cable.

    Places in it are the distance ahead of the base's axis and the height [m]. The third coordinate
    is the distance from the plane, to the right of who looks ahead.

    Attributes:
        ahead: Horizontal unit vector, shape [3].
        right: Normal of the plane, shape [3].
        aside: Distance of the plane from the base's axis, to the right [m].
    """

    ahead: Array
    right: Array
    aside: float

    @classmethod
    def of(cls, moves: JointMoves) -> "SwingPlane":
        """Return the plane of the cable's root at the start, across the joints that move.

        Raises:
            InputError: Their axes are not level and parallel.
        """
        frames = moves.arm.frames(np.array(moves.start))
        axes = np.array([frames[joint][:3, 2] for joint in moves.joints])
        axes *= np.sign(axes @ axes[0])[:, None]
        if np.abs(axes - axes[0]).max() > _PARALLEL or abs(axes[0, 2]) > _PARALLEL:
            names = " and ".join(moves.arm.joint_names[joint] for joint in moves.joints)
            raise InputError(
                f"the axes of {names} are not level and parallel at the start of a strike: the "
                "cable would not swing in a vertical plane"
            )
        root = moves.stick.root(frames[-1])
        right = np.array([axes[0, 0], axes[0, 1], 0.0]) / math.hypot(axes[0, 0], axes[0, 1])
        ahead = np.array([-right[1], right[0], 0.0])
        if ahead @ root < 0.0:
            ahead, right = -ahead, -right
        return cls(ahead=ahead, right=right, aside=float(right @ root))

    def points(self, places: ArrayLike) -> Array:
        """Return points [m], shape [..., 3], of places [m], shape [..., 2]."""
        places = np.asarray(places, dtype=float)
        up = np.array([0.0, 0.0, 1.0])
        flat = places[..., :1] * self.ahead + places[..., 1:2] * up
        return flat + self.aside * self.right

    def coordinates(self, points: ArrayLike) -> Array:
        """Return distance ahead, height and distance from the plane of points [m], [..., 3]."""
        points = np.asarray(points, dtype=float)
        away = points @ self.right - self.aside
        return np.stack([points @ self.ahead, points[..., 2], away], axis=-1)


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointMove:
    """One move of a laboratory in which cables are swung: a `Motion`.

    Attributes:
        speed: Speed of the joint that moves most [rad/s].
        turns: Turn of each joint [rad], zero for joints that there are not, shape [7].
    """

    family: ClassVar[str] = "swing"
    parameters: ClassVar[tuple[str, ...]] = ("swing_speed", *TURN_NAMES)

    speed: float
    turns: tuple[float, ...]

    def __str__(self) -> str:
        turns = ", ".join(
            f"joint {number} by {np.degrees(turn):.1f} deg"
            for number, turn in enumerate(self.turns, 1)
            if turn
        )
        return f"a swing at {self.speed:.2f} rad/s, {turns}"

    def to_array(self) -> Array:
        """Return speed [rad/s] and turns [rad], shape [parameter]."""
        return np.array([self.speed, *self.turns])

    @classmethod
    def from_array(cls, values: ArrayLike) -> "JointMove":
        """Make a move from its parameters."""
        speed, *turns = np.asarray(values, dtype=float).tolist()
        return cls(speed=speed, turns=tuple(turns))

    def mirrored(self) -> "JointMove":
        """Raise an error: the plane of a swing is no mirror image of itself."""
        raise InputError("a swing has no mirror image")

    def grip_path(self, setup: Setup) -> GripPath:
        """Return the path of the cable's root, one row."""
        moves = JointMoves.of(setup)
        unit = moves.unit_of(self)
        return moves.grip_path(unit, float(moves.duration(unit)))

    def set_points(self, grip_path: GripPath, setup: Setup) -> JointPath:
        """Return the angles that the move is made of, at the robot's control cycle."""
        moves, dt = JointMoves.of(setup), setup.motion.control_dt
        unit = moves.unit_of(self)
        count = math.ceil(float(moves.duration(unit)) / dt - 1e-9) + 1
        times = np.arange(count, dtype=float) * dt
        (q,), (qd,) = moves.angles(unit[None], times)
        return check_set_points(JointPath(times=times, q=q, qd=qd), setup, str(self))


def knot_times(duration: float) -> Array:
    """Return the times of the knots of a grip path that lasts some time [s], shape [step]."""
    return np.arange(math.ceil(duration / KNOT_DT - 1e-9) + 1, dtype=float) * KNOT_DT


def grip_path_of_joints(times: Array, q: Array, arm: Arm, stick: Stick) -> GripPath:
    """Return the paths of a cable's root at the end of a stick, from joint angles.

    Args:
        times: Evenly spaced times [s], shape [step].
        q: Joint angles [rad], shape [move, step, joint].
        arm: Arm.
        stick: Stick on its flange.
    """
    from scipy.interpolate import CubicSpline

    frames = arm.frames(q)
    flange = frames[-1]
    yaw, pitch = _continuous(flange[..., :3, 2])
    # The turn about the cable: the part of the joints' rates along it.
    axes = np.stack([frame[..., :3, 2] for frame in frames[:-1]], axis=-2)
    spin = np.einsum("...jx,...x->...j", axes, flange[..., :3, 2])
    middle = 0.5 * (spin[:, 1:] + spin[:, :-1])
    roll = np.pad(np.cumsum(np.sum(middle * np.diff(q, axis=1), axis=-1), axis=1), ((0, 0), (1, 0)))
    channels = np.concatenate(
        [stick.root(flange), yaw[..., None], pitch[..., None], roll[..., None]], axis=-1
    )
    spline = CubicSpline(times, channels, axis=1)
    # spline.c is [power, piece, move, channel], highest power first.
    cubic = np.transpose(spline.c[::-1], (2, 1, 3, 0))
    coefficients = np.concatenate([cubic, np.zeros((*cubic.shape[:-1], 2))], axis=-1)
    return GripPath(
        knots=np.broadcast_to(times, (len(q), len(times))).copy(),
        coefficients=coefficients[:, :, :5],
        roll=coefficients[:, :, 5] if np.any(np.abs(roll) > 1e-9) else None,
    )


def _continuous(along: Array) -> tuple[Array, Array]:
    """Return yaw and pitch [rad], both [move, step], of directions, [move, step, 3].

    They do not jump where a direction passes straight down or up: the pitch then goes on beyond a
    right angle. Yaw starts from where the direction is most level, and goes on to both ends.
    """
    level = np.hypot(along[..., 0], along[..., 1])
    yaw = np.arctan2(along[..., 0], along[..., 1])
    rows, middle = np.arange(len(along)), np.argmax(level, axis=1)
    upright = level < _UPRIGHT
    for way in (1, -1):
        known = yaw[rows, middle]
        for step in range(along.shape[1]) if way > 0 else range(along.shape[1] - 1, -1, -1):
            # To the nearest of the equal angles, and of those half a turn from them.
            turn = np.pi * np.round((known - yaw[:, step]) / np.pi)
            found = np.where(upright[:, step], known, yaw[:, step] + turn)
            reached = way * (step - middle) >= 0
            yaw[:, step] = np.where(reached, found, yaw[:, step])
            known = np.where(reached, found, known)
    forward = along[..., 0] * np.sin(yaw) + along[..., 1] * np.cos(yaw)
    return yaw, np.unwrap(np.arctan2(along[..., 2], forward), axis=1)


def swing_shape(q: Array, arm: Arm, stick: Stick) -> ArmShape:
    """Return the arm above its base and its stick as capsules, at angles [rad], [..., joint].

    The ends of the capsules have the shape [..., rod, 2, 3].
    """
    frames = arm.frames(q)
    links = arm.links(frames)
    flange = frames[-1]
    tool = rod_ends([(flange[..., :3, 3], stick.root(flange))])
    return ArmShape(
        ends=np.concatenate([links.ends[..., 1:, :, :], tool], axis=-3),
        radii=np.array([*links.drawn[1:], stick.radius]),
    )
