"""Long work of the pipeline, as the page starts it: each in the folder where its verb writes."""

import dataclasses
import pathlib

from cablecast.checks import check_count
from cablecast.datasets.reader import read_dataset
from cablecast.errors import InputError
from cablecast.pipeline.collect import collect
from cablecast.pipeline.simulate import simulate
from cablecast.pipeline.train import train
from cablecast.pipeline.tune import tune
from cablecast.pipeline.tuned import load_tuned
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.places import CASTS_FOLDERS, DATASET_FOLDER, MODEL_FOLDER, TUNE_FOLDER
from cablecast.runs.progress import ProgressCallback
from cablecast.tuning.result import PARAMS_FILE
from cablecast.view.worker import Work


@dataclasses.dataclass(frozen=True, kw_only=True)
class LongWork:
    """One kind of long work.

    Attributes:
        says: Purpose in a few words.
        unit: Unit of its amount; empty where it has none.
        amount: Usual amount.
        amount_max: Largest amount.
        folder: Folder that it fills, below that of the cable.
    """

    says: str
    unit: str
    amount: int
    amount_max: int
    folder: str


WORKS = {
    "collect": LongWork(
        says="cast on the rig",
        unit="casts",
        amount=20,
        amount_max=1000,
        folder=CASTS_FOLDERS["tune"],
    ),
    "tune": LongWork(
        says="fit the simulator to the casts", unit="", amount=1, amount_max=1, folder=TUNE_FOLDER
    ),
    "simulate": LongWork(
        says="play many casts in the simulator",
        unit="casts",
        amount=16_000,
        amount_max=200_000,
        folder=DATASET_FOLDER,
    ),
    "train": LongWork(
        says="learn where casts land",
        unit="epochs",
        amount=60,
        amount_max=1000,
        folder=MODEL_FOLDER,
    ),
}
"""Kinds of long work by the name of the verb, in the order in which data flows."""


def long_work(kind: str, rig: CheckedRig, home: pathlib.Path, amount: int) -> Work:
    """Return some long work for a worker; a stopped one goes on when it is started again.

    Args:
        kind: Name of the work, see `WORKS`.
        rig: Rig that `make_rig` returned.
        home: Folder of the cable's results, e.g. runs/cable_1.
        amount: Casts or epochs.

    Raises:
        InputError: There is no such work, or the amount is out of bounds: nothing from a browser is
            trusted.
    """
    if kind not in WORKS:
        raise InputError(f"unknown work {kind[:40]!r}: one of {', '.join(WORKS)}")
    known = WORKS[kind]
    amount = check_count(known.unit or "amount", amount, 1, known.amount_max)
    out = home / known.folder

    def work(report: ProgressCallback) -> None:
        if kind == "collect":
            collect(rig, count=amount, out=out, progress=report)
        elif kind == "tune":
            tune(read_dataset(home / CASTS_FOLDERS["tune"]), out=out, progress=report)
        elif kind == "simulate":
            is_tuned = (home / TUNE_FOLDER / PARAMS_FILE).exists()
            tuned = load_tuned(home / TUNE_FOLDER, rig.setup) if is_tuned else None
            simulate(rig.setup, tuned, count=amount, out=out, progress=report)
        else:
            train(read_dataset(home / DATASET_FOLDER), epochs=amount, out=out, progress=report)

    return work
