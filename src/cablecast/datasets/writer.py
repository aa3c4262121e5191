"""Writing a dataset shard by shard, so that it survives a kill at any moment and can be resumed.

A folder is laid out as LeRobot v3 does: `data/chunk-000/file-000.parquet` and so on,
`meta/info.json`, `meta/stats.json` and a README.md card. `meta/info.json` is written first, with
`complete` false, and again at the very end; a shard that exists is whole, because it was renamed
into place.
"""

import hashlib
import io
import json
import os
import pathlib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from cablecast.datasets.card import dataset_card
from cablecast.datasets.schema import (
    COLUMNS,
    OPTIONAL_COLUMNS,
    SCHEMA_VERSION,
    Column,
    arrow_schema,
    check_columns,
    settings_differences,
)
from cablecast.errors import DatasetError
from cablecast.files import write_bytes, write_json, write_text

CHUNK_SIZE = 1000
"""Shards in one folder, as in LeRobot v3."""

INFO_PATH = pathlib.Path("meta/info.json")


def shard_path(shard: int) -> str:
    """Where a shard lies within a dataset."""
    return f"data/chunk-{shard // CHUNK_SIZE:03d}/file-{shard % CHUNK_SIZE:03d}.parquet"


def settings_fingerprint(settings: Mapping[str, Any]) -> str:
    """A short name for some settings: the start of the SHA-256 of their canonical JSON."""
    text = json.dumps(settings, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class DatasetWriter:
    """Writes one dataset; a context manager that holds the folder against a second writer.

    Attributes:
        path: The folder.
        kind: "sim", "real", "tune" or "repeat".
        row_count: Rows of the finished dataset.
        shard_rows: Rows of each shard but the last.
    """

    def __init__(
        self,
        path: pathlib.Path,
        *,
        kind: str,
        settings: Mapping[str, Any],
        row_count: int,
        shard_rows: int,
    ):
        """Prepare to write or resume.

        Args:
            path: The folder; new, empty, or holding a dataset of the same settings.
            kind: "sim", "real", "tune" or "repeat".
            settings: Everything that decides the rows, as plain values. Written as they are.
            row_count: Rows of the finished dataset.
            shard_rows: Rows of each shard but the last.
        """
        self.path = pathlib.Path(path)
        self.kind = kind
        # A round through JSON makes tuples lists, so that stored and wanted settings compare.
        self.settings = json.loads(json.dumps(settings, allow_nan=False))
        self.row_count = row_count
        self.shard_rows = shard_rows
        self._lock: int | None = None

    @property
    def shard_count(self) -> int:
        """How many shards the finished dataset has."""
        return -(-self.row_count // self.shard_rows)

    def rows_of(self, shard: int) -> range:
        """Indices of the rows of a shard."""
        start = shard * self.shard_rows
        return range(start, min(start + self.shard_rows, self.row_count))

    def __enter__(self) -> "DatasetWriter":
        """Create the folder, or check that it holds the beginning of the same dataset.

        Raises:
            DatasetError: The folder holds something else or another process writes to it.
        """
        if self.path.exists() and not self.path.is_dir():
            raise DatasetError(f"{self.path} is a file: a dataset needs a folder")
        stored = self._stored_info()
        self.path.mkdir(parents=True, exist_ok=True)
        self._acquire_lock()
        try:
            for leftover in self.path.rglob(".*.tmp"):
                leftover.unlink()
            if stored is None:
                write_json(self.path / INFO_PATH, self._info(complete=False))
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    @property
    def complete(self) -> bool:
        """Whether the dataset is finished."""
        info = self._stored_info()
        return info is not None and info["complete"]

    def missing_shards(self) -> list[int]:
        """Shards that are still to be written.

        Raises:
            DatasetError: A shard that exists is damaged.
        """
        missing = []
        for shard in range(self.shard_count):
            file = self.path / shard_path(shard)
            if file.exists():
                read_shard(file, self.rows_of(shard))
            else:
                missing.append(shard)
        return missing

    def write_shard(self, shard: int, columns: Mapping[str, Any]) -> None:
        """Write one shard; it exists whole or not at all.

        Args:
            shard: Its number.
            columns: Values by column name, each of shape [row].
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        rows = self.rows_of(shard)
        if check_columns(columns) != len(rows):
            raise DatasetError(f"shard {shard} needs {len(rows)} rows, not {len(columns['index'])}")
        schema = arrow_schema(tuple(columns))
        schema = schema.with_metadata({"settings": settings_fingerprint(self.settings)})
        table = pa.table({name: columns[name] for name in schema.names}, schema=schema)
        buffer = io.BytesIO()
        pq.write_table(table, buffer, compression="zstd", write_page_checksum=True)
        write_bytes(self.path / shard_path(shard), buffer.getvalue())

    def finish(self) -> None:
        """Write statistics and card, and mark the dataset as complete."""
        import pyarrow as pa

        tables = [
            read_shard(self.path / shard_path(shard), self.rows_of(shard))
            for shard in range(self.shard_count)
        ]
        table = pa.concat_tables(tables)
        stats = _statistics(table)
        counts = {
            entry["values"]: entry["counts"]
            for entry in table["status"].combine_chunks().value_counts().to_pylist()
        }
        info = self._info(complete=True) | {"status_counts": dict(sorted(counts.items()))}
        info["features"] |= _features(
            column for column in OPTIONAL_COLUMNS if column.name in table.column_names
        )
        write_json(self.path / "meta/stats.json", stats)
        write_text(self.path / "README.md", dataset_card(info, stats))
        write_json(self.path / INFO_PATH, info)

    def _info(self, complete: bool) -> dict[str, Any]:
        return {
            "layout": "lerobot-v3",
            "schema_version": SCHEMA_VERSION,
            "kind": self.kind,
            "complete": complete,
            "total_episodes": self.row_count,
            "total_frames": self.row_count,
            "chunks_size": CHUNK_SIZE,
            "shard_rows": self.shard_rows,
            "shard_count": self.shard_count,
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "splits": {"train": f"0:{self.row_count}"},
            "features": _features(COLUMNS),
            "fingerprint": settings_fingerprint(self.settings),
            "settings": self.settings,
        }

    def _stored_info(self) -> dict[str, Any] | None:
        if not (self.path / INFO_PATH).exists():
            if self.path.is_dir():
                self._refuse_foreign_files()
            return None
        info = read_info(self.path)
        stored = {"kind": info["kind"], "shard_rows": info["shard_rows"]} | info["settings"]
        wanted = {"kind": self.kind, "shard_rows": self.shard_rows} | self.settings
        if differences := settings_differences(stored, wanted):
            raise DatasetError(
                f"{self.path} holds a dataset of other settings: {'; '.join(differences)}. "
                "Give the same settings or another folder"
            )
        return info

    def _refuse_foreign_files(self) -> None:
        for file in sorted(self.path.rglob("*")):
            # A run killed at its very start leaves the temporary file of meta/info.json.
            if file.is_file() and not (file.name.startswith(".") and file.suffix == ".tmp"):
                raise DatasetError(
                    f"{self.path} is not empty and holds no dataset (it has {file.name}): "
                    "give another folder"
                )

    def _acquire_lock(self) -> None:
        try:
            import fcntl
        except ImportError:  # Windows has no advisory locks on folders; one writer is assumed.
            return
        self._lock = os.open(self.path, os.O_RDONLY)
        try:
            # The system releases the lock when the process dies, however it dies.
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self.__exit__()
            raise DatasetError(f"another process is writing to {self.path}") from None


def read_info(path: pathlib.Path) -> dict[str, Any]:
    """The description of a dataset, finished or not.

    Raises:
        DatasetError: There is none, or it is damaged or of another schema version.
    """
    file = pathlib.Path(path) / INFO_PATH
    try:
        info = json.loads(file.read_text())
        version = info["schema_version"]
    except FileNotFoundError:
        raise DatasetError(f"{path} is not a dataset: {file} is missing") from None
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise DatasetError(f"{file} is damaged or of another kind: {error!r}") from None
    if version != SCHEMA_VERSION:
        raise DatasetError(
            f"{path} has schema version {version}: this cablecast reads {SCHEMA_VERSION}"
        )
    return info


def read_shard(file: pathlib.Path, rows: range):
    """The table of one shard, checked.

    Args:
        file: A Parquet file.
        rows: The indices that it must hold.

    Raises:
        DatasetError: It is missing, truncated, corrupt, or holds other rows.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(file, page_checksum_verification=True) as parquet:
            table = parquet.read()
    except FileNotFoundError:
        raise DatasetError(f"shard {file} is missing: resume the dataset") from None
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DatasetError(
            f"shard {file} is truncated or damaged ({reason}): delete it and resume the dataset"
        ) from None
    if missing := [column.name for column in COLUMNS if column.name not in table.column_names]:
        raise DatasetError(f"shard {file} lacks the columns {missing}")
    if not np.array_equal(table["index"].to_numpy(), np.arange(rows.start, rows.stop)):
        raise DatasetError(f"shard {file} must hold the rows {rows.start} to {rows.stop - 1}")
    return table


def _features(columns: Iterable[Column]) -> dict[str, dict[str, Any]]:
    """What the info says of some columns; a list has its own length in each row."""
    return {
        column.name: {
            "dtype": column.kind,
            "shape": [None] if column.kind == "list" else [1],
            "unit": column.unit,
        }
        for column in columns
    }


def _statistics(table) -> dict[str, dict[str, Any]]:
    """Extremes, mean and deviation of the finite values of each column of numbers."""
    stats = {}
    for column in (*COLUMNS, *OPTIONAL_COLUMNS):
        if column.kind not in ("int64", "float64") or column.name not in table.column_names:
            continue
        values = table[column.name].to_numpy()
        values = values[np.isfinite(values)]
        if len(values):
            stats[column.name] = {
                "min": [float(values.min())],
                "max": [float(values.max())],
                "mean": [float(values.mean())],
                "std": [float(values.std())],
                "count": [len(values)],
            }
    return stats
