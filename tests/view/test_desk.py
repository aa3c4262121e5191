import dataclasses
import threading

import numpy as np
import pytest

from cablecast.aiming.session import AimSession, Stop, StopReason
from cablecast.cast import TrialStatus
from cablecast.errors import InputError, RigError
from cablecast.rigs.make import make_rig
from cablecast.setup import Setup
from cablecast.view.desk import Desk, Phase
from cablecast.view.look import ShownCast
from cablecast.view.words import status_text
from cablecast.view.worker import WorkState

TARGET = np.array([0.3, 1.15])
LENGTH = Setup().cable.length

# The refined plan lands on its aim to this distance [m]: the model is linear in single precision,
# and the refinement stops after a few steps.
ON_AIM = 2e-3


def test_a_plan_says_what_to_expect(desk):
    preview = desk.aim(TARGET)
    assert desk.phase is Phase.PLANNED
    assert np.linalg.norm(preview.proposal.expected.mean - TARGET) < ON_AIM
    assert preview.cast.nodes is not None
    assert preview.cast.duration > preview.proposal.trajectory.duration
    assert np.all(preview.limit_shares <= 1.0)
    assert preview.margin == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("target", "words"),
    [((5.0, 0.0), "out of reach"), ((0.3,), "shape"), ("here", "must be numbers")],
)
def test_a_target_that_cannot_be_aimed_at_is_refused_and_leaves_no_plan(desk, target, words):
    desk.aim(TARGET)
    with pytest.raises(InputError, match=words):
        desk.aim(target)
    assert desk.preview is None
    assert desk.phase is Phase.READY


def test_a_cast_is_kept_with_its_landing_and_its_miss(desk, own):
    desk.aim(TARGET)
    one = desk.cast(desk.preview)
    assert desk.phase is Phase.LANDED
    assert [trial.number for trial in desk.tries] == [one.number]
    miss = one.miss_pct / 100 * LENGTH
    assert miss == pytest.approx(np.linalg.norm(own.offset), abs=ON_AIM)
    assert np.allclose(ShownCast.of_cast(one).path[-1], one.final_xy)


def test_nothing_is_planned_without_a_session_or_cast_without_a_plan(rig, own, engine, policy):
    desk = Desk(rig, engine)
    assert desk.phase is Phase.NO_MODEL
    with pytest.raises(InputError, match="no model"):
        desk.aim(TARGET)
    desk.set_session(AimSession(policy))
    assert desk.phase is Phase.READY
    with pytest.raises(InputError, match="choose a target"):
        desk.cast(desk.preview)
    assert own.cast_count == 0


def test_a_rehearsal_prepares_the_first_plan_and_leaves_no_trace(rig, engine, policy):
    desk, session = Desk(rig, engine), AimSession(policy)
    desk.open_session(session)
    assert desk.preview is None
    assert session.casts == ()
    prepared = session.predictor.beliefs.policy_candidates
    desk.aim(TARGET)
    desk.cast(desk.preview)
    desk.undo()
    # What takes longest is not computed again, also where all is learned anew.
    assert session.predictor.beliefs.policy_candidates is prepared
    assert session.predictor.casts == ()


def test_a_session_of_another_set_up_is_refused(own, engine, policy):
    slow = Setup().with_motion(v_max=1.2)
    desk = Desk(make_rig(own, slow), engine)
    with pytest.raises(InputError, match="another set-up"):
        desk.set_session(AimSession(policy))


def test_corrections_land_nearer(desk):
    # To the left of the robot, where all that is learned is mirrored.
    desk.aim(TARGET * [-1, 1])
    first = desk.cast(desk.preview).miss_pct
    for _ in range(3):
        desk.correct()
        last = desk.cast(desk.preview).miss_pct
    # The session weighs a miss by how well it repeats, and this one repeats exactly.
    assert last < 0.5 * first


def test_a_hit_is_the_end_at_its_target_and_another_one_is_offered(desk, own):
    own.offset = np.zeros(2)
    desk.aim(TARGET)
    assert desk.cast(desk.preview).hit
    desk.look_ahead()
    assert desk.phase is Phase.DONE
    assert desk.stop == ""
    other = desk.other_target()
    assert np.linalg.norm(other - TARGET) > 0.1
    desk.aim(other)
    assert desk.phase is Phase.PLANNED
    # Asked again, it is not the same.
    assert np.linalg.norm(desk.other_target() - other) > 0.1
    # The next cast leads to yet another one.
    desk.cast(desk.preview)
    yet_another = desk.other_target()
    assert min(np.linalg.norm(yet_another - xy) for xy in (TARGET, other)) > 0.1


def stop_at(proposal):
    """Return that a proposed cast is unlikely to hit."""
    nearest = proposal.expected.mean
    return Stop(proposal=proposal, reason=StopReason.UNLIKELY, nearest=nearest, is_simulated=True)


def test_a_cast_that_is_not_worth_making_is_said_after_the_one_before(desk, own):
    own.offset = np.array([-0.3, 0.2])
    desk.aim(TARGET)
    answers = iter([None, None, stop_at])
    desk.session.stop = lambda proposal: (answer := next(answers)) and answer(proposal)
    for phase in (Phase.LANDED, Phase.DONE):
        desk.cast(desk.correct() if desk.tries else desk.preview)
        desk.look_ahead()
        assert desk.phase is phase
    assert "to hit it: most likely" in status_text(desk, WorkState())
    # All the same, a person may.
    desk.session.stop = lambda proposal: None
    assert desk.correct().proposal.try_number == 3
    assert desk.phase is Phase.PLANNED


def test_only_the_plan_that_a_person_saw_is_cast(desk, own):
    seen = desk.aim(TARGET)
    desk.aim(TARGET + [0.1, -0.1])
    with pytest.raises(InputError, match="plan has changed"):
        desk.cast(seen)
    assert own.cast_count == 0
    planned = desk.preview
    desk.cast(planned)
    # A second answer to the same question.
    with pytest.raises(InputError, match="plan has changed"):
        desk.cast(planned)
    assert own.cast_count == 1


def test_what_was_said_before_a_hit_is_forgotten_and_stays_off_other_targets(desk, own):
    own.offset = np.zeros(2)
    desk.session.stop = stop_at
    desk.aim(TARGET)
    assert "to hit it: most likely" in desk.stop
    assert desk.cast(desk.preview).hit
    desk.look_ahead()
    assert desk.stop == ""
    desk.session.stop = lambda proposal: None
    desk.aim(desk.other_target())
    desk.session.stop = stop_at
    desk.look_ahead()
    assert desk.stop == ""


def test_a_stop_while_a_cast_is_taken_in_leaves_a_session_that_knows_it(desk, own, monkeypatch):
    desk.aim(TARGET)
    take_in = AimSession._add

    def stopped(*args, **kwargs):
        monkeypatch.setattr(AimSession, "_add", take_in)
        raise KeyboardInterrupt

    monkeypatch.setattr(AimSession, "_add", stopped)
    with pytest.raises(KeyboardInterrupt):
        desk.cast(desk.preview)
    assert len(desk.session.casts) == len(desk.session.predictor.casts) == 1


def test_all_tries_at_a_target_end_it(desk, own):
    own.offset = np.array([-0.3, 0.2])
    desk.session.config = dataclasses.replace(desk.session.config, tries=1, force=True)
    desk.aim(TARGET)
    desk.cast(desk.preview)
    desk.look_ahead()
    assert desk.phase is Phase.DONE
    assert desk.stop == "its only try is used"


def test_an_undone_try_teaches_nothing(desk, own):
    before = desk.aim(TARGET).proposal.expected.mean
    own.offset = np.array([-0.3, 0.2])
    one = desk.cast(desk.preview)
    desk.undo()
    assert desk.message.startswith("Try 1 is discarded")
    assert desk.is_undone(one)
    assert desk.last is None
    assert desk.tries_at(TARGET) == []
    assert np.allclose(desk.aim(TARGET).proposal.expected.mean, before)


def test_a_cast_without_a_landing_says_why(desk, own):
    own.status = TrialStatus.OFF_TABLE
    desk.aim(TARGET)
    assert np.isnan(desk.cast(desk.preview).miss_pct)
    assert "beyond the table" in desk.message


def test_nobody_casts_or_aims_while_the_arm_moves(desk, own):
    refused = []

    def disturb():
        for action in (lambda: desk.cast(seen), desk.correct, desk.undo, lambda: desk.aim(TARGET)):
            try:
                action()
            except InputError as error:
                refused.append(str(error))
        assert desk.phase is Phase.CASTING

    seen = desk.aim(TARGET)
    own.during = lambda: _in_thread(disturb)
    desk.cast(desk.preview)
    assert len(refused) == 4
    assert all("under way" in text for text in refused)
    assert own.cast_count == 1


def test_the_table_can_be_used_again_after_the_rig_failed(desk, own):
    desk.aim(TARGET)
    own.failures = 3
    with pytest.raises(RigError, match="protective stop"):
        desk.cast(desk.preview)
    assert desk.phase is Phase.PLANNED
    desk.cast(desk.preview)
    assert desk.phase is Phase.LANDED


def test_a_session_goes_on_where_it_was(open_desk, policy, tmp_path):
    desk = open_desk(AimSession(policy, out=tmp_path / "session"))
    desk.cast(desk.aim(TARGET))
    desk.cast(desk.correct())
    desk.undo()
    again = open_desk(AimSession(policy, out=tmp_path / "session"))
    assert [again.is_undone(one) for one in again.tries] == [False, True]
    for before, after in zip(desk.tries, again.tries, strict=True):
        assert before.action == after.action
        assert np.array_equal(ShownCast.of_cast(before).nodes, ShownCast.of_cast(after).nodes)
    expected = [one.aim(TARGET).proposal.expected.mean for one in (desk, again)]
    # The scales of the process are fitted anew in both, by a search with a tolerance.
    assert np.allclose(*expected, atol=ON_AIM)


def test_a_cable_that_nobody_saw_is_shown_by_its_free_end(desk, own):
    own.sees_cable = False
    desk.aim(TARGET)
    one = desk.cast(desk.preview)
    shown = ShownCast.of_cast(one)
    assert shown.nodes is None
    assert np.allclose(shown.path[-1], one.final_xy, atol=1e-6)
    assert shown.joint_path is not None


def _in_thread(action):
    thread = threading.Thread(target=action)
    thread.start()
    thread.join()
