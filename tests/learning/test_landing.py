import dataclasses

import numpy as np
import pytest
from synthetic_casts import network, random_actions, smooth_dataset

from cablecast.learning.landing import DEVIATION, MARGIN_NEIGHBORS, known_margins

# Differences of single-precision predictions of the order of a metre.
SINGLE_PRECISION = 1e-6
EXACT = 1e-12  # Sums of a few doubles of order 1.


def test_the_landing_of_a_linear_model_shifts_by_its_slope():
    model = network([4, 2])
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


def test_normalised_endpoints_are_turned_back_by_mean_and_scale():
    model, endpoints = network([4, 2]), np.array([[0.6, 0.7], [0.9, 0.1]])
    np.testing.assert_allclose(
        model.normalize_endpoints(endpoints), [[0.0, 0.0], [1.0, -2.0]], atol=EXACT
    )


def test_a_margin_is_the_mean_of_its_neighbours_weighted_by_inverse_distance():
    dataset = smooth_dataset(count=300)
    model = network([4, 2]).with_margins(dataset)
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
    model = network([4, 2]).with_margins(few)
    margin = model.predict_margin(few.actions)
    np.testing.assert_allclose(margin, known_margins(few)[1], atol=1e-5)


def test_a_model_is_named_by_all_its_arrays():
    model = network([4, 8, 2])
    assert dataclasses.replace(model, info={"seed": 3}).fingerprint == model.fingerprint
    moved = dataclasses.replace(model, endpoint_mean=model.endpoint_mean + 1e-9)
    assert moved.fingerprint != model.fingerprint
