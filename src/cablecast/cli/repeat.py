"""`cablecast repeat`: repeat equal casts, and measure the scatter of their landings."""

import dataclasses
import pathlib
import typing
from typing import Annotated, Any

from cablecast.cli.options import ArcRadius, CableName, LabFile, RigName, TimeLimit, argument

# The names of pipeline.repeat.COMBINATIONS, which would take NumPy to import.
Combination = typing.Literal["1.2", "1.5", "1.5-psi", "1.8", "1.8-psi"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Repeat:
    """Repeat equal casts on a real or virtual robot, and measure the scatter of their landings.

    For each combination of speed and wrist turn, every action of the paper's grid that the arm can
    make is cast several times. Writes the casts, a table of the actions (actions.csv), the landings
    with their 95 % confidence ellipses (repeatability.png) and metrics.json, and prints the scatter
    next to the paper's. By default these are 370 casts: four minutes on the virtual rig, two hours
    on a robot. The same command resumes an interrupted run.
    """

    rig: RigName = "virtual"
    setup: LabFile = None
    cable: CableName = None
    combinations: Annotated[tuple[Combination, ...], argument("{1.2,1.5,1.5-psi,1.8,1.8-psi}")] = (
        "1.5-psi",
    )
    """Speeds of the gripper [m/s], with -psi where the wrist turns as well."""
    repeats: int = 5
    """Casts of each action."""
    action_count: Annotated[int | None, argument("INT", "all that the arm can make")] = None
    """Number of actions of each grid, drawn at random."""
    actions: Annotated[pathlib.Path | None, argument("FILE", "the paper's grids")] = None
    """Repeat the actions of this CSV file, whose header is `theta1_deg,theta2_deg,r2_m,psi_deg`,
    and `,pace` if it is not 1."""
    r0: ArcRadius = None
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/repeat-RIG")] = None
    """Folder of the results."""
    seed: int = 0
    """Seed of the actions and of the virtual rig."""
    time_limit: TimeLimit = 120.0

    def run(self) -> None:
        """Repeat, and print the table."""
        from cablecast.cli.options import load_lab, open_rig, picked
        from cablecast.cli.progress import console_progress
        from cablecast.pipeline.repeat import (
            ACTIONS_FILE,
            FIGURE_FILE,
            check_repeat,
            read_actions,
            repeat,
        )
        from cablecast.runs.places import cable_folder, rig_folder

        setup = load_lab(self.setup, self.cable, r0=self.r0)
        chosen = None if self.actions is None else read_actions(self.actions)
        out = self.out or cable_folder(setup.cable.name) / rig_folder("repeat", self.rig)
        options = picked(self, "combinations", "repeats", "action_count", "seed")
        options |= {"actions": chosen, "out": out}
        check_repeat(**options)
        with (
            open_rig(self.rig, setup, self.seed, out, self.time_limit) as rig,
            console_progress() as progress,
        ):
            repeated = repeat(rig, **options, progress=progress)
        print_table(repeated.metrics["combinations"], self.rig)
        print(f"metrics  {out / 'metrics.json'}\nfigure   {out / FIGURE_FILE}")
        for name in self.combinations:
            print(f"actions  {out / name / ACTIONS_FILE}")


def print_table(combinations: list[dict[str, Any]], rig: str) -> None:
    """Print our scatter next to the paper's."""
    from cablecast.cli import tables
    from cablecast.evaluation.coverage import published_candidate
    from cablecast.report.tables import pct, share_pct

    title = "Scatter of equal casts, in % of cable length"
    caption = "The paper's figures are those of cable 1 on a real UR5."
    heads = ("v_max", "casts", "rms", "sd", "paper", "off table", "paper", "along arc")
    table = tables.make_table(title, *heads, caption=caption)
    for values in combinations:
        published = published_candidate(values["v_max"], values["with_psi"])
        off_table = None if published is None else published.off_table_share
        table.add_row(
            f"{values['v_max']:g}{' with psi' if values['with_psi'] else ''}",
            str(values["cast_count"]),
            f"{pct(values['scatter_pct'], 2)} ± {pct(values['scatter_standard_error_pct'], 2)}",
            pct(values["distance_sd_pct"], 2),
            pct(None if published is None else published.scatter_pct, 2),
            share_pct(values["off_table_share"]),
            share_pct(off_table),
            share_pct(values["along_arc_share"]),
        )
    tables.print_table(
        table,
        f"Casts on the {rig} rig. rms and sd: root mean square and, in the paper's words, standard "
        "deviation of the distance to the mean landing of an action, averaged over actions, the "
        "first with the standard error of that average; casts off the table are left out. Along "
        "arc: its share across the direction from the robot, 50 % where it is round.",
    )
