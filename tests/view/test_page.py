"""The page without a browser: what its buttons call, against a server that nobody looks at."""

import dataclasses
import threading
import types

import numpy as np
import pytest
from tests.view.conftest import drain

from cablecast.aiming.predictor import Beliefs
from cablecast.aiming.session import AimSession
from cablecast.camera.settings import CameraSight
from cablecast.errors import InputError
from cablecast.runs.progress import Progress
from cablecast.view.desk import Desk, Phase
from cablecast.view.look import ShownCast
from cablecast.view.page import Page, shrunk
from cablecast.view.scene import LIFT
from cablecast.view.words import try_name
from cablecast.view.worker import Worker

pytest.importorskip("viser")

TARGET = np.array([0.3, 1.15])


class Learning:
    """Stands for a fit: returns the same policy after some reports, or is stopped in between."""

    def __init__(self, policy):
        self.policy, self.counts, self.error = policy, [], None

    def __call__(self, store, report):
        report(Progress(task="2/4 fit", done=1, total=4))
        if self.error is not None:
            raise self.error
        self.counts.append((len(store.dataset()), len(store)))
        return Beliefs(policy=self.policy, fitted_to=len(store))


@pytest.fixture
def learning(policy):
    return Learning(policy)


@pytest.fixture
def page(open_desk, policy, learning, tmp_path):
    session = AimSession(policy, out=tmp_path / "session", refitting=learning)
    opened = Page(open_desk(session), Worker(), lambda report: None, tmp_path, port=0)
    yield opened
    opened.close()


def cast_at_target(page):
    page.aim(TARGET)
    page.cast()
    drain(page.worker)


def test_point_cast_correct_replay_undo(page, drawn):
    desk = page.desk
    page.aim(TARGET)
    assert desk.message == ""
    assert desk.phase is Phase.PLANNED
    assert [field.value for field in page._target_fields] == [1.188, 14.6]
    page.cast()
    drain(page.worker)
    assert page.worker.state.message == ""
    assert desk.phase is Phase.LANDED
    page.correct()
    drain(page.worker)
    assert [one.try_number for one in desk.tries] == [1, 2]
    # A person who saw the first cast only, in another tab, corrects nothing.
    page.correct(desk.tries[0])
    drain(page.worker)
    assert "there was another cast meanwhile" in page.worker.state.message
    assert len(desk.tries) == 2
    page.replay(try_name(desk.tries[0], desk))
    assert page.stage.player.duration == pytest.approx(ShownCast.of_cast(desk.tries[0]).duration)
    page.undo()
    assert "discarded" in desk.message
    assert "/marks/expected" not in drawn(page.server)
    page.aim(page.desk.task.from_typed(1.2, -20.0))
    assert desk.phase is Phase.PLANNED
    assert desk.preview.proposal.goal.value[0] < 0


def test_a_fit_to_all_casts_is_long_work_that_leaves_out_what_was_undone(page, learning):
    desk = page.desk
    for _ in range(3):
        cast_at_target(page)
    page.undo()
    learning.error = InputError("no disk")
    page.refit()
    assert page.worker.state.name == "a fit to all casts"
    drain(page.worker)
    assert page.worker.state.message == "no disk"
    assert desk.session.fitted_count == 0
    learning.error = None
    page.refit()
    drain(page.worker)
    assert page.worker.state.message == ""
    assert learning.counts == [(2, 3)]
    assert desk.session.fitted_count == len(desk.session.predictor.casts) == 2
    assert "fits 2 casts" in desk.message
    assert desk.phase is Phase.READY


def test_a_target_that_is_planned_as_the_new_fit_comes_stays_planned(page, learning, drawn):
    desk = page.desk
    for _ in range(2):
        cast_at_target(page)
    rehearse = desk.task.rehearse

    def rehearsed(session):
        rehearse(session)
        page.aim(page.desk.task.from_typed(1.2, -20.0))

    desk.task.rehearse = rehearsed
    page.refit()
    drain(page.worker)
    assert desk.phase is Phase.PLANNED
    # What is drawn is the plan, not the cast before.
    assert "/marks/expected" in drawn(page.server)


def test_a_bad_target_and_a_rig_that_fails_leave_a_sentence_and_the_page(page, own):
    page.aim((9.0, 9.0))
    assert "out of reach" in page.desk.message
    assert page.desk.phase is Phase.READY
    own.failures = 3
    cast_at_target(page)
    assert "protective stop" in page.worker.state.message
    page.cast()
    drain(page.worker)
    assert page.desk.phase is Phase.LANDED


@pytest.mark.parametrize(
    ("description", "is_real"),
    [
        ({"rig": "own"}, True),
        ({"rig": "virtual"}, False),
        ({"rig": "ur", "is_twin": False}, True),
        ({"rig": "ur", "is_twin": True}, False),
    ],
)
def test_a_rig_that_moves_something_is_asked_for_twice(page, description, is_real):
    page.desk.rig.description.update(description)
    assert page.rig_is_real == is_real


def test_a_folder_is_looked_at_with_sliders(page, tmp_path, drawn):
    cast_at_target(page)
    page.look.open(str(tmp_path))
    assert set(page.look.shown) == {"measured"}
    page.look.tick("believed", True)
    page.look.slide()
    assert set(page.look.shown) == {"measured", "believed", "sliders"}
    tips = {name.split("/")[2] for name in drawn(page.server) if name.endswith("/tip")}
    assert tips == {"measured", "believed", "sliders"}
    page.look.tick("believed", False)
    assert set(page.look.shown) == {"measured", "sliders"}
    page.aim(TARGET)
    assert "/figures/sliders/tip" not in drawn(page.server)


def test_casts_of_an_arm_with_other_joints_are_refused(page, monkeypatch):
    facts = {name: getattr(page.desk.setup, name) for name in ("workspace", "strike")}
    other = types.SimpleNamespace(**facts, arm=types.SimpleNamespace(joint_count=7))
    shown = types.SimpleNamespace(setup=other, labels=("cast 0",), tuned=None)
    monkeypatch.setattr("cablecast.view.page.open_collection", lambda folder: shown)
    with pytest.raises(InputError, match="an arm of 7 joints, and the page shows one of 6"):
        page.look.open("elsewhere")
    assert page.look._collection is None


def test_a_folder_is_opened_only_when_no_cast_of_the_one_before_is_drawn(page, tmp_path):
    cast_at_target(page)
    page.look.open(str(tmp_path))
    before = page.look._collection
    opening = threading.Thread(target=page.look.open, args=(str(tmp_path),))
    with page.look._lock:
        opening.start()
        opening.join(timeout=0.5)
        assert page.look._collection is before
    opening.join()
    assert page.look._collection is not before


def test_the_map_lies_between_the_table_and_the_target(page, drawn):
    page.aim(TARGET)
    page.show_map(True)
    assert 0.0 < drawn(page.server)["/marks/map"].position[2] < LIFT
    page.show_map(False)
    assert "/marks/map" not in drawn(page.server)


def test_a_map_without_a_model_is_refused_in_a_sentence(rig, engine, tmp_path):
    page = Page(Desk(rig, engine), Worker(), lambda report: None, tmp_path, port=0)
    page.guard(lambda: page.show_map(True))
    assert "no model predicts yet" in page.desk.message
    page.close()


def test_places_that_the_camera_is_blind_at_are_marked_from_the_session_on(page, drawn):
    hatch = [f"/room/blind/{number}/hatch" for number in range(2)]
    places = ((-1.08, 0.42, 0.16), (0.5, 0.9, 0.05))
    for count in (0, 2, 1):
        page.desk.session.sight = CameraSight(position=(0.0, 0.9, 2.2), blind=places[:count])
        page.refresh()
        nodes = drawn(page.server)
        assert [name in nodes for name in hatch] == [number < count for number in range(2)]
    page.desk.session.sight = None
    page.refresh()
    assert hatch[0] not in drawn(page.server)


def test_the_last_miss_is_written_over_no_other_number(page, own, drawn):
    cast_at_target(page)
    own.offset = np.array([-0.3, 0.1])
    for _ in range(2):
        page.correct()
        drain(page.worker)
    target = page.desk.last.target_xy
    # Two at one place, and one beyond the text of both.
    ends = [(-0.01, 0.0), (-0.3, 0.0), (0.0, 0.0)]
    tries = page.desk.tries_at(target)

    def landed(one, end):
        path = one.track.endpoint_xy.copy()
        path[-1] = target + end
        return path

    near = [
        dataclasses.replace(one, track=dataclasses.replace(one.track, endpoint_xy=landed(one, end)))
        for one, end in zip(tries, ends, strict=True)
    ]
    page.stage.table.landings(near)
    nodes = drawn(page.server)
    shown = [f"/marks/tries/{one.number}/label" in nodes for one in near]
    assert shown == [False, True, True]
    assert all(f"/marks/tries/{one.number}/ball" in nodes for one in near)


def test_the_arm_waits_at_its_start_while_the_ghost_moves(page, drawn):
    page.aim(TARGET)
    seen = []
    for time in (0.0, page.stage.player.duration):
        page.stage.player.seek(time)
        nodes = drawn(page.server)
        names = [f"/figures/{name}/arm/rods" for name in ("plan", "measured")]
        seen.append([np.array(nodes[name].batched_positions) for name in names])
    (ghost_before, arm_before), (ghost_after, arm_after) = seen
    assert np.abs(ghost_after - ghost_before).max() > 0.1
    assert np.array_equal(arm_after, arm_before)


def test_the_picture_of_the_camera_is_sent_small_and_in_the_order_of_a_browser():
    picture = np.zeros((108, 1920, 3), dtype=np.uint8)
    # Blue comes first in the rig's picture, last in the page's.
    picture[..., 0] = 200
    small = shrunk(picture)
    assert small.shape == (27, 480, 3)
    assert small[0, 0].tolist() == [0, 0, 200]


def test_casts_of_getting_ready_are_played_and_no_cable_stays_where_none_was_seen(
    rig, engine, policy, tmp_path, drawn
):
    page = Page(Desk(rig, engine), Worker(), lambda report: None, tmp_path, port=0)
    session = AimSession(policy)
    played = []
    page.stage.play = lambda casts, **options: played.append(casts["measured"])
    rig.reset()
    rig.execute(session.propose(TARGET).trajectory)
    motion, seen = played + list(page._unseen)
    assert motion.nodes is None
    assert np.all(np.isfinite(seen.nodes))
    for cast, is_drawn in ((seen, True), (motion, False)):
        page.stage.show({"measured": cast}, 0.0)
        assert ("/figures/measured/cable" in drawn(page.server)) == is_drawn
    # Once targets can be chosen, what is cast is shown by whoever casts.
    page.desk.set_session(session)
    rig.reset()
    rig.execute(session.propose(TARGET).trajectory)
    assert len(played) + len(page._unseen) == 2
    page.close()
