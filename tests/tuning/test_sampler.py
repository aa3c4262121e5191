"""The sampler that fits are compared with draws what closed forms say."""

import numpy as np
from benchmarks.sampler import sample

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
