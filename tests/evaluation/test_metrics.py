import json
import math

import numpy as np

from cablecast.evaluation.evaluate import summarise_errors

CLOSE = 1e-12  # Double precision; the values are of order 1 to 100.


def test_a_summary_interpolates_quartiles_as_numpy_does():
    errors = np.random.default_rng(0).exponential(20.0, 37)
    # Trials without a landing are left out.
    summary = summarise_errors([*errors, np.nan])
    expected = np.quantile(errors, [0.5, 0.25, 0.75, 0.0, 1.0])
    values = (
        summary.median_pct,
        summary.first_quartile_pct,
        summary.third_quartile_pct,
        summary.min_pct,
        summary.max_pct,
    )
    np.testing.assert_allclose(values, expected, rtol=CLOSE)
    assert summary.count == 37


def test_misses_of_unknown_size_raise_the_quantiles_without_spoiling_them():
    summary = summarise_errors([1.0, 2.0, 3.0, math.inf, math.inf])
    assert summary.median_pct == 3.0
    assert summary.first_quartile_pct == 2.0
    assert summary.third_quartile_pct == math.inf


def test_a_summary_of_nothing_is_valid_json_without_numbers():
    values = json.loads(json.dumps(summarise_errors([np.nan]).to_dict(), allow_nan=False))
    assert values.pop("count") == 0
    assert set(values.values()) == {None}
