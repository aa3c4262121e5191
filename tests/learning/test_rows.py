import dataclasses

import numpy as np
import pytest
from synthetic_casts import CABLE, dataset_of, random_actions, smooth_dataset

from cablecast.errors import InputError
from cablecast.learning.landing import (
    LEFT_TABLE_MARGIN,
    MIN_ROWS,
    error_metrics,
    known_endpoint_rows,
    known_margins,
)
from cablecast.workspace import Workspace

EXACT = 1e-12  # Sums of a few doubles of order 1.


def test_only_rows_with_a_finite_endpoint_are_learned_from():
    dataset = smooth_dataset(count=MIN_ROWS + 2)
    endpoints = dataset.endpoint_xy.copy()
    endpoints[3, 1] = np.nan
    rows = known_endpoint_rows(dataclasses.replace(dataset, endpoint_xy=endpoints))
    np.testing.assert_array_equal(rows, np.delete(np.arange(MIN_ROWS + 2), 3))
    endpoints[5:7] = np.nan
    with pytest.raises(InputError, match=f"49 of 52 rows .* training needs {MIN_ROWS}"):
        known_endpoint_rows(dataclasses.replace(dataset, endpoint_xy=endpoints))


def test_the_margin_is_the_least_distance_from_an_edge_and_unseen_exits_are_negative():
    workspace = Workspace()
    width, depth = workspace.table_width, workspace.table_depth
    # x_min, x_max, y_min, y_max on the way: near the right edge, beyond the far edge, seen only
    # within the table though it left it, and never seen.
    extent = np.array(
        [
            [0.0, width / 2 - 0.03, 0.5, 0.9],
            [0.0, 0.1, 0.5, depth + 0.2],
            [0.0, 0.1, 0.5, 0.9],
            [np.nan, np.nan, np.nan, np.nan],
        ]
    )
    dataset = dataclasses.replace(
        dataset_of(random_actions(4, seed=0), np.full((4, 2), 0.5)),
        extent=extent,
        status=np.array(["ok", "off_table", "off_table", "occluded"]),
    )
    rows, margins = known_margins(dataset)
    np.testing.assert_array_equal(rows, [0, 1, 2])
    np.testing.assert_allclose(margins, [0.03, -0.2, LEFT_TABLE_MARGIN], atol=EXACT)


def test_errors_are_distances_in_percent_of_the_cable():
    endpoints = np.zeros((4, 2))
    predicted = np.array([[0.3, 0.4], [0.0, 0.1], [0.0, -0.2], [0.3, 0.0]])
    metrics = error_metrics("held_out", predicted, endpoints, CABLE.length)
    pct = 100 / CABLE.length
    assert metrics["held_out_median_pct"] == pytest.approx(0.25 * pct)
    assert metrics["held_out_mean_pct"] == pytest.approx(0.275 * pct)
    # Linear between the third and the fourth of the sorted errors, 0.3 m and 0.5 m.
    assert metrics["held_out_p90_pct"] == pytest.approx((0.3 + 0.7 * 0.2) * pct)
