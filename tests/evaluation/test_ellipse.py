import math

import numpy as np
import pytest

from cablecast.errors import InputError
from cablecast.evaluation.repeatability import confidence_ellipse

# A share of 0.95 among 100,000 points has a standard deviation of 0.0007.
SHARE_TOLERANCE = 0.003


def test_an_ellipse_of_many_normal_points_holds_95_percent_of_them():
    random = np.random.default_rng(0)
    points = random.normal(size=(100_000, 2)) @ np.array([[0.03, 0.01], [0.0, 0.01]])
    ellipse = confidence_ellipse(points)
    assert ellipse.contains(points).mean() == pytest.approx(0.95, abs=SHARE_TOLERANCE)
    np.testing.assert_array_equal(ellipse.contains(ellipse.center_xy), True)
    outline = ellipse.outline()
    middle = ellipse.center_xy
    assert ellipse.contains(middle + 0.999 * (outline - middle)).all()
    assert not ellipse.contains(middle + 1.001 * (outline - middle)).any()


def test_the_longer_axis_points_where_the_landings_spread():
    along = np.linspace(-0.05, 0.05, 9)
    points = np.stack([0.6 * along, 0.8 * along], axis=-1) + [0.2, 0.9]
    points[::2] += [0.0008, -0.0006]
    ellipse = confidence_ellipse(points)
    assert abs(math.tan(ellipse.angle)) == pytest.approx(0.8 / 0.6, rel=0.02)
    assert ellipse.semi_axes[0] > 20 * ellipse.semi_axes[1]


@pytest.mark.parametrize(("small_sample", "scale"), [(False, 2.45), (True, 5.05)])
def test_the_scales_of_five_points_are_those_of_the_two_distributions(small_sample, scale):
    points = np.random.default_rng(3).normal(size=(5, 2))
    ellipse = confidence_ellipse(points, small_sample=small_sample)
    deviation = np.sqrt(np.linalg.eigvalsh(np.cov(points.T))[::-1])
    np.testing.assert_allclose(ellipse.semi_axes / deviation, scale, atol=0.005)


def test_two_landings_have_no_ellipse_and_nan_is_no_landing():
    assert confidence_ellipse([[0, 1], [0, 1.1]]) is None
    assert confidence_ellipse([[0, 1], [0, 1.1], [np.nan, np.nan]]) is None
    with pytest.raises(InputError, match=r"level = 1\.5"):
        confidence_ellipse([[0, 1], [0, 1.1], [0.1, 1]], 1.5)
