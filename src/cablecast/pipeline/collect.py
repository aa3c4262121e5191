"""collect: casts on a rig, to tune the simulator and to learn from."""

import os

from cablecast.datasets.collect import Purpose, Sampling, collect_dataset
from cablecast.datasets.reader import Dataset
from cablecast.motion.action import ActionRanges
from cablecast.pipeline.checks import check_collect
from cablecast.pipeline.places import folder_or_temporary
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.folder import record_run
from cablecast.runs.progress import ProgressCallback, resumed_counter

SAMPLINGS: dict[str, Sampling] = {"tune": "uniform", "real": "grid"}
"""Choice of actions by purpose, as in the paper."""


def collect(
    rig: CheckedRig,
    *,
    purpose: Purpose = "tune",
    count: int | None = None,
    sampling: Sampling | None = None,
    psi: bool = True,
    seed: int = 0,
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback | None = None,
) -> Dataset:
    """Make casts on a rig and record each one (paper, section V-C).

    Each cast begins with a reset and becomes one row: the action, the joints as commanded and as
    they moved, the track of the cable's free end, and how the cast ended.

    Args:
        rig: Rig that `make_rig` returned; gives the set-up.
        purpose: Purpose of the casts: "tune" (D_tune) or "real" (D_real). Each draws chances of
            its own on a rig that draws any.
        count: Number of casts; the paper's 80 or 200 where None.
        sampling: Choice of actions, "uniform" or "grid"; as in the paper where None.
        psi: Whether the wrist turns (the action set A2 of the paper).
        seed: Seed of the actions.
        out: Folder that keeps the casts and lets a stopped run go on; none where None.
        progress: Told how many casts are done.

    Returns:
        The casts.

    Raises:
        RigError: A cast failed too often.
        DatasetError: The folder holds something else. Casts that are finished are kept.
        InputError: A count or seed out of bounds.
    """
    check_collect(purpose=purpose, count=count, sampling=sampling, seed=seed, out=out)
    setup = rig.setup
    with folder_or_temporary(out) as folder:
        dataset = collect_dataset(
            folder,
            rig,
            setup,
            purpose=purpose,
            count=count,
            sampling=sampling or SAMPLINGS[purpose],
            seed=seed,
            ranges=ActionRanges.for_setup(setup, psi),
            progress=resumed_counter(progress, f"Casting {setup.cable.name}", "casts"),
        )
        if out is not None:
            record_run(
                folder,
                "collect",
                {**dataset.info["settings"], "purpose": purpose},
                {"cast_count": len(dataset), "status_counts": dataset.info["status_counts"]},
            )
    return dataset
