"""Training of a network on normalised casts with the L2 error of equation 5 as its loss."""

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.models.landing import LandingModel
from cablecast.models.network import Weights
from cablecast.models.torch_ import check_device, import_torch

# Fraction of the steps in which the learning rate rises, and the factor by which it falls below its
# initial value at the end.
_RISE_FRACTION = 0.15
_FINAL_DIVISOR = 1e3

TrainingCallback = Callable[[dict[str, float]], None]
"""Called after every epoch with a row of the learning curve."""

Casts = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Normalised features, shape [row, feature], and one or more normalised points, x before y, such as
the endpoint, shape [row, 2 * point]."""


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
        held_out_fraction: Fraction of the rows that is used for validation only.
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
            ("learning_rate", 1e-9, 10.0),
            ("weight_decay", 0.0, 10.0),
            ("held_out_fraction", 0.01, 0.9),
            ("patience", 1, 1_000_000),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(f"{name} = {value} is outside [{low:g}, {high:g}]")


def initial_weights(
    config: TrainingConfig, input_count: int, seed: int, output_count: int = 2
) -> Weights:
    """Return random weights that keep the variance from layer to layer (He).

    Args:
        config: Widths of the layers.
        input_count: Number of features.
        seed: Seed of the weights, which are the same on any machine and device.
        output_count: Number of outputs.
    """
    generator = np.random.default_rng([seed, 1])
    widths = [input_count, *[config.hidden_width] * config.hidden_count, output_count]
    layers = []
    for fan_in, fan_out in itertools.pairwise(widths):
        matrix = generator.normal(scale=np.sqrt(2.0 / fan_in), size=(fan_in, fan_out))
        layers.append((matrix.astype(np.float32), np.zeros(fan_out, dtype=np.float32)))
    return tuple(layers)


def normalized_casts(
    model: LandingModel, actions: NDArray[np.float64], endpoint_xy: NDArray[np.float64]
) -> Casts:
    """Return casts as the network of a model is trained on them.

    Args:
        model: Model that holds the means and scales.
        actions: Actions, shape [row, 4].
        endpoint_xy: Endpoints [m], shape [row, 2].
    """
    return model.normalize(actions), model.normalize_endpoints(endpoint_xy).astype(np.float32)


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
    row_weights: NDArray | None = None,
    keep_last: bool = False,
) -> tuple[Weights, list[dict[str, float]]]:
    """Train a network.

    Args:
        weights: Initial weights.
        training: Rows to learn.
        held_out: Rows to validate with.
        config: Settings of the training.
        seed: Seed for the order of the rows.
        device: "cpu" or "cuda".
        metre: Length of one unit of the normalised endpoints [m].
        on_epoch: Called after every epoch.
        row_weights: Weight of each training row in the loss, shape [row]; equal if None.
        keep_last: Whether to return the weights of the last epoch instead of the best.

    Returns:
        The weights of the epoch with the least held-out loss, and the learning curve. Its losses
        are mean distances [m].

    Raises:
        InputError: The device is not available, or no held-out loss was finite.
        MissingExtraError: torch is not installed.
    """
    check_device(device)
    network = _TorchNetwork(weights, device)
    epochs = _Epochs(network, training, row_weights, config, seed)
    inputs, wanted = network.tensors(held_out)
    torch = network.torch
    best, best_loss, best_epoch = None, np.inf, 0
    curve: list[dict[str, float]] = []
    for epoch in range(1, config.epochs + 1):
        training_loss = epochs.run()
        with torch.no_grad():
            held_out_loss = float(network.loss(inputs, wanted)) * metre
        curve.append(
            {
                "epoch": epoch,
                "loss": training_loss * metre,
                "held_out_loss": held_out_loss,
                "learning_rate": epochs.learning_rate,
            }
        )
        if on_epoch is not None:
            on_epoch(curve[-1])
        if held_out_loss < best_loss or (keep_last and np.isfinite(held_out_loss)):
            best_loss, best_epoch = held_out_loss, epoch
            best = network.weights()
        elif epoch - best_epoch >= config.patience:
            break
    if best is None:
        raise InputError(
            f"training diverged: no finite loss with learning_rate = {config.learning_rate:g}"
        )
    return best, curve


class _TorchNetwork:
    """The network of a forward model in torch."""

    def __init__(self, weights: Weights, device: str):
        self.torch = import_torch("training the forward model")
        self.device = device
        self.layers = [
            tuple(tensor.requires_grad_() for tensor in self.tensors(layer)) for layer in weights
        ]

    def tensors(self, arrays) -> list[Any]:
        """Copy arrays to the device."""
        return [self.torch.tensor(np.asarray(array), device=self.device) for array in arrays]

    def loss(self, inputs, wanted, row_weights=None):
        """Return the mean distance between predicted and wanted points, normalised."""
        torch, hidden = self.torch, inputs
        for matrix, offset in self.layers[:-1]:
            hidden = torch.nn.functional.silu(torch.addmm(offset, hidden, matrix))
        predicted = torch.addmm(self.layers[-1][1], hidden, self.layers[-1][0])
        # Equation 5 takes the norm, not its square, so outliers count less. They occur where the
        # endpoint folds back as the action changes.
        offsets = (predicted - wanted).view(len(wanted), -1, 2)
        distance = torch.linalg.vector_norm(offsets, dim=2).mean(dim=1)
        if row_weights is None:
            return distance.mean()
        return (row_weights * distance).sum() / row_weights.sum()

    def weights(self) -> Weights:
        """Return a copy of the current weights."""
        return tuple(
            (matrix.detach().cpu().numpy().copy(), offset.detach().cpu().numpy().copy())
            for matrix, offset in self.layers
        )


class _Epochs:
    """The optimiser of a network, which runs one epoch at a time."""

    def __init__(
        self,
        network: _TorchNetwork,
        training: Casts,
        row_weights: NDArray | None,
        config: TrainingConfig,
        seed: int,
    ):
        optim = network.torch.optim
        self.network = network
        self.inputs, self.wanted = network.tensors(training)
        self.row_weights = None
        if row_weights is not None:
            (self.row_weights,) = network.tensors([row_weights.astype(np.float32)])
        self.batch_size = min(config.batch_size, len(self.inputs))
        batch_count = -(-len(self.inputs) // self.batch_size)
        self.optimizer = optim.AdamW(
            [parameter for layer in network.layers for parameter in layer],
            lr=config.learning_rate,
            weight_decay=config.weight_decay,
            foreach=True,
        )
        self.schedule = optim.lr_scheduler.OneCycleLR(
            self.optimizer,
            max_lr=config.learning_rate,
            total_steps=config.epochs * batch_count,
            pct_start=_RISE_FRACTION,
            final_div_factor=_FINAL_DIVISOR,
        )
        self.shuffle = np.random.default_rng([seed, 2])

    @property
    def learning_rate(self) -> float:
        return self.optimizer.param_groups[0]["lr"]

    def run(self) -> float:
        """Take a step for every batch and return the mean loss, normalised."""
        (order,) = self.network.tensors([self.shuffle.permutation(len(self.inputs))])
        total = 0.0
        for rows in order.split(self.batch_size):
            self.optimizer.zero_grad(set_to_none=True)
            row_weights = None if self.row_weights is None else self.row_weights[rows]
            value = self.network.loss(self.inputs[rows], self.wanted[rows], row_weights)
            value.backward()
            self.optimizer.step()
            self.schedule.step()
            total += value.detach() * len(rows)
        return float(total) / len(self.inputs)
