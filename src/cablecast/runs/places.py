"""Default folders of results, below the folder in which a command runs."""

import pathlib
import re
from typing import Literal

from cablecast.errors import CablecastError, CheckpointError, DatasetError

RUNS_FOLDER = pathlib.Path("runs")
CASTS_FOLDERS = {"tune": "tune-data", "real": "real-data"}
TUNE_FOLDER = "tune"
DATASET_FOLDER = "dataset"
MODEL_FOLDER = "model"
AIM_FOLDER = "aim"
CALIBRATION_FOLDER = "calibration"
STRIKE_FOLDER = "strike"
SELECT_FOLDER = "select"
CHECK_FOLDER = "check"


def file_name(cable_name: str) -> str:
    """Return the name of a cable with all replaced that does not belong in the name of a file.

    >>> file_name('../rope "red"/1')
    '_rope_red_1'
    """
    return re.sub(r"[^\w.-]+", "_", cable_name).strip(".") or "cable"


def cable_folder(cable_name: str) -> pathlib.Path:
    """Return the folder of a cable's results, e.g. runs/cable_1."""
    return RUNS_FOLDER / file_name(cable_name)


def rig_folder(verb: str, rig: str) -> str:
    """Return the name of the folder of a verb on a rig, e.g. evaluate-virtual."""
    return f"{verb}-" + re.sub(r"[^\w.-]+", "-", rig)


_INPUTS = {
    "tune": ("casts", CASTS_FOLDERS["tune"], "collect --purpose tune", "--dataset", DatasetError),
    "real": ("casts", CASTS_FOLDERS["real"], "collect --purpose real", "--real", DatasetError),
    "simulated": ("dataset", DATASET_FOLDER, "simulate", "--dataset", DatasetError),
    "model": ("model", MODEL_FOLDER, "train", "--model", CheckpointError),
}


def check_not_aim(folder: pathlib.Path, part: str, what: str, error: type[CablecastError]) -> None:
    """Refuse a folder of `aim` where a part of it is meant, and name that.

    Raises:
        CablecastError: It is one; of the type `error`.
    """
    if all((folder / name).is_dir() for name in (CALIBRATION_FOLDER, TUNE_FOLDER, part)):
        raise error(f"{folder} is a folder of `cablecast aim`: {what} is in {folder / part}")


def find_input(
    kind: Literal["tune", "real", "simulated", "model"],
    folder: pathlib.Path | None,
    cable_name: str,
) -> pathlib.Path:
    """Return the casts, dataset or model that was named, or that a verb writes by default.

    Raises:
        DatasetError: There are no such casts; says how to make some.
        CheckpointError: There is no such model; says how to train one.
    """
    noun, name, command, option, error = _INPUTS[kind]
    if folder is not None:
        if not folder.is_dir():
            raise error(f"no {noun} at {folder}: there is no such folder")
        inner = CALIBRATION_FOLDER if noun == "casts" else name
        check_not_aim(folder, inner, f"its {noun}", error)
        return folder
    default = cable_folder(cable_name) / name
    if not default.is_dir():
        it = "them" if noun == "casts" else "it"
        raise error(
            f"no {noun} of {cable_name} in {default}: make {it} with `cablecast {command}` and "
            f"the same --setup or --cable, or name {it} with {option}"
        )
    return default
