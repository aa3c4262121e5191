"""meta/info.json: the description of a dataset, and the layout of its files."""

import pathlib
from typing import Any

from cablecast.checks import COUNT_MAX
from cablecast.datasets.schema import SCHEMA_VERSION
from cablecast.errors import DamagedFileError, DatasetError, InputError
from cablecast.reading import read_sealed

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
    file = pathlib.Path(path) / INFO_PATH
    try:
        info = read_sealed(file)
    except FileNotFoundError:
        raise DatasetError(f"{path} is not a dataset: {file} is missing") from None
    except DamagedFileError as error:
        version = _version_without_checksum(file)
        if version is not None and version != SCHEMA_VERSION:
            raise DatasetError(_other_version(path, version)) from None
        raise DatasetError(
            f"{error}. It describes the dataset: restore it, or make the dataset anew"
        ) from None
    check_info(info, path)
    return info


def check_info(info: dict[str, Any], path: pathlib.Path) -> None:
    """Refuse a description that this version cannot read.

    Raises:
        DatasetError: It is of another schema version, or its numbers contradict each other.
    """
    if info.get("schema_version") != SCHEMA_VERSION:
        raise DatasetError(_other_version(path, info.get("schema_version")))
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


def _version_without_checksum(file: pathlib.Path) -> Any:
    """Return the schema version of a description without a checksum, as older versions wrote it."""
    from cablecast.reading import read_json

    try:
        return read_json(file).get("schema_version")
    except (InputError, OSError):
        return None


def _other_version(path: pathlib.Path, version: Any) -> str:
    return (
        f"{path} has schema version {str(version)[:20]}: this cablecast reads {SCHEMA_VERSION}, "
        "make the dataset anew"
    )
