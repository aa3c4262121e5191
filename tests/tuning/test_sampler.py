"""The sampler that fits are compared with draws what closed forms say."""

import numpy as np
from benchmarks.fits import sample

COUNT = 600
"""Particles: means are then known to 4 % of a deviation, deviations to 3 %, if they are
independent; three times as much is allowed, for resampled particles are not."""


def test_a_gaussian_likelihood_gives_the_product_of_two_gaussians():
    rng = np.random.default_rng(1)
    slopes = rng.normal(size=(3, 3)) / 0.05
    center = np.array([0.55, 0.45, 0.5])
    mean, deviation = np.full(3, 0.5), np.array([0.1, 0.06, 0.08])

    def log_likelihood(points):
        return -0.5 * np.sum(((points - center) @ slopes.T) ** 2, axis=1)

    points = sample(log_likelihood, mean, deviation, count=COUNT, moves=8)
    prior = np.diag(deviation**-2.0)
    covariance = np.linalg.inv(prior + slopes.T @ slopes)
    expected = covariance @ (prior @ mean + slopes.T @ slopes @ center)
    np.testing.assert_allclose(points.mean(axis=0), expected, atol=0.12 * 0.1)
    wide = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(points.std(axis=0), wide, rtol=0.12)


def test_two_peaks_keep_their_weights_and_nothing_leaves_the_cube():
    def log_likelihood(points):
        near = np.exp(-0.5 * ((points[:, 0] - 0.1) / 0.05) ** 2)
        far = 3.0 * np.exp(-0.5 * ((points[:, 0] - 0.9) / 0.05) ** 2)
        return np.log(near + far + 1e-300)

    points = sample(log_likelihood, np.full(2, 0.5), np.full(2, 0.5), count=COUNT, moves=5)
    assert np.all((points >= 0.0) & (points <= 1.0))
    # Both peaks are as far from the prior's mean: one of four particles belongs to the smaller.
    assert abs(np.mean(points[:, 0] < 0.5) - 0.25) < 0.08


def test_what_the_likelihood_does_not_tell_keeps_its_prior_in_ten_dimensions():
    """Two of ten coordinates are known, along a curve: the others must not lose their spread."""

    def log_likelihood(points):
        product = points[:, 0] * points[:, 1]
        return -0.5 * ((product - 0.2) / 0.01) ** 2

    deviation = np.full(10, 0.15)
    points = sample(log_likelihood, np.full(10, 0.5), deviation, count=COUNT, moves=8)
    assert abs(np.std(points[:, 0] * points[:, 1]) / 0.01 - 1.0) < 0.15
    assert np.all(np.abs(points[:, 2:].std(axis=0) / 0.15 - 1.0) < 0.15)
    # Grid integration of exp(-(log prior + log likelihood)) over the two coordinates.
    axis = np.linspace(0.0005, 0.9995, 1000)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    density = np.exp(-0.5 * (((x - 0.5) ** 2 + (y - 0.5) ** 2) / 0.15**2))
    density = (density * np.exp(-0.5 * ((x * y - 0.2) / 0.01) ** 2)).sum(axis=1)
    middle = np.sum(axis * density) / density.sum()
    wide = np.sqrt(np.sum((axis - middle) ** 2 * density) / density.sum())
    assert abs(points[:, 0].mean() - middle) < 0.15 * wide
    assert abs(points[:, 0].std() / wide - 1.0) < 0.15
