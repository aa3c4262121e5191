"""`cablecast demo`: the whole way from a cable to a report."""

import dataclasses
import pathlib
import sys
from typing import Annotated

from cablecast.cli.collect import DATA_FOLDERS, Collect
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
from cablecast.cli.tune import TUNE_FOLDER, Tune

# A search that is short beside that of `cablecast tune`, and far better than none.
COARSE_GENERATIONS = 40
FINE_GENERATIONS = 10


@dataclasses.dataclass(frozen=True, kw_only=True)
class Demo:
    """Cast, tune, simulate, train and evaluate with one cable, and write a report.

    The rig makes some casts, a simulator is tuned to them, a model learns from many casts in the
    simulator, and the rig casts at the paper's 32 targets. Takes a few minutes on two processor
    cores. A demo that was interrupted goes on where it was when it is started again; one that is
    done shows its results again. `cablecast reproduce` does more of everything.
    """

    cable: Annotated[str, argument("CABLE")] = DEFAULT_CABLE
    """Which cable: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE")] = None
    """Where to put everything."""
    seed: int = 0
    """Chooses everything that is drawn by chance."""
    device: Device = "cpu"
    """Simulate and train on the processor or on an NVIDIA graphics card."""
    params: Annotated[pathlib.Path | None, argument("FILE", "what the demo finds itself")] = None
    """Parameters that `cablecast tune` found (params.json); the demo then casts and tunes none."""
    tune_count: int = 40
    """How many casts to tune the simulator with."""
    count: int = 16_000
    """How many casts to simulate; fewer are faster and less accurate."""
    epochs: int = 60
    """How often at most the training goes through them."""
    candidate_count: int = 50_000
    """How many motions to choose from when planning."""
    rig: Annotated[str, argument("RIG")] = "virtual"
    """What carries out the casts: virtual, engine, or your own robot as package.module:factory."""

    def run(self) -> None:
        """Run the verbs one after the other."""
        from cablecast.cable import load_cable

        out = self.out or cable_folder(load_cable(self.cable).name)
        dataset, model = out / DATASET_FOLDER, out / MODEL_FOLDER
        params = self.params or self._tune(out)
        print("3/5 simulate", file=sys.stderr)
        Simulate(
            cable=self.cable,
            count=self.count,
            out=dataset,
            seed=self.seed,
            device=self.device,
            params=params,
        ).run()
        print("4/5 train", file=sys.stderr)
        Train(
            cable=self.cable,
            dataset=dataset,
            out=model,
            seed=self.seed,
            device=self.device,
            epochs=self.epochs,
            candidate_count=self.candidate_count,
        ).run()
        print("5/5 evaluate", file=sys.stderr)
        Evaluate(
            cable=self.cable,
            model=model,
            rig=self.rig,
            out=out / evaluation_folder(self.rig),
            seed=self.seed,
        ).run()

    def _tune(self, out: pathlib.Path) -> pathlib.Path:
        """Cast on the rig and tune; returns the folder of the parameters."""
        casts = out / DATA_FOLDERS["tune"]
        print("1/5 cast to tune the simulator", file=sys.stderr)
        Collect(
            rig=self.rig,
            purpose="tune",
            cable=self.cable,
            count=self.tune_count,
            out=casts,
            seed=self.seed,
        ).run()
        print("2/5 tune", file=sys.stderr)
        Tune(
            cable=self.cable,
            dataset=casts,
            out=out / TUNE_FOLDER,
            seed=self.seed,
            device=self.device,
            coarse_generations=COARSE_GENERATIONS,
            fine_generations=FINE_GENERATIONS,
        ).run()
        return out / TUNE_FOLDER
