"""The learned baseline: a Gaussian process on all simulated casts (section VI-A).

Its weights solve (K + noise^2) w = y over all 36,000 casts, exactly up to a stated tolerance, by
conjugate gradients. Half of the symmetric kernel matrix is kept in single precision, 2.6 GB; a
Nystrom approximation preconditions the solve, so that some dozens of products suffice.
"""

import dataclasses
import functools
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.datasets.reader import Dataset
from cablecast.errors import InputError, MissingExtraError
from cablecast.models.base import (
    LandingModel,
    action_features,
    dataset_summary,
    known_margins,
)
from cablecast.models.training import library_versions

# Rows and columns of a block of the kernel matrix, and of a block of predictions.
_BLOCK = 4000
_CHUNK = 1000

# The noise is at least this share of the amplitude: single precision resolves no finer kernel.
_NOISE_MIN = 3e-3

Progress = Callable[[int, int], None]
"""Called with the number of steps done and the number of steps at most."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class GaussianProcessConfig:
    """How the process is fitted.

    Attributes:
        likelihood_count: Casts on which kernel and noise are fitted by their marginal likelihood.
        likelihood_steps: Steps of that fit.
        inducing_count: Rank of the preconditioner.
        tolerance: Residual of the solve relative to the right-hand side.
        iterations: Products with the kernel matrix at most.
        held_out_fraction: Part of the rows that only validates.
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
class GaussianProcessModel(LandingModel):
    """A Gaussian process with a Matern 3/2 kernel, a length scale for each feature.

    Attributes:
        inputs: Normalised features of its casts divided by the length scales, shape [cast, 4].
        length_scales: Shape [4].
        coefficients: Weight of each cast, amplitude included, shape [cast, 2].
    """

    inputs: NDArray[np.float32]
    length_scales: NDArray[np.float64]
    coefficients: NDArray[np.float64]

    FORMAT = "cablecast.gaussian_process"

    def predict(self, actions: ArrayLike) -> NDArray[np.float64]:
        """Where the free end will come to rest; see the base class."""
        points = self._points(actions)
        weights = self.coefficients.astype(np.float32)
        outputs = np.empty((len(points), 2))
        for start in range(0, len(points), _CHUNK):
            scaled, decay = self._decay(points[start : start + _CHUNK])
            scaled += 1.0
            scaled *= decay
            outputs[start : start + _CHUNK] = scaled @ weights
        return self.endpoint_mean + self.endpoint_scale * outputs

    def landing_shifts(
        self, actions: NDArray[np.float64], changes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """How the predicted landing moves when an action changes; see the base class.

        From the derivative of the kernel, which costs one pass over the casts for all changes.
        """
        points = self._points(actions)
        weights = self.coefficients.astype(np.float32)
        moments = np.hstack([weights] + [weights * self.inputs[:, k : k + 1] for k in range(4)])
        slopes = np.empty((len(points), 2, 4))
        for start in range(0, len(points), _CHUNK):
            rows = slice(start, start + _CHUNK)
            sums = (self._decay(points[rows])[1] @ moments).reshape(-1, 5, 2)
            # With u = sqrt(3) d, the slope of (1 + u) exp(-u) is -3 exp(-u) (x - x_i).
            centred = points[rows, :, None] * sums[:, :1] - sums[:, 1:]
            slopes[rows] = -3.0 * np.swapaxes(centred, 1, 2)
        # Features are the action's variables, but the last is psi - theta2.
        moves = changes.astype(float).copy()
        moves[:, 3] -= moves[:, 1]
        moves /= self.feature_scale * self.length_scales
        return self.endpoint_scale * slopes @ moves.T

    def _points(self, actions: ArrayLike) -> NDArray[np.float32]:
        return (self.normalize(actions) / self.length_scales).astype(np.float32)

    @functools.cached_property
    def _squares(self) -> NDArray[np.float32]:
        return np.sum(self.inputs**2, axis=1)

    def _decay(self, points: NDArray[np.float32]):
        """u = sqrt(3) times the distance of points from all casts, and exp(-u)."""
        u = points @ (-2.0 * self.inputs.T)
        u += self._squares
        u += np.sum(points**2, axis=1)[:, None]
        np.maximum(u, 0.0, out=u)
        u *= 3.0
        np.sqrt(u, out=u)
        return u, np.exp(-u)

    def _own_tensors(self) -> dict[str, NDArray]:
        names = ("inputs", "length_scales", "coefficients")
        return {f"process.{name}": getattr(self, name) for name in names}

    @classmethod
    def _own_fields(cls, tensors: dict[str, NDArray]) -> dict[str, Any]:
        names = ("inputs", "length_scales", "coefficients")
        return {name: tensors[f"process.{name}"] for name in names}


def train_gaussian_process(
    dataset: Dataset,
    *,
    config: GaussianProcessConfig | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> GaussianProcessModel:
    """Fit the process to a dataset.

    Kernel and noise come from a random subset; with the held-out rows left out, the error is
    measured with few casts' loss; all other rows carry the prediction.

    Args:
        dataset: Simulated casts.
        config: How to fit.
        seed: Chooses the subset, the held-out rows and the preconditioner's points.
        progress: Told after every product with the kernel matrix.

    Raises:
        InputError: Too few rows with a known endpoint.
        MissingExtraError: torch is not installed.
    """
    config = config or GaussianProcessConfig()
    rows = np.flatnonzero(dataset.finite)
    if len(rows) < 50:
        raise InputError(
            f"{len(rows)} of {len(dataset)} rows have a known endpoint: training needs 50"
        )
    began = time.monotonic()
    generator = np.random.default_rng([seed, 3])
    order = generator.permutation(rows)
    held_out_count = round(config.held_out_fraction * len(rows))
    held_out, training = order[:held_out_count], np.sort(order[held_out_count:])
    features = action_features(dataset.actions[training])
    endpoints = dataset.endpoint_xy[training]
    feature_scale = features.std(axis=0)
    model = GaussianProcessModel(
        feature_mean=features.mean(axis=0),
        feature_scale=np.where(feature_scale > 1e-9, feature_scale, 1.0),
        endpoint_mean=endpoints.mean(axis=0),
        endpoint_scale=max(float(endpoints.std(axis=0).mean()), 1e-6),
        margin_features=np.empty((0, 4), dtype=np.float32),
        margins=np.empty(0, dtype=np.float32),
        inputs=np.empty((0, 4), dtype=np.float32),
        length_scales=np.ones(4),
        coefficients=np.empty((0, 2)),
    )
    x = model.normalize(dataset.actions[training]).astype(float)
    y = (endpoints - model.endpoint_mean) / model.endpoint_scale
    subset = generator.permutation(len(x))[: config.likelihood_count]
    length_scales, amplitude, noise = _fit_kernel(x[subset], y[subset], config.likelihood_steps)
    kernel_seconds = time.monotonic() - began
    inducing = generator.permutation(len(x))[: config.inducing_count]
    inputs = (x / length_scales).astype(np.float32)
    weights, residuals = _solve(inputs, y, (noise / amplitude) ** 2, inducing, config, progress)
    known, margins = known_margins(dataset)
    model = dataclasses.replace(
        model,
        margin_features=model.normalize(dataset.actions[known]),
        margins=margins.astype(np.float32),
        inputs=inputs,
        length_scales=length_scales,
        coefficients=weights,
    )
    metrics: dict[str, Any] = {
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
        predicted = model.predict(dataset.actions[held_out])
        error = np.linalg.norm(predicted - dataset.endpoint_xy[held_out], axis=1)
        error_pct = error / dataset.cable.length * 100
        metrics |= {
            "held_out_median_pct": float(np.median(error_pct)),
            "held_out_p90_pct": float(np.percentile(error_pct, 90)),
            "held_out_mean_pct": float(np.mean(error_pct)),
        }
    info = {
        "config": dataclasses.asdict(config),
        "seed": seed,
        "device": "cpu",
        "versions": library_versions(),
        "metrics": metrics,
        "curve": [],
        "kernel": {
            "length_scales": length_scales.tolist(),
            "amplitude_m": amplitude * model.endpoint_scale,
            "noise_m": noise * model.endpoint_scale,
        },
        "residuals": residuals,
        "dataset": dataset_summary(dataset),
    }
    return dataclasses.replace(model, info=info)


def _fit_kernel(x, y, step_count):
    """Length scales, amplitude and noise of the greatest marginal likelihood."""
    torch = _torch()
    x, y = torch.tensor(x), torch.tensor(y)
    eye = torch.eye(len(x), dtype=x.dtype)
    unknowns = torch.zeros(x.shape[1] + 2, dtype=x.dtype)
    unknowns[-1] = float(np.log(0.05))
    unknowns.requires_grad_()
    optimizer = torch.optim.LBFGS([unknowns], max_iter=step_count, line_search_fn="strong_wolfe")

    def parts():
        return (
            torch.exp(unknowns[:-2]),
            torch.exp(unknowns[-2]),
            torch.exp(unknowns[-1]) + _NOISE_MIN,
        )

    def closure():
        optimizer.zero_grad()
        length_scales, amplitude, ratio = parts()
        points = x / length_scales
        squares = (points**2).sum(1)
        squares = squares[:, None] + squares - 2 * points @ points.T
        u = torch.sqrt(3.0 * squares.clamp_min(0.0) + 1e-12)
        factor = torch.linalg.cholesky((1.0 + u) * torch.exp(-u) + ratio**2 * eye)
        fit = 0.5 * (y * torch.cholesky_solve(y, factor)).sum() / amplitude**2
        volume = torch.log(torch.diagonal(factor)).sum() + len(x) * torch.log(amplitude)
        # Both outputs share the kernel.
        value = fit + y.shape[1] * volume
        value.backward()
        return value

    optimizer.step(closure)
    with torch.no_grad():
        length_scales, amplitude, ratio = parts()
    return length_scales.numpy(), float(amplitude), float(amplitude * ratio)


def _solve(inputs, y, noise_variance, inducing, config, progress):
    """Weights w of (K + noise_variance) w = y by preconditioned conjugate gradients.

    Args:
        inputs: Scaled features, shape [cast, 4].
        y: Normalised endpoints, shape [cast, 2].
        noise_variance: Relative to the squared amplitude.
        inducing: Rows that the preconditioner is built on.
        config: Tolerance and greatest number of iterations.
        progress: Told after every iteration.

    Returns:
        Weights, shape [cast, 2], and the greater of the two relative residuals by iteration.
    """
    torch = _torch()
    points = torch.tensor(inputs)
    blocks = _kernel_blocks(points)
    precondition = _preconditioner(points, noise_variance, inducing)
    y = torch.tensor(y)

    def product(vectors):
        single = vectors.to(torch.float32)
        result = noise_variance * vectors
        for first, second, block in blocks:
            result[first] += (block @ single[second]).to(vectors.dtype)
            if first != second:
                result[second] += (block.T @ single[first]).to(vectors.dtype)
        return result

    weights = precondition(y)
    remainder = y - product(weights)
    conditioned = precondition(remainder)
    direction = conditioned
    power = (remainder * conditioned).sum(0)
    norm = torch.linalg.vector_norm(y, dim=0)
    residuals: list[float] = []
    for iteration in range(1, config.iterations + 1):
        image = product(direction)
        step = power / (direction * image).sum(0)
        weights = weights + step * direction
        remainder = remainder - step * image
        residuals.append(float((torch.linalg.vector_norm(remainder, dim=0) / norm).max()))
        if progress is not None:
            progress(iteration, config.iterations)
        if not np.isfinite(residuals[-1]):
            raise InputError("the Gaussian process found no finite solution")
        if residuals[-1] <= config.tolerance:
            break
        conditioned = precondition(remainder)
        power, old_power = (remainder * conditioned).sum(0), power
        direction = conditioned + power / old_power * direction
    return weights.numpy(), residuals


def _kernel(first, second):
    torch = _torch()
    u = torch.addmm((second**2).sum(1)[None], first, second.T, alpha=-2.0)
    u.add_((first**2).sum(1)[:, None]).clamp_min_(0.0).mul_(3.0).sqrt_()
    decay = torch.exp(-u)
    return u.add_(1.0).mul_(decay)


def _kernel_blocks(points):
    """Blocks of the kernel matrix on and above its diagonal, with their rows and columns."""
    edges = range(0, len(points), _BLOCK)
    slices = [slice(start, min(start + _BLOCK, len(points))) for start in edges]
    return [
        (first, second, _kernel(points[first], points[second]))
        for i, first in enumerate(slices)
        for second in slices[i:]
    ]


def _preconditioner(points, noise_variance, inducing):
    """Solves with a Nystrom approximation of the kernel matrix plus the noise (Woodbury)."""
    torch = _torch()
    chosen = points[inducing].double()
    eye = torch.eye(len(chosen), dtype=torch.float64)
    factor = torch.linalg.cholesky(_kernel(chosen, chosen) + 1e-6 * eye)
    # low_rank.T @ low_rank approximates the kernel matrix.
    low_rank = torch.linalg.solve_triangular(factor, _kernel(chosen, points.double()), upper=False)
    inner = torch.linalg.cholesky(noise_variance * eye + low_rank @ low_rank.T)

    def solve(vectors):
        correction = low_rank.T @ torch.cholesky_solve(low_rank @ vectors, inner)
        return (vectors - correction) / noise_variance

    return solve


def _torch():
    try:
        import torch
    except ImportError:
        raise MissingExtraError("torch", "learn", "the Gaussian process") from None
    return torch
