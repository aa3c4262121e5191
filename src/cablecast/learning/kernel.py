"""Matern 3/2 kernel.

With u = sqrt(3) d, where d is the distance of two points in units of the length scales, the kernel
is k(u) = (1 + u) exp(-u).
"""

import numpy as np
from numpy.typing import NDArray


def matern(first: NDArray, second: NDArray) -> NDArray:
    """Return the kernel between all pairs of points, with amplitude 1.

    Args:
        first: Points in units of the length scales, shape [first, dimension].
        second: Points, shape [second, dimension].

    Returns:
        Kernel in the type of the points, shape [first, second].
    """
    # In place, because there may be thousands of points.
    u = first @ (-2.0 * second.T)
    u += np.sum(second**2, axis=1)
    u += np.sum(first**2, axis=1)[:, None]
    np.maximum(u, 0.0, out=u)
    u *= 3.0
    np.sqrt(u, out=u)
    decay = np.exp(-u)
    u += 1.0
    u *= decay
    return u
