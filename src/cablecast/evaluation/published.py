"""Errors that the paper measured with a real UR5, for comparison with ours."""

from typing import NamedTuple


class PublishedRow(NamedTuple):
    """Row of the paper's error tables (`table` II or III); values in % of cable length."""

    cable: str
    method: str
    table: str
    median_pct: float
    first_quartile_pct: float
    third_quartile_pct: float
    min_pct: float
    max_pct: float


METHOD_NAMES = {
    "polar": "polar casting",
    "gaussian-process": "Gaussian process, D_sim",
    "real": "forward model, D_real",
    "sim": "forward model, D_sim",
    "fine-tuning": "forward model, D_sim + D_real",
    "ours": "ours: the same model, searched and refined",
}
"""Names of the methods in the paper's table II, and of our way to plan with its best model."""

BEST_METHOD = "fine-tuning"
"""The paper's best method, which it carried out on all cables."""

# Source: arXiv 2405.09581, tables II (cable 1, five methods) and III (three cables, best method).
# 32 targets, 5 casts each; trials off the table or occluded are left out.
PUBLISHED_ROWS = (
    PublishedRow("cable_1", "polar casting", "II", 43, 14, 76, 4, 106),
    PublishedRow("cable_1", "Gaussian process, D_sim", "II", 29, 20, 59, 4, 159),
    PublishedRow("cable_1", "forward model, D_real", "II", 59, 43, 83, 3, 117),
    PublishedRow("cable_1", "forward model, D_sim", "II", 29, 15, 39, 1, 113),
    PublishedRow("cable_1", METHOD_NAMES[BEST_METHOD], "II", 22, 9, 38, 0, 78),
    PublishedRow("cable_2", METHOD_NAMES[BEST_METHOD], "III", 24, 14, 35, 1, 77),
    PublishedRow("cable_3", METHOD_NAMES[BEST_METHOD], "III", 34, 24, 50, 6, 89),
)


def published_rows(cable_name: str) -> tuple[PublishedRow, ...]:
    """Return the paper's rows for a cable; none for a cable that is not in the paper."""
    return tuple(row for row in PUBLISHED_ROWS if row.cable == cable_name)


def published_row(cable_name: str) -> PublishedRow | None:
    """Return the row of the paper's best method for a cable; None if there is none."""
    best = METHOD_NAMES[BEST_METHOD]
    return next((row for row in published_rows(cable_name) if row.method == best), None)


class PublishedTuning(NamedTuple):
    """Distances of the paper's table I, of PyBullet's default parameters and the tuned ones.

    Final: median final distance; mean: equation 4 [% of cable length].
    """

    default_final_pct: float
    default_mean_pct: float
    tuned_final_pct: float
    tuned_mean_pct: float


# Source: arXiv 2405.09581, table I: 20 validation trajectories of a real UR5 per cable.
_PUBLISHED_TUNING = {
    "cable_1": PublishedTuning(35.0, 38.2, 14.7, 28.4),
    "cable_2": PublishedTuning(25.8, 29.4, 12.2, 23.4),
    "cable_3": PublishedTuning(24.5, 24.5, 14.5, 18.7),
}


def published_tuning(cable_name: str) -> PublishedTuning | None:
    """Return the paper's values for a cable; None for a cable that is not in the paper."""
    return _PUBLISHED_TUNING.get(cable_name)
