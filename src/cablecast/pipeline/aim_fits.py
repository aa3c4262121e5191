"""Fits of a session: the first one to its calibration casts, later ones to all casts that it has.

A later fit lies in `fits/NNNNN` of the session's folder, where NNNNN is the number of casts that it
was made with. The newest whose model is finished is the one that the session goes on with.
"""

import dataclasses
import pathlib

from cablecast.datasets.reader import Dataset
from cablecast.datasets.store import CastStore
from cablecast.errors import InputError
from cablecast.runs.folder import METRICS_FILE
from cablecast.runs.places import MODEL_FOLDER
from cablecast.setup import Setup

FITS_FOLDER = "fits"
SESSION_FOLDER = "session"


@dataclasses.dataclass(frozen=True, kw_only=True)
class LaterFit:
    """A fit to all casts that a session had.

    Attributes:
        folder: Folder of the fit, its simulated casts and its model.
        count: Number of casts, the first ones of the session.
        casts: These casts.
    """

    folder: pathlib.Path
    count: int
    casts: Dataset


def later_fit(folder: pathlib.Path, setup: Setup, fit_all: bool) -> LaterFit | None:
    """Return the fit that a session goes on with; None for the one to its calibration casts.

    Args:
        folder: Folder of the session.
        setup: Set-up of the session.
        fit_all: True for a fit to all casts that the session has by now.

    Raises:
        InputError: There are no casts yet to fit the simulator to.
    """
    known = [
        int(file.parent.parent.name)
        for file in (folder / FITS_FOLDER).glob(f"*/{MODEL_FOLDER}/{METRICS_FILE}")
        if file.parent.parent.name.isdecimal()
    ]
    if not (fit_all or known):
        return None
    stored = folder / SESSION_FOLDER
    store = CastStore(setup, stored) if stored.exists() else CastStore(setup)
    if fit_all and not len(store):
        raise InputError("fitting to all casts needs the folder of a session that has some")
    return _fit(folder, store, len(store) if fit_all else max(known))


def _fit(folder: pathlib.Path, store: CastStore, count: int) -> LaterFit:
    if count > len(store):
        raise InputError(
            f"{folder / FITS_FOLDER} has a fit to {count} casts, but the session has {len(store)}"
        )
    first = CastStore(store.setup)
    first.casts = store.casts[:count]
    return LaterFit(
        folder=folder / FITS_FOLDER / f"{count:05d}", count=count, casts=first.dataset()
    )
