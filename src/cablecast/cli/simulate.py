"""`cablecast simulate`: make the dataset that the model learns from."""

import dataclasses
import pathlib
import sys
from typing import Annotated

from cablecast.cli.options import DATASET_FOLDER, DEFAULT_CABLE, Device, argument, cable_folder


@dataclasses.dataclass(frozen=True, kw_only=True)
class Simulate:
    """Simulate many casts of a cable and record where each one lands.

    The actions are spread evenly over what the arm can do. The result is a folder of Parquet files
    with a README. A run that was interrupted, in whatever way, goes on when it is started again.
    """

    cable: Annotated[str, argument("CABLE")] = DEFAULT_CABLE
    """Which cable: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    count: int = 36_000
    """How many casts."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/dataset")] = None
    """Where to put the dataset."""
    seed: int = 0
    """Chooses the actions. The same seed gives the same dataset."""
    device: Device = "cpu"
    """Simulate on the processor or on an NVIDIA graphics card."""
    params: Annotated[pathlib.Path | None, argument("FILE", "what the cable says of itself")] = None
    """Parameters of the cable, and lag of the arm, that `cablecast tune` found (params.json)."""
    v_max: Annotated[float, argument("M/S")] = 1.5
    """How fast the gripper may move [m/s]. Faster casts reach farther and scatter more."""
    r0: Annotated[float, argument("M")] = 0.6
    """Radius of the arcs that the gripper sweeps, at their start [m]; larger is flatter."""
    psi: bool = True
    """Whether the wrist turns; if not, the actions are of the set A1 of the paper."""
    segment_count: Annotated[int | None, argument("INT", "what the convergence study chose")] = None
    """How many segments the simulated cable has."""
    dt: Annotated[float | None, argument("S", "what the convergence study chose")] = None
    """Time step of the simulation [s]."""

    def run(self) -> None:
        """Simulate, and say what came out."""
        from cablecast.cable import load_cable
        from cablecast.cli.run_folder import record_run
        from cablecast.datasets.progress import console_progress
        from cablecast.datasets.simulate import simulate_dataset
        from cablecast.engines.warp_ import EngineWarp
        from cablecast.motion.action import ActionRanges, MotionConfig
        from cablecast.tuning import read_params, read_servo
        from cablecast.workspace import Workspace

        cable = load_cable(self.cable)
        params, servo = cable.params, None
        if self.params is not None:
            params, servo = read_params(self.params, cable), read_servo(self.params)
        config = MotionConfig(r0=self.r0, v_max=self.v_max)
        resolution = {"segment_count": self.segment_count, "dt": self.dt}
        engine = EngineWarp(
            device=self.device,
            **{name: value for name, value in resolution.items() if value is not None},
        )
        out = self.out or cable_folder(cable.name) / DATASET_FOLDER
        print(f"Choosing {self.count} motions that the arm can make", file=sys.stderr)
        with console_progress(f"Simulating {cable.name}") as progress:
            dataset = simulate_dataset(
                out,
                cable,
                params,
                engine,
                config,
                Workspace(),
                count=self.count,
                seed=self.seed,
                progress=progress,
                ranges=ActionRanges.for_config(config, self.psi),
                servo=servo,
            )
        counts = dataset.info["status_counts"]
        record_run(
            out,
            "simulate",
            dataset.info["settings"] | {"device": self.device},
            {"cast_count": len(dataset), "status_counts": counts},
        )
        shares = ", ".join(f"{100 * n / len(dataset):.1f} % {code}" for code, n in counts.items())
        print(f"{len(dataset)} casts of {cable.name} are in {out} ({shares})")
