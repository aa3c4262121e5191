"""Learning from real casts: what a few hundred of them add to what the simulator has taught.

Two ways, and the network that has only the real casts:

- `fine_tune` goes on training the network on D_real, as the paper does (section V-F).
- `correct_model` leaves the network as it is and adds a `LandingCorrection`, which also knows how
  far it may be trusted where; a policy can then choose casts that are likely to land where they
  should. `cablecast reproduce` compares them.

Each is cross-validated on D_real: every real cast is predicted once by a model that has not seen
it. Casts that left the table or were not seen have no endpoint and teach nothing here.
"""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.datasets.reader import Dataset
from cablecast.datasets.schema import settings_differences
from cablecast.errors import InputError
from cablecast.models.base import (
    action_features,
    dataset_summary,
    deviations,
    known_margins,
)
from cablecast.models.correction import MIN_REAL_ROWS, fit_correction
from cablecast.models.forward import ForwardModel
from cablecast.models.training import (
    TrainingConfig,
    check_device,
    fit_network,
    initial_weights,
    library_versions,
    one_thread,
)

FOLD_COUNT = 5
"""Parts that D_real is cut into; each is predicted from the others."""

Progress = Callable[[int, int], None]
"""Called with the number of fits done and of all."""

Predict = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclasses.dataclass(frozen=True, kw_only=True)
class FineTuningConfig:
    """How the network goes on learning from real casts.

    `cablecast reproduce` compares it with the correction on the same casts.

    Attributes:
        epochs: Passes over the training rows.
        learning_rate: Greatest learning rate.
        batch_size: Rows of a step.
        weight_decay: Decoupled weight decay.
        real_fraction: Share of real casts among the training rows. At 1 there are no others, as
            in the paper; below, simulated casts are kept and the real ones repeated, as in its
            sibling (arXiv 2111.04814), which took 0.3 to 0.4.
        real_weight: How much a real cast counts against a simulated one.
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
        """The same as settings of the optimiser, which then runs to its last epoch."""
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
"""How a network is trained from nothing on a few hundred real casts."""


def correct_model(
    model: ForwardModel, real: Dataset, *, seed: int = 0, progress: Progress | None = None
) -> ForwardModel:
    """Add what real casts teach to a model trained on simulated ones.

    Args:
        model: The model.
        real: D_real.
        seed: Chooses the parts of the cross-validation.
        progress: Told how many fits are done.

    Raises:
        InputError: Too few real casts, or they are of another cable or other motions.
    """
    actions, endpoints = _real_rows(real, model)
    changes = deviations(real.actions)
    began = time.monotonic()

    def fit(rows: NDArray[np.intp]) -> ForwardModel:
        correction = fit_correction(model, actions[rows], endpoints[rows], changes)
        return dataclasses.replace(model.uncorrected, correction=correction)

    folds = list(_folds(len(actions), seed))
    predicted, spread = np.empty_like(endpoints), np.empty(len(actions))
    for done, (rows, held_out) in enumerate(folds):
        _report(progress, done, len(folds) + 1)
        fold_model = fit(rows)
        predicted[held_out] = fold_model.predict(actions[held_out])
        spread[held_out] = fold_model.predict_spread(actions[held_out])
    _report(progress, len(folds), len(folds) + 1)
    corrected = fit(np.arange(len(actions)))
    _report(progress, len(folds) + 1, len(folds) + 1)
    # Offsets along x and y, in units of the spread that was predicted: 1 if it is right.
    offset = (predicted - endpoints) / spread[:, None]
    metrics = _real_metrics(real, model, actions, endpoints, predicted) | {
        "spread_calibration": float(np.sqrt(np.mean(offset**2))),
        "adaptation_seconds": round(time.monotonic() - began, 2),
    }
    return _with_info(corrected, model, real, "correction", {}, seed, metrics)


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
    """Go on training a model on real casts.

    Args:
        model: A model trained on simulated casts.
        real: D_real.
        simulated: D_sim, where `real_fraction` is below 1.
        config: How to train.
        seed: Chooses the parts of the cross-validation and the order of the rows.
        device: "cpu" or "cuda".
        progress: Told how many fits are done.

    Raises:
        InputError: Too few real casts, or they are of another cable or other motions.
    """
    config = config or FineTuningConfig()
    if config.real_fraction < 1.0 and simulated is None:
        raise InputError(f"real_fraction = {config.real_fraction:g} needs simulated casts")
    check_device(device)
    actions, endpoints = _real_rows(real, model)

    def fit(rows: NDArray[np.intp], held_out: NDArray[np.intp]):
        training, weights = _mixture(model, actions[rows], endpoints[rows], simulated, config)
        return fit_network(
            model.weights,
            training,
            _normalized(model, actions[held_out], endpoints[held_out]),
            config=config.training(),
            seed=seed,
            device=device,
            metre=model.endpoint_scale,
            row_weights=weights,
            keep_last=True,
        )

    network, curve, predicted = _cross_validate(model, actions, endpoints, fit, seed, progress)
    tuned = dataclasses.replace(model, weights=network, correction=None)
    metrics = _real_metrics(real, model, actions, endpoints, predicted)
    values = dataclasses.asdict(config)
    return _with_info(tuned, model, real, "fine-tuning", values, seed, metrics, curve)


def train_on_real(
    real: Dataset,
    *,
    config: TrainingConfig | None = None,
    seed: int = 0,
    device: str = "cpu",
    progress: Progress | None = None,
) -> ForwardModel:
    """Train the network on real casts alone: the paper's f_forw with D_real.

    Args:
        real: D_real.
        config: How to train.
        seed: Chooses first weights, order of rows, and the parts of the cross-validation.
        device: "cpu" or "cuda".
        progress: Told how many fits are done.

    Raises:
        InputError: Too few real casts.
    """
    config = config or REAL_ONLY
    check_device(device)
    actions, endpoints = _real_rows(real, None)
    features = action_features(actions)
    feature_scale = features.std(axis=0)
    known, margins = known_margins(real)
    feature_scale = np.where(feature_scale > 1e-9, feature_scale, 1.0)
    blank = ForwardModel(
        weights=initial_weights(config, features.shape[1], seed),
        feature_mean=features.mean(axis=0),
        feature_scale=feature_scale,
        endpoint_mean=endpoints.mean(axis=0),
        endpoint_scale=max(float(endpoints.std(axis=0).mean()), 1e-6),
        margin_features=np.empty((0, 4), dtype=np.float32),
        margins=margins.astype(np.float32),
        info={"dataset": dataset_summary(real)},
    )
    blank = dataclasses.replace(blank, margin_features=blank.normalize(real.actions[known]))

    def fit(rows: NDArray[np.intp], held_out: NDArray[np.intp]):
        return fit_network(
            blank.weights,
            _normalized(blank, actions[rows], endpoints[rows]),
            _normalized(blank, actions[held_out], endpoints[held_out]),
            config=config,
            seed=seed,
            device=device,
            metre=blank.endpoint_scale,
            keep_last=True,
        )

    network, curve, predicted = _cross_validate(blank, actions, endpoints, fit, seed, progress)
    model = dataclasses.replace(blank, weights=network)
    metrics = _real_metrics(real, None, actions, endpoints, predicted)
    info = {
        "config": dataclasses.asdict(config),
        "device": device,
        "versions": library_versions(),
    }
    blank = dataclasses.replace(blank, info=blank.info | info)
    return _with_info(model, blank, real, "real only", {}, seed, metrics, curve)


def _cross_validate(model, actions, endpoints, fit, seed, progress):
    """Fit to all but each part in turn, and to all.

    Returns:
        Weights from all casts, the learning curve with the held-out loss averaged over the parts,
        and the held-out predictions [m].
    """
    folds = list(_folds(len(actions), seed))
    predicted = np.empty_like(endpoints)
    held_out_losses = []
    every = np.arange(len(actions))
    with one_thread():
        for done, (rows, held_out) in enumerate(folds):
            _report(progress, done, len(folds) + 1)
            network, fold_curve = fit(rows, held_out)
            predicted[held_out] = dataclasses.replace(
                model, weights=network, correction=None
            ).predict(actions[held_out])
            held_out_losses.append([row["held_out_loss"] for row in fold_curve])
        _report(progress, len(folds), len(folds) + 1)
        network, curve = fit(every, every)
    _report(progress, len(folds) + 1, len(folds) + 1)
    for row, loss in zip(curve, np.mean(held_out_losses, axis=0), strict=True):
        row["held_out_loss"] = float(loss)
    return network, curve, predicted


def _mixture(model, actions, endpoints, simulated, config):
    """Normalised training rows, and how much each counts."""
    inputs, outputs = _normalized(model, actions, endpoints)
    if config.real_fraction >= 1.0 or simulated is None:
        return (inputs, outputs), None
    rows = simulated.finite
    sim_inputs, sim_outputs = _normalized(
        model, simulated.actions[rows], simulated.endpoint_xy[rows]
    )
    share = config.real_fraction / (1.0 - config.real_fraction)
    copies = max(1, round(share * len(sim_inputs) / len(inputs)))
    weights = np.repeat([1.0, config.real_weight], [len(sim_inputs), copies * len(inputs)])
    mixed = (
        np.concatenate([sim_inputs, np.tile(inputs, (copies, 1))]),
        np.concatenate([sim_outputs, np.tile(outputs, (copies, 1))]),
    )
    return mixed, weights


def _normalized(model, actions, endpoints):
    outputs = (endpoints - model.endpoint_mean) / model.endpoint_scale
    return model.normalize(actions), outputs.astype(np.float32)


def _folds(count: int, seed: int):
    """Rows to learn from and rows to predict, for each part."""
    order = np.random.default_rng([seed, 7]).permutation(count)
    for held_out in np.array_split(order, FOLD_COUNT):
        yield np.setdiff1d(order, held_out), held_out


def _real_rows(real: Dataset, model: ForwardModel | None):
    """Actions and endpoints of the real casts that came to rest on the table and were seen."""
    if model is not None:
        there, here = model.info["dataset"]["settings"], real.info["settings"]
        for name in ("cable", "motion", "workspace"):
            if differences := settings_differences(there.get(name, {}), here.get(name, {})):
                raise InputError(
                    f"the real casts do not fit the model: {name}.{'; '.join(differences)}"
                )
    rows = np.flatnonzero(real.ok & real.finite)
    if len(rows) < MIN_REAL_ROWS:
        raise InputError(
            f"{len(rows)} of {len(real)} real casts came to rest on the table and were seen: "
            f"learning from them needs {MIN_REAL_ROWS}"
        )
    return real.actions[rows], real.endpoint_xy[rows]


def _real_metrics(
    real: Dataset,
    model: ForwardModel | None,
    actions: NDArray[np.float64],
    endpoints: NDArray[np.float64],
    predicted: NDArray[np.float64],
) -> dict[str, Any]:
    """Errors on the real casts, each predicted by a model that has not seen it."""

    def errors_pct(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.linalg.norm(xy - endpoints, axis=1) / real.cable.length * 100

    metrics: dict[str, Any] = {
        "real_count": len(real),
        "real_used_count": len(actions),
        "real_fold_count": FOLD_COUNT,
    }
    errors = {"real": errors_pct(predicted)}
    if model is not None:
        errors["real_before"] = errors_pct(model.uncorrected.predict(actions))
    for name, values in errors.items():
        metrics |= {
            f"{name}_median_pct": float(np.median(values)),
            f"{name}_p90_pct": float(np.percentile(values, 90)),
            f"{name}_mean_pct": float(np.mean(values)),
        }
    return metrics


def _with_info(model, base, real, method, config, seed, metrics, curve=None) -> ForwardModel:
    """The model with the story of its adaptation added to that of its base."""
    info = base.info | {
        "metrics": base.info.get("metrics", {}) | metrics,
        "adaptation": {
            "method": method,
            "config": config,
            "seed": seed,
            "dataset": dataset_summary(real),
            "curve": curve or [],
        },
    }
    return dataclasses.replace(model, info=info)


def _report(progress: Progress | None, done: int, total: int) -> None:
    if progress is not None:
        progress(done, total)
