"""Collection of D_tune and D_real: choice of actions, and casts on a rig (section V-C)."""

import dataclasses
import pathlib
import typing

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.checks import check_seed
from cablecast.datasets.reader import Dataset
from cablecast.datasets.record import TrialPlan, record_trials
from cablecast.datasets.simulate import actions_digest
from cablecast.errors import InputError
from cablecast.motion.action import Action, ActionRanges, check_action_values
from cablecast.motion.feasibility import feasible_grid, feasible_uniform
from cablecast.motion.trajectory import plan_trajectory
from cablecast.rigs.attempts import ATTEMPT_COUNT
from cablecast.rigs.base import Rig
from cablecast.runs.progress import CountCallback
from cablecast.setup import Setup

Purpose = typing.Literal["tune", "real", "repeat"]
Sampling = typing.Literal["uniform", "grid"]

TRIAL_COUNTS: dict[str, int] = {"tune": 80, "real": 200}
"""Number of trials in the paper: 60 to tune and 20 to validate (section V-D), and D_real
(section V-F)."""


def collect_dataset(
    path: str | pathlib.Path,
    rig: Rig,
    setup: Setup,
    *,
    purpose: Purpose,
    count: int | None = None,
    sampling: Sampling = "uniform",
    actions: ArrayLike | None = None,
    repeats: int = 1,
    seed: int = 0,
    ranges: ActionRanges | None = None,
    attempts: int = ATTEMPT_COUNT,
    progress: CountCallback | None = None,
) -> Dataset:
    """Make casts on a rig, or resume an earlier collection of the same settings.

    See `record_trials`, which this calls with casting motions.

    Args:
        path: Folder of the dataset: new, empty, or with an earlier run of the same settings.
        rig: Carries out the casts; its description is one of the settings.
        setup: Cable, workspace, arm and motion settings.
        purpose: Purpose of the casts: "tune" (D_tune), "real" (D_real) or "repeat".
        count: Number of actions, where none are given; the paper's by default.
        sampling: Choice of actions: "uniform" over the ranges, or on a "grid".
        actions: Actions to make instead of sampled ones, shape [action, 4].
        repeats: Casts of each action, one after the other.
        seed: Seed of the actions and of their order.
        ranges: Ranges of the actions; those that suit the set-up where None.
        attempts: Number of attempts at a cast before the collection stops.
        progress: Callback for the number of casts done and the total, at the start and after each.

    Returns:
        The finished dataset.

    Raises:
        RigError: A cast failed too often, or the rig's description cannot be stored.
        DatasetError: The folder holds another dataset or other files, a shard is damaged, or the
            disk is full. Casts that are finished are kept.
        InputError: A count that is not positive, or a motion that the arm cannot make.
    """
    if actions is None:
        count = TRIAL_COUNTS.get(purpose) if count is None else count
        if count is None:
            raise InputError(f"trials for the purpose {purpose!r} need actions or a count")
        chosen = sample_actions(sampling, count, setup, seed, ranges)
        origin = {
            "sampling": sampling,
            "seed": seed,
            "ranges": dataclasses.asdict(ranges or ActionRanges.for_setup(setup)),
        }
    else:
        chosen = check_action_values(actions)
        origin = {"sampling": "given"}
    plan = TrialPlan(
        setup=setup,
        kind=purpose,
        count=len(chosen),
        motion=lambda number: plan_trajectory(Action.from_array(chosen[number]), setup),
        repeats=repeats,
        attempts=attempts,
    )
    settings = {**origin, "actions_sha256": actions_digest(chosen)}
    return record_trials(path, rig, plan, settings, progress)


def sample_actions(
    sampling: Sampling,
    count: int,
    setup: Setup,
    seed: int = 0,
    ranges: ActionRanges | None = None,
) -> NDArray[np.float64]:
    """Sample feasible actions, in the order in which a rig should make them.

    Args:
        sampling: "uniform" over the ranges, or on a "grid".
        count: Number of actions.
        setup: Cable, workspace, arm and motion settings.
        seed: Seed of the choice and of the order.
        ranges: Ranges of the actions; those that suit the set-up where None.

    Returns:
        Actions, shape [count, 4].
    """
    check_seed(seed)
    if sampling == "uniform":
        return feasible_uniform(count, setup, ranges, seed)
    if sampling != "grid":
        raise InputError(f"unknown sampling {sampling!r}: one of uniform, grid")
    actions = feasible_grid(count, setup, ranges, seed)
    # Shuffled, so that a rig that drifts does not make its drift look like an effect of an action.
    return np.random.default_rng([seed, 1]).permutation(actions)
