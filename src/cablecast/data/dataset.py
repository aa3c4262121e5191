"""Datasets of casts, read with every shard checked: rows, tracks, joints and settings."""

import dataclasses
import functools
import itertools
import json
import pathlib
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.cast import ControllerLog, EndpointTrack, TrialStatus
from cablecast.conventions import Array
from cablecast.data.schema import (
    COLUMNS,
    CONTROLLER_COLUMNS,
    ENDPOINT_COLUMNS,
    EXTENT_COLUMNS,
    INFO_PATH,
    read_info,
    read_shard,
    shard_path,
)
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import CablecastError, DatasetError, InputError
from cablecast.motion.action import ACTION_NAMES, ActionRanges, action_rows
from cablecast.motion.casting import Action
from cablecast.motion.families import MOTIONS, motion_of
from cablecast.motion.grip_path import CHANNELS
from cablecast.motion.trajectory import JointPath, Motion
from cablecast.runs.folder import fingerprint
from cablecast.setup import SECTIONS, Setup, laboratory_sections
from cablecast.task import Landing, Task

T = TypeVar("T")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Dataset:
    """Trials: actions and their outcomes.

    Attributes:
        actions: (theta1, theta2, r2, psi, pace) [rad, rad, m, rad, -], shape [row, 5]; without the
            pace, which is 1 then, [row, 4].
        rest_xy: Resting point of the free end [m], shape [row, 2]; NaN where unknown. A
            simulated row that left the table keeps the place of the end that hangs or fell.
        status: Codes of the trial statuses, shape [row].
        duration: Duration of the gripper's motion [s], shape [row].
        extent: Smallest x, largest x, smallest y and largest y of the free end during the cast [m],
            shape [row, 4].
        extra: Other columns by name, each of length row.
        info: Content of `meta/info.json`: settings, fingerprint and so on.
        path: Folder that it was read from; None for a dataset in memory.
    """

    actions: Array
    rest_xy: Array
    status: NDArray[np.str_]
    duration: Array
    extent: Array
    extra: dict[str, Any] = dataclasses.field(default_factory=dict)
    info: dict[str, Any] = dataclasses.field(default_factory=dict)
    path: pathlib.Path | None = None

    def __post_init__(self):
        row_count = len(self.actions)
        object.__setattr__(self, "actions", action_rows(self.actions))
        for name, shape in (
            ("rest_xy", (row_count, 2)),
            ("status", (row_count,)),
            ("duration", (row_count,)),
            ("extent", (row_count, 4)),
        ):
            if getattr(self, name).shape != shape:
                raise DatasetError(f"{name} has shape {getattr(self, name).shape}, not {shape}")

    def __len__(self) -> int:
        return len(self.actions)

    @property
    def finite(self) -> NDArray[np.bool_]:
        """Rows whose resting point is known, on the table or off it, shape [row]."""
        return np.all(np.isfinite(self.rest_xy), axis=1)

    @property
    def ok(self) -> NDArray[np.bool_]:
        """Rows whose free end stayed on the table and came to rest there, shape [row]."""
        return self.status == TrialStatus.OK.code

    @property
    def kind(self) -> str:
        """Kind of the casts: "sim", "real", "tune", "repeat", "evaluate", or a session's "aim"."""
        return self.info.get("kind", "")

    @property
    def fingerprint(self) -> str:
        """Fingerprint of the settings and of all rows."""
        return self.info.get("fingerprint", "")

    @functools.cached_property
    def settings(self) -> "StoredSettings":
        """Settings that the casts were made with."""
        return StoredSettings(self.info, self._name)

    @property
    def setup(self) -> Setup:
        """Cable, workspace, arm and motion settings of the casts."""
        return self.settings.setup

    @property
    def cable(self) -> Cable:
        """Cable that was cast."""
        return self.setup.cable

    @property
    def status_counts(self) -> dict[str, int]:
        """Number of trials of each status, by its code."""
        codes, counts = np.unique(self.status, return_counts=True)
        return dict(zip(codes.tolist(), counts.tolist(), strict=True))

    def outcomes(self, task: Task) -> Array:
        """Return the outcomes of simulated casts in a task, shape [row, k]; NaN where unknown.

        Raises:
            DatasetError: They were simulated for another task.
        """
        if isinstance(task, Landing):
            return self.rest_xy
        if self.info.get("settings", {}).get("task") != task.name:
            raise DatasetError(f"{self._name} has no outcomes of {task.name}: simulate anew")
        return np.array(self.extra["outcome"], dtype=float)

    def table_margin(self) -> Array:
        """Return the free end's least distance from the table's edges by cast [m], shape [row].

        It is negative where the end left the table, minus infinity where its path is unknown.
        """
        x_min, x_max, y_min, y_max = self.extent.T
        corners = np.stack(
            [np.stack([x_min, y_min], axis=-1), np.stack([x_max, y_max], axis=-1)], axis=1
        )
        margin = self.setup.workspace.edge_distance(corners).min(axis=1)
        return np.where(np.isfinite(margin), margin, -np.inf)

    def rows(self, chosen: ArrayLike) -> "Dataset":
        """Return the dataset of chosen rows, by a mask or by indices in the new order, in memory.

        Raises:
            DatasetError: The mask has another length, or an index is out of range.
        """
        chosen = np.atleast_1d(np.asarray(chosen))
        try:
            rows = np.arange(len(self))[chosen if chosen.size else chosen.astype(int)]
        except IndexError as error:
            raise DatasetError(f"{self._name} has {len(self)} rows: {error}") from None
        settings = self.info.get("settings", {})
        # What describes the files of the whole does not describe its rows.
        kept = {
            name: self.info[name] for name in ("kind", "cablecast_version") if name in self.info
        }
        return Dataset(
            actions=self.actions[rows],
            rest_xy=self.rest_xy[rows],
            status=self.status[rows],
            duration=self.duration[rows],
            extent=self.extent[rows],
            extra={name: [values[row] for row in rows] for name, values in self.extra.items()},
            info={
                **kept,
                "fingerprint": fingerprint([self.fingerprint, rows.tolist()]),
                "settings": {**settings, "count": len(rows)},
            },
        )

    def motion(self, row: int) -> Motion | None:
        """Return what the motion of one trial was planned from; None for one of no family."""
        columns: dict[str, float] = dict(zip(Action.parameters, self.actions[row], strict=True))
        for name in itertools.chain.from_iterable(kind.parameters for kind in MOTIONS):
            if name in self.extra:
                columns[name] = self.extra[name][row]
        return motion_of(columns)

    def track(self, row: int) -> EndpointTrack:
        """Return the track that the rig reported for one trial.

        Raises:
            DatasetError: The dataset holds no track of it, or a damaged one.
        """
        times, x, y = (self._values(name, row) for name in ("times", "track_x", "track_y"))
        if times is None or x is None or y is None:
            raise DatasetError(f"{self._name} holds no track of trial {row}")
        nodes = self._values("nodes", row)
        if nodes is not None:
            if not len(times) or len(nodes) % (3 * len(times)):
                raise self._damage(
                    row,
                    f"has {len(nodes)} node coordinates for {len(times)} times: they must be three "
                    "for each node",
                )
            nodes = nodes.reshape(len(times), -1, 3)
        return EndpointTrack(
            times=times,
            endpoint_xy=np.stack([x, y], axis=-1),
            status=TrialStatus.from_code(str(self.status[row])),
            nodes=nodes,
            joint_path=self.measured_joints(row),
            controller_log=self.controller_log(row),
            note=str(self.extra["note"][row] or "") if "note" in self.extra else "",
            endpoint_z=self._values("track_z", row),
        )

    def measured_joints(self, row: int) -> JointPath | None:
        """Return the measured joints of one trial; None if the rig reported none."""
        return self._joint_path("actual_times", "actual_q", row)

    def commanded_joints(self, row: int) -> JointPath | None:
        """Return the commanded joints of one trial; None if the motion had none."""
        return self._joint_path("joint_times", "joint_q", row)

    def controller_log(self, row: int) -> ControllerLog | None:
        """Return what the arm's controller reported of one trial; None if not recorded."""
        values = [self._values(name, row) for name in CONTROLLER_COLUMNS]
        times, target_q, speed_scaling, safety_bits = values
        if times is None or target_q is None or speed_scaling is None or safety_bits is None:
            return None
        try:
            return ControllerLog(
                times=times,
                target_q=target_q.reshape(-1, self.setup.arm.joint_count),
                speed_scaling=speed_scaling,
                safety_bits=safety_bits,
            )
        except ValueError as error:
            raise DatasetError(f"trial {row} of {self._name}: {error}") from None

    def measured_poses(self, row: int) -> tuple[Array, Array] | None:
        """Return times [s] and poses of the tracked grip in one trial; None if it was not tracked.

        A pose is x, y, z [m], yaw and pitch [rad]; shapes [sample] and [sample, 5].
        """
        return self._by_time("grip_times", "grip_pose", len(CHANNELS), row)

    def rig(self, row: int) -> dict[str, Any]:
        """Return the rig's description at one trial."""
        texts = self.extra.get("rig")
        return self.settings.rig if texts is None else json.loads(texts[row])

    def _values(self, name: str, row: int) -> Array | None:
        column = self.extra.get(name)
        if column is None or column[row] is None:
            return None
        return np.asarray(column[row], dtype=float)

    def _by_time(
        self, times_name: str, name: str, size: int, row: int
    ) -> tuple[Array, Array] | None:
        """Return times, and values that are stored one group after the other; None without any."""
        times, values = self._values(times_name, row), self._values(name, row)
        if times is None or values is None or not len(times):
            return None
        if len(values) != size * len(times):
            raise self._damage(
                row,
                f"has {len(values)} values of {name} for {len(times)} times, not {size} for each",
            )
        return times, values.reshape(-1, size)

    def _joint_path(self, times_name: str, q_name: str, row: int) -> JointPath | None:
        found = self._by_time(times_name, q_name, self.setup.arm.joint_count, row)
        if found is None:
            return None
        times, q = found
        if not (np.all(np.diff(times) > 0) and np.all(np.isfinite(q))):
            raise self._damage(row, "has joints that are not finite or times that do not rise")
        # Rates are not stored; any reader can take differences of the angles.
        qd = np.asarray(np.gradient(q, times, axis=0)) if len(times) > 1 else np.zeros_like(q)
        return JointPath(times=times, q=q, qd=qd)

    def _damage(self, row: int, what: str) -> DatasetError:
        return DatasetError(f"trial {row} of {self._name} {what}")

    @property
    def _name(self) -> str:
        return str(self.path or "the dataset")


@dataclasses.dataclass(frozen=True)
class StoredSettings:
    """Settings that casts were made with, as a dataset or a model (`owner`) stores them in `info`.

    Reading one raises `DatasetError` where it is missing, or was written by a version of cablecast
    with other settings.
    """

    info: Mapping[str, Any]
    owner: str

    @property
    def values(self) -> dict[str, Any]:
        """All settings, as plain values by name."""
        return self.info.get("settings", {})

    @functools.cached_property
    def setup(self) -> Setup:
        """Cable, workspace, arm and motion settings."""
        return self._read(
            lambda values: Setup.from_dict(laboratory_sections(values)),
            "set-up",
            SECTIONS,
        )

    @property
    def is_simulated(self) -> bool:
        """True if the casts were simulated, with dynamics that are known."""
        return self.values.get("params") is not None

    @property
    def dynamics(self) -> Dynamics:
        """Cable and servo of the arm that the casts were simulated with."""
        return self._read(Dynamics.from_dict, "dynamics", ("params",))

    @property
    def ranges(self) -> ActionRanges | None:
        """Ranges from which the actions were chosen; None for given actions."""
        if self.values.get("ranges") is None:
            return None
        return self._read(
            lambda values: ActionRanges(**{k: tuple(v) for k, v in values["ranges"].items()}),
            "ranges",
            ("ranges",),
        )

    @property
    def rig(self) -> dict[str, Any]:
        """Description of the rig; empty for simulated casts."""
        return dict(self.values.get("rig", {}))

    def _read(self, make: Callable[[dict[str, Any]], T], what: str, needed: tuple[str, ...]) -> T:
        if missing := [name for name in needed if self.values.get(name) is None]:
            raise DatasetError(f"the settings of {self.owner} lack {', '.join(missing)}")
        try:
            return make(self.values)
        except (TypeError, AttributeError, CablecastError) as error:
            version = str(self.info.get("cablecast_version", "?"))[:20]
            raise DatasetError(
                f"{self.owner} was made by cablecast {version}, whose {what} does not fit this "
                f"version ({error}): make it anew"
            ) from None


def read_dataset(path: str | pathlib.Path) -> Dataset:
    """Read a finished dataset.

    Raises:
        DatasetError: It is missing or unfinished, or a shard is damaged.
        UnreadableFileError: The system refuses to read a file.
    """
    import pyarrow as pa

    path = pathlib.Path(path)
    info = read_info(path)
    row_count, shard_rows = info["total_frames"], info["shard_rows"]
    shards = range(info["shard_count"])
    if not info["complete"]:
        present = sum((path / shard_path(shard)).exists() for shard in shards)
        raise DatasetError(
            f"{path} is unfinished: {present} of {len(shards)} shards exist. Run the command that "
            "made it again to complete it"
        )
    settings = fingerprint(info["settings"])
    tables, digests = [], []
    for shard in shards:
        start = shard * shard_rows
        rows = range(start, min(start + shard_rows, row_count))
        known = info["shard_digests"][shard]
        table, digest = read_shard(path / shard_path(shard), rows, settings, known)
        tables.append(table)
        digests.append(digest)
    if fingerprint([settings, *digests]) != info["fingerprint"]:
        raise DatasetError(
            f"{path / INFO_PATH} is damaged: its fingerprint is not that of the rows"
        )
    try:
        table = pa.concat_tables(tables, promote_options="default")
    except pa.ArrowException as error:
        raise DatasetError(f"shards of {path} differ in their columns: {error}") from None

    return table_dataset(table, info, path)


def table_dataset(table: Any, info: dict[str, Any], path: pathlib.Path | None = None) -> Dataset:
    """Return the dataset that a pyarrow table of checked rows holds."""

    def stack(names: tuple[str, ...]) -> Array:
        return np.stack([table[name].to_numpy() for name in names], axis=-1)

    known = {column.name for column in COLUMNS}
    status = np.array(table["status"].to_pylist(), dtype=str)
    for code in np.unique(status):
        try:
            TrialStatus.from_code(str(code))
        except InputError as error:
            raise DatasetError(f"{path or 'the dataset'}: {error}") from None
    return Dataset(
        actions=stack(ACTION_NAMES),
        rest_xy=stack(ENDPOINT_COLUMNS),
        status=status,
        duration=table["duration"].to_numpy(),
        extent=stack(EXTENT_COLUMNS),
        extra={name: table[name].to_pylist() for name in table.column_names if name not in known},
        info=info,
        path=path,
    )
