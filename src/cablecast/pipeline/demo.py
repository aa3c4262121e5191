"""demo: the whole way from a cable to a report, in minutes."""

import os
import pathlib

from cablecast.evaluation.evaluate import Evaluation
from cablecast.pipeline.collect import collect
from cablecast.pipeline.evaluate import evaluate
from cablecast.pipeline.places import require
from cablecast.pipeline.simulate import simulate
from cablecast.pipeline.train import train
from cablecast.pipeline.tune import tune
from cablecast.pipeline.tuned import Tuned
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.places import (
    CASTS_FOLDERS,
    DATASET_FOLDER,
    MODEL_FOLDER,
    TUNE_FOLDER,
)
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.tuning.tune import TuneConfig

EVALUATION_FOLDER = "evaluate"

# A search that is short beside that of `cablecast tune`, and far better than none.
COARSE_GENERATIONS = 40
FINE_GENERATIONS = 10


def demo(
    rig: CheckedRig,
    out: str | os.PathLike[str],
    *,
    tuned: Tuned | None = None,
    tune_count: int = 40,
    count: int = 16_000,
    epochs: int = 60,
    candidate_count: int = 50_000,
    seed: int = 0,
    device: str = "cpu",
    progress: ProgressCallback | None = None,
) -> Evaluation:
    """Cast, tune, simulate, train and evaluate with one cable, and write a report.

    Args:
        rig: Rig that `make_rig` returned; gives the set-up.
        out: Folder of all results; a demo that was stopped goes on there.
        tuned: Result of `tune`, instead of casts and a search.
        tune_count: Number of casts to tune with.
        count: Number of simulated casts.
        epochs: Largest number of passes over them.
        candidate_count: Number of motions to choose from when planning.
        seed: Seed of everything that is drawn by chance.
        device: "cpu" or "cuda".
        progress: Told how far each of the five steps is.
    """
    require("the demo", "torch", "safetensors", "matplotlib", "jinja2")
    report, folder, setup = progress or ignore, pathlib.Path(out), rig.setup
    if tuned is None:
        report(Progress(task="1/5 cast to tune the simulator"))
        casts = collect(
            rig, count=tune_count, seed=seed, out=folder / CASTS_FOLDERS["tune"], progress=progress
        )
        report(Progress(task="2/5 tune"))
        config = TuneConfig(
            coarse_generations=COARSE_GENERATIONS, fine_generations=FINE_GENERATIONS, seed=seed
        )
        tuned = tune(
            casts, config=config, device=device, out=folder / TUNE_FOLDER, progress=progress
        )
    report(Progress(task="3/5 simulate"))
    simulated = simulate(
        setup,
        tuned,
        count=count,
        seed=seed,
        device=device,
        out=folder / DATASET_FOLDER,
        progress=progress,
    )
    report(Progress(task="4/5 train"))
    policy = train(
        simulated,
        epochs=epochs,
        candidate_count=candidate_count,
        seed=seed,
        device=device,
        out=folder / MODEL_FOLDER,
        progress=progress,
    )
    report(Progress(task="5/5 evaluate"))
    return evaluate(policy, rig, device=device, out=folder / EVALUATION_FOLDER, progress=progress)
