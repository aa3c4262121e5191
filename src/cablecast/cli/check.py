"""`cablecast check`: what casts of a cable can reach, before any of them is made."""

import dataclasses
import pathlib
from typing import Annotated

from cablecast.cli.options import (
    EXIT_FALLS_SHORT,
    AnyTargetOptions,
    ArcRadius,
    CableName,
    GripSpeed,
    LabFile,
    TaskName,
    argument,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Check(AnyTargetOptions):
    """Say in seconds what casts of this cable, arm and table can reach, and what would reach more.

    Casts that the arm can follow are simulated with the cable as its file describes it, and with
    others that it may be as well. The command prints the share of the table on which they end,
    whether a --target is among it, what keeps them from the rest, and which changes of the
    laboratory reach clearly more in simulation; it draws the places. No robot is needed. The exit
    status is 3 if no cast stays on the table. With --task strike it says where swings pass in the
    air; the status is 3 if a --target cannot be struck.
    """

    task: TaskName = None
    setup: LabFile = None
    cable: CableName = None
    v_max: GripSpeed = None
    r0: ArcRadius = None
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/check")] = None
    """Folder of the picture."""
    seed: int = 0
    """Seed of the casts, and of what the cable may be."""

    def run(self) -> int:
        """Check, print what was found, and return the exit status."""
        from cablecast.cli.options import load_lab, polar_text
        from cablecast.cli.progress import console_progress
        from cablecast.pipeline.check import PICTURE_FILE, check, remedy
        from cablecast.runs.places import CHECK_FOLDER, cable_folder

        setup = load_lab(self.setup, self.cable, self.task, v_max=self.v_max, r0=self.r0)
        if setup.strike is not None:
            from cablecast.cli.strike import check_strikes

            return check_strikes(self, setup)
        places = self.targets(setup)
        out = self.out or cable_folder(setup.cable.name) / CHECK_FOLDER
        with console_progress() as progress:
            found = check(setup, target_xy=places, out=out, seed=self.seed, progress=progress)
        print(found.summary)
        for limit in found.limits:
            print(f"  {limit}")
        if found.reset_words:
            print(f"reset    {found.reset_words}")
        for xy in places:
            print(f"target   {polar_text(xy)}\n         {found.words_at(xy)}")
        print("Simulated casts reach more with" if found.changes else f"{remedy(())}.")
        for change in found.changes:
            print(f"  {change}")
        if any(change.kind in ("r0", "v_max") for change in found.changes):
            print("`cablecast select` compares r0 and v_max with all casts of a grid.")
        print(f"picture  {out / PICTURE_FILE}")
        return 0 if found.reaches_anything else EXIT_FALLS_SHORT
