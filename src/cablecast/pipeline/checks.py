"""Checks of a verb's input before its rig is connected: a cast takes 20 s, a typing error none."""

import os
import pathlib
import typing
from collections.abc import Sequence

from numpy.typing import ArrayLike

from cablecast.data.record import TRIAL_COUNTS
from cablecast.data.schema import INFO_PATH
from cablecast.errors import DatasetError, InputError, check_count, check_seed
from cablecast.evaluation.repeatability import REPEAT_MAX
from cablecast.learning.landing import MIN_ROWS, LandingModel
from cablecast.motion.action import check_action_values
from cablecast.motion.feasibility import ACTION_COUNT_MAX
from cablecast.pipeline.places import require
from cablecast.runs.folder import Claim, refuse_other_work
from cablecast.setup import Setup
from cablecast.workspace import load_targets

COMBINATIONS = {
    "1.2": (1.2, False),
    "1.5": (1.5, False),
    "1.5-psi": (1.5, True),
    "1.8": (1.8, False),
    "1.8-psi": (1.8, True),
}
"""Combinations that the paper repeated (section V-E): speed [m/s], and whether the wrist turns."""

EVALUATE_REPEATS_MAX = 100_000

Folder = str | os.PathLike[str] | None


def check_collect(
    *,
    purpose: str,
    count: int | None,
    sampling: str | None,
    seed: int,
    out: Folder = None,
) -> None:
    """Check what `collect` is asked for.

    Raises:
        InputError: A name is unknown, or a number is out of bounds.
        DatasetError: The folder holds other work.
    """
    if purpose not in TRIAL_COUNTS:
        raise InputError(f"purpose {str(purpose)[:40]!r} must be one of {', '.join(TRIAL_COUNTS)}")
    if sampling not in (None, "uniform", "grid", "spread"):
        known = "uniform, grid or spread"
        raise InputError(f"sampling {str(sampling)[:40]!r} must be {known}")
    if count is not None:
        check_count("count", count, high=ACTION_COUNT_MAX)
    check_seed(seed)
    if out is not None:
        path = pathlib.Path(out)
        claim = Claim(path=path, file=str(INFO_PATH), noun="dataset", error=DatasetError)
        if claim.read() is None:
            claim.refuse_foreign_files()


def check_repeat(
    *,
    combinations: Sequence[str],
    repeats: int,
    action_count: int | None,
    actions: ArrayLike | None,
    seed: int,
    out: Folder = None,
) -> None:
    """Check what `repeat` is asked for.

    Raises:
        InputError: A name is unknown, a number is out of bounds, or the folder holds other work.
        MissingExtraError: A picture is to be drawn, and matplotlib is missing.
    """
    if not combinations or any(name not in COMBINATIONS for name in combinations):
        raise InputError(
            f"combinations {str(list(combinations))[:80]} must be some of {', '.join(COMBINATIONS)}"
        )
    check_count("repeats", repeats, 2, REPEAT_MAX)
    if action_count is not None:
        check_count("action_count", action_count, high=ACTION_COUNT_MAX)
    if actions is not None:
        check_action_values(actions)
    check_seed(seed)
    if out is not None:
        require("drawing the landings", "matplotlib")
        refuse_other_work(out, "repeat")


def check_evaluate(
    model: LandingModel | None, *, repeats: int, device: str = "cpu", out: Folder = None
) -> None:
    """Check what `evaluate` is asked for.

    Args:
        model: Model of the policy; None for a policy without one.
        repeats: Casts at each target.
        device: Device of the simulator that splits the errors.
        out: Folder of the results.

    Raises:
        InputError: A number is out of bounds, the device is not here, or the folder holds other
            work.
        MissingExtraError: A report is to be written, and matplotlib or jinja2 is missing.
    """
    check_count("repeats", repeats, high=EVALUATE_REPEATS_MAX)
    if out is not None:
        require("the report", "matplotlib", "jinja2")
        refuse_other_work(out, "evaluate")
    if model is not None and model.settings.is_simulated:
        from cablecast.pipeline.rigs import engine_rig

        engine_rig(model, device).close()


def check_way(setups: Sequence[Setup], device: str) -> None:
    """Check what later steps on the way from the first cast to the evaluation need.

    Args:
        setups: Set-up of each cable.
        device: "cpu" or "cuda".

    Raises:
        InputError: The device is not here.
        TargetError: A target of the evaluation is out of reach of arm and cable, or off the table.
    """
    from cablecast.engines import make_engine

    make_engine("warp", device=device)
    if device != "cpu":
        from cablecast.learning.checkpoint import check_device

        check_device(device)
    for setup in setups:
        setup.workspace.check_targets(load_targets(), cable_length=setup.cable.length)


def check_demo(
    *,
    setup: Setup,
    tune_count: int,
    count: int,
    epochs: int,
    candidate_count: int,
    seed: int,
    device: str,
    out: Folder,
    folders: typing.Collection[str],
) -> None:
    """Check what `demo` is asked for.

    Args:
        setup: Cable, workspace, arm and motion settings.
        tune_count: Number of casts to tune with.
        count: Number of simulated casts.
        epochs: Largest number of passes over them.
        candidate_count: Number of motions to choose from when planning.
        seed: Seed of everything that is drawn by chance.
        device: "cpu" or "cuda".
        out: Folder of all results.
        folders: Names of the folders that the demo makes in it.

    Raises:
        InputError: A number is out of bounds, the device is not here, or the folder holds other
            files.
        TargetError: A target of the evaluation cannot be asked for.
        MissingExtraError: A library that a later step needs is missing.
    """
    require("the demo", "torch", "safetensors", "matplotlib", "jinja2")
    from cablecast.learning.network import TrainingConfig

    # One cast to search with and one to measure the result; a model needs more.
    check_count("tune_count", tune_count, 2, ACTION_COUNT_MAX)
    check_count("count", count, MIN_ROWS, ACTION_COUNT_MAX)
    check_count("candidate_count", candidate_count, 1, ACTION_COUNT_MAX)
    TrainingConfig(epochs=epochs)
    check_seed(seed)
    path = pathlib.Path(out) if out is not None else None
    if path is not None and path.exists():
        if not path.is_dir():
            raise InputError(f"{path} is a file: the demo needs a folder")
        names = sorted(entry.name for entry in path.iterdir() if not entry.name.startswith("."))
        if other := [name for name in names if name not in folders]:
            raise InputError(
                f"{path} holds {other[0]}, which is none of the demo's: give a new or empty folder"
            )
    check_way([setup], device)
