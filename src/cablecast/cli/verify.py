"""`cablecast verify`: repeat the headline on small data."""

import dataclasses
import pathlib
from typing import Annotated

from cablecast.cli.options import argument

EXIT_DIFFERS = 3


@dataclasses.dataclass(frozen=True, kw_only=True)
class Verify:
    """Repeat the headline on small data, and say by how much it differs.

    Casts, tunes, simulates, trains, corrects and evaluates with cable_1 on the virtual rig, with
    about a hundredth of the headline's budget, in a few minutes on two free cores, and prints each
    figure beside that of the README. A small budget makes the errors larger; a difference beyond
    the bound says that something is wrong.
    """

    out: Annotated[pathlib.Path | None, argument("DIR", "runs/verify")] = None
    """Folder of all results; the same command shows the results of a finished run."""
    difference_max: Annotated[float, argument("PCT")] = 15.0
    """Excess of the median error up to which the status is 0 [% of cable length]; else 3."""

    def run(self) -> int:
        """Verify, and print the figures."""
        from cablecast.cli.progress import console_progress
        from cablecast.cli.tables import make_table, print_table
        from cablecast.errors import check_number
        from cablecast.pipeline.verify import verify
        from cablecast.runs.places import RUNS_FOLDER

        check_number("difference_max", self.difference_max, 0.0, 1e6, "%")
        with console_progress() as progress:
            result = verify(out=self.out or RUNS_FOLDER / "verify", progress=progress)
        table = make_table("The headline on small data, in % of cable length")
        for title in ("figure", "headline", "here", "difference"):
            table.add_column(title, justify="left" if title == "figure" else "right")
        for name, headline, here in result.rows:
            table.add_row(name, f"{headline:.1f}", f"{here:.1f}", f"{here - headline:+.1f}")
        print_table(table)
        return EXIT_DIFFERS if result.difference_pct > self.difference_max else 0
