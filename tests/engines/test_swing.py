"""An arm that swings cables by joint moves; air, lengths and contact have tests of their own."""

import dataclasses

import numpy as np
import pytest
from tests.stick_moves import MOVES

from cablecast.engines.swing import SAMPLE_DT, SwingModel
from cablecast.engines.warp_ import EngineWarp
from cablecast.tuning.tips import air_cable

ENGINE = EngineWarp(segment_count=14, dt=1e-3, table=False, thread_count=1)
MODEL = SwingModel(moves=MOVES, engine=ENGINE, duration=1.0)
UNITS = np.array([[0.2, 0.5, 0.5], [0.9, 0.3, 0.7]])
SHORT, LONG = air_cable(0.5, 0.05, 0.01, 0.1, 0.01), air_cable(1.1, 0.02, 0.03, 0.3, 0.02)
# Splines through samples at other places of a ramp, of a tip at some metres per second.
LAG_TOLERANCE = 5e-3
# Single precision over a thousand steps of a metre.
ROUNDING = 1e-4


def test_moves_and_cables_go_together_row_by_row():
    motion = MODEL.motion(UNITS)
    both = MODEL.play(motion, [SHORT, LONG]).tip
    for row, cable in enumerate((SHORT, LONG)):
        alone = MODEL.play(motion.rows(np.array([row])), cable).tip[0]
        np.testing.assert_allclose(both[row], alone, atol=ROUNDING)
    assert both.shape == (2, round(1.0 / SAMPLE_DT) + 1, 3)


def test_a_rope_hangs_below_the_stick_before_it_moves():
    tip = MODEL.play(MODEL.motion(UNITS), SHORT).tip[:, 0]
    flange = MOVES.arm.frames(np.array(MOVES.start))[-1]
    root = flange[:3, 3] + 0.5 * flange[:3, 2]
    np.testing.assert_allclose(tip, np.tile(root - [0.0, 0.0, 0.5], (2, 1)), atol=ROUNDING)


def test_an_arm_that_lags_moves_the_rope_later():
    def respond(q, dt):
        """Return what the joints were set to five samples before."""
        return np.concatenate([np.repeat(q[:, :1], 5, axis=1), q[:, :-5]], axis=1)

    late = dataclasses.replace(MODEL, respond=respond)
    on_time, lagged = (one.play(one.motion(UNITS), SHORT).tip for one in (MODEL, late))
    np.testing.assert_allclose(lagged[:, 5:], on_time[:, :-5], atol=LAG_TOLERANCE)


def test_a_thicker_rope_meets_the_arm_sooner_or_at_once():
    swings = MODEL.play(MODEL.motion(UNITS), LONG, nodes=True)
    worlds = np.arange(2)
    thin, thick = (swings.contacts(worlds, margin) for margin in (0.0, 0.3))
    assert np.all(thick <= thin)
    assert np.all(thick < len(swings.tip[0]))


def test_a_stick_that_folds_onto_the_arm_ends_the_swing():
    # The second wrist joint turns the stick out of the plane beside the arm, and towards it.
    wide = dataclasses.replace(
        MOVES, joints=(2, 3, 4), low=(3.0, -3.0, -3.0, -3.0), high=(3.0, 3.0, 3.0, 3.0)
    )
    model = dataclasses.replace(MODEL, moves=wide, duration=1.5)
    motion = model.motion(np.random.default_rng(0).random((40, 4)))
    steps = motion.shape.ends.shape[1]
    assert 0 < np.count_nonzero(motion.end < steps) < 40
    swings = model.play(motion, SHORT, nodes=True)
    assert np.all(swings.contacts(np.arange(40)) <= motion.end)


@pytest.mark.parametrize("count", [1, 3])
def test_one_move_swings_any_number_of_cables(count):
    tip = MODEL.play(MODEL.motion(UNITS[:1]), [SHORT] * count).tip
    assert len(tip) == count
