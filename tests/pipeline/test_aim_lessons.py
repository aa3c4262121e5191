"""Casts near a target teach the simulators before the next cast is chosen."""

import dataclasses

import numpy as np
import pytest
from formula_rig import LENGTH, SETUP, make_policy

import cablecast as cc
from cablecast.aiming.choice import _NEAR_COUNT, AimedCast, Aimer
from cablecast.aiming.ensemble import Judgement
from cablecast.cast import TrialStatus
from cablecast.data.record import collect_dataset
from cablecast.motion.feasibility import feasible_uniform
from cablecast.pipeline.aim_casts import AimTrial
from cablecast.pipeline.aim_lessons import LESSON_COUNT, rows_near
from cablecast.pipeline.simulate import simulate_to_aim
from cablecast.rigs.engine import RigEngine
from cablecast.tuning.tracks import MeasuredTracks

COARSE = {"segment_count": 10, "dt": 2e-3}
SEARCH = cc.FitConfig(
    # The cable of these rigs has no material.
    materials=(),
    start_count=2,
    coarse_iterations=2,
    fine_start_count=1,
    fine_iterations=1,
    ensemble_iterations=1,
    coarse_segment_count=10,
    coarse_dt=2e-3,
)
TARGET = np.array([0.3, 1.1])
ACTION = np.array([[-0.5, 0.6, 0.55, 1.0]])
NEARBY = ACTION + [[0.05, -0.05, 0.01, 0.05]]


def trial(number, landing, target=(np.nan, np.nan)):
    """Return a cast that landed somewhere."""
    return AimTrial(
        number=number,
        purpose="aim",
        try_number=1,
        target_xy=np.array(target),
        action=np.zeros(4),
        expected_xy=np.zeros(2),
        covariance=np.eye(2),
        status=TrialStatus.OK,
        final_xy=np.array(landing),
        miss_pct=1.0,
        hit=False,
    )


def test_casts_at_the_target_teach_first_then_those_that_landed_nearest():
    far = [trial(k, (0.3, 1.1 + 0.01 * (20 - k))) for k in range(12)]
    aimed = [trial(12, (-0.8, 0.4), TARGET), trial(13, (np.nan, np.nan), TARGET)]
    assert rows_near([*far, *aimed], TARGET) == [6, 7, 8, 9, 10, 11, 12, 13]
    many = [trial(k, (0.0, 1.0), TARGET) for k in range(12)]
    assert rows_near(many, TARGET) == list(range(12 - LESSON_COUNT, 12))
    assert rows_near([trial(0, (np.nan, np.nan), (0.5, 1.0))], TARGET) == []
    assert rows_near([], TARGET) == []


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


def session_of(tuned, **given):
    return cc.AimSession(make_policy(), tuned=tuned, within_pct=0.01, tries=9, **given)


def test_simulators_that_learned_from_a_cast_land_it_and_another_nearer_to_it(
    tuned, lesson, slippery
):
    ensemble = session_of(tuned).aimer.predictor.ensemble
    taught = ensemble.taught(MeasuredTracks.from_dataset(lesson))
    true = dataclasses.replace(ensemble.members[0], params=slippery.rig.dynamics.params)
    both = np.concatenate([ACTION, NEARBY])
    true_xy = ensemble._tracks(ensemble.engine, [true], both, np.ones(2))[0, :, -1]
    before, after = (
        np.linalg.norm(some.tracks(both)[:, :, -1] - true_xy, axis=-1)
        for some in (ensemble, taught)
    )
    # One step, held back by what the earlier casts told.
    assert np.all(after < before)
    assert np.all(np.median(after, axis=0) < 0.75 * np.median(before, axis=0))


def test_landings_are_expected_where_the_fit_says_after_it_learned(tuned, lesson):
    ensemble = session_of(tuned).aimer.predictor.ensemble
    taught = ensemble.taught(MeasuredTracks.from_dataset(lesson))
    learned = taught._tracks(taught.fine_engine, [taught.best], NEARBY, np.ones(1))[0, :, -1]
    said = taught.judge(NEARBY).landing_xy
    np.testing.assert_allclose(said, learned, rtol=0, atol=1e-12)
    assert np.linalg.norm(said - ensemble.judge(NEARBY).landing_xy) > 0.001 * LENGTH


def test_a_cast_of_which_nothing_was_seen_teaches_nothing(tuned, lesson):
    ensemble = session_of(tuned).aimer.predictor.ensemble
    tracks = MeasuredTracks.from_dataset(lesson)
    unseen = dataclasses.replace(tracks, endpoint_xy=np.full_like(tracks.endpoint_xy, np.nan))
    assert ensemble.taught(unseen) is ensemble


def test_an_aimer_without_simulators_learns_as_before(lesson):
    aimer = Aimer(make_policy())
    assert aimer.taught(MeasuredTracks.from_dataset(lesson), TARGET) is aimer


def test_a_taught_aimer_knows_the_same_casts_and_leaves_the_other_alone(tuned, lesson):
    session = session_of(tuned)
    session.add_casts(lesson)
    aimer = session.aimer
    before = aimer.predictor.predict(NEARBY)[0]
    taught = aimer.taught(MeasuredTracks.from_dataset(lesson), TARGET)
    assert len(taught.casts) == len(aimer.casts) == 1
    assert taught.experience.residual.scales == aimer.experience.residual.scales
    np.testing.assert_array_equal(aimer.predictor.predict(NEARBY)[0], before)
    own = [a.experience.residual.residuals[0] for a in (aimer, taught)]
    assert np.linalg.norm(own[1]) < np.linalg.norm(own[0])


class _Steady:
    """An ensemble that says the same of all casts, and learns nothing."""

    def judge(self, actions, side=None):
        nothing = np.zeros(len(actions))
        return Judgement(
            landing_xy=np.full((len(actions), 2), np.nan),
            frictions=nothing,
            spreads=nothing + 0.02,
            leaving=nothing,
        )

    def taught(self, tracks):
        return self


def test_an_aimer_for_one_target_knows_the_nearest_casts_as_old_as_they_are(lesson):
    aimer = Aimer(make_policy(), ensemble=_Steady())
    actions = feasible_uniform(75, SETUP, seed=8)
    landings = aimer.predictor.predict(actions)[0]
    far = np.linalg.norm(landings - TARGET, axis=1)
    nearest, farthest = int(np.argmin(far)), np.argsort(far)[-22:]
    # More casts than an aimer takes end far away without a landing, and one near the target.
    lost = [nearest, *farthest[:-1]]
    landings[lost] = np.nan
    # Everything shifts after 40 casts, which is noticed as a drift.
    landings[40:] += 0.4 * LENGTH
    casts = [AimedCast(action=a, endpoint_xy=xy) for a, xy in zip(actions, landings, strict=True)]
    # The farthest of all was aimed at the target, and missed it.
    aimed = int(farthest[-1])
    casts[aimed] = dataclasses.replace(casts[aimed], target_xy=TARGET)
    aimer.learn(casts)
    assert aimer.experience.drifts
    taught = aimer.taught(MeasuredTracks.from_dataset(lesson), TARGET)
    kept = [[c is cast for c in casts].index(True) for cast in taught.casts]
    far = np.linalg.norm(np.where(np.isfinite(landings), landings, 9.0) - TARGET, axis=1)
    far[[nearest, aimed]] = 0.0
    assert kept == sorted(np.argsort(far, kind="stable")[:_NEAR_COUNT])
    landed = np.isfinite(landings).all(axis=1)
    ages = np.array(aimer.experience.ages)
    rows = [int(landed[:k].sum()) for k in kept if landed[k]]
    np.testing.assert_array_equal(taught.experience.ages, ages[rows])
    assert min(taught.experience.ages) == 1.0 < max(taught.experience.ages)


def test_a_session_that_is_opened_again_plans_as_it_would_have(tuned, slippery, tmp_path):
    whole = session_of(tuned)
    for _ in range(3):
        whole.cast(slippery, whole.propose(TARGET))
        again = session_of(tuned, out=tmp_path / "session")
        again.cast(slippery, again.propose(TARGET))
    # A motion that is simulated beside longer ones ends by other pieces: a micrometre apart.
    for one, other in zip(whole.history, again.history, strict=True):
        np.testing.assert_allclose(one.action, other.action, rtol=0, atol=1e-4)
    planned = [session.propose(TARGET) for session in (whole, again, whole.fork())]
    for proposal in planned[1:]:
        np.testing.assert_allclose(proposal.expected_xy, planned[0].expected_xy, rtol=0, atol=1e-4)


def test_a_model_learns_from_the_first_simulator_without_its_curl(tuned):
    first = tuned.ensemble.members[0]
    straight = dataclasses.replace(first.params, damping_time=0.01, rest_curvature=0.0)
    curled = first.with_params(dataclasses.replace(straight, rest_curvature=0.3))
    ensemble = dataclasses.replace(
        tuned.ensemble, members=(curled, *tuned.ensemble.members[1:]), segment_count=12
    )
    casts = simulate_to_aim(SETUP, dataclasses.replace(tuned, ensemble=ensemble), count=50)
    settings = casts.info["settings"]
    assert settings["engine"]["segment_count"] == 12
    assert settings["params"] == straight.to_dict()
    alone = dataclasses.replace(tuned, ensemble=None)
    casts = simulate_to_aim(SETUP, alone, count=50, segment_count=10, dt=2e-3)
    assert casts.info["settings"]["params"] == tuned.params.to_dict()


def test_casts_that_the_simulators_were_fitted_to_teach_them_nothing_new(tuned, lesson):
    session = session_of(tuned)
    session.add_casts(lesson)
    fitted = cc.AimSession(make_policy(), casts=lesson, tuned=tuned, fitted_count=1)
    assert session._aimer_at(TARGET) is not session.aimer
    assert fitted._aimer_at(TARGET) is fitted.aimer
    session.relearn(without=[0])
    assert session._aimer_at(TARGET) is session.aimer


def test_a_cast_that_was_not_aimed_is_known_as_such(tuned, lesson, slippery):
    session = session_of(tuned)
    session.add_casts(lesson)
    assert [cast.aimed for cast in session.aimer.casts] == [False]
    session.cast(slippery, session.propose(TARGET))
    assert [cast.aimed for cast in session.aimer.casts] == [False, True]
    # A dataset tells no targets, whatever its casts were for.
    again = session_of(tuned)
    again.add_casts(session.store.dataset())
    assert [cast.aimed for cast in again.aimer.casts] == [False, False]


def test_casts_of_another_session_are_learned_together_again(
    tuned, lesson, slippery, tmp_path, monkeypatch
):
    one = session_of(tuned)
    one.add_casts(lesson)
    one.cast(slippery, one.propose(TARGET))
    two = session_of(tuned, out=tmp_path / "session")
    two.add_casts(one.store.dataset())
    groups = []
    learn = Aimer.learn

    def noted(self, casts, *, refit=True):
        groups.append((len(casts), refit))
        return learn(self, casts, refit=refit)

    monkeypatch.setattr(Aimer, "learn", noted)
    session_of(tuned, out=tmp_path / "session")
    assert groups == [(2, True)]
