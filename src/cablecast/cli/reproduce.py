"""`cablecast reproduce`: every experiment of the paper, and one report of them all."""

import dataclasses
import pathlib
import sys
from typing import TYPE_CHECKING, Annotated, Any

from cablecast.cli.options import RUNS_FOLDER, Device, argument
from cablecast.cli.reproduce_stages import FULL, QUICK, Budget, make_stages

if TYPE_CHECKING:
    from cablecast.cli.run_folder import RunFolder

REPRODUCE_FOLDER = "reproduce"
REPORT_FILE = "report.html"
TABLES_FILE = "tables.md"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reproduce:
    """Repeat every experiment of the paper on the virtual rig, and write one report.

    For each cable: cast on the rig, tune the simulator, choose the system parameters, simulate,
    cast again, train, and evaluate every method at the 32 targets. Takes more than an hour on two
    processor cores, with --quick less than ten minutes. Start it again after any interruption, and
    it goes on where it was.
    """

    quick: bool = False
    """One cable, and less of everything."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/reproduce, runs/reproduce-quick")] = (
        None
    )
    """Where to put everything."""
    rig: Annotated[str, argument("RIG")] = "virtual"
    """What carries out the casts: virtual, engine, or your own robot as package.module:factory."""
    seed: int = 0
    """Chooses everything that is drawn by chance."""
    device: Device = "cpu"
    """Simulate and train on the processor or on an NVIDIA graphics card."""

    def run(self) -> None:
        """Run every stage that is not done, and write the report."""
        self.run_budget(QUICK if self.quick else FULL)

    def run_budget(self, budget: Budget) -> None:
        """Do the same with another budget, and say where the report is."""
        from cablecast.cli.run_folder import RunFolder
        from cablecast.cli.stages import run_stages

        name = REPRODUCE_FOLDER + "-quick" * self.quick
        out = self.out or RUNS_FOLDER / name
        settings = {
            "quick": self.quick,
            "rig": self.rig,
            "seed": self.seed,
            "device": self.device,
            "budget": dataclasses.asdict(budget),
        }
        run = RunFolder.open(out, "reproduce", settings)
        run.begin()
        stages = make_stages(out, budget, self.rig, self.seed, self.device)
        log = run_stages(stages, out)
        print("Writing the report", file=sys.stderr)
        times = [(stage.title, log.seconds.get(stage.name, 0.0)) for stage in stages]
        self._report(run, budget, times)
        print(f"tables   {out / TABLES_FILE}\nreport   {out / REPORT_FILE}")

    def _report(self, run: "RunFolder", budget: Budget, times: list[tuple[str, float]]) -> None:
        from cablecast.files import write_text
        from cablecast.report.reproduction import Reproduction
        from cablecast.report.reproduction_page import reproduction_page

        results = Reproduction(folder=run.path, cables=budget.cables)
        page, tables = reproduction_page(results, run.config, times)
        write_text(run.path / REPORT_FILE, page)
        write_text(run.path / TABLES_FILE, "\n".join(table.to_markdown() for table in tables))
        metrics: dict[str, Any] = {
            "evaluations": {cable: results.evaluations(cable) for cable in budget.cables},
            "seconds": dict(times),
        }
        run.finish(metrics)
