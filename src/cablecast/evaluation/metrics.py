"""Target errors: distances from target to landing, in % of cable length."""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.conventions import finite_or_none
from cablecast.errors import InputError


def target_error_pct(
    landed_xy: ArrayLike, target_xy: ArrayLike, cable_length: float
) -> NDArray[np.float64]:
    """Return distances from target to endpoint, as in the paper's tables [% of cable length].

    Args:
        landed_xy: Resting points of the endpoint [m], shape [..., 2]; NaN where unknown.
        target_xy: Targets [m], shape [..., 2].
        cable_length: Cable length r_c [m].

    Returns:
        Errors, NaN where the endpoint is unknown, shape [...].
    """
    offset = np.asarray(landed_xy, dtype=float) - np.asarray(target_xy, dtype=float)
    if offset.shape[-1:] != (2,):
        raise InputError(f"points have shape {offset.shape}: it must be [..., 2]")
    return 100.0 * np.hypot(offset[..., 0], offset[..., 1]) / cable_length


@dataclasses.dataclass(frozen=True, kw_only=True)
class ErrorSummary:
    """Five-number summary of errors, as in the paper, and the number of errors.

    Values are NaN without errors, and infinite where a miss of unknown size determines them.

    Attributes:
        count: Number of errors.
        median_pct: Median [% of cable length].
        first_quartile_pct: 25th percentile [% of cable length].
        third_quartile_pct: 75th percentile [% of cable length].
        min_pct: Smallest [% of cable length].
        max_pct: Largest [% of cable length].
    """

    count: int
    median_pct: float
    first_quartile_pct: float
    third_quartile_pct: float
    min_pct: float
    max_pct: float

    def to_dict(self) -> dict:
        """Return plain values for a JSON file; NaN and infinity, which JSON lacks, become None."""
        values = dataclasses.asdict(self)
        count = values.pop("count")
        return {"count": count} | {name: finite_or_none(value) for name, value in values.items()}


def summarise_errors(errors_pct: ArrayLike) -> ErrorSummary:
    """Summarise errors; trials without a landing (NaN) are left out, as in the paper.

    Args:
        errors_pct: Errors [% of cable length], any shape. Infinite errors are misses of unknown
            size, and are counted.
    """
    errors = np.asarray(errors_pct, dtype=float)
    errors = np.sort(errors[~np.isnan(errors)])
    return ErrorSummary(
        count=errors.size,
        median_pct=_quantile(errors, 0.5),
        first_quartile_pct=_quantile(errors, 0.25),
        third_quartile_pct=_quantile(errors, 0.75),
        min_pct=_quantile(errors, 0.0),
        max_pct=_quantile(errors, 1.0),
    )


def _quantile(sorted_errors: NDArray[np.float64], fraction: float) -> float:
    """Return a linearly interpolated quantile; unlike NumPy's, never NaN next to infinity."""
    if sorted_errors.size == 0:
        return math.nan
    position = fraction * (sorted_errors.size - 1)
    low = math.floor(position)
    if position == low:
        return float(sorted_errors[low])
    below, above = sorted_errors[low], sorted_errors[low + 1]
    if math.isinf(above):
        return math.inf
    return float(below + (position - low) * (above - below))
