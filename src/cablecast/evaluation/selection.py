"""Choosing r0, v_max and the action set from coverage and repeatability (sections V-E and VI-B).

The paper takes the r0 of the greatest coverage, and then weighs coverage against repeatability by
eye. Here the second step is a rule, which on the paper's own figures makes the paper's choice: the
combination whose coverage is greatest for each percent of scatter; and where the repeated actions
are too few to tell which that is, the one of those in question that covers most.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from cablecast.errors import InputError
from cablecast.evaluation.published import PUBLISHED_REPEATABILITY


@dataclasses.dataclass(frozen=True, kw_only=True)
class Candidate:
    """A combination of system parameters with what is known of it.

    Attributes:
        r0: Distance of the polar origin [m].
        v_max: Largest speed of the grip [m/s].
        with_psi: Whether the wrist turns (the action set A2).
        coverage: Share of the reachable half disc [-].
        scatter_pct: Mean over actions of the standard deviation of repeated landings [% of cable
            length]; None where it was not measured.
        scatter_standard_error_pct: Of that mean, for the choice of actions [% of cable length];
            None where it is not known, and taken as none at all.
        off_table_share: Share of repeated casts that left the table [-]; None where not measured.
    """

    r0: float
    v_max: float
    with_psi: bool
    coverage: float
    scatter_pct: float | None = None
    scatter_standard_error_pct: float | None = None
    off_table_share: float | None = None

    @property
    def name(self) -> str:
        """As a person reads it, e.g. `r0 = 0.6 m, v_max = 1.5 m/s with psi`."""
        return f"r0 = {self.r0:g} m, v_max = {self.v_max:g} m/s" + " with psi" * self.with_psi

    @property
    def merit(self) -> float | None:
        """Coverage times the share of casts that land, for each percent of scatter.

        None where scatter was not measured.
        """
        if self.scatter_pct is None:
            return None
        # No rig repeats perfectly: below a tenth of a percent the camera decides what is measured.
        return self.coverage * (1.0 - (self.off_table_share or 0.0)) / max(self.scatter_pct, 0.1)

    @property
    def merit_error(self) -> float:
        """Standard error of the merit, from that of the scatter."""
        if not self.merit or not self.scatter_pct:
            return 0.0
        return self.merit * (self.scatter_standard_error_pct or 0.0) / self.scatter_pct


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
"""What the paper weighed against each other."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Choice:
    """The chosen system parameters.

    Attributes:
        r0: Distance of the polar origin [m].
        v_max: Largest speed of the grip [m/s].
        with_psi: Whether the wrist turns.
        reasons: Why, in sentences.
    """

    r0: float
    v_max: float
    with_psi: bool
    reasons: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a JSON file."""
        return dataclasses.asdict(self) | {"reasons": list(self.reasons)}


def choose_r0(candidates: Sequence[Candidate]) -> tuple[float, str]:
    """The r0 whose coverage, averaged over the speeds without psi, is greatest, and why.

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
    return best, f"r0 = {best:g} m covers most, averaged over the speeds: {listed}."


def choose(candidates: Sequence[Candidate]) -> Choice:
    """Choose among candidates.

    Args:
        candidates: With coverage; of those with the best r0 some with scatter as well. Where none
            has, coverage alone decides.

    Raises:
        InputError: There are no candidates without psi to compare r0 by.
    """
    r0, why_r0 = choose_r0(candidates)
    same_r0 = [candidate for candidate in candidates if candidate.r0 == r0]
    merits: Mapping[Candidate, float] = {
        candidate: candidate.merit for candidate in same_r0 if candidate.merit is not None
    }
    if not merits:
        best = max(same_r0, key=lambda candidate: candidate.coverage)
        why = (
            f"{_speed(best)} covers most, {100 * best.coverage:.1f} %; repeatability was not "
            "measured, so that coverage alone decides."
        )
    else:
        first = max(merits, key=lambda candidate: merits[candidate])
        in_question = [
            candidate
            for candidate, merit in merits.items()
            if merit >= merits[first] - math.hypot(candidate.merit_error, first.merit_error)
        ]
        best = max(in_question, key=lambda candidate: candidate.coverage)
        listed = ", ".join(
            f"{100 * merit:.1f} points with {_speed(candidate)}"
            for candidate, merit in sorted(merits.items(), key=lambda pair: -pair[1])
        )
        why = (
            f"{_speed(first)} gives the most coverage by casts that stay on the table for each "
            f"percent of scatter: {listed}."
        )
        if len(in_question) > 1:
            others = " and ".join(_speed(candidate) for candidate in in_question)
            why += (
                f" But the scatter is not known well enough to tell {others} apart, and of these "
                f"{_speed(best)} covers most, {100 * best.coverage:.1f} %."
            )
    return Choice(r0=r0, v_max=best.v_max, with_psi=best.with_psi, reasons=(why_r0, why))


def _speed(candidate: Candidate) -> str:
    return f"v_max = {candidate.v_max:g} m/s" + " with psi" * candidate.with_psi
