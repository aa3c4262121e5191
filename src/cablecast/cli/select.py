"""`cablecast select`: choose r0, v_max and the use of the wrist."""

import dataclasses
import pathlib
from typing import Annotated, Any

from cablecast.cli.options import (
    CableName,
    Engine,
    LabFile,
    SimulatorDevice,
    TunedParams,
    Workers,
    argument,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Select:
    """Compare the coverage of several r0 and v_max, and choose the best.

    Simulates nine combinations of r0 and v_max without a turn of the wrist, and the three speeds of
    the best r0 with one. With --repeat, the scatter that `cablecast repeat` measured is weighed
    against coverage. Takes about a minute on two cores. The same command resumes an interrupted
    run.
    """

    setup: LabFile = None
    cable: CableName = None
    params: TunedParams = None
    repeat: Annotated[pathlib.Path | None, argument("DIR", "coverage alone decides")] = None
    """Folder that `cablecast repeat` wrote, with the combinations to choose from."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/select")] = None
    """Folder of the results."""
    scatter_max: Annotated[float, argument("PCT")] = 3.0
    """Largest acceptable scatter of repeated casts, the standard deviation of the distance to their
    mean landing, in % of cable length."""
    grid: int = 15
    """Values of each action variable without a turn of the wrist; the paper used 15."""
    grid_psi: int = 10
    """Values of each action variable with one; the paper used 10, and 5 for the turn itself."""
    engine: Engine = "warp"
    device: SimulatorDevice = "cpu"
    workers: Workers = "local"

    def run(self) -> None:
        """Measure, choose, and print the table."""
        from cablecast.cli.options import load_lab, picked
        from cablecast.cli.progress import console_progress
        from cablecast.pipeline.select import FIGURE_FILE, load_repeated, select
        from cablecast.runs.places import SELECT_FOLDER, cable_folder
        from cablecast.tuning.tuned import load_tuned

        setup = load_lab(self.setup, self.cable)
        out = self.out or cable_folder(setup.cable.name) / SELECT_FOLDER
        with console_progress() as progress:
            selection = select(
                setup,
                None if self.params is None else load_tuned(self.params, setup),
                repeated=None if self.repeat is None else load_repeated(self.repeat, setup.cable),
                scatter_max_pct=self.scatter_max,
                out=out,
                progress=progress,
                **picked(self, "grid", "grid_psi", "engine", "device", "workers"),
            )
        print_choice(selection.metrics)
        print(f"metrics  {out / 'metrics.json'}\nfigure   {out / FIGURE_FILE}")


def print_choice(metrics: dict[str, Any]) -> None:
    """Print the coverage of every combination in metrics.json, and the choice."""
    from cablecast.cli import tables
    from cablecast.pipeline.repeat import combination
    from cablecast.report.tables import pct

    ratio = metrics["coverage"][0]["hull_ratio"]
    heads = ("r0 [m]", "v_max [m/s]", "psi", "casts", "coverage [%]", "scatter [%]")
    caption = f"Concave hulls of ratio {ratio:g}; scatter in % of cable length."
    table = tables.make_table("Share of the reachable half disc", *heads, caption=caption)
    chosen = metrics["choice"]
    for row in metrics["coverage"]:
        scatter_pct = (row["repeatability"] or {}).get("distance_sd_pct")
        table.add_row(
            f"{row['r0']:g}",
            f"{row['v_max']:g}",
            "yes" if row["with_psi"] else "no",
            str(row["feasible_count"]),
            pct(100 * row["share"]),
            "" if scatter_pct is None else pct(scatter_pct, 2),
            style="bold" if combination(row) == combination(chosen) else "",
        )
    table.add_section()
    table.add_row("polar casting", "", "", "", pct(100 * metrics["polar_casting"]["share"]), "")
    tables.print_table(table, *chosen["reasons"])
