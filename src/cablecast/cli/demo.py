"""`cablecast demo`: every step from a cable never seen to casts that hit."""

import dataclasses
import pathlib
from typing import Annotated, Any

from cablecast.cli.evaluate import print_table
from cablecast.cli.options import Device, argument


@dataclasses.dataclass(frozen=True, kw_only=True)
class Demo:
    """Make five casts, fit, simulate, train, aim at 32 targets, and write a report.

    The rig makes five casts, the simulator is fitted to them, a model is trained on many simulated
    casts, and the rig casts at the paper's 32 targets, up to three times each: after every cast the
    model learns, and the next one is corrected. Takes five minutes on two cores. The same
    command resumes an interrupted demo, and shows the results of a finished one. `cablecast aim`
    does the same at targets of your own.
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
    tune_count: int = 5
    """Number of casts to fit the simulator to."""
    tries: int = 3
    """Casts at each target at most."""
    within: Annotated[float, argument("PCT")] = 3.0
    """Distance from the target at which a cast has hit, in % of cable length."""
    count: int = 16_000
    """Number of simulated casts; fewer are faster and less accurate."""
    epochs: int = 60
    """Largest number of passes of the training over them."""
    candidate_count: int = 20_000
    """Number of candidate motions that planning searches."""
    rig: Annotated[str, argument("RIG")] = "virtual"
    """Rig that makes the casts: virtual, engine, or your own robot as package.module:factory."""

    def run(self) -> None:
        """Run the steps one after the other, and print the table of errors."""
        from cablecast.cli.options import load_lab, open_rig
        from cablecast.cli.progress import console_progress
        from cablecast.errors import check_count, check_number
        from cablecast.evaluation.published import published_rows
        from cablecast.pipeline.checks import check_demo
        from cablecast.pipeline.demo import EVALUATION_FOLDER, FOLDERS, demo
        from cablecast.pipeline.evaluate import REPORT_FILE
        from cablecast.runs.places import RUNS_FOLDER, cable_folder
        from cablecast.tuning.tuned import load_tuned

        check_number("within", self.within, 0.01, 100.0, "%")
        check_count("tries", self.tries, 1, 1000)
        setup = load_lab(self.setup, self.cable)
        name = setup.cable.name
        out = self.out or RUNS_FOLDER / f"demo-{cable_folder(name).name}"
        tuned = None if self.params is None else load_tuned(self.params, setup)
        check_demo(
            setup=setup,
            tune_count=self.tune_count,
            count=self.count,
            epochs=self.epochs,
            candidate_count=self.candidate_count,
            seed=self.seed,
            device=self.device,
            out=out,
            folders=FOLDERS,
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
                tries=self.tries,
                within_pct=self.within,
                seed=self.seed,
                device=self.device,
                progress=progress,
            )
        print_tries(evaluation.metrics)
        print_table(evaluation.metrics, published_rows(name))
        print(f"report   {out / EVALUATION_FOLDER / REPORT_FILE}")


def print_tries(metrics: dict[str, Any]) -> None:
    """Print the errors after each try.

    Args:
        metrics: Content of metrics.json of a demo.
    """
    from cablecast.cli import tables
    from cablecast.report.tables import pct

    table = tables.make_table("Miss after each try, in % of cable length; no landing is a miss")
    for name in ("try", "median", "q1", "q3", "without landing"):
        table.add_column(name, justify="right")
    for row in metrics["tries"]:
        names = ("median_pct", "first_quartile_pct", "third_quartile_pct")
        cells = [pct(row[name]) for name in names]
        table.add_row(str(row["try"]), *cells, str(row["without_landing"]))
    tables.print_table(
        table, f"{metrics['cast_count']} real casts in all. The table below is of the last tries."
    )
