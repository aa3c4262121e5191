import numpy as np
import pytest

from cablecast.errors import InputError
from cablecast.learning.landing import DEVIATION, action_features, deviations, normalization

EXACT = 1e-12  # Sums of a few doubles of order 1.


def test_the_last_feature_is_the_turn_of_the_wrist_against_the_arm():
    actions = np.array([[-0.5, 0.3, 0.6, 1.1], [-0.2, 0.9, 0.5, 0.4]])
    features = action_features(actions)
    np.testing.assert_allclose(features[:, :3], actions[:, :3], atol=EXACT)
    np.testing.assert_allclose(features[:, 3], [0.8, -0.5], atol=EXACT)
    assert actions[0, 3] == 1.1


@pytest.mark.parametrize("shape", [(4,), (2, 3), (2, 4, 1)])
def test_actions_of_another_shape_are_refused(shape):
    with pytest.raises(InputError, match=r"must be \[action, 4\]"):
        action_features(np.ones(shape))


def test_each_variable_of_an_action_deviates_by_itself():
    actions = np.array([[-0.5, 0.3, 0.6, 1.1], [-0.2, 0.9, 0.5, 0.4]])
    np.testing.assert_array_equal(deviations(actions), np.diag(DEVIATION))
    np.testing.assert_allclose(DEVIATION, [np.pi / 180, np.pi / 180, 0.01, np.pi / 180])


def test_without_psi_the_wrist_deviates_along_with_the_arm():
    actions = np.array([[-0.5, 0.3, 0.6, 0.3], [-0.2, 0.9, 0.5, 0.9]])
    changes = deviations(actions)
    assert changes.shape == (3, 4)
    np.testing.assert_allclose(action_features(actions + changes[1])[:, 3], 0.0, atol=EXACT)


def test_normalised_features_have_mean_zero_and_deviation_one():
    generator = np.random.default_rng(0)
    actions, endpoints = generator.normal(size=(200, 4)), generator.normal(size=(200, 2))
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
