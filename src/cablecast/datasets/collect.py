"""Collecting trials on a rig: D_tune and D_real, one row per trial (section V-C).

A trial on a robot takes about 20 s, so nothing that is finished may be lost: each trial is a file
of its own, written before the next begins, and space for it is set aside beforehand.
"""

import contextlib
import dataclasses
import hashlib
import json
import os
import pathlib
import typing
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import cablecast
from cablecast.cable import Cable
from cablecast.datasets.reader import Dataset, read_dataset
from cablecast.datasets.schema import (
    ACTION_COLUMNS,
    ENDPOINT_COLUMNS,
    EXTENT_COLUMNS,
    SCHEMA_VERSION,
    track_extent,
)
from cablecast.datasets.writer import DatasetWriter
from cablecast.errors import DatasetError, InputError, RigError
from cablecast.machine import core_count
from cablecast.motion.action import Action, ActionRanges, MotionConfig, check_action_values
from cablecast.motion.feasibility import feasible_grid, feasible_uniform
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.rigs.base import Rig, check_track, error_line
from cablecast.track import EndpointTrack, TrialStatus
from cablecast.workspace import Workspace

Purpose = typing.Literal["tune", "real", "repeat"]
Sampling = typing.Literal["uniform", "grid"]

TRIAL_COUNTS: dict[str, int] = {"tune": 80, "real": 200}
"""Trials that the paper made: 60 to tune on and 20 to validate with (section V-D), and D_real
(section V-F)."""

ATTEMPT_COUNT = 3
"""How often a trial is tried before the collection gives up."""

# More than a row of a long trial takes: 5 s of six joints at 500 Hz are 140 kB.
_ROW_BYTES_MAX = 2**20
_RESERVE_NAME = ".reserve.tmp"


def collect_dataset(
    path: str | pathlib.Path,
    rig: Rig,
    cable: Cable,
    config: MotionConfig,
    workspace: Workspace,
    *,
    purpose: Purpose,
    count: int | None = None,
    sampling: Sampling = "uniform",
    actions: ArrayLike | None = None,
    repeats: int = 1,
    seed: int = 0,
    ranges: ActionRanges | None = None,
    attempts: int = ATTEMPT_COUNT,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Make trials on a rig, or go on where an earlier run of the same settings was stopped.

    Each trial begins with a reset. One in which the rig raises, or which it reports as aborted, is
    made again. The rig is not closed.

    Args:
        path: Folder of the dataset; new, empty, or begun with the same settings.
        rig: Carries out the trials; its description is one of the settings.
        cable: The cable in the gripper.
        config: System parameters of the motions.
        workspace: Table and arm.
        purpose: What the trials are for: "tune" (D_tune), "real" (D_real) or "repeat".
        count: Number of actions, where none are given; the paper's by default.
        sampling: How they are chosen: "uniform" over the ranges, or on a "grid".
        actions: The actions to make instead, shape [action, 4].
        repeats: How many trials of each action, one after the other.
        seed: Chooses the actions and their order.
        ranges: Ranges of the actions; those that suit the config where None.
        attempts: How often a trial is tried before the collection gives up.
        progress: Told how many trials are done and how many there are, at the start and whenever
            one has been stored.

    Returns:
        The finished dataset.

    Raises:
        RigError: A trial failed too often, or the rig returned something that is no track.
        DatasetError: The folder holds another dataset or other files, a shard is damaged, or the
            disk is full. Trials that are finished are kept.
        InputError: A count that is not positive, or a motion that the arm cannot make.
    """
    for name, value in (("repeats", repeats), ("attempts", attempts)):
        if value < 1:
            raise InputError(f"{name} = {value} must be at least 1")
    if actions is None:
        count = TRIAL_COUNTS.get(purpose) if count is None else count
        if count is None:
            raise InputError(f"trials for the purpose {purpose!r} need actions or a count")
        chosen = sample_actions(sampling, count, config, workspace, seed, ranges)
        origin = {
            "sampling": sampling,
            "seed": seed,
            "ranges": dataclasses.asdict(ranges or ActionRanges.for_config(config)),
        }
    else:
        chosen = check_action_values(actions)
        origin = {"sampling": "given"}
    settings = {
        "cablecast_version": cablecast.__version__,
        "schema_version": SCHEMA_VERSION,
        "cable": cable.to_dict(),
        "rig": rig.description,
        "motion": dataclasses.asdict(config),
        "workspace": dataclasses.asdict(workspace),
        **origin,
        "count": len(chosen),
        "repeats": repeats,
        # Rounded, so that the last bits of another machine's mathematics do not matter.
        "actions_sha256": hashlib.sha256(np.round(chosen, 9).tobytes()).hexdigest()[:16],
    }
    try:
        writer = DatasetWriter(
            pathlib.Path(path),
            kind=purpose,
            settings=settings,
            row_count=len(chosen) * repeats,
            shard_rows=1,
        )
    except (TypeError, ValueError) as error:
        raise RigError(
            f"the rig's description must hold plain, finite values: {error_line(error)}"
        ) from None
    with writer:
        if not writer.complete:
            _Collection(rig, writer, chosen, config, workspace, repeats, attempts, progress).run()
            writer.finish()
    return read_dataset(path)


def sample_actions(
    sampling: Sampling,
    count: int,
    config: MotionConfig,
    workspace: Workspace,
    seed: int = 0,
    ranges: ActionRanges | None = None,
) -> NDArray[np.float64]:
    """Feasible actions in the order in which a rig should make them, shape [count, 4].

    Args:
        sampling: "uniform" over the ranges, or on a "grid".
        count: How many.
        config: System parameters.
        workspace: Table and arm.
        seed: Of the choice and of the order.
        ranges: Ranges of the actions; those that suit the config where None.
    """
    if sampling == "uniform":
        return feasible_uniform(count, config, workspace, ranges, seed)
    if sampling != "grid":
        raise InputError(f"unknown sampling {sampling!r}: one of uniform, grid")
    actions = feasible_grid(count, config, workspace, ranges, seed)
    # Shuffled, so that a rig that drifts does not make its drift look like an effect of an action.
    return np.random.default_rng([seed, 1]).permutation(actions)


def rig_seed(seed: int, purpose: Purpose) -> int:
    """The seed of a rig for a purpose.

    With one seed for all, the n-th trial to tune with would have the same luck as the n-th trial
    that the tuned simulator is tested on.
    """
    if seed < 0:
        raise InputError(f"seed = {seed} must be at least 0")
    place = typing.get_args(Purpose).index(purpose)
    return int(np.random.SeedSequence([seed, place]).generate_state(1)[0])


class _Collection:
    """The trials of one collection that are still to be made."""

    def __init__(
        self,
        rig: Rig,
        writer: DatasetWriter,
        actions: NDArray[np.float64],
        config: MotionConfig,
        workspace: Workspace,
        repeats: int,
        attempts: int,
        progress: Callable[[int, int], None] | None,
    ):
        self.rig = rig
        self.writer = writer
        self.actions = actions
        self.config = config
        self.workspace = workspace
        self.repeats = repeats
        self.attempts = attempts
        self.progress = progress
        self._planned: tuple[int, Trajectory] | None = None
        # A rig that makes many at once returns no track before the last is done, so what is lost
        # when it is killed is kept small.
        self.batch_size = 2 * core_count() if callable(_method(rig, "execute_many")) else 1

    def run(self) -> None:
        """Make and store every trial that is missing."""
        missing = self.writer.missing_shards()
        done = self.writer.row_count - len(missing)
        self._report(done)
        with _reserved_space(self.writer.path, self.batch_size * _ROW_BYTES_MAX) as release:
            for batch in _consecutive(missing, self.batch_size):
                full: OSError | None = None
                for index, columns in self._make(batch):
                    try:
                        self.writer.write_shard(index, columns)
                    except OSError as error:
                        # The trial is done and must not be lost: use the space set aside.
                        full = error
                        release()
                        self.writer.write_shard(index, columns)
                    done += 1
                self._report(done)
                if full is not None:
                    raise DatasetError(
                        f"{self.writer.path} takes no more trials ({full.strerror}): the last one "
                        "is stored. Make room, and the same command goes on"
                    ) from full

    def _report(self, done: int) -> None:
        if self.progress is not None:
            self.progress(done, self.writer.row_count)

    def _make(self, batch: Sequence[int]) -> Iterator[tuple[int, dict[str, Any]]]:
        """Make the trials of some indices, which follow one another; yield each when it is done."""
        trajectories = [self._trajectory(index) for index in batch]
        tracks: Sequence[Any] = [None] * len(batch)
        execute_many = _method(self.rig, "execute_many")
        if len(batch) > 1 and callable(execute_many):
            self._seek(batch[0])
            # Where one trial of many fails, each is tried on its own, so that the others are kept.
            with contextlib.suppress(Exception):
                tracks = list(execute_many(trajectories))  # pyright: ignore[reportArgumentType]
            if len(tracks) != len(batch):
                raise RigError(f"the rig returned {len(tracks)} tracks for {len(batch)} motions")
        failed = []
        for index, trajectory, track in zip(batch, trajectories, tracks, strict=True):
            with contextlib.suppress(RigError):
                if track is not None and _finished(track):
                    yield index, self._row(index, trajectory, track, failures=0)
                    continue
            failed.append((index, trajectory))
        for index, trajectory in failed:
            yield index, self._attempt(index, trajectory)

    def _attempt(self, index: int, trajectory: Trajectory) -> dict[str, Any]:
        """The row of one trial, tried until it comes to an end."""
        reason = ""
        for failures in range(self.attempts):
            try:
                self._seek(index)
                self.rig.reset()
                track = self.rig.execute(trajectory)
                if _finished(track):
                    return self._row(index, trajectory, track, failures)
                reason = "the rig reported it as aborted"
            # A rig is somebody else's code: whatever it raises, the trial has failed.
            except Exception as error:
                reason = error_line(error)
        kept = self.writer.row_count - len(self.writer.missing_shards())
        raise RigError(
            f"trial {index} failed {self.attempts} times, the last time because: {reason}. "
            f"{kept} of {self.writer.row_count} trials are kept in {self.writer.path}: clear the "
            "cause, and the same command goes on with this trial"
        )

    def _seek(self, index: int) -> None:
        seek = _method(self.rig, "seek")
        if callable(seek):
            seek(index)

    def _trajectory(self, index: int) -> Trajectory:
        number = index // self.repeats
        # Repeats of an action follow one another and share its motion.
        if self._planned is None or self._planned[0] != number:
            action = Action.from_array(self.actions[number])
            self._planned = number, plan_trajectory(action, self.config, self.workspace)
        return self._planned[1]

    def _row(
        self, index: int, trajectory: Trajectory, track: EndpointTrack, failures: int
    ) -> dict[str, Any]:
        commanded, actual = trajectory.joint_path, track.joint_path
        values = {
            "index": index,
            **dict(zip(ACTION_COLUMNS, self.actions[index // self.repeats], strict=True)),
            **dict(zip(ENDPOINT_COLUMNS, track.final_xy, strict=True)),
            "status": track.status.code,
            "duration": trajectory.duration,
            **dict(zip(EXTENT_COLUMNS, track_extent(track.endpoint_xy[None])[0], strict=True)),
            "repeat": index % self.repeats,
            "times": track.times,
            "track_x": track.endpoint_xy[:, 0],
            "track_y": track.endpoint_xy[:, 1],
            "joint_times": None if commanded is None else commanded.times,
            "joint_q": None if commanded is None else commanded.q.ravel(),
            "actual_times": None if actual is None else actual.times,
            "actual_q": None if actual is None else actual.q.ravel(),
            "attempt": failures,
            "rig": json.dumps(self.rig.description, sort_keys=True, ensure_ascii=False),
        }
        return {name: [value] for name, value in values.items()}


def _finished(track: object) -> bool:
    """Whether a rig brought a trial to its end.

    Raises:
        RigError: What it returned is no track.
    """
    return check_track(track).status is not TrialStatus.ABORTED


def _method(rig: Rig, name: str) -> object:
    """A method that a rig may have or not."""
    return getattr(rig, name, None)


def _consecutive(indices: Sequence[int], size: int) -> Iterator[list[int]]:
    """Runs of indices that follow one another, each at most some size."""
    run: list[int] = []
    for index in indices:
        if run and (index != run[-1] + 1 or len(run) == size):
            yield run
            run = []
        run.append(index)
    if run:
        yield run


@contextlib.contextmanager
def _reserved_space(folder: pathlib.Path, size: int) -> Iterator[Callable[[], None]]:
    """Set space on the disk aside, and yield what gives it back.

    Args:
        folder: Where.
        size: How much [byte].

    Raises:
        DatasetError: There is not as much.
    """
    file = folder / _RESERVE_NAME

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
                f"{folder} has no room for another trial ({error.strerror}): make room, and the "
                "same command goes on"
            ) from error
        yield release
    finally:
        release()
