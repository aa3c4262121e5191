"""Results of a reproduction, read from the run folders of its stages, and parts of its report."""

import base64
import dataclasses
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from cablecast.errors import DamagedFileError, InputError
from cablecast.evaluation.results import TRIAL_COLUMNS
from cablecast.reading import read_csv, read_json
from cablecast.report.tables import Table
from cablecast.setup import SECTIONS, Setup

METHOD_NAMES = {
    "polar": "polar casting",
    "gaussian-process": "Gaussian process, D_sim",
    "real": "forward model, D_real",
    "sim": "forward model, D_sim",
    "fine-tuning": "forward model, D_sim + D_real",
    "correction": "corrected forward model, D_sim + D_real",
}
"""Names of the methods: those of the paper's table II as there, and last our own."""

BEST_METHOD = "correction"
"""Method that is carried out on all cables. The paper's is the fine-tuned forward model."""

_SETUP_STAGES = (*(f"evaluate-{method}" for method in METHOD_NAMES), "select", "repeat", "tune")
"""Stages whose settings hold the set-up; those that decide the figures come first."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Figure:
    """A picture inside the page.

    Attributes:
        uri: Picture as a data URI.
        caption: Sentence below it.
    """

    uri: str
    caption: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Part:
    """A section of the page.

    Attributes:
        title: Heading.
        paragraphs: Text before tables and figures.
        tables: Tables of the section.
        figures: Figures of the section.
    """

    title: str
    paragraphs: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[Figure] = ()


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reproduction:
    """Run folders of a reproduction: one folder per cable, and in it one per stage.

    Attributes:
        folder: Folder of the reproduction.
        cables: Names of the cables, the first being the one that every method is tried on.
    """

    folder: pathlib.Path
    cables: tuple[str, ...]

    def metrics(self, cable: str, stage: str) -> dict[str, Any] | None:
        """Return metrics.json of a stage; None where the stage has not been run."""
        return _read_json(self.folder / cable / stage / "metrics.json")

    def config(self, cable: str, stage: str) -> dict[str, Any] | None:
        """Return config.json of a stage; None where the stage has not been run."""
        return _read_json(self.folder / cable / stage / "config.json")

    def setup(self, cable: str) -> Setup:
        """Return the set-up that a cable was cast with, as its stages recorded it.

        Raises:
            InputError: No stage has been run, or its settings hold no set-up.
        """
        for stage in _SETUP_STAGES:
            if (config := self.config(cable, stage)) is not None:
                settings = config["settings"]
                if missing := [name for name in SECTIONS if name not in settings]:
                    raise InputError(
                        f"{self.folder / cable / stage} does not record its {', '.join(missing)}"
                    )
                return Setup.from_dict({name: settings[name] for name in SECTIONS})
        raise InputError(f"{self.folder} holds no finished stage of {cable} that tells its set-up")

    def evaluations(self, cable: str) -> dict[str, dict[str, Any]]:
        """Return metrics.json of the evaluation of every method that was tried on a cable."""
        found = {method: self.metrics(cable, f"evaluate-{method}") for method in METHOD_NAMES}
        return {method: metrics for method, metrics in found.items() if metrics is not None}

    def best_evaluations(self) -> dict[str, dict[str, Any]]:
        """Return metrics.json of the evaluation of the best method by cable."""
        found = {cable: self.metrics(cable, f"evaluate-{BEST_METHOD}") for cable in self.cables}
        return {cable: metrics for cable, metrics in found.items() if metrics is not None}

    def tunings(self) -> dict[str, dict[str, Any]]:
        """Return metrics.json of the tuning of every cable."""
        found = {cable: self.metrics(cable, "tune") for cable in self.cables}
        return {cable: metrics for cable, metrics in found.items() if metrics is not None}

    def trials(self, cable: str, method: str) -> dict[str, np.ndarray]:
        """Return the columns of trials.csv of an evaluation; an empty cell is NaN."""
        file = self.folder / cable / f"evaluate-{method}" / "trials.csv"
        rows = read_csv(file, TRIAL_COLUMNS)
        columns: dict[str, np.ndarray] = {}
        for name in TRIAL_COLUMNS:
            values = [row[name] for row in rows]
            try:
                columns[name] = np.array([float(value) if value else np.nan for value in values])
            except ValueError:
                columns[name] = np.array(values)
        return columns

    def picture(self, cable: str, stage: str, name: str, caption: str) -> tuple[Figure, ...]:
        """Return a PNG file that a stage left behind as a figure; nothing where it did not."""
        file = self.folder / cable / stage / name
        if not file.is_file():
            return ()
        uri = "data:image/png;base64," + base64.b64encode(file.read_bytes()).decode()
        return (Figure(uri=uri, caption=caption),)


def _read_json(file: pathlib.Path) -> dict[str, Any] | None:
    try:
        return read_json(file)
    except FileNotFoundError:
        return None
    except DamagedFileError as error:
        raise DamagedFileError(f"{error}: delete it and run the same again") from None
