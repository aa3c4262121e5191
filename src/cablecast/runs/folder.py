"""The folder of one run: what was asked for (config.json), and what came out (metrics.json).

config.json is written when the run begins and metrics.json when it is done, so a folder without
metrics.json holds a run that was interrupted and may be taken up again. A folder that holds a run
of other settings is refused, and nothing in it is touched.
"""

import dataclasses
import datetime
import json
import os
import pathlib
from typing import Any

from cablecast.errors import InputError
from cablecast.files import write_json

CONFIG_FILE = "config.json"
METRICS_FILE = "metrics.json"

_DISTRIBUTIONS = (
    "cablecast",
    "numpy",
    "scipy",
    "warp-lang",
    "mujoco",
    "ruckig",
    "torch",
    "pyarrow",
    "matplotlib",
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunFolder:
    """A folder that a run may write to.

    Attributes:
        path: Where it is.
        config: What config.json holds.
    """

    path: pathlib.Path
    config: dict[str, Any]

    @classmethod
    def open(cls, path: pathlib.Path, command: str, settings: dict[str, Any]) -> "RunFolder":
        """Look whether a run may be written to a folder; nothing is written yet.

        Args:
            path: A new or empty folder, or one of an earlier run of the same settings.
            command: The verb that writes it.
            settings: Plain values that decide the results; a difference in any is refused.

        Raises:
            InputError: The folder holds something else.
        """
        # A round through JSON makes tuples lists, so that stored and wanted settings compare.
        settings = json.loads(json.dumps(settings, allow_nan=False))
        stored = cls.read_config(path)
        if stored is None:
            refuse_foreign_folder(path)
        else:
            from cablecast.datasets.schema import settings_differences

            there = {"command": stored["command"]} | stored["settings"]
            differences = settings_differences(there, {"command": command} | settings)
            if not differences:
                return cls(path=path, config=stored)
            # A run that was stopped before its first result leaves nothing worth keeping.
            if _visible_names(path) != [CONFIG_FILE]:
                raise InputError(
                    f"{path} holds a run of other settings: {'; '.join(differences)}. "
                    "Give the same settings, or another folder with --out"
                )
        return cls(path=path, config={"command": command, "settings": settings} | run_facts())

    def begin(self) -> None:
        """Write config.json, unless it is there already."""
        if self.read_config(self.path) != self.config:
            write_json(self.path / CONFIG_FILE, self.config)

    @staticmethod
    def read_config(path: pathlib.Path) -> dict[str, Any] | None:
        """What the config.json of a folder holds, None where there is none.

        Raises:
            InputError: It is damaged.
        """
        file = path / CONFIG_FILE
        try:
            config = json.loads(file.read_text())
            return config if config["command"] and dict(config["settings"]) is not None else None
        except (FileNotFoundError, NotADirectoryError):
            return None
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise InputError(f"{file} is damaged ({error!r}): give another folder") from None

    @property
    def metrics(self) -> dict[str, Any] | None:
        """What metrics.json holds; None while the run is not done.

        Raises:
            InputError: It is damaged.
        """
        file = self.path / METRICS_FILE
        try:
            return json.loads(file.read_text())
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            raise InputError(f"{file} is damaged ({error!r}): give another folder") from None

    def finish(self, metrics: dict[str, Any]) -> None:
        """Write metrics.json, which marks the run as done."""
        write_json(self.path / METRICS_FILE, metrics)


def refuse_foreign_folder(path: pathlib.Path) -> None:
    """Refuse a path that is neither new nor an empty folder.

    Raises:
        InputError: It is a file, or a folder with files of someone else.
    """
    if path.exists() and not path.is_dir():
        raise InputError(f"{path} is a file: --out needs a folder")
    if names := _visible_names(path):
        raise InputError(
            f"{path} holds {names[0]} but no run of cablecast: give a new or empty folder"
        )


def _visible_names(path: pathlib.Path) -> list[str]:
    """Names in a folder, without hidden ones such as the leftovers of a killed write."""
    return sorted(name for name in os.listdir(path) if name[0] != ".") if path.is_dir() else []


def run_facts() -> dict[str, Any]:
    """Versions, commit, machine and time, for the record; they are not compared."""
    return {
        "versions": library_versions(),
        "commit": source_commit(),
        "cpu_count": os.cpu_count(),
        "started": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }


def library_versions() -> dict[str, str]:
    """Versions of Python and of the libraries that decide the results, without importing them."""
    import importlib.metadata
    import platform

    versions = {"python": platform.python_version(), "platform": platform.platform()}
    for name in _DISTRIBUTIONS:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions


def source_commit() -> str | None:
    """Git commit of the source tree that runs, with "+changes" if it differs; None without git."""
    import subprocess

    package = pathlib.Path(__file__).resolve().parent.parent
    # Without the index lock: a status for the record must not disturb a commit under way.
    git = ["git", "--no-optional-locks", "-C", str(package)]
    try:
        # An installed package may lie in somebody else's repository: ask whether git tracks it.
        for arguments in (["ls-files", "--error-unmatch", "errors.py"], ["rev-parse", "HEAD"]):
            answer = subprocess.run(
                [*git, *arguments], capture_output=True, text=True, timeout=5, check=True
            )
        status = subprocess.run(
            [*git, "status", "--porcelain", "--untracked-files=no", "."],
            capture_output=True,
            text=True,
            timeout=5,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip() + ("+changes" if status.stdout.strip() else "")


def record_run(
    path: pathlib.Path, command: str, settings: dict[str, Any], metrics: dict[str, Any]
) -> None:
    """Leave config.json and metrics.json beside results that guard their own settings.

    Args:
        path: Folder of the results.
        command: The verb that wrote them.
        settings: What they were made with.
        metrics: What came out.
    """
    if not (path / CONFIG_FILE).exists():
        config = {"command": command, "settings": settings} | run_facts()
        write_json(path / CONFIG_FILE, config)
    if not (path / METRICS_FILE).exists():
        write_json(path / METRICS_FILE, metrics)
