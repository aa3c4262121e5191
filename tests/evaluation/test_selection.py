import dataclasses
import math

import pytest

from cablecast.errors import InputError
from cablecast.evaluation.coverage import PUBLISHED_CANDIDATES, Candidate, choose


def candidate(v_max, coverage, **values):
    return Candidate(
        **({"r0": 0.6, "v_max": v_max, "with_psi": False, "coverage": coverage} | values)
    )


def test_on_the_papers_figures_the_rule_makes_the_papers_choice():
    choice, _ = choose(PUBLISHED_CANDIDATES)
    assert (choice.r0, choice.v_max, choice.with_psi) == (0.6, 1.5, True)


def test_r0_is_the_one_that_covers_most_on_average_over_the_speeds():
    figures = ((1.2, 0.2, 0.6), (1.8, 0.6, 0.6), (1.2, 0.1, 1.0), (1.8, 0.65, 1.0))
    choice, reasons = choose([candidate(v, share, r0=r0) for v, share, r0 in figures])
    assert choice.r0 == 0.6
    assert "40.0 % with 0.6 m, 37.5 % with 1 m" in reasons[0]


def test_coverage_that_costs_too_much_scatter_is_not_chosen():
    calm, wild = candidate(1.5, 0.5, scatter_pct=2.0), candidate(1.8, 0.7, scatter_pct=4.0)
    assert choose([calm, wild])[0].v_max == 1.5
    steadier = dataclasses.replace(wild, scatter_pct=2.5)
    assert choose([calm, steadier])[0].v_max == 1.8


def test_casts_that_leave_the_table_count_against_their_coverage():
    kept = candidate(1.5, 0.5, scatter_pct=2.0, off_table_share=0.0)
    lost = candidate(1.8, 0.6, scatter_pct=2.0, off_table_share=0.3)
    assert choose([kept, lost])[0].v_max == 1.5


def test_where_nothing_repeats_well_enough_what_scatters_least_is_chosen():
    choice, reasons = choose(
        [candidate(1.2, 0.2, scatter_pct=4.0), candidate(1.8, 0.6, scatter_pct=5.0)]
    )
    assert choice.v_max == 1.2
    assert "No setting has a scatter of at most 3 %" in reasons[1]


def test_how_much_may_scatter_is_the_users_to_say():
    assert choose(PUBLISHED_CANDIDATES, scatter_max_pct=1.5)[0].v_max == 1.2
    assert choose(PUBLISHED_CANDIDATES, scatter_max_pct=4.0)[0].v_max == 1.5


@pytest.mark.parametrize("scatter_max_pct", [0.0, math.nan])
def test_a_bound_on_the_scatter_is_a_positive_number(scatter_max_pct):
    with pytest.raises(InputError, match="scatter_max_pct = "):
        choose(PUBLISHED_CANDIDATES, scatter_max_pct=scatter_max_pct)


@pytest.mark.parametrize(
    "values",
    [{"coverage": 1.5}, {"scatter_pct": math.nan}, {"off_table_share": -0.1}],
    ids=str,
)
def test_figures_that_nobody_can_measure_are_refused(values):
    with pytest.raises(InputError, match=next(iter(values)).removesuffix("_pct")):
        candidate(1.5, **{"coverage": 0.5} | values)


def test_without_repeatability_coverage_alone_decides_and_the_reason_says_so():
    choice, reasons = choose([candidate(1.2, 0.2), candidate(1.8, 0.6)])
    assert choice.v_max == 1.8
    assert "was not measured" in reasons[1]


def test_a_candidate_that_was_not_repeated_is_not_chosen_over_one_that_was():
    choice, _ = choose([candidate(1.2, 0.2, scatter_pct=1.0), candidate(1.8, 0.6)])
    assert choice.v_max == 1.2


def test_r0_cannot_be_chosen_without_casts_that_keep_the_wrist():
    with pytest.raises(InputError, match="without psi"):
        choose([candidate(1.5, 0.5, with_psi=True)])
