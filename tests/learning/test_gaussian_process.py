import dataclasses

import numpy as np
import pytest
import scipy.special
import scipy.stats
from tests.learning.synthetic_casts import (
    CABLE,
    dataset_of,
    random_actions,
    smooth_dataset,
    smooth_map,
)

from cablecast.errors import InputError
from cablecast.learning.gaussian_process import (
    GaussianProcessConfig,
    GaussianProcessModel,
    fit_kernel,
    negative_log_likelihood,
    sparse_posterior,
    train_gaussian_process,
)
from cablecast.learning.kernel import matern
from cablecast.learning.landing import FEATURE_COUNT, action_features

torch = pytest.importorskip("torch")

pytestmark = pytest.mark.usefixtures("one_core")

# Squared distances come from products, which lose half the digits of a double near zero distance.
DOUBLE = 1e-7

# What the jitter of the inducing kernel matrix, 1e-6 of its diagonal, leaves over a noise of 0.04.
JITTERED = 1e-3

# Densities of 40 outputs, summed in another order.
LIKELIHOOD = 1e-9


def general_matern(distance, nu=1.5):
    """Return the Matern kernel of any smoothness, by its Bessel function."""
    u = np.sqrt(2 * nu) * np.where(distance == 0, 1.0, distance)
    value = 2 ** (1 - nu) / scipy.special.gamma(nu) * u**nu * scipy.special.kv(nu, u)
    return np.where(distance == 0, 1.0, value)


def points(count, seed, dimension=3):
    return np.random.default_rng(seed).normal(size=(count, dimension))


def distances(first, second):
    return np.linalg.norm(first[:, None] - second[None], axis=2)


def test_the_kernel_is_matern_three_halves():
    first, second = points(20, seed=0), points(30, seed=1)
    second[:5] = first[:5]
    expected = general_matern(distances(first, second))
    np.testing.assert_allclose(matern(first, second), expected, atol=DOUBLE)


def test_the_likelihood_is_that_of_a_normal_distribution():
    x, generator = points(20, seed=2), np.random.default_rng(3)
    outputs, log_amplitude, ratio = generator.normal(size=(20, 2)), 0.7, 0.3
    covariance = general_matern(distances(x, x)) + ratio**2 * np.eye(20)
    covariance *= np.exp(2 * log_amplitude)
    normal = scipy.stats.multivariate_normal(mean=np.zeros(20), cov=covariance)
    expected = -sum(normal.logpdf(column) for column in outputs.T)
    value = negative_log_likelihood(
        torch.tensor(x), torch.tensor(outputs), torch.tensor(log_amplitude), torch.tensor(ratio)
    )
    constant = outputs.size / 2 * np.log(2 * np.pi)
    # The kernel holds the diagonal a little off zero distance.
    assert float(value) + constant == pytest.approx(expected, rel=1e-6, abs=LIKELIHOOD)


def test_the_slope_of_the_likelihood_is_finite_where_casts_coincide():
    x = torch.tensor(np.repeat(points(5, seed=4), 2, axis=0), requires_grad=True)
    outputs = torch.tensor(points(10, seed=5, dimension=2))
    negative_log_likelihood(x, outputs, torch.tensor(0.0), torch.tensor(0.1)).backward()
    assert x.grad is not None
    assert bool(torch.isfinite(x.grad).all())


@pytest.mark.parametrize("huge", [1e200, np.nan])
def test_a_fit_that_is_not_finite_is_reported(huge):
    with np.errstate(all="ignore"), pytest.raises(InputError, match="no finite fit"):
        fit_kernel(points(60, seed=6), points(60, seed=7, dimension=2) * huge, 20)


def test_the_posterior_of_all_casts_is_the_exact_one():
    x, outputs = points(80, seed=8), points(80, seed=9, dimension=2)
    variance = 0.04
    exact = np.linalg.solve(matern(x, x) + variance * np.eye(80), outputs)
    new = points(40, seed=10)
    weights = sparse_posterior(x, x, outputs, variance)
    np.testing.assert_allclose(matern(new, x) @ weights, matern(new, x) @ exact, atol=JITTERED)


def test_more_inducing_casts_come_nearer_to_the_exact_posterior():
    x = np.random.default_rng(11).uniform(-1, 1, (400, 2))
    outputs = np.stack([np.sin(3 * x[:, 0]), x[:, 0] * x[:, 1]], axis=1)
    exact = np.linalg.solve(matern(x, x) + 1e-3 * np.eye(400), outputs)
    new = np.random.default_rng(12).uniform(-1, 1, (100, 2))
    errors = []
    for count in (10, 40, 160):
        weights = sparse_posterior(x[:count], x, outputs, 1e-3)
        error = matern(new, x[:count]) @ weights - matern(new, x) @ exact
        errors.append(np.sqrt(np.mean(error**2)))
    assert errors[2] < 0.3 * errors[1] < 0.1 * errors[0]


# Features are normalised in single precision, for landings of the order of a metre.
SINGLE_PRECISION = 2e-5


@pytest.fixture(scope="module")
def model():
    generator = np.random.default_rng(0)
    features = action_features(random_actions(50, seed=1))
    length_scales = np.array([1.5, 2.0, 4.0, 3.0, 1.0])
    mean, scale = features.mean(axis=0), features.std(axis=0)
    scale[4] = 1.0
    return GaussianProcessModel(
        feature_mean=mean,
        feature_scale=scale,
        endpoint_mean=np.array([0.6, 0.7]),
        endpoint_scale=0.3,
        margin_features=generator.normal(size=(20, FEATURE_COUNT)).astype(np.float32),
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
def fitted_model(dataset):
    return train_gaussian_process(dataset, config=SMALL)


def test_the_process_learns_a_smooth_map(fitted_model):
    actions = random_actions(300, seed=9)
    error = np.linalg.norm(fitted_model.predict(actions) - smooth_map(actions), axis=1)
    assert np.median(error) / CABLE.length * 100 < LEARNED_PCT
    assert fitted_model.metrics["held_out_median_pct"] < LEARNED_PCT


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


def test_held_out_casts_are_measured_and_not_learned_from(dataset, fitted_model):
    # All training rows are inducing ones.
    points = fitted_model.normalize(dataset.actions).astype(float) / fitted_model.length_scales
    kept = (points[:, None] == fitted_model.inputs[None]).all(axis=2).any(axis=1)
    assert kept.sum() == fitted_model.metrics["training_count"]
    held_out = ~kept & (dataset.status == "ok")
    error = np.linalg.norm(
        fitted_model.predict(dataset.actions[held_out]) - dataset.rest_xy[held_out], axis=1
    )
    pct = error / CABLE.length * 100
    assert fitted_model.metrics["held_out_count"] == held_out.sum()
    assert fitted_model.metrics["held_out_median_pct"] == pytest.approx(
        np.median(pct), abs=BATCH_PCT
    )
    assert fitted_model.metrics["held_out_p90_pct"] == pytest.approx(
        np.percentile(pct, 90), abs=BATCH_PCT
    )
    elsewhere = dataset.rest_xy + np.where(held_out, 0.5, 0.0)[:, None]
    again = train_gaussian_process(dataclasses.replace(dataset, rest_xy=elsewhere), config=SMALL)
    assert again.fingerprint == fitted_model.fingerprint
    assert again.metrics["held_out_median_pct"] > 10 * fitted_model.metrics["held_out_median_pct"]


@pytest.mark.parametrize("name", ["likelihood_count", "inducing_count", "held_out_fraction"])
def test_options_out_of_bounds_are_refused(name):
    with pytest.raises(InputError, match=f"{name} = -1 is outside"):
        GaussianProcessConfig(**{name: -1})
