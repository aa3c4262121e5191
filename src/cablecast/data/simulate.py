"""Simulation of D_sim: feasible actions of a grid and their landings (section V-F)."""

import dataclasses
import functools
import hashlib
import pathlib
from typing import Any

import numpy as np

from cablecast.cable import CableParams
from cablecast.cast import TrialStatus
from cablecast.conventions import Array
from cablecast.data.dataset import Dataset, read_dataset
from cablecast.data.schema import (
    ENDPOINT_COLUMNS,
    EXTENT_COLUMNS,
    INFO_PATH,
    SCHEMA_VERSION,
    track_extent,
)
from cablecast.data.writer import DatasetWriter
from cablecast.engines.base import SETTLE_TIME, Engine, engine_settings
from cablecast.engines.dynamics import Dynamics
from cablecast.engines.spread import is_slow, spec_of, spread
from cablecast.errors import CablecastError, DatasetError, InputError, check_count, check_seed
from cablecast.files import read_sealed
from cablecast.motion.action import ACTION_NAMES, ActionRanges, action_rows
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import ACTION_COUNT_MAX, feasible_actions, feasible_ranges
from cablecast.runs.folder import plain_settings
from cablecast.runs.progress import DONE_NOTE, Progress, ProgressCallback, ignore
from cablecast.runs.workers import LOCAL, check_workers, run_tasks
from cablecast.setup import Setup
from cablecast.task import LANDING, Landing, Task

SIMULATED_COUNT = 36_000
"""Number of actions in D_sim (section V-F)."""

SHARD_ROWS, SLOW_SHARD_ROWS, CUDA_SHARD_ROWS = 3000, 30, 36_000
"""Number of rows of a shard, which is the unit of progress and what a kill loses: a few seconds on
two cores, some more of a slow engine, and on a graphics card, which takes about as long for a tenth
of these rows."""

# The free end moves at several metres a second and could swing over the table's edge and back
# between samples, so the track is sampled five times as often as a camera would.
SAMPLE_DT = 0.02


def simulate_dataset(
    path: str | pathlib.Path,
    setup: Setup,
    dynamics: Dynamics | CableParams | None,
    engine: Engine,
    *,
    count: int = SIMULATED_COUNT,
    seed: int = 0,
    ranges: ActionRanges | None = None,
    task: Task = LANDING,
    shard_rows: int | None = None,
    workers: str = LOCAL,
    progress: ProgressCallback = ignore,
) -> Dataset:
    """Simulate a dataset, or resume an earlier run of the same settings.

    Its actions are `count` feasible ones, chosen by the seed from ranges that suit the set-up where
    None. The dynamics may be parameters of the cable alone; they are the cable's own if None.
    Shards take the engine's device a few seconds each, unless their rows are given. They may be
    simulated on a cluster (see `check_workers`): rows are equal to the bit on processors of one
    kind. Outcomes in another task than a landing are kept next to the landings.

    Raises:
        DatasetError: The folder holds another dataset or other files, or a shard is damaged.
        InputError: A count that is not positive; a curled cable.
    """
    check_count("count", count, high=ACTION_COUNT_MAX)
    if shard_rows is None:
        on_card = str(getattr(engine, "device", "cpu")).startswith("cuda")
        shard_rows = CUDA_SHARD_ROWS if on_card else SHARD_ROWS
        shard_rows = SLOW_SHARD_ROWS if is_slow(engine) else shard_rows
    check_count("shard_rows", shard_rows)
    check_seed(seed)
    made = None if check_workers(workers) == LOCAL else spec_of(engine)
    dynamics = Dynamics.of(dynamics, setup)
    ranges = feasible_ranges(setup) if ranges is None else ranges
    _check_mirrored(dynamics)
    settings = {
        **setup.to_settings(),
        **dynamics.to_dict(),
        "engine": engine_settings(engine),
        "ranges": dataclasses.asdict(ranges),
        "sample_dt": SAMPLE_DT,
        "settle_time": SETTLE_TIME,
        "count": count,
        "seed": seed,
        **({} if isinstance(task, Landing) else {"task": task.name}),
    }
    path = pathlib.Path(path)
    # To choose the actions takes seconds, which a finished dataset need not spend.
    chosen = functools.partial(feasible_actions, count, setup, ranges, seed, progress)
    digest = _known_digest(path, settings) or actions_digest(chosen())
    writer = DatasetWriter(
        path,
        kind="sim",
        settings=settings | {"actions_sha256": digest},
        row_count=count,
        shard_rows=shard_rows,
    )
    words = f"Simulating {setup.cable.name}"

    def report(done: int) -> None:
        progress(Progress(task=words, done=done, total=count, unit="casts"))

    with writer:
        if not writer.was_complete:
            actions = chosen()
            if actions_digest(actions) != digest:
                raise DatasetError(f"{path} was begun with other actions: give another folder")
            missing = writer.missing_shards()
            done = count - sum(len(writer.rows_of(shard)) for shard in missing)
            report(done)
            tasks = [(shard, (actions[writer.rows_of(shard)], dynamics)) for shard in missing]
            function, shared = simulate_actions, (setup, spread(engine, LOCAL), task)
            if made is not None:
                function, shared = _simulate_remotely, (setup, made, task)
            for shard, columns in run_tasks(function, tasks, workers, shared):
                rows = writer.rows_of(shard)
                writer.write_shard(shard, {"index": np.arange(rows.start, rows.stop)} | columns)
                done += len(rows)
                report(done)
            writer.finish()
        else:
            progress(Progress(task=words, note=DONE_NOTE))
    return read_dataset(path)


def _known_digest(path: pathlib.Path, settings: dict[str, Any]) -> str | None:
    """Return the fingerprint of the actions of a dataset that was begun with the same settings."""
    try:
        stored = dict(read_sealed(path / INFO_PATH)["settings"])
    except (OSError, CablecastError, KeyError, TypeError):
        return None
    digest = stored.pop("actions_sha256", None)
    known = plain_settings({"schema_version": SCHEMA_VERSION, **settings})
    return digest if stored == known else None


def _check_mirrored(dynamics: Dynamics) -> None:
    """Refuse a curled cable: planning takes casts to the left for mirrored casts to the right."""
    curl = float(np.max(np.abs(dynamics.params.rest_curvature)))
    if curl > 0.0:
        raise InputError(
            "planning takes casts to the left for mirrored ones to the right, which those of a "
            f"cable with rest_curvature = {curl:g} 1/m are not"
        )


def _simulate_remotely(
    actions: Array,
    dynamics: Dynamics,
    setup: Setup,
    made: tuple[type, dict[str, Any]],
    task: Task,
) -> dict[str, Any]:
    """Simulate a shard on a worker, with an engine made there."""
    kind, options = made
    return simulate_actions(actions, dynamics, setup, kind(**options), task)


def actions_digest(actions: Array) -> str:
    """Return a fingerprint of actions, shape [action, 5]."""
    # Rounded, so that the last bits of another machine's mathematics do not matter.
    return hashlib.sha256(np.round(actions, 9).tobytes()).hexdigest()[:16]


def simulate_actions(
    actions: Array,
    dynamics: Dynamics | CableParams,
    setup: Setup,
    engine: Engine,
    task: Task = LANDING,
) -> dict[str, Any]:
    """Simulate actions, shape [row, 5], and return all columns of a dataset but `index`.

    The dynamics are shared by all rows, or one value per row. Outcomes in another task than a
    landing are in `outcome`.
    """
    dynamics = Dynamics.of(dynamics, setup)
    actions = action_rows(actions)
    grip_paths = cast_grip_paths(actions, setup)
    rollout = dynamics.rollout(engine, setup, grip_paths, sample_dt=SAMPLE_DT)
    track = rollout.endpoint_xy
    outcome = LANDING.outcome(track)
    finite = rollout.finite & np.all(np.isfinite(outcome), axis=-1)
    endpoint_xy = np.where(finite[:, None], outcome, np.nan)
    lost = LANDING.lost(track, setup)
    codes = np.where(lost, TrialStatus.OFF_TABLE.code, TrialStatus.OK.code)
    status = np.where(finite, codes, TrialStatus.NON_FINITE.code)
    extent = np.where(finite[:, None], track_extent(track), np.nan)
    return (
        dict(zip(ACTION_NAMES, actions.T, strict=True))
        | dict(zip(ENDPOINT_COLUMNS, endpoint_xy.T, strict=True))
        | {"status": status.tolist(), "duration": grip_paths.duration}
        | dict(zip(EXTENT_COLUMNS, extent.T, strict=True))
        | ({} if isinstance(task, Landing) else {"outcome": list(task.outcome(track))})
    )
