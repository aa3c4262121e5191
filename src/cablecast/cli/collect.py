"""`cablecast collect`: casts on a robot, to tune the simulator and to fine-tune the model."""

import dataclasses
import pathlib
import typing
from typing import TYPE_CHECKING, Annotated, Any

from cablecast.cli.options import (
    ArcRadius,
    CableName,
    GripSpeed,
    LabFile,
    RigName,
    TimeLimit,
    WithPsi,
    argument,
    casts_text,
)

if TYPE_CHECKING:
    from cablecast.setup import Setup


@dataclasses.dataclass(frozen=True, kw_only=True)
class Collect:
    """Make casts on a real or virtual robot and record each one.

    Each cast starts with a reset and becomes one row: the action, the commanded and the measured
    joints, the track of the cable's free end, and the status. A cast takes about 20 s on a robot;
    80 casts on the virtual rig take about a minute. The same command resumes an interrupted run;
    finished casts are neither lost nor repeated.
    """

    rig: RigName = "virtual"
    purpose: typing.Literal["tune", "real"] = "tune"
    """Purpose of the casts: to tune the simulator, or to fine-tune the model."""
    setup: LabFile = None
    cable: CableName = None
    count: Annotated[int | None, argument("INT", "80 to tune, 200 real")] = None
    """Number of casts."""
    sampling: Annotated[
        typing.Literal["uniform", "grid", "spread"] | None,
        argument("{uniform,grid,spread}", "uniform to tune, grid for real, as in the paper"),
    ] = None
    """Sampling of the actions that the arm can make; spread: simulated landings lie far apart."""
    out: Annotated[
        pathlib.Path | None, argument("DIR", "runs/CABLE/tune-data or runs/CABLE/real-data")
    ] = None
    """Folder of the dataset."""
    seed: int = 0
    """Seed of the actions and of the virtual rig."""
    v_max: GripSpeed = None
    r0: ArcRadius = None
    psi: WithPsi = True
    time_limit: TimeLimit = 120.0
    dry_run: bool = False
    """With an arm, check every path and ask its controller if it is ready, and move nothing."""

    def run(self) -> int | None:
        """Collect, and print the number of casts."""
        from cablecast.cli.options import load_lab, open_rig, picked
        from cablecast.cli.progress import console_progress
        from cablecast.pipeline.collect import check_collect, collect
        from cablecast.runs.places import CASTS_FOLDERS, cable_folder

        setup = load_lab(self.setup, self.cable, v_max=self.v_max, r0=self.r0)
        out = self.out or cable_folder(setup.cable.name) / CASTS_FOLDERS[self.purpose]
        options = picked(self, "purpose", "count", "sampling", "seed")
        check_collect(**options, out=out)
        if self.dry_run:
            return self._dry_run(setup, options)
        with (
            open_rig(self.rig, setup, self.seed, out, self.time_limit) as rig,
            console_progress() as progress,
        ):
            dataset = collect(rig, **options, psi=self.psi, out=out, progress=progress)
        shares = ", ".join(f"{n} {code}" for code, n in dataset.status_counts.items())
        print(f"{casts_text(len(dataset), setup.cable.name)} in {out} ({shares})")
        left = dataset.status_counts.get("off_table", 0)
        if self.sampling != "spread" and 2 * left > len(dataset):
            print(
                "note: most casts left the table; --sampling spread draws such as stay on it in "
                "simulation"
            )
        return None

    def _dry_run(self, setup: "Setup", options: dict[str, Any]) -> int:
        """Print what would be done, and return 2 if something would not go."""
        from cablecast.arm.robot import DRIVERS
        from cablecast.errors import InputError
        from cablecast.pipeline.dry_run import dry_run

        if self.rig not in DRIVERS:
            arms = " or ".join(DRIVERS)
            raise InputError(f"--dry-run is for --rig {arms}, not for {self.rig[:60]}")
        findings = dry_run(setup, self.rig, **options, psi=self.psi)
        for finding in findings:
            mark = "ok  " if finding.problem is None else "NOT "
            print(f"{mark}{finding.what}: {finding.problem or finding.detail}")
        print("Nothing was moved.")
        return 2 if any(finding.problem for finding in findings) else 0
