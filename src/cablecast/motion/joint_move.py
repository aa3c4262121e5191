"""Joint-space moves: a family of motions of any serial arm that holds a stick with a cable.

Some joints move from a posture at rest to another and stop there, all in the same phase: the joint
that moves most has the speed of the move, and speed up and slow down each take the same time
(movej of many controllers). The cable goes on at the end of the stick as the stick points.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.base import Arm, LimitPeak, limit_violations, rod_ends
from cablecast.arm.shape import ArmShape, self_gaps
from cablecast.errors import InputError, check_number, check_ranges
from cablecast.motion.grip_path import GripPath

Array = NDArray[np.float64]

KNOT_DT = 0.01
"""Time between the knots of a grip path [s]: a tenth of a short ramp."""

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

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return ("speed", *(self.arm.joint_names[joint] for joint in self.joints))

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
        arm = dataclasses.replace(self.arm, gripper_length=self.stick.length, grip_offset=0.0)
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
