import numpy as np
import pytest
import scipy.special
import scipy.stats

from cablecast.errors import InputError
from cablecast.learning.kernel import (
    matern,
    matern_torch,
    minimize,
    negative_log_likelihood,
    scaled_distances,
    weighted_sums,
)

torch = pytest.importorskip("torch")
pytestmark = pytest.mark.usefixtures("one_core")

# Squared distances come from products, which lose half the digits of a double near zero distance.
DOUBLE = 1e-7
# The same in single precision.
SINGLE = 1e-3
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
    np.testing.assert_allclose(
        scaled_distances(first, second), np.sqrt(3) * distances(first, second), atol=DOUBLE
    )


def test_the_kernel_has_its_known_values_along_a_line():
    line = np.array([[0.0], [1.0], [2.0]])
    # (1 + sqrt 3) exp(-sqrt 3) and (1 + 2 sqrt 3) exp(-2 sqrt 3).
    np.testing.assert_allclose(matern(line[:1], line)[0], [1.0, 0.4833577, 0.1397314], atol=1e-7)


def test_the_kernel_in_torch_is_the_same():
    first, second = points(20, seed=0), points(30, seed=1)
    second[:5] = first[:5]
    double = matern_torch(torch.tensor(first), torch.tensor(second)).numpy()
    np.testing.assert_allclose(double, general_matern(distances(first, second)), atol=DOUBLE)


def test_single_precision_is_kept_and_suffices():
    first, second = (points(20, seed=seed).astype(np.float32) for seed in (0, 1))
    expected = general_matern(distances(first.astype(float), second.astype(float)))
    for kernel in (
        matern(first, second),
        matern_torch(torch.tensor(first), torch.tensor(second)).numpy(),
    ):
        assert kernel.dtype == np.float32
        np.testing.assert_allclose(kernel, expected, atol=SINGLE)


def test_large_weights_of_both_signs_cancel_as_in_double_precision():
    generator = np.random.default_rng(8)
    kernel = (1 - 0.01 * generator.uniform(size=(50, 3000))).astype(np.float32)
    weights = 1e4 * generator.normal(size=(3000, 2))
    exact = kernel.astype(float) @ weights
    # The rest of 0.01 in single precision, on a sum of 3000 terms of 1e4 with random signs.
    rounding = 0.01 * 6e-8 * 1e4 * 3000
    np.testing.assert_allclose(weighted_sums(kernel.copy(), weights), exact, atol=rounding)
    # Weights that single precision can hold: the whole in it is off by far more.
    assert np.max(np.abs(kernel @ weights.astype(np.float32) - exact)) > 2 * rounding


def test_the_likelihood_is_that_of_a_normal_distribution():
    x, generator = points(20, seed=2), np.random.default_rng(3)
    outputs, log_sizes, ratio = generator.normal(size=(20, 2)), generator.normal(size=20), 0.3
    sizes = np.exp(log_sizes)
    covariance = general_matern(distances(x, x)) + ratio**2 * np.eye(20)
    covariance *= sizes[:, None] * sizes
    normal = scipy.stats.multivariate_normal(mean=np.zeros(20), cov=covariance)
    expected = -sum(normal.logpdf(column) for column in outputs.T)
    value = negative_log_likelihood(
        torch.tensor(x), torch.tensor(outputs), torch.tensor(log_sizes), torch.tensor(ratio)
    )
    constant = outputs.size / 2 * np.log(2 * np.pi)
    # The kernel holds the diagonal a little off zero distance.
    assert float(value) + constant == pytest.approx(expected, rel=1e-6, abs=LIKELIHOOD)


def test_the_slope_of_the_likelihood_is_finite_where_casts_coincide():
    x = torch.tensor(np.repeat(points(5, seed=4), 2, axis=0), requires_grad=True)
    outputs = torch.tensor(points(10, seed=5, dimension=2))
    negative_log_likelihood(x, outputs, torch.zeros(10).double(), torch.tensor(0.1)).backward()
    assert x.grad is not None
    assert bool(torch.isfinite(x.grad).all())


def test_minimising_finds_the_least_value_of_a_curved_valley():
    def rosenbrock(unknowns):
        a, b = unknowns
        return (1 - a) ** 2 + 100 * (b - a**2) ** 2

    # L-BFGS stops at a slope of 1e-7, which is this far from the minimum in a valley this flat.
    np.testing.assert_allclose(minimize(rosenbrock, np.array([-1.2, 1.0]), 200), 1.0, atol=1e-4)


@pytest.mark.parametrize("huge", [1e200, np.nan])
def test_a_fit_that_is_not_finite_is_reported(huge):
    x, outputs = torch.tensor(points(10, seed=6)), torch.tensor(points(10, seed=7, dimension=2))

    def loss(unknowns):
        sizes = unknowns[0].expand(10)
        return negative_log_likelihood(x * torch.exp(unknowns[1]), outputs * huge, sizes, 0.1)

    with pytest.raises(InputError, match="no finite fit"):
        minimize(loss, np.zeros(2), 20)
