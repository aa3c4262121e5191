"""Aiming: the first cast by the simulator, every further one by what the casts before it showed."""

import dataclasses
import itertools
import re

import numpy as np
import pytest
from tests.aiming.casts import made_up_cast
from tests.aiming.formula_rig import SETUP, FormulaRig, make_policy

import cablecast as cc
from cablecast.aiming.propose import SAME_ACTION
from cablecast.aiming.session import StopReason
from cablecast.camera.settings import CameraSettings, CameraSight
from cablecast.conventions import xy_to_polar
from cablecast.errors import InputError, RigError, TargetError
from cablecast.motion.feasibility import check_actions
from cablecast.report.words import (
    change_text,
    outlook_text,
    reason_text,
    small_step_text,
    stop_text,
)
from cablecast.task import LANDING

TARGETS = np.array([[0.3, 1.1], [-0.25, 1.2], [0.5, 1.05], [-0.5, 1.15], [0.1, 1.25]])


@pytest.fixture(scope="module")
def policy():
    return make_policy()


def session_of(policy, *, within_pct=0.01, tries=6, force=True, **options):
    config = cc.AimConfig(within_pct=within_pct, tries=tries, force=force)
    return cc.AimSession(policy, config=config, **options)


def rig_of(policy, **options):
    return cc.make_rig(FormulaRig(policy, **options), SETUP)


def expecting(proposal, **values):
    """Return a proposal with other values of its expectation."""
    return dataclasses.replace(proposal, expected=dataclasses.replace(proposal.expected, **values))


def track_to(final_xy):
    """Return a track that is seen at rest at one place, or not at all where it is NaN."""
    landed = np.all(np.isfinite(final_xy))
    return cc.EndpointTrack(
        times=np.arange(4) / 10,
        endpoint_xy=np.tile(final_xy, (4, 1)),
        status=cc.TrialStatus.OK if landed else cc.TrialStatus.OFF_TABLE,
    )


def test_corrections_bring_casts_to_the_target_within_the_scatter(policy):
    with rig_of(policy) as rig:
        session = session_of(policy, tries=5)
        result = cc.aim(session, rig, TARGETS[:3])
    first, fifth = (np.median(result.misses_pct(number)) for number in (1, 5))
    # The bias is up to 11 % of the length, equal casts scatter by 0.7 %.
    assert first > 3.0
    assert fifth < 1.5
    assert len(session.casts) == 15


def test_a_hit_is_a_hit_within_the_tolerance_of_now(policy, tmp_path):
    target = TARGETS[0]
    session = session_of(policy, within_pct=3.0, out=tmp_path)
    # 2 % of the cable's length off.
    session.observe(session.propose(target), track_to(target + [0.02 * SETUP.cable.length, 0.0]))
    assert session.is_done(target)
    (cast,) = session_of(policy, within_pct=1.0, out=tmp_path).casts_at(target)
    assert not cast.hit
    assert not session_of(policy, within_pct=1.0, out=tmp_path).is_done(target)
    assert session_of(policy, within_pct=2.5, out=tmp_path).is_done(target)


def test_a_target_is_done_once_it_is_hit(policy):
    with rig_of(policy) as rig:
        result = cc.aim(cc.AimSession(policy), rig, TARGETS)
    assert result.hit.all()
    for casts in result.casts:
        assert [cast.hit for cast in casts] == [False] * (len(casts) - 1) + [True]
        assert casts[-1].miss_pct <= 3.0
        assert [cast.try_number for cast in casts] == list(range(1, len(casts) + 1))


def test_later_targets_profit_from_earlier_ones(policy):
    line = np.stack([np.linspace(0.2, 0.5, 8), np.full(8, 1.15)], axis=1)
    with rig_of(policy) as rig:
        together = cc.aim(session_of(policy, tries=1, within_pct=3.0), rig, line).misses_pct(1)
        alone = [
            cc.aim(session_of(policy, tries=1, within_pct=3.0), rig, one).misses_pct(1)[0]
            for one in line
        ]
    assert np.median(together[4:]) < 0.6 * np.median(alone[4:])


def test_every_cast_stays_within_the_arms_limits_and_the_expected_landing_on_the_table(policy):
    edge = SETUP.workspace
    targets = np.array([[0.55, 0.9], [-0.6, 1.3], [0.0, 1.4]])
    targets = targets[edge.on_table(targets)]
    with rig_of(policy, bias=0.15) as rig:
        session = session_of(policy, tries=4, within_pct=3.0)
        cc.aim(session, rig, targets)
    actions = np.array([cast.sweep for cast in session.casts])
    assert check_actions(actions, SETUP).mask.all()
    assert edge.on_table(np.array([cast.expected_xy for cast in session.casts])).all()


def test_a_session_that_was_closed_at_any_cast_goes_on_as_if_it_had_not_been(policy, tmp_path):
    with rig_of(policy) as rig:
        casts = cc.collect(rig, count=3, seed=3)
        whole = session_of(policy, casts=casts)
        for _ in range(5):
            whole.cast(rig, whole.propose(TARGETS[0]))
            reopened = session_of(policy, casts=casts, out=tmp_path / "session")
            reopened.cast(rig, reopened.propose(TARGETS[0]))
    for live, kept in zip(whole.casts, reopened.casts, strict=True):
        np.testing.assert_array_equal(kept.final_xy, live.final_xy)
    assert [cast.try_number for cast in reopened.casts_at(TARGETS[0])] == [1, 2, 3, 4, 5]


def test_a_proposal_says_what_to_expect_before_the_cast(policy):
    session = cc.AimSession(policy)
    proposal = session.propose(r=1.15, theta_deg=-12.0)
    assert proposal.try_number == 1
    assert np.linalg.norm(proposal.expected.mean - proposal.goal.value) < 0.02
    major, minor = proposal.expected.ellipse(0.9).semi_axes
    assert major > minor > 0.0
    assert proposal.expected.ellipse(0.99).semi_axes[0] > major
    assert not session.casts


def test_the_stated_uncertainty_holds_for_first_and_for_corrected_casts(policy):
    rng = np.random.default_rng(3)
    targets = np.stack([rng.uniform(-0.5, 0.5, 20), rng.uniform(1.05, 1.25, 20)], axis=1)
    inside: dict[int, list[bool]] = {1: [], 2: []}
    with rig_of(policy) as rig:
        for target in targets:
            session = session_of(policy, tries=2)
            for cast in cc.aim(session, rig, target).casts[0]:
                inside[cast.try_number].append(cast.square < cast.proposal.expected.law.square(0.9))
    # Nine of ten, as far as 20 casts tell; a bias with a sharp bound is better than Gaussian.
    assert np.mean(inside[1]) >= 0.8
    assert np.mean(inside[2]) >= 0.8


def test_an_action_that_scatters_is_damped(policy):
    """With as much scatter as bias, a full correction would double the variance of the miss."""
    misses = []
    with rig_of(policy, bias=0.02, scatter=0.04) as rig:
        session = session_of(policy, tries=8)
        result = cc.aim(session, rig, TARGETS)
        misses = [result.misses_pct(number) for number in range(3, 9)]
    root = np.sqrt(np.mean(np.square(misses)))
    # Scatter of 4 % along each axis alone gives 5.7 %.
    assert root < 1.25 * 100 * 0.04 * np.sqrt(2)


@pytest.mark.parametrize(("drift", "noticed"), [(0.0, False), (0.02, True)])
def test_a_drift_is_noticed_and_a_steady_rig_is_not_accused(policy, drift, noticed):
    with rig_of(policy, bias=0.05, drift=drift) as rig:
        session = session_of(policy, tries=100)
        changes = []
        for number in range(34):
            proposal = session.propose(TARGETS[number % 3])
            changes.append(change_text(session.cast(rig, proposal), session))
    assert any("has changed" in change for change in changes) is noticed
    assert bool(session.predictor.experience.drifts) is noticed


def test_a_cast_without_a_landing_leads_to_another_action(policy):
    with rig_of(policy, hidden=True) as rig:
        session = session_of(policy, tries=3, within_pct=3.0)
        result = cc.aim(session, rig, TARGETS[:1])
    casts = result.casts[0]
    assert [cast.status.code for cast in casts] == ["occluded"] * 3
    assert np.isnan([cast.miss_pct for cast in casts]).all()
    assert not np.allclose(casts[0].sweep, casts[1].sweep)
    assert "avoided" in change_text(casts[0], session)


@pytest.mark.parametrize(("gap", "said"), [(0.01, False), (0.2, True)])
def test_a_target_that_a_search_reaches_is_not_said_to_be_out_of_reach(gap, said):
    cast = made_up_cast((0.3, 1.0), target=(0.3, 1.0), expected=(0.3 + gap, 1.0))
    proposal = dataclasses.replace(cast.proposal, inside_coverage=False)
    assert ("no simulated cast of this cable lands near" in outlook_text(proposal)) == said
    half = 100 * SETUP.cable.length * proposal.expected.miss_within(proposal.goal, 0.5)
    assert f"most likely {half:.1f} cm off the target" in outlook_text(proposal)


def test_a_proposal_that_is_not_the_next_cast_is_refused(policy):
    with rig_of(policy) as rig:
        session = cc.AimSession(policy)
        first, second = session.propose(TARGETS[0]), session.propose(TARGETS[1])
        session.cast(rig, first)
        with pytest.raises(InputError, match="cast 0 of the session, whose next cast is 1"):
            session.cast(rig, second)
    assert len(rig.rig.actions) == 1


def test_the_lab_file_of_the_rig_may_name_robot_and_camera(policy):
    setup = dataclasses.replace(SETUP, camera=CameraSettings(source="0"))
    with cc.make_rig(FormulaRig(policy), setup) as rig:
        session = session_of(policy, tries=1, within_pct=3.0)
        cc.aim(session, rig, TARGETS[0])
        assert len(session.casts) == 1


def test_a_rig_that_fails_keeps_the_casts_before(policy, tmp_path):
    class BrokenRig(FormulaRig):
        def execute(self, trajectory):
            if len(self.actions) >= 2:
                raise RuntimeError("the gripper is open")
            return super().execute(trajectory)

    with cc.make_rig(BrokenRig(policy), SETUP) as rig:
        session = session_of(policy, out=tmp_path)
        with pytest.raises(RigError, match=r"cast 2 failed 3 times.*the gripper is open"):
            cc.aim(session, rig, TARGETS)
    assert len(cc.AimSession(policy, out=tmp_path).casts) == 2


def test_bad_targets_and_settings_are_refused(policy, tmp_path):
    session = cc.AimSession(policy)
    with pytest.raises(TargetError):
        session.propose(r=9.0, theta_deg=0.0)
    with pytest.raises(InputError, match="one target, not 2"):
        session.propose(TARGETS[:2])
    for name in ("within_pct", "tries", "simulated_count", "candidate_count", "epochs"):
        with pytest.raises(InputError, match=f"{name} = 0"):
            cc.AimConfig(**{name: 0})
    with pytest.raises(InputError, match="at least 2 casts"):
        cc.AimConfig(calibration_count=1)
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"holds notes\.txt"):
        cc.AimSession(policy, out=tmp_path)
    other = cc.make_rig(FormulaRig(policy), SETUP.with_motion(v_max=1.2))
    with pytest.raises(InputError, match="another set-up"):
        session.cast(other, session.propose(TARGETS[0]))
    model = dataclasses.replace(policy.model, info=policy.model.info | {"adaptation": {}})
    with pytest.raises(InputError, match="learns from real casts itself"):
        cc.AimSession(dataclasses.replace(policy, model=model))


def test_a_target_that_the_camera_is_blind_at_is_aimed_past(policy):
    target, radius = TARGETS[0], 0.1
    sight = CameraSight(position=(0.0, 0.7, 2.2), blind=((*target, radius),))
    rig = FormulaRig(policy)
    session = cc.AimSession(policy)
    straight = session.propose(target)
    assert "marker" not in reason_text(straight, session)
    session.look(cc.make_rig(rig, SETUP))
    assert session.sight is None
    rig.sight = lambda: sight
    with cc.make_rig(rig, SETUP) as checked:
        session.look(checked)
        past = session.propose(target)
        assert "cannot tell the marker at the target" in reason_text(past, session)
        session.cast(checked, past)
    assert session.sight is sight
    assert np.linalg.norm(straight.expected.mean - target) < 0.1 * radius
    assert 0.9 * radius < np.linalg.norm(past.expected.mean - target) < 3.0 * radius


def test_a_cast_is_kept_where_the_camera_fails_after_it(policy):
    def fail():
        raise OSError("unplugged")

    rig = FormulaRig(policy)
    rig.sight = fail
    session = cc.AimSession(policy)
    with cc.make_rig(rig, SETUP) as checked:
        with pytest.warns(UserWarning, match="after cast 0, and the next cast relies on its sight"):
            session.cast(checked, session.propose(TARGETS[0]))
        with pytest.raises(RigError, match="sight failed: OSError: unplugged"):
            session.look(checked)
    assert len(session.casts) == 1


def test_an_action_that_would_lose_its_landing_leaves_its_place_to_another(policy, monkeypatch):
    usual = cc.AimSession(policy).propose(TARGETS[0])
    action, end = usual.action.to_array(), usual.trajectory.grip_path

    def lost_like_the_usual(paths, *_):
        last, there = (path.evaluate(path.duration[:, None])[:, 0] for path in (paths, end))
        return np.where(np.abs(last - there).max(axis=1) < 0.05, 0.9, 0.0)

    monkeypatch.setattr("cablecast.aiming.propose.lost_chance", lost_like_the_usual)
    other = cc.AimSession(policy).propose(TARGETS[0])
    assert np.abs(other.action.to_array() - action).max() >= 0.05
    assert other.expected.failure < 0.05
    assert np.linalg.norm(other.expected.mean - TARGETS[0]) < 0.03


def test_a_cast_that_was_taken_back_counts_for_nothing(policy, tmp_path):
    with rig_of(policy) as rig:
        plain = session_of(policy, out=tmp_path / "plain")
        plain.cast(rig, plain.propose(TARGETS[0]))
        session = session_of(policy, tries=2, out=tmp_path / "undone")
        session.cast(rig, session.propose(TARGETS[0]))
        second = session.cast(rig, session.propose(TARGETS[0]))
        assert session.is_done(TARGETS[0])
        assert session.undo() is second
        assert [cast.try_number for cast in session.casts_at(TARGETS[0])] == [1]
        assert not session.is_done(TARGETS[0])
        with pytest.raises(InputError, match="no such cast"):
            session.undo(1)
    expected = plain.predictor.predict(second.sweep)[0]
    again = session_of(policy, tries=2, out=tmp_path / "undone")
    assert again.undone == {1}
    for kept in (session, again):
        np.testing.assert_array_equal(kept.predictor.predict(second.sweep)[0], expected)
        assert len(kept.casts) == 2
    with pytest.raises(InputError, match="no such cast"):
        cc.AimSession(policy).undo()


def test_a_target_that_no_simulated_cast_comes_near_is_not_cast_at(policy):
    # The policy's candidates reach to 1.48 m; the table and the cable allow 1.5.
    targets, stopped = [(0.3, 1.1), (1.0, 0.3)], []
    with rig_of(policy) as rig:
        session = session_of(policy, within_pct=3.0, force=False)
        result = cc.aim(session, rig, targets, on_stop=stopped.append)
        assert [len(casts) > 0 for casts in result.casts] == [True, False]
        assert result.stops[0] is None
        assert stopped == [result.stops[1]]
        assert result.stops[1].is_simulated
        assert "no simulated cast" in stop_text(result.stops[1])
        assert "nearest landing of a simulated cast is r = " in stop_text(result.stops[1])
        np.testing.assert_allclose(result.misses_pct(1)[1], np.nan)
        always = cc.AimSession(policy, config=cc.AimConfig(force=True, tries=2))
        result = cc.aim(always, rig, targets[1])
    assert len(result.casts[0]) == 2
    assert result.stops == (None,)


def test_casts_end_where_the_next_one_is_nearly_certain_to_miss(policy):
    # At the edge of what the arm can do corrections bring the cast ever less nearer.
    edge = policy.predicted_xy[np.argmax(policy.predicted_xy[:, 1])] + [0.0, 0.012]
    with rig_of(policy, bias=0.0, scatter=0.001) as rig:
        session = session_of(policy, within_pct=0.3, force=False)
        result = cc.aim(session, rig, edge)
    assert 1 <= len(result.casts[0]) < 6
    assert "has a chance of" in stop_text(result.stops[0])


def test_casts_end_where_two_missed_far_in_one_direction_and_a_hit_is_unlikely(policy):
    target = np.array([0.3, 1.1])

    def stop_after(*offsets, **expected):
        session = session_of(policy, force=False)
        for offset in offsets:
            session.observe(session.propose(target), track_to(target + offset))
        return session.stop(expecting(session.propose(target), mean=target, **expected))

    wide = {"covariance": np.eye(2)}
    stop = stop_after([0.12, 0.0], [0.11, 0.02], **wide)
    assert stop.reason is StopReason.IN_VAIN
    assert "missed far in one direction" in stop_text(stop)
    # In another direction, much nearer, near, or where the next one may well hit.
    assert stop_after([0.12, 0.0], [-0.11, 0.02], **wide) is None
    assert stop_after([0.18, 0.0], [0.1, 0.0], **wide) is None
    assert stop_after([0.05, 0.0], [0.05, 0.0], **wide) is None
    sharp = stop_after([0.12, 0.0], [0.11, 0.02], covariance=1e-12 * np.eye(2))
    assert sharp is None


def test_a_small_correction_of_a_large_miss_says_why(policy):
    target = np.array([0.3, 1.1])
    session = session_of(policy)
    cast = session.observe(session.propose(target), track_to(target + [0.2, 0.0]))
    proposal = session.propose(target)
    for mean, words in (
        (target, "it is expected to move the landing by 20 cm"),
        (target + [0.19, 0.0], "nothing that the arm can do is expected to land much nearer"),
    ):
        text = small_step_text(expecting(proposal, mean=mean), cast)
        assert text == f", a small change after a miss of 20 cm: {words}"
    near = session.observe(session.propose(target), track_to(target + [0.02, 0.0]))
    assert small_step_text(proposal, near) == ""


def test_no_cast_is_made_twice_at_a_target(policy):
    # Beyond what the arm can do, the best cast would be an earlier one again.
    beyond = policy.predicted_xy[np.argmax(policy.predicted_xy[:, 1])] + [0.0, 0.019]
    with rig_of(policy, bias=0.0, scatter=0.001) as rig:
        casts = cc.aim(session_of(policy), rig, beyond).casts[0]
    assert len(casts) == 6
    for one, other in itertools.combinations([cast.sweep for cast in casts], 2):
        assert np.any(np.abs(one - other) > SAME_ACTION)


def test_a_third_cast_that_will_hardly_hit_is_made_only_where_it_is_expected_nearer(policy):
    target = np.array([0.3, 1.1])
    session = session_of(policy, within_pct=1.0, force=False)
    missed = np.array([0.03, 0.05])
    # A cast at another target landed nearer: it does not count.
    session.observe(session.propose(target + 0.2), track_to(target + 0.1 * missed))
    session.observe(session.propose(target), track_to(target + missed))
    # Stated so widely that hits are unlikely, as after a cast that missed by more than was stated.
    proposal = session.propose(target)
    law = dataclasses.replace(proposal.expected.law, scale=1.0)
    wide = expecting(proposal, covariance=np.eye(2), law=law, scatter=0.002)
    nearer, hardly = (expecting(wide, mean=target + share * missed) for share in (0.7, 0.8))
    scattered = expecting(nearer, scatter=np.linalg.norm(missed))
    likely = expecting(hardly, covariance=missed @ missed * np.eye(2))
    likely = dataclasses.replace(likely, goal=dataclasses.replace(likely.goal, within_pct=40.0))
    assert session.stop(hardly) is None
    session.observe(session.propose(target), track_to(target + 2.0 * missed))
    assert max(one.hit_chance for one in (nearer, hardly, scattered)) < 0.1 < likely.hit_chance
    assert session.stop(nearer) is session.stop(likely) is None
    r, theta = xy_to_polar(target + missed)
    place = f"cast is r = {r:.2f} m, theta = {np.degrees(theta):.1f} deg"
    for one in (hardly, scattered):
        stop = session.stop(one)
        assert stop.reason is StopReason.UNLIKELY
        assert "has a chance of" in stop_text(stop)
        assert f"the nearest landing of a {place}" in stop_text(stop)
    # At another target the first cast is judged by what is simulated.
    assert session_of(policy).stop(hardly) is None


def test_three_casts_in_a_row_that_come_no_nearer_are_the_last_at_a_target(policy):
    target = np.array([0.3, 1.1])
    session, offsets = session_of(policy, force=False), [0.2, -0.1, 0.3, -0.15, 0.12]
    stops = []
    for offset in offsets:
        proposal = session.propose(target)
        # Whatever is expected of them.
        proposal = expecting(proposal, mean=target, covariance=1e-4 * np.eye(2))
        stops.append(session.stop(proposal))
        session.observe(proposal, track_to(target + [offset, 0.0]))
    assert stops == [None] * 5
    stop = session.stop(session.propose(target))
    assert stop.reason is StopReason.STUCK
    assert "none of the last 3 casts came nearer" in stop_text(stop)
    session.undo()
    stop = session.stop(session.propose(target))
    assert stop is None or stop.reason is not StopReason.STUCK


def test_a_cast_that_was_stopped_while_it_was_learned_from_is_learned_from(policy, monkeypatch):
    session = session_of(policy)
    first = session.propose(TARGETS[0])

    def stopped(*_, **__):
        monkeypatch.undo()
        raise KeyboardInterrupt

    monkeypatch.setattr("cablecast.aiming.predictor.LandingPredictor.with_casts", stopped)
    with pytest.raises(KeyboardInterrupt):
        session.observe(first, track_to(TARGETS[0] + 0.1))
    assert len(session.casts) == len(session.predictor.casts) == 1
    session.observe(session.propose(TARGETS[0]), track_to(TARGETS[0]))
    assert len(session.predictor.casts) == 2


def test_three_casts_without_a_landing_are_the_last_at_a_target(policy):
    target, session = np.array([0.3, 1.1]), session_of(policy, force=False)
    for _ in range(3):
        assert session.stop(session.propose(target)) is None
        session.observe(session.propose(target), track_to([np.nan, np.nan]))
    stop = session.stop(session.propose(target))
    assert stop.reason is StopReason.STUCK
    words = r"none of the last 3 casts has a landing, though a simulated one lands 0\.\d cm off"
    assert re.search(words, stop_text(stop))


def test_a_place_that_would_count_as_hit_is_no_place_without_simulated_casts(policy):
    length, target = SETUP.cable.length, np.array([0.3, 1.1])
    gap = np.linalg.norm(policy.nearest_landing(target) - target) / length
    assert policy.inside_coverage(target, 100.0 * gap + 1e-6)
    assert not policy.inside_coverage(target, 100.0 * gap - 1e-6)


def test_a_cast_that_left_the_table_says_where_such_casts_go(policy):
    target, edge = np.array([0.9, 1.0]), SETUP.workspace.half_width
    session = session_of(policy, within_pct=1.0)
    proposal = session.propose(target)
    # Seen last 25 cm before the edge, where it goes on by 10 cm from sample to sample.
    way = np.array([[0.0, 1.2], [edge - 0.35, 1.1], [edge - 0.25, 1.1], [np.nan, np.nan]])
    track = cc.EndpointTrack(
        times=np.arange(4) / 10, endpoint_xy=way, status=cc.TrialStatus.OFF_TABLE
    )
    before = session.predictor.predict(proposal.action.to_array())[0][0]
    cast = session.observe(proposal, track)
    np.testing.assert_allclose(cast.read(LANDING, SETUP.workspace), [edge + 0.05, 1.1])
    assert not cast.landed
    assert cast.square > 10.0
    moved = session.predictor.predict(proposal.action.to_array())[0][0] - before
    share = moved @ (cast.read(LANDING, SETUP.workspace) - before)
    assert share > 0.7 * np.sum((cast.read(LANDING, SETUP.workspace) - before) ** 2)
    assert session.propose(target).expected.law.scale > proposal.expected.law.scale


def test_the_chance_to_hit_is_the_share_of_the_stated_law(policy):
    proposal = dataclasses.replace(session_of(policy, within_pct=3.0).propose((0.3, 1.1)))
    rng = np.random.default_rng(0)
    for offset in (0.0, 0.02, 0.1):
        moved = expecting(proposal, mean=proposal.goal.value + [offset, 0.0])
        squares = np.array(
            [moved.expected.law.square(share) for share in rng.uniform(0.01, 0.9999, 4000)]
        )
        angles = rng.uniform(0.0, 2.0 * np.pi, squares.size)
        unit = np.sqrt(squares)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        landings = moved.expected.mean + unit @ np.linalg.cholesky(moved.expected.spread).T
        share = np.mean(
            np.linalg.norm(landings - moved.goal.value, axis=1) <= 0.03 * SETUP.cable.length
        )
        np.testing.assert_allclose(
            moved.hit_chance, (1.0 - moved.expected.failure) * share, rtol=0, atol=0.03
        )
