"""Shards: Parquet files of rows, checked when they are read."""

import hashlib
import io
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from cablecast.datasets.schema import COLUMNS
from cablecast.errors import DatasetError
from cablecast.reading import read_bytes
from cablecast.runs.settings import fingerprint

SHARD_SIZE_MAX = 2**32
"""Largest shard that is read [byte]."""


def read_shard(file: pathlib.Path, rows: range, settings_fingerprint: str) -> tuple[Any, bytes]:
    """Return the table of one shard, checked, and the digest of its bytes.

    Args:
        file: Parquet file.
        rows: Indices that it must hold.
        settings_fingerprint: Fingerprint of the settings that its rows must come from.

    Raises:
        DatasetError: It is missing, truncated, corrupt, of another dataset, or holds other rows.
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
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DatasetError(
            f"shard {file} is truncated or damaged ({reason}): delete it and run the command that "
            "made the dataset again, it makes the shard again"
        ) from None
    if missing := [column.name for column in COLUMNS if column.name not in table.column_names]:
        raise DatasetError(f"shard {file} lacks the columns {missing}")
    if not np.array_equal(table["index"].to_numpy(), np.arange(rows.start, rows.stop)):
        raise DatasetError(f"shard {file} must hold the rows {rows.start} to {rows.stop - 1}")
    if metadata.get(b"settings", b"").decode(errors="replace") != settings_fingerprint:
        raise DatasetError(
            f"shard {file} belongs to a dataset of other settings: delete it and run the command "
            "that made the dataset again"
        )
    return table, hashlib.sha256(content).digest()


def content_fingerprint(settings_fingerprint: str, digests: Sequence[bytes]) -> str:
    """Return a short name for the content of a dataset: its settings and all its rows.

    Args:
        settings_fingerprint: Fingerprint of the settings.
        digests: Digest of each shard, in order.
    """
    return fingerprint(settings_fingerprint, *digests)
