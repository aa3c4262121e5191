"""Training of the forward model on simulated casts."""

import numpy as np
from numpy.typing import NDArray

from cablecast.datasets.reader import Dataset
from cablecast.models.features import FEATURE_COUNT, normalization
from cablecast.models.fitting import fit_model, split_rows
from cablecast.models.forward import ForwardModel
from cablecast.models.training import (
    TrainingCallback,
    TrainingConfig,
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
    training, held_out = split_rows(dataset, config, seed)
    actions, endpoint_xy = dataset.actions, dataset.endpoint_xy
    model = start.uncorrected if start is not None else None
    if model is None:
        model = untrained_model(actions[training], endpoint_xy[training], config, seed)
    model = model.with_margins(dataset)
    return fit_model(
        model,
        dataset,
        (training, held_out),
        casts=lambda rows: normalized_casts(model, actions[rows], endpoint_xy[rows]),
        predict=lambda fitted, rows: fitted.predict(actions[rows]),
        config=config,
        seed=seed,
        device=device,
        on_epoch=on_epoch,
    )


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
