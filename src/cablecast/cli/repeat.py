"""`cablecast repeat`: make equal casts again and again, and measure how far apart they land."""

import dataclasses
import pathlib
import re
import sys
import typing
from typing import TYPE_CHECKING, Annotated, Any

from cablecast.cli.options import DEFAULT_CABLE, argument, cable_folder

if TYPE_CHECKING:
    from cablecast.evaluation.repeatability import Repeatability

FIGURE_FILE = "repeatability.png"
ACTIONS_FILE = "actions.csv"

# What the paper repeated (section V-E), by its own words: the speed, and whether the wrist turns.
COMBINATIONS = {
    "1.2": (1.2, False),
    "1.5": (1.5, False),
    "1.5-psi": (1.5, True),
    "1.8": (1.8, False),
    "1.8-psi": (1.8, True),
}
Combination = typing.Literal["1.2", "1.5", "1.5-psi", "1.8", "1.8-psi"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Repeat:
    """Repeat casts on a robot, real or virtual, and measure how far apart equal casts land.

    For each combination of speed and wrist turn, the actions of the paper's grid that the arm can
    make are each cast several times. Writes the casts, a table of the actions (actions.csv), the
    landings with their 95 % confidence ellipses (repeatability.png) and metrics.json, and prints
    the scatter beside the paper's. A run that was stopped goes on when it is started again.
    """

    rig: Annotated[str, argument("RIG")] = "virtual"
    """What carries out the casts: virtual (a laboratory in software), engine (the simulator), or
    your own robot as package.module:factory."""
    cable: Annotated[str, argument("CABLE")] = DEFAULT_CABLE
    """Which cable: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    combinations: Annotated[tuple[Combination, ...], argument("{1.2,1.5,1.5-psi,1.8,1.8-psi}")] = (
        "1.5-psi",
    )
    """Speeds of the gripper [m/s], with psi where the wrist turns, too."""
    repeats: int = 5
    """How many casts of each action."""
    action_count: Annotated[int | None, argument("INT", "all that the arm can make")] = None
    """Repeat only as many actions of each grid, chosen by chance."""
    actions: Annotated[pathlib.Path | None, argument("FILE", "the paper's grids")] = None
    """Repeat these actions instead: a CSV file with a line `theta1_deg,theta2_deg,r2_m,psi_deg`."""
    r0: Annotated[float, argument("M")] = 0.6
    """Radius of the arcs that the gripper sweeps, at their start [m]."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/repeat-RIG")] = None
    """Where to put the results."""
    seed: int = 0
    """Chooses the actions, and all that the virtual rig draws by chance."""

    def run(self) -> None:
        """Repeat, write the results, and print the table."""
        from cablecast.cable import load_cable
        from cablecast.cli.run_folder import RunFolder
        from cablecast.evaluation.repeatability import save_actions
        from cablecast.files import write_bytes
        from cablecast.report.repeatability import repeatability_map
        from cablecast.report.style import new_figure, png_bytes
        from cablecast.workspace import Workspace

        cable, workspace = load_cable(self.cable), Workspace()
        chosen = None if self.actions is None else read_actions(self.actions)
        folder = "repeat-" + re.sub(r"[^\w.-]+", "-", self.rig)
        out = self.out or cable_folder(cable.name) / folder
        settings = {
            "cable": cable.to_dict(),
            "rig": self.rig,
            "repeats": self.repeats,
            "action_count": self.action_count,
            "actions": None if chosen is None else chosen.tolist(),
            "r0": self.r0,
            "seed": self.seed,
        }
        run = RunFolder.open(out, "repeat", settings)
        new_figure(1, 1)  # Says at once, not after hours of casts, if matplotlib is missing.
        results = []
        for name in self.combinations:
            result = self._repeat(run, name, cable, workspace, chosen)
            save_actions(result, out / name / ACTIONS_FILE)
            results.append(result)
        print("Drawing the landings", file=sys.stderr)
        write_bytes(out / FIGURE_FILE, png_bytes(repeatability_map(results, workspace)))
        metrics = [result.to_dict() for result in results]
        run.finish({"combinations": metrics})
        print_table(metrics, self.rig)
        print(f"metrics  {out / 'metrics.json'}\nfigure   {out / FIGURE_FILE}")
        for name in self.combinations:
            print(f"actions  {out / name / ACTIONS_FILE}")

    def _repeat(self, run: Any, name: str, cable, workspace, chosen) -> "Repeatability":
        from cablecast.datasets.collect import rig_seed
        from cablecast.datasets.progress import console_progress
        from cablecast.evaluation.repeatability import measure_repeatability, repeat_actions
        from cablecast.motion.action import MotionConfig
        from cablecast.rigs.base import make_rig

        v_max, with_psi = COMBINATIONS[name]
        config = MotionConfig(r0=self.r0, v_max=v_max)
        actions = chosen
        if actions is None:
            actions = repeat_actions(
                config,
                workspace,
                with_psi=with_psi,
                action_count=self.action_count,
                seed=self.seed,
            )
        rig = make_rig(self.rig, cable, workspace, rig_seed(self.seed, "repeat"))
        try:
            run.begin()
            with console_progress(f"Repeating {len(actions)} casts, v_max {name}") as progress:
                return measure_repeatability(
                    run.path / name / "casts",
                    rig,
                    cable,
                    config,
                    workspace,
                    actions=actions,
                    repeats=self.repeats,
                    progress=progress,
                )
        finally:
            rig.close()


def read_actions(file: pathlib.Path):
    """Actions from a CSV file with the columns theta1_deg, theta2_deg, r2_m and psi_deg.

    Raises:
        InputError: It cannot be read, or holds something that is no action.
    """
    import csv

    import numpy as np

    from cablecast.errors import InputError
    from cablecast.motion.action import check_action_values

    names = ("theta1_deg", "theta2_deg", "r2_m", "psi_deg")
    try:
        rows = list(csv.DictReader(file.read_text().splitlines()))
        values = np.array([[float(row[name]) for name in names] for row in rows]).reshape(-1, 4)
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise InputError(
            f"{file} must be a CSV file with the columns {', '.join(names)} ({error!r})"
        ) from None
    if not len(values):
        raise InputError(f"{file} holds no action")
    values[:, [0, 1, 3]] = np.radians(values[:, [0, 1, 3]])
    return check_action_values(values)


def print_table(combinations: list[dict[str, Any]], rig: str) -> None:
    """Print our scatter beside the paper's.

    Args:
        combinations: What metrics.json holds of each.
        rig: What carried out the casts.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from cablecast.evaluation.published import published_repeatability

    table = Table(title="Scatter of equal casts, in % of cable length", box=box.SIMPLE)
    table.caption = "The paper's figures are those of cable 1 on a real UR5."
    table.add_column("v_max", no_wrap=True)
    for name in ("casts", "scatter", "paper", "off table", "paper", "along arc"):
        table.add_column(name, justify="right", no_wrap=True)
    for values in combinations:
        published = published_repeatability(values["v_max"], values["with_psi"])
        off_table = None if published is None else published.off_table_share
        table.add_row(
            f"{values['v_max']:g}{' with psi' if values['with_psi'] else ''}",
            str(values["cast_count"]),
            f"{_number(values['scatter_pct'], 2)} ± "
            f"{_number(values['scatter_standard_error_pct'], 2)}",
            _number(None if published is None else published.scatter_pct, 2),
            _percent(values["off_table_share"]),
            _percent(off_table),
            _percent(values["along_arc_share"]),
        )
    console = Console()
    console.print(table)
    console.print(
        f"Casts on the {rig} rig. Scatter: standard deviation about the mean landing of an action, "
        "averaged over actions, with the standard error of that average; casts off the table are "
        "left out. Along arc: its share across the direction from the robot, 50 % where it is "
        "round.",
        highlight=False,
        soft_wrap=True,
    )


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f} %"
