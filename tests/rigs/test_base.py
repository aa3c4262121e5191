import pytest

from cablecast.errors import InputError
from cablecast.rigs.base import PURPOSES, purpose_seed


def test_each_purpose_of_each_seed_has_a_seed_of_its_own():
    seeds = {purpose_seed(seed, purpose) for seed in range(20) for purpose in ("", *PURPOSES)}
    assert len(seeds) == 20 * (1 + len(PURPOSES))


def test_the_seeds_of_purposes_are_those_of_earlier_versions():
    # Stored, so that casts of earlier versions can be made again.
    seeds = [purpose_seed(0, purpose) for purpose in ("", "tune", "real", "repeat")]
    assert seeds == [0, 2968811710, 3964924996, 3141116543]


@pytest.mark.parametrize(
    ("seed", "purpose", "words"),
    [(0, "party", "'party' of trials: one of tune, real, repeat"), (-1, "tune", "seed = -1")],
)
def test_unknown_purposes_and_bad_seeds_are_refused(seed, purpose, words):
    with pytest.raises(InputError, match=words):
        purpose_seed(seed, purpose)
