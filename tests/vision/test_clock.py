"""The rough offset between two clocks, from a motion that both tell of."""

import numpy as np
import pytest

from cablecast.errors import InputError
from cablecast.vision.clock import check_film_rate, controller_shift, rough_offset

RATE = 60.0
OFFSET = -12.3456
# A gripper swings to and fro for four seconds and is seen with a noise of a twentieth. With a slope
# of 4/s over 240 frames that tells the offset to 0.05 / (4 sqrt(240)) = 0.8 ms; ten draws stay
# within 3.5 times that.
OFFSET_MAX = 2.8e-3


def swing(times):
    """Return a reported speed: a few strokes, and rest before and after."""
    t = np.asarray(times) - 2.0
    inside = (t > 0) & (t < 4)
    return np.where(inside, np.sin(np.pi * t / 4) ** 2 * np.sin(2 * np.pi * 1.3 * t), 0.0)


def seen(seed, noise=0.05, scale=37.0):
    """Return times by the camera's clock, and what it saw."""
    times = np.arange(0.0, 8.0, 1 / RATE) - OFFSET
    rng = np.random.default_rng(seed)
    return times, scale * (swing(times + OFFSET) + noise * rng.normal(size=len(times))) + 2.0


def test_the_offset_is_found_whatever_the_scale_of_what_is_seen():
    found = [rough_offset(*seen(seed), swing, -14.0, -10.0, 0.02) for seed in range(10)]
    assert np.abs(np.array(found) - OFFSET).max() < OFFSET_MAX


def test_a_motion_that_the_robot_did_not_make_is_refused():
    times = np.arange(0.0, 8.0, 1 / RATE)
    noise = np.random.default_rng(0).normal(size=len(times))
    with pytest.raises(InputError, match="explains only"):
        rough_offset(times, noise, swing, -1.0, 1.0)


def test_a_motion_that_was_not_seen_is_refused():
    times, signal = seen(0)
    signal[20:] = np.nan
    with pytest.raises(InputError, match="20 frames show the motion: at least 30"):
        rough_offset(times, signal, swing, -20.0, 0.0)


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


@pytest.mark.parametrize("friction", [0.15, 0.3, 0.8])
def test_slow_motion_is_noticed_by_the_friction_that_it_would_need(friction):
    check_film_rate(*coast(friction), rate=60.0)
    with pytest.raises(InputError, match=r"slow motion, with about \d+ frames/s stored as 30"):
        check_film_rate(*coast(friction, pace=1 / 8), rate=30.0)


def test_an_endpoint_that_lies_still_or_never_rests_says_nothing_of_the_rate():
    times = np.arange(60) / 60
    check_film_rate(times, np.zeros((60, 2)), 60.0)
    check_film_rate(times, np.stack([times, times], axis=1), 60.0)
    check_film_rate(times, np.full((60, 2), np.nan), 60.0)
