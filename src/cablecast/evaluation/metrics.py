"""Distances between where the endpoint should be and where it is, in % of cable length."""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.errors import InputError


def target_error_pct(
    landed_xy: ArrayLike, target_xy: ArrayLike, cable_length: float
) -> NDArray[np.float64]:
    """Distance from target to endpoint, as the paper's tables give it [% of cable length].

    Args:
        landed_xy: Where the endpoint came to rest [m], shape [..., 2]; NaN where unknown.
        target_xy: Where it should have [m], shape [..., 2].
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
    """The five numbers by which the paper summarises errors, and how many trials they cover.

    NaN where there is no error to summarise, infinite where a miss of unknown size decides.

    Attributes:
        count: Number of errors summarised.
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
        """Plain values for a JSON file; NaN and infinity, which JSON lacks, become None."""
        values = dataclasses.asdict(self)
        return {name: value if math.isfinite(value) else None for name, value in values.items()}


def summarise_errors(errors_pct: ArrayLike) -> ErrorSummary:
    """Summarise errors; those of trials without a landing (NaN) are left out, as in the paper.

    Args:
        errors_pct: Errors [% of cable length], any shape. An infinite error stands for a miss of
            unknown size and counts.
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
    """Linearly interpolated quantile that, unlike NumPy's, is no NaN beside an infinite value."""
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
