"""demo: from a cable never seen to casts at 32 targets, in minutes."""

import dataclasses
import os
import pathlib

from cablecast.evaluation.evaluate import Evaluation
from cablecast.pipeline.aim import (
    CALIBRATION_COUNT,
    CALIBRATION_FOLDER,
    EPOCHS,
    SESSION_FOLDER,
    SIMULATED_COUNT,
    aim,
    prepare_aim,
)
from cablecast.pipeline.aim_learning import CANDIDATE_COUNT
from cablecast.pipeline.aim_report import aim_evaluation, last_tries, write_aim_report
from cablecast.pipeline.aim_session import WITHIN_PCT
from cablecast.pipeline.places import require
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.folder import RunFolder
from cablecast.runs.places import DATASET_FOLDER, MODEL_FOLDER, TUNE_FOLDER
from cablecast.runs.progress import DONE_NOTE, Progress, ProgressCallback, ignore
from cablecast.tuning.tuned import Tuned
from cablecast.workspace import load_targets

EVALUATION_FOLDER = "evaluate"
TRIES = 3

FOLDERS = {
    *(CALIBRATION_FOLDER, TUNE_FOLDER, DATASET_FOLDER, MODEL_FOLDER),
    *(SESSION_FOLDER, EVALUATION_FOLDER),
}
"""Folders that the demo makes."""


def demo(
    rig: CheckedRig,
    out: str | os.PathLike[str],
    *,
    tuned: Tuned | None = None,
    tune_count: int = CALIBRATION_COUNT,
    count: int = SIMULATED_COUNT,
    epochs: int = EPOCHS,
    candidate_count: int = CANDIDATE_COUNT,
    tries: int = TRIES,
    within_pct: float = WITHIN_PCT,
    seed: int = 0,
    device: str = "cpu",
    progress: ProgressCallback = ignore,
) -> Evaluation:
    """Make a few casts, fit, simulate, train, aim at the paper's targets, and write a report.

    Args:
        rig: Rig that `make_rig` returned; gives the set-up.
        out: Folder of all results; a demo that was stopped goes on there.
        tuned: Result of `tune`, instead of casts and a fit.
        tune_count: Number of casts to fit the simulator to.
        count: Number of simulated casts.
        epochs: Largest number of passes over them.
        candidate_count: Number of motions to choose from when planning.
        tries: Casts at each target at most.
        within_pct: Distance from a target at which a cast has hit [% of cable length].
        seed: Seed of everything that is drawn by chance.
        device: "cpu" or "cuda".
        progress: Told how far each step is.

    Returns:
        The last cast at each target. `metrics["tries"]` has the errors after each try.
    """
    require("the demo", "torch", "safetensors", "matplotlib", "jinja2")
    folder = pathlib.Path(out)
    session = prepare_aim(
        rig,
        tuned=tuned,
        calibration_count=tune_count,
        count=count,
        epochs=epochs,
        candidate_count=candidate_count,
        within_pct=within_pct,
        tries=tries,
        seed=seed,
        device=device,
        out=folder,
        progress=progress,
    )
    targets = load_targets()
    settings = {
        **rig.setup.to_settings(),
        "rig": dict(rig.description),
        "policy": session.aimer.policy.info,
        "tries": tries,
        "within_pct": within_pct,
        "targets": targets.tolist(),
    }
    run = RunFolder.open(folder / EVALUATION_FOLDER, "demo", settings)
    with run.locked():
        progress(Progress(task=f"Aiming at {len(targets)} targets, up to {tries} tries each"))
        # Minutes are for one fit; a session of `aim` takes the time for another.
        result = aim(session, rig, targets, refit=False, progress=progress)
        if run.metrics is not None:
            progress(Progress(task="Report", note=DONE_NOTE))
            last = last_tries(aim_evaluation(result, rig))
            return dataclasses.replace(last, metrics=run.metrics)
        progress(Progress(task="Drawing the report"))
        return write_aim_report(result, rig, run)
