"""Tuning results of the paper, for comparison with ours."""

import dataclasses


@dataclasses.dataclass(frozen=True, kw_only=True)
class PublishedTuning:
    """Column of the paper's tuning table; values in % of cable length.

    Attributes:
        default_final_pct: Median final distance with PyBullet's default parameters.
        default_mean_pct: Equation 4 with PyBullet's default parameters.
        tuned_final_pct: Median final distance after Differential Evolution.
        tuned_mean_pct: Equation 4 after Differential Evolution.
    """

    default_final_pct: float
    default_mean_pct: float
    tuned_final_pct: float
    tuned_mean_pct: float


# Source: arXiv 2405.09581, table I: 20 validation trajectories of a real UR5 per cable.
_PUBLISHED = {
    "cable_1": PublishedTuning(
        default_final_pct=35.0, default_mean_pct=38.2, tuned_final_pct=14.7, tuned_mean_pct=28.4
    ),
    "cable_2": PublishedTuning(
        default_final_pct=25.8, default_mean_pct=29.4, tuned_final_pct=12.2, tuned_mean_pct=23.4
    ),
    "cable_3": PublishedTuning(
        default_final_pct=24.5, default_mean_pct=24.5, tuned_final_pct=14.5, tuned_mean_pct=18.7
    ),
}

PUBLISHED_SIMULATION_COUNT = 30_000
"""Approximate number of simulations of the paper's search per cable."""


def published_tuning(cable_name: str) -> PublishedTuning | None:
    """Return the paper's values for a cable; None for a cable that is not in the paper."""
    return _PUBLISHED.get(cable_name)
