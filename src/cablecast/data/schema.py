"""Schema of D_tune, D_sim and D_real, and their files: one row is one trial.

Every dataset has the columns from `index` to `y_max`. Trials on a rig add some of
`OPTIONAL_COLUMNS`. Unknown columns are read as they are. `meta/info.json` describes a dataset; its
rows lie in shards, Parquet files that are checked when they are read.
"""

import hashlib
import io
import pathlib
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from cablecast.conventions import Array
from cablecast.errors import COUNT_MAX, DamagedFileError, DatasetError
from cablecast.files import read_bytes, read_sealed
from cablecast.motion.joint_move import TURN_NAMES

SCHEMA_VERSION = 4
"""Version of the schema; datasets of other versions are refused."""


class Column(NamedTuple):
    """One column of a dataset; the unit is "-" for none, the meaning a phrase for the card.

    The kind is "int64", "float64", "string", or "list" of float64.
    """

    name: str
    kind: str
    unit: str
    meaning: str


COLUMNS = (
    Column("index", "int64", "-", "number of the trial, from 0"),
    Column("theta1", "float64", "rad", "angle at which the motion turns back"),
    Column("theta2", "float64", "rad", "angle at which the motion ends"),
    Column("r2", "float64", "m", "radius at which the motion ends"),
    Column("psi", "float64", "rad", "heading of the gripper at the end"),
    Column("pace", "float64", "-", "speed over that of the paper's motion"),
    Column(
        "endpoint_x", "float64", "m", "resting point of the free end, to the right of the robot"
    ),
    Column("endpoint_y", "float64", "m", "resting point of the free end, away from the robot"),
    Column("status", "string", "-", "end of the trial"),
    Column("duration", "float64", "s", "duration of the gripper's motion"),
    Column("x_min", "float64", "m", "smallest x of the free end during the trial"),
    Column("x_max", "float64", "m", "largest x of the free end during the trial"),
    Column("y_min", "float64", "m", "smallest y of the free end during the trial"),
    Column("y_max", "float64", "m", "largest y of the free end during the trial"),
)

OPTIONAL_COLUMNS = (
    Column("outcome", "list", "-", "outcome in the task that it was simulated for, if no landing"),
    Column("polar_azimuth", "float64", "rad", "azimuth of the swing of a polar cast"),
    Column("polar_x", "float64", "m", "x of the gripper at the end of its pull"),
    Column("polar_y", "float64", "m", "y of the gripper at the end of its pull"),
    Column("polar_pace", "float64", "-", "pace of its swing; that of the reset is 1"),
    Column("swing_speed", "float64", "rad/s", "speed of the joint that moves most in a swing"),
    *(
        Column(name, "float64", "rad", f"turn of joint {number} in a swing")
        for number, name in enumerate(TURN_NAMES, 1)
    ),
    Column("repeat", "int64", "-", "repeat of the same action, from 0"),
    Column("times", "list", "s", "times of the track"),
    Column("track_x", "list", "m", "x of the free end at these times"),
    Column("track_y", "list", "m", "y of the free end at these times"),
    Column("track_z", "list", "m", "height of a free end that was swung in the air"),
    Column("joint_times", "list", "s", "times of the commanded joints"),
    Column(
        "joint_q", "list", "rad", "commanded joint angles, joint after joint, one group per time"
    ),
    Column("actual_times", "list", "s", "times of the reported joints"),
    Column(
        "actual_q", "list", "rad", "reported joint angles, joint after joint, one group per time"
    ),
    Column("controller_times", "list", "s", "these times by the clock of the arm's controller"),
    Column(
        "target_q",
        "list",
        "rad",
        "joint angles that the controller followed then, joint after joint",
    ),
    Column("speed_scaling", "list", "-", "speed scaling that the controller reported then"),
    Column("safety_bits", "list", "-", "safety status bits that the controller reported then"),
    Column("grip_times", "list", "s", "times of the tracked grip, where no arm moved it"),
    Column(
        "grip_pose", "list", "m, rad", "x, y, z, yaw and pitch of the tracked grip, five after five"
    ),
    Column("nodes", "list", "m", "x, y and z of the nodes from the grip to the free end, by time"),
    Column("purpose", "string", "-", "what the cast was made for"),
    Column("origin", "string", "-", "fingerprint of the dataset and the row it came from"),
    Column("task", "string", "-", "task of an aimed cast, whose coordinates the goal has"),
    Column("goal", "list", "m", "outcome that the cast was aimed at"),
    Column("within_pct", "float64", "% of cable length", "distance from the goal that is a hit"),
    Column("try_number", "int64", "-", "number of the cast at its goal, from 1"),
    Column("expected", "list", "m", "outcome that was expected"),
    Column("covariance", "list", "m²", "covariance about it before any miss, row after row"),
    Column("law", "list", "-", "factor on that covariance, and degrees of freedom of the law"),
    Column("scatter", "float64", "m", "standard deviation of equal casts along each axis"),
    Column("failure", "float64", "-", "probability of a cast without an outcome"),
    Column("inside_coverage", "int64", "-", "1 where simulated casts end near the goal, else 0"),
    Column("note", "string", "-", "what was corrected in the cast"),
    Column("attempt", "int64", "-", "failed attempts before this one"),
    Column("rig", "string", "-", "description of the rig, as JSON"),
)

ENDPOINT_COLUMNS = ("endpoint_x", "endpoint_y")
EXTENT_COLUMNS = ("x_min", "x_max", "y_min", "y_max")
CONTROLLER_COLUMNS = ("controller_times", "target_q", "speed_scaling", "safety_bits")
"""Lists of what an arm's controller reported, in the order of `ControllerLog`."""


def columns_table(columns: Mapping[str, Any]) -> Any:
    """Return the pyarrow table of a shard, from values by column name, each of shape [row]."""
    import pyarrow as pa

    kinds = {
        "int64": pa.int64(),
        "float64": pa.float64(),
        "string": pa.string(),
        "list": pa.list_(pa.float64()),
    }
    optional = [column for column in OPTIONAL_COLUMNS if column.name in columns]
    schema = pa.schema(
        [
            pa.field(column.name, kinds[column.kind], metadata={"unit": column.unit})
            for column in (*COLUMNS, *optional)
        ]
    )
    return pa.table({name: columns.get(name, []) for name in schema.names}, schema=schema)


def track_extent(endpoint_xy: Array) -> Array:
    """Return smallest x, largest x, smallest y and largest y of paths [m], shape [row, 4].

    Paths have the shape [row, step, 2], with NaN where the free end was not seen; rows in which it
    was never seen become NaN.
    """
    missing = ~np.isfinite(endpoint_xy)
    low = np.where(missing, np.inf, endpoint_xy).min(axis=1)
    high = np.where(missing, -np.inf, endpoint_xy).max(axis=1)
    extent = np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=-1)
    return np.where(np.isfinite(extent), extent, np.nan)


CHUNK_SIZE = 1000
"""Shards in one folder, as in LeRobot v3."""

INFO_PATH = pathlib.Path("meta/info.json")

_KINDS: dict[str, type] = {
    "kind": str,
    "complete": bool,
    "total_frames": int,
    "shard_rows": int,
    "shard_count": int,
    "fingerprint": str,
    "shard_digests": list,
    "settings": dict,
}


def shard_path(shard: int) -> str:
    """Return the path of a shard within a dataset."""
    return f"data/chunk-{shard // CHUNK_SIZE:03d}/file-{shard % CHUNK_SIZE:03d}.parquet"


def read_info(path: pathlib.Path) -> dict[str, Any]:
    """Return the description of a dataset, finished or not.

    Raises:
        DatasetError: There is none, or it is damaged or of another schema version.
        UnreadableFileError: The system refuses to read it.
    """
    file = path / INFO_PATH
    try:
        info = read_sealed(file)
    except FileNotFoundError:
        raise DatasetError(f"{path} is not a dataset: {file} is missing") from None
    except DamagedFileError as error:
        raise DatasetError(
            f"{error}. It describes the dataset: restore it, or make the dataset anew"
        ) from None
    check_info(info, path)
    return info


def check_info(info: dict[str, Any], path: pathlib.Path) -> None:
    """Refuse a description that this version cannot read."""
    if info.get("schema_version") != SCHEMA_VERSION:
        raise DatasetError(
            f"{path} has schema version {str(info.get('schema_version'))[:20]}: this cablecast "
            f"reads {SCHEMA_VERSION}, make the dataset anew"
        )
    for name, kind in _KINDS.items():
        value = info.get(name)
        if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
            raise DatasetError(f"{path / INFO_PATH} is damaged: {name} = {str(value)[:40]!r}")
    rows, shard_rows = info["total_frames"], info["shard_rows"]
    if not (1 <= rows <= COUNT_MAX and 1 <= shard_rows <= COUNT_MAX):
        raise DatasetError(f"{path / INFO_PATH} is damaged: {rows} rows in shards of {shard_rows}")
    if info["shard_count"] != -(-rows // shard_rows):
        raise DatasetError(
            f"{path / INFO_PATH} is damaged: {info['shard_count']} shards for {rows} rows"
        )
    if len(info["shard_digests"]) != (info["shard_count"] if info["complete"] else 0):
        raise DatasetError(f"{path / INFO_PATH} is damaged: it lacks digests of shards")


SHARD_SIZE_MAX = 2**32
"""Largest shard that is read [byte]."""


def shard_bytes(table: Any, settings_fingerprint: str) -> bytes:
    """Return the content of the file of a shard: a pyarrow table, marked with its settings."""
    import pyarrow.parquet as pq

    metadata = {"settings": settings_fingerprint, "rows": _rows_digest(table)}
    buffer = io.BytesIO()
    table = table.replace_schema_metadata(metadata)
    pq.write_table(table, buffer, compression="zstd", write_page_checksum=True)
    return buffer.getvalue()


def read_shard(
    file: pathlib.Path, rows: range, settings_fingerprint: str, digest: str | None = None
) -> tuple[Any, str]:
    """Return the table of one shard, checked, and the digest of its bytes.

    It must hold the rows, and come from the settings; its digest is not checked if None.

    Raises:
        DatasetError: It is missing, damaged, of another dataset, or holds other rows.
        UnreadableFileError: The system refuses to read it.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        content = read_bytes(file, SHARD_SIZE_MAX)
    except FileNotFoundError:
        raise DatasetError(
            f"shard {file} is missing: run the command that made the dataset again, it makes the "
            "shard again"
        ) from None
    try:
        with pq.ParquetFile(io.BytesIO(content), page_checksum_verification=True) as parquet:
            table = parquet.read()
            metadata = parquet.schema_arrow.metadata or {}
            rows_digest = _rows_digest(table)
    except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
        raise _damage(file, error) from None
    if metadata.get(b"rows", b"").decode(errors="replace") != rows_digest:
        raise _damage(file, "its rows do not match their checksum")
    if missing := [column.name for column in COLUMNS if column.name not in table.column_names]:
        raise DatasetError(f"shard {file} lacks the columns {missing}")
    if not np.array_equal(table["index"].to_numpy(), np.arange(rows.start, rows.stop)):
        raise DatasetError(f"shard {file} must hold the rows {rows.start} to {rows.stop - 1}")
    if metadata.get(b"settings", b"").decode(errors="replace") != settings_fingerprint:
        raise DatasetError(
            f"shard {file} belongs to a dataset of other settings: delete it and run the command "
            "that made the dataset again"
        )
    found = hashlib.sha256(content).hexdigest()[:16]
    if digest not in (None, found):
        raise DatasetError(
            f"shard {file} is not the one that the dataset was finished with: restore it, or "
            "delete it and run the command that made the dataset again"
        )
    return table, found


def _damage(file: pathlib.Path, reason: object) -> DatasetError:
    line = " ".join(str(reason).split())[:200] or type(reason).__name__
    return DatasetError(
        f"shard {file} is truncated or damaged ({line}): delete it and run the command that made "
        "the dataset again, it makes the shard again"
    )


def _rows_digest(table: Any) -> str:
    """Return a checksum over the names, types and values of all columns.

    Parquet has checksums for its pages but none for its footer, in which a flipped bit may rename a
    column or change its type.
    """
    import pyarrow as pa

    digest = hashlib.sha256()
    for name in table.column_names:
        column = table[name].combine_chunks()
        digest.update(f"{name} {len(column)} {column.null_count}".encode())
        if pa.types.is_list(column.type):
            digest.update(repr(column.value_lengths().to_pylist()).encode())
            column = column.flatten()
        digest.update(str(column.type).encode())
        if pa.types.is_floating(column.type) or pa.types.is_integer(column.type):
            digest.update(column.to_numpy(zero_copy_only=False).tobytes())
        else:
            digest.update(repr(column.to_pylist()).encode("utf-8", "surrogatepass"))
    return digest.hexdigest()[:32]
