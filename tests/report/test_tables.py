import math

import pytest

from cablecast.evaluation.evaluate import summarise_errors
from cablecast.report.tables import five_cells, flatten_settings, pct, share_pct


@pytest.mark.parametrize(
    ("value", "text"), [(12.34, "12.3"), (None, "–"), (math.nan, "–"), (math.inf, "miss")]
)
def test_a_percentage_may_be_missing_or_a_miss(value, text):
    assert pct(value) == text


def test_the_five_numbers_of_a_summary_tell_a_miss_from_a_missing_value():
    assert five_cells(summarise_errors([1.0, 2.0, 3.0]).to_dict()) == (
        *("2.0", "1.5", "2.5", "1.0", "3.0"),
    )
    # Of four casts two are misses of unknown size: median, third quartile and largest are misses.
    missed = summarise_errors([1.0, 3.0, math.inf, math.inf]).to_dict()
    assert five_cells(missed) == ("miss", "2.5", "miss", "1.0", "miss")
    assert five_cells(summarise_errors([]).to_dict()) == ("–",) * 5


def test_nested_settings_become_lines_with_dotted_names():
    settings = {"arm": {"model": "ur5", "gripper_length": 0.17}, "targets": [[0.5, 1.0]], "seed": 0}
    assert flatten_settings(settings) == [
        ("arm.model", "ur5"),
        ("arm.gripper_length", "0.17"),
        ("targets", "[0.5, 1.0]"),
        ("seed", "0"),
    ]


def test_a_part_of_a_whole_is_told_in_percent_with_its_sign():
    assert (share_pct(0.129), share_pct(0.0)) == ("12.9 %", "0.0 %")
    assert (share_pct(None), share_pct(math.nan)) == ("–", "–")
