"""The next point of aim after misses: each miss counts by how surely it will repeat."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.view.tries import Try

PRIOR_SHARE, SCATTER_SHARE, DRIFT_SHARE = 0.08, 0.02, 0.008
"""Standard deviations of the miss before any cast, of equal casts, and of the change of the miss
from try to try [share of cable length]. Measured on the virtual rig (docs/view.md)."""


def next_aim(tries: Sequence[Try], length: float) -> NDArray[np.float64]:
    """Return the point to aim at next, moved against the expected miss of the last action.

    A Kalman filter per axis follows the offset from the model's prediction to the landing. It
    starts at zero, moves by the drift from try to try, and sees each landing with the scatter.

    Args:
        tries: Tries at one target that came to rest, in order, at least one.
        length: Length of the cable [m].
    """
    offset, variance = np.zeros(2), (PRIOR_SHARE * length) ** 2
    noise, drift = (SCATTER_SHARE * length) ** 2, (DRIFT_SHARE * length) ** 2
    for one in tries:
        gain = variance / (variance + noise)
        offset = offset + gain * (one.landed_xy - one.predicted_xy - offset)
        variance = (1.0 - gain) * variance + drift
    return np.asarray(tries[-1].target_xy - offset)
