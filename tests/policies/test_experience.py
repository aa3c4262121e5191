"""What casts tell of the scales of the residual, and which of them."""

import numpy as np

from cablecast.models.few_casts import PLACE_COUNT, Places
from cablecast.policies.experience import Experience

RNG = np.random.default_rng(4)
CAST_COUNT = 30


def places(count):
    """Return usual places, far from each other."""
    return Places(
        inputs=4.0 * RNG.normal(size=(count, PLACE_COUNT)),
        log_sizes=np.zeros(count),
        log_shakes=np.zeros(count),
        frictions=np.zeros(count),
    )


def learned(share, **options):
    """Return an experience of casts that miss by a share of what is believed."""
    experience = Experience()
    believed = experience.residual.believed
    size = share * np.hypot(believed.amplitude, believed.noise)
    some = places(CAST_COUNT)
    for row in range(CAST_COUNT):
        experience.add(some[np.array([row])], size * RNG.normal(size=2), **options)
    experience.refit()
    return experience


def test_aimed_casts_tell_how_far_casts_miss():
    near, far = (learned(share).residual.scales.amplitude for share in (0.4, 2.0))
    believed = Experience().residual.believed.amplitude
    assert near < 0.8 * believed < 1.3 * believed < far


def test_casts_that_were_not_aimed_tell_nothing_of_it():
    for options in ({"aimed": False}, {"fitted": True}):
        experience = learned(0.4, **options)
        assert experience.residual.scales == experience.residual.believed
        assert len(experience.residual) == CAST_COUNT
