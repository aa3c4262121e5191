"""`cablecast train`: learn where casts land, and prepare the search for the best one."""

import dataclasses
import pathlib
import sys
import typing
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

from cablecast.cli.options import (
    DEFAULT_CABLE,
    MODEL_FOLDER,
    Device,
    argument,
    cable_folder,
    check_same_cable,
    find_dataset,
)

if TYPE_CHECKING:
    from cablecast.datasets.reader import Dataset
    from cablecast.models.landing import LandingModel

Mode = typing.Literal["sim", "real", "both"]
Method = typing.Literal["correction", "fine-tuning", "network", "gaussian-process"]

REAL_FOLDER = "real-data"
CARD_FILE = "MODELCARD.md"
CURVE_FILE = "learning_curve.png"

# What a method may learn from; the first mode is the one by default.
_MODES: dict[str, tuple[Mode, ...]] = {
    "correction": ("both",),
    "fine-tuning": ("both",),
    "network": ("sim", "real"),
    "gaussian-process": ("sim",),
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Train:
    """Train the model that predicts where a cast lands, from simulated and real casts.

    Also predicts 50,000 candidate motions, among which `plan` and `evaluate` search. Part of the
    casts is held out to measure the model's error, and a model card is written beside the model.
    With --real, the casts of a robot teach it what the simulator does not know.
    """

    cable: Annotated[str | None, argument("CABLE", "that of --dataset, or cable_1")] = None
    """Which cable: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    dataset: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/dataset")] = None
    """Folder that `cablecast simulate` wrote."""
    real: Annotated[
        pathlib.Path | None, argument("DIR", "runs/CABLE/real-data where --mode asks for it")
    ] = None
    """Folder that `cablecast collect --purpose real` wrote."""
    mode: Annotated[Mode | None, argument("{sim,real,both}", "both with --real, otherwise sim")] = (
        None
    )
    """What to learn from: simulated casts, real casts, or the former first and then the latter."""
    method: Annotated[
        Method | None,
        argument("METHOD", "correction where both are learned from, otherwise network"),
    ] = None
    """How to learn: network (simulated or real casts alone), gaussian-process (the paper's baseline
    on simulated casts), and for both: correction (a process of what the robot does differently, and
    how surely) or fine-tuning (the network goes on training, as in the paper)."""
    start: Annotated[pathlib.Path | None, argument("DIR", "train one first")] = None
    """Model of the simulated casts to begin with, where both are learned from."""
    out: Annotated[
        pathlib.Path | None, argument("DIR", "runs/CABLE/model, or model-METHOD with real casts")
    ] = None
    """Where to put the model."""
    seed: int = 0
    """Chooses what is held out, the network's first weights, and the candidates."""
    device: Device = "cpu"
    """Train on the processor or on an NVIDIA graphics card."""
    epochs: int = 100
    """How often at most the training goes through the dataset."""
    candidate_count: int = 50_000
    """How many motions to choose from when planning."""

    def run(self) -> None:
        """Train, and say how well the model predicts what it has not seen."""
        from cablecast.cable import load_cable
        from cablecast.cli.run_folder import RunFolder
        from cablecast.datasets.reader import read_dataset
        from cablecast.models.torch_ import check_device
        from cablecast.policies.forward_search import ForwardSearchPolicy

        mode, method = self._mode_and_method()
        asked = load_cable(self.cable) if self.cable else None
        casts: dict[str, Dataset] = {}
        if mode != "real":
            folder = find_dataset(self.dataset, asked)
            casts["sim"] = read_dataset(folder)
            asked = check_same_cable(asked, casts["sim"].cable, folder)
        if mode != "sim":
            folder = self.real or cable_folder(asked.name if asked else DEFAULT_CABLE) / REAL_FOLDER
            casts["real"] = read_dataset(folder)
            asked = check_same_cable(asked, casts["real"].cable, folder)
        cable = next(iter(casts.values())).cable
        settings = self._settings(cable, mode, method, casts)
        out = self.out or cable_folder(cable.name) / _folder_name(mode, method)
        run = RunFolder.open(out, "train", settings)
        if run.metrics is None:
            check_device(self.device)
            run.begin()
            model = self._model(method, casts)
            print(f"Predicting {self.candidate_count} candidate motions", file=sys.stderr)
            policy = ForwardSearchPolicy.build(
                model,
                model.motion_config,
                model.workspace,
                self.candidate_count,
                self.seed,
                ranges=model.action_ranges,
            )
            model.save(out)
            policy.save(out)
            write_documents(model, policy.info, out)
            run.finish(model.metrics | {"policy": policy.info})
        print(f"The model of {cable.name} is in {out}: {_errors(run.metrics or {})}")

    def _mode_and_method(self) -> tuple[Mode, Method]:
        from cablecast.errors import InputError

        mode = self.mode
        if mode is None:
            by_default = "both" if self.real else "sim"
            mode = _MODES[self.method][0] if self.method and not self.real else by_default
        method: Method = self.method or ("correction" if mode == "both" else "network")
        if mode not in _MODES[method]:
            raise InputError(
                f"--method {method} learns from --mode {' or '.join(_MODES[method])}, not {mode}"
            )
        if mode == "sim" and self.real:
            raise InputError(f"--mode sim uses no real casts, but --real {self.real} was given")
        if mode != "both" and self.start:
            raise InputError(f"--mode {mode} starts from nothing, but --start was given")
        return mode, method

    def _settings(self, cable, mode, method, casts) -> dict[str, Any]:
        from cablecast.models.adaptation import REAL_ONLY, FineTuningConfig
        from cablecast.models.gaussian_process_training import GaussianProcessConfig
        from cablecast.models.training import TrainingConfig

        configs: dict[str, Any] = {
            "network": REAL_ONLY if mode == "real" else TrainingConfig(epochs=self.epochs),
            "correction": TrainingConfig(epochs=self.epochs),
            "fine-tuning": TrainingConfig(epochs=self.epochs),
            "gaussian-process": GaussianProcessConfig(),
        }
        settings = {
            "cable": cable.to_dict(),
            "training": dataclasses.asdict(configs[method]),
            "candidate_count": self.candidate_count,
            "seed": self.seed,
            "device": self.device,
            "mode": mode,
            "method": method,
        }
        for kind, name in (("sim", "dataset_fingerprint"), ("real", "real_fingerprint")):
            if kind in casts:
                settings[name] = casts[kind].fingerprint
        if method == "fine-tuning":
            settings["fine_tuning"] = dataclasses.asdict(FineTuningConfig())
        if self.start is not None:
            settings["start_fingerprint"] = self._start_model(casts["sim"]).fingerprint
        return settings

    def _model(self, method: Method, casts: "dict[str, Dataset]") -> "LandingModel":
        from cablecast.datasets.progress import console_progress
        from cablecast.models.adaptation import correct_model, fine_tune, train_on_real
        from cablecast.models.gaussian_process_training import train_gaussian_process

        seed, device = self.seed, self.device
        if "sim" not in casts:
            with console_progress("Learning from real casts", "fits") as progress:
                return train_on_real(casts["real"], seed=seed, device=device, progress=progress)
        simulated = casts["sim"]
        if method == "gaussian-process":
            with console_progress("Solving", "steps at most") as progress:
                return train_gaussian_process(simulated, seed=seed, progress=_every(10, progress))
        start = self._train(simulated) if self.start is None else self._start_model(simulated)
        if "real" not in casts:
            return start
        with console_progress("Learning from real casts", "fits") as progress:
            if method == "correction":
                return correct_model(start, casts["real"], seed=seed, progress=progress)
            return fine_tune(start, casts["real"], seed=seed, device=device, progress=progress)

    def _train(self, simulated: "Dataset"):
        from cablecast.datasets.progress import console_progress
        from cablecast.models.forward_training import train_forward_model
        from cablecast.models.training import TrainingConfig

        config = TrainingConfig(epochs=self.epochs)
        with console_progress("Training", "epochs") as progress:
            report = _every(10, progress)
            return train_forward_model(
                simulated,
                config=config,
                seed=self.seed,
                device=self.device,
                on_epoch=lambda row: report(int(row["epoch"]), config.epochs),
            )

    def _start_model(self, simulated: "Dataset"):
        from cablecast.errors import CheckpointError
        from cablecast.models.forward import ForwardModel

        model = ForwardModel.load(self.start or "")
        there = model.info["dataset"]["fingerprint"]
        if there != simulated.fingerprint:
            raise CheckpointError(
                f"{self.start} was trained on another dataset ({there}, not "
                f"{simulated.fingerprint})"
            )
        if "adaptation" in model.info:
            raise CheckpointError(f"{self.start} has learned from real casts already")
        return model


def write_documents(
    model: "LandingModel", policy_info: dict[str, Any], folder: pathlib.Path
) -> None:
    """Write the card of a model, and its learning curve if matplotlib is there.

    Args:
        model: The model.
        policy_info: What its policy says of itself.
        folder: The run folder.
    """
    from cablecast.errors import MissingExtraError
    from cablecast.files import write_bytes, write_text
    from cablecast.models.card import model_card

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
            print(f"no learning curve: {error}", file=sys.stderr)
    write_text(folder / CARD_FILE, card)


def _every(count: int, progress: Callable[[int, int], None]) -> Callable[[int, int], None]:
    """A bar may move at every step; a log with a line for each would be noise."""
    count = 1 if sys.stderr.isatty() else count

    def report(done: int, total: int) -> None:
        if done % count == 0 or done == total:
            progress(done, total)

    return report


def _folder_name(mode: Mode, method: Method) -> str:
    if (mode, method) == ("sim", "network"):
        return MODEL_FOLDER
    return f"{MODEL_FOLDER}-{'real' if mode == 'real' else method}"


def _errors(metrics: dict[str, Any]) -> str:
    """The errors that tell how good a model is, as a sentence."""
    if "real_median_pct" in metrics:
        before = metrics.get("real_before_median_pct")
        was = "" if before is None else f", before {before:.2f} %"
        return (
            f"on {metrics['real_used_count']} real casts, each predicted without having been seen, "
            f"its median error is {metrics['real_median_pct']:.2f} % of cable length{was}"
        )
    return (
        f"on {metrics['held_out_count']} held-out casts its median error is "
        f"{metrics['held_out_median_pct']:.2f} % of cable length "
        f"(90 % are below {metrics['held_out_p90_pct']:.2f} %)"
    )
