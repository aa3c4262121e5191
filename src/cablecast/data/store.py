"""CastStore: all casts of one cable, whatever they were made for, one Parquet file each.

A dataset has a number of rows that is known before its first cast. A store grows: a cast is kept as
soon as it is done. Its files are shards of one row in the schema of datasets.
"""

import dataclasses
import os
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cast import Cast, Proposal
from cablecast.data.dataset import Dataset, table_dataset
from cablecast.data.schema import (
    CONTROLLER_COLUMNS,
    ENDPOINT_COLUMNS,
    EXTENT_COLUMNS,
    columns_table,
    read_shard,
    shard_bytes,
    track_extent,
)
from cablecast.errors import (
    CablecastError,
    DamagedFileError,
    DatasetError,
    InputError,
    UnreadableFileError,
)
from cablecast.files import read_sealed, seal, write_bytes, write_json
from cablecast.motion.action import ACTION_NAMES
from cablecast.motion.casting import Action
from cablecast.runs.folder import RunFolder, fingerprint
from cablecast.setup import Setup
from cablecast.task import LANDING, Expectation, Goal, MissLaw, Task

UNDONE_FILE = "undone.json"

_REMEDY = "Restore it from a copy, or rename the casts after it so that the numbers have no gap"


def cast_row(cast: Cast) -> dict[str, Any]:
    """Return a cast as a row of a dataset: a value for each column of motion and track."""
    track = cast.track
    commanded, actual, log = cast.joint_path, track.joint_path, track.controller_log
    reported: dict[str, Any] = {}
    if log is not None:
        lists = (log.times, log.target_q.ravel(), log.speed_scaling, log.safety_bits)
        reported = dict(zip(CONTROLLER_COLUMNS, lists, strict=True))
    if cast.grip is not None:
        times, poses = cast.grip
        reported |= {"grip_times": times, "grip_pose": poses.ravel()}
    action = cast.action
    planned = {} if action is None else dict(zip(action.parameters, action.to_array(), strict=True))
    return {
        **dict.fromkeys(ACTION_NAMES, np.nan),
        **planned,
        **dict(zip(ENDPOINT_COLUMNS, track.final_xy, strict=True)),
        "status": track.status.code,
        "duration": cast.duration,
        **dict(zip(EXTENT_COLUMNS, track_extent(track.endpoint_xy[None])[0], strict=True)),
        "times": track.times,
        "track_x": track.endpoint_xy[:, 0],
        "track_y": track.endpoint_xy[:, 1],
        **({} if track.endpoint_z is None else {"track_z": track.endpoint_z}),
        "joint_times": None if commanded is None else commanded.times,
        "joint_q": None if commanded is None else commanded.q.ravel(),
        "actual_times": None if actual is None else actual.times,
        "actual_q": None if actual is None else actual.q.ravel(),
        "note": track.note,
        **reported,
    }


def dataset_cast(casts: Dataset, row: int) -> Cast:
    """Return a row of a dataset as a cast without a proposal.

    Raises:
        DatasetError: The dataset holds no tracks.
    """
    return Cast(
        action=casts.motion(row),
        duration=float(casts.duration[row]),
        joint_path=casts.commanded_joints(row),
        track=casts.track(row),
        purpose=casts.kind,
        origin=f"{casts.fingerprint}/{row}",
        grip=casts.measured_poses(row),
    )


def _stored_row(cast: Cast, index: int) -> dict[str, Any]:
    nodes = cast.track.nodes
    return {
        **cast_row(cast),
        "index": index,
        "nodes": None if nodes is None else nodes.ravel(),
        "purpose": cast.purpose,
        "origin": cast.origin,
        **({} if cast.proposal is None else _proposal_cells(cast.proposal)),
    }


def _proposal_cells(proposal: Proposal) -> dict[str, Any]:
    """Return the columns of a proposal but for the number and the action of its cast."""
    expected = proposal.expected
    return {
        "task": proposal.goal.task.name,
        "goal": proposal.goal.value,
        "within_pct": proposal.goal.within_pct,
        "try_number": proposal.try_number,
        "expected": expected.mean,
        "covariance": expected.covariance.ravel(),
        "law": [expected.law.scale, expected.law.freedom],
        "scatter": expected.scatter,
        "failure": expected.failure,
        "inside_coverage": int(proposal.inside_coverage),
    }


def _stored_proposal(casts: Dataset, number: int, setup: Setup, task: Task) -> Proposal | None:
    """Return the proposal of the one cast of a dataset; None for a cast that was not aimed."""
    cells = {name: values[0] for name, values in casts.extra.items()}
    if not cells.get("task"):
        return None
    if cells["task"] != task.name:
        raise InputError(f"its task is {cells['task']}")
    if (action := casts.motion(0)) is None:
        raise InputError("the parameters of its motion are missing")
    mean, (scale, freedom) = np.array(cells["expected"], dtype=float), cells["law"]
    return Proposal(
        goal=Goal(
            task=task,
            setup=setup,
            value=np.array(cells["goal"], dtype=float),
            within_pct=cells["within_pct"],
        ),
        number=number,
        try_number=cells["try_number"],
        action=action,
        expected=Expectation(
            mean=mean,
            covariance=np.array(cells["covariance"], dtype=float).reshape(len(mean), len(mean)),
            law=MissLaw(scale=scale, freedom=freedom),
            scatter=cells["scatter"],
            failure=cells["failure"],
        ),
        inside_coverage=bool(cells["inside_coverage"]),
    )


class CastStore:
    """Casts of one set-up in the order in which they came, kept in a folder unless it is None.

    Attributes:
        casts: All casts.
        undone: Numbers of discarded ones: they are kept, and count for nothing.
        task: Task of the casts that were aimed.

    Raises:
        InputError: The folder holds something else, or casts of another set-up.
        DamagedFileError: A file is not what was written, or missing before later ones.
    """

    def __init__(
        self,
        setup: Setup,
        folder: str | os.PathLike[str] | None = None,
        task: Task = LANDING,
    ):
        self.setup, self.task = setup, task
        self.casts: list[Cast] = []
        self.undone: frozenset[int] = frozenset()
        self._run: RunFolder | None = None
        if folder is None:
            return
        self._run = RunFolder.open(pathlib.Path(folder), "aim", setup.to_settings())
        while self._file(len(self)).exists():
            self.casts.append(self._read(len(self)))
        later = sorted(
            file.name
            for file in self._file(0).parent.glob("[0-9]*.parquet")
            if file.name > self._file(len(self)).name
        )
        if later:
            # They would be overlooked, and then overwritten.
            raise DamagedFileError(
                f"{self._file(len(self))} is missing, but {later[0]} is there. {_REMEDY}"
            )
        self.undone = self._read_undone()

    def __len__(self) -> int:
        return len(self.casts)

    @property
    def folder(self) -> pathlib.Path | None:
        """Folder of the casts; None where they are kept in memory alone."""
        return None if self._run is None else self._run.path

    def add(self, cast: Cast) -> None:
        """Keep a cast."""
        number = len(self)
        if self._run is not None:
            with self._run.locked():
                if self._file(number).exists():
                    raise InputError(
                        f"another process has added casts to {self._run.path}: open the store again"
                    )
                table = columns_table({k: [v] for k, v in _stored_row(cast, number).items()})
                write_bytes(self._file(number), shard_bytes(table, self._settings_fingerprint))
        self.casts.append(cast)

    def add_dataset(self, casts: Dataset) -> int:
        """Keep the casts of a dataset that are not here yet, and return their number."""
        if casts.kind == "sim":
            raise InputError("a store keeps casts of a rig: these were simulated")
        if casts.setup.to_settings() != self.setup.to_settings():
            raise InputError("the casts were made with another set-up than those of the store")
        origins = {cast.origin for cast in self.casts}
        before = len(self)
        for row in range(len(casts)):
            cast = dataset_cast(casts, row)
            if cast.origin not in origins:
                self.add(cast)
        return len(self) - before

    def set_tolerance(self, within_pct: float) -> None:
        """Let the goals of all casts have a tolerance [% of cable length]; files keep their own."""
        self.casts = [cast.with_tolerance(within_pct) for cast in self.casts]

    @property
    def sweeps(self) -> list[int]:
        """Numbers of the sweeps that were not discarded: simulators are fitted to these."""
        return [
            number
            for number, cast in enumerate(self.casts)
            if number not in self.undone and isinstance(cast.action, Action)
        ]

    def in_memory(self) -> "CastStore":
        """Return a store of the same casts that keeps nothing on disk."""
        store = CastStore(self.setup, task=self.task)
        store.casts, store.undone = list(self.casts), self.undone
        return store

    def undo(self, number: int) -> None:
        """Discard a cast: it is kept, and counts for nothing from now on."""
        if number not in range(len(self)):
            raise InputError(f"the store has {len(self)} casts: there is no cast {number}")
        undone = self.undone | {number}
        if self._run is not None:
            with self._run.locked():
                # Another process may have discarded one meanwhile.
                undone |= self._read_undone()
                write_json(self._run.path / UNDONE_FILE, seal({"undone": sorted(undone)}))
        self.undone = undone

    def dataset(self, rows: Sequence[int] | NDArray[np.intp] | None = None) -> Dataset:
        """Return casts by number, or all that were not discarded, as a dataset in memory."""
        if rows is None:
            rows = [number for number in range(len(self)) if number not in self.undone]
        stored = [_stored_row(self.casts[row], index) for index, row in enumerate(rows)]
        names = {name for row in stored for name in row}
        table = columns_table({name: [row.get(name) for row in stored] for name in names})
        info = {
            "kind": "aim",
            "settings": {**self.setup.to_settings(), "count": len(stored)},
            "fingerprint": fingerprint([len(stored)], shard_bytes(table, "")),
        }
        return table_dataset(table, info)

    def _read_undone(self) -> frozenset[int]:
        if self._run is None:
            return self.undone
        try:
            return frozenset(read_sealed(self._run.path / UNDONE_FILE)["undone"])
        except FileNotFoundError:
            return frozenset()
        except DamagedFileError as error:
            raise DamagedFileError(
                f"{error}. Restore it, or delete it: discarded casts count again then"
            ) from None

    @property
    def _settings_fingerprint(self) -> str:
        return fingerprint(self.setup.to_settings())

    def _file(self, number: int) -> pathlib.Path:
        if self._run is None:
            raise InputError("this store keeps nothing on the disk")
        return self._run.path / "casts" / f"{number:05d}.parquet"

    def _read(self, number: int) -> Cast:
        """Return a stored cast, if the file holds one."""
        file = self._file(number)
        try:
            table, _ = read_shard(file, range(number, number + 1), self._settings_fingerprint)
            casts = table_dataset(table, {"kind": "aim", "settings": self.setup.to_settings()})
            return dataclasses.replace(
                dataset_cast(casts, 0),
                purpose=casts.extra["purpose"][0],
                proposal=_stored_proposal(casts, number, self.setup, self.task),
                origin=casts.extra["origin"][0],
            )
        except DatasetError as error:
            reason = str(error).partition(": delete it")[0]
            raise DamagedFileError(f"{reason}. {_REMEDY}") from None
        except UnreadableFileError:
            raise
        except (KeyError, TypeError, ValueError, CablecastError):
            raise DamagedFileError(f"{file} holds no cast. {_REMEDY}") from None
