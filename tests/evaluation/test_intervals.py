"""Bootstrap intervals of medians."""

import numpy as np
import pytest

from cablecast.evaluation.evaluate import (
    difference_interval,
    median_interval,
    share_of_smaller_median,
)


def test_the_interval_holds_the_true_median_about_nine_times_in_ten():
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(100):
        values = rng.exponential(size=40)
        _, low, high = median_interval(values)
        held += low <= np.log(2.0) <= high
    # 90 % of 100, give or take three binomial deviations and what a bootstrap is off.
    assert 78 <= held <= 99
    assert median_interval(values)[1:] == (low, high)


def test_equal_values_leave_no_doubt():
    assert median_interval([3.0] * 7) == (3.0, 3.0, 3.0)
    assert difference_interval([3.0] * 7, [2.5] * 7) == (0.5, 0.5, 0.5)


def test_a_difference_in_the_same_cases_is_surer_than_in_others():
    rng = np.random.default_rng(2)
    hard = rng.exponential(size=100)
    middle, low, high = difference_interval(hard + 0.1, hard)
    assert (middle, low, high) == (pytest.approx(0.1), pytest.approx(0.1), pytest.approx(0.1))
    _, low, high = difference_interval(hard + 0.1, rng.permutation(hard))
    assert high - low > 0.1


def test_an_order_of_methods_is_told_from_chance_by_drawing_the_targets_anew():
    errors = np.random.default_rng(0).uniform(0.0, 20.0, size=(32, 5))
    errors[3, 1:] = np.nan
    assert share_of_smaller_median(errors, errors + 5.0) == 1.0
    assert share_of_smaller_median(errors + 5.0, errors) == 0.0
    # A method that is better at every second target is better by chance.
    other = errors[np.arange(32)[::-1]]
    assert 0.2 < share_of_smaller_median(errors, other) < 0.8


@pytest.mark.filterwarnings("error")
def test_a_draw_without_a_landing_counts_for_neither_method():
    errors = np.array([[1.0], [np.nan]])
    assert share_of_smaller_median(errors, errors + 5.0) == pytest.approx(0.75, abs=0.05)
