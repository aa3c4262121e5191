"""collect: casts on a rig, to tune the simulator or to train a model."""

import os
import pathlib
import typing

import numpy as np
from numpy.typing import NDArray

from cablecast.data.dataset import Dataset
from cablecast.data.record import (
    TRIAL_COUNTS,
    Purpose,
    Sampling,
    collect_dataset,
    sample_actions,
)
from cablecast.data.schema import INFO_PATH
from cablecast.engines import make_engine
from cablecast.errors import DatasetError, InputError, check_argument_types, check_count, check_seed
from cablecast.motion.action import ActionRanges
from cablecast.motion.feasibility import ACTION_COUNT_MAX, feasible_ranges
from cablecast.pipeline.check import check
from cablecast.pipeline.places import folder_or_temporary
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.folder import METRICS_FILE, Claim, record_run
from cablecast.runs.progress import Progress, ProgressCallback, show
from cablecast.setup import Setup
from cablecast.tuning.fit import FitConfig
from cablecast.tuning.spread import spread_actions

AnySampling = Sampling | typing.Literal["spread"]

SAMPLINGS: dict[str, Sampling] = {"tune": "uniform", "real": "grid"}
"""Choice of actions by purpose, as in the paper."""


@check_argument_types
def collect(
    rig: CheckedRig,
    *,
    purpose: Purpose = "tune",
    count: int | None = None,
    sampling: AnySampling | None = None,
    psi: bool = True,
    pace: tuple[float, float] = (1.0, 1.0),
    seed: int = 0,
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = show,
) -> Dataset:
    """Make casts on a rig and record each one (paper, section V-C).

    Each cast starts with a reset and becomes one row: the action, the joints as commanded and as
    they moved, the track of the cable's free end, and how the cast ended.

    Args:
        rig: Rig that `make_rig` returned; gives the set-up.
        purpose: Purpose of the casts: "tune" (D_tune) or "real" (D_real). Each has random
            effects of its own on a rig that has any.
        count: Number of casts; the paper's 80 or 200 if None.
        sampling: Choice of actions: "uniform" over their ranges, on a "grid", or "spread", so that
            the simulated landings are spread over the table; as in the paper if None.
        psi: Whether the wrist turns (the action set A2 of the paper).
        pace: Range of the pace [-]; the paper's alone by default.
        seed: Seed of the actions.
        out: Folder that keeps the casts and lets a stopped run go on; none if None.
        progress: Receives the number of casts done.

    Raises:
        RigError: A cast failed too often.
        DatasetError: The folder holds something else. Casts that are finished are kept.
        InputError: A name is unknown, or a count or seed is out of bounds.
    """
    check_collect(purpose=purpose, count=count, sampling=sampling, seed=seed, out=out)
    setup = rig.setup
    how = sampling or SAMPLINGS[purpose]
    is_finished = out is not None and (pathlib.Path(out) / METRICS_FILE).is_file()
    if not is_finished:
        progress(Progress(task=f"Checking what casts of {setup.cable.name} reach"))
        found = check(setup, changes=False)
        progress(Progress(task=f"Checking {setup.cable.name}", note=found.summary))
        if how == "spread" and not found.reaches_anything:
            raise InputError(check(setup).refusal())
    ranges = feasible_ranges(setup, psi, pace)
    given = None
    if how == "spread":
        given = choose_actions(how, purpose, count, setup, ranges, seed)
    with folder_or_temporary(out) as folder:
        dataset = collect_dataset(
            folder,
            rig,
            setup,
            purpose=purpose,
            count=count,
            sampling=SAMPLINGS[purpose] if how == "spread" else how,
            actions=given,
            seed=seed,
            ranges=ranges,
            progress=progress,
        )
        if out is not None:
            settings = {**dataset.settings.values, "purpose": purpose}
            record_run(folder, "collect", settings, dataset.status_counts)
    return dataset


def check_collect(
    *,
    purpose: str,
    count: int | None,
    sampling: str | None,
    seed: int,
    out: str | os.PathLike[str] | None = None,
) -> None:
    """Raise the errors of `collect` that are known before a rig is connected."""
    if purpose not in TRIAL_COUNTS:
        raise InputError(f"purpose {str(purpose)[:40]!r} must be one of {', '.join(TRIAL_COUNTS)}")
    if sampling not in (None, "uniform", "grid", "spread"):
        raise InputError(f"sampling {str(sampling)[:40]!r} must be uniform, grid or spread")
    if count is not None:
        check_count("count", count, high=ACTION_COUNT_MAX)
    check_seed(seed)
    if out is not None:
        claim = Claim(
            path=pathlib.Path(out), file=str(INFO_PATH), noun="dataset", error=DatasetError
        )
        if claim.read() is None:
            claim.refuse_foreign_files()


def choose_actions(
    sampling: AnySampling,
    purpose: Purpose,
    count: int | None,
    setup: Setup,
    ranges: ActionRanges,
    seed: int,
) -> NDArray[np.float64]:
    """Return the actions of a collection, in the order in which they are made, shape [action, 5].

    Raises:
        InputError: Too few actions stay on the table.
    """
    count = count or TRIAL_COUNTS[purpose]
    if sampling != "spread":
        return sample_actions(sampling, count, setup, seed, ranges)
    coarse = FitConfig()
    engine = make_engine("warp", coarse.coarse_segment_count, coarse.coarse_dt)
    return spread_actions(setup, count, engine, ranges, seed)
