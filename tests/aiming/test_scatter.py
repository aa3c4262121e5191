"""Scatter follows the sensitivity to the action and the friction."""

import numpy as np

from cablecast.aiming.predictor import TYPICAL_FRICTION, log_scatters


def test_a_usual_cast_scatters_as_usual():
    assert abs(log_scatters(np.ones(1), np.full(1, TYPICAL_FRICTION))[0]) < 1e-12


def test_scatter_grows_with_either_and_is_bounded_below():
    sensitivities = np.array([1.0, 3.0, 1.0, 0.0])
    frictions = TYPICAL_FRICTION * np.array([1.0, 1.0, 3.0, 0.0])
    usual, wide, sliding, none = log_scatters(sensitivities, frictions)
    assert usual < wide < sliding
    np.testing.assert_allclose(np.exp(2 * sliding), 0.1 + 0.9 * 9)
    assert np.isfinite(none)
