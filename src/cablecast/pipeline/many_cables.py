"""train --cables: one model for many cables, and the policy that it gives for one of them."""

import dataclasses
import os
from typing import Any

from cablecast.cable import CableParams
from cablecast.data.dataset import Dataset
from cablecast.data.simulate import simulate_dataset
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import check_count, check_seed
from cablecast.files import write_text
from cablecast.learning.card import many_cables_card, model_card
from cablecast.learning.checkpoint import check_device
from cablecast.learning.network import (
    MANY_CABLES_CONFIG,
    ForwardModel,
    ManyCablesModel,
    TrainingConfig,
    train_forward_model,
    train_many_cables,
)
from cablecast.learning.policy import ForwardSearchPolicy
from cablecast.motion.feasibility import ACTION_COUNT_MAX
from cablecast.pipeline.engine import make_engine
from cablecast.pipeline.places import folder_or_temporary, require
from cablecast.pipeline.simulate import simulate
from cablecast.pipeline.train import CARD_FILE
from cablecast.pipeline.tuned import Tuned
from cablecast.runs.folder import RunFolder
from cablecast.runs.places import DATASET_FOLDER
from cablecast.runs.progress import DONE_NOTE, Progress, ProgressCallback, ignore, resumed_counter
from cablecast.runs.workers import LOCAL, check_workers
from cablecast.setup import Setup
from cablecast.tuning.space import draw_cables

CABLE_COUNT = 160_000
"""Cables that are drawn, with one simulated cast each."""

SEGMENT_COUNT, DT = 30, 1e-3
"""Segments and step [s] of the simulated cables. Coarser than for one cable: with more casts in the
same time the network gains more than the coarse cables cost (docs/learning.md)."""

CANDIDATE_COUNT = 20_000
"""Motions that a policy from this model chooses from: fewer than where a model is trained, for most
of the time to the first plan is spent on them."""

REFINE_COUNT = 1500
"""Casts with which a refined model is nearly as good as one that learned from 8,000 casts alone."""

REFINE_CONFIG = TrainingConfig(
    epochs=40, batch_size=64, learning_rate=1e-3, weight_decay=0.03, patience=40
)
"""Settings of the training that refines."""


def train_cables(
    setup: Setup,
    *,
    cables: int = CABLE_COUNT,
    tuned: Tuned | None = None,
    epochs: int = MANY_CABLES_CONFIG.epochs,
    seed: int = 0,
    segment_count: int = SEGMENT_COUNT,
    dt: float = DT,
    device: str = "cpu",
    workers: str = LOCAL,
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback | None = None,
) -> ManyCablesModel:
    """Simulate casts of many random cables, and train one model for all of them.

    The cables are drawn uniformly from the ranges that `tune` searches around the cable of the
    set-up. They share its length and diameter. `ManyCablesModel.for_cable` then gives the model of
    a cable whose parameters are known, without a simulation or any training.

    Args:
        setup: Cable, workspace, arm and motion settings.
        cables: Number of cables, each of which is cast once.
        tuned: Result of `tune` that gives the servo of the arm; an arm without lag where None.
        epochs: Passes over the casts.
        seed: Seed of the cables, the actions, the held-out casts and the first weights.
        segment_count: Segments of the simulated cables.
        dt: Time step [s].
        device: "cpu" or "cuda".
        workers: Who simulates: "local", "ray" for a cluster on this machine, or "ray:ADDRESS".
        out: Folder that keeps the casts and the model and lets a stopped run go on; none where
            None.
        progress: Told how many casts and epochs are done.

    Raises:
        InputError: A value is out of bounds, or the folder holds something else.
        MissingExtraError: torch or safetensors is missing.
    """
    check_workers(workers)
    check_count("cables", cables, 50, ACTION_COUNT_MAX)
    check_seed(seed)
    require("training a model", "torch", "safetensors")
    check_device(device)
    report, config = progress or ignore, dataclasses.replace(MANY_CABLES_CONFIG, epochs=epochs)
    servo = None if tuned is None else tuned.dynamics.servo
    settings = {
        **setup.to_settings(),
        "method": "many cables",
        "cable_count": cables,
        "training": dataclasses.asdict(config),
        "servo": None if servo is None else servo.to_dict(),
        "segment_count": segment_count,
        "dt": dt,
        "seed": seed,
        "device": device,
    }
    with folder_or_temporary(out) as folder:
        run = RunFolder.open(folder, "train", settings)
        if run.metrics is not None:
            report(Progress(task="Training", note=DONE_NOTE))
            return ManyCablesModel.load(folder)
        with run.begun():
            report(Progress(task=f"Choosing {cables} motions that the arm can make"))
            dataset = simulate_dataset(
                folder / DATASET_FOLDER,
                setup,
                Dynamics(params=draw_cables(setup.cable, cables, seed), servo=servo),
                make_engine(segment_count, dt, device),
                count=cables,
                seed=seed,
                workers=workers,
                progress=resumed_counter(progress, "Simulating many cables", "casts"),
            )
            model = _trained(dataset, config, seed, device, report)
            if out is not None:
                model.save(folder)
                write_text(folder / CARD_FILE, many_cables_card(model))
                run.finish(model.metrics)
        return model


def _trained(
    dataset: Dataset, config: Any, seed: int, device: str, report: ProgressCallback
) -> ManyCablesModel:
    def on_epoch(row: dict[str, float]) -> None:
        done = int(row["epoch"])
        report(Progress(task="Training", done=done, total=config.epochs, unit="epochs"))

    return train_many_cables(dataset, config=config, seed=seed, device=device, on_epoch=on_epoch)


def policy_for_cable(
    model: ManyCablesModel,
    tuned: Tuned | CableParams,
    setup: Setup,
    *,
    refine: int = 0,
    candidate_count: int = CANDIDATE_COUNT,
    seed: int = 0,
    segment_count: int | None = None,
    dt: float | None = None,
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback | None = None,
) -> ForwardSearchPolicy:
    """Return the policy of one cable from the model of many, as `train` does from its casts.

    Args:
        model: Model of many cables.
        tuned: Result of `tune`, or parameters alone.
        setup: Set-up with the cable.
        refine: Casts of this cable to simulate and to go on learning from; none where 0.
        candidate_count: Number of motions that the policy chooses from.
        seed: Seed of the candidates and of the casts.
        segment_count: Segments of the cable of these casts; what the convergence study chose where
            None.
        dt: Time step of these casts [s]; what the convergence study chose where None.
        out: Folder that keeps model and policy; none where None.
        progress: Told how many casts are done, and that the candidates are predicted.

    Raises:
        InputError: The cable or the set-up is not one that the model has learned, a value is out of
            bounds, or the folder holds something else.
    """
    report = progress or ignore
    check_count("candidate_count", candidate_count, high=ACTION_COUNT_MAX)
    check_count("refine", refine, 0, ACTION_COUNT_MAX)
    known = Tuned.of(tuned, setup)
    one = model.for_cable(known.params, setup)
    settings = {
        **setup.to_settings(),
        "method": "many cables",
        **known.dynamics.to_dict(),
        "start_fingerprint": model.fingerprint,
        "refine": {"count": refine, "segment_count": segment_count, "dt": dt} if refine else None,
        "candidate_count": candidate_count,
        "seed": seed,
    }
    with folder_or_temporary(out) as folder:
        run = RunFolder.open(folder, "train", settings)
        if run.metrics is not None:
            return ForwardSearchPolicy.load(folder)
        with run.begun():
            if refine:
                engine = {"segment_count": segment_count, "dt": dt}
                casts = simulate(setup, known, count=refine, seed=seed, progress=progress, **engine)
                one = _refined(one, casts, seed)
            report(Progress(task=f"Predicting {candidate_count} candidate motions"))
            policy = ForwardSearchPolicy.build(one, candidate_count, seed, ranges=one.action_ranges)
            if out is not None:
                policy.save(folder)
                write_text(folder / CARD_FILE, model_card(one, policy.info))
                run.finish({**one.metrics, "policy": policy.info})
        return policy


def _refined(model: ForwardModel, casts: Dataset, seed: int) -> ForwardModel:
    """Return the model of one cable after it learned from casts of it."""
    refined = train_forward_model(casts, config=REFINE_CONFIG, seed=seed, start=model)
    # The table margins of the model of many cables are known at more actions than these.
    return dataclasses.replace(
        refined,
        margin_features=model.margin_features,
        margins=model.margins,
        info=refined.info | {"many_cables": model.info["many_cables"]},
    )
