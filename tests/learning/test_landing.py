import dataclasses

import numpy as np
import pytest
from tests.learning.synthetic_casts import (
    CABLE,
    dataset_of,
    network,
    random_actions,
    smooth_dataset,
)

from cablecast.errors import InputError
from cablecast.learning.landing import (
    DEVIATION,
    FEATURE_COUNT,
    LEFT_TABLE_MARGIN,
    MARGIN_NEIGHBORS,
    MIN_ROWS,
    action_features,
    deviations,
    error_metrics,
    known_endpoint_rows,
    known_margins,
    normalization,
)
from cablecast.motion.action import ACTION_SIZE, action_rows
from cablecast.workspace import Workspace

EXACT = 1e-12  # Sums of a few doubles of order 1.


def test_the_last_features_are_the_turn_of_the_wrist_and_the_logarithm_of_the_pace():
    actions = np.array([[-0.5, 0.3, 0.6, 1.1, 1.0], [-0.2, 0.9, 0.5, 0.4, 0.3]])
    features = action_features(actions)
    np.testing.assert_allclose(features[:, :3], actions[:, :3], atol=EXACT)
    np.testing.assert_allclose(features[:, 3], [0.8, -0.5], atol=EXACT)
    np.testing.assert_allclose(features[:, 4], np.log([1.0, 0.3]), atol=EXACT)
    assert actions[0, 3] == 1.1


@pytest.mark.parametrize("shape", [(5,), (2, 3), (2, 6), (2, 5, 1)])
def test_actions_of_another_shape_are_refused(shape):
    with pytest.raises(InputError, match=r"must be \[action, 4 or 5\]"):
        action_features(np.ones(shape))


def test_each_variable_of_an_action_deviates_by_itself():
    actions = np.array([[-0.5, 0.3, 0.6, 1.1, 1.0], [-0.2, 0.9, 0.5, 0.4, 0.3]])
    np.testing.assert_array_equal(deviations(actions), np.diag(DEVIATION))
    np.testing.assert_allclose(DEVIATION, [np.pi / 180, np.pi / 180, 0.01, np.pi / 180, 0.01])


def test_the_pace_of_a_set_of_one_pace_does_not_deviate():
    actions = action_rows([[-0.5, 0.3, 0.6, 1.1], [-0.2, 0.9, 0.5, 1.1]])
    np.testing.assert_array_equal(deviations(actions), np.diag(DEVIATION)[:4])


def test_without_psi_the_wrist_deviates_along_with_the_arm():
    actions = action_rows([[-0.5, 0.3, 0.6, 0.3], [-0.2, 0.9, 0.5, 0.9]])
    changes = deviations(actions)
    assert changes.shape == (3, ACTION_SIZE)
    np.testing.assert_allclose(action_features(actions + changes[1])[:, 3], 0.0, atol=EXACT)


def test_normalised_features_have_mean_zero_and_deviation_one():
    generator = np.random.default_rng(0)
    actions, endpoints = generator.normal(size=(200, 5)), generator.normal(size=(200, 2))
    actions[:, 4] = np.exp(actions[:, 4])
    endpoints *= [0.2, 0.4]
    scales = normalization(actions, endpoints)
    normal = (action_features(actions) - scales["feature_mean"]) / scales["feature_scale"]
    np.testing.assert_allclose(normal.mean(axis=0), 0.0, atol=EXACT)
    np.testing.assert_allclose(normal.std(axis=0), 1.0, atol=EXACT)
    np.testing.assert_allclose(scales["endpoint_mean"], endpoints.mean(axis=0), atol=EXACT)
    # One scale for both axes, so that a normalised distance is a distance.
    assert scales["endpoint_scale"] == pytest.approx(np.mean(endpoints.std(axis=0)))


def test_a_feature_that_never_varies_is_not_divided_by_zero():
    actions = np.tile([-0.5, 0.3, 0.6, 0.3], (10, 1))
    scales = normalization(actions, np.ones((10, 2)))
    np.testing.assert_array_equal(scales["feature_scale"], 1.0)
    assert scales["endpoint_scale"] > 0


def test_only_rows_with_a_finite_endpoint_are_learned_from():
    dataset = smooth_dataset(count=MIN_ROWS + 2)
    dataset = dataclasses.replace(dataset, status=np.full(MIN_ROWS + 2, "ok"))
    endpoints = dataset.rest_xy.copy()
    endpoints[3, 1] = np.nan
    rows = known_endpoint_rows(dataclasses.replace(dataset, rest_xy=endpoints))
    np.testing.assert_array_equal(rows, np.delete(np.arange(MIN_ROWS + 2), 3))
    endpoints[5:7] = np.nan
    with pytest.raises(InputError, match=f"49 of 52 rows .* training needs {MIN_ROWS}"):
        known_endpoint_rows(dataclasses.replace(dataset, rest_xy=endpoints))


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


# Differences of single-precision predictions of the order of a metre.
SINGLE_PRECISION = 1e-6


def test_the_landing_of_a_linear_model_shifts_by_its_slope():
    model = network([FEATURE_COUNT, 2])
    (matrix, _) = model.weights[0]
    slope = model.endpoint_scale * (matrix / model.feature_scale[:, None]).T.astype(float)
    # The last feature is psi - theta2.
    by_variable = slope.copy()
    by_variable[:, 1] -= slope[:, 3]
    changes = np.diag(DEVIATION)
    shifts = model.landing_shifts(random_actions(30, seed=0), changes)
    expected = np.broadcast_to(by_variable @ changes.T, shifts.shape)
    np.testing.assert_allclose(shifts, expected, atol=SINGLE_PRECISION)
    sensitivity = model.sensitivity(random_actions(30, seed=0), changes)
    np.testing.assert_allclose(
        sensitivity, np.sqrt(np.sum((by_variable @ changes.T) ** 2)), atol=SINGLE_PRECISION
    )


def test_a_margin_is_the_mean_of_its_neighbours_weighted_by_inverse_distance():
    dataset = smooth_dataset(count=300)
    model = network([FEATURE_COUNT, 2]).with_margins(dataset)
    rows, margins = known_margins(dataset)
    actions = random_actions(20, seed=4)
    features = model.normalize(dataset.actions[rows]).astype(float)
    for action, margin in zip(actions, model.predict_margin(actions), strict=True):
        distance = np.linalg.norm(features - model.normalize(action[None]), axis=1)
        nearest = np.argsort(distance)[:MARGIN_NEIGHBORS]
        weight = 1 / distance[nearest]
        # Margins and features are kept in single precision.
        expected = np.sum(weight * margins[nearest]) / np.sum(weight)
        assert margin == pytest.approx(expected, abs=1e-5)


def test_few_margins_are_all_neighbours():
    few = smooth_dataset(count=5)
    model = network([FEATURE_COUNT, 2]).with_margins(few)
    margin = model.predict_margin(few.actions)
    np.testing.assert_allclose(margin, known_margins(few)[1], atol=1e-5)


def test_a_model_is_named_by_all_its_arrays():
    model = network([4, 8, 2])
    assert dataclasses.replace(model, info={"seed": 3}).fingerprint == model.fingerprint
    moved = dataclasses.replace(model, endpoint_mean=model.endpoint_mean + 1e-9)
    assert moved.fingerprint != model.fingerprint
