"""Path of one motion of an arm: its fit, and the checks before anything moves."""

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from cablecast.arm.base import LimitKind, limit_violations
from cablecast.arm.shape import find_collision
from cablecast.conventions import Array
from cablecast.errors import InputError, JointLimitError
from cablecast.motion.trajectory import JointPath
from cablecast.setup import Setup

FIT_TOLERANCE = 8e-5
"""Largest distance of a piece from the set points [rad]: with what lies between them, 1e-4."""
_KNOT_DT = 0.008
"""Pieces last whole multiples of it [s]: whole cycles of every controller."""
_CHECK_DT = 0.002
DECIMALS_Q, DECIMALS_QD = 6, 5
"""A microradian moves the grip by less than a micrometre."""
_LIMIT_TOLERANCE = 1.001
_ACCELERATION_MARGIN = 1.25
"""Pieces overshoot the true peak of an acceleration at its corners."""


@dataclasses.dataclass(frozen=True)
class JointCurve:
    """Path of the joints as cubic pieces between knots, from rest to rest.

    Angles and rates are rounded as they are sent: what is checked is what the controller evaluates.

    Attributes:
        times: Times of the knots, the first 0 [s], shape [knot].
        q: Joint angles at the knots [rad], shape [knot, joint].
        qd: Joint rates at the knots, zero at both ends [rad/s], shape [knot, joint].
    """

    times: Array
    q: Array
    qd: Array

    def __post_init__(self):
        shape = (len(self.times), self.q.shape[-1])
        spans = np.diff(self.times) / _KNOT_DT
        if len(spans) < 1 or self.q.shape != shape or self.qd.shape != shape:
            raise InputError(
                f"a curve has shapes times {self.times.shape}, q {self.q.shape}, qd "
                f"{self.qd.shape}, not [knot], [knot, joint], [knot, joint]"
            )
        if not (np.isfinite(self.q).all() and np.isfinite(self.qd).all()):
            raise InputError("the path of a motion must be finite")
        if np.any(spans < 0.5) or np.any(abs(spans - spans.round()) > 1e-6):
            raise InputError(f"pieces of a motion must last whole multiples of {_KNOT_DT:g} s")
        if np.any(self.qd[[0, -1]] != 0.0):
            raise InputError("a motion must start and end at rest")
        object.__setattr__(self, "q", self.q.round(DECIMALS_Q))
        object.__setattr__(self, "qd", self.qd.round(DECIMALS_QD))

    @classmethod
    def fit(cls, path: JointPath) -> "JointCurve":
        """Fit a curve to set points at even times, with as few pieces as `FIT_TOLERANCE` allows.

        Raises:
            InputError: The set points are at times that no controller has.
        """
        dt = float(path.times[1] - path.times[0]) if len(path.times) > 1 else 0.0
        stride = round(_KNOT_DT / dt) if dt > 0.0 else 0
        if abs(stride * dt - _KNOT_DT) > 1e-9 or stride < 1:
            raise InputError(
                f"control_dt = {dt:g} s of a robot must divide {_KNOT_DT:g} s, as 0.002 s does"
            )
        if not np.allclose(np.diff(path.times), dt, rtol=0.0, atol=1e-9):
            raise InputError("the set points of a robot must come at even times")
        # Held at its end until the next knot.
        pad = ((0, -(len(path.q) - 1) % stride), (0, 0))
        q, qd = np.pad(path.q, pad, "edge"), np.pad(path.qd, pad)
        qd[[0, -1]] = 0.0
        whole = cls(np.arange(0, len(q), stride, dtype=np.float64) * dt, q[::stride], qd[::stride])
        knots, last = [0], len(whole.times) - 1
        while knots[-1] < last:
            end = knots[-1] + 1
            while end < last:
                piece = [knots[-1], end + 1]
                meant = q[piece[0] * stride : piece[1] * stride + 1]
                times = whole.times[piece[0]] + np.arange(len(meant)) * dt
                if np.abs(whole._spline(piece)(times) - meant).max() > FIT_TOLERANCE:
                    break
                end += 1
            knots.append(end)
        return cls(whole.times[knots], whole.q[knots], whole.qd[knots])

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return float(self.times[-1])

    def evaluate(self, times: ArrayLike) -> Array:
        """Return joint angles [rad], shape [time, joint], held before start and after end."""
        return self._spline(slice(None))(np.clip(times, 0.0, self.duration))

    def slowed(self, factor: int) -> "JointCurve":
        """Return the same way in a whole multiple of its time."""
        return JointCurve(self.times * factor, self.q, self.qd / factor)

    def _spline(self, knots: slice | list[int]) -> Callable[[Array], Array]:
        """Return the pieces between some of the knots, as a function of time."""
        from scipy.interpolate import CubicHermiteSpline

        return CubicHermiteSpline(self.times[knots], self.q[knots], self.qd[knots])


def straight_move(start: Array, end: Array, speed: float) -> JointCurve:
    """Return a straight way in joint space, from rest to rest.

    Args:
        start: Joint angles at its start [rad], shape [joint].
        end: Joint angles at its end [rad], shape [joint].
        speed: Largest speed of a joint [rad/s].
    """
    distance = float(np.abs(end - start).max())
    duration = max(1.875 * distance / speed, 4 * _KNOT_DT)
    count = int(np.ceil(duration / _KNOT_DT))
    u = np.linspace(0.0, 1.0, count + 1)[:, None]
    times = np.arange(count + 1, dtype=np.float64) * _KNOT_DT
    q = start + u**3 * (10 - 15 * u + 6 * u * u) * (end - start)
    qd = 30 * u**2 * (1 - u) ** 2 * (end - start) / times[-1]
    return JointCurve.fit(JointPath(times=times, q=q, qd=qd))


def check_path(curve: JointCurve, setup: Setup, what: str, floor: float | None = None) -> None:
    """Refuse a path that leaves limits or box, or comes too close to anything.

    Args:
        curve: The path as it is sent.
        setup: Arm with its limits, and the robot section with box, margins and obstacles.
        what: Name of the motion in the error.
        floor: Height of the floor [m]; None where there is a table.

    Raises:
        JointLimitError: A limit, the box or a distance is violated; names the value and the bound.
        InputError: The set-up has no robot.
    """
    robot, limits = setup.robot, setup.arm.limits
    if robot is None:
        raise InputError("the lab file has no robot section: a real arm needs one")
    q = curve.evaluate(np.arange(round(curve.duration / _CHECK_DT) + 1) * _CHECK_DT)
    if q.shape[1] != setup.arm.joint_count:
        raise InputError(f"{what} has {q.shape[1]} joints, the arm {setup.arm.joint_count}")
    qd = np.diff(q, axis=0) / _CHECK_DT
    qdd = np.diff(qd, axis=0, prepend=0.0, append=0.0) / _CHECK_DT
    asked = (q - np.array(limits.middle), qd, qdd)
    bounds = (
        np.array(limits.position) - robot.position_margin,
        np.array(limits.velocity) * _LIMIT_TOLERANCE,
        np.array(limits.acceleration) * _ACCELERATION_MARGIN,
    )
    if peak := next(limit_violations(asked, bounds), None):
        doing = {
            LimitKind.POSITION: "off the middle of its range by" if any(limits.middle) else "at",
            LimitKind.VELOCITY: "turning at",
            LimitKind.ACCELERATION: "speeding up at",
        }[peak.kind]
        raise JointLimitError(
            f"{what}: {setup.arm.joint_names[peak.joint]} {doing} {peak.value:.3f} "
            f"{peak.kind.value} is beyond {peak.bound:.3f} {peak.kind.value}"
        )
    low, high = np.array(robot.box_low), np.array(robot.box_high)
    for name, places in (
        ("grip", setup.arm.grip_pose(q)[:, :3]),
        ("flange", setup.arm.forward(q)[:, :3, 3]),
    ):
        outside = np.maximum(low - places, places - high).max(axis=1)
        if outside.max() > 0.0:
            tick = int(np.argmax(outside))
            raise JointLimitError(
                f"{what}: the {name} at {places[tick].round(3).tolist()} m is outside the box from "
                f"{low.tolist()} to {high.tolist()} m"
            )
    if found := find_collision(setup.arm, robot, q, floor):
        raise JointLimitError(f"{what}: {found}")
