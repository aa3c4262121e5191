"""Training of the model of many cables."""

import numpy as np
from numpy.typing import NDArray

from cablecast.datasets.reader import Dataset
from cablecast.errors import InputError
from cablecast.models.cable_features import CABLE_FEATURES, cable_features
from cablecast.models.features import FEATURE_COUNT, normalization
from cablecast.models.fitting import fit_model, split_rows
from cablecast.models.many_cables import POINT_COUNT, ManyCablesModel
from cablecast.models.rows import dataset_summary
from cablecast.models.training import (
    Casts,
    TrainingCallback,
    TrainingConfig,
    initial_weights,
)

MANY_CABLES_CONFIG = TrainingConfig(
    hidden_count=6,
    epochs=40,
    batch_size=512,
    weight_decay=0.03,
    held_out_fraction=0.05,
    patience=40,
)
"""Settings of the training. Every cast has its own cable, so those held out have cables that the
network never saw."""

MARGIN_COUNT = 10_000
"""Largest number of actions for which a cable's model knows the table margin."""


def train_many_cables(
    dataset: Dataset,
    *,
    config: TrainingConfig = MANY_CABLES_CONFIG,
    seed: int = 0,
    device: str = "cpu",
    on_epoch: TrainingCallback | None = None,
) -> ManyCablesModel:
    """Train the model of many cables on a dataset in which every cast has its own cable.

    Args:
        dataset: Simulated casts with their parameters.
        config: Settings of the training.
        seed: Seed for the held-out rows, the initial weights and the order of the rows.
        device: "cpu" or "cuda".
        on_epoch: Called after every epoch with a row of the learning curve.

    Raises:
        InputError: The casts are of one cable, there are too few rows with a known endpoint, the
            device is not available, or the training diverged.
        MissingExtraError: torch is not installed.
    """
    if not dataset.has_many_cables:
        raise InputError("the casts are of one cable: the model of many cables needs many")
    split = split_rows(dataset, config, seed)
    model = _untrained(dataset, split[0], config, seed)
    return fit_model(
        model,
        dataset,
        split,
        casts=lambda rows: _normalized(model, dataset, rows),
        predict=lambda fitted, rows: fitted.predict(
            dataset.actions[rows], dataset.params.rows(rows)
        ),
        config=config,
        seed=seed,
        device=device,
        on_epoch=on_epoch,
    )


def _untrained(
    dataset: Dataset, training: NDArray[np.intp], config: TrainingConfig, seed: int
) -> ManyCablesModel:
    """Return a model with random weights and the normalisation of the training rows."""
    cables = cable_features(dataset.params.rows(training), dataset.cable)
    input_count = FEATURE_COUNT + len(CABLE_FEATURES)
    return ManyCablesModel(
        **normalization(dataset.actions[training], dataset.endpoint_xy[training]),
        cable_low=cables.min(axis=0),
        cable_high=cables.max(axis=0),
        margin_actions=dataset.actions[training[:MARGIN_COUNT]],
        weights=initial_weights(config, input_count, seed, 2 * POINT_COUNT),
        info={"dataset": dataset_summary(dataset)},
    )


def _normalized(model: ManyCablesModel, dataset: Dataset, rows: NDArray[np.intp]) -> Casts:
    """Return rows of a dataset as the network is trained on them."""
    inputs = model.normalize(dataset.actions[rows], dataset.params.rows(rows))
    x_min, x_max, y_min, y_max = dataset.extent[rows].T
    points = np.stack([dataset.endpoint_xy[rows].T, [x_min, y_min], [x_max, y_max]])
    outputs = (points.transpose(2, 0, 1) - model.endpoint_mean) / model.endpoint_scale
    return inputs, outputs.reshape(len(rows), -1).astype(np.float32)
