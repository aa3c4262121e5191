"""Training of the forward model on simulated casts."""

import dataclasses
import time

import numpy as np
from numpy.typing import NDArray

from cablecast.datasets.reader import Dataset
from cablecast.machine import library_versions
from cablecast.models.features import FEATURE_COUNT, normalization
from cablecast.models.forward import ForwardModel
from cablecast.models.rows import dataset_summary, error_metrics, known_endpoint_rows
from cablecast.models.torch_ import one_thread
from cablecast.models.training import (
    TrainingCallback,
    TrainingConfig,
    fit_network,
    initial_weights,
    normalized_casts,
)


def train_forward_model(
    dataset: Dataset,
    *,
    config: TrainingConfig | None = None,
    seed: int = 0,
    device: str = "cpu",
    start: ForwardModel | None = None,
    on_epoch: TrainingCallback | None = None,
) -> ForwardModel:
    """Train the forward model on a dataset.

    All rows with a known endpoint are used, including those off the table. The simulated plane has
    no edge, so these endpoints are equally physical and vary smoothly across the edge. They support
    the network just inside it. `ForwardModel.predict_margin` predicts whether an action keeps the
    cable on the table; the network does not.

    Args:
        dataset: Simulated casts.
        config: Settings of the training.
        seed: Seed for the held-out rows, the initial weights and the order of the rows. Equal seeds
            give equal weights on the same machine.
        device: "cpu" or "cuda".
        start: Model whose weights and normalisation to start from, instead of random weights.
        on_epoch: Called after every epoch with a row of the learning curve.

    Raises:
        InputError: There are too few rows with a known endpoint, the device is not available, or
            the training diverged.
        MissingExtraError: torch is not installed.
    """
    config = config or TrainingConfig()
    rows = known_endpoint_rows(dataset)
    actions, endpoint_xy = dataset.actions[rows], dataset.endpoint_xy[rows]
    order = np.random.default_rng(seed).permutation(len(rows))
    held_out_count = max(1, round(config.held_out_fraction * len(rows)))
    held_out, training = order[:held_out_count], order[held_out_count:]
    model = start.uncorrected if start is not None else None
    if model is None:
        model = untrained_model(actions[training], endpoint_xy[training], config, seed)
    model = model.with_margins(dataset)
    began = time.monotonic()
    with one_thread():
        weights, curve = fit_network(
            model.weights,
            normalized_casts(model, actions[training], endpoint_xy[training]),
            normalized_casts(model, actions[held_out], endpoint_xy[held_out]),
            config=config,
            seed=seed,
            device=device,
            metre=model.endpoint_scale,
            on_epoch=on_epoch,
        )
    model = dataclasses.replace(model, weights=weights)
    predicted = model.predict(actions[held_out])
    metrics = {
        "held_out_count": len(held_out),
        **error_metrics("held_out", predicted, endpoint_xy[held_out], dataset.cable.length),
        "training_count": len(training),
        "unknown_endpoint_count": len(dataset) - len(rows),
        "off_table_count": int(np.sum(dataset.status == "off_table")),
        "epoch_count": len(curve),
        "best_epoch": min(curve, key=lambda row: row["held_out_loss"])["epoch"],
        "training_seconds": round(time.monotonic() - began, 2),
    }
    info = {
        "config": dataclasses.asdict(config),
        "seed": seed,
        "device": device,
        "versions": library_versions(),
        "metrics": metrics,
        "curve": curve,
        "dataset": dataset_summary(dataset),
    }
    return dataclasses.replace(model, info=info)


def untrained_model(
    actions: NDArray[np.float64],
    endpoint_xy: NDArray[np.float64],
    config: TrainingConfig,
    seed: int,
) -> ForwardModel:
    """Return a model with random weights and the normalisation of some casts.

    Args:
        actions: Actions of the casts, shape [row, 4].
        endpoint_xy: Their endpoints [m], shape [row, 2].
        config: Widths of the layers.
        seed: Seed of the weights.
    """
    return ForwardModel(
        **normalization(actions, endpoint_xy),
        weights=initial_weights(config, FEATURE_COUNT, seed),
    )
