"""Simulators take a step towards the casts near a target before the next cast is chosen."""

import dataclasses

import numpy as np
import pytest
from tests.aiming.casts import made_up_cast
from tests.aiming.formula_rig import LENGTH, SETUP, make_policy

import cablecast as cc
from cablecast.aiming.predictor import _NEAR_COUNT, Beliefs, LandingPredictor
from cablecast.aiming.session import LOCAL_COUNT, casts_near
from cablecast.data.record import collect_dataset
from cablecast.motion.casting import Action
from cablecast.motion.feasibility import feasible_uniform
from cablecast.pipeline.simulate import simulate_to_aim
from cablecast.rigs.engine import RigEngine
from cablecast.task import LANDING, Goal
from cablecast.tuning.landings import LandingEstimate
from cablecast.tuning.tracks import MeasuredTracks

COARSE = {"segment_count": 10, "dt": 2e-3}
SEARCH = cc.FitConfig(
    # The cable of these rigs has no material.
    materials=(),
    start_count=2,
    rough_iterations=2,
    kept_start_count=1,
    coarse_iterations=1,
    fine_iterations=1,
    ensemble_iterations=1,
    coarse_segment_count=10,
    coarse_dt=2e-3,
)
TARGET = np.array([0.3, 1.1])
GOAL = Goal(task=LANDING, setup=SETUP, value=TARGET)
ACTION = np.array([[-0.5, 0.6, 0.55, 1.0, 1.0]])
NEARBY = ACTION + [[0.05, -0.05, 0.01, 0.05, 0.0]]


def test_casts_at_the_target_come_first_then_those_that_landed_nearest():
    far = [made_up_cast((0.3, 1.1 + 0.01 * (20 - k))) for k in range(12)]
    aimed = [made_up_cast((-0.8, 0.4), TARGET), made_up_cast((np.nan, np.nan), TARGET)]
    rows = list(enumerate([*far, *aimed]))
    assert casts_near(rows, GOAL) == [6, 7, 8, 9, 10, 11, 12, 13]
    many = [(k, made_up_cast((0.0, 1.0), TARGET)) for k in range(12)]
    assert casts_near(many, GOAL) == list(range(12 - LOCAL_COUNT, 12))
    assert casts_near([(0, made_up_cast((np.nan, np.nan), (0.5, 1.0)))], GOAL) == []
    assert casts_near([], GOAL) == []


@pytest.fixture(scope="module")
def slippery():
    """Return a rig whose table rubs less than that of the casts that were fitted."""
    believed = SETUP.cable.params
    friction = 0.9 * float(believed.lateral_friction)
    params = dataclasses.replace(believed, lateral_friction=friction)
    with cc.make_rig(RigEngine(cc.EngineWarp(**COARSE), SETUP, params), SETUP) as rig:
        yield rig


@pytest.fixture(scope="module")
def tuned():
    with cc.make_rig(RigEngine(cc.EngineWarp(**COARSE), SETUP), SETUP) as rig:
        casts = cc.collect(rig, count=3, seed=4)
        return cc.tune(casts, config=SEARCH, validation_count=0, **COARSE)


@pytest.fixture(scope="module")
def lesson(slippery, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lesson") / "casts"
    return collect_dataset(folder, slippery, SETUP, purpose="tune", actions=ACTION)


CONFIG = cc.AimConfig(within_pct=0.01, tries=9, polar=False)


def session_of(tuned, *, fitted_count=0, **given):
    model = Beliefs(policy=make_policy(), tuned=tuned, fitted_to=fitted_count)
    return cc.AimSession(model, config=CONFIG, **given)


def test_simulators_that_learned_from_a_cast_land_it_and_another_nearer_to_it(
    tuned, lesson, slippery
):
    ensemble = session_of(tuned).predictor.ensemble
    updated = ensemble.updated(MeasuredTracks.from_dataset(lesson))
    true = dataclasses.replace(ensemble.members[0], params=slippery.rig.dynamics.params)
    both = np.concatenate([ACTION, NEARBY])
    true_xy = ensemble.tracks(both, simulators=[true])[0, :, -1]
    before, after = (
        np.linalg.norm(some.tracks(both)[:, :, -1] - true_xy, axis=-1)
        for some in (ensemble, updated)
    )
    # One step, held back by what the earlier casts told.
    assert np.all(after < before)
    assert np.all(np.median(after, axis=0) < 0.75 * np.median(before, axis=0))


def test_landings_are_expected_where_the_fit_says_after_it_learned(tuned, lesson):
    ensemble = session_of(tuned).predictor.ensemble
    updated = ensemble.updated(MeasuredTracks.from_dataset(lesson))
    best = updated.tracks(NEARBY, simulators=[updated.dynamics], engine=updated.engine)
    simulated = best[0, :, -1]
    said = updated.landings(NEARBY).landing_xy
    np.testing.assert_allclose(said, simulated, rtol=0, atol=1e-12)
    assert np.linalg.norm(said - ensemble.landings(NEARBY).landing_xy) > 0.001 * LENGTH


def test_a_cast_of_which_nothing_was_seen_teaches_nothing(tuned, lesson):
    ensemble = session_of(tuned).predictor.ensemble
    tracks = MeasuredTracks.from_dataset(lesson)
    unseen = dataclasses.replace(tracks, endpoint_xy=np.full_like(tracks.endpoint_xy, np.nan))
    assert ensemble.updated(unseen) is ensemble


def test_a_predictor_without_simulators_stays_as_it_is(lesson):
    predictor = LandingPredictor.of(Beliefs(policy=make_policy()))
    assert predictor.near(TARGET, MeasuredTracks.from_dataset(lesson)) is predictor


def test_a_predictor_for_one_target_has_the_same_casts_and_leaves_the_other_alone(tuned, lesson):
    session = session_of(tuned)
    session.add_casts(lesson)
    predictor = session.predictor
    before = predictor.predict(NEARBY)[0]
    near = predictor.near(TARGET, MeasuredTracks.from_dataset(lesson))
    assert len(near.casts) == len(predictor.casts) == 1
    assert near.experience.residual.scales == predictor.experience.residual.scales
    np.testing.assert_array_equal(predictor.predict(NEARBY)[0], before)
    own = [p.experience.residual.residuals[0] for p in (predictor, near)]
    assert np.linalg.norm(own[1]) < np.linalg.norm(own[0])


class _Steady:
    """An ensemble that says the same of all casts, and learns nothing."""

    factor = 1.0

    def landings(self, actions, side, task):
        nothing = np.zeros(len(actions))
        return LandingEstimate(
            landing_xy=np.full((len(actions), 2), np.nan),
            frictions=nothing,
            spreads=nothing + 0.02,
            leaving=nothing,
        )

    def updated(self, tracks):
        return self


def test_a_predictor_for_one_target_has_the_nearest_casts_as_old_as_they_are(lesson):
    predictor = LandingPredictor.of(Beliefs(policy=make_policy()))
    predictor = dataclasses.replace(predictor, ensemble=_Steady())
    actions = feasible_uniform(75, SETUP, seed=8)
    landings = predictor.predict(actions)[0]
    far = np.linalg.norm(landings - TARGET, axis=1)
    nearest, farthest = int(np.argmin(far)), np.argsort(far)[-22:]
    # More casts than a predictor takes end far away without a landing, and one near the target.
    lost = [nearest, *farthest[:-1]]
    landings[lost] = np.nan
    # Everything shifts after 40 casts, which is noticed as a drift.
    landings[40:] += 0.4 * LENGTH
    casts = [
        dataclasses.replace(made_up_cast(xy), action=Action.from_array(action))
        for action, xy in zip(actions, landings, strict=True)
    ]
    # The farthest of all was aimed at the target, and missed it.
    aimed = int(farthest[-1])
    proposal = made_up_cast((0.0, 1.0), TARGET).proposal
    casts[aimed] = dataclasses.replace(casts[aimed], proposal=proposal)
    predictor = predictor.with_casts(casts)
    assert predictor.experience.drifts
    near = predictor.near(TARGET, MeasuredTracks.from_dataset(lesson))
    kept = [[c is cast for c in casts].index(True) for cast in near.casts]
    far = np.linalg.norm(np.where(np.isfinite(landings), landings, 9.0) - TARGET, axis=1)
    far[[nearest, aimed]] = 0.0
    assert kept == sorted(np.argsort(far, kind="stable")[:_NEAR_COUNT])
    landed = np.isfinite(landings).all(axis=1)
    ages = np.array(predictor.experience.ages)
    rows = [int(landed[:k].sum()) for k in kept if landed[k]]
    np.testing.assert_array_equal(near.experience.ages, ages[rows])
    assert min(near.experience.ages) == 1.0 < max(near.experience.ages)


def test_a_session_that_is_opened_again_plans_as_it_would_have(tuned, slippery, tmp_path):
    whole = session_of(tuned)
    for _ in range(3):
        whole.cast(slippery, whole.propose(TARGET))
        again = session_of(tuned, out=tmp_path / "session")
        again.cast(slippery, again.propose(TARGET))
    # A motion that is simulated beside longer ones ends by other pieces: a micrometre apart.
    for one, other in zip(whole.casts, again.casts, strict=True):
        np.testing.assert_allclose(one.sweep, other.sweep, rtol=0, atol=1e-4)
    planned = [session.propose(TARGET) for session in (whole, again, whole.fork())]
    for proposal in planned[1:]:
        np.testing.assert_allclose(
            proposal.expected.mean, planned[0].expected.mean, rtol=0, atol=3e-4
        )


def test_a_model_learns_from_the_first_simulator_without_its_curl(tuned):
    first = tuned.members[0]
    straight = dataclasses.replace(first.params, damping_time=0.01, rest_curvature=0.0)
    curled = first.with_params(dataclasses.replace(straight, rest_curvature=0.3))
    other = dataclasses.replace(
        tuned, members=(curled, *tuned.members[1:]), member_resolution=(12, 2e-3)
    )
    casts = simulate_to_aim(SETUP, other, count=50)
    settings = casts.info["settings"]
    assert settings["engine"]["segment_count"] == 12
    assert settings["params"] == straight.to_dict()
    alone = dataclasses.replace(tuned, members=())
    casts = simulate_to_aim(SETUP, alone, count=50, segment_count=10, dt=2e-3)
    assert casts.info["settings"]["params"] == tuned.params.to_dict()


def test_casts_that_the_simulators_were_fitted_to_change_them_no_more(tuned, lesson):
    session = session_of(tuned)
    session.add_casts(lesson)
    fitted = session_of(tuned, casts=lesson, fitted_count=1)
    assert session.predictor_at(TARGET) is not session.predictor
    assert fitted.predictor_at(TARGET) is fitted.predictor
    session.undo(0)
    assert session.predictor_at(TARGET) is session.predictor


def test_a_cast_that_was_not_aimed_is_known_as_such(tuned, lesson, slippery):
    session = session_of(tuned)
    session.add_casts(lesson)
    assert list(session.predictor.experience.aimed) == [False]
    session.cast(slippery, session.propose(TARGET))
    assert list(session.predictor.experience.aimed) == [False, True]
    # A dataset tells no targets, whatever its casts were for.
    again = session_of(tuned)
    again.add_casts(session.store.dataset())
    assert list(again.predictor.experience.aimed) == [False, False]


def test_casts_of_another_session_are_taken_in_together(
    tuned, lesson, slippery, tmp_path, monkeypatch
):
    one = session_of(tuned)
    one.add_casts(lesson)
    one.cast(slippery, one.propose(TARGET))
    two = session_of(tuned, out=tmp_path / "session")
    two.add_casts(one.store.dataset())
    groups = []
    with_casts = LandingPredictor.with_casts

    def noted(self, casts, **options):
        groups.append((len(casts), options["fit_scales"]))
        return with_casts(self, casts, **options)

    monkeypatch.setattr(LandingPredictor, "with_casts", noted)
    session_of(tuned, out=tmp_path / "session")
    assert groups == [(2, True)]
