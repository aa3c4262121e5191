"""Gaussian process from an action to the endpoint, the learned baseline (paper, section VI-A).

Training of the Gaussian process on all simulated casts (paper, section VI-A).
"""

import dataclasses
import time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.data.dataset import Dataset
from cablecast.errors import InputError
from cablecast.files import library_versions
from cablecast.learning.checkpoint import import_torch
from cablecast.learning.kernel import (
    matern,
    minimize,
    negative_log_likelihood,
    scaled_distances,
    solve_kernel_system,
    weighted_sums,
)
from cablecast.learning.landing import (
    FEATURE_COUNT,
    LandingModel,
    dataset_summary,
    error_metrics,
    known_endpoint_rows,
    normalization,
)
from cablecast.runs.progress import ProgressCallback, ignore

# Actions per block of predictions; a block against 36,000 casts takes 144 MB.
_CHUNK_ROWS = 1000

_OWN = ("inputs", "length_scales", "coefficients")


@dataclasses.dataclass(frozen=True, kw_only=True)
class GaussianProcessModel(LandingModel):
    """A Gaussian process with a Matern 3/2 kernel and one length scale per feature.

    Attributes:
        inputs: Normalised features of the training casts divided by the length scales, shape
            [cast, 4].
        length_scales: Length scale of each normalised feature, shape [4].
        coefficients: Weight of each cast in the normalised endpoint, shape [cast, 2].
    """

    inputs: NDArray[np.float32]
    length_scales: NDArray[np.float64]
    coefficients: NDArray[np.float64]

    FORMAT = "cablecast.gaussian_process"

    def predict(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Predict where the free end comes to rest; see `LandingModel.predict`."""
        points = self._points(actions)
        outputs = np.empty((len(points), 2))
        for start in range(0, len(points), _CHUNK_ROWS):
            rows = slice(start, start + _CHUNK_ROWS)
            outputs[rows] = weighted_sums(matern(points[rows], self.inputs), self.coefficients)
        return self.endpoint_mean + self.endpoint_scale * outputs

    def landing_shifts(
        self, actions: NDArray[np.float64], changes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the change of the endpoint for each change; see `LandingModel.landing_shifts`.

        The derivative of the kernel, dk/dx = -3 exp(-u) (x - x_i), gives all changes in one pass
        over the casts.
        """
        points = self._points(actions)
        weights = self.coefficients
        moments = np.hstack(
            [weights] + [weights * self.inputs[:, k : k + 1] for k in range(FEATURE_COUNT)]
        )
        slopes = np.empty((len(points), 2, FEATURE_COUNT))
        for start in range(0, len(points), _CHUNK_ROWS):
            rows = slice(start, start + _CHUNK_ROWS)
            decay = np.exp(-scaled_distances(points[rows], self.inputs))
            sums = weighted_sums(decay, moments).reshape(-1, 1 + FEATURE_COUNT, 2)
            centred = points[rows, :, None] * sums[:, :1] - sums[:, 1:]
            slopes[rows] = -3.0 * np.swapaxes(centred, 1, 2)
        # The features are the variables of the action, except for the last, psi - theta2.
        moves = changes.astype(float).copy()
        moves[:, 3] -= moves[:, 1]
        moves /= self.feature_scale * self.length_scales
        return self.endpoint_scale * slopes @ moves.T

    def _points(self, actions: ArrayLike) -> NDArray[np.float32]:
        return (self.normalize(actions) / self.length_scales).astype(np.float32)

    def _own_tensors(self) -> dict[str, NDArray]:
        return {f"process.{name}": getattr(self, name) for name in _OWN}

    @classmethod
    def _own_fields(cls, tensors: dict[str, NDArray]) -> dict[str, Any]:
        return {name: tensors[f"process.{name}"] for name in _OWN}


# Minimum of the noise relative to the amplitude: the kernel matrix is in single precision.
_NOISE_MIN = 3e-3

_NOISE_START = 0.05


@dataclasses.dataclass(frozen=True, kw_only=True)
class GaussianProcessConfig:
    """Settings of the training.

    Attributes:
        likelihood_count: Number of casts on which the kernel and the noise are fitted.
        likelihood_steps: Maximum number of steps of that fit.
        inducing_count: Rank of the preconditioner.
        tolerance: Residual of the solution relative to the right-hand side.
        iterations: Maximum number of products with the kernel matrix.
        held_out_fraction: Fraction of the rows that is used for validation only.
    """

    likelihood_count: int = 1500
    likelihood_steps: int = 30
    inducing_count: int = 4000
    tolerance: float = 1e-3
    iterations: int = 200
    held_out_fraction: float = 0.1

    def __post_init__(self):
        for name, low, high in (
            ("likelihood_count", 50, 10_000),
            ("likelihood_steps", 1, 1000),
            ("inducing_count", 10, 10_000),
            ("tolerance", 1e-6, 0.5),
            ("iterations", 1, 100_000),
            ("held_out_fraction", 0.0, 0.9),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(f"{name} = {value} is outside [{low:g}, {high:g}]")


@dataclasses.dataclass(frozen=True, kw_only=True)
class KernelFit:
    """Kernel and noise of normalised endpoints.

    Attributes:
        length_scales: Length scale of each normalised feature, shape [feature].
        amplitude: Standard deviation of the process.
        noise: Standard deviation of the noise.
    """

    length_scales: NDArray[np.float64]
    amplitude: float
    noise: float


def train_gaussian_process(
    dataset: Dataset,
    *,
    config: GaussianProcessConfig | None = None,
    seed: int = 0,
    progress: ProgressCallback = ignore,
) -> GaussianProcessModel:
    """Train the Gaussian process on a dataset.

    The kernel and the noise are fitted to a random subset by marginal likelihood. The weights are
    then solved for on all training rows. The error is measured on the held-out rows, which the
    model does not use at all.

    Args:
        dataset: Simulated casts.
        config: Settings of the training.
        seed: Seed for the held-out rows, the subset and the rows of the preconditioner.
        progress: Called after every product with the kernel matrix.

    Raises:
        InputError: There are too few rows with a known endpoint, or no finite fit.
        MissingExtraError: torch is not installed.
    """
    config = config or GaussianProcessConfig()
    rows = known_endpoint_rows(dataset)
    began = time.monotonic()
    generator = np.random.default_rng([seed, 3])
    order = generator.permutation(rows)
    held_out_count = round(config.held_out_fraction * len(rows))
    held_out, training = order[:held_out_count], np.sort(order[held_out_count:])
    actions, endpoint_xy = dataset.actions[training], dataset.endpoint_xy[training]
    model = GaussianProcessModel(
        **normalization(actions, endpoint_xy),
        inputs=np.empty((0, 4), dtype=np.float32),
        length_scales=np.ones(4),
        coefficients=np.empty((0, 2)),
    ).with_margins(dataset)
    x = model.normalize(actions).astype(float)
    y = model.normalize_endpoints(endpoint_xy)
    subset = generator.permutation(len(x))[: config.likelihood_count]
    kernel = fit_kernel(x[subset], y[subset], config.likelihood_steps)
    kernel_seconds = time.monotonic() - began
    inputs = (x / kernel.length_scales).astype(np.float32)
    coefficients, residuals = solve_kernel_system(
        inputs,
        y,
        (kernel.noise / kernel.amplitude) ** 2,
        generator.permutation(len(x))[: config.inducing_count],
        tolerance=config.tolerance,
        max_iterations=config.iterations,
        progress=progress,
    )
    model = dataclasses.replace(
        model, inputs=inputs, length_scales=kernel.length_scales, coefficients=coefficients
    )
    metrics = {
        "training_count": len(training),
        "unknown_endpoint_count": len(dataset) - len(rows),
        "off_table_count": int(np.sum(dataset.status == "off_table")),
        "iteration_count": len(residuals),
        "relative_residual": residuals[-1],
        "kernel_seconds": round(kernel_seconds, 2),
        "training_seconds": round(time.monotonic() - began, 2),
        "held_out_count": held_out_count,
    }
    if held_out_count:
        predicted, actual = model.predict(dataset.actions[held_out]), dataset.endpoint_xy[held_out]
        metrics |= error_metrics("held_out", predicted, actual, dataset.cable.length)
    info = _description(dataset, config, seed, kernel, model.endpoint_scale)
    return dataclasses.replace(model, info=info | {"metrics": metrics, "residuals": residuals})


def fit_kernel(
    points: NDArray[np.float64], outputs: NDArray[np.float64], step_count: int
) -> KernelFit:
    """Maximise the marginal likelihood of the kernel and the noise.

    Args:
        points: Normalised features, shape [cast, feature].
        outputs: Normalised endpoints, shape [cast, output].
        step_count: Maximum number of steps.

    Raises:
        InputError: The fit is not finite.
        MissingExtraError: torch is not installed.
    """
    torch = import_torch("the Gaussian process")
    x, y = torch.tensor(points), torch.tensor(outputs)

    def loss(unknowns):
        log_sizes = unknowns[-2].expand(len(x))
        ratio = torch.exp(unknowns[-1]) + _NOISE_MIN
        return negative_log_likelihood(x / torch.exp(unknowns[:-2]), y, log_sizes, ratio)

    start = np.zeros(points.shape[1] + 2)
    start[-1] = np.log(_NOISE_START)
    found = np.exp(minimize(loss, start, step_count))
    amplitude = float(found[-2])
    return KernelFit(
        length_scales=found[:-2],
        amplitude=amplitude,
        noise=amplitude * float(found[-1] + _NOISE_MIN),
    )


def _description(
    dataset: Dataset,
    config: GaussianProcessConfig,
    seed: int,
    kernel: KernelFit,
    endpoint_scale: float,
) -> dict[str, Any]:
    return {
        "config": dataclasses.asdict(config),
        "seed": seed,
        "device": "cpu",
        "versions": library_versions(),
        "curve": [],
        "kernel": {
            "length_scales": kernel.length_scales.tolist(),
            "amplitude_m": kernel.amplitude * endpoint_scale,
            "noise_m": kernel.noise * endpoint_scale,
        },
        "dataset": dataset_summary(dataset),
    }
