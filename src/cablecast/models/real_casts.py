"""Real casts to learn from, cross-validation on them, and the record of the adaptation."""

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cablecast.datasets.reader import Dataset
from cablecast.errors import InputError
from cablecast.models.forward import ForwardModel
from cablecast.models.rows import MIN_REAL_ROWS, dataset_summary, error_metrics
from cablecast.runs.settings import settings_differences
from cablecast.setup import SECTIONS

FOLD_COUNT = 5
"""Number of folds of the cross-validation."""

Progress = Callable[[int, int], None]
"""Called with the number of completed fits and the number of all fits."""

Rows = NDArray[np.intp]
Fit = TypeVar("Fit")


def real_rows(
    real: Dataset, model: ForwardModel | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the real casts that came to rest on the table and were seen.

    Args:
        real: Real casts, D_real.
        model: Model that will learn from them; None if it has not learned from other casts before.

    Returns:
        Actions, shape [cast, 4], and endpoints [m], shape [cast, 2].

    Raises:
        InputError: There are too few such casts, or the model is of another cable, workspace or
            other motions.
    """
    if model is not None:
        there, here = model.info["dataset"]["settings"], real.info["settings"]
        for name in SECTIONS:
            if differences := settings_differences(there.get(name, {}), here.get(name, {})):
                raise InputError(
                    f"the real casts do not match the model: {name}.{'; '.join(differences)}"
                )
    rows = np.flatnonzero(real.ok & real.finite)
    if len(rows) < MIN_REAL_ROWS:
        raise InputError(
            f"{len(rows)} of {len(real)} real casts came to rest on the table and were seen: "
            f"learning from them needs {MIN_REAL_ROWS}"
        )
    return real.actions[rows], real.endpoint_xy[rows]


def folds(count: int, seed: int) -> Iterator[tuple[Rows, Rows]]:
    """Yield the rows to learn from and the held-out rows of each fold.

    Args:
        count: Number of rows.
        seed: Seed for the assignment of rows to folds.
    """
    order = np.random.default_rng([seed, 7]).permutation(count)
    for held_out in np.array_split(order, FOLD_COUNT):
        yield np.setdiff1d(order, held_out), held_out


def cross_validate(
    count: int,
    fit: Callable[[Rows, Rows], Fit],
    seed: int,
    progress: Progress | None = None,
) -> tuple[list[tuple[Rows, Fit]], Fit]:
    """Fit to all rows but one fold in turn, and then to all rows.

    Args:
        count: Number of rows.
        fit: Function of the rows to learn from and the rows to validate on.
        seed: Seed for the assignment of rows to folds.
        progress: Called before every fit and at the end.

    Returns:
        The held-out rows and the fit of each fold, and the fit to all rows, which is validated on
        the rows that it learned from.
    """
    every = np.arange(count)
    jobs = [*folds(count, seed), (every, every)]
    fits = []
    for done, (rows, held_out) in enumerate(jobs):
        if progress is not None:
            progress(done, len(jobs))
        fits.append(fit(rows, held_out))
    if progress is not None:
        progress(len(jobs), len(jobs))
    parts = [(held_out, part) for (_, held_out), part in zip(jobs[:-1], fits[:-1], strict=True)]
    return parts, fits[-1]


def real_metrics(
    real: Dataset,
    model: ForwardModel | None,
    actions: NDArray[np.float64],
    endpoint_xy: NDArray[np.float64],
    predicted_xy: NDArray[np.float64],
) -> dict[str, Any]:
    """Return the errors on real casts, each predicted by a model that has not seen it.

    Args:
        real: Real casts, D_real.
        model: Model before it learned from them; None if there was none.
        actions: Actions of the casts that were used, shape [cast, 4].
        endpoint_xy: Their endpoints [m], shape [cast, 2].
        predicted_xy: Their cross-validated predictions [m], shape [cast, 2].
    """
    length = real.cable.length
    metrics: dict[str, Any] = {
        "real_count": len(real),
        "real_used_count": len(actions),
        "real_fold_count": FOLD_COUNT,
        **error_metrics("real", predicted_xy, endpoint_xy, length),
    }
    if model is not None:
        before_xy = model.uncorrected.predict(actions)
        metrics |= error_metrics("real_before", before_xy, endpoint_xy, length)
    return metrics


def with_adaptation(
    model: ForwardModel,
    info: dict[str, Any],
    real: Dataset,
    *,
    method: str,
    seed: int,
    metrics: dict[str, Any],
    config: dict[str, Any] | None = None,
    curve: list[dict[str, float]] | None = None,
) -> ForwardModel:
    """Return a model with a record of its adaptation to real casts.

    Args:
        model: Model after it learned from them.
        info: Description of the model before.
        real: Real casts, D_real.
        method: "correction", "fine-tuning" or "real only".
        seed: Seed of the adaptation.
        metrics: Metrics to add to those of the model before.
        config: Settings of the method.
        curve: Learning curve.
    """
    adaptation = {
        "method": method,
        "config": config or {},
        "seed": seed,
        "dataset": dataset_summary(real),
        "curve": curve or [],
    }
    metrics = info.get("metrics", {}) | metrics
    return dataclasses.replace(model, info=info | {"metrics": metrics, "adaptation": adaptation})
