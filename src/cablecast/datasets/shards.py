"""Shards: Parquet files of rows, checked when they are read.

Parquet has checksums for its pages but none for its footer, in which a flipped bit may rename a
column or change its type. Each shard therefore holds a digest of its rows.
"""

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


def shard_bytes(table: Any, settings_fingerprint: str) -> bytes:
    """Return the content of a shard's file.

    Args:
        table: Rows, a pyarrow table.
        settings_fingerprint: Fingerprint of the settings that they come from.
    """
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

    Args:
        file: Parquet file.
        rows: Indices that it must hold.
        settings_fingerprint: Fingerprint of the settings that its rows must come from.
        digest: Digest that its bytes must have; not checked where None.

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
    """Return a checksum over the names, types and values of all columns."""
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


def content_fingerprint(settings_fingerprint: str, digests: Sequence[str]) -> str:
    """Return the fingerprint of a dataset's content: its settings and all its rows.

    Args:
        settings_fingerprint: Fingerprint of the settings.
        digests: Digest of each shard, in order.
    """
    return fingerprint([settings_fingerprint, *digests])
