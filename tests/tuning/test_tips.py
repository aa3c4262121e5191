import numpy as np
import pytest
from scipy.special import ndtr
from tests.stick_moves import MOVES

from cablecast.engines.swing import SwingModel
from cablecast.engines.warp_ import EngineWarp
from cablecast.tuning.tips import TipBelief, TipSwing, air_cable, fit_tips, nearest

ENGINE = EngineWarp(segment_count=16, dt=1e-3, table=False, thread_count=1)
MODEL = SwingModel(moves=MOVES, engine=ENGINE, duration=1.6)
TRUTH = air_cable(0.8, 0.04, 0.02, 0.08, 0.015)
BELIEF = TipBelief(
    cable=air_cable(0.95, 0.06, 0.03, 0.05, 0.015), deviations=(1.5, 2.0, 2.0, 2.0, 1.0)
)
UNIT = np.array([0.6, 0.4, 0.7])
# A swing of one second and a half tells the length to a millimetre and stiffness and damping to a
# few per cent where the engine is the truth; the prior pulls by as much.
LENGTH_TOLERANCE, RATIO_TOLERANCE = 0.003, 0.15


def numbers(cable):
    """Return length, density, stiffness over it and damping time of a cable."""
    density = float(cable.params.mass) / cable.length
    ratio = float(cable.params.bend_stiffness) / density
    return np.array([cable.length, density, ratio, float(cable.params.damping_time)])


@pytest.fixture(scope="module")
def tip():
    return MODEL.play(MODEL.motion(UNIT), TRUTH).tip[0]


def fit(swing, **options):
    return fit_tips(MODEL, BELIEF, [swing], draw_count=64, start_count=3, **options)


def test_a_fit_to_one_swing_finds_the_numbers_of_the_cable(tip):
    found = fit(TipSwing(unit=UNIT, tip=tip))
    ratio = numbers(found.cable) / numbers(TRUTH)
    assert abs(ratio[0] - 1.0) < LENGTH_TOLERANCE
    assert np.abs(ratio - 1.0).max() < RATIO_TOLERANCE
    assert np.all(np.diff(found.costs) >= 0.0)


def test_points_without_a_time_or_an_order_tell_the_length(tip):
    points = tip[np.random.default_rng(0).permutation(len(tip))]
    found = fit(TipSwing(unit=UNIT, tip=points, timed=False))
    # Points every 10 ms that may lie anywhere along the path.
    assert numbers(found.cable)[0] == pytest.approx(TRUTH.length, abs=0.02)


def test_draws_of_a_posterior_scatter_as_its_covariance_says(tip):
    found = fit(TipSwing(unit=UNIT, tip=tip[:60]))
    drawn = found.draw(400, np.random.default_rng(0))
    spread = np.std(np.log([cable.length for cable in drawn]))
    stated = np.sqrt(found.covariances[0, 0, 0]) * np.log(BELIEF.deviations[0])
    assert len(found.points) == 1
    # Of 400 draws, 3.5 %.
    assert spread == pytest.approx(stated, rel=0.15)


def test_the_tolerance_of_a_tip_grows_from_its_fastest_moment_on(tip):
    swing = TipSwing(unit=UNIT, tip=tip)
    whip = int(np.argmax(np.linalg.norm(np.diff(tip, axis=0), axis=1)))
    assert np.all(np.diff(swing.tolerance[: whip + 1]) == 0.0)
    assert np.all(np.diff(swing.tolerance[whip:]) >= 0.0)
    assert len(swing.relevant.tip) <= len(tip)


def test_the_nearest_point_of_a_path_lies_on_its_pieces():
    path = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [np.nan] * 3, [0.0, 5.0, 0.0]])
    points, steps = nearest(path, np.array([[0.3, 1.0, 0.0], [2.0, 0.0, 0.0]]))
    np.testing.assert_allclose(points, [[0.3, 0.0, 0.0], [1.0, 0.0, 0.0]])
    np.testing.assert_array_equal(steps, [0, 0])


def test_draws_reach_the_ends_of_what_is_believed_of_each_number():
    count = 16
    points = BELIEF.draw(count, np.random.default_rng(0))[1:]
    # One draw in each sixteenth of probability; the first is the most likely cable instead.
    for number in points.T:
        shares = np.unique(np.floor(count * ndtr(number)))
        assert len(shares) == count - 1
