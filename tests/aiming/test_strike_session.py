"""A session of strikes: what it knows after each swing, keeps, and says before it."""

import dataclasses

import numpy as np
import pytest

from cablecast.aiming.config import AimConfig
from cablecast.aiming.strike_session import StrikeSession, check_reach, sampled
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.data.store import CastStore
from cablecast.engines.swing import SAMPLE_DT
from cablecast.errors import InputError, TargetError
from cablecast.motion.joint_move import JointMove, JointMoves
from cablecast.motion.trajectory import JointPath
from cablecast.pipeline.aim import aim
from cablecast.pipeline.strike import check_strike, prepare_strike
from cablecast.rigs.engine import RigSwing
from cablecast.rigs.make import make_rig
from cablecast.runs.progress import ignore
from cablecast.setup import Setup, StrikeConfig
from cablecast.task import STRIKE

SETUP = Setup(strike=StrikeConfig(watch_time=1.6))
TARGET = (1.2, 0.9)
FEW = {"move_count": 128, "cable_count": 4, "progress": ignore}
# A cable that its file describes within what a person gets wrong.
TRUE = dataclasses.replace(
    SETUP.cable,
    params=dataclasses.replace(
        SETUP.cable.params,
        bend_stiffness=5e-4,
        twist_stiffness=5e-4,
        mass=0.057,
        drag_coefficient=1.1,
        drag_ratio=0.2,
        damping_time=0.05,
    ),
)
# Servos of a quarter of a radian's lag at speed, as real ones have.
LAG = 0.06


class RigLate(RigSwing):
    """Swings with an arm that is late by a constant time, which its joints show."""

    def execute(self, trajectory):
        path = trajectory.joint_path
        times = np.arange(0.0, path.times[-1] + 0.5, 0.008)
        q = np.stack([np.interp(times - LAG, path.times, q) for q in path.q.T], axis=1)
        late = JointPath(times=times, q=q, qd=np.gradient(q, times, axis=0))
        self.model = dataclasses.replace(self.model, respond=_late)
        return dataclasses.replace(super().execute(trajectory), joint_path=late)


def _late(q, dt):
    ticks = np.arange(q.shape[-2]) * dt
    return np.stack([[np.interp(ticks - LAG, ticks, one) for one in row.T] for row in q]).swapaxes(
        1, 2
    )


@pytest.fixture
def rig():
    return make_rig(RigSwing(SETUP, TRUE, segment_count=16), SETUP)


@pytest.fixture(scope="module")
def prior():
    """Return simulated swings, which all sessions begin with."""
    return opened(make_rig(RigSwing(SETUP, TRUE), SETUP)).prior


@pytest.fixture
def session(prior):
    return StrikeSession(SETUP, prior, config=CONFIG)


CONFIG = AimConfig(within_pct=2.0)


def opened(rig, out=None, **options):
    return prepare_strike(rig, CONFIG, out=out, **(FEW | options))


def test_a_target_is_struck_within_three_tries_and_the_next_profits(rig, session):
    assert session.refit_due is None
    result = aim(session, rig, [TARGET, (1.0, 1.3)], progress=ignore)
    assert result.hit.all()
    assert [len(casts) <= 3 for casts in result.casts] == [True, True]
    assert session.posterior is not None
    proposals = [cast.proposal for cast in session.casts]
    assert [one.number for one in proposals] == list(range(len(proposals)))
    assert all(0.0 <= one.hit_chance <= 1.0 for one in proposals)
    assert isinstance(proposals[0].action, JointMove)


def test_the_lag_of_the_arm_is_learned_from_the_joints_that_it_reports(session):
    late = make_rig(RigLate(SETUP, TRUE, segment_count=16), SETUP)
    (goal,) = session.goals(TARGET)
    session.cast(late, session.propose(goal))
    respond = session.prior.model.respond
    assert respond is not None
    moves = JointMoves.of(SETUP)
    q, _ = moves.angles(np.array([[0.5, 0.5, 0.3]]), SAMPLE_DT * np.arange(150))
    np.testing.assert_allclose(respond(q, SAMPLE_DT), _late(q, SAMPLE_DT), atol=0.02)


def test_a_swing_that_was_discarded_tells_nothing_of_cable_and_arm(prior, tmp_path):
    late = make_rig(RigLate(SETUP, TRUE, segment_count=16), SETUP)
    session = StrikeSession(SETUP, prior, out=tmp_path, config=CONFIG)
    (goal,) = session.goals(TARGET)
    first = session.propose(goal)
    swing = session.cast(late, first)
    assert session.propose(goal).action != first.action
    assert session.undo() is swing
    again = StrikeSession(SETUP, prior, out=tmp_path, config=CONFIG)
    for kept in (session, again):
        assert kept.undone == {0}
        assert kept.prior is prior
        assert kept.posterior is None
        assert kept.propose(goal).action == first.action
    with pytest.raises(InputError, match="no such cast"):
        session.undo()


def test_a_session_that_is_opened_again_knows_its_swings(rig, tmp_path):
    session = opened(rig, tmp_path)
    (goal,) = session.goals(TARGET)
    session.cast(rig, session.propose(goal))
    expected = session.propose(goal)
    again = opened(rig, tmp_path)
    assert len(again.casts) == 1
    first, stored = session.casts[0], again.casts[0]
    np.testing.assert_array_equal(stored.track.path, first.track.path)
    np.testing.assert_array_equal(stored.outcome, first.outcome)
    assert stored.action == first.action
    assert stored.proposal.expected.law == first.proposal.expected.law
    # It is fitted anew, from the same swings.
    proposed = again.propose(goal)
    assert proposed.number == expected.number == 1
    assert proposed.action.speed == pytest.approx(expected.action.speed, abs=1.0)
    # These are swings of strikes, in three dimensions.
    with pytest.raises(InputError):
        CastStore(Setup(), tmp_path / "session", STRIKE)
    flat = dataclasses.replace(first.track, endpoint_z=None)
    with pytest.raises(InputError, match="needs the height of the tip"):
        session.observe(expected, flat)


def test_simulated_swings_whose_file_is_damaged_are_simulated_anew(rig, tmp_path):
    few = {"move_count": 16, "cable_count": 1}
    units = opened(rig, tmp_path, **few).prior.units
    file = tmp_path / "prior.npz"
    whole = file.read_bytes()
    for content in (b"", whole[: len(whole) // 2]):
        file.write_bytes(content)
        np.testing.assert_array_equal(opened(rig, tmp_path, **few).prior.units, units)
        assert len(file.read_bytes()) == len(whole)


def test_a_swing_that_was_not_seen_is_not_made_again(session):
    (goal,) = session.goals(TARGET)
    for _ in range(2):
        unseen = EndpointTrack.unseen(TrialStatus.OCCLUDED)
        session.observe(session.propose(goal), unseen)
    lost = [cast.action for cast in session.casts]
    assert len({*lost, session.propose(goal).action}) == 3
    assert session.casts[0].track.path.shape == (1, 3)


def test_what_cannot_be_struck_is_refused_with_the_nearest_point_that_can(session):
    (goal,) = session.goals([2.6, 0.9])
    with pytest.raises(TargetError, match=r"2\.60 m ahead, 0\.90 m high cannot be struck") as error:
        check_reach(session.prior, goal, session.plane)
    assert "the nearest point that a swing of this cable passes is 1." in str(error.value)
    check_reach(session.prior, session.goals(TARGET)[0], session.plane)


def test_a_check_says_where_swings_pass_before_any_is_made(monkeypatch):
    monkeypatch.setattr("cablecast.pipeline.strike.CHECK_MOVES", 64)
    monkeypatch.setattr("cablecast.pipeline.strike.CHECK_CABLES", 2)
    found = check_strike(SETUP)
    assert "swings of this cable pass" in found.summary
    assert "a swing passes there" in found.words_at(TARGET)
    assert "cannot be struck" in found.words_at((3.0, 3.0))
    low, high = found.envelope
    points = found.prior.tips.reshape(-1, 3)
    points = points[np.isfinite(points[:, 0])]
    assert np.all((points > low) & (points < high))


def track(times, seen=None, status=TrialStatus.OK):
    times = np.array(times, dtype=float)
    path = np.stack([times, 2.0 * times, 3.0 * times], axis=1)
    if seen is not None:
        path[~np.array(seen)] = np.nan
    return EndpointTrack(times=times, endpoint_xy=path[:, :2], endpoint_z=path[:, 2], status=status)


def test_a_track_is_sampled_on_the_engine_s_times_and_ends_at_a_gap():
    tip = sampled(track(np.arange(0.0, 0.2, 0.008)))
    np.testing.assert_allclose(tip[:, 0], SAMPLE_DT * np.arange(len(tip)), atol=1e-12)
    one_lost = sampled(track([0.0, 0.01, 0.02, 0.03, 0.04], [True, True, False, True, True]))
    np.testing.assert_allclose(one_lost[:, 2], 0.03 * np.arange(5), atol=1e-12)
    assert len(sampled(track([0.0, 0.01, 0.02, 0.2, 0.21]))) == 3
    assert len(sampled(track([0.0, 0.1], status=TrialStatus.NON_FINITE))) == 0


def test_a_swing_beyond_the_ranges_of_the_lab_file_is_no_swing_of_it():
    moves = JointMoves.of(SETUP)
    fast = dataclasses.replace(moves.move([0.5, 0.5, 0.5]), speed=9.0)
    with pytest.raises(InputError, match="beyond the ranges of speed and turns"):
        moves.unit_of(fast)
    unit = np.array([0.2, 0.7, 0.4])
    np.testing.assert_allclose(moves.unit_of(moves.move(unit)), unit)
    with pytest.raises(InputError, match="no mirror image"):
        fast.mirrored()
