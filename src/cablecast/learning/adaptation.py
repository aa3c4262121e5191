"""Real casts to learn from, cross-validation on them, and the record of the adaptation.

Learning from real casts.

- `correct_model` keeps the network and adds a `LandingCorrection`. It also estimates the spread of
  real landings, with which a policy can choose casts that are likely to succeed.
- `fine_tune` continues the training of the network on D_real, as in the paper (section V-F).
- `train_on_real` trains a network on D_real alone.

Each is cross-validated on D_real: every real cast is predicted once by a model that has not seen
it. Casts that left the table or were not seen have no endpoint and are not used.
"""

import dataclasses
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cablecast.data.dataset import Dataset
from cablecast.errors import InputError
from cablecast.files import library_versions
from cablecast.learning.checkpoint import check_device, one_thread
from cablecast.learning.landing import MIN_REAL_ROWS, dataset_summary, deviations, error_metrics
from cablecast.learning.network import (
    Casts,
    ForwardModel,
    TrainingConfig,
    Weights,
    fit_correction,
    fit_network,
    normalized_casts,
    untrained_model,
)
from cablecast.runs.folder import settings_differences
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.setup import SECTIONS

FOLD_COUNT = 5
"""Number of folds of the cross-validation."""

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
        there, here = model.settings.values, real.settings.values
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
    progress: ProgressCallback = ignore,
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
    fits, task = [], "Learning from real casts"
    for done, (rows, held_out) in enumerate(jobs):
        progress(Progress(task=task, done=done, total=len(jobs), unit="fits"))
        fits.append(fit(rows, held_out))
    progress(Progress(task=task, done=len(jobs), total=len(jobs), unit="fits"))
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


Curve = list[dict[str, float]]


@dataclasses.dataclass(frozen=True, kw_only=True)
class FineTuningConfig:
    """Settings of fine-tuning.

    Attributes:
        epochs: Passes over the training rows.
        learning_rate: Maximum learning rate.
        batch_size: Number of rows per step.
        weight_decay: Decoupled weight decay.
        real_fraction: Fraction of real casts among the training rows. At 1 there are no others, as
            in the paper. Below 1, simulated casts are kept and the real ones repeated, as in the
            sibling paper (arXiv 2111.04814), which used 0.3 to 0.4.
        real_weight: Weight of a real cast in the loss, relative to a simulated one.
    """

    epochs: int = 400
    learning_rate: float = 1e-3
    batch_size: int = 256
    weight_decay: float = 0.0
    real_fraction: float = 1.0
    real_weight: float = 1.0

    def __post_init__(self):
        for name, low, high in (("real_fraction", 0.01, 1.0), ("real_weight", 1e-3, 1e3)):
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(f"{name} = {value} is outside [{low:g}, {high:g}]")
        self.training()

    def training(self) -> TrainingConfig:
        """Return the settings of the optimiser, which runs through all epochs."""
        return TrainingConfig(
            epochs=self.epochs,
            learning_rate=self.learning_rate,
            batch_size=self.batch_size,
            weight_decay=self.weight_decay,
            patience=self.epochs,
        )


REAL_ONLY = TrainingConfig(
    epochs=300, batch_size=64, learning_rate=3e-3, weight_decay=1e-2, patience=300
)
"""Settings for training a network on a few hundred real casts alone."""


def correct_model(
    model: ForwardModel, real: Dataset, *, seed: int = 0, progress: ProgressCallback = ignore
) -> ForwardModel:
    """Fit a correction to real casts and add it to a model.

    The metric `spread_calibration` is the root mean square of the cross-validated errors along x
    and y, each divided by its predicted spread: 1 if the spread is right.

    Args:
        model: Model trained on simulated casts.
        real: Real casts, D_real.
        seed: Seed for the folds of the cross-validation.
        progress: Called with the number of completed fits.

    Raises:
        InputError: There are too few real casts, they are of another cable or other motions, or
            there is no finite fit.
        MissingExtraError: torch is not installed.
    """
    actions, endpoint_xy = real_rows(real, model)
    changes = deviations(real.actions)
    began = time.monotonic()

    def fit(rows: Rows, held_out: Rows) -> ForwardModel:
        del held_out
        correction = fit_correction(model, actions[rows], endpoint_xy[rows], changes)
        return dataclasses.replace(model, correction=correction)

    parts, corrected = cross_validate(len(actions), fit, seed, progress)
    predicted, spread = np.empty_like(endpoint_xy), np.empty(len(actions))
    for held_out, fold_model in parts:
        predicted[held_out] = fold_model.predict(actions[held_out])
        spread[held_out] = fold_model.predict_spread(actions[held_out])
    offset = (predicted - endpoint_xy) / spread[:, None]
    metrics = real_metrics(real, model, actions, endpoint_xy, predicted) | {
        "spread_calibration": float(np.sqrt(np.mean(offset**2))),
        "adaptation_seconds": round(time.monotonic() - began, 2),
    }
    return with_adaptation(
        corrected, model.info, real, method="correction", seed=seed, metrics=metrics
    )


def fine_tune(
    model: ForwardModel,
    real: Dataset,
    *,
    simulated: Dataset | None = None,
    config: FineTuningConfig | None = None,
    seed: int = 0,
    device: str = "cpu",
    progress: ProgressCallback = ignore,
) -> ForwardModel:
    """Continue the training of a model on real casts.

    Args:
        model: Model trained on simulated casts. An existing correction is dropped.
        real: Real casts, D_real.
        simulated: Simulated casts, D_sim; needed if `real_fraction` is below 1.
        config: Settings of fine-tuning.
        seed: Seed for the folds of the cross-validation and the order of the rows.
        device: "cpu" or "cuda".
        progress: Called with the number of completed fits.

    Raises:
        InputError: There are too few real casts, or they are of another cable or other motions.
        MissingExtraError: torch is not installed.
    """
    config = config or FineTuningConfig()
    if config.real_fraction < 1.0 and simulated is None:
        raise InputError(f"real_fraction = {config.real_fraction:g} needs simulated casts")
    check_device(device)
    actions, endpoint_xy = real_rows(real, model)

    def fit(rows: Rows, held_out: Rows) -> tuple[Weights, Curve]:
        training, row_weights = training_mixture(
            model, actions[rows], endpoint_xy[rows], simulated, config
        )
        return fit_network(
            model.weights,
            training,
            normalized_casts(model, actions[held_out], endpoint_xy[held_out]),
            config=config.training(),
            seed=seed,
            device=device,
            metre=model.endpoint_scale,
            row_weights=row_weights,
            keep_last=True,
        )

    tuned, curve, predicted = _cross_validate_network(model, actions, fit, seed, progress)
    return with_adaptation(
        tuned,
        model.info,
        real,
        method="fine-tuning",
        config=dataclasses.asdict(config),
        seed=seed,
        metrics=real_metrics(real, model, actions, endpoint_xy, predicted),
        curve=curve,
    )


def train_on_real(
    real: Dataset,
    *,
    config: TrainingConfig | None = None,
    seed: int = 0,
    device: str = "cpu",
    progress: ProgressCallback = ignore,
) -> ForwardModel:
    """Train a network on real casts alone, the paper's f_forw with D_real.

    Args:
        real: Real casts, D_real.
        config: Settings of the training.
        seed: Seed for the initial weights, the order of the rows and the folds.
        device: "cpu" or "cuda".
        progress: Called with the number of completed fits.

    Raises:
        InputError: There are too few real casts.
        MissingExtraError: torch is not installed.
    """
    config = config or REAL_ONLY
    check_device(device)
    actions, endpoint_xy = real_rows(real, None)
    blank = untrained_model(actions, endpoint_xy, config, seed).with_margins(real)

    def fit(rows: Rows, held_out: Rows) -> tuple[Weights, Curve]:
        return fit_network(
            blank.weights,
            normalized_casts(blank, actions[rows], endpoint_xy[rows]),
            normalized_casts(blank, actions[held_out], endpoint_xy[held_out]),
            config=config,
            seed=seed,
            device=device,
            metre=blank.endpoint_scale,
            keep_last=True,
        )

    model, curve, predicted = _cross_validate_network(blank, actions, fit, seed, progress)
    info = {
        "config": dataclasses.asdict(config),
        "device": device,
        "versions": library_versions(),
        "dataset": dataset_summary(real),
    }
    return with_adaptation(
        model,
        info,
        real,
        method="real only",
        seed=seed,
        metrics=real_metrics(real, None, actions, endpoint_xy, predicted),
        curve=curve,
    )


def training_mixture(
    model: ForwardModel,
    actions: NDArray[np.float64],
    endpoint_xy: NDArray[np.float64],
    simulated: Dataset | None,
    config: FineTuningConfig,
) -> tuple[Casts, NDArray[np.float64] | None]:
    """Return the training rows of fine-tuning and their weights in the loss.

    Real casts are repeated a whole number of times, so their fraction only approximates
    `real_fraction`.

    Args:
        model: Model that holds the means and scales.
        actions: Actions of the real casts, shape [cast, 4].
        endpoint_xy: Their endpoints [m], shape [cast, 2].
        simulated: Simulated casts, D_sim; used if `real_fraction` is below 1.
        config: Settings of fine-tuning.

    Returns:
        Normalised casts, and weights of shape [row], or None if all are equal.
    """
    inputs, outputs = normalized_casts(model, actions, endpoint_xy)
    if config.real_fraction >= 1.0 or simulated is None:
        return (inputs, outputs), None
    rows = simulated.finite
    sim_inputs, sim_outputs = normalized_casts(
        model, simulated.actions[rows], simulated.endpoint_xy[rows]
    )
    ratio = config.real_fraction / (1.0 - config.real_fraction)
    copies = max(1, round(ratio * len(sim_inputs) / len(inputs)))
    row_weights = np.repeat([1.0, config.real_weight], [len(sim_inputs), copies * len(inputs)])
    mixed = (
        np.concatenate([sim_inputs, np.tile(inputs, (copies, 1))]),
        np.concatenate([sim_outputs, np.tile(outputs, (copies, 1))]),
    )
    return mixed, row_weights


def _cross_validate_network(
    model: ForwardModel,
    actions: NDArray[np.float64],
    fit: Callable[[Rows, Rows], tuple[Weights, Curve]],
    seed: int,
    progress: ProgressCallback,
) -> tuple[ForwardModel, Curve, NDArray[np.float64]]:
    """Cross-validate a network, and train it on all casts.

    Returns:
        The model trained on all casts, its learning curve with the held-out loss averaged over the
        folds, and the cross-validated predictions [m], shape [cast, 2].
    """
    with one_thread():
        parts, (weights, curve) = cross_validate(len(actions), fit, seed, progress)
    predicted = np.empty((len(actions), 2))
    for held_out, (fold_weights, _) in parts:
        fold_model = dataclasses.replace(model, weights=fold_weights, correction=None)
        predicted[held_out] = fold_model.predict(actions[held_out])
    losses = [[row["held_out_loss"] for row in fold_curve] for _, (_, fold_curve) in parts]
    curve = [
        row | {"held_out_loss": float(loss)}
        for row, loss in zip(curve, np.mean(losses, axis=0), strict=True)
    ]
    return dataclasses.replace(model, weights=weights, correction=None), curve, predicted
