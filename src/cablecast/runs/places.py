"""Default folders of results, below the folder in which a command runs."""

import pathlib
import re
from typing import TYPE_CHECKING

from cablecast.errors import CheckpointError, DatasetError

if TYPE_CHECKING:
    from cablecast.errors import CablecastError

RUNS_FOLDER = pathlib.Path("runs")
CASTS_FOLDERS = {"tune": "tune-data", "real": "real-data"}
TUNE_FOLDER = "tune"
DATASET_FOLDER = "dataset"
MODEL_FOLDER = "model"
AIM_FOLDER = "aim"
SELECT_FOLDER = "select"


def cable_folder(cable_name: str) -> pathlib.Path:
    """Return the folder of a cable's results, e.g. runs/cable_1.

    Args:
        cable_name: Name of the cable, which may come from a user's file: characters that do not
            belong in a file name are replaced.
    """
    return RUNS_FOLDER / (re.sub(r"[^\w.-]+", "_", cable_name).strip(".") or "cable")


def rig_folder(verb: str, rig: str) -> str:
    """Return the name of the folder of a verb on a rig, e.g. evaluate-virtual."""
    return f"{verb}-" + re.sub(r"[^\w.-]+", "-", rig)


def find_casts(folder: pathlib.Path | None, cable_name: str, purpose: str) -> pathlib.Path:
    """Return the casts that were named, or those that `cablecast collect` writes by default.

    Raises:
        DatasetError: None were named and there are none by default; says how to make some.
    """
    command = f"cablecast collect --purpose {purpose} --cable {cable_name}"
    option = "--dataset" if purpose == "tune" else "--real"
    default = cable_folder(cable_name) / CASTS_FOLDERS[purpose]
    return _find(folder, default, f"casts of {cable_name}", command, option, DatasetError)


def find_dataset(folder: pathlib.Path | None, cable_name: str) -> pathlib.Path:
    """Return the dataset that was named, or the one that `cablecast simulate` writes by default.

    Raises:
        DatasetError: None was named and there is none by default; says how to make one.
    """
    command = f"cablecast simulate --cable {cable_name}"
    default = cable_folder(cable_name) / DATASET_FOLDER
    return _find(folder, default, f"dataset of {cable_name}", command, "--dataset", DatasetError)


def find_model(folder: pathlib.Path | None, cable_name: str) -> pathlib.Path:
    """Return the model that was named, or the one that `cablecast train` writes by default.

    Raises:
        CheckpointError: There is none; says how to make one.
    """
    command = f"cablecast train --cable {cable_name}"
    default = cable_folder(cable_name) / MODEL_FOLDER
    return _find(folder, default, f"model of {cable_name}", command, "--model", CheckpointError)


def _find(
    folder: pathlib.Path | None,
    default: pathlib.Path,
    what: str,
    command: str,
    option: str,
    error: "type[CablecastError]",
) -> pathlib.Path:
    if folder is not None:
        if not folder.is_dir():
            raise error(f"no {what.split(' of ')[0]} at {folder}: there is no such folder")
        return folder
    if not default.is_dir():
        raise error(f"no {what} in {default}: make it with `{command}`, or name it with {option}")
    return default
