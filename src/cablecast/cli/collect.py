"""`cablecast collect`: trials on a robot, to tune the simulator and to fine-tune the model."""

import dataclasses
import pathlib
import typing
from typing import Annotated

from cablecast.cli.options import DEFAULT_CABLE, argument, cable_folder

DATA_FOLDERS = {"tune": "tune-data", "real": "real-data"}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Collect:
    """Make casts on a robot, real or virtual, and record each one.

    Each cast begins with a reset and becomes one row: the action, the joints as commanded and as
    they moved, the track of the cable's free end, and how the trial ended. A cast on a robot takes
    about 20 s. A run that was stopped, in whatever way, goes on when it is started again; finished
    casts are neither lost nor repeated.
    """

    rig: Annotated[str, argument("RIG")] = "virtual"
    """What carries out the casts: virtual (a laboratory in software), engine (the simulator), or
    your own robot as package.module:factory."""
    purpose: typing.Literal["tune", "real"] = "tune"
    """What the casts are for: to tune the simulator, or to fine-tune the model."""
    cable: Annotated[str, argument("CABLE")] = DEFAULT_CABLE
    """Which cable: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    count: Annotated[int | None, argument("INT", "80 to tune, of which 20 validate; 200 real")] = (
        None
    )
    """How many casts."""
    sampling: Annotated[
        typing.Literal["uniform", "grid"] | None,
        argument("{uniform,grid}", "uniform to tune, grid for real, as in the paper"),
    ] = None
    """How the actions are chosen among those that the arm can make."""
    out: Annotated[
        pathlib.Path | None, argument("DIR", "runs/CABLE/tune-data or runs/CABLE/real-data")
    ] = None
    """Where to put the dataset."""
    seed: int = 0
    """Chooses the actions, and all that the virtual rig draws by chance."""
    v_max: Annotated[float, argument("M/S")] = 1.5
    """How fast the gripper may move [m/s]."""
    r0: Annotated[float, argument("M")] = 0.6
    """Radius of the arcs that the gripper sweeps, at their start [m]."""
    psi: bool = True
    """Whether the wrist turns; if not, the actions are of the set A1 of the paper."""

    def run(self) -> None:
        """Collect, and say what came out."""
        from cablecast.cable import load_cable
        from cablecast.cli.run_folder import record_run
        from cablecast.datasets.collect import collect_dataset, rig_seed
        from cablecast.datasets.progress import console_progress
        from cablecast.motion.action import ActionRanges, MotionConfig
        from cablecast.rigs.base import make_rig
        from cablecast.workspace import Workspace

        cable = load_cable(self.cable)
        config = MotionConfig(r0=self.r0, v_max=self.v_max)
        workspace = Workspace()
        out = self.out or cable_folder(cable.name) / DATA_FOLDERS[self.purpose]
        rig = make_rig(self.rig, cable, workspace, rig_seed(self.seed, self.purpose))
        try:
            with console_progress(f"Casting {cable.name} on the {self.rig} rig") as progress:
                dataset = collect_dataset(
                    out,
                    rig,
                    cable,
                    config,
                    workspace,
                    purpose=self.purpose,
                    count=self.count,
                    sampling=self.sampling or ("uniform" if self.purpose == "tune" else "grid"),
                    seed=self.seed,
                    ranges=ActionRanges.for_config(config, self.psi),
                    progress=progress,
                )
        finally:
            rig.close()
        counts = dataset.info["status_counts"]
        record_run(
            out,
            "collect",
            dataset.info["settings"] | {"purpose": self.purpose},
            {"cast_count": len(dataset), "status_counts": counts},
        )
        shares = ", ".join(f"{n} {code}" for code, n in counts.items())
        print(f"{len(dataset)} casts of {cable.name} are in {out} ({shares})")
