"""CastStore: all casts of one cable, whatever they were made for, one file each.

A dataset has a number of rows that is known before its first cast. A store grows: a cast is kept as
soon as it is done, and every cast teaches.
"""

import dataclasses
import math
import os
import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.data.dataset import Dataset
from cablecast.data.schema import (
    ACTION_COLUMNS,
    CONTROLLER_COLUMNS,
    ENDPOINT_COLUMNS,
    EXTENT_COLUMNS,
)
from cablecast.errors import DamagedFileError, InputError
from cablecast.runs.folder import Parts, RunFolder, fingerprint
from cablecast.setup import Setup

_LISTS = (
    *("times", "track_x", "track_y"),
    *("joint_times", "joint_q", "actual_times", "actual_q", "nodes"),
    *CONTROLLER_COLUMNS,
)
_COLUMNS = (*ACTION_COLUMNS, *ENDPOINT_COLUMNS, "status", "duration", *EXTENT_COLUMNS)

_REMEDY = "Restore it from a copy, or rename the casts after it so that the numbers have no gap"


@dataclasses.dataclass(frozen=True, kw_only=True)
class StoredCast:
    """One cast of a store.

    Attributes:
        purpose: What it was made for, e.g. "calibrate" or "aim".
        values: A value for each column of motion and track, see `trial_values`.
        note: What whoever made the cast wants to know of it again, as plain values.
        origin: Fingerprint of the dataset and the row that it came from; empty where it was made
            for the store.
    """

    purpose: str
    values: dict[str, Any]
    note: dict[str, Any] = dataclasses.field(default_factory=dict)
    origin: str = ""

    @property
    def action(self) -> NDArray[np.float64]:
        """Action, shape [4]; NaN for a motion that no action describes."""
        return np.array([self.values[name] for name in ACTION_COLUMNS], dtype=float)

    @property
    def endpoint_xy(self) -> NDArray[np.float64]:
        """Landing [m], shape [2]; NaN for a cast without one."""
        return np.array([self.values[name] for name in ENDPOINT_COLUMNS], dtype=float)

    @property
    def status(self) -> str:
        """Code of the trial's status."""
        return str(self.values["status"])


class CastStore:
    """Casts of one set-up, in the order in which they came.

    Args:
        setup: Cable, workspace, arm and motion settings of the casts.
        folder: Folder that keeps them; none where None.

    Raises:
        InputError: The folder holds something else, or casts of another set-up.
        DamagedFileError: A file is not what was written, or missing before later ones.
    """

    def __init__(self, setup: Setup, folder: str | os.PathLike[str] | None = None):
        self.setup = setup
        self.casts: list[StoredCast] = []
        self._run: RunFolder | None = None
        if folder is not None:
            self._run = RunFolder.open(pathlib.Path(folder), "aim", setup.to_settings())
            while (values := self._parts.get(self._name())) is not None:
                self.casts.append(_read(values, self._parts, self._name()))
            self._refuse_gap()

    def __len__(self) -> int:
        return len(self.casts)

    def add(self, cast: StoredCast) -> None:
        """Keep a cast.

        Raises:
            InputError: Another process has added casts meanwhile.
        """
        if self._run is not None:
            with self._run.locked():
                if self._parts.file(self._name()).exists():
                    raise InputError(
                        f"another process has added casts to {self._run.path}: open the store again"
                    )
                self._parts.put(self._name(), _plain(dataclasses.asdict(cast)))
        self.casts.append(cast)

    def add_dataset(self, casts: Dataset) -> int:
        """Keep the casts of a dataset that are not here yet.

        Args:
            casts: Casts on a rig, with the set-up of the store.

        Returns:
            The number of casts that were added.

        Raises:
            InputError: The casts were simulated, or made with another set-up.
        """
        if casts.kind == "sim":
            raise InputError("a store keeps casts of a rig: these were simulated")
        if casts.setup.to_settings() != self.setup.to_settings():
            raise InputError("the casts were made with another set-up than those of the store")
        known = {cast.origin for cast in self.casts}
        before = len(self)
        for row in range(len(casts)):
            origin = f"{casts.fingerprint}/{row}"
            if origin not in known:
                values = _row_values(casts, row)
                self.add(StoredCast(purpose=casts.kind, values=values, origin=origin))
        return len(self) - before

    def dataset(self) -> Dataset:
        """Return all casts as a dataset in memory."""

        def stack(names: tuple[str, ...]) -> NDArray[np.float64]:
            rows = [[cast.values[name] for name in names] for cast in self.casts]
            return np.array(rows, dtype=float).reshape(-1, len(names))

        plain = [_plain(cast.values) for cast in self.casts]
        return Dataset(
            actions=stack(ACTION_COLUMNS),
            endpoint_xy=stack(ENDPOINT_COLUMNS),
            status=np.array([cast.status for cast in self.casts], dtype=str),
            duration=stack(("duration",))[:, 0],
            extent=stack(EXTENT_COLUMNS),
            extra={name: [cast.values.get(name) for cast in self.casts] for name in _LISTS},
            info={
                "kind": "aim",
                "fingerprint": fingerprint(plain),
                "settings": {**self.setup.to_settings(), "count": len(self)},
            },
        )

    @property
    def _parts(self) -> Parts:
        if self._run is None:
            raise InputError("this store keeps nothing on the disk")
        return dataclasses.replace(self._run.parts("casts"), remedy=_REMEDY)

    def _refuse_gap(self) -> None:
        """Refuse casts behind a missing one: they would be overlooked, and then overwritten."""
        folder = self._parts.folder
        later = sorted(file.name for file in folder.glob("[0-9]*.json") if file.stem > self._name())
        if later:
            raise DamagedFileError(
                f"{self._parts.file(self._name())} is missing, but {later[0]} is there. {_REMEDY}"
            )

    def _name(self) -> str:
        """Return the name of the file of the next cast."""
        return f"{len(self.casts):05d}"


def _row_values(casts: Dataset, row: int) -> dict[str, Any]:
    """Return the values of one row of a dataset."""
    values: dict[str, Any] = dict(zip(ACTION_COLUMNS, casts.actions[row], strict=True))
    values |= dict(zip(ENDPOINT_COLUMNS, casts.endpoint_xy[row], strict=True))
    values |= dict(zip(EXTENT_COLUMNS, casts.extent[row], strict=True))
    values |= {"status": str(casts.status[row]), "duration": float(casts.duration[row])}
    for name in _LISTS:
        column = casts.extra.get(name)
        values[name] = None if column is None else column[row]
    return values


def _plain(value: Any) -> Any:
    """Return a value as JSON stores it: arrays become lists, NaN and infinity become None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray) and value.dtype.kind == "f" and np.isfinite(value).all():
        return value.tolist()
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _read(stored: Mapping[str, Any], parts: Parts, name: str) -> StoredCast:
    """Return a stored cast, if it is one."""
    try:
        values = dict(stored["values"])
        for column in _COLUMNS:
            if column != "status":
                values[column] = np.nan if values[column] is None else float(values[column])
        for column in _LISTS:
            if values.get(column) is not None:
                values[column] = np.array(values[column], dtype=float)
        return StoredCast(
            purpose=str(stored["purpose"]),
            values=values | {"status": str(values["status"])},
            note=dict(stored["note"]),
            origin=str(stored["origin"]),
        )
    except (KeyError, TypeError, ValueError):
        raise DamagedFileError(
            f"{parts.file(name)} holds no cast: restore it from a copy"
        ) from None
