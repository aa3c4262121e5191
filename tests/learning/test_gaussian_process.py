import dataclasses

import numpy as np
import pytest
from synthetic_casts import random_actions

from cablecast.learning.gaussian_process import GaussianProcessModel
from cablecast.learning.landing import DEVIATION, LandingModel, action_features, deviations

# Predictions are computed in single precision, for landings of the order of a metre.
SINGLE_PRECISION = 2e-5
# Shifts for 1 degree are of the order of 1 cm. Central differences of single-precision predictions
# are off by their rounding, and for a Matern kernel by its third derivative.
SHIFT_ERROR = 5e-5


@pytest.fixture(scope="module")
def model():
    generator = np.random.default_rng(0)
    features = action_features(random_actions(50, seed=1))
    length_scales = np.array([1.5, 2.0, 4.0, 3.0])
    mean, scale = features.mean(axis=0), features.std(axis=0)
    return GaussianProcessModel(
        feature_mean=mean,
        feature_scale=scale,
        endpoint_mean=np.array([0.6, 0.7]),
        endpoint_scale=0.3,
        margin_features=generator.normal(size=(20, 4)).astype(np.float32),
        margins=generator.normal(size=20).astype(np.float32),
        inputs=((features - mean) / scale / length_scales).astype(np.float32),
        length_scales=length_scales,
        coefficients=generator.normal(size=(50, 2)),
    )


def dense_prediction(model, actions):
    """Return the sum over casts, pair by pair and in double precision."""
    points = (action_features(actions) - model.feature_mean) / model.feature_scale
    u = np.sqrt(3) * np.linalg.norm(points[:, None] / model.length_scales - model.inputs, axis=2)
    outputs = ((1 + u) * np.exp(-u)) @ model.coefficients
    return model.endpoint_mean + model.endpoint_scale * outputs


def test_a_prediction_is_the_weighted_sum_of_kernels(model):
    # More actions than fit into one block.
    actions = random_actions(2300, seed=2)
    expected = dense_prediction(model, actions)
    np.testing.assert_allclose(model.predict(actions), expected, atol=SINGLE_PRECISION)


def test_shifts_are_the_differences_of_predictions(model):
    actions = random_actions(1200, seed=3)
    changes = np.diag(DEVIATION)
    shifts = model.landing_shifts(actions, changes)
    assert shifts.shape == (1200, 2, 4)
    # In double precision, with steps that are small against the kernel's curvature.
    step = 1e-4
    expected = [
        (dense_prediction(model, actions + step * c) - dense_prediction(model, actions - step * c))
        / (2 * step)
        for c in changes
    ]
    np.testing.assert_allclose(shifts, np.stack(expected, axis=2), atol=SHIFT_ERROR)
    by_differences = LandingModel.landing_shifts(model, actions, changes)
    np.testing.assert_allclose(shifts, by_differences, atol=SHIFT_ERROR)


def test_a_process_with_long_length_scales_loses_no_digits(model):
    """The kernel is near 1 everywhere, and weights of 1e4 cancel to landings of a metre."""
    generator = np.random.default_rng(7)
    stretched = dataclasses.replace(
        model,
        length_scales=20 * model.length_scales,
        inputs=model.inputs / 20,
        coefficients=1e4 * generator.normal(size=(50, 2)),
    )
    actions, changes, step = random_actions(200, seed=8), np.diag(DEVIATION), 1e-3
    expected = dense_prediction(stretched, actions)
    # Entries rounded to 6e-8 of 1 alone, times 50 weights of 1e4 with random signs and 0.3 m.
    rounding = 6e-8 * 1e4 * np.sqrt(50) * 0.3
    np.testing.assert_allclose(stretched.predict(actions), expected, atol=5 * rounding)
    differences = [
        dense_prediction(stretched, actions + step * c)
        - dense_prediction(stretched, actions - step * c)
        for c in changes
    ]
    slopes = np.stack(differences, axis=2) / (2 * step)
    # The casts' own coordinates are single precision: 6e-8 of shifts of up to 10 m.
    np.testing.assert_allclose(
        stretched.landing_shifts(actions, changes), slopes, atol=2.5 * 6e-8 * np.abs(slopes).max()
    )


def test_without_psi_a_turn_of_the_arm_leaves_the_wrist_as_it_is(model):
    actions = random_actions(30, seed=4)
    actions[:, 3] = actions[:, 1]
    changes = deviations(actions)
    shifts = model.landing_shifts(actions, changes)
    assert shifts.shape == (30, 2, 3)
    np.testing.assert_allclose(
        shifts, LandingModel.landing_shifts(model, actions, changes), atol=SHIFT_ERROR
    )


def test_the_sensitivity_is_the_root_of_the_summed_squares_of_all_shifts(model):
    actions, changes = random_actions(10, seed=5), np.diag(DEVIATION)
    shifts = model.landing_shifts(actions, changes)
    expected = [np.sqrt(sum(value**2 for value in shift.ravel())) for shift in shifts]
    np.testing.assert_allclose(model.sensitivity(actions, changes), expected)


def test_a_saved_process_predicts_the_same(model, tmp_path):
    pytest.importorskip("safetensors")
    described = dataclasses.replace(model, info={"metrics": {"held_out_median_pct": 0.4}})
    described.save(tmp_path)
    loaded = GaussianProcessModel.load(tmp_path)
    actions = random_actions(100, seed=6)
    np.testing.assert_array_equal(loaded.predict(actions), model.predict(actions))
    assert loaded.info == described.info
