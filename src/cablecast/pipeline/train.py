"""train: learn where casts land, and prepare the search for the best one."""

import dataclasses
import os
import pathlib
import typing
from typing import Any

from cablecast.data.dataset import Dataset
from cablecast.errors import CheckpointError, InputError, check_count, check_seed
from cablecast.files import write_bytes, write_text
from cablecast.learning.adaptation import (
    REAL_ONLY,
    FineTuningConfig,
    correct_model,
    fine_tune,
    train_on_real,
)
from cablecast.learning.checkpoint import check_device
from cablecast.learning.gaussian_process import (
    GaussianProcessConfig,
    train_gaussian_process,
)
from cablecast.learning.landing import LandingModel
from cablecast.learning.network import ForwardModel, TrainingConfig, train_forward_model
from cablecast.learning.policy import CANDIDATE_COUNT, ForwardSearchPolicy
from cablecast.motion.feasibility import ACTION_COUNT_MAX
from cablecast.pipeline.places import folder_or_temporary, require
from cablecast.runs.folder import RunFolder
from cablecast.runs.progress import DONE_NOTE, Progress, ProgressCallback, ignore

Mode = typing.Literal["sim", "real", "both"]
Method = typing.Literal["correction", "fine-tuning", "network", "gaussian-process"]

CARD_FILE = "MODELCARD.md"
CURVE_FILE = "learning_curve.png"

MODES: dict[Method, tuple[Mode, ...]] = {
    "correction": ("both",),
    "fine-tuning": ("both",),
    "network": ("sim", "real"),
    "gaussian-process": ("sim",),
}
"""Casts that a method may learn from."""


def train(
    simulated: Dataset | None = None,
    real: Dataset | None = None,
    *,
    method: Method | None = None,
    start: ForwardModel | None = None,
    epochs: int = 100,
    candidate_count: int = CANDIDATE_COUNT,
    seed: int = 0,
    device: str = "cpu",
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = ignore,
) -> ForwardSearchPolicy:
    """Train the model that predicts where a cast lands, and prepare the policy that searches it.

    Args:
        simulated: Casts that `simulate` made (D_sim).
        real: Casts that `collect` recorded (D_real), which teach what the simulator does not know.
        method: Way to learn: "network" (simulated or real casts alone), "gaussian-process" (the
            paper's baseline, simulated casts), and where both are given "correction" (a Gaussian
            process on the sim-to-real residual, with its standard deviation) or "fine-tuning" (the
            network goes on training, as in the paper). Where None: correction if both are given,
            otherwise network.
        start: Model of the same simulated casts to begin with, where both are given; trained first
            where None.
        epochs: Largest number of passes over the simulated casts.
        candidate_count: Number of motions that the policy chooses from.
        seed: Seed of the held-out casts, the first weights and the candidates.
        device: "cpu" or "cuda".
        out: Folder that keeps model and policy; none where None.
        progress: Told the epochs, fits and candidates.

    Returns:
        The policy; `policy.model` is the model, `policy.model.metrics` its errors.

    Raises:
        InputError: No casts, casts of the wrong kind, a method that does not suit them, or a value
            out of bounds.
        MissingExtraError: torch or safetensors is missing.
    """
    casts = _check_casts(simulated, real)
    method = _check_method(method, casts)
    check_count("candidate_count", candidate_count, high=ACTION_COUNT_MAX)
    check_seed(seed)
    require("training a model", "torch", "safetensors")
    check_device(device)
    if start is not None:
        _check_start(start, simulated)
    job = _Training(casts, method, start, TrainingConfig(epochs=epochs), seed, device, progress)
    setup = next(iter(casts.values())).setup
    settings = {
        **setup.to_settings(),
        **job.settings(),
        "candidate_count": candidate_count,
        "seed": seed,
        "device": device,
    }
    with folder_or_temporary(out) as folder:
        run = RunFolder.open(folder, "train", settings)
        if run.metrics is not None:
            progress(Progress(task=f"Training the model of {setup.cable.name}", note=DONE_NOTE))
            return ForwardSearchPolicy.load(folder)
        with run.begun():
            model = job.model()
            progress(Progress(task=f"Predicting {candidate_count} candidate motions"))
            policy = ForwardSearchPolicy.build(
                model, candidate_count, seed, ranges=model.action_ranges
            )
            if out is not None:
                policy.save(folder)
                write_documents(model, policy.info, folder, progress)
                run.finish({**model.metrics, "policy": policy.info})
        return policy


def _check_casts(simulated: Dataset | None, real: Dataset | None) -> dict[str, Dataset]:
    """Return the casts by where they come from, "sim" first.

    Raises:
        InputError: There are none, or they are not of the kind that they are given as.
    """
    casts = {name: d for name, d in (("sim", simulated), ("real", real)) if d is not None}
    if not casts:
        raise InputError("training needs casts: simulated ones, real ones, or both")
    for name, dataset in casts.items():
        if (dataset.kind == "sim") is not (name == "sim"):
            raise InputError(
                f"{dataset.path or 'the dataset'} holds casts of kind {dataset.kind!r}, which are "
                f"not {'simulated' if name == 'sim' else 'casts of a rig'}"
            )
    return casts


def _check_method(method: Method | None, casts: dict[str, Dataset]) -> Method:
    mode: Mode = "both" if len(casts) == 2 else "sim" if "sim" in casts else "real"
    method = method or ("correction" if mode == "both" else "network")
    if method not in MODES:
        raise InputError(f"method {str(method)[:40]!r} must be one of {', '.join(MODES)}")
    if mode not in MODES[method]:
        raise InputError(
            f"method {method} learns from {' or '.join(MODES[method])} casts, not from {mode}"
        )
    return method


def _check_start(start: ForwardModel, simulated: Dataset | None) -> None:
    if simulated is None:
        raise InputError("a model to start from needs the simulated casts that it learned from")
    there = start.info["dataset"]["fingerprint"]
    if there != simulated.fingerprint:
        raise CheckpointError(
            f"the model to start from was trained on another dataset ({there}, not "
            f"{simulated.fingerprint})"
        )
    if "adaptation" in start.info:
        raise CheckpointError("the model to start from has learned from real casts already")


@dataclasses.dataclass(frozen=True)
class _Training:
    """One way to learn from some casts."""

    casts: dict[str, Dataset]
    method: Method
    start: ForwardModel | None
    config: TrainingConfig
    seed: int
    device: str
    progress: ProgressCallback

    def settings(self) -> dict[str, Any]:
        """Return what decides the model, as plain values."""
        configs: dict[str, Any] = {
            "network": self.config if "sim" in self.casts else REAL_ONLY,
            "gaussian-process": GaussianProcessConfig(),
        }
        settings = {
            "method": self.method,
            "training": dataclasses.asdict(configs.get(self.method, self.config)),
            **{f"{name}_fingerprint": casts.fingerprint for name, casts in self.casts.items()},
        }
        if self.method == "fine-tuning":
            settings["fine_tuning"] = dataclasses.asdict(FineTuningConfig())
        if self.start is not None:
            settings["start_fingerprint"] = self.start.fingerprint
        return settings

    def model(self) -> LandingModel:
        """Return the trained model."""
        seed, device, progress = self.seed, self.device, self.progress
        if "sim" not in self.casts:
            return train_on_real(
                self.casts["real"], seed=seed, device=device, progress=self.progress
            )
        simulated = self.casts["sim"]
        if self.method == "gaussian-process":
            return train_gaussian_process(simulated, seed=seed, progress=progress)
        start = self.start or self._network(simulated)
        if self.method == "correction":
            return correct_model(start, self.casts["real"], seed=seed, progress=progress)
        if self.method == "fine-tuning":
            return fine_tune(
                start, self.casts["real"], seed=seed, device=device, progress=self.progress
            )
        return start

    def _network(self, simulated: Dataset) -> ForwardModel:
        epochs = self.config.epochs

        def on_epoch(row: dict[str, float]) -> None:
            done = int(row["epoch"])
            self.progress(Progress(task="Training", done=done, total=epochs, unit="epochs"))

        return train_forward_model(
            simulated, config=self.config, seed=self.seed, device=self.device, on_epoch=on_epoch
        )


def write_documents(
    model: LandingModel,
    policy_info: dict[str, Any],
    folder: pathlib.Path,
    progress: ProgressCallback = ignore,
) -> None:
    """Write the card of a model, and its learning curve where matplotlib is installed.

    Args:
        model: The model.
        policy_info: Description of its policy.
        folder: Run folder.
        progress: Told where there is no curve, and why.
    """
    from cablecast.errors import MissingExtraError
    from cablecast.learning.card import model_card

    card = model_card(model, policy_info)
    adaptation = model.info.get("adaptation", {})
    # A network of real casts alone has no other curve than that of its adaptation.
    curves = [("Pre-training" if adaptation else "Training", model.info.get("curve", []))]
    if adaptation.get("curve"):
        curves.append(("On real casts", adaptation["curve"]))
    curves = [(title, curve) for title, curve in curves if len(curve) > 1]
    if curves:
        try:
            from cablecast.report.curves import learning_curves
            from cablecast.report.style import png_bytes

            figure = learning_curves(curves, model.cable.length)
            write_bytes(folder / CURVE_FILE, png_bytes(figure))
            card += f"\n![learning curve]({CURVE_FILE})\n"
        except MissingExtraError as error:
            progress(Progress(task="No learning curve", note=str(error)))
    write_text(folder / CARD_FILE, card)
