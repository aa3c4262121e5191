"""Folder of one run: its lock, settings (config.json), finished parts and results (metrics.json).

Run folders and datasets both claim their folder here. The description of the work (config.json or
meta/info.json) is written first and records the settings. Parts of the work follow, each a file
that exists whole or not at all. The same command resumes interrupted work: it keeps the parts that
exist and makes those that are missing. A folder with work of other settings is refused, and nothing
in it is touched.
"""

import contextlib
import dataclasses
import datetime
import hashlib
import json
import os
import pathlib
import subprocess
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from cablecast.errors import CablecastError, DamagedFileError, InputError
from cablecast.files import (
    is_leftover,
    library_versions,
    processor_name,
    read_sealed,
    seal,
    write_json,
)

DIFFERENCES_SHOWN = 6
"""Differences of settings that an error names; there may be dozens."""


def plain_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings as JSON stores them: tuples become lists."""
    try:
        return json.loads(json.dumps(dict(settings), allow_nan=False, default=_plain))
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError(f"settings must hold plain, finite values: {error}") from None


def _plain(value: Any) -> Any:
    """Return a number of NumPy's as one of Python's."""
    if type(value).__module__ == "numpy" and getattr(value, "ndim", 1) == 0:
        return value.item()
    raise TypeError(f"{value!r} is a {type(value).__name__}")


def settings_differences(
    stored: Mapping[str, Any], wanted: Mapping[str, Any], prefix: str = ""
) -> list[str]:
    """Return a phrase for each of the first settings in which two runs differ, with both values.

    The prefix is the path of nested settings, ending in a dot. A last phrase counts the others.

    >>> settings_differences({"arm": {"model": "ur5"}}, {"arm": {"model": "ur5e"}})
    ["arm.model is 'ur5' there and 'ur5e' here"]
    """
    phrases = []
    for key in (*stored, *(key for key in wanted if key not in stored)):
        there, here = stored.get(key, "(absent)"), wanted.get(key, "(absent)")
        if isinstance(there, Mapping) and isinstance(here, Mapping):
            phrases += settings_differences(there, here, f"{prefix}{key}.")
        elif there != here:
            phrases.append(f"{prefix}{key} is {_short(there)} there and {_short(here)} here")
    if not prefix and len(phrases) > DIFFERENCES_SHOWN + 1:
        others = len(phrases) - DIFFERENCES_SHOWN
        return [*phrases[:DIFFERENCES_SHOWN], f"and {others} others"]
    return phrases


def flat_settings(settings: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Return the leaves of nested settings with dotted names."""
    rows = []
    for key, value in settings.items():
        if isinstance(value, Mapping):
            rows += flat_settings(value, f"{prefix}{key}.")
        else:
            rows.append((f"{prefix}{key}", value))
    return rows


def fingerprint(values: Any, *more: bytes) -> str:
    """Return the start of the SHA-256 of plain values as canonical JSON, and of further bytes."""
    digest = hashlib.sha256(json.dumps(values, sort_keys=True, ensure_ascii=False).encode())
    for content in more:
        digest.update(content)
    return digest.hexdigest()[:16]


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 120 else f"{text[:117]}..."


def run_facts() -> dict[str, Any]:
    """Return versions, commit, processor, its load [processes], and the time now."""
    return {
        "versions": library_versions(),
        "commit": source_commit(),
        "processor": processor_name(),
        "cpu_count": os.cpu_count(),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "started": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }


def source_commit() -> str | None:
    """Return the commit of the source tree that runs, with "+changes" if it differs.

    It is None without git, or where the package is installed.
    """
    package = pathlib.Path(__file__).resolve().parent.parent
    # Without the index lock: a status for the record must not disturb a commit under way.
    git = ["git", "--no-optional-locks", "-C", str(package)]

    def ask(*arguments: str) -> str:
        answer = subprocess.run(
            [*git, *arguments], capture_output=True, text=True, timeout=5, check=True
        )
        return answer.stdout.strip()

    try:
        # An installed package may lie inside another repository: ask whether git tracks it.
        ask("ls-files", "--error-unmatch", "errors.py")
        commit = ask("rev-parse", "HEAD")
        return commit + "+changes" * bool(ask("status", "--porcelain", "-uno", "."))
    except (OSError, subprocess.SubprocessError):
        return None


# Folders that this process has locked, and for which purposes.
_HELD: dict[str, set[str]] = {}
_HELD_LOCK = threading.Lock()


@contextlib.contextmanager
def hold_folder(
    path: pathlib.Path, error: type[CablecastError], role: str = "rig"
) -> Iterator[None]:
    """Lock a folder against other processes, and delete the leftovers of killed writes.

    The folder is created if it does not exist. The lock lies on the folder itself and leaves no
    file behind; the system releases it when the process dies, however it dies. Windows has no such
    lock; one process at a time is assumed there. A process may lock a folder once for each role: it
    does so before it connects a rig, and again when it starts to write.

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
        # A folder of this name is that of an export, which clears its own.
        for file in () if roles else path.rglob(".*.tmp"):
            if not file.is_dir() and is_leftover(file):
                file.unlink(missing_ok=True)
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Claim:
    """Folder that one kind of work ("run" or "dataset") may fill, and the file that describes it.

    A folder of other work is refused with the class of errors.
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
        """Refuse a folder whose work has other settings, with both values of each."""
        if differences := settings_differences(stored, wanted):
            raise self.error(
                f"{self.path} holds a {self.noun} of other settings: {'; '.join(differences)}. "
                "Give the same settings, or another folder"
            )

    def refuse_foreign_files(self) -> None:
        """Refuse a path that is neither new nor an empty folder, with the file in the way."""
        if self.path.exists() and not self.path.is_dir():
            raise self.error(f"{self.path} is a file: a {self.noun} needs a folder")
        if names := _visible_files(self.path):
            raise self.error(
                f"{self.path} holds {names[0]} but no {self.noun} of cablecast: give a new or "
                "empty folder"
            )


def _visible_files(path: pathlib.Path) -> list[str]:
    """Return the files in a folder and below it, without hidden ones, relative and sorted."""
    files = (file.relative_to(path) for file in path.rglob("*") if not file.is_dir())
    return sorted(str(file) for file in files if not file.name.startswith("."))


_OWNER_KEY = "run"


@dataclasses.dataclass(frozen=True)
class Parts:
    """Folder of finished parts, JSON files with a checksum.

    Attributes:
        folder: Folder; it is created when the first part is stored.
        owner: Fingerprint of the run that the parts belong to; empty for parts of no run.
        remedy: What to do about a damaged part, for errors.
    """

    folder: pathlib.Path
    owner: str = ""
    remedy: str = "Delete it, and the same command makes it again"

    def get(self, name: str) -> dict[str, Any] | None:
        """Return a part; None where it does not exist yet.

        Raises:
            DamagedFileError: It is not what was written, or belongs to another run; says how to
                resume.
            UnreadableFileError: The system refuses to read it.
        """
        file = self.file(name)
        try:
            values = read_sealed(file)
        except FileNotFoundError:
            return None
        except DamagedFileError as error:
            raise DamagedFileError(f"{error}. {self.remedy}") from None
        if values.pop(_OWNER_KEY, self.owner) != self.owner:
            raise DamagedFileError(f"{file} belongs to a run of other settings. {self.remedy}")
        return values

    def put(self, name: str, values: dict[str, Any]) -> None:
        """Store a part; it exists whole or not at all."""
        owner = {_OWNER_KEY: self.owner} if self.owner else {}
        write_json(self.file(name), seal({**values, **owner}))

    def get_or_make(self, name: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Return a part, made and stored first where it is missing."""
        values = self.get(name)
        if values is None:
            self.put(name, make())
            values = self.get(name)
        return values or {}

    def file(self, name: str) -> pathlib.Path:
        """Return the file of a part."""
        return self.folder / f"{name}.json"


CONFIG_FILE = "config.json"
METRICS_FILE = "metrics.json"


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunFolder:
    """A folder that a run may write to; without metrics.json, the run is not done.

    Attributes:
        path: Folder.
        config: Content of config.json: command, settings, versions, commit, time.
    """

    path: pathlib.Path
    config: dict[str, Any]

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> "RunFolder | None":
        """Return the run in a folder, finished or not; None where there is none."""
        claim = _claim(path)
        config = claim.read()
        if config is None:
            return None
        if not (
            isinstance(config.get("command"), str) and isinstance(config.get("settings"), dict)
        ):
            raise DamagedFileError(f"{claim.path / CONFIG_FILE} is damaged: give another folder")
        return cls(path=claim.path, config=config)

    @classmethod
    def open(
        cls, path: str | os.PathLike[str], command: str, settings: Mapping[str, Any]
    ) -> "RunFolder":
        """Check that a run may be written to a folder; write nothing yet.

        The folder is new or empty, or holds an earlier run of equal command and settings: all plain
        values that decide the results.

        Raises:
            InputError: The folder holds something else, or a setting is not plain.
        """
        settings = plain_settings(settings)
        claim = _claim(path)
        stored = cls.read(path)
        wanted = {"command": command, **settings}
        if stored is None:
            claim.refuse_foreign_files()
        else:
            there = {"command": stored.command, **stored.settings}
            if there == wanted:
                return stored
            # A run that was interrupted before its first result has nothing worth keeping.
            if _visible_files(claim.path) != [CONFIG_FILE]:
                claim.refuse_differences(there, wanted)
        return cls(
            path=claim.path, config={"command": command, "settings": settings, **run_facts()}
        )

    @property
    def command(self) -> str:
        """Verb that wrote the run."""
        return self.config["command"]

    @property
    def settings(self) -> dict[str, Any]:
        """Plain values that decide its results."""
        return self.config["settings"]

    @contextlib.contextmanager
    def locked(self, *, replaces: bool = False) -> Iterator["RunFolder"]:
        """Lock the folder against other processes, and write config.json if it is missing.

        Args:
            replaces: Whether a run of other settings is replaced.

        Raises:
            InputError: Another process has locked the folder, or has begun a run of other settings
                in it meanwhile.
        """
        claim = _claim(self.path)
        with hold_folder(self.path, InputError, "work"):
            # What is replaced need not be whole.
            stored = None if replaces else claim.read()
            if stored != self.config:
                if stored is not None:
                    self.open(self.path, self.command, self.settings)
                claim.write(self.config)
            yield self

    @property
    def metrics(self) -> dict[str, Any] | None:
        """Content of metrics.json; None while the run is not done.

        Raises:
            DamagedFileError: It is not what was written.
        """
        return Parts(self.path).get("metrics")

    def finish(self, metrics: dict[str, Any]) -> None:
        """Write metrics.json, which marks the run as done."""
        Parts(self.path).put("metrics", metrics)

    def parts(self, name: str) -> Parts:
        """Return the parts of this run in a subfolder."""
        return Parts(self.path / name, owner=fingerprint(self.settings))


def refuse_other_work(path: str | os.PathLike[str], command: str) -> None:
    """Refuse a folder that holds anything else than a run of a verb, whatever its settings."""
    run = RunFolder.read(path)
    if run is None:
        _claim(path).refuse_foreign_files()
    elif run.command != command:
        raise InputError(f"{path} holds a run of `cablecast {run.command}`: give another folder")


def record_run(
    path: str | os.PathLike[str],
    command: str,
    settings: Mapping[str, Any],
    status_counts: Mapping[str, int],
) -> None:
    """Write config.json and metrics.json next to a dataset, which checks its own settings."""
    metrics = {"cast_count": sum(status_counts.values()), "status_counts": dict(status_counts)}
    run = RunFolder(
        path=pathlib.Path(path),
        config={"command": command, "settings": plain_settings(settings), **run_facts()},
    )
    if not (run.path / CONFIG_FILE).exists():
        _claim(path).write(run.config)
    try:
        stored = run.metrics
    except DamagedFileError:
        stored = None
    # A collection that was repaired or resumed has other figures than before.
    if stored != metrics:
        run.finish(metrics)


def _claim(path: str | os.PathLike[str]) -> Claim:
    return Claim(path=pathlib.Path(path), file=CONFIG_FILE, noun="run", error=InputError)
