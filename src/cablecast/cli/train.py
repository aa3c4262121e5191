"""`cablecast train`: learn where casts land, and prepare the search for the best one."""

import dataclasses
import pathlib
import sys
from typing import Annotated

from cablecast.cli.options import (
    MODEL_FOLDER,
    Device,
    argument,
    cable_folder,
    check_same_cable,
    find_dataset,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Train:
    """Train the model that predicts where a cast lands, from a simulated dataset.

    Also predicts 50,000 candidate motions, among which `plan` and `evaluate` search. A tenth of the
    dataset is held out to measure the model's error.
    """

    cable: Annotated[str | None, argument("CABLE", "that of --dataset, or cable_1")] = None
    """Which cable: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    dataset: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/dataset")] = None
    """Folder that `cablecast simulate` wrote."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/model")] = None
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
        from cablecast.datasets.progress import console_progress
        from cablecast.datasets.reader import read_dataset
        from cablecast.models.training import TrainingConfig, check_device, train_forward_model
        from cablecast.policies.forward_search import ForwardSearchPolicy

        asked = load_cable(self.cable) if self.cable else None
        config = TrainingConfig(epochs=self.epochs)
        folder = find_dataset(self.dataset, asked)
        dataset = read_dataset(folder)
        cable = check_same_cable(asked, dataset.cable, folder)
        settings = {
            "dataset_fingerprint": dataset.fingerprint,
            "cable": cable.to_dict(),
            "training": dataclasses.asdict(config),
            "candidate_count": self.candidate_count,
            "seed": self.seed,
            "device": self.device,
        }
        out = self.out or cable_folder(cable.name) / MODEL_FOLDER
        run = RunFolder.open(out, "train", settings)
        if run.metrics is None:
            check_device(self.device)
            run.begin()
            with console_progress("Training", "epochs") as progress:
                # A bar may move at every epoch; a log with a line for each would be noise.
                every = 1 if sys.stderr.isatty() else 10

                def show(row: dict[str, float]) -> None:
                    if row["epoch"] % every == 0:
                        progress(int(row["epoch"]), config.epochs)

                model = train_forward_model(
                    dataset, config=config, seed=self.seed, device=self.device, on_epoch=show
                )
            print(f"Predicting {self.candidate_count} candidate motions", file=sys.stderr)
            policy = ForwardSearchPolicy.build(
                model, dataset.motion_config, dataset.workspace, self.candidate_count, self.seed
            )
            model.save(out)
            policy.save(out)
            run.finish(model.metrics | {"policy": policy.info})
        metrics = run.metrics or {}
        print(
            f"The model of {cable.name} is in {out}: on {metrics['held_out_count']} held-out casts "
            f"its median error is {metrics['held_out_median_pct']:.2f} % of cable length "
            f"(90 % are below {metrics['held_out_p90_pct']:.2f} %)"
        )
