"""Training the forward model on the L2 error of equation 5."""

import contextlib
import dataclasses
import itertools
import os
import platform
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast
from cablecast.datasets.reader import Dataset
from cablecast.errors import InputError, MissingExtraError
from cablecast.models.base import action_features, dataset_summary, known_margins
from cablecast.models.forward import ForwardModel

MIN_ROWS = 50
"""Fewer rows than this cannot be split into a training and a held-out part that mean anything."""

TrainingCallback = Callable[[dict[str, float]], None]
"""Called after every epoch with a row of the learning curve."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainingConfig:
    """How the network is trained; widths are the paper's (section V-F).

    Attributes:
        hidden_width: Units of each hidden layer.
        hidden_count: Number of hidden layers.
        epochs: Passes over the training rows, along which the learning rate rises and falls.
        batch_size: Rows of a step.
        learning_rate: Greatest learning rate.
        weight_decay: Decoupled weight decay.
        held_out_fraction: Part of the rows that only validates.
        patience: Epochs without a better held-out loss after which training stops.
    """

    hidden_width: int = 256
    hidden_count: int = 4
    epochs: int = 100
    batch_size: int = 256
    learning_rate: float = 6e-3
    weight_decay: float = 1e-4
    held_out_fraction: float = 0.1
    patience: int = 25

    def __post_init__(self):
        for name, low, high in (
            ("hidden_width", 1, 65_536),
            ("hidden_count", 1, 64),
            ("epochs", 1, 1_000_000),
            ("batch_size", 1, 1_000_000),
            ("learning_rate", 1e-9, 10.0),
            ("weight_decay", 0.0, 10.0),
            ("held_out_fraction", 0.01, 0.9),
            ("patience", 1, 1_000_000),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(f"{name} = {value} is outside [{low:g}, {high:g}]")


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

    Every row with a known resting point is used, those off the table too: the simulated plane has
    no edge, so their resting points are as physical as the others, and the map is smooth across the
    edge. They support the network where it matters, just inside. Whether an action stays on the
    table is told by `ForwardModel.predict_margin`, not by the network.

    Args:
        dataset: Trials.
        config: How to train.
        seed: Chooses the held-out rows, the first weights and the order of the rows. The same seed
            gives the same weights on the same machine.
        device: "cpu" or "cuda".
        start: Go on from this model's weights and normalisation instead of from random weights.
        on_epoch: Told after every epoch how the losses stand.

    Raises:
        InputError: Too few rows with a known endpoint, or a device that is not there.
        MissingExtraError: torch is not installed.
    """
    config = config or TrainingConfig()
    rows = np.flatnonzero(dataset.finite)
    if len(rows) < MIN_ROWS:
        raise InputError(
            f"{len(rows)} of {len(dataset)} rows have a known endpoint: training needs {MIN_ROWS}"
        )
    cable_length = dataset.cable.length
    features, endpoints = action_features(dataset.actions[rows]), dataset.endpoint_xy[rows]
    order = np.random.default_rng(seed).permutation(len(rows))
    held_out_count = max(1, round(config.held_out_fraction * len(rows)))
    held_out, training = order[:held_out_count], order[held_out_count:]
    if start is None:
        feature_mean, feature_scale = (
            features[training].mean(axis=0),
            features[training].std(axis=0),
        )
        # An action set without psi has a feature that never varies.
        feature_scale = np.where(feature_scale > 1e-9, feature_scale, 1.0)
        endpoint_mean = endpoints[training].mean(axis=0)
        endpoint_scale = max(float(endpoints[training].std(axis=0).mean()), 1e-6)
        weights = initial_weights(config, features.shape[1], seed)
    else:
        feature_mean, feature_scale = start.feature_mean, start.feature_scale
        endpoint_mean, endpoint_scale = start.endpoint_mean, start.endpoint_scale
        weights = start.weights

    inputs = ((features - feature_mean) / feature_scale).astype(np.float32)
    outputs = ((endpoints - endpoint_mean) / endpoint_scale).astype(np.float32)
    began = time.monotonic()
    with one_thread():
        weights, curve = fit_network(
            weights,
            (inputs[training], outputs[training]),
            (inputs[held_out], outputs[held_out]),
            config=config,
            seed=seed,
            device=device,
            metre=endpoint_scale,
            on_epoch=on_epoch,
        )
    known, margins = known_margins(dataset)
    model = ForwardModel(
        weights=weights,
        feature_mean=feature_mean,
        feature_scale=feature_scale,
        endpoint_mean=endpoint_mean,
        endpoint_scale=endpoint_scale,
        margin_features=(
            (action_features(dataset.actions[known]) - feature_mean) / feature_scale
        ).astype(np.float32),
        margins=margins.astype(np.float32),
    )
    error = np.linalg.norm(
        model.predict(dataset.actions[rows[held_out]]) - endpoints[held_out], axis=1
    )
    metrics: dict[str, Any] = {
        "held_out_count": len(held_out),
        "held_out_median_pct": float(np.median(error) / cable_length * 100),
        "held_out_p90_pct": float(np.percentile(error, 90) / cable_length * 100),
        "held_out_mean_pct": float(np.mean(error) / cable_length * 100),
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


def check_device(device: str) -> None:
    """Refuse a device that training cannot run on.

    Args:
        device: "cpu" or "cuda".

    Raises:
        InputError: Another name, or no CUDA device was found.
        MissingExtraError: torch is not installed.
    """
    if device not in ("cpu", "cuda"):
        raise InputError(f"device {device!r} must be 'cpu' or 'cuda'")
    torch = _torch()
    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("device 'cuda' is not available: no CUDA device was found, use cpu")


def initial_weights(
    config: TrainingConfig, input_count: int, seed: int
) -> tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]:
    """Random first weights, scaled so that every layer keeps the variance (He).

    Args:
        config: Widths.
        input_count: Number of features.
        seed: Chooses them, on any machine and device the same.
    """
    generator = np.random.default_rng([seed, 1])
    widths = [input_count, *[config.hidden_width] * config.hidden_count, 2]
    layers = []
    for fan_in, fan_out in itertools.pairwise(widths):
        matrix = generator.normal(scale=np.sqrt(2.0 / fan_in), size=(fan_in, fan_out))
        layers.append((matrix.astype(np.float32), np.zeros(fan_out, dtype=np.float32)))
    return tuple(layers)


def fit_network(
    weights,
    training,
    held_out,
    *,
    config,
    seed,
    device,
    metre,
    on_epoch=None,
    row_weights=None,
    keep_last=False,
):
    """Run the optimiser; returns the weights of the best epoch and the learning curve.

    Args:
        weights: First weights by layer.
        training: Normalised inputs and outputs to learn.
        held_out: Normalised inputs and outputs to validate with.
        config: How to train.
        seed: Chooses the order of the rows.
        device: "cpu" or "cuda".
        metre: Metres per unit of the normalised outputs.
        on_epoch: Told after every epoch.
        row_weights: How much each training row counts, shape [row]; all the same where None.
        keep_last: Keep the weights of the last epoch rather than of the best.
    """
    check_device(device)
    torch = _torch()

    def tensor(values):
        return torch.tensor(np.asarray(values), device=device)

    layers = [(tensor(m).requires_grad_(), tensor(o).requires_grad_()) for m, o in weights]
    parameters = [p for layer in layers for p in layer]
    (x, y), (x_held_out, y_held_out) = ([tensor(a) for a in pair] for pair in (training, held_out))

    def network(hidden):
        for matrix, offset in layers[:-1]:
            hidden = torch.nn.functional.silu(torch.addmm(offset, hidden, matrix))
        return torch.addmm(layers[-1][1], hidden, layers[-1][0])

    counts = None if row_weights is None else tensor(np.asarray(row_weights, dtype=np.float32))

    def loss(predicted, wanted, count=None):
        # The norm itself, not its square (equation 5): outliers near folds of the map do not rule.
        distance = torch.linalg.vector_norm(predicted - wanted, dim=1)
        return distance.mean() if count is None else (count * distance).sum() / count.sum()

    batch_size = min(config.batch_size, len(x))
    batch_count = -(-len(x) // batch_size)
    optimizer = torch.optim.AdamW(
        parameters, lr=config.learning_rate, weight_decay=config.weight_decay
    )
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer,
        max_lr=config.learning_rate,
        total_steps=config.epochs * batch_count,
        pct_start=0.15,
        final_div_factor=1e3,
    )
    shuffle = np.random.default_rng([seed, 2])
    best, best_loss, best_epoch, curve = None, np.inf, 0, []
    for epoch in range(1, config.epochs + 1):
        order = tensor(shuffle.permutation(len(x)))
        total = 0.0
        for rows in order.split(batch_size):
            optimizer.zero_grad(set_to_none=True)
            value = loss(network(x[rows]), y[rows], None if counts is None else counts[rows])
            value.backward()
            optimizer.step()
            schedule.step()
            total += value.detach() * len(rows)
        with torch.no_grad():
            held_out_loss = float(loss(network(x_held_out), y_held_out)) * metre
        curve.append(
            {
                "epoch": epoch,
                "loss": float(total) / len(x) * metre,
                "held_out_loss": held_out_loss,
                "learning_rate": optimizer.param_groups[0]["lr"],
            }
        )
        if on_epoch is not None:
            on_epoch(curve[-1])
        if held_out_loss < best_loss or (keep_last and np.isfinite(held_out_loss)):
            best_loss, best_epoch = held_out_loss, epoch
            best = [(m.detach().clone(), o.detach().clone()) for m, o in layers]
        elif epoch - best_epoch >= config.patience:
            break
    if best is None:
        raise InputError(
            f"training diverged: no finite loss with learning_rate = {config.learning_rate:g}"
        )
    return tuple((m.cpu().numpy(), o.cpu().numpy()) for m, o in best), curve


@contextlib.contextmanager
def one_thread():
    """Keep torch to one thread for a while.

    A few hundred rows through 256 units are microseconds of work: threads that wait for each other
    at every layer cost more than they bring, and on a busy machine ten times as much.
    """
    torch = _torch()
    thread_count = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(thread_count)


def _torch():
    # OpenMP's threads wait for each other by spinning, some forty times a step. When anything else
    # runs on the same cores, they mostly spin for one that is not running: training then took 15
    # times as long as on one thread. They read this wish once, when the library is loaded.
    wish = "OMP_WAIT_POLICY"
    is_ours = "torch" not in sys.modules and wish not in os.environ
    if is_ours:
        os.environ[wish] = "PASSIVE"
    try:
        import torch
    except ImportError:
        raise MissingExtraError("torch", "learn", "training the forward model") from None
    finally:
        if is_ours:
            del os.environ[wish]
    return torch


def library_versions() -> dict[str, str]:
    """Versions of what decides the weights."""
    return {
        "cablecast": cablecast.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "torch": str(_torch().__version__),
    }
