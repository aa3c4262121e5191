"""Scatter follows the sensitivity to action and friction, and bounds the chance of a hit."""

import numpy as np
import pytest

from cablecast.aiming.predictor import TYPICAL_FRICTION, log_scatters
from cablecast.aiming.propose import LEFT, STAYS, hit_chances
from cablecast.setup import Setup
from cablecast.task import LANDING, Expectation, MissLaw

GOAL = LANDING.goals(Setup(), [0.0, 1.0])[0]
POINTS = 0.03
"""Error of a chance that is counted among some hundred points of the law [-]."""


def test_a_usual_cast_scatters_as_usual():
    assert abs(log_scatters(np.ones(1), np.full(1, TYPICAL_FRICTION))[0]) < 1e-12


def test_scatter_grows_with_either_and_is_bounded_below():
    sensitivities = np.array([1.0, 3.0, 1.0, 0.0])
    frictions = TYPICAL_FRICTION * np.array([1.0, 1.0, 3.0, 0.0])
    usual, wide, sliding, none = log_scatters(sensitivities, frictions)
    assert usual < wide < sliding
    np.testing.assert_allclose(np.exp(2 * sliding), 0.1 + 0.9 * 9)
    assert np.isfinite(none)


def expected(deviation, scatter):
    """Return a law that is all but normal, expected on the goal; deviations in cable lengths."""
    length = GOAL.setup.cable.length
    return Expectation(
        mean=GOAL.value,
        covariance=(deviation * length) ** 2 * np.eye(2),
        law=MissLaw(freedom=1e6),
        scatter=scatter * length,
    )


def hit_chance(deviation):
    """Return the chance that a round normal law of a deviation [cable lengths] hits the goal."""
    return 1.0 - np.exp(-0.5 * (GOAL.within_pct / 100.0 / deviation) ** 2)


def test_the_chance_of_a_hit_grows_with_the_tries_as_corrections_leave_less_variance():
    one, two, three = hit_chances(expected(0.05, 0.0), GOAL, "sweep", 3)
    first, second, third = (hit_chance(0.05 * LEFT ** (0.5 * number)) for number in range(3))
    assert one == pytest.approx(first, abs=POINTS)
    left = (1.0 - first) * (1.0 - STAYS[0] * second)
    assert two == pytest.approx(1.0 - left, abs=POINTS)
    left *= 1.0 - STAYS[1] * third
    assert three == pytest.approx(1.0 - left, abs=POINTS)
    polar = hit_chances(expected(0.05, 0.0), GOAL, "polar", 2)
    assert polar[0] == one
    assert polar[1] > two


def test_no_correction_takes_the_scatter_of_equal_casts():
    chances = hit_chances(expected(0.04, 0.04), GOAL, "sweep", 2)
    again = hit_chance(0.04 * np.sqrt(2.0))
    left = (1.0 - chances[0]) * (1.0 - STAYS[0] * again)
    assert chances[1] == pytest.approx(1.0 - left, abs=POINTS)
