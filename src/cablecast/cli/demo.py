"""`cablecast demo`: every step from a cable to a report."""

import dataclasses
import pathlib
from typing import Annotated

from cablecast.cli.evaluate import print_table
from cablecast.cli.options import Device, argument


@dataclasses.dataclass(frozen=True, kw_only=True)
class Demo:
    """Cast, tune, simulate, train and evaluate with one cable, and write a report.

    The rig makes some casts, the simulator is tuned to them, a model is trained on many simulated
    casts, and the rig casts at the paper's 32 targets. Takes a few minutes on two cores. The same
    command resumes an interrupted demo, and shows the results of a finished one. `cablecast
    reproduce` does more of everything.
    """

    setup: Annotated[pathlib.Path | None, argument("FILE", "the paper's set-up")] = None
    """Lab file that describes cable, table, arm and motion."""
    cable: Annotated[str | None, argument("CABLE", "that of --setup, or cable_1")] = None
    """Cable in the gripper: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/demo-CABLE")] = None
    """Folder of all results."""
    seed: int = 0
    """Seed of all random numbers."""
    device: Device = "cpu"
    """Simulate and train on the processor or on an NVIDIA graphics card."""
    params: Annotated[pathlib.Path | None, argument("FILE", "those that the demo finds")] = None
    """Parameters that `cablecast tune` found (params.json); casts and tuning are skipped."""
    tune_count: int = 40
    """Number of casts to tune the simulator with."""
    count: int = 16_000
    """Number of simulated casts; fewer are faster and less accurate."""
    epochs: int = 60
    """Largest number of passes of the training over them."""
    candidate_count: int = 50_000
    """Number of candidate motions that planning searches."""
    rig: Annotated[str, argument("RIG")] = "virtual"
    """Rig that makes the casts: virtual, engine, or your own robot as package.module:factory."""

    def run(self) -> None:
        """Run the steps one after the other, and print the table of errors."""
        from cablecast.cli.options import load_lab, open_rig
        from cablecast.cli.progress import console_progress
        from cablecast.evaluation.published import published_rows
        from cablecast.pipeline.checks import check_demo
        from cablecast.pipeline.demo import EVALUATION_FOLDER, demo
        from cablecast.pipeline.evaluate import REPORT_FILE
        from cablecast.pipeline.tuned import load_tuned
        from cablecast.runs.places import (
            CASTS_FOLDERS,
            DATASET_FOLDER,
            MODEL_FOLDER,
            RUNS_FOLDER,
            TUNE_FOLDER,
            cable_folder,
        )

        setup = load_lab(self.setup, self.cable)
        name = setup.cable.name
        out = self.out or RUNS_FOLDER / f"demo-{cable_folder(name).name}"
        tuned = None if self.params is None else load_tuned(self.params, setup)
        made = {CASTS_FOLDERS["tune"], TUNE_FOLDER, DATASET_FOLDER, MODEL_FOLDER, EVALUATION_FOLDER}
        check_demo(
            setup=setup,
            tune_count=self.tune_count,
            count=self.count,
            epochs=self.epochs,
            candidate_count=self.candidate_count,
            seed=self.seed,
            device=self.device,
            out=out,
            folders=made,
        )
        with (
            open_rig(self.rig, setup, self.seed, out) as rig,
            console_progress() as progress,
        ):
            evaluation = demo(
                rig,
                out,
                tuned=tuned,
                tune_count=self.tune_count,
                count=self.count,
                epochs=self.epochs,
                candidate_count=self.candidate_count,
                seed=self.seed,
                device=self.device,
                progress=progress,
            )
        print_table(evaluation.metrics, published_rows(name))
        print(f"report   {out / EVALUATION_FOLDER / REPORT_FILE}")
