"""Regions that landings are stated to lie in, before and after misses."""

import numpy as np
import pytest
import scipy.stats

from cablecast.cast import MISS_MEMORY, MISS_WEIGHT, RegionLaw
from cablecast.errors import InputError

LAWS = [RegionLaw(), RegionLaw.after([0.2, 5.0]), RegionLaw.after([9.0] * 30)]


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("law", LAWS)
def test_regions_are_those_of_a_t_distribution_with_the_stated_covariance(law, share):
    # d' S^-1 d / 2 follows Fisher's F with 2 and n degrees of freedom, and the covariance is
    # S n / (n - 2).
    scale = (law.freedom - 2.0) / law.freedom
    expected = 2.0 * scale * scipy.stats.f.ppf(share, 2, law.freedom)
    np.testing.assert_allclose(law.square(share), expected, rtol=1e-12)


def test_a_miss_changes_the_belief_as_bayes_rule_says():
    """A whole cast's worth of misses: the marginal of an inverse gamma belief about the factor."""
    squares = [0.3, 4.0, 1.1, 2.0]
    prior, weight = RegionLaw(), MISS_WEIGHT
    freedom, total = prior.freedom, prior.freedom - 2.0
    factors = np.geomspace(1e-4, 1e4, 20001)
    density = scipy.stats.invgamma.pdf(factors, freedom / 2, scale=total / 2)
    for square in squares:
        # A miss in the plane is Gaussian given the factor.
        density *= (np.exp(-0.5 * square / factors) / factors) ** weight
    mean = np.trapezoid(factors * density, factors) / np.trapezoid(density, factors)
    law = RegionLaw.after(squares)
    np.testing.assert_allclose(law.scale, mean, rtol=1e-3)
    assert law.freedom == freedom + 2.0 * weight * len(squares)


def test_misses_of_a_usual_size_change_nothing_but_how_sure_the_law_is():
    law = RegionLaw.after([2.0] * 8)
    np.testing.assert_allclose(law.scale, 1.0)
    assert law.square(0.99) < RegionLaw().square(0.99)


def test_only_the_last_misses_count():
    assert RegionLaw.after([100.0] * 5 + [1.0] * MISS_MEMORY) == RegionLaw.after([1.0] * 20)


@pytest.mark.parametrize("share", [0.0, 1.0, np.nan])
def test_a_share_out_of_bounds_is_named(share):
    with pytest.raises(InputError, match="share"):
        RegionLaw().square(share)
