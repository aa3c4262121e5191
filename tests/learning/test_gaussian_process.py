import dataclasses

import numpy as np
import pytest
from synthetic_casts import random_actions

from cablecast.learning.gaussian_process import GaussianProcessModel
from cablecast.learning.landing import DEVIATION, action_features

# Features are normalised in single precision, for landings of the order of a metre.
SINGLE_PRECISION = 2e-5


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
        inputs=(features - mean) / scale / length_scales,
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
