"""Solution of the kernel system of all casts by preconditioned conjugate gradients.

Half of the symmetric kernel matrix is kept in single precision: 2.6 GB for 36,000 casts. A Nystrom
approximation preconditions the system, so that a few dozen products with the matrix suffice.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.models.kernel import matern_torch
from cablecast.models.torch_ import import_torch

BLOCK_ROWS = 4000
"""Rows and columns of a block of the kernel matrix."""

NOT_SOLVED = 0.1
"""Relative residual above which the last iterate is refused."""

# Number of casts from which the mean of the kernel is estimated.
_MEAN_ROWS = 500

# Added to the diagonal of the inducing kernel matrix, which is singular where casts coincide.
_JITTER = 1e-6

Progress = Callable[[int, int], None]
"""Called with the number of completed steps and the maximum number of steps."""


def solve_kernel_system(
    inputs: NDArray[np.float32],
    targets: NDArray[np.float64],
    noise_variance: float,
    inducing: NDArray[np.intp],
    *,
    tolerance: float,
    max_iterations: int,
    progress: Progress | None = None,
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
        if progress is not None:
            progress(iteration, max_iterations)
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
