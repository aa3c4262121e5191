import dataclasses

import numpy as np
import pytest
from synthetic_casts import CABLE, dataset_of, random_actions, smooth_dataset, smooth_map

from cablecast.errors import InputError
from cablecast.learning.gaussian_process import (
    GaussianProcessConfig,
    fit_kernel,
    train_gaussian_process,
)
from cablecast.learning.kernel import matern

pytest.importorskip("torch")
pytestmark = pytest.mark.usefixtures("one_core")

COUNT = 600
SMALL = GaussianProcessConfig(likelihood_count=200, inducing_count=540)

# A smooth map of four variables over 540 casts is interpolated to 0.15 to 0.3 % of the cable's
# length, depending on the casts.
LEARNED_PCT = 0.6

# Single precision rounds otherwise in another batch of actions: by micrometres.
BATCH_PCT = 2e-3


@pytest.fixture(scope="module")
def dataset():
    return smooth_dataset(COUNT)


@pytest.fixture(scope="module")
def model(dataset):
    return train_gaussian_process(dataset, config=SMALL)


def test_the_process_learns_a_smooth_map(model):
    actions = random_actions(300, seed=9)
    error = np.linalg.norm(model.predict(actions) - smooth_map(actions), axis=1)
    assert np.median(error) / CABLE.length * 100 < LEARNED_PCT
    assert model.metrics["held_out_median_pct"] < LEARNED_PCT


def test_kernel_and_noise_are_those_that_the_casts_were_drawn_from():
    generator = np.random.default_rng(0)
    length_scales, amplitude, noise = np.array([0.8, 1.6, 5.0]), 0.7, 0.1
    x = generator.normal(size=(300, 3))
    covariance = amplitude**2 * matern(x / length_scales, x / length_scales)
    factor = np.linalg.cholesky(covariance + noise**2 * np.eye(300))
    fitted = fit_kernel(x, factor @ generator.normal(size=(300, 2)), 50)
    # 600 values tell the noise to 5 % or so; amplitude and length scales are known together only,
    # so it is their ratio, the slope of the process, that is compared.
    assert fitted.noise == pytest.approx(noise, rel=0.15)
    slope = fitted.amplitude / fitted.length_scales
    np.testing.assert_allclose(slope, amplitude / length_scales, rtol=0.25)
    assert 0.5 < fitted.amplitude / amplitude < 2.0


def test_the_noise_of_the_casts_is_not_interpolated():
    actions = random_actions(COUNT, seed=1)
    noise = 0.05
    scatter = np.random.default_rng(2).normal(scale=noise, size=(COUNT, 2))
    trained = train_gaussian_process(
        dataset_of(actions, smooth_map(actions) + scatter), config=SMALL
    )
    # From four other draws: 0.95 to 1.05 times the noise.
    assert trained.info["kernel"]["noise_m"] == pytest.approx(noise, rel=0.15)
    fresh = random_actions(300, seed=9)
    error = np.linalg.norm(trained.predict(fresh) - smooth_map(fresh), axis=1)
    # From the same draws: 0.3 to 0.5 times the noise, and 0.85 to 1.0 for an interpolation.
    assert np.median(error) < 0.65 * noise


def test_held_out_casts_are_measured_and_not_learned_from(dataset, model):
    # All training rows are inducing ones.
    points = model.normalize(dataset.actions).astype(float) / model.length_scales
    kept = (points[:, None] == model.inputs[None]).all(axis=2).any(axis=1)
    assert kept.sum() == model.metrics["training_count"] == 540
    held_out = ~kept
    error = np.linalg.norm(
        model.predict(dataset.actions[held_out]) - dataset.endpoint_xy[held_out], axis=1
    )
    pct = error / CABLE.length * 100
    assert model.metrics["held_out_count"] == 60
    assert model.metrics["held_out_median_pct"] == pytest.approx(np.median(pct), abs=BATCH_PCT)
    assert model.metrics["held_out_p90_pct"] == pytest.approx(np.percentile(pct, 90), abs=BATCH_PCT)
    elsewhere = dataset.endpoint_xy + np.where(held_out, 0.5, 0.0)[:, None]
    again = train_gaussian_process(
        dataclasses.replace(dataset, endpoint_xy=elsewhere), config=SMALL
    )
    assert again.fingerprint == model.fingerprint
    assert again.metrics["held_out_median_pct"] > 10 * model.metrics["held_out_median_pct"]


def test_an_action_set_without_psi_can_be_learned():
    actions = random_actions(200, seed=3)
    actions[:, 3] = actions[:, 1]
    trained = train_gaussian_process(dataset_of(actions, smooth_map(actions)), config=SMALL)
    fresh = random_actions(100, seed=4)
    fresh[:, 3] = fresh[:, 1]
    error = np.linalg.norm(trained.predict(fresh) - smooth_map(fresh), axis=1)
    # Three variables: 180 casts are as dense as thousands in four.
    assert np.median(error) / CABLE.length * 100 < LEARNED_PCT


def test_too_few_casts_are_refused():
    with pytest.raises(InputError, match="49 of 49 rows have a known endpoint: training needs 50"):
        train_gaussian_process(smooth_dataset(count=49))


@pytest.mark.parametrize("name", ["likelihood_count", "inducing_count", "held_out_fraction"])
def test_options_out_of_bounds_are_refused(name):
    with pytest.raises(InputError, match=f"{name} = -1 is outside"):
        GaussianProcessConfig(**{name: -1})
