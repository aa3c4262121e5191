"""Polar casts err alike: one teaches the others, and they are chosen where sweeps are wild."""

import dataclasses

import numpy as np
import pytest
from tests.aiming.formula_rig import SETUP, make_policy

import cablecast as cc
from cablecast.aiming.polar import ASTRAY, KNOWN, LAID_OUT, PolarLandings
from cablecast.aiming.polar_errors import FLOOR, TURNING
from cablecast.aiming.predictor import Beliefs, LandingPredictor
from cablecast.aiming.propose import propose
from cablecast.aiming.residual import Experience, ResidualScales
from cablecast.cast import Cast, EndpointTrack, TrialStatus
from cablecast.conventions import polar_to_xy
from cablecast.data.store import CastStore
from cablecast.engines.dynamics import Dynamics
from cablecast.motion.casting import Action
from cablecast.motion.polar import PolarCast, cast_paces
from cablecast.motion.servo import ServoModel
from cablecast.report.words import reason_text
from cablecast.task import LANDING
from cablecast.tuning.tuned import Tuned

LENGTH = SETUP.cable.length
PACES = cast_paces(SETUP)
FAR = polar_to_xy([1.25, 0.2])
WILD = ResidualScales(amplitude=0.3, noise=0.3)
"""Scales of sweeps that scatter by a third of the cable's length."""
ASIDE = 0.05
"""Error of made-up casts across the cable [cable lengths]."""


@pytest.fixture(scope="module")
def landings():
    dynamics = Dynamics(params=SETUP.cable.params)
    tuned = Tuned(setup=SETUP, dynamics=dynamics, members=(dynamics,), member_resolution=(12, 2e-3))
    return PolarLandings.of(tuned)


def astray(landings, cast):
    """Return a polar cast that landed beside where it was expected, with the landing."""
    return made_at(landings, cast, ASIDE * landings.reach.axes(cast)[1], "aim")


def made_at(landings, cast, error, purpose):
    """Return a polar cast that erred from where it was simulated [cable lengths]."""
    return landed(cast, landings._simulated_xy(cast) + LENGTH * error, purpose)


def landed(cast, xy, purpose="aim"):
    """Return a polar cast that landed at a place [m], or nowhere."""
    track = EndpointTrack.unseen(TrialStatus.OCCLUDED)
    if xy is not None:
        track = EndpointTrack(times=np.zeros(1), endpoint_xy=xy[None], status=TrialStatus.OK)
    return Cast(action=cast, duration=20.0, joint_path=None, track=track, purpose=purpose)


def folded(landings, cast):
    """Return where a cable ends that is laid out with a fold [m]."""
    straight = landings.reach.end_xy(cast.to_array())
    return straight - 3.0 * LAID_OUT * LENGTH * landings.reach.axes(cast)[0]


def beside(landings, cast, error):
    """Return a polar cast that landed short of where it was simulated [cable lengths]."""
    return made_at(landings, cast, -error * landings.reach.axes(cast)[0], "pilot")


def test_the_arm_lags_behind_once(landings):
    servo = ServoModel(delay=np.full(6, 0.05), frequency=np.full(6, 20.0), damping=np.full(6, 0.8))
    lagging = dataclasses.replace(landings.dynamics, servo=servo)
    late = dataclasses.replace(landings, dynamics=lagging, _known={})
    cast = landings.reach.ahead(PACES[0])
    path = servo.apply(cast.grip_path(SETUP), SETUP.arm)
    expected = landings.dynamics.rollout(landings.engine, SETUP, path).endpoint_xy[0, -1]
    np.testing.assert_array_equal(late._simulated_xy(cast), expected)
    assert np.linalg.norm(landings._simulated_xy(cast) - expected) > 1e-6


def test_a_cast_is_aimed_so_that_it_is_expected_on_the_target(landings):
    cast = landings.aimed_at(FAR)
    expected = landings.expectation(cast)
    assert np.linalg.norm(expected.mean - FAR) < 2e-3
    assert landings.aimed_at(np.array([0.0, 0.4])) is None


def test_one_cast_teaches_itself_and_its_neighbours(landings):
    cast, other = landings.aimed_at(FAR), landings.aimed_at(polar_to_xy([1.2, 0.1]))
    made = astray(landings, cast)
    after = landings.with_casts([made])
    expected = after.expectation(cast)
    assert np.linalg.norm(expected.mean - made.final_xy) < expected.scatter
    # The neighbour is expected to err by most of what this one did, on the same side.
    real = astray(landings, other).final_xy
    before_miss, after_miss = (
        np.linalg.norm(one.expectation(other).mean - real) for one in (landings, after)
    )
    assert after_miss < 0.4 * before_miss
    assert np.trace(after.expectation(other).covariance) < 0.5 * np.trace(
        landings.expectation(other).covariance
    )
    corrected = after.aimed_at(FAR)
    assert np.linalg.norm(after.expectation(corrected).mean - FAR) < 2e-3
    assert corrected != cast


def test_three_pilots_are_cast_and_none_after_another_cast(landings):
    pilots, after = [], landings
    while (pilot := after.pilot) is not None:
        pilots.append(pilot)
        after = after.with_casts([beside(landings, pilot, 0.5 * LAID_OUT)])
    ahead, left, right = pilots
    assert (ahead.azimuth, ahead.x) == (0.0, 0.0)
    assert left == right.mirrored()
    assert left.azimuth < 0.0 < left.x
    assert {pilot.pace for pilot in pilots} == {PACES[0]}
    other = landings.with_casts([beside(landings, landings.aimed_at(FAR), 0.01)])
    assert other.pilot is None


def test_pilots_tell_how_far_each_angle_of_a_pull_turns_the_cable_too_far(landings):
    def turned(cast):
        error = TURNING * landings.reach.turn(cast) * landings.reach.axes(cast)[1]
        return made_at(landings, cast, error, "pilot")

    after = landings
    while (pilot := after.pilot) is not None:
        after = after.with_casts([turned(pilot)])
    target = polar_to_xy([0.9, -0.5])
    real = turned(landings.aimed_at(target)).final_xy
    before_miss, after_miss = (
        np.linalg.norm(one.expectation(landings.aimed_at(target)).mean - real)
        for one in (landings, after)
    )
    assert after_miss < 0.5 * before_miss


def test_a_pull_takes_the_sway_of_a_swing_down_as_a_tractrix_does(landings):
    back = landings.reach.back

    def sway(y):
        cast = PolarCast(0.0, 0.0, y)
        noise = landings._errors_at(1.0)._noise([cast], np.ones(1))[0, :, 0] - FLOOR**2
        return landings.reach.way(cast), np.sqrt(noise)

    (short, before), (long, after) = sway(back.grip_y_min + 0.1), sway(back.grip_y_min)
    assert long - short == pytest.approx(0.1)
    np.testing.assert_allclose(after / before, np.exp(-0.1 / LENGTH))


def test_equal_casts_that_land_apart_are_told_to_scatter_and_are_followed_less(landings):
    cast = landings.aimed_at(FAR)
    across = landings.reach.axes(cast)[1]

    def after(errors):
        return landings.with_casts([made_at(landings, cast, e * across, "aim") for e in errors])

    calm, wild = after([0.05, 0.052, 0.048]), after([0.05, 0.15, -0.02])
    assert calm.expectation(cast).scatter < landings.expectation(cast).scatter
    assert wild.expectation(cast).scatter > 3.0 * calm.expectation(cast).scatter
    # Nothing else is left to be known of a cast that was made three times.
    known = calm.expectation(cast)
    assert np.sqrt(0.5 * np.trace(known.covariance)) < 1.5 * known.scatter
    # What the next lands off by is luck, for the most part.
    last = made_at(landings, cast, 0.15 * across, "aim")
    before, later = (one.expectation(cast).mean for one in (wild, wild.with_casts([last])))
    assert across @ (later - before) < 0.4 * across @ (last.final_xy - before)


def test_pilots_are_cast_at_other_paces_until_a_swing_lays_the_cable_out(landings):
    pilot = landings.pilot
    # The first swing leaves the cable in a heap, the second lays it out.
    heap = landings.with_casts([beside(landings, pilot, 0.9)])
    second = heap.pilot
    assert second.pace == heap.aimed_at(FAR).pace == PACES[1]
    assert np.linalg.norm(heap.expectation(second).mean - landings._simulated_xy(second)) < 1e-9
    after = heap.with_casts([beside(heap, second, 0.5 * LAID_OUT)])
    assert after.pilot.pace == after.aimed_at(FAR).pace == PACES[1]


def test_where_no_swing_lays_the_cable_out_the_best_is_kept(landings):
    for error in (0.5, 0.3, 0.4):
        landings = landings.with_casts([beside(landings, landings.pilot, error)])
    assert landings.pace == landings.pilot.pace == PACES[1]


def test_a_fold_that_is_foretold_is_as_good_as_a_straight_cable(landings):
    pilots = [pilot for pace in PACES for pilot in landings._pilots(pace)]
    known = {pilot: folded(landings, pilot) for pilot in pilots}
    folds = dataclasses.replace(landings, _known=known)
    first = folds.pilot.pace
    for _ in range(3):
        folds = folds.with_casts([beside(folds, folds.pilot, 0.01)])
    assert folds.pilot is None
    assert folds.pace == first
    # Where it folds any more, nothing is known.
    cast = landings.reach.cast_to(FAR, first)
    most = folded(landings, cast) - 3.0 * LAID_OUT * LENGTH * landings.reach.axes(cast)[0]
    folds._known[cast] = most
    assert folds.aimed_at(FAR) is None


def test_a_pace_at_which_casts_land_now_here_and_now_there_is_left_for_another(landings):
    def made(casts, error):
        return casts.with_casts(
            [made_at(casts, casts.pilot, error * casts.reach.axes(casts.pilot)[1], "pilot")]
        )

    first = landings.pace
    for error in (0.1, 0.1, -0.2):
        assert landings.pace == first
        landings = made(landings, error)
    assert landings._doubt(first) > KNOWN
    assert landings.pilot.pace == landings.pace == PACES[1]
    for _ in range(3):
        landings = made(landings, 0.02)
    assert landings.pilot is None
    assert landings.pace == PACES[1]


def test_no_other_pace_is_tried_at_a_target_for_a_small_doubt(landings):
    proposal = proposal_of(landings, WILD)
    for pilot in landings._pilots(landings.pace):
        landings = landings.with_casts([beside(landings, pilot, 0.0)])
    first = landings.pace
    for error in (0.12, -0.12):
        cast = landings.aimed_at(FAR)
        made = made_at(landings, cast, error * landings.reach.axes(cast)[1], "aim")
        landings = landings.with_casts([dataclasses.replace(made, proposal=proposal)])
    assert landings._doubt(first) > KNOWN
    assert landings.pace == first


def test_a_pace_that_is_simulated_off_the_table_is_not_tried_first(landings):
    nowhere = {pilot: np.full(2, np.nan) for pilot in landings._pilots(PACES[0])}
    assert dataclasses.replace(landings, _known=nowhere).pilot.pace == PACES[1]


def test_a_cast_that_was_lost_is_not_made_again(landings):
    cast = landings.aimed_at(FAR)
    after = landings.with_casts([landed(cast, None)])
    assert after.aimed_at(FAR) is None
    assert after.aimed_at(polar_to_xy([1.2, -0.2])) is not None


def test_a_cast_that_ended_in_a_heap_is_not_made_again(landings):
    pilots = [beside(landings, pilot, 0.0) for pilot in landings._pilots(PACES[0])]
    before = landings.with_casts(pilots)
    after = before.with_casts([beside(landings, before.aimed_at(FAR), 1.5 * ASTRAY)])
    assert after.aimed_at(FAR) is None
    assert after.aimed_at(polar_to_xy([1.2, -0.2])) is not None


@pytest.mark.parametrize("error", [-0.04, 0.04, 1.5 * ASTRAY])
def test_an_error_aside_is_removed_by_the_next_casts_at_the_target(landings, error):
    def made(cast, share):
        error = share * landings.reach.axes(cast)[1]
        return dataclasses.replace(made_at(landings, cast, error, "aim"), proposal=proposal)

    proposal = proposal_of(landings, WILD)
    after = landings.with_casts([made(pilot, 0.03) for pilot in landings._pilots(PACES[0])])
    misses = []
    for _ in range(3):
        # The world errs across the cable by as much each time.
        cast = made(after.aimed_at(FAR), error)
        misses.append(np.linalg.norm(cast.final_xy - FAR) / LENGTH)
        after = after.with_casts([cast])
    assert misses[1] < 0.6 * misses[0]
    assert misses[2] < 0.03


def test_casts_that_were_laid_out_count_more_than_a_simulator_that_folds_them(landings):
    reach = landings.reach
    pilots = landings._pilots(PACES[0])
    cast = reach.cast_to(FAR, PACES[0])
    known = {one: folded(landings, one) for one in (*pilots, cast)}
    alone = dataclasses.replace(landings, _known=known)
    assert alone.pace != PACES[0] or alone.aimed_at(FAR) is None
    straight = [landed(one, reach.end_xy(one.to_array()), "pilot") for one in pilots]
    told = alone.with_casts(straight)
    assert told.pace == PACES[0]
    expected = told.expectation(cast)
    np.testing.assert_allclose(expected.mean, FAR, atol=1e-3)
    assert told.aimed_at(FAR) is not None
    # The simulator may be right all the same.
    along = landings.reach.axes(cast)[0]
    assert np.sqrt(along @ expected.covariance @ along) > 1.4 * LAID_OUT * LENGTH


def proposal_of(landings, scales):
    """Return what is proposed for a far target where sweeps have some scales."""
    predictor = dataclasses.replace(
        LandingPredictor.of(Beliefs(policy=make_policy())),
        experience=Experience.empty(scales, 2),
        polar=landings,
    )
    return propose(predictor, LANDING.goals(SETUP, FAR)[0])


def test_a_polar_cast_is_proposed_where_sweeps_are_wild_and_no_other(landings):
    assert isinstance(proposal_of(None, WILD).action, Action)
    assert isinstance(
        proposal_of(landings, ResidualScales(amplitude=0.01, noise=0.005)).action, Action
    )
    proposal = proposal_of(landings, WILD)
    assert isinstance(proposal.action, PolarCast)
    assert proposal.inside_coverage
    assert proposal.expected_miss < 0.01
    assert proposal.trajectory.action == proposal.action


def test_a_polar_cast_is_kept_and_read_again(landings, tmp_path):
    proposal = proposal_of(landings, WILD)
    track = EndpointTrack(
        times=np.zeros(1), endpoint_xy=proposal.goal.value[None], status=TrialStatus.OK
    )
    store = CastStore(SETUP, tmp_path)
    store.add(Cast.of_motion(proposal.trajectory, track, "aim", proposal))
    (kept,) = CastStore(SETUP, tmp_path).casts
    assert kept.action == proposal.action == kept.proposal.action
    assert np.isnan(kept.sweep).all()
    assert store.sweeps == []
    np.testing.assert_array_equal(kept.final_xy, proposal.goal.value)


def test_a_polar_cast_far_off_says_nothing_of_how_well_sweeps_are_predicted(landings):
    session = cc.AimSession(make_policy())
    before = session.propose(FAR)
    assert isinstance(before.action, Action)
    polar = dataclasses.replace(proposal_of(landings, WILD), number=0)
    track = EndpointTrack(times=np.zeros(1), endpoint_xy=FAR[None] + 0.4, status=TrialStatus.OK)
    session.observe(polar, track)
    assert session.casts[0].square > 9.0
    assert session.propose(FAR).expected.law == before.expected.law


def test_a_second_polar_cast_is_told_by_what_differs_from_the_first(landings):
    session = cc.AimSession(make_policy())
    first = dataclasses.replace(proposal_of(landings, WILD), number=0)
    track = EndpointTrack(times=np.zeros(1), endpoint_xy=FAR[None] + 0.1, status=TrialStatus.OK)
    session.observe(first, track)
    action = first.action
    moved = PolarCast(action.azimuth + np.radians(2.0), action.x + 0.03, action.y, 0.8)
    second = dataclasses.replace(proposal_of(landings, WILD), action=moved, number=1)
    assert reason_text(second, session) == (
        "try 1 with the azimuth +2.0 deg, the end of the pull +3.0 cm in x and +0.0 cm in y, "
        "pace -0.10"
    )
    sweep = dataclasses.replace(proposal_of(None, WILD), number=1)
    assert reason_text(sweep, session) == (
        "another kind of motion, which is expected to land nearer"
    )
