"""Feasible actions: sweeps that the arm can make, their ranges, their grids and draws from them."""

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
from cablecast.motion.limits import Feasibility, check_grip_paths
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.setup import Setup

# Actions per chunk: keeps the intermediate arrays in the processor's cache.
_CHUNK = 256

ACTION_COUNT_MAX = 1_000_000
"""Largest number of actions per search; their grid has to fit into memory."""

# Actions per draw. Fixed, so that a larger count starts with the actions of a smaller one.
_UNIFORM_DRAWS = 256
# Number of draws without a feasible action after which the search gives up.
_UNIFORM_EMPTY_MAX = 40


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
