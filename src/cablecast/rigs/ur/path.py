"""Paths of set points for the arm, and the checks that each must pass before it is sent."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.limits import JOINT_NAMES
from cablecast.errors import InputError, JointLimitError
from cablecast.rigs.ur.collision import find_collision
from cablecast.setup import Setup

Array = NDArray[np.float64]

CONTROL_DTS = (0.002, 0.004, 0.008)
"""Times between set points that the programs use [s]: whole cycles of both controllers."""
_LIMIT_TOLERANCE = 1.001
_ACCELERATION_MARGIN = 1.25
"""Second differences of set points overshoot the true peak of an acceleration at its corners."""


@dataclasses.dataclass(frozen=True)
class SetPoints:
    """Set points at even times, from rest to rest.

    Attributes:
        q: Joint angles [rad], shape [tick, 6].
        dt: Time between two of them [s].
    """

    q: Array
    dt: float

    def __post_init__(self):
        if self.q.ndim != 2 or self.q.shape[1] != 6 or len(self.q) < 2:
            raise InputError(f"set points have shape {self.q.shape}, not [tick, 6]")
        if not np.all(np.isfinite(self.q)):
            raise InputError("set points must be finite")
        if not any(abs(self.dt - dt) < 1e-9 for dt in CONTROL_DTS):
            known = ", ".join(f"{dt:g}" for dt in CONTROL_DTS)
            raise InputError(f"control_dt = {self.dt:g} s of a robot must be one of {known} s")

    @property
    def duration(self) -> float:
        """Time from the first to the last [s]."""
        return (len(self.q) - 1) * self.dt

    def slowed(self, factor: float) -> "SetPoints":
        """Return the same way at a part of the speed.

        Args:
            factor: Share of the speed, above 0 and at most 1 [-].
        """
        from scipy.interpolate import CubicSpline

        times = np.arange(len(self.q)) * self.dt
        count = int(np.ceil(times[-1] / factor / self.dt)) + 1
        spline = CubicSpline(times, self.q, axis=0, bc_type="clamped")
        q = spline(np.minimum(np.arange(count) * self.dt * factor, times[-1]))
        return SetPoints(np.asarray(q), self.dt)


def joint_move(start: Array, end: Array, speed: float, dt: float) -> SetPoints:
    """Return a straight way in joint space, from rest to rest.

    Args:
        start: Joint angles at its begin [rad], shape [6].
        end: Joint angles at its end [rad], shape [6].
        speed: Largest speed of a joint [rad/s].
        dt: Time between set points [s].
    """
    distance = float(np.abs(end - start).max())
    duration = max(1.875 * distance / speed, 4 * dt)
    count = int(np.ceil(duration / dt)) + 1
    u = np.linspace(0.0, 1.0, count)[:, None]
    return SetPoints(start + u**3 * (10 - 15 * u + 6 * u * u) * (end - start), dt)


def check_path(points: SetPoints, setup: Setup, what: str) -> None:
    """Refuse set points that leave limits or box, or come too close to anything.

    Args:
        points: Set points.
        setup: Arm with its limits, and the robot section with box, margins and obstacles.
        what: Name of the motion in the error.

    Raises:
        JointLimitError: A limit, the box or a distance is violated; names the value and the bound.
        InputError: The set-up has no robot.
    """
    robot, limits = setup.robot, setup.arm.limits
    if robot is None:
        raise InputError("the lab file has no robot section: --rig ur needs one")
    q, dt = points.q, points.dt
    position = np.array(limits.position) - robot.position_margin
    qd = np.diff(q, axis=0) / dt
    padded = np.concatenate([np.zeros((1, 6)), qd, np.zeros((1, 6))])
    qdd = np.diff(padded, axis=0) / dt
    for values, bound, name, unit in (
        (q, position, "at", "rad"),
        (qd, np.array(limits.velocity) * _LIMIT_TOLERANCE, "turning at", "rad/s"),
        (qdd, np.array(limits.acceleration) * _ACCELERATION_MARGIN, "speeding up at", "rad/s²"),
    ):
        over = np.abs(values) - bound
        if over.max() > 0.0:
            tick, joint = np.unravel_index(int(np.argmax(over)), over.shape)
            raise JointLimitError(
                f"{what}: {JOINT_NAMES[int(joint)]} {name} {values[tick, joint]:.3f} {unit} is "
                f"beyond {bound[joint]:.3f} {unit}"
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
    if found := find_collision(setup.arm, robot, q):
        raise JointLimitError(f"{what}: {found}")
