"""Gaussian process from an action to the endpoint, the learned baseline (paper, section VI-A).

The kernel and the noise are fitted to a subset of the simulated casts by marginal likelihood. All
casts then enter a sparse posterior over inducing casts (deterministic training conditional;
Quiñonero-Candela and Rasmussen, JMLR 6, 2005): as accurate as the casts are dense, in seconds.
"""

import dataclasses
import time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.conventions import stream
from cablecast.data.dataset import Dataset
from cablecast.errors import InputError, check_count, check_number
from cablecast.files import library_versions
from cablecast.learning.checkpoint import import_torch
from cablecast.learning.kernel import matern
from cablecast.learning.landing import (
    FEATURE_COUNT,
    LandingModel,
    dataset_summary,
    error_metrics,
    known_endpoint_rows,
    normalization,
)
from cablecast.runs.progress import Progress, ProgressCallback, ignore

# Casts per block of the posterior and of predictions; a block against 4,000 casts takes 64 MB.
_CHUNK_ROWS = 2000

# Minimum of the noise relative to the amplitude, which keeps the posterior well conditioned.
_NOISE_MIN = 3e-3

_NOISE_START = 0.05

# Added to the diagonal of the kernel matrix of the inducing casts, which is singular where they
# coincide.
_JITTER = 1e-6

# The square root has no slope at zero, so the squared distances on the diagonal are kept above it.
_SQUARE_MIN = 1e-12

_OWN = ("inputs", "length_scales", "coefficients")


@dataclasses.dataclass(frozen=True, kw_only=True)
class GaussianProcessModel(LandingModel):
    """A Gaussian process with a Matern 3/2 kernel and one length scale per feature.

    Attributes:
        inputs: Normalised features of the inducing casts divided by the length scales, shape
            [cast, 5].
        length_scales: Length scale of each normalised feature, shape [5].
        coefficients: Weight of each inducing cast in the normalised endpoint, shape [cast, 2].
    """

    inputs: NDArray[np.float64]
    length_scales: NDArray[np.float64]
    coefficients: NDArray[np.float64]

    FORMAT = "cablecast.gaussian_process"

    def predict(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Predict where the free end comes to rest; see `LandingModel.predict`."""
        points = self.normalize(actions) / self.length_scales
        outputs = np.empty((len(points), self.coefficients.shape[1]))
        for start in range(0, len(points), _CHUNK_ROWS):
            rows = slice(start, start + _CHUNK_ROWS)
            outputs[rows] = matern(points[rows], self.inputs) @ self.coefficients
        return self.endpoint_mean + self.endpoint_scale * outputs

    def _own_tensors(self) -> dict[str, NDArray]:
        return {f"process.{name}": getattr(self, name) for name in _OWN}

    @classmethod
    def _own_fields(cls, tensors: dict[str, NDArray]) -> dict[str, Any]:
        return {name: tensors[f"process.{name}"] for name in _OWN}


@dataclasses.dataclass(frozen=True, kw_only=True)
class GaussianProcessConfig:
    """Settings of the training.

    Attributes:
        likelihood_count: Number of casts on which the kernel and the noise are fitted.
        likelihood_steps: Maximum number of steps of that fit.
        inducing_count: Number of inducing casts.
        held_out_fraction: Fraction of the rows that is used for validation only.
    """

    likelihood_count: int = 1500
    likelihood_steps: int = 30
    inducing_count: int = 4000
    held_out_fraction: float = 0.1

    def __post_init__(self):
        for name, low, high in (
            ("likelihood_count", 50, 10_000),
            ("likelihood_steps", 1, 1000),
            ("inducing_count", 10, 10_000),
        ):
            check_count(name, getattr(self, name), low, high)
        check_number("held_out_fraction", self.held_out_fraction, 0.01, 0.9)


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

    Args:
        dataset: Simulated casts.
        config: Settings of the training.
        seed: Seed for the held-out rows, the subset and the inducing casts.
        progress: Told which of the two steps is under way.

    Raises:
        InputError: There are too few rows with a known endpoint, or no finite fit.
        MissingExtraError: torch is not installed.
    """
    config = config or GaussianProcessConfig()
    rows = known_endpoint_rows(dataset)
    start = time.monotonic()
    generator = stream(seed, "Gaussian process")
    order = generator.permutation(rows)
    held_out_count = max(1, round(config.held_out_fraction * len(rows)))
    held_out, training = order[:held_out_count], np.sort(order[held_out_count:])
    actions, endpoint_xy = dataset.actions[training], dataset.rest_xy[training]
    model = GaussianProcessModel(
        **normalization(actions, endpoint_xy),
        inputs=np.empty((0, FEATURE_COUNT)),
        length_scales=np.ones(FEATURE_COUNT),
        coefficients=np.empty((0, 2)),
    ).with_margins(dataset)
    x = model.normalize(actions).astype(float)
    y = model.normalize_endpoints(endpoint_xy)
    subset = generator.permutation(len(x))[: config.likelihood_count]
    progress(Progress(task=f"Fitting the kernel to {len(subset)} casts"))
    kernel = fit_kernel(x[subset], y[subset], config.likelihood_steps)
    kernel_seconds = time.monotonic() - start
    progress(Progress(task=f"Fitting the Gaussian process to {len(x)} casts"))
    points = x / kernel.length_scales
    inputs = points[generator.permutation(len(x))[: config.inducing_count]]
    model = dataclasses.replace(
        model,
        inputs=inputs,
        length_scales=kernel.length_scales,
        coefficients=sparse_posterior(inputs, points, y, (kernel.noise / kernel.amplitude) ** 2),
    )
    metrics = {
        "training_count": len(training),
        "unknown_endpoint_count": len(dataset) - len(rows),
        "off_table_count": int(np.sum(dataset.status == "off_table")),
        "kernel_seconds": round(kernel_seconds, 2),
        "training_seconds": round(time.monotonic() - start, 2),
        "held_out_count": held_out_count,
        **error_metrics(
            "held_out",
            model.predict(dataset.actions[held_out]),
            dataset.rest_xy[held_out],
            dataset.cable.length,
        ),
    }
    info = {
        "config": dataclasses.asdict(config),
        "seed": seed,
        "device": "cpu",
        "versions": library_versions(),
        "curve": [],
        "kernel": {
            "length_scales": kernel.length_scales.tolist(),
            "amplitude_m": kernel.amplitude * model.endpoint_scale,
            "noise_m": kernel.noise * model.endpoint_scale,
        },
        "dataset": dataset_summary(dataset),
        "metrics": metrics,
    }
    return dataclasses.replace(model, info=info)


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
    from scipy.optimize import minimize

    torch = import_torch("the Gaussian process")
    x, y = torch.tensor(points), torch.tensor(outputs)

    def loss_and_slope(values: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        unknowns = torch.tensor(values, requires_grad=True)
        scaled, ratio = x / torch.exp(unknowns[:-2]), torch.exp(unknowns[-1]) + _NOISE_MIN
        value = negative_log_likelihood(scaled, y, unknowns[-2], ratio)
        value.backward()
        return value.item(), unknowns.grad.numpy()  # pyright: ignore[reportOptionalMemberAccess]

    first = np.zeros(points.shape[1] + 2)
    first[-1] = np.log(_NOISE_START)
    try:
        found = minimize(
            loss_and_slope, first, jac=True, method="L-BFGS-B", options={"maxiter": step_count}
        )
    except torch.linalg.LinAlgError:  # pyright: ignore[reportPrivateImportUsage]
        # The covariance is no longer positive definite, or holds NaN.
        raise InputError("the Gaussian process found no finite fit to the casts") from None
    values = np.exp(found.x)
    if not (np.all(np.isfinite(values)) and np.isfinite(found.fun)):
        raise InputError("the Gaussian process found no finite fit to the casts")
    amplitude = float(values[-2])
    return KernelFit(
        length_scales=values[:-2],
        amplitude=amplitude,
        noise=amplitude * float(values[-1] + _NOISE_MIN),
    )


def negative_log_likelihood(points: Any, outputs: Any, log_amplitude: Any, noise_ratio: Any) -> Any:
    """Return the negative log marginal likelihood of outputs, up to a constant.

    Column j is modelled as exp(log_amplitude) (g_j + noise_ratio e_j), where g_j is a Gaussian
    process of amplitude 1 and e_j is standard normal noise. All columns share the kernel.

    Args:
        points: Points in units of the length scales, tensor of shape [point, dimension].
        outputs: Outputs of mean zero, tensor of shape [point, output].
        log_amplitude: Logarithm of the amplitude.
        noise_ratio: Standard deviation of the noise relative to the amplitude.
    """
    torch = import_torch("the Gaussian process")
    squares = (points**2).sum(1)
    squares = squares[:, None] + squares - 2 * points @ points.T
    u = torch.sqrt(3.0 * squares.clamp_min(0.0) + _SQUARE_MIN)
    eye = torch.eye(len(points), dtype=points.dtype)
    factor = torch.linalg.cholesky((1.0 + u) * torch.exp(-u) + noise_ratio**2 * eye)
    whitened = outputs * torch.exp(-log_amplitude)
    fit = 0.5 * (whitened * torch.cholesky_solve(whitened, factor)).sum()
    log_volume = torch.log(torch.diagonal(factor)).sum() + len(points) * log_amplitude
    return fit + outputs.shape[1] * log_volume


def sparse_posterior(
    inducing: NDArray[np.float64],
    points: NDArray[np.float64],
    outputs: NDArray[np.float64],
    noise_variance: float,
) -> NDArray[np.float64]:
    """Return the weights of inducing points in the posterior mean of a process of amplitude 1.

    Args:
        inducing: Inducing points in units of the length scales, shape [inducing, dimension].
        points: All points, shape [point, dimension].
        outputs: Outputs at all points, shape [point, output].
        noise_variance: Variance of the noise relative to that of the process.

    Returns:
        Weights, shape [inducing, output].
    """
    from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

    eye = np.eye(len(inducing))
    factor = cholesky(matern(inducing, inducing) + _JITTER * eye, lower=True)
    inner, image = noise_variance * eye, np.zeros((len(inducing), outputs.shape[1]))
    for start in range(0, len(points), _CHUNK_ROWS):
        rows = slice(start, start + _CHUNK_ROWS)
        whitened = solve_triangular(factor, matern(inducing, points[rows]), lower=True)
        inner += whitened @ whitened.T
        image += whitened @ outputs[rows]
    return solve_triangular(factor, cho_solve(cho_factor(inner), image), lower=True, trans=1)
