"""Writer of datasets, shard by shard: a kill at any moment loses at most the shard under way.

The layout of the folder is that of LeRobot v3: `data/chunk-000/file-000.parquet` and so on,
`meta/info.json`, `meta/stats.json` and a README.md card. `meta/info.json` is written first, with
`complete` false, and again at the very end. A shard that exists is whole, because it was renamed
into place. A missing shard of a finished dataset is made again.
"""

import collections
import contextlib
import dataclasses
import json
import pathlib
import string
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

import cablecast
from cablecast.data.schema import (
    CHUNK_SIZE,
    COLUMNS,
    INFO_PATH,
    OPTIONAL_COLUMNS,
    SCHEMA_VERSION,
    Column,
    check_info,
    columns_table,
    read_shard,
    shard_bytes,
    shard_path,
)
from cablecast.errors import DatasetError
from cablecast.files import write_bytes, write_json, write_text
from cablecast.runs.folder import Claim, fingerprint, flat_settings, hold_folder, plain_settings

_CARD_FILE = pathlib.Path(__file__).with_name("card.md")

_TITLES = {
    "sim": "Simulated casts (D_sim)",
    "real": "Casts on a rig for fine-tuning (D_real)",
    "tune": "Casts on a rig for tuning the simulator (D_tune)",
    "evaluate": "Casts at targets (evaluation)",
    "repeat": "The same casts again and again on a rig (repeatability)",
}

_SIMULATED = (
    "A row whose free end left the table has the status `off_table`, and the place where it hangs "
    "or fell to; the columns of the path's extent show those that left the table on their way. A "
    "row of status `non_finite` has no resting point."
)
_ON_A_RIG = (
    "Only a row of status `ok` has a resting point. The track holds NaN where the free end was not "
    "seen. Aborted trials were repeated and are not included."
)


def dataset_card(info: Mapping[str, Any], stats: Mapping[str, Any]) -> str:
    """Return the card of a finished dataset, from its meta/info.json and meta/stats.json."""
    settings = info["settings"]
    cable = settings.get("cable", {})
    title = f"{_TITLES.get(info['kind'], 'Casts')}: {cable.get('name', 'a cable')}"
    statuses = ", ".join(f"{count} {code}" for code, count in info["status_counts"].items())
    columns = []
    for column in (*COLUMNS, *OPTIONAL_COLUMNS):
        if column.name not in info["features"]:
            continue
        entry = stats.get(column.name)
        low, high = (f"{entry[key][0]:.4g}" if entry else "" for key in ("min", "max"))
        columns.append(f"| `{column.name}` | {column.unit} | {column.meaning} | {low} | {high} |")
    template = string.Template(_CARD_FILE.read_text(encoding="utf-8"))
    return template.substitute(
        # JSON strings are YAML strings; a cable may be called anything.
        title_json=json.dumps(title),
        title=title,
        count=info["total_episodes"],
        length=cable.get("length", "?"),
        statuses=statuses,
        columns="\n".join(columns),
        remark=_SIMULATED if info["kind"] == "sim" else _ON_A_RIG,
        fingerprint=info["fingerprint"],
        settings="\n".join(f"| `{name}` | {value} |" for name, value in flat_settings(settings)),
    )


@dataclasses.dataclass(kw_only=True, eq=False)
class DatasetWriter:
    """Writer of one dataset; a context manager that locks the folder against a second writer.

    Attributes:
        path: Folder.
        kind: Kind of the casts: "sim", "real", "tune", "repeat" or "evaluate".
        settings: All plain values that decide the rows.
        row_count: Rows of the finished dataset.
        shard_rows: Rows of each shard but the last.
        was_complete: True if the dataset was finished before and no shard is missing.

    Raises:
        InputError: A setting is not plain or not finite.
    """

    path: pathlib.Path = dataclasses.field(kw_only=False)
    kind: str
    settings: Mapping[str, Any]
    row_count: int
    shard_rows: int
    was_complete: bool = dataclasses.field(default=False, init=False)

    def __post_init__(self):
        self.settings = plain_settings({"schema_version": SCHEMA_VERSION, **self.settings})
        self._claim = Claim(path=self.path, file=str(INFO_PATH), noun="dataset", error=DatasetError)

    @property
    def shard_count(self) -> int:
        """Number of shards of the finished dataset."""
        return -(-self.row_count // self.shard_rows)

    def rows_of(self, shard: int) -> range:
        """Return the indices of the rows of a shard."""
        start = shard * self.shard_rows
        return range(start, min(start + self.shard_rows, self.row_count))

    def __enter__(self) -> "DatasetWriter":
        """Create the folder, or check that it holds the same dataset.

        Raises:
            DatasetError: The folder holds something else, or another process writes to it.
        """
        stored = self._check_stored()
        with contextlib.ExitStack() as hold:
            hold.enter_context(hold_folder(self.path, DatasetError, "work"))
            if stored is None:
                self._claim.write(self._info(complete=False))
            elif stored["complete"]:
                self.was_complete = not self.missing_shards(stored["shard_digests"])
                if not self.was_complete:
                    # Readers must not take a dataset under repair for a whole one.
                    self._claim.write(self._info(complete=False))
            self._hold = hold.pop_all()
        return self

    def __exit__(self, *_) -> None:
        self._hold.close()

    def missing_shards(self, digests: Sequence[str] = ()) -> list[int]:
        """Return the shards that are still to be written.

        Those that exist must have the digests of a dataset that was finished before, if given.

        Raises:
            DatasetError: A shard that exists is damaged, or of another dataset.
        """
        missing = []
        for shard in range(self.shard_count):
            file = self.path / shard_path(shard)
            if file.exists():
                digest = digests[shard] if digests else None
                read_shard(file, self.rows_of(shard), self._settings_fingerprint, digest)
            else:
                missing.append(shard)
        return missing

    def write_shard(self, shard: int, columns: Mapping[str, Any]) -> None:
        """Write one shard, whole or not at all, from values by column name, each of shape [row]."""
        rows = self.rows_of(shard)
        if len(columns["index"]) != len(rows):
            raise DatasetError(f"shard {shard} needs {len(rows)} rows, not {len(columns['index'])}")
        content = shard_bytes(columns_table(columns), self._settings_fingerprint)
        write_bytes(self.path / shard_path(shard), content)

    def finish(self) -> None:
        """Write the statistics and the card, and mark the dataset as complete."""
        import pyarrow as pa

        tables, digests = [], []
        for shard in range(self.shard_count):
            file = self.path / shard_path(shard)
            table, digest = read_shard(file, self.rows_of(shard), self._settings_fingerprint)
            tables.append(table)
            digests.append(digest)
        table = pa.concat_tables(tables, promote_options="default")
        stats = _statistics(table)
        counts = collections.Counter(table["status"].to_pylist())
        info = self._info(complete=True) | {
            "status_counts": dict(sorted(counts.items())),
            "fingerprint": fingerprint([self._settings_fingerprint, *digests]),
            "shard_digests": digests,
        }
        info["features"] |= _features(
            column for column in OPTIONAL_COLUMNS if column.name in table.column_names
        )
        write_json(self.path / "meta/stats.json", stats)
        write_text(self.path / "README.md", dataset_card(info, stats))
        self._claim.write(info)

    @property
    def _settings_fingerprint(self) -> str:
        return fingerprint(self.settings)

    def _info(self, complete: bool) -> dict[str, Any]:
        return {
            "layout": "lerobot-v3",
            "schema_version": SCHEMA_VERSION,
            "cablecast_version": cablecast.__version__,
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
            "fingerprint": "",
            "shard_digests": [],
            "settings": self.settings,
        }

    def _check_stored(self) -> dict[str, Any] | None:
        info = self._claim.read() if self.path.is_dir() else None
        if info is None:
            self._claim.refuse_foreign_files()
            return None
        check_info(info, self.path)
        self._claim.refuse_differences(
            {"kind": info["kind"], "shard_rows": info["shard_rows"], **info["settings"]},
            {"kind": self.kind, "shard_rows": self.shard_rows, **self.settings},
        )
        return info


def _features(columns: Iterable[Column]) -> dict[str, dict[str, Any]]:
    """Return the description of columns; the length of a list may differ from row to row."""
    return {
        column.name: {
            "dtype": column.kind,
            "shape": [None] if column.kind == "list" else [1],
            "unit": column.unit,
        }
        for column in columns
    }


def _statistics(table) -> dict[str, dict[str, Any]]:
    """Return minimum, maximum, mean and standard deviation of the finite values of each column."""
    stats = {}
    for column in (*COLUMNS, *OPTIONAL_COLUMNS):
        if column.kind not in ("int64", "float64") or column.name not in table.column_names:
            continue
        values = table[column.name].to_numpy()
        values = values[np.isfinite(values)]
        if len(values):
            stats[column.name] = {
                **{
                    name: [float(getattr(values, name)())] for name in ("min", "max", "mean", "std")
                },
                "count": [len(values)],
            }
    return stats
