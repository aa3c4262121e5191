"""Claiming a folder for one run: no foreign files, the same settings, one process at a time.

Run folders and datasets both claim their folder here. A description file (config.json or
meta/info.json) is written first and records the settings. Parts of the work follow, each a file
that exists whole or not at all. The same command resumes interrupted work: it keeps the parts that
exist and makes those that are missing.
"""

import contextlib
import dataclasses
import os
import pathlib
import threading
from collections.abc import Iterator, Mapping
from typing import Any

from cablecast.errors import CablecastError, DamagedFileError
from cablecast.files import write_json
from cablecast.reading import read_sealed, seal
from cablecast.runs.settings import settings_differences

_HELD: dict[str, set[str]] = {}
_HELD_LOCK = threading.Lock()


@dataclasses.dataclass(frozen=True, kw_only=True)
class Claim:
    """Folder that one kind of work may fill.

    Attributes:
        path: Folder.
        file: Path of the description within the folder.
        noun: Kind of work, for errors: "run" or "dataset".
        error: Class of the errors that refuse the folder.
    """

    path: pathlib.Path
    file: str
    noun: str
    error: type[CablecastError]

    def read(self) -> dict[str, Any] | None:
        """Return the description; None where there is none.

        Raises:
            DamagedFileError: It is not what was written.
            UnreadableFileError: The system refuses to read it.
        """
        try:
            return read_sealed(self.path / self.file)
        except FileNotFoundError:
            return None
        except DamagedFileError as error:
            raise DamagedFileError(
                f"{error}. Without it the {self.noun} cannot be resumed: restore the file, or give "
                "another folder"
            ) from None

    def write(self, description: Mapping[str, Any]) -> None:
        """Write the description with its checksum."""
        write_json(self.path / self.file, seal(dict(description)))

    def refuse_differences(self, stored: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
        """Refuse a folder whose work has other settings.

        Raises:
            CablecastError: A setting differs; an instance of `error` that names both values.
        """
        if differences := settings_differences(stored, wanted):
            raise self.error(
                f"{self.path} holds a {self.noun} of other settings: {'; '.join(differences)}. "
                "Give the same settings, or another folder"
            )

    def refuse_foreign_files(self) -> None:
        """Refuse a path that is neither new nor an empty folder.

        Raises:
            CablecastError: A file is in the way; an instance of `error` that names it.
        """
        if self.path.exists() and not self.path.is_dir():
            raise self.error(f"{self.path} is a file: a {self.noun} needs a folder")
        if names := visible_files(self.path):
            raise self.error(
                f"{self.path} holds {names[0]} but no {self.noun} of cablecast: give a new or "
                "empty folder"
            )

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Lock the folder against other processes, and delete the leftovers of killed writes.

        Raises:
            CablecastError: Another process holds the lock; an instance of `error`.
        """
        with hold_folder(self.path, self.error, "work"):
            yield


def visible_files(path: pathlib.Path) -> list[str]:
    """Return the files in a folder and below it, without hidden ones, relative and sorted."""
    if not path.is_dir():
        return []
    files = (file.relative_to(path) for file in path.rglob("*") if not file.is_dir())
    return sorted(str(file) for file in files if not file.name.startswith("."))


@contextlib.contextmanager
def hold_folder(
    path: pathlib.Path, error: type[CablecastError], role: str = "rig"
) -> Iterator[None]:
    """Lock a folder against other processes, and delete the leftovers of killed writes.

    The system releases the lock when the process dies, however it dies. Windows has no such lock;
    one process at a time is assumed there.

    Args:
        path: Folder; it is created if it does not exist.
        error: Class of the error.
        role: Purpose of the lock. A process may lock a folder once for each purpose: it does so
            before it connects a rig, and again when work in the folder begins.

    Raises:
        CablecastError: The folder is locked already; an instance of `error`.
    """
    new = [folder for folder in (path, *path.parents) if not folder.exists()]
    path.mkdir(parents=True, exist_ok=True)
    key = str(path.resolve())
    with _HELD_LOCK:
        roles = _HELD.get(key, set())
        if role in roles:
            raise error(f"another process is writing to {path}: this one, in another thread")
        handle = None if roles else _lock(path, error)
        if not roles:
            for leftover in path.rglob(".*.tmp"):
                leftover.unlink(missing_ok=True)
        _HELD[key] = roles | {role}
    try:
        yield
    finally:
        with _HELD_LOCK:
            _HELD[key] = _HELD[key] - {role}
            if not _HELD[key]:
                del _HELD[key]
        if handle is not None:
            os.close(handle)
        # Refused work leaves no empty folders behind.
        with contextlib.suppress(OSError):
            for folder in new:
                folder.rmdir()


def _lock(path: pathlib.Path, error: type[CablecastError]) -> int | None:
    try:
        import fcntl
    except ImportError:
        return None
    handle = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        raise error(f"another process is writing to {path}") from None
    return handle
