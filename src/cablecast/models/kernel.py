"""Matern 3/2 kernel in NumPy and torch, and the fit of its parameters by marginal likelihood.

With u = sqrt(3) d, where d is the distance of two points in units of the length scales, the kernel
is k(u) = (1 + u) exp(-u). Prediction uses NumPy and does not need torch.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.models.torch_ import import_torch

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
