"""Strikes of a rope whose numbers the aim does not know, in the engine itself."""

import dataclasses

import numpy as np
import pytest
from tests.stick_moves import MOVES

from cablecast.aiming.strike import StrikeAim, StrikePrior
from cablecast.engines.swing import SAMPLE_DT, SwingModel
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import TargetError
from cablecast.task import STRIKE, Arrival, closest
from cablecast.tuning.tips import TipBelief, air_cable

COARSE = EngineWarp(segment_count=14, dt=1e-3, table=False, thread_count=1)
MODEL = SwingModel(moves=MOVES, engine=COARSE, duration=1.6)
# The world has a finer rope than the model of it, and a slower arm.
WORLD = dataclasses.replace(
    MODEL, engine=EngineWarp(segment_count=20, dt=1e-3, table=False, thread_count=1)
)
ROPE = air_cable(0.8, 0.04, 0.02, 0.08, 0.015)
BELIEF = TipBelief(
    cable=air_cable(0.95, 0.06, 0.03, 0.05, 0.015), deviations=(1.4, 2.0, 2.0, 2.0, 1.0)
)
# First tries miss by 4 cm, second ones by one or two, later ones by millimetres.
FIRST, SECOND, LAST = 0.03, 0.03, 0.01
# Distance that counts as a strike from a direction in the published task.
ARRIVAL_WITHIN = 0.05


@pytest.fixture(scope="module")
def prior():
    return StrikePrior.simulate(MODEL, BELIEF, checked=False, move_count=128, cable_count=6)


def swing(unit):
    """Return the tip of the world's rope until its first contact."""
    swings = WORLD.play(WORLD.motion(unit), ROPE, nodes=True)
    return swings.tip[0][: swings.contacts(np.array([0]))[0]]


def tries(aim, count):
    for _ in range(count):
        unit = aim.propose()
        aim.observe(unit, swing(unit))
    return np.array([one.miss for one in aim.tries])


@pytest.fixture(scope="module")
def goals():
    return [swing(unit)[step] for unit, step in (([0.5, 0.3, 0.8], 90), ([0.8, 0.6, 0.6], 70))]


@pytest.fixture(scope="module")
def misses(prior, goals):
    """Return the misses of four tries at each goal."""
    return np.array([tries(StrikeAim(prior, goal), 4) for goal in goals])


def test_a_fit_and_corrections_bring_the_tip_to_its_goal(misses):
    assert misses[:, 0].mean() > FIRST
    assert misses[:, 1].max() < SECOND
    assert misses[:, -1].max() < LAST


def test_a_move_that_hit_is_repeated(prior, goals):
    aim = StrikeAim(prior, goals[0], within=0.5)
    tries(aim, 2)
    np.testing.assert_array_equal(aim.tries[0].unit, aim.tries[1].unit)


def test_a_session_is_the_same_each_time(prior, goals, misses):
    np.testing.assert_array_equal(tries(StrikeAim(prior, goals[1]), 2), misses[1, :2])


def test_moves_that_the_arm_cannot_make_are_never_proposed(prior, goals):
    able = np.array([bool(ok) for ok in MOVES.feasible(prior.units)])
    assert 0 < np.count_nonzero(able) < len(able)
    tips = np.ascontiguousarray(prior.tips[:, able])
    aim = StrikeAim(
        StrikePrior(model=MODEL, belief=BELIEF, units=prior.units[able], tips=tips), goals[0]
    )
    tries(aim, 2)
    assert np.all(MOVES.feasible([one.unit for one in aim.tries]))


def test_a_goal_out_of_reach_is_refused_with_the_nearest_point_that_is_not(prior):
    with pytest.raises(
        TargetError, match=r"target \(0, 5, 0.5\) m cannot be struck: .* is \("
    ) as error:
        StrikeAim(prior, [0.0, 5.0, 0.5])
    assert "\n" not in str(error.value)


@pytest.mark.filterwarnings("error")
def test_any_number_of_moves_is_the_first_of_more(prior):
    few = StrikePrior.simulate(MODEL, BELIEF, checked=False, move_count=6, cable_count=1)
    np.testing.assert_array_equal(few.units, prior.units[:6])


def test_a_loss_counts_beside_the_distance(prior, goals):
    aim = StrikeAim(prior, goals[0], loss=lambda tip: 0.25)
    unit = aim.propose()
    tip = swing(unit)
    assert aim.observe(unit, tip) == pytest.approx(0.25 + float(closest(tip, goals[0])[0]))


def test_a_known_cable_strikes_a_goal_from_a_direction_at_the_first_try():
    known = TipBelief(cable=ROPE, deviations=(1.0, 1.0, 1.0, 1.0, 1.0))
    prior = StrikePrior.simulate(MODEL, known, checked=False, move_count=128, cable_count=1)
    hidden = MODEL.play(MODEL.motion([0.45, 0.35, 0.75]), ROPE).tip[0]
    asked = Arrival(
        goal=tuple(hidden[80].tolist()),
        direction=tuple((hidden[81] - hidden[79]).tolist()),
        dt=SAMPLE_DT,
    )
    aim = StrikeAim(prior, asked.goal, cable=ROPE, loss=asked)
    swings = MODEL.play(MODEL.motion(aim.propose()), ROPE, nodes=True)
    tip = swings.tip[0][: swings.contacts(np.array([0]))[0]]
    assert closest(tip, asked.goal)[0] <= ARRIVAL_WITHIN
    assert np.linalg.norm(STRIKE.arrival(tip, asked.goal, SAMPLE_DT)) >= asked.least_speed
    assert asked(tip) == 0.0


def test_cables_that_cannot_strike_a_goal_do_not_decide_the_first_try():
    # The first cable strikes the goal with the first move, the second one with none.
    misses = np.array([[0.0, 0.2], [1.0, 0.5]])
    tips = np.zeros((2, 2, 3, 3), dtype=np.float32)
    tips[..., 0] = misses[:, :, None]
    prior = StrikePrior(model=MODEL, belief=BELIEF, units=np.zeros((2, 3)), tips=tips)
    np.testing.assert_allclose(prior.misses([0.0, 0.0, 0.0]), misses[0], atol=1e-5)
