"""verify: the way to the headline on small data, beside the headline itself."""

import dataclasses
import importlib.resources
import json
import os
import pathlib
from collections.abc import Mapping
from typing import Any

from cablecast.errors import InputError, check_count, check_seed
from cablecast.pipeline.collect import collect
from cablecast.pipeline.evaluate import evaluate
from cablecast.pipeline.places import folder_or_temporary, require
from cablecast.pipeline.simulate import simulate
from cablecast.pipeline.train import train
from cablecast.pipeline.tune import tune
from cablecast.rigs.make import make_rig
from cablecast.runs.places import CASTS_FOLDERS, DATASET_FOLDER, MODEL_FOLDER, TUNE_FOLDER
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.setup import Setup
from cablecast.tuning.tune import TuneConfig

HEADLINE_FILE = "data/headline.json"
EVALUATION_FOLDER = "evaluate"
MEDIAN = "median error"

_FIGURES = {
    MEDIAN: "median_pct",
    "first quartile": "first_quartile_pct",
    "third quartile": "third_quartile_pct",
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class VerifyBudget:
    """Amount of everything: about a hundredth of the headline's.

    Attributes:
        cable: Cable that is cast.
        tune_count: Casts to tune with.
        coarse_generations: Generations of the coarse search.
        fine_generations: Generations of the fine search.
        count: Simulated casts.
        epochs: Largest number of passes over them.
        real_count: Casts that correct the model.
        candidate_count: Motions to choose from.
        seed: Seed of everything that is drawn by chance.
    """

    cable: str = "cable_1"
    tune_count: int = 16
    coarse_generations: int = 10
    fine_generations: int = 2
    count: int = 4000
    epochs: int = 30
    real_count: int = 32
    candidate_count: int = 20_000
    seed: int = 0

    def __post_init__(self):
        for field in dataclasses.fields(self):
            if field.type in (int, "int") and field.name != "seed":
                check_count(field.name, getattr(self, field.name))
        check_seed(self.seed)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Verification:
    """Figures of a small run beside those of the headline.

    Attributes:
        measured: Figures by name [% of cable length].
        headline: The headline's, by the same names.
    """

    measured: dict[str, float]
    headline: dict[str, float]

    @property
    def rows(self) -> list[tuple[str, float, float]]:
        """Name, headline and measured value of each figure [% of cable length]."""
        return [(name, value, self.measured[name]) for name, value in self.headline.items()]

    @property
    def difference_pct(self) -> float:
        """Difference of the median error from the headline's [% of cable length]."""
        return self.measured[MEDIAN] - self.headline[MEDIAN]


def verify(
    *,
    budget: VerifyBudget | None = None,
    rig: str = "virtual",
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = ignore,
) -> Verification:
    """Cast, tune, simulate, train, correct and evaluate on small data, and compare.

    The way is that of the headline: a forward model, corrected by real casts, on the virtual rig.

    Args:
        budget: Amount of everything; about a hundredth of the headline's where None.
        rig: Rig that makes the casts; the headline is that of "virtual".
        out: Folder that keeps the results and lets a stopped run go on; none where None.
        progress: Told how far each step is.

    Raises:
        InputError: The folder holds something else, or the headline is that of another cable.
        MissingExtraError: torch, mujoco or a library of the report is missing.
    """
    require("verifying", "torch", "safetensors", "mujoco", "matplotlib", "jinja2")
    budget, headline = budget or VerifyBudget(), read_headline()
    if headline["cable"] != budget.cable:
        raise InputError(f"the headline is that of {headline['cable']}, not of {budget.cable}")
    measured = measure(budget, rig=rig, out=out, progress=progress)
    return Verification(measured=measured, headline=dict(headline["figures"]))


def measure(
    budget: VerifyBudget,
    *,
    rig: str = "virtual",
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = ignore,
) -> dict[str, float]:
    """Return the figures of one small run [% of cable length].

    Args:
        budget: Amount of everything.
        rig: Rig that makes the casts; the figures of another than "virtual" are no headline.
        out: Folder of the results; none where None.
        progress: Told how far each step is.
    """
    setup, seed = Setup(cable=budget.cable), budget.seed
    with (
        folder_or_temporary(out) as folder,
        make_rig(rig, setup, seed) as executor,
    ):
        folder = pathlib.Path(folder)

        def cast(purpose: Any, count: int) -> Any:
            place = folder / CASTS_FOLDERS[purpose]
            return collect(
                executor, purpose=purpose, count=count, seed=seed, out=place, progress=progress
            )

        casts = cast("tune", budget.tune_count)
        config = TuneConfig(
            coarse_generations=budget.coarse_generations,
            fine_generations=budget.fine_generations,
            seed=seed,
        )
        tuned = tune(casts, config=config, out=folder / TUNE_FOLDER, progress=progress)
        simulated = simulate(
            setup,
            tuned,
            count=budget.count,
            seed=seed,
            out=folder / DATASET_FOLDER,
            progress=progress,
        )
        real = cast("real", budget.real_count)
        policy = train(
            simulated,
            real,
            epochs=budget.epochs,
            candidate_count=budget.candidate_count,
            seed=seed,
            out=folder / MODEL_FOLDER,
            progress=progress,
        )
        evaluation = evaluate(policy, executor, out=folder / EVALUATION_FOLDER, progress=progress)
        progress(Progress(task="Comparing"))
    return headline_figures(evaluation.summary.to_dict())


def headline_figures(errors: Mapping[str, Any]) -> dict[str, float]:
    """Return the figures that are compared from a summary of errors as metrics.json holds it."""
    return {name: errors[key] for name, key in _FIGURES.items()}


def read_headline() -> dict[str, Any]:
    """Return the cable and the figures of the headline in the README."""
    file = importlib.resources.files("cablecast").joinpath(HEADLINE_FILE)
    return json.loads(file.read_text(encoding="utf-8"))
