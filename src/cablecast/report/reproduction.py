"""What the stages of a reproduction left in their run folders, and what its report is made of."""

import base64
import csv
import dataclasses
import json
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from cablecast.errors import InputError
from cablecast.report.tables import Table

METHOD_NAMES = {
    "polar": "polar casting",
    "gaussian-process": "Gaussian process, D_sim",
    "real": "forward model, D_real",
    "sim": "forward model, D_sim",
    "fine-tuning": "forward model, D_sim + D_real",
    "correction": "corrected forward model, D_sim + D_real",
}
"""What each method is called: those of the paper's table II as there, and last our own."""

BEST_METHOD = "correction"
"""The method that is carried out on all cables. The paper's is the fine-tuned forward model."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Figure:
    """A picture inside the page.

    Attributes:
        uri: The picture as a data URI.
        caption: What it shows.
    """

    uri: str
    caption: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Part:
    """A section of the page.

    Attributes:
        title: Its heading.
        paragraphs: Text before tables and figures.
        tables: Its tables.
        figures: Its figures.
    """

    title: str
    paragraphs: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[Figure] = ()


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reproduction:
    """The run folders of a reproduction: one folder per cable, and in it one per stage.

    Attributes:
        folder: The whole.
        cables: Names of the cables, the first being the one that every method is tried on.
    """

    folder: pathlib.Path
    cables: tuple[str, ...]

    def metrics(self, cable: str, stage: str) -> dict[str, Any] | None:
        """metrics.json of a stage; None where the stage has not been run."""
        return _read_json(self.folder / cable / stage / "metrics.json")

    def config(self, cable: str, stage: str) -> dict[str, Any] | None:
        """config.json of a stage; None where the stage has not been run."""
        return _read_json(self.folder / cable / stage / "config.json")

    def evaluations(self, cable: str) -> dict[str, dict[str, Any]]:
        """metrics.json of the evaluation of every method that was tried on a cable."""
        found = {method: self.metrics(cable, f"evaluate-{method}") for method in METHOD_NAMES}
        return {method: metrics for method, metrics in found.items() if metrics is not None}

    def best_evaluations(self) -> dict[str, dict[str, Any]]:
        """metrics.json of the evaluation of the best method by cable."""
        found = {cable: self.metrics(cable, f"evaluate-{BEST_METHOD}") for cable in self.cables}
        return {cable: metrics for cable, metrics in found.items() if metrics is not None}

    def tunings(self) -> dict[str, dict[str, Any]]:
        """metrics.json of the tuning of every cable."""
        found = {cable: self.metrics(cable, "tune") for cable in self.cables}
        return {cable: metrics for cable, metrics in found.items() if metrics is not None}

    def trials(self, cable: str, method: str) -> dict[str, np.ndarray]:
        """Columns of trials.csv of an evaluation; an empty cell is NaN."""
        text = (self.folder / cable / f"evaluate-{method}" / "trials.csv").read_text()
        rows = list(csv.DictReader(text.splitlines()))
        columns: dict[str, np.ndarray] = {}
        for name in rows[0] if rows else ():
            values = [row[name] for row in rows]
            try:
                columns[name] = np.array([float(value) if value else np.nan for value in values])
            except ValueError:
                columns[name] = np.array(values)
        return columns

    def picture(self, cable: str, stage: str, name: str, caption: str) -> tuple[Figure, ...]:
        """A PNG file that a stage left behind; nothing where it did not."""
        file = self.folder / cable / stage / name
        if not file.is_file():
            return ()
        uri = "data:image/png;base64," + base64.b64encode(file.read_bytes()).decode()
        return (Figure(uri=uri, caption=caption),)


def _read_json(file: pathlib.Path) -> dict[str, Any] | None:
    try:
        return json.loads(file.read_text())
    except FileNotFoundError:
        return None
    except ValueError as error:
        raise InputError(f"{file} is damaged ({error}): delete it and run the same again") from None
