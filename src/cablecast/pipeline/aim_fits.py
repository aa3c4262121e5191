"""Fits of a session: the first one to its calibration casts, later ones to all casts that it has.

A later fit lies in `fits/NNNNN` of the session's folder, where NNNNN is the number of casts that it
was made with. The newest whose model is finished is the one that the session goes on with.
"""

import pathlib
from collections.abc import Sequence

import numpy as np

from cablecast.pipeline.aim_casts import AimTrial
from cablecast.runs.folder import METRICS_FILE
from cablecast.runs.places import MODEL_FOLDER

FITS_FOLDER = "fits"
SESSION_FOLDER = "session"

GROWTH = 3
"""Times as many casts as the simulator was fitted to, from which on a new fit is due."""

EARLY_GROWTH = 2
"""Times as many, if first tries land farther off than was stated."""

EARLY_SURPRISE, EARLY_TRIES = 2.0, 3
"""Mean surprise of so many first tries or more from which on they land farther off than was stated.
The surprise is the squared distance from the expected landing over the expected one, 1 on average.
With the 5-cast fits of the virtual rig, three first tries exceed it in 28 to 66 % of draws where a
fit is poor (regions of 90 % that hold less than 75 %), and in 1 to 11 % elsewhere."""

FIRST_COUNT = 5
"""Casts from which on the first fit is due, where a session began without one."""

ENOUGH = 40
"""Casts from which on no fit is due: more hardly change the parameters (docs/tuning.md)."""

_SURPRISE_MAX = 4.0


def fit_folder(folder: pathlib.Path, count: int) -> pathlib.Path:
    """Return the folder of a later fit.

    Args:
        folder: Folder of the session.
        count: Number of casts of the session.
    """
    return folder / FITS_FOLDER / f"{count:05d}"


def newest_fit(folder: pathlib.Path) -> int:
    """Return the number of casts of the newest finished fit to all casts; 0 where there is none.

    Args:
        folder: Folder of the session.
    """
    known = [
        int(file.parent.parent.name)
        for file in (folder / FITS_FOLDER).glob(f"*/{MODEL_FOLDER}/{METRICS_FILE}")
        if file.parent.parent.name.isdecimal()
    ]
    return max(known, default=0)


def refit_reason(trials: Sequence[AimTrial], fitted_count: int, *, waits: bool = False) -> str:
    """Return why the simulator should be fitted anew, in words; empty where it need not be.

    Args:
        trials: All casts of a session, in the order in which they were made.
        fitted_count: Number of them that the simulator was fitted to; 0 where it was not fitted to
            casts of the session, and is none of its business.
        waits: True for a simulator that waits for the first casts of the session.
    """
    known = len(trials)
    if waits and known >= FIRST_COUNT:
        return f"{known} casts are known, and the simulator is fitted to none"
    if not 0 < fitted_count < ENOUGH:
        return ""
    counts = f"{known} casts are known, and the simulator is fitted to {fitted_count}"
    if known >= GROWTH * fitted_count:
        return counts
    if known < EARLY_GROWTH * fitted_count:
        return ""
    surprises = [
        trial.surprise
        for trial in trials[fitted_count:]
        if trial.try_number == 1 and np.isfinite(trial.surprise)
    ]
    if len(surprises) < EARLY_TRIES:
        return ""
    mean = float(np.mean(np.minimum(surprises, _SURPRISE_MAX)))
    if mean <= EARLY_SURPRISE:
        return ""
    return f"{counts}; first tries land {np.sqrt(mean):.1f} times as far off as was stated"
