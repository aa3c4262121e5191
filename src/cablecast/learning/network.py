"""The network of a forward model: its weights, its outputs, and its part of a checkpoint.

Forward model f_forw: a neural network from an action to the endpoint (paper, section V-F).

Training of a network on normalised casts with the L2 error of equation 5 as its loss.

Fit of a model to the simulated casts of a dataset, and the record of it.

Training of the forward model on simulated casts.

Correction of a forward model: a Gaussian process on the sim-to-real residual.

The residual of an action is modelled as r(a) = s(a) (g(a) + e). g is a Gaussian process over the
features of the action and the endpoint that the network predicts, and e is noise. The local size
s(a) = exp(w . h(a)) varies with the action, because a wide fast sweep misses by ten times as much
as a short one. The same fit yields the remaining spread about the corrected prediction.

Fit of a correction to real casts by the marginal likelihood of their residuals.
"""

import dataclasses
import functools
import itertools
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.data.dataset import Dataset
from cablecast.errors import InputError
from cablecast.files import library_versions
from cablecast.learning.checkpoint import (
    check_device,
    import_torch,
    one_thread,
)
from cablecast.learning.kernel import matern, minimize, negative_log_likelihood
from cablecast.learning.landing import (
    FEATURE_COUNT,
    MIN_REAL_ROWS,
    LandingModel,
    dataset_summary,
    error_metrics,
    known_endpoint_rows,
    normalization,
)

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


def weight_tensors(weights: Weights) -> dict[str, NDArray]:
    """Return weights by name, as a checkpoint holds them."""
    tensors: dict[str, NDArray] = {}
    for k, (matrix, offset) in enumerate(weights):
        tensors |= {f"layer{k}.matrix": matrix, f"layer{k}.offset": offset}
    return tensors


def weights_of_tensors(tensors: dict[str, NDArray]) -> Weights:
    """Return the weights among the arrays of a checkpoint.

    Raises:
        KeyError: A layer is missing.
    """
    layer_count = sum(name.endswith(".matrix") for name in tensors)
    return tuple(
        (tensors[f"layer{k}.matrix"], tensors[f"layer{k}.offset"]) for k in range(layer_count)
    )


# Lower bound of the relative shift, for its logarithm.
_SHIFT_MIN = 1e-6


@dataclasses.dataclass(frozen=True, kw_only=True)
class ForwardModel(LandingModel):
    """A trained network, with an optional correction from real casts.

    Attributes:
        weights: Matrix and offset of each layer. SiLU follows every layer but the last.
        correction: Correction fitted to real casts, if there is one.
    """

    weights: Weights
    correction: "LandingCorrection | None" = None

    FORMAT = "cablecast.forward_model"

    def predict(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Predict where the free end comes to rest; see `LandingModel.predict`."""
        endpoints = self.predict_uncorrected(actions)
        if self.correction is None:
            return endpoints
        inputs = self.correction_inputs(actions, self.correction.changes, endpoints)
        return endpoints + self.correction.shift(*inputs)

    def predict_uncorrected(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Predict the endpoints by the network alone.

        Args:
            actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [action, 4].

        Returns:
            Endpoints [m], shape [action, 2].
        """
        outputs = network_outputs(self.normalize(actions), self.weights)
        return self.endpoint_mean + self.endpoint_scale * outputs

    def predict_spread(self, actions: ArrayLike) -> NDArray[np.float64] | None:
        """Predict how far real landings scatter; see `LandingModel.predict_spread`."""
        if self.correction is None:
            return None
        return self.correction.spread(*self.correction_inputs(actions, self.correction.changes))

    def sensitivity(
        self, actions: NDArray[np.float64], changes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the sensitivity of the network alone; see `LandingModel.sensitivity`."""
        shifts = self.uncorrected.landing_shifts(actions, changes)
        return np.linalg.norm(shifts, axis=(1, 2))

    def correction_inputs(
        self,
        actions: ArrayLike,
        changes: NDArray[np.float64],
        endpoints: NDArray[np.float64] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the inputs of a correction for actions.

        Args:
            actions: Actions, shape [action, 4].
            changes: Perturbations of an action, see `deviations`, shape [change, 4].
            endpoints: Result of `predict_uncorrected`, if it is known already.

        Returns:
            Places, at which the process is evaluated: the normalised features and the normalised
            endpoint of the network, shape [action, 6]. Arguments of the local size: the features
            and the logarithm of the normalised sensitivity, shape [action, 5].
        """
        actions = np.asarray(actions, dtype=float)
        if endpoints is None:
            endpoints = self.predict_uncorrected(actions)
        features = self.normalize(actions).astype(float)
        shift = self.sensitivity(actions, changes)
        log_shift = np.log(np.maximum(shift / self.endpoint_scale, _SHIFT_MIN))
        places = np.hstack([features, self.normalize_endpoints(endpoints)])
        return places, np.hstack([features, log_shift[:, None]])

    @property
    def uncorrected(self) -> "ForwardModel":
        """Model without the correction."""
        return dataclasses.replace(self, correction=None)

    def _own_tensors(self) -> dict[str, NDArray]:
        tensors = weight_tensors(self.weights)
        if self.correction is not None:
            tensors |= self.correction.tensors()
        return tensors

    @classmethod
    def _own_fields(cls, tensors: dict[str, NDArray]) -> dict[str, Any]:
        return {
            "weights": weights_of_tensors(tensors),
            "correction": LandingCorrection.from_tensors(tensors),
        }


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
    model: ForwardModel,
    dataset: Dataset,
    split: tuple[Rows, Rows],
    *,
    casts: Callable[[Rows], Casts],
    predict: Callable[[ForwardModel, Rows], NDArray[np.float64]],
    config: TrainingConfig,
    seed: int,
    device: str,
    on_epoch: TrainingCallback | None,
) -> ForwardModel:
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class LandingCorrection:
    """A fitted correction.

    Attributes:
        changes: Perturbations for the sensitivity of an action, see `deviations`, shape
            [change, 4].
        inputs: Places of the real casts, see `ForwardModel.correction_inputs`, shape [cast, 6].
        length_scales: Length scale of the process along each place coordinate, shape [6].
        size_weights: Weights w of the local size, shape [5].
        amplitude: Standard deviation of g along each of x and y [m].
        noise: Standard deviation of the noise e along each of x and y [m].
        residuals: Endpoint on the rig minus that of the network, divided by the local size [m],
            shape [cast, 2].
    """

    changes: NDArray[np.float64]
    inputs: NDArray[np.float64]
    length_scales: NDArray[np.float64]
    size_weights: NDArray[np.float64]
    amplitude: float
    noise: float
    residuals: NDArray[np.float64]

    def shift(self, places: NDArray[np.float64], sizes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the expected endpoint on the rig minus that of the network.

        Args:
            places: Places of the actions, see `ForwardModel.correction_inputs`, shape [action, 6].
            sizes: Arguments h of their local size, shape [action, 5].

        Returns:
            Shifts [m], shape [action, 2].
        """
        means = self._kernel(places) @ (self._inverse @ self.residuals)
        return self._size(sizes)[:, None] * means

    def spread(
        self, places: NDArray[np.float64], sizes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the standard deviation of real endpoints about the corrected prediction.

        Args:
            places: Places of the actions, see `ForwardModel.correction_inputs`, shape [action, 6].
            sizes: Arguments h of their local size, shape [action, 5].

        Returns:
            Standard deviation along each of x and y, noise included [m], shape [action].
        """
        kernel = self._kernel(places)
        explained = np.einsum("ai,ai->a", kernel @ self._inverse, kernel)
        variance = np.maximum(self.amplitude**2 - explained, 0.0) + self.noise**2
        return self._size(sizes) * np.sqrt(variance)

    def _size(self, sizes: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.exp(sizes @ self.size_weights)

    def _kernel(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the covariance of g between places and real casts [m²], shape [action, cast]."""
        return self.amplitude**2 * matern(
            places / self.length_scales, self.inputs / self.length_scales
        )

    @functools.cached_property
    def _inverse(self) -> NDArray[np.float64]:
        """Inverse covariance of the residuals, noise included [1/m²], shape [cast, cast]."""
        covariance = self._kernel(self.inputs) + self.noise**2 * np.eye(len(self.inputs))
        return np.asarray(np.linalg.inv(covariance), dtype=np.float64)

    def tensors(self) -> dict[str, NDArray]:
        """Return the arrays by name, as stored in a checkpoint."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {f"correction.{name}": np.atleast_1d(value) for name, value in values.items()}

    @classmethod
    def from_tensors(cls, tensors: dict[str, NDArray]) -> "LandingCorrection | None":
        """Return the correction stored by `tensors`, or None if there is none.

        Args:
            tensors: All arrays of a checkpoint by name.
        """
        if "correction.inputs" not in tensors:
            return None
        values: dict[str, Any] = {
            field.name: tensors[f"correction.{field.name}"] for field in dataclasses.fields(cls)
        }
        for name in ("amplitude", "noise"):
            values[name] = float(values[name][0])
        return cls(**values)


# Prior standard deviation of the logarithm of a length scale and of a size weight. It is weak, but
# with a few dozen casts it keeps the effect of an irrelevant variable from growing without bound.
_PRIOR_DEVIATION = 2.0

# Minimum of the noise relative to the amplitude, which keeps the covariance well conditioned.
_NOISE_MIN = 0.01

_NOISE_START = 0.2
_STEP_COUNT = 200


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResidualProcess:
    """Parameters of the process on the residuals; see `LandingCorrection`.

    Attributes:
        length_scales: Length scale along each place coordinate, shape [place].
        size_weights: Weights of the local size, shape [size].
        amplitude: Standard deviation of g [m].
        noise: Standard deviation of the noise e [m].
    """

    length_scales: NDArray[np.float64]
    size_weights: NDArray[np.float64]
    amplitude: float
    noise: float


def fit_correction(
    model: ForwardModel,
    actions: NDArray[np.float64],
    endpoint_xy: NDArray[np.float64],
    changes: NDArray[np.float64],
) -> LandingCorrection:
    """Fit a correction of a model to real casts.

    Args:
        model: Forward model. A correction that it already has is ignored.
        actions: Actions of the real casts, shape [cast, 4].
        endpoint_xy: Endpoints of the real casts [m], shape [cast, 2].
        changes: Perturbations of an action, see `deviations`, shape [change, 4].

    Raises:
        InputError: There are too few casts, or no finite fit.
        MissingExtraError: torch is not installed.
    """
    if len(actions) < MIN_REAL_ROWS:
        raise InputError(
            f"{len(actions)} real casts have a known endpoint: a correction needs {MIN_REAL_ROWS}"
        )
    base = model.uncorrected
    predicted = base.predict(actions)
    places, sizes = base.correction_inputs(actions, changes, predicted)
    residuals = endpoint_xy - predicted
    process = fit_process(places, sizes, residuals)
    return LandingCorrection(
        changes=changes,
        inputs=places,
        residuals=residuals * np.exp(-sizes @ process.size_weights)[:, None],
        **vars(process),
    )


def fit_process(
    places: NDArray[np.float64], sizes: NDArray[np.float64], residuals: NDArray[np.float64]
) -> ResidualProcess:
    """Maximise the posterior density of the process parameters.

    Args:
        places: Places of the casts, shape [cast, place].
        sizes: Arguments of their local size, shape [cast, size].
        residuals: Endpoint on the rig minus that of the network [m], shape [cast, 2].

    Raises:
        InputError: The fit is not finite.
        MissingExtraError: torch is not installed.
    """
    torch = import_torch("learning from real casts")
    x, h, r = (torch.tensor(a, dtype=torch.float64) for a in (places, sizes, residuals))
    widths = [places.shape[1], sizes.shape[1], 1, 1]

    def split(unknowns):
        log_scales, weights, log_amplitude, log_ratio = torch.split(unknowns, widths)
        return log_scales, weights, log_amplitude, torch.exp(log_ratio) + _NOISE_MIN

    def loss(unknowns):
        log_scales, weights, log_amplitude, ratio = split(unknowns)
        prior = ((log_scales**2).sum() + (weights**2).sum()) / (2 * _PRIOR_DEVIATION**2)
        points = x * torch.exp(-log_scales)
        return negative_log_likelihood(points, r, h @ weights + log_amplitude, ratio) + prior

    start = np.zeros(sum(widths))
    start[-2:] = np.log(float(np.std(residuals)) or 1e-6), np.log(_NOISE_START)
    # A few hundred casts are too few to share among threads.
    with one_thread():
        found = torch.tensor(minimize(loss, start, _STEP_COUNT))
    log_scales, weights, log_amplitude, ratio = (part.numpy() for part in split(found))
    amplitude = float(np.exp(log_amplitude[0]))
    return ResidualProcess(
        length_scales=np.exp(log_scales),
        size_weights=weights,
        amplitude=amplitude,
        noise=amplitude * float(ratio[0]),
    )
