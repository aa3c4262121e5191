"""Matern 3/2 kernel in NumPy and torch, and the fit of its parameters by marginal likelihood.

With u = sqrt(3) d, where d is the distance of two points in units of the length scales, the kernel
is k(u) = (1 + u) exp(-u). Prediction uses NumPy and does not need torch.

Solution of the kernel system of all casts by preconditioned conjugate gradients.

Half of the symmetric kernel matrix is kept in single precision: 2.6 GB for 36,000 casts. A Nystrom
approximation preconditions the system, so that a few dozen products with the matrix suffice.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.learning.checkpoint import import_torch
from cablecast.runs.progress import Progress, ProgressCallback, ignore

# The square root has no slope at zero, so the squared distances on the diagonal are kept above it.
_SQUARE_MIN = 1e-12


def scaled_distances(first: NDArray, second: NDArray) -> NDArray:
    """Return u, sqrt(3) times the distance between all pairs of points.

    Args:
        first: Points in units of the length scales, shape [first, dimension].
        second: Points, shape [second, dimension].

    Returns:
        Scaled distances in the type of the points, shape [first, second].
    """
    # In place, because `second` may hold 36,000 casts.
    u = first @ (-2.0 * second.T)
    u += np.sum(second**2, axis=1)
    u += np.sum(first**2, axis=1)[:, None]
    np.maximum(u, 0.0, out=u)
    u *= 3.0
    return np.sqrt(u, out=u)


def matern(first: NDArray, second: NDArray) -> NDArray:
    """Return the kernel between all pairs of points, with amplitude 1.

    Args:
        first: Points in units of the length scales, shape [first, dimension].
        second: Points, shape [second, dimension].

    Returns:
        Kernel in the type of the points, shape [first, second].
    """
    u = scaled_distances(first, second)
    decay = np.exp(-u)
    u += 1.0
    u *= decay
    return u


def weighted_sums(kernel: NDArray, weights: NDArray) -> NDArray[np.float64]:
    """Return kernel @ weights, nearly as accurate as in double precision.

    Where the length scales are long, the kernel is close to 1 everywhere, and large weights of both
    signs cancel. Single precision would lose the result in the rounding of that sum, so a constant
    near the mean of the kernel is subtracted, and its share is summed in double precision.

    Args:
        kernel: Kernel or its decay, shape [point, cast]. It is overwritten.
        weights: Weights of the casts, shape [cast, output].
    """
    # A sample suffices: any constant is exact, and the mean leaves the least to round.
    mean = kernel[::8, ::8].mean()
    kernel -= mean
    return kernel @ weights.astype(kernel.dtype) + float(mean) * weights.sum(axis=0)


def matern_torch(first: Any, second: Any) -> Any:
    """Return the kernel between all pairs of points as a tensor; see `matern`.

    It works in place, without gradients, on all cores and in the precision of the points.
    """
    torch = import_torch("the Gaussian process")
    u = torch.addmm((second**2).sum(1)[None], first, second.T, alpha=-2.0)
    u.add_((first**2).sum(1)[:, None]).clamp_min_(0.0).mul_(3.0).sqrt_()
    decay = torch.exp(-u)
    return u.add_(1.0).mul_(decay)


def negative_log_likelihood(points: Any, outputs: Any, log_sizes: Any, noise_ratio: Any) -> Any:
    """Return the negative log marginal likelihood of outputs, up to a constant.

    Output column j at point i is modelled as exp(log_sizes[i]) (g_j(i) + noise_ratio e_ij), where
    g_j is a Gaussian process of amplitude 1 and e_ij is standard normal noise. All columns share
    the kernel.

    Args:
        points: Points in units of the length scales, shape [point, dimension].
        outputs: Outputs of mean zero, shape [point, output].
        log_sizes: Logarithm of the local amplitude, shape [point].
        noise_ratio: Standard deviation of the noise relative to the amplitude.

    Returns:
        A scalar tensor with gradients for all arguments.
    """
    torch = import_torch("the Gaussian process")
    squares = (points**2).sum(1)
    squares = squares[:, None] + squares - 2 * points @ points.T
    u = torch.sqrt(3.0 * squares.clamp_min(0.0) + _SQUARE_MIN)
    eye = torch.eye(len(points), dtype=points.dtype)
    factor = torch.linalg.cholesky((1.0 + u) * torch.exp(-u) + noise_ratio**2 * eye)
    whitened = outputs * torch.exp(-log_sizes)[:, None]
    fit = 0.5 * (whitened * torch.cholesky_solve(whitened, factor)).sum()
    log_volume = torch.log(torch.diagonal(factor)).sum() + log_sizes.sum()
    return fit + outputs.shape[1] * log_volume


def minimize(loss: Callable[[Any], Any], start: NDArray, step_count: int) -> NDArray[np.float64]:
    """Minimise a smooth function by L-BFGS.

    Args:
        loss: Function of a vector, differentiable by torch.
        start: Vector to start from.
        step_count: Maximum number of steps.

    Returns:
        The vector with the least loss found.

    Raises:
        InputError: The loss or the vector became infinite or NaN.
    """
    torch = import_torch("the Gaussian process")
    unknowns = torch.tensor(start, dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.LBFGS([unknowns], max_iter=step_count, line_search_fn="strong_wolfe")

    def closure():
        optimizer.zero_grad()
        value = loss(unknowns)
        value.backward()
        return value

    try:
        optimizer.step(closure)
    except torch.linalg.LinAlgError:  # pyright: ignore[reportPrivateImportUsage]
        # The covariance is no longer positive definite, or holds NaN.
        raise InputError("the Gaussian process found no finite fit to the casts") from None
    result = unknowns.detach().numpy()
    if not np.all(np.isfinite(result)):
        raise InputError("the Gaussian process found no finite fit to the casts")
    return result


BLOCK_ROWS = 4000
"""Rows and columns of a block of the kernel matrix."""

NOT_SOLVED = 0.1
"""Relative residual above which the last iterate is refused."""

# Number of casts from which the mean of the kernel is estimated.
_MEAN_ROWS = 500

# Added to the diagonal of the inducing kernel matrix, which is singular where casts coincide.
_JITTER = 1e-6


def solve_kernel_system(
    inputs: NDArray[np.float32],
    targets: NDArray[np.float64],
    noise_variance: float,
    inducing: NDArray[np.intp],
    *,
    tolerance: float,
    max_iterations: int,
    progress: ProgressCallback = ignore,
    block_rows: int = BLOCK_ROWS,
) -> tuple[NDArray[np.float64], list[float]]:
    """Solve (K + noise_variance I) w = targets, where K is the kernel matrix of the inputs.

    Args:
        inputs: Points in units of the length scales, shape [cast, dimension].
        targets: Right-hand sides, shape [cast, output].
        noise_variance: Variance of the noise relative to that of the process.
        inducing: Rows on which the preconditioner is built.
        tolerance: Residual, relative to the right-hand side, at which the iteration stops.
        max_iterations: Maximum number of iterations.
        progress: Called after every iteration.
        block_rows: Rows and columns of a block of the kernel matrix.

    Returns:
        The weights w, shape [cast, output], and the greatest relative residual of any output after
        each iteration.

    Raises:
        InputError: The residual was not finite, or above `NOT_SOLVED` after the last iteration.
        MissingExtraError: torch is not installed.
    """
    torch = import_torch("the Gaussian process")
    points, y = torch.tensor(inputs), torch.tensor(targets)
    product = _kernel_product(points, noise_variance, block_rows)
    precondition = _preconditioner(points, noise_variance, inducing)

    weights = precondition(y)
    remainder = y - product(weights)
    conditioned = precondition(remainder)
    direction = conditioned
    power = (remainder * conditioned).sum(0)
    norm = torch.linalg.vector_norm(y, dim=0)
    residuals: list[float] = []
    for iteration in range(1, max_iterations + 1):
        image = product(direction)
        step = power / (direction * image).sum(0)
        weights = weights + step * direction
        remainder = remainder - step * image
        residuals.append(float((torch.linalg.vector_norm(remainder, dim=0) / norm).max()))
        unit = "steps at most"
        progress(Progress(task="Solving", done=iteration, total=max_iterations, unit=unit))
        if not np.isfinite(residuals[-1]):
            raise InputError("the Gaussian process found no finite solution")
        if residuals[-1] <= tolerance:
            break
        conditioned = precondition(remainder)
        power, old_power = (remainder * conditioned).sum(0), power
        direction = conditioned + power / old_power * direction
    if residuals[-1] > NOT_SOLVED:
        raise InputError(
            f"the Gaussian process has a relative residual of {residuals[-1]:.2g} after "
            f"{len(residuals)} iterations: it must be below {NOT_SOLVED:g}"
        )
    return weights.numpy(), residuals


def _kernel_product(points: Any, noise_variance: float, block_rows: int) -> Callable[[Any], Any]:
    """Return the product with K + noise_variance I, from blocks on and above the diagonal.

    The blocks hold the kernel minus a constant near its mean, whose share is added in double
    precision; see `weighted_sums`.
    """
    some = points[:: max(1, len(points) // _MEAN_ROWS)]
    mean = float(matern_torch(some, some).mean())
    edges = range(0, len(points), block_rows)
    slices = [slice(start, min(start + block_rows, len(points))) for start in edges]
    blocks = [
        (first, second, matern_torch(points[first], points[second]).sub_(mean))
        for i, first in enumerate(slices)
        for second in slices[i:]
    ]

    def product(vectors):
        single = vectors.to(points.dtype)
        result = noise_variance * vectors + mean * vectors.sum(0)
        for first, second, block in blocks:
            result[first] += (block @ single[second]).to(vectors.dtype)
            if first != second:
                result[second] += (block.T @ single[first]).to(vectors.dtype)
        return result

    return product


def _preconditioner(
    points: Any, noise_variance: float, inducing: NDArray[np.intp]
) -> Callable[[Any], Any]:
    """Return the solution with a Nystrom approximation of K plus the noise (Woodbury)."""
    torch = import_torch("the Gaussian process")
    chosen = points[inducing].double()
    eye = torch.eye(len(chosen), dtype=torch.float64)
    factor = torch.linalg.cholesky(matern_torch(chosen, chosen) + _JITTER * eye)
    # low_rank.T @ low_rank approximates the kernel matrix.
    low_rank = torch.linalg.solve_triangular(
        factor, matern_torch(chosen, points.double()), upper=False
    )
    inner = torch.linalg.cholesky(noise_variance * eye + low_rank @ low_rank.T)

    def solve(vectors):
        correction = low_rank.T @ torch.cholesky_solve(low_rank @ vectors, inner)
        return (vectors - correction) / noise_variance

    return solve
