"""`cablecast train`: train the model of landings, and prepare the search for the best cast."""

import dataclasses
import pathlib
import typing
from typing import Annotated, Any

from cablecast.cli.options import Device, argument, check_same_setup, load_lab, picked
from cablecast.errors import InputError
from cablecast.runs.places import MODEL_FOLDER, cable_folder, find_input

Mode = typing.Literal["sim", "real", "both"]
Method = typing.Literal["network", "gaussian-process"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Train:
    """Train the model that predicts where a cast lands, on simulated and real casts.

    Also predicts the landings of 50,000 candidate motions, which `plan` and `evaluate` search. Part
    of the casts is held out to measure the model's error, and a model card is written next to the
    model. With --real, the model is then fine-tuned on casts of a robot. 36,000 casts take one to
    two minutes on two cores, and so does the Gaussian process. Training that was interrupted starts
    again.
    """

    setup: Annotated[pathlib.Path | None, argument("FILE", "that of the casts")] = None
    """Lab file that the casts must have been made with."""
    cable: Annotated[str | None, argument("CABLE", "that of --dataset, or cable_1")] = None
    """Cable of the casts: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    dataset: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/dataset")] = None
    """Folder that `cablecast simulate` wrote."""
    real: Annotated[
        pathlib.Path | None, argument("DIR", "runs/CABLE/real-data where --mode asks for it")
    ] = None
    """Folder that `cablecast collect --purpose real` wrote."""
    mode: Annotated[Mode | None, argument("{sim,real,both}", "both with --real, otherwise sim")] = (
        None
    )
    """Casts to train on: simulated, real, or both (trained on the simulated ones, then fine-tuned
    on the real ones)."""
    method: Method = "network"
    """Learning method: network, or gaussian-process, the paper's baseline on simulated casts."""
    start: Annotated[pathlib.Path | None, argument("DIR", "a new one is trained")] = None
    """Model of the simulated casts to start from, for --mode both."""
    out: Annotated[
        pathlib.Path | None, argument("DIR", "runs/CABLE/model, model-real or model-fine-tuning")
    ] = None
    """Folder of the model."""
    seed: int = 0
    """Seed of the held-out casts, the initial weights and the candidates."""
    device: Device = "cpu"
    """Train on the processor or on an NVIDIA graphics card."""
    epochs: int = 100
    """Largest number of passes over the dataset."""
    candidate_count: int = 50_000
    """Number of candidate motions that planning searches."""

    def run(self) -> None:
        """Train, and print the error of the model."""
        from cablecast.cli.progress import console_progress
        from cablecast.data.dataset import read_dataset
        from cablecast.learning.network import ForwardModel
        from cablecast.pipeline.train import train

        mode = self._mode()
        name = load_lab(self.setup, self.cable).cable.name
        folders = {}
        if mode != "real":
            folders["simulated"] = find_input("simulated", self.dataset, name)
        if mode != "sim":
            folders["real"] = find_input("real", self.real, name)
        casts = {kind: read_dataset(folder) for kind, folder in folders.items()}
        for kind, dataset in casts.items():
            check_same_setup(self.setup, self.cable, dataset.setup, folders[kind])
        cable = next(iter(casts.values())).cable
        out = self.out or cable_folder(cable.name) / _folder_name(mode, self.method)
        with console_progress() as progress:
            policy = train(
                casts.get("simulated"),
                casts.get("real"),
                start=None if self.start is None else ForwardModel.load(self.start),
                out=out,
                progress=progress,
                **picked(self, "method", "epochs", "candidate_count", "seed", "device"),
            )
        print(f"The model of {cable.name} is in {out}: {_errors(policy.model.metrics)}")

    def _mode(self) -> Mode:
        mode = self.mode or ("both" if self.real else "sim")
        if mode == "sim" and self.real:
            raise InputError(f"--mode sim uses no real casts, but --real {self.real} was given")
        if mode == "real" and self.dataset:
            raise InputError(
                f"--mode real uses no simulated casts, but --dataset {self.dataset} was given"
            )
        if mode != "both" and self.start:
            raise InputError(f"--mode {mode} takes no --start, but {self.start} was given")
        return mode


def _folder_name(mode: Mode, method: Method) -> str:
    if method == "gaussian-process":
        return f"{MODEL_FOLDER}-{method}"
    return MODEL_FOLDER + {"sim": "", "real": "-real", "both": "-fine-tuning"}[mode]


def _errors(metrics: dict[str, Any]) -> str:
    """Return the errors of a model as a sentence."""
    if "real_median_pct" in metrics:
        before = metrics.get("real_before_median_pct")
        was = "" if before is None else f", before {before:.2f} %"
        return (
            f"on {metrics['real_used_count']} real casts, each held out in turn, its median error "
            f"is {metrics['real_median_pct']:.2f} % of cable length{was}"
        )
    return (
        f"on {metrics['held_out_count']} held-out casts its median error is "
        f"{metrics['held_out_median_pct']:.2f} % of cable length "
        f"(90 % are below {metrics['held_out_p90_pct']:.2f} %)"
    )
