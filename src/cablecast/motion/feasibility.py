"""Feasibility of motions: reach, joint limits, and the limits that a rejected motion violates."""

import collections
import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.base import Arm, JointMotion, LimitKind, limit_violations
from cablecast.conventions import stream
from cablecast.errors import InputError, check_count, check_seed
from cablecast.motion.action import (
    ACTION_SIZE,
    PSI_MAX,
    R2_BOUNDS,
    ActionRanges,
    check_action_values,
    grid_actions,
    with_psi,
)
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.grip_path import DEGREE, GripPath
from cablecast.runs.progress import Progress, ProgressCallback, ignore
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
# Distance that the sampled gripper keeps from the box of a robot [m]: it goes up to 1 mm farther
# between the samples.
_BOX_MARGIN = 2e-3
# Actions per chunk: keeps the intermediate arrays in the processor's cache.
_CHUNK = 256

ACTION_COUNT_MAX = 1_000_000
"""Largest number of actions per search; their grid has to fit into memory."""

# Actions per draw. Fixed, so that a larger count starts with the actions of a smaller one.
_UNIFORM_DRAWS = 256
# Number of draws without a feasible action after which the search gives up.
_UNIFORM_EMPTY_MAX = 40


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


def check_actions(
    actions: ArrayLike,
    setup: Setup,
    *,
    both_sides: bool = True,
    progress: ProgressCallback = ignore,
) -> Feasibility:
    """Check casting motions against the arm's reach and joints, the table and the robot's box.

    Args:
        actions: theta1, theta2 [rad], r2 [m], psi [rad], pace [-], shape [action, 5].
        setup: Arm and its limits, workspace, motion settings and robot.
        both_sides: Whether the mirror image of an action must be feasible too, so that it serves
            targets on either side.
        progress: Receives how many are checked.

    Raises:
        ActionError: An action is not a casting motion; see `check_action_values`.
    """
    actions = check_action_values(actions)
    chunks = []
    for start in range(0, len(actions), _CHUNK):
        grip_path = cast_grip_paths(actions[start : start + _CHUNK], setup)
        chunks.append(check_grip_paths(grip_path, setup, casting=True, both_sides=both_sides))
        done, total = start + len(grip_path), len(actions)
        progress(Progress(task="Motions checked against the arm", done=done, total=total))
    return Feasibility(
        bounds=chunks[0].bounds,
        joint_names=setup.arm.joint_names,
        **{
            name: np.concatenate([getattr(chunk, name) for chunk in chunks])
            for name in ("mask", "peaks", "place", "place_bound", "place_name")
        },
    )


# Widest ranges of the search: sweeps of 1 to 90 deg, and a wrist turn of 90 deg.
_SWEEP = (float(np.radians(1.0)), float(np.radians(90.0)))
_TURN = float(np.radians(90.0))
# Least radius over the arm's reach, which keeps a folded elbow clear of the base.
_FOLDED = 0.37
_RANGE_COUNTS, _PACE_COUNT = (8, 8, 8, 4), 3
# Share of the feasible actions that lies beyond either end of a range: a few at the limits of speed
# do not widen it to where almost no motion is feasible.
_RANGE_TAIL = 0.02


def feasible_ranges(
    setup: Setup, turns: bool = True, pace: tuple[float, float] = (1.0, 1.0)
) -> ActionRanges:
    """Return the ranges of the motions that the arm can follow above the table.

    They bound the feasible actions of a grid, without the outermost 2 % on either side of each
    variable.

    Args:
        setup: Arm, workspace and motion settings.
        turns: Whether the wrist turns (action set A2 of the paper) or not (A1).
        pace: Range of the pace [-]; the paper's alone by default.

    Raises:
        InputError: The arm can follow no such motion; the error names the limits that forbid it.
    """
    return _find_ranges(setup, turns, pace)


@functools.lru_cache(maxsize=16)
def _find_ranges(setup: Setup, turns: bool, pace: tuple[float, float]) -> ActionRanges:
    widest = widest_ranges(setup, pace).to_array()
    box = widest.copy()
    for tail in (0.0, _RANGE_TAIL):
        ranges = _ranges(box)
        grid = grid_actions(ranges, (*_RANGE_COUNTS, _pace_count(ranges)))
        found = check_actions(grid, setup)
        actions = grid[found.mask]
        if not len(actions):
            raise InputError(
                f"the arm can follow no motion with reset_y = {setup.workspace.reset_y:g} m, "
                f"r0 = {setup.motion.r0:g} m and v_max = {setup.motion.v_max:g} m/s: "
                + _most_broken(found)
            )
        actions[:, 3] -= actions[:, 1]
        step = 0.0 if tail else np.diff(box[:4], axis=1) / (np.array(_RANGE_COUNTS)[:, None] - 1)
        ends = np.quantile(actions[:, :4], [tail, 1.0 - tail], axis=0).T
        box[:4] = np.clip(ends + step * np.array([-1.0, 1.0]), widest[:4, :1], widest[:4, 1:])
    if not turns:
        box[3] = 0.0
    return _ranges(box)


def _pace_count(ranges: ActionRanges) -> int:
    return 1 if ranges.pace[0] == ranges.pace[1] else _PACE_COUNT


def widest_ranges(setup: Setup, pace: tuple[float, float] = (1.0, 1.0)) -> ActionRanges:
    """Return the widest ranges that are searched: up to where the arm folds or ends."""
    workspace, r0 = setup.workspace, setup.motion.r0
    # The polar origin lies behind the base, or in front of it where this is negative.
    behind = r0 - workspace.reset_y
    low = max(R2_BOUNDS[0], _FOLDED * workspace.r_max + behind)
    high = min(workspace.r_max + abs(behind), R2_BOUNDS[1])
    sweep = (-_SWEEP[1], -_SWEEP[0])
    return _ranges(np.array([sweep, _SWEEP, (low, max(low, high)), (0.0, _TURN), pace]))


def _ranges(box: NDArray[np.float64]) -> ActionRanges:
    """Return the ranges within a box, shape [5, 2], whose psi keeps to its bound."""
    box = box.copy()
    box[3, 0] = 0.0
    box[3, 1] = min(box[3, 1], PSI_MAX - box[1, 1])
    names = ("theta1", "theta2", "r2", "wrist", "pace")
    return ActionRanges(
        **{name: (float(low), float(high)) for name, (low, high) in zip(names, box, strict=True)}
    )


def _most_broken(found: Feasibility) -> str:
    """Return what keeps most of the actions of a grid from being feasible."""
    counts = found.counts()
    name = next(iter(counts))
    violation = next(
        violation
        for violations in found.reasons.values()
        for violation in violations
        if violation.name == name
    )
    return f"{100 * counts[name] / len(found):.0f} % break its {name}, such as {violation}"


def feasible_of_grid(counts: Sequence[int], setup: Setup) -> NDArray[np.float64]:
    """Return the feasible actions of a `grid_actions` of the set-up's ranges, shape [action, 5]."""
    check_count("grid size", math.prod(counts), 1, ACTION_COUNT_MAX)
    grid = grid_actions(feasible_ranges(setup), counts)
    actions = grid[check_actions(grid, setup).mask]
    if not len(actions):
        raise InputError(
            f"no action of the grid {tuple(counts)} with r0 = {setup.motion.r0} m and "
            f"v_max = {setup.motion.v_max} m/s is feasible"
        )
    return actions


def feasible_grid(
    count: int,
    setup: Setup,
    ranges: ActionRanges | None = None,
    seed: int = 0,
    progress: ProgressCallback = ignore,
) -> NDArray[np.float64]:
    """Return feasible actions from a grid, all with theta1 < 0 < theta2 <= psi.

    The grid is just fine enough for the count. It has half as many wrist turns, and paces, as
    values of the other variables (the paper's 10 x 10 x 10 x 5). Surplus feasible actions are
    dropped at random.

    Args:
        count: Number of actions.
        setup: Arm, workspace and motion settings.
        ranges: Ranges of the grid; `feasible_ranges` if None.
        seed: Seed for the random choice.
        progress: Receives how many motions of the grid are checked.

    Returns:
        Actions in grid order, shape [count, 5].

    Raises:
        InputError: The count is not positive, or no action within the ranges is feasible.
    """
    check_count("count", count, high=ACTION_COUNT_MAX)
    check_seed(seed)
    ranges = ranges or feasible_ranges(setup)
    return _kept(_find_grid, count, setup, ranges, seed, progress)


def _find_grid(
    count: int, setup: Setup, ranges: ActionRanges, seed: int, progress: ProgressCallback
) -> NDArray[np.float64]:
    probe = check_actions(grid_actions(ranges, (7, 7, 7, 3, _pace_count(ranges))), setup)
    share = float(np.mean(probe.mask))
    if share == 0.0:
        raise InputError(f"the arm can follow no action with {ranges}: {_most_broken(probe)}")
    size = count / share
    while True:
        grid = grid_actions(ranges, _grid_counts(ranges, size))
        actions = grid[check_actions(grid, setup, progress=progress).mask]
        if len(actions) >= count:
            break
        size = max(1.02 * size * count / max(len(actions), 1), len(grid) + 1.0)
    chosen = stream(seed, "feasible grid").choice(len(actions), count, replace=False)
    return actions[np.sort(chosen)]


def feasible_actions(
    count: int,
    setup: Setup,
    ranges: ActionRanges,
    seed: int = 0,
    progress: ProgressCallback = ignore,
) -> NDArray[np.float64]:
    """Return actions that cover ranges: a grid, as in the paper, or drawn where the pace varies.

    A grid of five variables has few values of each.
    """
    if _pace_count(ranges) == 1:
        return feasible_grid(count, setup, ranges, seed, progress)
    return _kept(feasible_uniform, count, setup, ranges, seed, progress)


# All policies of a set-up have the same candidates, which take seconds to find: by what finds them,
# and what it is given.
_found: dict[Any, NDArray[np.float64]] = {}
_FOUND_MAX = 8


def _kept(
    find: Callable[..., NDArray[np.float64]],
    count: int,
    setup: Setup,
    ranges: ActionRanges,
    seed: int,
    progress: ProgressCallback,
) -> NDArray[np.float64]:
    """Return the actions that a function finds, and keep them for the next call."""
    key = find.__name__, count, setup, ranges, seed
    if (actions := _found.get(key)) is None:
        actions = _found[key] = find(count, setup, ranges, seed, progress)
        for oldest in list(_found)[:-_FOUND_MAX]:
            _found.pop(oldest, None)
    return actions.copy()


def feasible_uniform(
    count: int,
    setup: Setup,
    ranges: ActionRanges | None = None,
    seed: int = 0,
    progress: ProgressCallback = ignore,
) -> NDArray[np.float64]:
    """Return feasible actions drawn uniformly from the ranges (section V-C).

    theta1, theta2, r2, the wrist turn and the pace are drawn uniformly; actions that violate a
    limit are redrawn. A larger count starts with the actions of a smaller one.

    Args:
        count: Number of actions.
        setup: Arm, workspace and motion settings.
        ranges: Ranges to draw from; `feasible_ranges` if None.
        seed: Seed for the draws.
        progress: Receives how many are found.

    Returns:
        Actions in drawing order, shape [count, 5].
    """
    check_count("count", count, high=ACTION_COUNT_MAX)
    check_seed(seed)
    ranges = ranges or feasible_ranges(setup)
    rng = stream(seed, "feasible actions")
    chosen = np.empty((0, ACTION_SIZE))
    for draw in itertools.count():
        actions = uniform_actions(ranges, _UNIFORM_DRAWS, rng)
        feasible = actions[check_actions(actions, setup).mask]
        chosen = np.concatenate([chosen, feasible])
        done = min(len(chosen), count)
        found = Progress(task="Motions that the arm can follow", done=done, total=count)
        progress(found)
        if done == count:
            return chosen[:count]
        if draw >= _UNIFORM_EMPTY_MAX and not len(chosen):
            break
    broken = _most_broken(check_actions(actions, setup))
    raise InputError(
        f"the arm can follow none of {(draw + 1) * _UNIFORM_DRAWS} actions with {ranges}: {broken}"
    )


def uniform_actions(
    ranges: ActionRanges, count: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return actions drawn from ranges, which the arm may not be able to follow, [count, 5]."""
    bounds = ranges.to_array()
    actions = np.empty((count, ACTION_SIZE))
    actions[:, :4] = rng.uniform(bounds[:4, 0], bounds[:4, 1], size=(count, 4))
    low, high = ranges.pace
    actions[:, 4] = rng.uniform(low, high, count) if low < high else high
    return with_psi(actions)


def _grid_counts(ranges: ActionRanges, size: float) -> tuple[int, ...]:
    """Return the counts of the smallest n x n x n x n/2 x n/2 grid with at least `size` actions."""
    free = [low < high for low, high in ranges.to_array()]
    n = 1
    while True:
        # Grow one axis at a time to exceed the size by as little as possible.
        for grown in range(4):
            per_axis = [n + (axis < grown) for axis in range(3)]
            per_axis += [max((n + 1) // 2, 1)] * 2
            counts = [c if is_free else 1 for c, is_free in zip(per_axis, free, strict=True)]
            if np.prod(counts) >= size or not any(free):
                return tuple(counts)
        n += 1


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
