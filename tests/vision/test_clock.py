"""The clock of a controller, and the rate of a film."""

import warnings

import numpy as np
import pytest

from cablecast.errors import InputError
from cablecast.vision.clock import check_film_rate, controller_shift


def test_the_report_that_travelled_fastest_ties_the_controller_to_this_computer():
    delays = np.array([0.004, 0.0011, 0.02, 0.003])
    reports = np.array([5.0, 5.002, 5.004, 5.006])
    pairs = np.column_stack([reports, reports + 1000.0 + delays])
    assert controller_shift(pairs) == pytest.approx(1000.0011)
    with pytest.raises(InputError, match="reported no times"):
        controller_shift(np.empty((0, 2)))


def coast(friction, pace=1.0, speed=2.5, rate=60.0):
    """Return times of frames and the way of an endpoint that friction stops, filmed at a pace."""
    times = np.arange(0.0, 2.0, pace / rate)
    stop = speed / (9.81 * friction)
    t = np.minimum(times, stop)
    x = speed * t - 0.5 * 9.81 * friction * t * t
    return times / pace, np.stack([x, 0.5 * x], axis=1)


@pytest.mark.parametrize("friction", [0.15, 0.8])
def test_slow_motion_is_noticed_by_the_friction_that_it_would_need(friction):
    check_film_rate(*coast(friction), rate=60.0)
    with pytest.raises(InputError, match=r"filmed with about \d+ frames/s, and stored as 30"):
        check_film_rate(*coast(friction, pace=1 / 8), rate=30.0)


# A tracker puts an endpoint to a millimetre or so [m].
NOISE = 1e-3


@pytest.mark.parametrize("rate", [30.0, 60.0])
def test_slow_motion_of_a_slow_cast_is_warned_of(rate):
    rng = np.random.default_rng(0)
    times, xy = coast(0.3, pace=1 / 8, speed=1.2, rate=rate)
    with pytest.warns(UserWarning, match=r"slowed from 0\.1\d m/s by 0\.0\d m/s² only.*--rate"):
        check_film_rate(times, xy + rng.normal(0.0, NOISE, xy.shape), rate)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        times, xy = coast(0.3, speed=1.2, rate=rate)
        check_film_rate(times, xy + rng.normal(0.0, NOISE, xy.shape), rate)


def test_an_endpoint_that_lies_still_or_never_rests_says_nothing_of_the_rate():
    times = np.arange(60) / 60
    check_film_rate(times, np.zeros((60, 2)), 60.0)
    check_film_rate(times, np.stack([times, times], axis=1), 60.0)
    check_film_rate(times, np.full((60, 2), np.nan), 60.0)
