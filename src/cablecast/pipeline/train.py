"""train: train the model of landings, and prepare the search for the best cast."""

import dataclasses
import os
import pathlib
import typing
from typing import Any

from cablecast.data.dataset import Dataset
from cablecast.errors import (
    CheckpointError,
    InputError,
    MissingExtraError,
    check_argument_types,
    check_count,
    check_seed,
)
from cablecast.files import write_bytes, write_text
from cablecast.learning.card import model_card
from cablecast.learning.checkpoint import check_device
from cablecast.learning.gaussian_process import GaussianProcessConfig, train_gaussian_process
from cablecast.learning.landing import LandingModel
from cablecast.learning.network import (
    FINE_TUNING,
    REAL_ONLY,
    ForwardModel,
    TrainingConfig,
    fine_tune,
    train_forward_model,
    train_on_real,
)
from cablecast.learning.policy import CANDIDATE_COUNT, ForwardSearchPolicy
from cablecast.motion.feasibility import ACTION_COUNT_MAX
from cablecast.pipeline.places import folder_or_temporary, require
from cablecast.report.curves import learning_curves
from cablecast.report.style import png_bytes
from cablecast.runs.folder import METRICS_FILE, RunFolder
from cablecast.runs.progress import DONE_NOTE, Progress, ProgressCallback, show

Method = typing.Literal["network", "gaussian-process"]

CARD_FILE = "MODELCARD.md"
CURVE_FILE = "learning_curve.png"


@check_argument_types
def train(
    simulated: Dataset | None = None,
    real: Dataset | None = None,
    *,
    method: Method = "network",
    start: ForwardModel | None = None,
    epochs: int = 100,
    hidden_width: int = TrainingConfig.hidden_width,
    candidate_count: int = CANDIDATE_COUNT,
    seed: int = 0,
    device: str = "cpu",
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = show,
) -> ForwardSearchPolicy:
    """Train the model that predicts where a cast lands, and prepare the policy that searches it.

    Given both kinds of casts, a network is trained on the simulated ones and then fine-tuned on the
    real ones (section V-F).

    Args:
        simulated: Simulated casts of one cable, D_sim.
        real: Casts of a rig, D_real.
        method: "network", or "gaussian-process", the paper's baseline on simulated casts alone.
        start: Network of the same simulated casts to fine-tune; trained first if None.
        epochs: Largest number of passes over the simulated casts.
        hidden_width: Number of units of each of the four hidden layers; the paper's by default.
        candidate_count: Number of motions that the policy chooses from.
        seed: Seed of the held-out casts, the first weights and the candidates.
        device: "cpu" or "cuda".
        out: Folder that keeps model and policy; none if None.
        progress: Receives the epochs and fits done.

    Returns:
        The policy; `policy.model` is the model, `policy.model.metrics` its errors.

    Raises:
        InputError: No casts, casts of the wrong kind, a method that does not suit them, or a value
            out of bounds.
        MissingExtraError: torch or safetensors is missing.
    """
    _check_casts(simulated, real, method)
    check_count("candidate_count", candidate_count, high=ACTION_COUNT_MAX)
    check_seed(seed)
    require("training a model", "torch", "safetensors")
    check_device(device)
    if start is not None:
        _check_start(start, simulated)
    config = TrainingConfig(epochs=epochs, hidden_width=hidden_width)
    casts = {
        role: dataset
        for role, dataset in (("sim", simulated), ("real", real))
        if dataset is not None
    }
    both = len(casts) == 2
    setup = next(iter(casts.values())).setup
    used = config if simulated is not None else REAL_ONLY
    settings = {
        **setup.to_settings(),
        "method": "fine-tuning" if both else method,
        "training": dataclasses.asdict(
            GaussianProcessConfig() if method == "gaussian-process" else used
        ),
        **{f"{role}_fingerprint": dataset.fingerprint for role, dataset in casts.items()},
        **({"fine_tuning": dataclasses.asdict(FINE_TUNING)} if both else {}),
        **({} if start is None else {"start_fingerprint": start.fingerprint}),
        "candidate_count": candidate_count,
        "seed": seed,
        "device": device,
    }

    def on_epoch(row: dict[str, float]) -> None:
        progress(Progress(task="Training", done=int(row["epoch"]), total=epochs, unit="epochs"))

    def trained() -> LandingModel:
        options: dict[str, Any] = {"seed": seed, "device": device}
        if method == "gaussian-process" and simulated is not None:
            return train_gaussian_process(simulated, seed=seed, progress=progress)
        model = start
        if model is None and simulated is not None:
            model = train_forward_model(simulated, config=config, on_epoch=on_epoch, **options)
        if real is None:
            return typing.cast(ForwardModel, model)
        if model is None:
            return train_on_real(real, progress=progress, **options)
        return fine_tune(model, real, progress=progress, **options)

    with folder_or_temporary(out) as folder:
        run = RunFolder.open(folder, "train", settings)
        if run.metrics is not None:
            progress(Progress(task=f"Training the model of {setup.cable.name}", note=DONE_NOTE))
            try:
                return ForwardSearchPolicy.load(folder)
            except CheckpointError as error:
                again = f"Delete {run.path / METRICS_FILE}, and the same command trains anew"
                raise CheckpointError(f"{error}. {again}") from None
        with run.locked():
            model = trained()
            task = f"Choosing {candidate_count} candidates that the arm can follow"
            progress(Progress(task=task))
            policy = ForwardSearchPolicy.build(
                model, candidate_count, seed, ranges=model.action_ranges, progress=progress
            )
            if out is not None:
                policy.save(folder)
                _write_documents(policy, folder, progress)
                run.finish({**model.metrics, "policy": policy.info})
        return policy


def _check_casts(simulated: Dataset | None, real: Dataset | None, method: str) -> None:
    if simulated is None and real is None:
        raise InputError("training needs casts: simulated ones, real ones, or both")
    for dataset, is_simulated, words in (
        (simulated, True, "simulated"),
        (real, False, "casts of a rig"),
    ):
        if dataset is not None and (dataset.kind == "sim") is not is_simulated:
            raise InputError(
                f"{dataset.path or 'the dataset'} holds casts of kind {dataset.kind!r}, which are "
                f"not {words}"
            )
    if method not in typing.get_args(Method):
        known = ", ".join(typing.get_args(Method))
        raise InputError(f"method {str(method)[:40]!r} must be one of {known}")
    if method == "gaussian-process" and (simulated is None or real is not None):
        raise InputError("method gaussian-process takes simulated casts alone")


def _check_start(start: ForwardModel, simulated: Dataset | None) -> None:
    if simulated is None:
        raise InputError("a model to start from needs the simulated casts that it was trained on")
    if start.dataset_fingerprint != simulated.fingerprint:
        raise CheckpointError(
            "the model to start from was trained on another dataset "
            f"({start.dataset_fingerprint}, not {simulated.fingerprint})"
        )
    if start.has_real_casts:
        raise CheckpointError("the model to start from was trained on real casts already")


def _write_documents(
    policy: ForwardSearchPolicy, folder: pathlib.Path, progress: ProgressCallback
) -> None:
    """Write the card of a model, and its learning curve where matplotlib is installed."""
    model = policy.model
    card = model_card(model, policy.info)
    adaptation = model.info.get("adaptation", {})
    # A network of real casts alone has no other curve than that of its adaptation.
    curves = [("Pre-training" if adaptation else "Training", model.info.get("curve", []))]
    curves.append(("On real casts", adaptation.get("curve", [])))
    curves = [(title, curve) for title, curve in curves if len(curve) > 1]
    if curves:
        try:
            figure = learning_curves(curves, model.setup.cable.length)
            write_bytes(folder / CURVE_FILE, png_bytes(figure))
            card += f"\n![learning curve]({CURVE_FILE})\n"
        except MissingExtraError as error:
            progress(Progress(task="No learning curve", note=str(error)))
    write_text(folder / CARD_FILE, card)
