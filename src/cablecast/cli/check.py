"""`cablecast check`: what casts of a cable can reach, before any of them is made."""

import dataclasses
import math
import pathlib
from typing import TYPE_CHECKING, Annotated

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
from cablecast.errors import InputError

if TYPE_CHECKING:
    from cablecast.setup import Setup


@dataclasses.dataclass(frozen=True, kw_only=True)
class Check(AnyTargetOptions):
    """Say in seconds what casts of this cable, arm and table can reach, and what would reach more.

    Casts that the arm can follow are simulated with the cable as its file describes it, and with
    others that it may be as well. The command prints the share of the table on which they end,
    whether a --target is among it, what keeps them from the rest, and which changes of the
    laboratory reach clearly more in simulation; it draws the places. No robot is needed. The exit
    status is 3 if no cast stays on the table. With --task strike it says where swings pass in the
    air; the status is 3 if a --target cannot be struck.

    It simulates the reset between casts, too. Where that folds the cable, --tune-swing looks for a
    lift and a swing that lay it out straight, half a minute, and writes them to the lab file.
    """

    task: TaskName = None
    setup: LabFile = None
    cable: CableName = None
    v_max: GripSpeed = None
    r0: ArcRadius = None
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/check")] = None
    """Folder of the picture."""
    tune_swing: bool = False
    """Look for a swing of resets and polar casts that lays this cable out, and write it to the lab
    file as its section `polar`."""
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
            if self.tune_swing:
                raise InputError("--tune-swing is for casts onto a table, not for strikes")
            from cablecast.cli.strike import check_strikes

            return check_strikes(self, setup)
        places = self.targets(setup)
        out = self.out or cable_folder(setup.cable.name) / CHECK_FOLDER
        tuned = self._tuned(setup) if self.tune_swing else None
        setup = tuned or setup
        # Before the work, as a folder may be none to write to.
        out.mkdir(parents=True, exist_ok=True)
        found = check(setup, changes=False, seed=self.seed)
        print(f"lab      {_lab_text(setup)}")
        print(found.summary)
        for limit in found.limits:
            print(f"  {limit}")
        # What was just looked for in vain is not advised.
        if found.swing_words and (tuned or not self.tune_swing):
            print(f"swing    {found.swing_words}")
        for xy in places:
            print(f"target   {polar_text(xy)}\n         {found.words_at(xy)}", flush=True)
        with console_progress() as progress:
            found = check(setup, target_xy=places, out=out, seed=self.seed, progress=progress)
        print("Simulated casts reach more with" if found.changes else f"{remedy(())}.")
        for change in found.changes:
            print(f"  {change}")
        if any(change.kind in ("r0", "v_max") for change in found.changes):
            print("`cablecast select` compares r0 and v_max with all casts of a grid.")
        print(f"picture  {out / PICTURE_FILE}")
        return 0 if found.reaches_anything else EXIT_FALLS_SHORT

    def _tuned(self, setup: "Setup") -> "Setup | None":
        """Return the set-up with a swing that is looked for, None if its own is as good."""
        import yaml

        from cablecast.cli.progress import console_progress
        from cablecast.pipeline.check import check, check_tuned
        from cablecast.setup import POLAR_SECTION, update_lab_file

        if self.setup is None or self.cable is not None:
            raise InputError("--tune-swing writes to a lab file: give --setup, without --cable")
        with console_progress() as progress:
            old = check(setup, changes=False, seed=self.seed)
            new = check_tuned(old, seed=self.seed, progress=progress)
        if new is None:
            which = (
                f"with which a reset leaves the free end {100 * old.reset_offset:.0f} cm from "
                "straight ahead in simulation"
            )
            if math.isinf(old.reset_offset):
                which = "which the arm cannot follow"
            print(f"swing    none is better than that of {self.setup}, {which}")
            return None
        section = {POLAR_SECTION: new.setup.to_dict()[POLAR_SECTION]}
        try:
            update_lab_file(self.setup, section)
        except InputError:
            # What half a minute found is not lost.
            print(yaml.safe_dump(section, sort_keys=False))
            raise
        before = f"{100 * old.reset_offset:.0f} cm with the old one"
        if math.isinf(old.reset_offset):
            before = "the arm could not follow the old one"
        print(
            f"swing    the new one of {self.setup}, section `{POLAR_SECTION}`, leaves the free end "
            f"{100 * new.reset_offset:.0f} cm from straight ahead in simulation; {before}"
        )
        return new.setup


def _lab_text(setup: "Setup") -> str:
    """Return what is assumed of a lab where its file says nothing, in one line."""
    arm, table, motion = setup.arm, setup.workspace, setup.motion
    return (
        f"{arm.model}, base {arm.base_height:g} m above the table, r_max = {table.r_max:.3g} m, "
        f"reset_y = {table.reset_y:.3g} m, r0 = {motion.r0:.3g} m, v_max = {motion.v_max:g} m/s"
    )
