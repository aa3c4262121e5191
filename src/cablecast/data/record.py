"""Casts on a rig, stored as they are made: D_tune, D_real (section V-C), repeats and evaluations.

A trial on a robot takes about 20 s, so no finished trial may be lost: each becomes a file of its
own before the next one starts, and disk space for it is reserved beforehand.
"""

import contextlib
import dataclasses
import functools
import json
import os
import pathlib
import typing
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cablecast.cast import Cast, EndpointTrack, TrialStatus
from cablecast.conventions import Array, stream
from cablecast.data.dataset import Dataset, read_dataset
from cablecast.data.simulate import actions_digest
from cablecast.data.store import cast_row
from cablecast.data.writer import DatasetWriter
from cablecast.errors import (
    DatasetError,
    InputError,
    RigError,
    StoppedError,
    check_choice,
    check_count,
)
from cablecast.files import core_count, temporary_prefix
from cablecast.motion.action import ActionRanges, check_action_values
from cablecast.motion.casting import Action
from cablecast.motion.feasibility import feasible_grid, feasible_ranges, feasible_uniform
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.rigs.base import Rig
from cablecast.rigs.checked import (
    ATTEMPT_COUNT,
    CheckedRig,
    TrialFailedError,
    attempt_trial,
    seek_trial,
)
from cablecast.runs.progress import DONE_NOTE, Progress, ProgressCallback, ignore
from cablecast.setup import Setup

Kind = typing.Literal["tune", "real", "repeat", "evaluate"]

REPEAT_MAX = 100_000

# More than a row of a long trial takes: 5 s of six joints at 500 Hz are 140 kB.
_ROW_BYTES_MAX = 2**20

# Casts per core that a rig makes at once: cores that wait for the last cast of a batch, against
# what a kill can lose. Batches of 2 per core take a quarter more processor time.
_CASTS_PER_CORE = 8


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrialPlan:
    """Trials to make.

    Attributes:
        setup: Cable, workspace, arm and motion settings.
        kind: Purpose of the trials, which also selects the random numbers of the rig.
        count: Number of motions.
        motion: Function that returns the motion of an index from 0.
        repeats: Consecutive trials of each motion.
        attempts: Number of attempts at a trial before the work stops.
        keep_nodes: True to store the cable's nodes, if the rig knows them.
    """

    setup: Setup
    kind: Kind
    count: int
    motion: Callable[[int], Trajectory]
    repeats: int = 1
    attempts: int = ATTEMPT_COUNT
    keep_nodes: bool = False

    def __post_init__(self):
        check_count("repeats", self.repeats, high=REPEAT_MAX)
        check_count("attempts", self.attempts, high=1000)

    @property
    def trial_count(self) -> int:
        """Number of trials."""
        return self.count * self.repeats

    @property
    def task(self) -> str:
        """Name of the work in its progress."""
        name = self.setup.cable.name
        if self.kind == "repeat":
            return (
                f"Repeating {self.count} casts of {name}, v_max = {self.setup.motion.v_max:g} m/s"
            )
        return f"Casting {name} at targets" if self.kind == "evaluate" else f"Casting {name}"


def record_trials(
    path: str | pathlib.Path,
    rig: Rig,
    plan: TrialPlan,
    settings: Mapping[str, Any],
    progress: ProgressCallback = ignore,
) -> Dataset:
    """Make trials on a rig, or resume an earlier run of the same settings in the folder.

    Each trial starts with a reset. A trial in which the rig raises, or which it reports as aborted,
    is repeated. The rig's description and `settings` decide the trials. The rig is not closed.

    Raises:
        RigError: A trial failed too often, or the rig's description cannot be stored.
        DatasetError: The folder holds another dataset or other files, a shard is damaged, or the
            disk is full. Trials that are finished are kept.
    """
    # The answers of any rig are checked before they are stored.
    rig = rig if isinstance(rig, CheckedRig) else CheckedRig(rig, plan.setup)
    # Repeats of a motion are consecutive.
    plan = dataclasses.replace(plan, motion=functools.lru_cache(maxsize=1)(plan.motion))
    writer = DatasetWriter(
        pathlib.Path(path),
        kind=plan.kind,
        settings={
            **plan.setup.to_settings(),
            "rig": rig.description,
            **settings,
            "count": plan.count,
            "repeats": plan.repeats,
        },
        row_count=plan.trial_count,
        shard_rows=1,
    )
    with writer:
        if not writer.was_complete:
            _Recording(rig, writer, plan, progress).run()
            writer.finish()
        else:
            progress(Progress(task=plan.task, note=DONE_NOTE))
    return read_dataset(path)


@dataclasses.dataclass(frozen=True)
class _Recording:
    """Trials that are still missing."""

    rig: CheckedRig
    writer: DatasetWriter
    plan: TrialPlan
    progress: ProgressCallback

    def run(self) -> None:
        """Make and store every trial that is missing."""
        missing = self.writer.missing_shards()
        done = self.writer.row_count - len(missing)
        self._report(done)
        # A rig that makes many trials at once returns no track before the last is done. A batch is
        # small, because a kill loses it.
        size = 1 if self.rig.execute_many is None else _CASTS_PER_CORE * core_count()
        with _reserved_space(self.writer.path, size * _ROW_BYTES_MAX) as release:
            for batch in _consecutive(missing, size):
                full: OSError | None = None
                for index, columns in self._make(batch):
                    try:
                        self.writer.write_shard(index, columns)
                    except OSError as error:
                        # The trial is done and must not be lost: use the reserved space.
                        full = error
                        release()
                        self.writer.write_shard(index, columns)
                    done += 1
                self._report(done)
                if full is not None:
                    raise DatasetError(
                        f"{self.writer.path} takes no more trials ({full.strerror}): the last one "
                        "is stored. Free some space, and the same command resumes"
                    ) from full

    def _report(self, done: int) -> None:
        total = self.writer.row_count
        self.progress(Progress(task=self.plan.task, done=done, total=total, unit="casts"))

    def _make(self, batch: Sequence[int]) -> Iterator[tuple[int, dict[str, Any]]]:
        """Make the trials of consecutive indices, and yield the row of each."""
        motions = [self.plan.motion(index // self.plan.repeats) for index in batch]
        tracks: Sequence[EndpointTrack | None] = [None] * len(batch)
        execute_many = self.rig.execute_many
        if execute_many is not None and len(batch) > 1:
            seek_trial(self.rig, batch[0], self._purpose)
            # If one trial of a batch fails, each is tried on its own, so that the others are kept.
            # After a stop by a person nothing moves again.
            try:
                tracks = execute_many(motions)
            except StoppedError as error:
                raise RigError(
                    f"trials {batch[0]} to {batch[-1]} failed because: {error}. The same command "
                    "resumes with them"
                ) from error
            except Exception as error:
                warnings.warn(
                    f"trials {batch[0]} to {batch[-1]} failed together and are made one by one: "
                    f"{error or type(error).__name__}",
                    stacklevel=2,
                )
                tracks = [None] * len(batch)
        failed = []
        for index, motion, track in zip(batch, motions, tracks, strict=True):
            if track is not None and track.status is not TrialStatus.ABORTED:
                yield index, self._row(index, motion, track, failures=0)
            else:
                failed.append((index, motion))
        for index, motion in failed:
            yield index, self._attempt(index, motion)

    def _attempt(self, index: int, motion: Trajectory) -> dict[str, Any]:
        """Return the row of one trial, repeated until it succeeds."""
        try:
            track, failures = attempt_trial(
                self.rig, motion, index=index, purpose=self._purpose, count=self.plan.attempts
            )
        except TrialFailedError as error:
            kept = self.writer.row_count - len(self.writer.missing_shards())
            raise RigError(
                f"trial {index} {error}. {kept} of {self.writer.row_count} trials are kept in "
                f"{self.writer.path}: clear the cause, and the same command resumes with this trial"
            ) from error
        return self._row(index, motion, track, failures)

    @property
    def _purpose(self) -> str:
        # An evaluation uses the rig's own random numbers.
        return "" if self.plan.kind == "evaluate" else self.plan.kind

    def _row(
        self, index: int, motion: Trajectory, track: EndpointTrack, failures: int
    ) -> dict[str, Any]:
        values = {
            "index": index,
            **cast_row(Cast.of_motion(motion, track, self._purpose)),
            "repeat": index % self.plan.repeats,
            "attempt": failures,
            "rig": json.dumps(self.rig.description, sort_keys=True, ensure_ascii=False),
        }
        if self.plan.keep_nodes:
            values["nodes"] = None if track.nodes is None else track.nodes.ravel()
        return {name: [value] for name, value in values.items()}


def _consecutive(indices: Sequence[int], size: int) -> Iterator[list[int]]:
    """Yield runs of consecutive indices, each of at most some size."""
    for run in np.split(indices, np.flatnonzero(np.diff(indices) != 1) + 1):
        for start in range(0, len(run), size):
            yield run[start : start + size].tolist()


@contextlib.contextmanager
def _reserved_space(folder: pathlib.Path, size: int) -> Iterator[Callable[[], None]]:
    """Reserve disk space [byte], and yield the function that releases it."""
    file = folder / f"{temporary_prefix(folder / 'reserve')}.tmp"

    def release() -> None:
        file.unlink(missing_ok=True)

    try:
        try:
            # Written, not only made long: a hole in a file takes no space.
            with file.open("wb") as stream:
                stream.write(bytes(size))
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise DatasetError(
                f"{folder} has no room for another trial ({error.strerror}): free some space, and "
                "the same command resumes"
            ) from error
        yield release
    finally:
        release()


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
    progress: ProgressCallback = ignore,
) -> Dataset:
    """Make casts on a rig, or resume an earlier collection of equal settings; see `record_trials`.

    The actions are given, shape [action, 5], or sampled: `count` of them (the paper's by default)
    from ranges that suit the set-up. Each is repeated `repeats` times in a row.

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
            "ranges": dataclasses.asdict(ranges or feasible_ranges(setup)),
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
) -> Array:
    """Sample feasible actions in the order in which a rig should make them, shape [count, 5].

    They are uniform over the ranges, those that suit the set-up if None, or on a grid of them.
    """
    check_choice("sampling", sampling, typing.get_args(Sampling))
    if sampling == "uniform":
        return feasible_uniform(count, setup, ranges, seed)
    actions = feasible_grid(count, setup, ranges, seed)
    # Shuffled, so that a rig that drifts does not make its drift look like an effect of an action.
    return stream(seed, "order of a grid").permutation(actions)
