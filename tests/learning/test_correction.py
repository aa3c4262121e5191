import numpy as np
import pytest

from cablecast.learning.network import LandingCorrection

# Dense solutions of 25 casts in double precision; the kernel's products cost half the digits.
DENSE = 1e-6

CASTS, PLACES, SIZES = 25, 6, 5


def correction(noise=0.01, amplitude=0.08, seed=0):
    generator = np.random.default_rng(seed)
    return LandingCorrection(
        changes=np.diag([0.02, 0.02, 0.01, 0.02]),
        inputs=generator.normal(size=(CASTS, PLACES)),
        length_scales=generator.uniform(1.0, 3.0, PLACES),
        size_weights=np.array([0.3, -0.2, 0.1, 0.0, 0.5]),
        amplitude=amplitude,
        noise=noise,
        residuals=generator.normal(scale=0.08, size=(CASTS, 2)),
    )


def new_actions(count=40, seed=1):
    generator = np.random.default_rng(seed)
    return generator.normal(size=(count, PLACES)), generator.normal(size=(count, SIZES))


def covariance(correction, first, second):
    """Amplitude squared times Matern 3/2, entry by entry."""
    result = np.empty((len(first), len(second)))
    for i, a in enumerate(first):
        for j, b in enumerate(second):
            u = np.sqrt(3 * np.sum(((a - b) / correction.length_scales) ** 2))
            result[i, j] = correction.amplitude**2 * (1 + u) * np.exp(-u)
    return result


def test_shift_and_spread_are_those_of_the_dense_gaussian_process():
    fitted = correction()
    places, sizes = new_actions()
    size = np.exp(sizes @ fitted.size_weights)
    among = covariance(fitted, fitted.inputs, fitted.inputs) + fitted.noise**2 * np.eye(CASTS)
    across = covariance(fitted, places, fitted.inputs)
    mean = across @ np.linalg.solve(among, fitted.residuals)
    np.testing.assert_allclose(fitted.shift(places, sizes), size[:, None] * mean, atol=DENSE)
    variance = fitted.amplitude**2 - np.diag(across @ np.linalg.solve(among, across.T))
    expected = size * np.sqrt(variance + fitted.noise**2)
    np.testing.assert_allclose(fitted.spread(places, sizes), expected, atol=DENSE)


def test_without_noise_the_shift_at_a_cast_is_its_residual():
    fitted = correction(noise=1e-6)
    sizes = np.random.default_rng(2).normal(size=(CASTS, SIZES))
    size = np.exp(sizes @ fitted.size_weights)[:, None]
    # Where a cast was made, a noise of 1e-6 m leaves no more than the kernel's own rounding.
    np.testing.assert_allclose(
        fitted.shift(fitted.inputs, sizes), size * fitted.residuals, atol=1e-4
    )
    assert np.all(fitted.spread(fitted.inputs, sizes) < 1e-4 * size[:, 0])


def test_far_from_all_casts_nothing_is_corrected_and_the_spread_is_greatest():
    fitted = correction()
    places, sizes = np.full((1, PLACES), 1e3), np.zeros((1, SIZES))
    np.testing.assert_allclose(fitted.shift(places, sizes), 0.0, atol=DENSE)
    greatest = np.hypot(fitted.amplitude, fitted.noise)
    assert fitted.spread(places, sizes)[0] == pytest.approx(greatest)
    near = fitted.spread(fitted.inputs, np.zeros((CASTS, SIZES)))
    assert np.all(near < greatest)
    assert np.all(near > fitted.noise)


def test_a_correction_is_rebuilt_from_its_arrays():
    fitted = correction()
    tensors = fitted.tensors() | {"layer0.matrix": np.ones((4, 2))}
    again = LandingCorrection.from_tensors(tensors)
    assert again is not None
    np.testing.assert_array_equal(again.shift(*new_actions()), fitted.shift(*new_actions()))
    np.testing.assert_array_equal(again.spread(*new_actions()), fitted.spread(*new_actions()))
    assert LandingCorrection.from_tensors({"layer0.matrix": np.ones((4, 2))}) is None
