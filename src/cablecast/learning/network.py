"""Forward model f_forw: a neural network from an action to the endpoint (paper, section V-F).

It is trained on simulated casts (D_sim), on casts of a rig (D_real), or on the first and then on
the second, with the L2 error of equation 5 as its loss.
"""

import dataclasses
import itertools
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.conventions import stream
from cablecast.data.dataset import Dataset
from cablecast.errors import InputError, check_count, check_number
from cablecast.files import library_versions
from cablecast.learning.checkpoint import check_device, import_torch, one_thread
from cablecast.learning.landing import (
    FEATURE_COUNT,
    MIN_REAL_ROWS,
    LandingModel,
    dataset_summary,
    error_metrics,
    is_paced,
    known_endpoint_rows,
    normalization,
)
from cablecast.runs.folder import settings_differences
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.setup import SECTIONS
from cablecast.task import LANDING, Task

# Rows per pass through the network: enough for fast products, few enough for the cache.
_CHUNK_ROWS = 4096

Weights = tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]
"""Matrix, shape [in, out], and offset, shape [out], of each layer."""


def network_outputs(inputs: NDArray[np.float32], weights: Weights) -> NDArray[np.float64]:
    """Return the outputs of a network.

    Args:
        inputs: Normalised features, shape [row, feature].
        weights: Matrix and offset of each layer.

    Returns:
        Normalised outputs, shape [row, output].
    """
    outputs = np.empty((len(inputs), len(weights[-1][1])))
    for start in range(0, len(inputs), _CHUNK_ROWS):
        hidden = inputs[start : start + _CHUNK_ROWS]
        for layer, (matrix, offset) in enumerate(weights):
            hidden = hidden @ matrix + offset
            if layer < len(weights) - 1:
                # Far below zero exp overflows to infinity, and SiLU is then zero as it should.
                with np.errstate(over="ignore"):
                    hidden /= 1.0 + np.exp(-hidden)
        outputs[start : start + _CHUNK_ROWS] = hidden
    return outputs


@dataclasses.dataclass(frozen=True, kw_only=True)
class ForwardModel(LandingModel):
    """A trained network.

    Attributes:
        weights: Matrix and offset of each layer. SiLU follows every layer but the last.
    """

    weights: Weights

    FORMAT = "cablecast.forward_model"

    def predict(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Predict where the free end comes to rest; see `LandingModel.predict`."""
        outputs = network_outputs(self.normalize(actions), self.weights)
        return self.endpoint_mean + self.endpoint_scale * outputs

    def normalized_casts(
        self, actions: NDArray[np.float64], endpoint_xy: NDArray[np.float64]
    ) -> "Casts":
        """Return actions, shape [row, 5], and outcomes [m], shape [row, k], for training."""
        return self.normalize(actions), self.normalize_endpoints(endpoint_xy).astype(np.float32)

    def _own_tensors(self) -> dict[str, NDArray]:
        tensors: dict[str, NDArray] = {}
        for k, (matrix, offset) in enumerate(self.weights):
            tensors |= {f"layer{k}.matrix": matrix, f"layer{k}.offset": offset}
        return tensors

    @classmethod
    def _own_fields(cls, tensors: dict[str, NDArray]) -> dict[str, Any]:
        count = sum(name.endswith(".matrix") for name in tensors)
        layers = ((tensors[f"layer{k}.matrix"], tensors[f"layer{k}.offset"]) for k in range(count))
        return {"weights": tuple(layers)}


# Fraction of the steps in which the learning rate rises, and the factor by which it falls below its
# initial value at the end.
_RISE_FRACTION = 0.15
_FINAL_DIVISOR = 1e3

FOLD_COUNT = 5
"""Number of folds of the cross-validation on real casts."""

TrainingCallback = Callable[[dict[str, float]], None]
"""Called after every epoch with a row of the learning curve."""

Curve = list[dict[str, float]]
Rows = NDArray[np.intp]

Casts = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Normalised features, shape [row, 5], and normalised outcomes, shape [row, k]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainingConfig:
    """Settings of the training. The widths are the paper's (section V-F).

    Attributes:
        hidden_width: Number of units of each hidden layer.
        hidden_count: Number of hidden layers.
        epochs: Passes over the training rows, during which the learning rate rises and falls once.
        batch_size: Number of rows per step.
        learning_rate: Maximum learning rate.
        weight_decay: Decoupled weight decay.
        held_out_fraction: Fraction of the simulated casts that is used for validation only.
        patience: Epochs without a better held-out loss after which the training stops.
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
            ("patience", 1, 1_000_000),
        ):
            check_count(name, getattr(self, name), low, high)
        for name, low, high in (
            ("learning_rate", 1e-9, 10.0),
            ("weight_decay", 0.0, 10.0),
            ("held_out_fraction", 0.01, 0.9),
        ):
            check_number(name, getattr(self, name), low, high)


FINE_TUNING = TrainingConfig(epochs=400, learning_rate=1e-3, weight_decay=0.0, patience=400)
"""Settings for fine-tuning on a few hundred real casts. The widths are those of the model."""

REAL_ONLY = TrainingConfig(
    epochs=300, batch_size=64, learning_rate=3e-3, weight_decay=1e-2, patience=300
)
"""Settings for training a network on a few hundred real casts alone."""


def initial_weights(config: TrainingConfig, seed: int, *, paced: bool, size: int = 2) -> Weights:
    """Return random weights that keep the variance from layer to layer (He).

    Args:
        config: Widths of the layers.
        seed: Seed of the weights, which are the same on any machine and device.
        paced: Whether the pace varies; the weights of a feature that is always 0 are 0.
        size: Number of components of the outcome.
    """
    generator = stream(seed, "weights")
    feature_count = FEATURE_COUNT if paced else FEATURE_COUNT - 1
    widths = [feature_count, *[config.hidden_width] * config.hidden_count, size]
    layers = []
    for fan_in, fan_out in itertools.pairwise(widths):
        matrix = generator.normal(scale=np.sqrt(2.0 / fan_in), size=(fan_in, fan_out))
        layers.append((matrix.astype(np.float32), np.zeros(fan_out, dtype=np.float32)))
    if not paced:
        layers[0] = (np.pad(layers[0][0], ((0, 1), (0, 0))), layers[0][1])
    return tuple(layers)


def fit_network(
    weights: Weights,
    training: Casts,
    held_out: Casts,
    *,
    config: TrainingConfig,
    seed: int,
    device: str,
    metre: float,
    on_epoch: TrainingCallback | None = None,
    keep_last: bool = False,
) -> tuple[Weights, Curve]:
    """Train a network.

    Args:
        weights: Initial weights.
        training: Rows to train on.
        held_out: Rows to validate with.
        config: Settings of the training.
        seed: Seed for the order of the rows.
        device: "cpu" or "cuda".
        metre: Length of one unit of the normalised endpoints [m].
        on_epoch: Called after every epoch.
        keep_last: Whether to return the weights of the last epoch instead of the best.

    Returns:
        The weights of the epoch with the least held-out loss, and the learning curve. Its losses
        are mean distances [m].

    Raises:
        InputError: The device is not available, or no held-out loss was finite.
        MissingExtraError: torch is not installed.
    """
    check_device(device)
    torch = import_torch("training the forward model")

    def tensors(arrays) -> list[Any]:
        return [torch.tensor(np.asarray(array), device=device) for array in arrays]

    layers = [[tensor.requires_grad_() for tensor in tensors(layer)] for layer in weights]

    def loss(inputs, wanted):
        hidden = inputs
        for matrix, offset in layers[:-1]:
            hidden = torch.nn.functional.silu(torch.addmm(offset, hidden, matrix))
        predicted = torch.addmm(layers[-1][1], hidden, layers[-1][0])
        # Equation 5 takes the norm, not its square, so outliers count less. They occur where the
        # endpoint folds back as the action changes.
        return torch.linalg.vector_norm(predicted - wanted, dim=1).mean()

    inputs, wanted = tensors(training)
    held_out_tensors = tensors(held_out)
    batch_size = min(config.batch_size, len(inputs))
    optimizer = torch.optim.AdamW(
        [tensor for layer in layers for tensor in layer],
        lr=config.learning_rate,
        weight_decay=config.weight_decay,
        foreach=True,
    )
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer,
        max_lr=config.learning_rate,
        total_steps=config.epochs * -(-len(inputs) // batch_size),
        pct_start=_RISE_FRACTION,
        final_div_factor=_FINAL_DIVISOR,
    )
    shuffle = stream(seed, "epochs")
    best, best_loss, best_epoch = None, np.inf, 0
    curve: Curve = []
    for epoch in range(1, config.epochs + 1):
        (order,) = tensors([shuffle.permutation(len(inputs))])
        total = torch.zeros((), device=device)
        for rows in order.split(batch_size):
            optimizer.zero_grad(set_to_none=True)
            value = loss(inputs[rows], wanted[rows])
            value.backward()
            optimizer.step()
            schedule.step()
            total += value.detach() * len(rows)
        with torch.no_grad():
            held_out_loss = float(loss(*held_out_tensors)) * metre
        curve.append(
            {
                "epoch": epoch,
                "loss": float(total) / len(inputs) * metre,
                "held_out_loss": held_out_loss,
                "learning_rate": optimizer.param_groups[0]["lr"],
            }
        )
        if on_epoch is not None:
            on_epoch(curve[-1])
        if keep_last and not np.isfinite(held_out_loss):
            best = None
            break
        if held_out_loss < best_loss or keep_last:
            best_loss, best_epoch = held_out_loss, epoch
            best = tuple(
                (matrix.detach().cpu().numpy().copy(), offset.detach().cpu().numpy().copy())
                for matrix, offset in layers
            )
        elif epoch - best_epoch >= config.patience:
            break
    if best is None:
        raise InputError(
            f"training diverged: no finite loss with learning_rate = {config.learning_rate:g}"
        )
    return best, curve


def train_forward_model(
    dataset: Dataset,
    *,
    task: Task = LANDING,
    config: TrainingConfig | None = None,
    seed: int = 0,
    device: str = "cpu",
    on_epoch: TrainingCallback | None = None,
) -> ForwardModel:
    """Train the forward model on simulated casts.

    All rows with a known endpoint on the table are used. `ForwardModel.predict_margin` predicts
    whether an action keeps the cable on the table; the network does not.

    Args:
        dataset: Simulated casts.
        task: Task whose outcomes the model predicts.
        config: Settings of the training.
        seed: Seed for the held-out rows, the initial weights and the order of the rows. Equal seeds
            give equal weights on the same machine.
        device: "cpu" or "cuda".
        on_epoch: Called after every epoch with a row of the learning curve.

    Raises:
        InputError: There are too few rows with a known endpoint, the device is not available, or
            the training diverged.
        MissingExtraError: torch is not installed.
    """
    config = config or TrainingConfig()
    rows = known_endpoint_rows(dataset, task)
    order = rows[stream(seed, "held-out casts").permutation(len(rows))]
    held_out_count = max(1, round(config.held_out_fraction * len(order)))
    held_out, training = order[:held_out_count], order[held_out_count:]
    actions = dataset.actions
    endpoint_xy = dataset.outcomes(task) / task.units(dataset.setup)
    paced = is_paced(actions[training])
    model = ForwardModel(
        **normalization(actions[training], endpoint_xy[training]),
        weights=initial_weights(config, seed, paced=paced, size=endpoint_xy.shape[1]),
        task=task,
    ).with_margins(dataset)
    began = time.monotonic()
    with one_thread():
        weights, curve = fit_network(
            model.weights,
            model.normalized_casts(actions[training], endpoint_xy[training]),
            model.normalized_casts(actions[held_out], endpoint_xy[held_out]),
            config=config,
            seed=seed,
            device=device,
            metre=model.endpoint_scale,
            on_epoch=on_epoch,
        )
    model = dataclasses.replace(model, weights=weights)
    metrics = {
        "held_out_count": len(held_out),
        **error_metrics(
            "held_out",
            model.predict(actions[held_out]),
            endpoint_xy[held_out],
            dataset.cable.length,
        ),
        "training_count": len(training),
        "unknown_endpoint_count": len(dataset) - len(order),
        "off_table_count": int(np.sum(dataset.status == "off_table")),
        "epoch_count": len(curve),
        "best_epoch": min(curve, key=lambda row: row["held_out_loss"])["epoch"],
        "training_seconds": round(time.monotonic() - began, 2),
    }
    return dataclasses.replace(
        model,
        info={
            "config": dataclasses.asdict(config),
            "seed": seed,
            "device": device,
            "versions": library_versions(),
            "metrics": metrics,
            "curve": curve,
            "dataset": dataset_summary(dataset),
        },
    )


def fine_tune(
    model: ForwardModel,
    real: Dataset,
    *,
    config: TrainingConfig = FINE_TUNING,
    seed: int = 0,
    device: str = "cpu",
    progress: ProgressCallback = ignore,
) -> ForwardModel:
    """Continue the training of a model on real casts, the paper's f_forw with D_sim and D_real.

    Casts that left the table or were not seen have no endpoint and are not used. The errors on real
    casts are cross-validated: every cast is predicted once by a model that has not seen it.

    Args:
        model: Model trained on simulated casts.
        real: Real casts, D_real.
        config: Settings of the training; its widths are not used.
        seed: Seed for the folds of the cross-validation and the order of the rows.
        device: "cpu" or "cuda".
        progress: Told the fits done.

    Raises:
        InputError: There are too few real casts, or they are of another cable or other motions.
        MissingExtraError: torch is not installed.
    """
    there, here = model.settings.values, real.settings.values
    for name in SECTIONS:
        if differences := settings_differences(there.get(name, {}), here.get(name, {})):
            raise InputError(
                f"the real casts do not match the model: {name}.{'; '.join(differences)}"
            )
    rows, ends = real_rows(real), real.outcomes(model.task)
    before = error_metrics(
        "real_before", model.predict(real.actions[rows]), ends[rows], real.cable.length
    )
    return _fit_to_real(
        model, real, rows, "fine-tuning", config, seed, device, progress, metrics=before
    )


def train_on_real(
    real: Dataset,
    *,
    config: TrainingConfig = REAL_ONLY,
    seed: int = 0,
    device: str = "cpu",
    progress: ProgressCallback = ignore,
) -> ForwardModel:
    """Train a network on real casts alone, the paper's f_forw with D_real; see `fine_tune`.

    Args:
        real: Real casts, D_real.
        config: Settings of the training.
        seed: Seed for the initial weights, the order of the rows and the folds.
        device: "cpu" or "cuda".
        progress: Told the fits done.

    Raises:
        InputError: There are too few real casts.
        MissingExtraError: torch is not installed.
    """
    rows = real_rows(real)
    blank = ForwardModel(
        **normalization(real.actions[rows], real.rest_xy[rows]),
        weights=initial_weights(config, seed, paced=is_paced(real.actions[rows])),
        info={
            "config": dataclasses.asdict(config),
            "device": device,
            "versions": library_versions(),
            "dataset": dataset_summary(real),
        },
    ).with_margins(real)
    return _fit_to_real(blank, real, rows, "real only", config, seed, device, progress)


def real_rows(real: Dataset) -> Rows:
    """Return the rows of real casts that came to rest on the table and were seen.

    Raises:
        InputError: There are too few.
    """
    rows = np.flatnonzero(real.ok & real.finite & np.isfinite(real.actions).all(axis=1))
    if len(rows) < MIN_REAL_ROWS:
        raise InputError(
            f"{len(rows)} of {len(real)} real casts came to rest on the table and were seen: "
            f"learning from them needs {MIN_REAL_ROWS}"
        )
    return rows


def folds(count: int, seed: int) -> Iterator[tuple[Rows, Rows]]:
    """Yield the rows to train on and the held-out rows of each fold of `count` rows."""
    order = stream(seed, "folds").permutation(count)
    for held_out in np.array_split(order, FOLD_COUNT):
        yield np.setdiff1d(order, held_out), held_out


def _fit_to_real(
    start: ForwardModel,
    real: Dataset,
    rows: Rows,
    method: str,
    config: TrainingConfig,
    seed: int,
    device: str,
    progress: ProgressCallback,
    *,
    metrics: dict[str, float] | None = None,
) -> ForwardModel:
    """Cross-validate a network, fit it to all rows, and record both in `info`."""
    check_device(device)
    actions, endpoint_xy = real.actions[rows], real.rest_xy[rows]
    every = np.arange(len(rows))
    # The last fit is the one to all rows, which is validated on the rows that it was fitted to.
    jobs = [*folds(len(rows), seed), (every, every)]
    fits: list[tuple[Weights, Curve]] = []
    task = "Training on real casts"
    with one_thread():
        for training, held_out in jobs:
            progress(Progress(task=task, done=len(fits), total=len(jobs), unit="fits"))
            fits.append(
                fit_network(
                    start.weights,
                    start.normalized_casts(actions[training], endpoint_xy[training]),
                    start.normalized_casts(actions[held_out], endpoint_xy[held_out]),
                    config=config,
                    seed=seed,
                    device=device,
                    metre=start.endpoint_scale,
                    keep_last=True,
                )
            )
    progress(Progress(task=task, done=len(jobs), total=len(jobs), unit="fits"))
    predicted = np.empty((len(rows), 2))
    for (_, held_out), (weights, _) in zip(jobs[:-1], fits[:-1], strict=True):
        fold_model = dataclasses.replace(start, weights=weights)
        predicted[held_out] = fold_model.predict(actions[held_out])
    weights, curve = fits[-1]
    # Its held-out loss is the mean over the folds.
    losses = np.mean([[row["held_out_loss"] for row in each] for _, each in fits[:-1]], axis=0)
    curve = [row | {"held_out_loss": float(x)} for row, x in zip(curve, losses, strict=True)]
    info = start.info | {
        "metrics": start.info.get("metrics", {})
        | {
            "real_count": len(real),
            "real_used_count": len(rows),
            "real_fold_count": FOLD_COUNT,
            **error_metrics("real", predicted, endpoint_xy, real.cable.length),
            **(metrics or {}),
        },
        "adaptation": {
            "method": method,
            "config": dataclasses.asdict(config),
            "seed": seed,
            "dataset": dataset_summary(real),
            "curve": curve,
        },
    }
    return dataclasses.replace(start, weights=weights, info=info)
