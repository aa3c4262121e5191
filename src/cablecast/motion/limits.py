"""Limits of the arm, the table and the robot's box, and what of them a motion violates."""

import collections
import dataclasses
import functools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import Arm, JointMotion, LimitKind, limit_violations
from cablecast.motion.grip_path import DEGREE, GripPath
from cablecast.setup import Setup

LIMIT_SHARE = 0.98
"""Share of each limit that a motion may use [-]. Peaks are taken from samples; a peak between two
samples is less than 2 % higher (measured in tests/motion/test_feasibility.py)."""

# Sample points of each piece of a grip path, as shares of its duration. Both ends are included:
# accelerations peak where the jerk switches, and jump where the radius comes to rest.
_PARTS = np.linspace(0.0, 1.0, 5)
# Distance beyond the table's near edge that is forgiven [m]: a sweep of 90 deg about the base ends
# on the edge but for rounding.
_EDGE_SLACK = 1e-5
# Depth below the table's surface that is forgiven [m]: the reset of a cable of 0.1 m passes 1.3 mm
# below it between its via points.
_TABLE_SLACK = 2e-3
# Distance that the sampled gripper keeps from the box of a robot [m]: it goes up to 1 mm farther
# between the samples.
_BOX_MARGIN = 2e-3


@dataclasses.dataclass(frozen=True, kw_only=True)
class LimitViolation:
    """One limit that a motion violates.

    Attributes:
        what: What is beyond it, e.g. `elbow velocity` or `robot box: x of the grip`.
        value: Peak of that over the motion.
        bound: Largest allowed value, or smallest where that is above the peak.
        unit: Unit of both.
        note: Words behind the bound.
    """

    what: str
    value: float
    bound: float
    unit: str
    note: str = ""

    @property
    def name(self) -> str:
        """Short name of the limit, e.g. `elbow velocity` or `robot box`."""
        return self.what.partition(":")[0]

    def __str__(self) -> str:
        side, unit = "above" if self.value > self.bound else "below", self.unit
        return f"{self.what} {self.value:.4g} {unit} is {side} {self.bound:.4g} {unit}{self.note}"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Feasibility:
    """Feasibility of a batch of motions for the arm.

    Attributes:
        mask: True where the arm can follow, shape [action].
        peaks: Largest angle from the middle of each joint's range [rad], speed [rad/s] and
            acceleration [rad/s²]; NaN where the gripper may not be, shape [action, 3, joint].
        bounds: Largest allowed peaks, shape [3, joint].
        place: Coordinate of the gripper with the least margin [m], shape [action].
        place_bound: Bound of the reach, the table or the robot's box there [m], shape [action].
        place_name: That bound, and what is beyond it, shape [action].
        joint_names: Names of the joints.
    """

    mask: NDArray[np.bool_]
    peaks: NDArray[np.float64]
    bounds: NDArray[np.float64]
    place: NDArray[np.float64]
    place_bound: NDArray[np.float64]
    place_name: NDArray[np.str_]
    joint_names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.mask)

    @functools.cached_property
    def reasons(self) -> dict[int, tuple[LimitViolation, ...]]:
        """Limits that each rejected motion violates, by row."""
        found: dict[int, list[LimitViolation]] = {
            int(row): [] for row in np.flatnonzero(~self.mask)
        }
        for row in np.flatnonzero(np.isnan(self.peaks[:, 0, 0])).tolist():
            violation = LimitViolation(
                what=str(self.place_name[row]),
                value=float(self.place[row]),
                bound=float(self.place_bound[row]),
                unit=LimitKind.REACH.value,
            )
            found[row].append(violation)
        peaks = np.moveaxis(self.peaks[:, :, None], 1, 0)
        for peak in limit_violations(peaks, self.bounds):
            violation = LimitViolation(
                what=f"{self.joint_names[peak.joint]} {peak.kind.name.lower()}",
                value=peak.value,
                bound=peak.bound,
                unit=peak.kind.value,
                note=f", {100 * LIMIT_SHARE:g} % of the joint's limit",
            )
            found[peak.row[0]].append(violation)
        return {row: tuple(violations) for row, violations in found.items()}

    def describe(self, row: int) -> str:
        """Return one line that names every limit that a rejected motion violates."""
        return "; ".join(str(violation) for violation in self.reasons.get(row, ()))

    def counts(self) -> dict[str, int]:
        """Return the number of motions that violate each limit, by name, most frequent first."""
        names = (v.name for violations in self.reasons.values() for v in violations)
        return dict(collections.Counter(names).most_common())


def check_grip_paths(
    grip_path: GripPath, setup: Setup, *, casting: bool = False, both_sides: bool = False
) -> Feasibility:
    """Check motions against the reach and the joint limits of the arm, and the box of its robot.

    Args:
        grip_path: One motion per row.
        setup: Set-up with the arm; r_max of its workspace bounds the reach too.
        casting: Whether the gripper must stay in front of the table's near edge, beyond which a
            cast would not lie on the table.
        both_sides: Whether to check each motion mirrored about the workspace axis too, and keep
            the worse result. The arm is not symmetric: its shoulder is offset from the base axis.
    """
    bounds = LIMIT_SHARE * setup.arm.limits.to_array()
    peaks, place, place_bound, place_name = _peaks(grip_path, setup, casting, both_sides)
    mask = np.all(peaks <= bounds, axis=(1, 2))
    return Feasibility(
        mask=mask,
        peaks=peaks,
        bounds=bounds,
        place=place,
        place_bound=place_bound,
        place_name=place_name,
        joint_names=setup.arm.joint_names,
    )


def _peaks(
    grip_path: GripPath, setup: Setup, casting: bool, both_sides: bool
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return the peaks of every joint, and the worst place, its bound and its name."""
    arm = setup.arm
    lengths = np.diff(grip_path.knots, axis=1)
    used = lengths > 0
    # A path that only holds its pose still needs one piece to sample.
    used[:, 0] = True
    starts = np.concatenate([[0], np.cumsum(used.sum(axis=1))[:-1]])
    motion, poses = _sample(arm, grip_path.coefficients[used], lengths[used])
    peaks = _row_peaks(motion, starts, arm)
    if both_sides:
        if motion.mirrored is None:
            mirrored, _ = _sample(arm, grip_path.mirrored().coefficients[used], lengths[used])
        else:
            mirrored = motion.mirrored()
        peaks = np.maximum(peaks, _row_peaks(mirrored, starts, arm))
    worst, bound, excess = np.zeros((3, len(grip_path)))
    excess[:] = -np.inf
    names = np.full(len(grip_path), "", dtype="U32")
    for name, values, limit, sign in _places(motion, poses, setup, casting, both_sides):
        beyond = np.maximum.reduceat(np.max(sign * (values - limit), axis=0), starts)
        worse = beyond > excess
        at_worst = np.maximum.reduceat(np.max(sign * values, axis=0), starts) * sign
        excess = np.where(worse, beyond, excess)
        worst = np.where(worse, at_worst, worst)
        bound = np.where(worse, at_worst - sign * beyond, bound)
        names[worse] = name
    peaks[excess > 0] = np.nan
    return peaks, worst, bound, names


def _places(
    motion: JointMotion, poses: NDArray[np.float64], setup: Setup, casting: bool, both_sides: bool
) -> Iterator[tuple[str, NDArray[np.float64], Any, float]]:
    """Yield what bounds the gripper: a name, values, their limit, and 1 for a largest value."""
    arm, workspace, robot = setup.arm, setup.workspace, setup.robot
    # The arm's reach is measured at the flange, the workspace's r_max at the grip. The reach is the
    # same on both sides.
    yield "reach: radius", motion.radius, motion.radius_max, 1.0
    yield "reach: radius", motion.radius, motion.radius_min, -1.0
    x, y, z, yaw, pitch = np.moveaxis(poses, -1, 0)
    yield "reach: radius", np.hypot(x, y), workspace.r_max, 1.0
    if casting:
        yield "table edge: y of the grip", y, workspace.y_min - _EDGE_SLACK, -1.0
    if setup.strike is None:
        yield "table: z of the grip", z, -_TABLE_SLACK, -1.0
    if robot is None:
        return
    low, high = np.array(robot.box_low) + _BOX_MARGIN, np.array(robot.box_high) - _BOX_MARGIN
    if both_sides:
        low[0], high[0] = max(low[0], -high[0]), min(high[0], -low[0])
    # The flange is behind the grip along the cable, and above it.
    back = arm.gripper_length * np.sin(pitch) + arm.grip_offset * np.cos(pitch)
    up = arm.gripper_length * np.cos(pitch) - arm.grip_offset * np.sin(pitch)
    flange = (x - back * np.sin(yaw), y - back * np.cos(yaw), z + up)
    for part, coordinates in (("grip", (x, y, z)), ("flange", flange)):
        for axis, values in enumerate(coordinates):
            yield f"robot box: {'xyz'[axis]} of the {part}", values, low[axis], -1.0
            yield f"robot box: {'xyz'[axis]} of the {part}", values, high[axis], 1.0


def _sample(
    arm: Arm, coefficients: NDArray[np.float64], lengths: NDArray[np.float64]
) -> tuple[JointMotion, NDArray[np.float64]]:
    """Return joint motion and poses at the sample points, leading shape [part, piece]."""
    powers = np.arange(DEGREE + 1)
    # Scale time by the piece's duration, and put the piece axis last: sums then run along
    # contiguous memory.
    scaled = np.ascontiguousarray(coefficients.transpose(2, 1, 0)) * (
        lengths ** powers[:, None, None]
    )
    scaled = scaled.reshape(DEGREE + 1, -1)
    safe = np.where(lengths > 0, lengths, 1.0)
    values = []
    for order in range(3):
        basis = np.zeros((len(_PARTS), DEGREE + 1))
        for power in range(order, DEGREE + 1):
            factor = math.perm(power, order)
            basis[:, power] = factor * _PARTS ** (power - order)
        sampled = (basis @ scaled).reshape(len(_PARTS), -1, len(lengths)) / safe**order
        values.append(np.moveaxis(sampled, 1, -1))
    return arm.inverse_motion(*values), values[0]


def _row_peaks(motion: JointMotion, starts: NDArray[np.intp], arm: Arm) -> NDArray[np.float64]:
    """Return the largest absolute values over the samples of each row, shape [row, 3, joint]."""
    middle = arm.limits.middle
    peaks = [
        np.maximum.reduceat(np.max(np.abs(values), axis=0), starts, axis=0)
        for values in (motion.q - middle if any(middle) else motion.q, motion.qd, motion.qdd)
    ]
    return np.stack(peaks, axis=1)
