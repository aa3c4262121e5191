"""Scales of the residual are fitted to casts that were aimed, and to no others."""

import numpy as np

from cablecast.aiming.residual import Experience, Places, length_scales

CAST_COUNT = 30
PLACE_COUNT = len(length_scales())


def experience_of(share, **options):
    """Return an experience of casts that miss by a share of what is believed."""
    experience = Experience.empty()
    believed = experience.residual.believed
    size = share * np.hypot(believed.amplitude, believed.noise)
    rng = np.random.default_rng(4)
    none = np.zeros(1)
    for _ in range(CAST_COUNT):
        # Far from the others.
        inputs = 4.0 * rng.normal(size=(1, PLACE_COUNT))
        place = Places(inputs=inputs, log_sizes=none, log_scatters=none, frictions=none)
        experience = experience.with_cast(place, size * rng.normal(size=2), **options)
    return experience.with_fitted_scales()


def test_aimed_casts_tell_how_far_casts_miss():
    near, far = (experience_of(share).residual.scales.amplitude for share in (0.4, 2.0))
    believed = Experience.empty().residual.believed.amplitude
    assert near < 0.8 * believed < 1.3 * believed < far


def test_casts_that_were_not_aimed_tell_nothing_of_it():
    for options in ({"aimed": False}, {"fitted": True}):
        experience = experience_of(0.4, **options)
        assert experience.residual.scales == experience.residual.believed
        assert len(experience.residual) == CAST_COUNT
