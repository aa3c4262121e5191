"""The local size: a smooth map over the table, told by few actions."""

import numpy as np
import pytest

from cablecast.aiming.residual import LocalSize


@pytest.fixture(scope="module")
def size():
    """Return the size of landings that are the surer the nearer they are, known to a quarter."""
    rng = np.random.default_rng(0)
    landing_xy = rng.uniform([0.0, 0.3], [1.2, 1.4], (240, 2))
    values = 0.05 * np.exp(2.0 * landing_xy[:, 1]) * np.exp(0.25 * rng.normal(size=240))
    return LocalSize(landing_xy=landing_xy, values=values)


def test_it_follows_the_values_and_is_relative_to_the_usual_one(size):
    asked = np.array([[0.6, 0.5], [0.6, 0.85], [0.6, 1.2]])
    near, middle, far = size.log_sizes(asked)
    assert middle == pytest.approx(0.0, abs=0.15)
    assert far - near == pytest.approx(2.0 * 0.7, abs=0.35)


def test_it_is_smooth_though_its_values_are_not(size):
    line = np.stack([np.full(50, 0.6), np.linspace(0.4, 1.3, 50)], axis=1)
    assert np.max(np.abs(np.diff(size.log_sizes(line)))) < 0.15


def test_far_outside_it_stays_within_the_values(size):
    logs = np.log(size.values / size.typical)
    far = size.log_sizes(np.array([[0.6, 50.0], [-90.0, 0.0]]))
    assert np.all(far >= logs.min())
    assert np.all(far <= logs.max())
