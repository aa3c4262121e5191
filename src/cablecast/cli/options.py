"""What several verbs share: where results lie by default, and how values are shown."""

import math
import pathlib
import re
import typing
from typing import Any

import tyro

from cablecast.errors import CheckpointError, DatasetError, InputError

if typing.TYPE_CHECKING:
    from cablecast.cable import Cable

Device = typing.Literal["cpu", "cuda"]

DEFAULT_CABLE = "cable_1"

# All results of one cable lie side by side, relative to where the command is run.
RUNS_FOLDER = pathlib.Path("runs")
DATASET_FOLDER = "dataset"
MODEL_FOLDER = "model"


def argument(metavar: str, default: str | None = None) -> Any:
    """How `--help` shows an argument: what to give, and what happens without it.

    Args:
        metavar: Stands for the value.
        default: Words for a default that the code knows as None.
    """
    hint = None if default is None else f"(default: {default})"
    return tyro.conf.arg(metavar=metavar, help_behavior_hint=hint)


def cable_folder(cable_name: str) -> pathlib.Path:
    """Where the results of a cable lie by default, e.g. runs/cable_1.

    Args:
        cable_name: Name of the cable, which may come from a user's file: characters that do not
            belong in a file name are replaced.
    """
    return RUNS_FOLDER / (re.sub(r"[^\w.-]+", "_", cable_name).strip(".") or "cable")


def evaluation_folder(rig: str) -> str:
    """Name of the folder of an evaluation on a rig, e.g. evaluate-virtual."""
    return "evaluate-" + re.sub(r"[^\w.-]+", "-", rig)


def find_dataset(folder: pathlib.Path | None, cable: "Cable | None") -> pathlib.Path:
    """The dataset that was named, or the one that `cablecast simulate` writes by default.

    Raises:
        DatasetError: Neither was named and there is none; says how to make one.
    """
    if folder is not None:
        return folder
    name = cable.name if cable else DEFAULT_CABLE
    folder = cable_folder(name) / DATASET_FOLDER
    if not folder.is_dir():
        raise DatasetError(
            f"no dataset of {name} in {folder}: make one with `cablecast simulate --cable {name}`, "
            "or name one with --dataset"
        )
    return folder


def find_model(folder: pathlib.Path | None, cable: "Cable | None") -> pathlib.Path:
    """The model that was named, or the one that `cablecast train` writes by default.

    Raises:
        CheckpointError: There is none; says how to make one.
    """
    name = cable.name if cable else DEFAULT_CABLE
    if folder is None:
        folder = cable_folder(name) / MODEL_FOLDER
        if not folder.is_dir():
            raise CheckpointError(
                f"no model of {name} in {folder}: make one with `cablecast demo` or `cablecast "
                f"train --cable {name}`, or name one with --model"
            )
    elif not folder.is_dir():
        raise CheckpointError(f"no model at {folder}: there is no such folder")
    return folder


def check_same_cable(asked: "Cable | None", stored: "Cable", where: pathlib.Path) -> "Cable":
    """The cable that a dataset or model was made for, if it is the one that was asked for.

    Raises:
        InputError: Another cable was asked for; names the values that differ.
    """
    if asked is None:
        return stored
    from cablecast.datasets.schema import settings_differences

    if differences := settings_differences(stored.to_dict(), asked.to_dict()):
        raise InputError(f"{where} was made for another cable: {'; '.join(differences)}")
    return stored


def polar_text(xy) -> str:
    """A point on the table as a person reads it."""
    x, y = float(xy[0]), float(xy[1])
    theta_deg = math.degrees(math.atan2(x, y))
    r = math.hypot(x, y)
    return f"r = {r:.3f} m, theta = {theta_deg:.1f} deg (x = {x:.3f} m, y = {y:.3f} m)"
