"""simulate: many casts in the simulator, to train the model on."""

import dataclasses
import os
from typing import Any

from cablecast.cable import CableParams
from cablecast.data.dataset import Dataset
from cablecast.data.simulate import SIMULATED_COUNT, simulate_dataset
from cablecast.engines import EngineName, make_engine
from cablecast.errors import check_argument_types
from cablecast.motion.feasibility import feasible_ranges
from cablecast.pipeline.places import folder_or_temporary
from cablecast.runs.folder import record_run
from cablecast.runs.progress import Progress, ProgressCallback, show
from cablecast.runs.workers import LOCAL, check_workers
from cablecast.setup import Setup
from cablecast.tuning.tuned import Tuned


@check_argument_types
def simulate(
    setup: Setup,
    tuned: Tuned | CableParams | None = None,
    *,
    count: int = SIMULATED_COUNT,
    psi: bool = True,
    pace: tuple[float, float] = (1.0, 1.0),
    seed: int = 0,
    engine: EngineName = "warp",
    segment_count: int | None = None,
    dt: float | None = None,
    device: str = "cpu",
    workers: str = LOCAL,
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = show,
) -> Dataset:
    """Simulate casts and record where each one lands (D_sim of section V-F).

    The actions are spread evenly over what the arm can do. A curl that `tune` found is left out:
    planning takes casts to the left for mirrored ones to the right. `aim` adds it again.

    Args:
        setup: Cable, workspace, arm and motion settings.
        tuned: Parameters of the cable and servo of the arm that `tune` found, or parameters alone.
            The cable's own parameters and an arm without lag if None.
        count: Number of casts.
        psi: Whether the wrist turns (the action set A2 of the paper).
        pace: Range of the pace [-]; the paper's alone by default.
        seed: Seed of the actions. The same seed gives the same dataset.
        engine: Simulator, see `make_engine`.
        segment_count: Segments of the simulated cable; the engine's default if None.
        dt: Time step [s]; the engine's default if None.
        device: "cpu" or "cuda".
        workers: Who simulates: "local", "ray" for a cluster on this machine, or "ray:ADDRESS".
        out: Folder that keeps the dataset and lets a stopped run go on; none if None.
        progress: Receives the number of casts done.

    Raises:
        DatasetError: The folder holds something else.
        InputError: A value out of bounds.
    """
    check_workers(workers)
    tuned = Tuned.of(tuned, setup)
    simulator = make_engine(engine, segment_count, dt, device)
    progress(Progress(task=f"Choosing {count} motions that the arm can follow"))
    with folder_or_temporary(out) as folder:
        dataset = simulate_dataset(
            folder,
            setup,
            tuned.dynamics.without_curl(),
            simulator,
            count=count,
            seed=seed,
            ranges=feasible_ranges(setup, psi, pace),
            workers=workers,
            progress=progress,
        )
        if out is not None:
            settings = {**dataset.settings.values, "device": device}
            record_run(folder, "simulate", settings, dataset.status_counts)
    return dataset


def simulate_to_aim(setup: Setup, tuned: Tuned, **options: Any) -> Dataset:
    """Simulate the casts that the model of `aim` is trained on.

    They are those of the first simulator of the ensemble, at its resolution: what the others add to
    a landing leads from there. Without an ensemble they are those of `simulate`, whose arguments
    the options are; a resolution that is given holds.
    """
    if not tuned.members:
        return simulate(setup, tuned, **options)
    first = dataclasses.replace(tuned, dynamics=tuned.members[0])
    segment_count, dt = tuned.member_resolution
    resolution: dict[str, Any] = {"segment_count": segment_count, "dt": dt}
    return simulate(setup, first, **(resolution | options))
