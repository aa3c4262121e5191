"""Checks of a verb's input before its rig is connected: a cast takes 20 s, a typing error none."""

import os
import pathlib
import typing
from collections.abc import Sequence

from cablecast.errors import InputError, check_count, check_seed
from cablecast.learning.landing import MIN_ROWS
from cablecast.motion.feasibility import ACTION_COUNT_MAX
from cablecast.pipeline.places import require
from cablecast.setup import Setup
from cablecast.workspace import load_targets

Folder = str | os.PathLike[str] | None


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
