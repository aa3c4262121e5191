import numpy as np
import pytest
import scipy.special
import scipy.stats

from cablecast.errors import InputError
from cablecast.learning.gaussian_process import (
    fit_kernel,
    negative_log_likelihood,
    sparse_posterior,
)
from cablecast.learning.kernel import matern

torch = pytest.importorskip("torch")
pytestmark = pytest.mark.usefixtures("one_core")

# Squared distances come from products, which lose half the digits of a double near zero distance.
DOUBLE = 1e-7
# The same in single precision.
SINGLE = 1e-3
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


def test_the_kernel_has_its_known_values_along_a_line():
    line = np.array([[0.0], [1.0], [2.0]])
    # (1 + sqrt 3) exp(-sqrt 3) and (1 + 2 sqrt 3) exp(-2 sqrt 3).
    np.testing.assert_allclose(matern(line[:1], line)[0], [1.0, 0.4833577, 0.1397314], atol=1e-7)


def test_single_precision_is_kept_and_suffices():
    first, second = (points(20, seed=seed).astype(np.float32) for seed in (0, 1))
    expected = general_matern(distances(first.astype(float), second.astype(float)))
    kernel = matern(first, second)
    assert kernel.dtype == np.float32
    np.testing.assert_allclose(kernel, expected, atol=SINGLE)


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
