"""Expected loss of a cast: what an aimer chooses by."""

import numpy as np
from numpy.typing import NDArray

NEAR = 0.08
"""Miss beyond which it hardly matters how large a miss is [cable lengths]."""


def expected_loss(
    distance: NDArray[np.float64], variance: NDArray[np.float64], failure: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the expected loss of casts.

    The loss of a miss m is 1 - exp(-m² / (2 w²)) with w = `NEAR`, and 1 for a cast without a
    landing. Small misses count by their square, as in a Kalman filter. A large miss that is certain
    counts for as much as one that is only possible: it is no reason to stay.

    Args:
        distance: Distance from expected landing to target [cable lengths], shape [action].
        variance: Variance of the landing along each axis [square cable lengths], [action].
        failure: Chance of a cast without a landing [-], shape [action].

    Returns:
        Loss [-], shape [action].
    """
    width = NEAR**2 + variance
    near = NEAR**2 / width * np.exp(-(distance**2) / (2.0 * width))
    return 1.0 - (1.0 - failure) * near
