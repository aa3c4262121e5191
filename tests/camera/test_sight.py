"""Limits of a camera's sight: its place, and the circles in which the marker is not told."""

import numpy as np
import pytest

from cablecast.camera.settings import CameraSight
from cablecast.errors import InputError

OVERHEAD = (0.0, 0.7, 2.0)


def test_a_place_is_blind_within_a_circle_and_not_beside_it():
    sight = CameraSight(position=OVERHEAD, blind=((-1.0, 0.4, 0.15), (0.5, 1.2, 0.05)))
    places = [[-1.0, 0.4], [-0.86, 0.4], [-0.84, 0.4], [0.5, 1.24], [0.5, 1.26]]
    np.testing.assert_array_equal(sight.is_blind_at(places), [True, True, False, True, False])
    assert not CameraSight(position=OVERHEAD).is_blind_at([0.0, 1.0])


def test_the_nearest_place_that_is_seen_lies_straight_ahead_or_around_the_next_circle():
    sight = CameraSight(position=OVERHEAD, blind=((0.0, 1.0, 0.2),))
    np.testing.assert_allclose(sight.seen_near([0.1, 1.0], 0.05), [0.25, 1.0])
    np.testing.assert_allclose(sight.seen_near([0.3, 1.0], 0.05), [0.3, 1.0])
    assert np.hypot(*(sight.seen_near([0.0, 1.0], 0.05) - [0.0, 1.0])) == pytest.approx(0.25)
    # Another circle closes the nearest way: the place beside both is a little farther.
    two = CameraSight(position=OVERHEAD, blind=((0.0, 1.0, 0.2), (0.3, 1.0, 0.1)))
    found = two.seen_near([0.1, 1.0], 0.05)
    apart = [np.hypot(*(found - place[:2])) - place[2] for place in two.blind]
    assert min(apart) == pytest.approx(0.05, abs=1e-6)
    assert 0.15 < np.hypot(*(found - [0.1, 1.0])) < 0.24
    np.testing.assert_allclose(CameraSight(position=OVERHEAD).seen_near([0.1, 1], 0.1), [0.1, 1.0])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"position": (0.0, 0.7)}, "must be three numbers"),
        ({"position": (0.0, 0.7, np.nan)}, "must be three numbers"),
        ({"position": (0.0, 700.0, 2000.0)}, "within 100 m"),
        ({"position": (0.0, 0.7, -2.0)}, "height -2 m: it must be above the table"),
        ({"blind": ((0.0, 1.0),)}, "must be x, y and a radius"),
        ({"blind": ((0.0, 1.0, np.inf),)}, "must be x, y and a radius"),
        ({"blind": ((0.0, 1.0, 0.0),)}, "radius 0 m of a blind place must be above 0"),
        ({"blind": ((0.0, 1.0, 0.1),) * 101}, "101 blind places: at most 100"),
    ],
)
def test_what_is_no_sight_is_refused(values, words):
    with pytest.raises(InputError, match=words):
        CameraSight(**({"position": OVERHEAD} | values))
