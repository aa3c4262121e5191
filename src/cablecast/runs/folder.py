"""The folder of one run: its settings (config.json) and its results (metrics.json).

config.json is written when the run begins, metrics.json when it is done. A folder without
metrics.json holds an interrupted run, which the same command resumes. A folder with a run of other
settings is refused, and nothing in it is touched.
"""

import contextlib
import dataclasses
import os
import pathlib
from collections.abc import Iterator, Mapping
from typing import Any

from cablecast.errors import DamagedFileError, InputError
from cablecast.runs.claim import Claim, visible_files
from cablecast.runs.facts import run_facts
from cablecast.runs.parts import Parts
from cablecast.runs.settings import fingerprint, plain_settings

CONFIG_FILE = "config.json"
METRICS_FILE = "metrics.json"


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunFolder:
    """A folder that a run may write to.

    Attributes:
        path: Folder.
        config: Content of config.json: command, settings, versions, commit, time.
    """

    path: pathlib.Path
    config: dict[str, Any]

    @classmethod
    def open(
        cls, path: str | os.PathLike[str], command: str, settings: Mapping[str, Any]
    ) -> "RunFolder":
        """Check that a run may be written to a folder; write nothing yet.

        Args:
            path: A new or empty folder, or one of an earlier run of the same settings.
            command: Verb that writes it.
            settings: Plain values that decide the results; a difference in any is refused.

        Raises:
            InputError: The folder holds something else, or a setting is not plain.
        """
        settings = plain_settings(settings)
        claim = _claim(path)
        stored = cls.read_config(path)
        wanted = {"command": command, **settings}
        if stored is None:
            claim.refuse_foreign_files()
        else:
            there = {"command": stored["command"], **stored["settings"]}
            if there == wanted:
                return cls(path=claim.path, config=stored)
            # A run that was interrupted before its first result has nothing worth keeping.
            if visible_files(claim.path) != [CONFIG_FILE]:
                claim.refuse_differences(there, wanted)
        return cls(
            path=claim.path, config={"command": command, "settings": settings, **run_facts()}
        )

    @contextlib.contextmanager
    def begun(self) -> Iterator["RunFolder"]:
        """Lock the folder against other processes, and write config.json if it is missing.

        Raises:
            InputError: Another process has locked the folder.
        """
        claim = _claim(self.path)
        with claim.held():
            if claim.read() != self.config:
                claim.write(self.config)
            yield self

    @staticmethod
    def read_config(path: str | os.PathLike[str]) -> dict[str, Any] | None:
        """Return the content of a folder's config.json; None where there is none.

        Raises:
            DamagedFileError: It is not what was written.
        """
        claim = _claim(path)
        config = claim.read()
        if config is None:
            return None
        if not (
            isinstance(config.get("command"), str) and isinstance(config.get("settings"), dict)
        ):
            raise DamagedFileError(f"{claim.path / CONFIG_FILE} is damaged: give another folder")
        return config

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
        return Parts(self.path / name, owner=fingerprint(self.config["settings"]))


def refuse_other_work(path: str | os.PathLike[str], command: str) -> None:
    """Refuse a folder that holds anything else than a run of a verb, whatever its settings.

    Args:
        path: Folder of the results.
        command: Verb that is to write there.

    Raises:
        InputError: It is a file, or holds other files or a run of another verb.
    """
    config = RunFolder.read_config(path)
    if config is None:
        _claim(path).refuse_foreign_files()
    elif config["command"] != command:
        raise InputError(
            f"{path} holds a run of `cablecast {config['command']}`: give another folder"
        )


def record_run(
    path: str | os.PathLike[str],
    command: str,
    settings: Mapping[str, Any],
    metrics: dict[str, Any],
) -> None:
    """Write config.json and metrics.json beside a dataset, which checks its own settings.

    Args:
        path: Folder of the results.
        command: Verb that wrote them.
        settings: Settings of the results.
        metrics: Figures of the results.
    """
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
