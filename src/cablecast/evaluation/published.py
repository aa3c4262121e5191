"""Errors that the paper measured with a real UR5, for comparison with ours."""

import dataclasses


@dataclasses.dataclass(frozen=True, kw_only=True)
class PublishedRow:
    """Row of the paper's error tables; values in % of cable length.

    Attributes:
        cable: Name of the cable.
        method: Method that chose the actions.
        table: Number of the paper's table.
        median_pct: Median [% of cable length].
        first_quartile_pct: 25th percentile [% of cable length].
        third_quartile_pct: 75th percentile [% of cable length].
        min_pct: Smallest [% of cable length].
        max_pct: Largest [% of cable length].
    """

    cable: str
    method: str
    table: str
    median_pct: float
    first_quartile_pct: float
    third_quartile_pct: float
    min_pct: float
    max_pct: float


def _row(cable: str, method: str, table: str, *values: float) -> PublishedRow:
    median, q1, q3, low, high = values
    return PublishedRow(
        cable=cable,
        method=method,
        table=table,
        median_pct=median,
        first_quartile_pct=q1,
        third_quartile_pct=q3,
        min_pct=low,
        max_pct=high,
    )


BEST_METHOD_PUBLISHED = "forward model, D_sim + D_real"
"""The paper's best method, fine-tuned on real casts."""

# Source: arXiv 2405.09581, tables II (cable 1, five methods) and III (three cables, best method).
# 32 targets, 5 casts each; trials off the table or occluded are left out.
PUBLISHED_ROWS = (
    _row("cable_1", "polar casting", "II", 43, 14, 76, 4, 106),
    _row("cable_1", "Gaussian process, D_sim", "II", 29, 20, 59, 4, 159),
    _row("cable_1", "forward model, D_real", "II", 59, 43, 83, 3, 117),
    _row("cable_1", "forward model, D_sim", "II", 29, 15, 39, 1, 113),
    _row("cable_1", BEST_METHOD_PUBLISHED, "II", 22, 9, 38, 0, 78),
    _row("cable_2", BEST_METHOD_PUBLISHED, "III", 24, 14, 35, 1, 77),
    _row("cable_3", BEST_METHOD_PUBLISHED, "III", 34, 24, 50, 6, 89),
)


def published_rows(cable_name: str) -> tuple[PublishedRow, ...]:
    """Return the paper's rows for a cable; none for a cable that is not in the paper."""
    return tuple(row for row in PUBLISHED_ROWS if row.cable == cable_name)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PublishedRepeatability:
    """Repeatability of one combination of system parameters, with cable 1 on a real UR5.

    Attributes:
        v_max: Largest speed of the gripped end [m/s].
        with_psi: Whether the wrist turns.
        scatter_pct: Standard deviation about the mean landing, averaged over the actions [% of
            cable length].
        off_table_share: Share of the casts that left the table [-]; None if not published.
    """

    v_max: float
    with_psi: bool
    scatter_pct: float
    off_table_share: float | None


# Source: arXiv 2405.09581, section VI-B; the shares off the table from its arXiv source.
PUBLISHED_REPEATABILITY = (
    PublishedRepeatability(v_max=1.2, with_psi=False, scatter_pct=1.27, off_table_share=None),
    PublishedRepeatability(v_max=1.5, with_psi=True, scatter_pct=1.93, off_table_share=0.129),
    PublishedRepeatability(v_max=1.8, with_psi=False, scatter_pct=3.70, off_table_share=None),
    PublishedRepeatability(v_max=1.8, with_psi=True, scatter_pct=4.72, off_table_share=0.30),
)


def published_repeatability(v_max: float, with_psi: bool) -> PublishedRepeatability | None:
    """Return the paper's values for a combination; None if not published."""
    for row in PUBLISHED_REPEATABILITY:
        if abs(row.v_max - v_max) < 1e-9 and row.with_psi == with_psi:
            return row
    return None
