"""Selection: r0, v_max and the action set from coverage and repeatability (sections V-E and VI-B).

The paper takes the r0 with the largest coverage, and then weighs coverage against repeatability by
eye. Here the second step is a rule: maximise coverage among the repeatable combinations. With the
paper's own figures, the rule makes the paper's choice.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

from cablecast.checks import check_number
from cablecast.errors import InputError
from cablecast.evaluation.published import PUBLISHED_REPEATABILITY

SCATTER_MAX_PCT = 3.0
"""Largest scatter of a repeatable combination [% of cable length]. The paper accepted 1.93 and
rejected 3.70."""

_SCATTER_BOUNDS = (1e-3, 1e4)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Candidate:
    """Combination of system parameters, with its coverage and scatter.

    Attributes:
        r0: Distance of the polar origin [m].
        v_max: Largest speed of the grip [m/s].
        with_psi: Whether the wrist turns (the action set A2).
        coverage: Share of the reachable half disc [-].
        scatter_pct: Mean over actions of the standard deviation of repeated landings [% of cable
            length]; None if not measured.
        off_table_share: Share of repeated casts that left the table [-]; None if not measured.
    """

    r0: float
    v_max: float
    with_psi: bool
    coverage: float
    scatter_pct: float | None = None
    off_table_share: float | None = None

    def __post_init__(self):
        # Rounding may lift a share of area above 1.
        check_number("coverage", self.coverage, 0.0, 1.0 + 1e-9)
        if self.scatter_pct is not None:
            check_number("scatter", self.scatter_pct, 0.0, 1e6, "% of cable length")
        if self.off_table_share is not None:
            check_number("off_table_share", self.off_table_share, 0.0, 1.0)

    @property
    def name(self) -> str:
        """Display name, e.g. `r0 = 0.6 m, v_max = 1.5 m/s with psi`."""
        return f"r0 = {self.r0:g} m, v_max = {self.v_max:g} m/s" + " with psi" * self.with_psi

    @property
    def landed_coverage(self) -> float:
        """Coverage times the share of repeated casts that stayed on the table [-]."""
        return self.coverage * (1.0 - (self.off_table_share or 0.0))


# Source: arXiv 2405.09581, section VI-B: coverage in simulation tuned to cable 1, r0 = 0.6 m.
_PUBLISHED_COVERAGE = {
    (1.2, False): 0.213,
    (1.8, False): 0.663,
    (1.5, True): 0.769,
    (1.8, True): 0.797,
}

PUBLISHED_CANDIDATES = tuple(
    Candidate(
        r0=0.6,
        v_max=row.v_max,
        with_psi=row.with_psi,
        coverage=_PUBLISHED_COVERAGE[row.v_max, row.with_psi],
        scatter_pct=row.scatter_pct,
        off_table_share=row.off_table_share,
    )
    for row in PUBLISHED_REPEATABILITY
)
"""Combinations that the paper compared."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Choice:
    """Chosen system parameters.

    Attributes:
        r0: Distance of the polar origin [m].
        v_max: Largest speed of the grip [m/s].
        with_psi: Whether the wrist turns.
        reasons: Reasons for the choice, as sentences.
    """

    r0: float
    v_max: float
    with_psi: bool
    reasons: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for a JSON file."""
        return dataclasses.asdict(self) | {"reasons": list(self.reasons)}


def choose_r0(candidates: Sequence[Candidate]) -> tuple[float, str]:
    """Return the r0 with the largest coverage, averaged over the speeds without psi, and why.

    Raises:
        InputError: There is no candidate without psi.
    """
    shares: dict[float, list[float]] = {}
    for candidate in candidates:
        if not candidate.with_psi:
            shares.setdefault(candidate.r0, []).append(candidate.coverage)
    if not shares:
        raise InputError("choosing r0 needs candidates without psi, and there are none")
    means = {r0: sum(values) / len(values) for r0, values in shares.items()}
    best = max(means, key=lambda r0: means[r0])
    listed = ", ".join(f"{100 * means[r0]:.1f} % with {r0:g} m" for r0 in sorted(means))
    return best, f"r0 = {best:g} m has the largest coverage, averaged over the speeds: {listed}."


def choose(candidates: Sequence[Candidate], scatter_max_pct: float = SCATTER_MAX_PCT) -> Choice:
    """Choose r0, v_max and the action set.

    Args:
        candidates: Combinations with their coverage. Those with the best r0 may also have a
            scatter; if none has, coverage alone decides.
        scatter_max_pct: Largest scatter of a repeatable combination [% of cable length].

    Raises:
        InputError: There are no candidates without psi to choose r0 from, or scatter_max_pct is out
            of bounds.
    """
    check_number("scatter_max", scatter_max_pct, *_SCATTER_BOUNDS, "% of cable length")
    r0, why_r0 = choose_r0(candidates)
    same_r0 = [candidate for candidate in candidates if candidate.r0 == r0]
    scatter = {c: c.scatter_pct for c in same_r0 if c.scatter_pct is not None}
    steady = [candidate for candidate in scatter if scatter[candidate] <= scatter_max_pct]
    listed = ", ".join(
        f"{100 * candidate.landed_coverage:.1f} % at a scatter of {scatter[candidate]:.2f} % with "
        f"{_speed(candidate)}"
        for candidate in sorted(scatter, key=lambda c: -c.landed_coverage)
    )
    if not scatter:
        best = max(same_r0, key=lambda candidate: candidate.coverage)
        why = (
            f"{_speed(best)} has the largest coverage, {100 * best.coverage:.1f} %. Repeatability "
            "was not measured, so coverage alone decides."
        )
    elif steady:
        best = max(steady, key=lambda candidate: candidate.landed_coverage)
        why = (
            f"{_speed(best)} has the largest coverage by casts that stay on the table, among "
            f"settings with a scatter of at most {scatter_max_pct:g} % of cable length: {listed}."
        )
    else:
        best = min(scatter, key=lambda candidate: scatter[candidate])
        why = (
            f"No setting has a scatter of at most {scatter_max_pct:g} % of cable length; "
            f"{_speed(best)} has the smallest: {listed}."
        )
    return Choice(r0=r0, v_max=best.v_max, with_psi=best.with_psi, reasons=(why_r0, why))


def _speed(candidate: Candidate) -> str:
    return f"v_max = {candidate.v_max:g} m/s" + " with psi" * candidate.with_psi
