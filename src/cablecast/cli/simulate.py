"""`cablecast simulate`: make the dataset that the model is trained on."""

import dataclasses
import pathlib
from typing import Annotated

from cablecast.cli.options import (
    ArcRadius,
    CableName,
    Engine,
    GripSpeed,
    LabFile,
    SimulatorDevice,
    TunedParams,
    WithPsi,
    Workers,
    argument,
    casts_text,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Simulate:
    """Simulate many casts of a cable and record where each one lands.

    The actions cover what the arm can do evenly. The result is a folder of Parquet files with a
    README. 36,000 casts take about half a minute on two cores. The same command resumes an
    interrupted run.
    """

    setup: LabFile = None
    cable: CableName = None
    count: int = 36_000
    """Number of casts."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/dataset")] = None
    """Folder of the dataset."""
    seed: int = 0
    """Seed of the actions. The same seed gives the same dataset."""
    engine: Engine = "warp"
    device: SimulatorDevice = "cpu"
    workers: Workers = "local"
    params: TunedParams = None
    v_max: GripSpeed = None
    r0: ArcRadius = None
    psi: WithPsi = True
    segment_count: Annotated[int | None, argument("INT", "the engine's")] = None
    """Segments of the simulated cable."""
    dt: Annotated[float | None, argument("S", "the engine's")] = None
    """Time step of the simulation [s]."""

    def run(self) -> None:
        """Simulate, and print the number of casts."""
        from cablecast.cli.options import load_lab, picked
        from cablecast.cli.progress import console_progress
        from cablecast.pipeline.simulate import simulate
        from cablecast.runs.places import DATASET_FOLDER, TUNE_FOLDER, cable_folder
        from cablecast.tuning.tuned import PARAMS_FILE, load_tuned

        setup = load_lab(self.setup, self.cable, v_max=self.v_max, r0=self.r0)
        out = self.out or cable_folder(setup.cable.name) / DATASET_FOLDER
        tuned = None if self.params is None else load_tuned(self.params, setup)
        options = picked(self, "count", "psi", "seed", "engine", "device", "workers")
        options |= picked(self, "segment_count", "dt")
        with console_progress() as progress:
            dataset = simulate(setup, tuned, **options, out=out, progress=progress)
        counts = dataset.status_counts
        shares = ", ".join(f"{100 * n / len(dataset):.1f} % {code}" for code, n in counts.items())
        print(f"{casts_text(len(dataset), setup.cable.name)} in {out} ({shares})")
        fitted = cable_folder(setup.cable.name) / TUNE_FOLDER
        if tuned is None and (fitted / PARAMS_FILE).exists():
            print(
                "note: they have the values of the cable's file; for those that `cablecast tune` "
                f"fitted, add --params {fitted} and another --out"
            )
