"""`cablecast demo`: the whole way from a cable to a report."""

import dataclasses
import pathlib
import sys
from typing import Annotated

from cablecast.cli.evaluate import Evaluate
from cablecast.cli.options import (
    DATASET_FOLDER,
    DEFAULT_CABLE,
    MODEL_FOLDER,
    Device,
    argument,
    cable_folder,
    evaluation_folder,
)
from cablecast.cli.simulate import Simulate
from cablecast.cli.train import Train


@dataclasses.dataclass(frozen=True, kw_only=True)
class Demo:
    """Simulate, train and evaluate one cable on the virtual rig, and write a report.

    Takes a few minutes on two processor cores. A demo that was interrupted goes on where it was
    when it is started again; one that is done shows its results again.
    """

    cable: Annotated[str, argument("CABLE")] = DEFAULT_CABLE
    """Which cable: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE")] = None
    """Where to put everything."""
    seed: int = 0
    """Chooses everything that is drawn by chance."""
    device: Device = "cpu"
    """Simulate and train on the processor or on an NVIDIA graphics card."""
    params: Annotated[pathlib.Path | None, argument("FILE", "what the cable says of itself")] = None
    """Parameters that `cablecast tune` found (params.json), which make the simulation truer."""
    count: int = 36_000
    """How many casts to simulate; fewer are faster and less accurate."""
    epochs: int = 100
    """How often at most the training goes through them."""
    candidate_count: int = 50_000
    """How many motions to choose from when planning."""
    rig: Annotated[str, argument("RIG")] = "virtual"
    """What carries out the casts: virtual, engine, or your own robot as package.module:factory."""

    def run(self) -> None:
        """Run the three verbs one after the other."""
        from cablecast.cable import load_cable

        out = self.out or cable_folder(load_cable(self.cable).name)
        dataset, model = out / DATASET_FOLDER, out / MODEL_FOLDER
        print("1/3 simulate", file=sys.stderr)
        Simulate(
            cable=self.cable,
            count=self.count,
            out=dataset,
            seed=self.seed,
            device=self.device,
            params=self.params,
        ).run()
        print("2/3 train", file=sys.stderr)
        Train(
            cable=self.cable,
            dataset=dataset,
            out=model,
            seed=self.seed,
            device=self.device,
            epochs=self.epochs,
            candidate_count=self.candidate_count,
        ).run()
        print("3/3 evaluate", file=sys.stderr)
        Evaluate(
            cable=self.cable,
            model=model,
            rig=self.rig,
            out=out / evaluation_folder(self.rig),
            seed=self.seed,
        ).run()
