"""Fit of a model to the simulated casts of a dataset, and the record of it."""

import dataclasses
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cablecast.datasets.reader import Dataset
from cablecast.machine import library_versions
from cablecast.models.forward import ForwardModel
from cablecast.models.many_cables import ManyCablesModel
from cablecast.models.rows import dataset_summary, error_metrics, known_endpoint_rows
from cablecast.models.torch_ import one_thread
from cablecast.models.training import Casts, TrainingCallback, TrainingConfig, fit_network

Model = TypeVar("Model", ForwardModel, ManyCablesModel)
Rows = NDArray[np.intp]


def split_rows(dataset: Dataset, config: TrainingConfig, seed: int) -> tuple[Rows, Rows]:
    """Return the rows to train with and those to hold out, of all with a known endpoint.

    Args:
        dataset: Simulated casts.
        config: Share of the rows to hold out.
        seed: Seed of the choice.

    Raises:
        InputError: There are too few rows.
    """
    rows = known_endpoint_rows(dataset)
    order = rows[np.random.default_rng(seed).permutation(len(rows))]
    held_out_count = max(1, round(config.held_out_fraction * len(order)))
    return order[held_out_count:], order[:held_out_count]


def fit_model(
    model: Model,
    dataset: Dataset,
    split: tuple[Rows, Rows],
    *,
    casts: Callable[[Rows], Casts],
    predict: Callable[[Model, Rows], NDArray[np.float64]],
    config: TrainingConfig,
    seed: int,
    device: str,
    on_epoch: TrainingCallback | None,
) -> Model:
    """Return a model with fitted weights, whose `info` tells how they were fitted.

    Args:
        model: Model with the initial weights and the normalisation.
        dataset: Simulated casts.
        split: Rows to train with and rows to hold out.
        casts: Function that returns rows as the network is trained on them.
        predict: Function that returns a model's endpoints of rows [m], shape [row, 2].
        config: Settings of the training.
        seed: Seed of the order of the rows.
        device: "cpu" or "cuda".
        on_epoch: Called after every epoch with a row of the learning curve.

    Raises:
        InputError: The device is not available, or the training diverged.
        MissingExtraError: torch is not installed.
    """
    training, held_out = split
    began = time.monotonic()
    with one_thread():
        weights, curve = fit_network(
            model.weights,
            casts(training),
            casts(held_out),
            config=config,
            seed=seed,
            device=device,
            metre=model.endpoint_scale,
            on_epoch=on_epoch,
        )
    fitted = dataclasses.replace(model, weights=weights)
    errors = error_metrics(
        "held_out", predict(fitted, held_out), dataset.endpoint_xy[held_out], dataset.cable.length
    )
    metrics = {
        "held_out_count": len(held_out),
        **errors,
        "training_count": len(training),
        "unknown_endpoint_count": len(dataset) - len(training) - len(held_out),
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
    return dataclasses.replace(fitted, info=info)
