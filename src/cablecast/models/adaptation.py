"""Learning from real casts.

- `correct_model` keeps the network and adds a `LandingCorrection`. It also estimates the spread of
  real landings, with which a policy can choose casts that are likely to succeed.
- `fine_tune` continues the training of the network on D_real, as in the paper (section V-F).
- `train_on_real` trains a network on D_real alone.

Each is cross-validated on D_real: every real cast is predicted once by a model that has not seen
it. Casts that left the table or were not seen have no endpoint and are not used.
"""

import dataclasses
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cablecast.datasets.reader import Dataset
from cablecast.errors import InputError
from cablecast.machine import library_versions
from cablecast.models.correction_fit import fit_correction
from cablecast.models.features import deviations
from cablecast.models.forward import ForwardModel
from cablecast.models.forward_training import untrained_model
from cablecast.models.network import Weights
from cablecast.models.real_casts import (
    Progress,
    Rows,
    cross_validate,
    real_metrics,
    real_rows,
    with_adaptation,
)
from cablecast.models.rows import dataset_summary
from cablecast.models.torch_ import check_device, one_thread
from cablecast.models.training import Casts, TrainingConfig, fit_network, normalized_casts

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
    model: ForwardModel, real: Dataset, *, seed: int = 0, progress: Progress | None = None
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
    progress: Progress | None = None,
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
    progress: Progress | None = None,
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
    progress: Progress | None,
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
