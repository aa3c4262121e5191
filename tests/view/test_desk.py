import dataclasses
import threading

import numpy as np
import pytest

from cablecast.errors import InputError, RigError, TargetError
from cablecast.runs.parts import Parts
from cablecast.setup import Setup
from cablecast.track import TrialStatus
from cablecast.view.desk import Desk, Phase
from cablecast.view.tries import TryStore

TARGET = np.array([0.3, 1.15])

# The refined plan lands on its aim to this distance [m]: the model is linear in single precision,
# and the refinement stops after a few steps.
ON_AIM = 1e-3


@pytest.fixture
def desk(rig, engine, policy):
    return Desk(rig, Setup(), engine, policy=policy)


def test_a_plan_says_what_to_expect(desk):
    preview = desk.aim(TARGET)
    assert desk.phase is Phase.PLANNED
    assert np.linalg.norm(preview.predicted_xy - TARGET) < ON_AIM
    assert preview.cast.nodes is not None
    assert preview.cast.duration > preview.trajectory.duration
    assert np.all(preview.limit_shares <= 1.0)
    assert preview.margin == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ((5.0, 0.0), "out of reach"),
        ((np.nan, 1.0), "not finite"),
        ((0.3, -0.2), "off the table"),
        ((0.3,), "shape"),
        ("here", "could not convert"),
    ],
)
def test_a_target_that_cannot_be_aimed_at_is_refused_and_changes_nothing(desk, target, words):
    before = desk.aim(TARGET)
    with pytest.raises((TargetError, ValueError), match=words):
        desk.aim(target)
    assert desk.preview is before


def test_a_cast_is_kept_with_its_landing_and_its_miss(desk, rig):
    desk.aim(TARGET)
    one = desk.cast()
    assert desk.phase is Phase.LANDED
    assert desk.tries == [one]
    assert one.miss == pytest.approx(np.linalg.norm(rig.offset), abs=ON_AIM)


def test_nothing_is_cast_before_it_is_planned(desk, rig):
    with pytest.raises(InputError, match="choose a target"):
        desk.cast()
    assert rig.cast_count == 0


def test_without_a_model_nothing_can_be_planned(rig, engine, policy):
    desk = Desk(rig, Setup(), engine)
    assert desk.phase is Phase.NO_MODEL
    with pytest.raises(InputError, match="no model"):
        desk.aim(TARGET)
    desk.set_model(policy)
    assert desk.phase is Phase.READY


def test_a_model_of_another_set_up_is_refused(rig, engine, policy):
    desk = Desk(rig, Setup().with_motion(v_max=1.2), engine)
    with pytest.raises(InputError, match="another set-up"):
        desk.set_model(policy)


def test_each_correction_lands_nearer(desk):
    desk.aim(TARGET)
    misses = [desk.cast().miss]
    for _ in range(3):
        desk.correct()
        misses.append(desk.cast().miss)
    # The first gain is 0.94 of the offset; what is left shrinks with every try.
    assert misses[1] < 0.1 * misses[0]
    assert misses[3] < 0.02 * misses[0]


def test_a_correction_on_the_left_half_lands_nearer_too(desk):
    desk.aim(TARGET * [-1, 1])
    first = desk.cast().miss
    desk.correct()
    assert desk.cast().miss < 0.1 * first


def test_an_undone_try_teaches_nothing(desk, rig):
    desk.aim(TARGET)
    desk.cast()
    rig.offset = np.array([-0.3, 0.2])
    desk.cast()
    desk.undo()
    aim = desk.correct().aim_xy
    assert [one.undone for one in desk.tries] == [False, True]
    assert aim[0] < TARGET[0]
    assert aim[1] > TARGET[1]


def test_a_miss_without_a_landing_corrects_nothing(desk, rig):
    rig.status = TrialStatus.OFF_TABLE
    desk.aim(TARGET)
    one = desk.cast()
    assert np.isnan(one.miss)
    assert "left the table" in desk.message
    with pytest.raises(InputError, match="came to rest"):
        desk.correct()


def test_nobody_casts_or_aims_while_the_arm_moves(desk, rig):
    refused = []

    def disturb():
        for action in (desk.cast, desk.correct, desk.undo, lambda: desk.aim(TARGET)):
            try:
                action()
            except InputError as error:
                refused.append(str(error))
        assert desk.phase is Phase.CASTING

    desk.aim(TARGET)
    rig.during = lambda: _in_thread(disturb)
    desk.cast()
    assert len(refused) == 4
    assert all("under way" in text for text in refused)
    assert rig.cast_count == 1


def test_the_table_can_be_used_again_after_the_rig_failed(desk, rig):
    desk.aim(TARGET)
    rig.failure = RigError("the arm stopped: protective stop")
    with pytest.raises(RigError, match="protective stop"):
        desk.cast()
    assert desk.phase is Phase.PLANNED
    desk.cast()
    assert desk.phase is Phase.LANDED


def test_a_session_goes_on_where_it_was(rig, engine, policy, tmp_path):
    store = TryStore(Parts(tmp_path))
    desk = Desk(rig, Setup(), engine, policy=policy, store=store)
    desk.aim(TARGET)
    desk.cast()
    desk.correct()
    desk.cast()
    desk.undo()
    again = Desk(rig, Setup(), engine, policy=policy, store=TryStore(Parts(tmp_path)))
    assert [one.undone for one in again.tries] == [False, True]
    assert again.message == ""
    for before, after in zip(desk.tries, again.tries, strict=True):
        assert np.array_equal(before.action, after.action)
        assert after.cast.status is TrialStatus.OK
        # Shapes are stored to a tenth of a millimetre.
        assert np.allclose(before.cast.nodes, after.cast.nodes, atol=6e-5)
    aim = again.correct().aim_xy
    assert np.allclose(aim, desk.correct().aim_xy, atol=1e-6)


def test_a_cast_that_the_process_did_not_survive_is_said(rig, engine, policy, tmp_path):
    class Killed(BaseException):
        pass

    desk = Desk(rig, Setup(), engine, policy=policy, store=TryStore(Parts(tmp_path)))
    desk.aim(TARGET)
    rig.failure = Killed()
    with pytest.raises(Killed):
        desk.cast()
    again = Desk(rig, Setup(), engine, policy=policy, store=TryStore(Parts(tmp_path)))
    assert again.tries == []
    assert "x = 0.300, y = 1.150 m was cut off" in again.message


def test_the_simulated_cast_follows_the_parameters(desk):
    preview = desk.aim(TARGET)
    slippery = dataclasses.replace(desk.params, lateral_friction=0.05)
    other = desk.simulate(preview.trajectory, slippery)
    ends = [cast.endpoint_xy[-1] for cast in (preview.cast, other)]
    assert np.linalg.norm(ends[0] - ends[1]) > 0.01


def _in_thread(action):
    thread = threading.Thread(target=action)
    thread.start()
    thread.join()
