"""Bootstrap intervals of medians: a median over few casts is uncertain, and says by how much."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

DRAW_COUNT = 2000
"""Bootstrap draws."""

SHARE = 0.9
"""Share of the draws that an interval holds."""


def median_interval(values: ArrayLike) -> tuple[float, float, float]:
    """Return the median of some values, and the ends of its interval.

    Args:
        values: Values in any unit, shape [value].
    """
    known = np.asarray(values, dtype=float)
    low, high = _ends(np.median(known[_picks(len(known))], axis=1))
    return float(np.median(known)), low, high


def difference_interval(first: ArrayLike, second: ArrayLike) -> tuple[float, float, float]:
    """Return the first median less the second, and the ends of its interval.

    Args:
        first: Values of one method, shape [case].
        second: Values of another one in the same cases, shape [case].
    """
    both = np.array([first, second], dtype=float)
    draws = np.median(both[:, _picks(both.shape[1])], axis=2)
    low, high = _ends(draws[0] - draws[1])
    return float(np.median(both[0]) - np.median(both[1])), low, high


def _picks(count: int) -> NDArray[np.int_]:
    """Return which cases each draw holds, shape [draw, case]; the same for equal counts."""
    return np.random.default_rng(0).integers(count, size=(DRAW_COUNT, count))


def _ends(draws: NDArray[np.float64]) -> tuple[float, float]:
    low, high = np.quantile(draws, (0.5 - 0.5 * SHARE, 0.5 + 0.5 * SHARE))
    return float(low), float(high)
