"""`cablecast reproduce`: every experiment of the paper in one report."""

import dataclasses
import pathlib
from typing import Annotated

from cablecast.cli.options import EXIT_FALLS_SHORT, Device, Engine, RigName, Workers, argument


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reproduce:
    """Repeat every experiment of the paper and write one report.

    For each cable: cast on the rig, tune the simulator, choose the system parameters, simulate,
    cast again, train, and evaluate every method at the 32 targets. Prints the median error of each
    method; the exit status is 3 if that of the fine-tuned network is not below those of polar
    casting and of a network of real casts alone. Takes an hour or more on two cores, with --quick
    some ten minutes, and an hour with --quick --engine pybullet, the paper's simulator. The same
    command resumes an interrupted run.
    """

    quick: bool = False
    """One cable, and less of everything."""
    setup: Annotated[pathlib.Path | None, argument("FILE", "the paper's set-up")] = None
    """Lab file that describes table, arm and motion; the cables are the paper's."""
    out: Annotated[
        pathlib.Path | None, argument("DIR", "runs/reproduce, runs/reproduce-quick ...")
    ] = None
    """Folder of all results."""
    rig: RigName = "virtual"
    engine: Engine = "warp"
    seed: int = 0
    """Seed of all random numbers."""
    device: Device = "cpu"
    """Simulate and train on the processor or on an NVIDIA graphics card."""
    workers: Workers = "local"

    def run(self) -> int:
        """Run every stage that is not done, and print the order of methods and the report."""
        from cablecast.cli.options import load_lab, picked
        from cablecast.cli.progress import console_progress
        from cablecast.pipeline.reproduce import FULL, QUICK, QUICK_SLOW, reproduce
        from cablecast.report.reproduction import METHOD_NAMES
        from cablecast.runs.places import RUNS_FOLDER

        name = "reproduce" + "-quick" * self.quick
        name += "" if self.engine == "warp" else f"-{self.engine}"
        quick = QUICK if self.engine == "warp" else QUICK_SLOW
        with console_progress() as progress:
            reproduced = reproduce(
                self.out or RUNS_FOLDER / name,
                setup=load_lab(self.setup, None),
                budget=quick if self.quick else FULL,
                progress=progress,
                **picked(self, "rig", "engine", "seed", "device", "workers"),
            )
        print("median error at the 32 targets, in % of cable length:")
        for method, median_pct in reproduced.medians_pct.items():
            print(f"{median_pct:8.1f}  {METHOD_NAMES[method]}")
        print(f"tables   {reproduced.tables}\nreport   {reproduced.report}")
        if reproduced.holds:
            return 0
        print(
            "note: simulated and real casts together do not beat polar casting and real casts alone"
        )
        return EXIT_FALLS_SHORT
