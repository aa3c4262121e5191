"""The page without a browser: what its buttons call, against a server that nobody looks at."""

import dataclasses

import numpy as np
import pytest

from cablecast.camera.settings import CameraSight
from cablecast.errors import InputError
from cablecast.pipeline.aim_learning import Learned
from cablecast.pipeline.aim_session import AimSession
from cablecast.rigs.make import make_rig
from cablecast.runs.folder import Parts
from cablecast.runs.progress import Progress
from cablecast.setup import Setup
from cablecast.view.controls import plan_text, status_text, tour_text, tries_text
from cablecast.view.desk import Desk, Phase
from cablecast.view.look import Album
from cablecast.view.page import Page
from cablecast.view.scene import LIFT
from cablecast.view.shapes import DARK, LIGHT
from cablecast.view.worker import Worker

pytest.importorskip("viser")

TARGET = np.array([0.3, 1.15])


class Finished(Worker):
    """A worker that ends when its work is done."""

    def work(self):
        self._ended = False
        while self.busy:
            self._step()


@pytest.fixture
def page(rig, engine, policy, tmp_path):
    session = AimSession(policy, out=tmp_path / "session")
    desk = Desk(rig, engine, Album(Parts(tmp_path / "shapes")), session)
    page = Page(desk, Finished(), lambda report: None, port=0, suggestion=tmp_path)
    yield page
    page.close()


def test_point_cast_correct_replay_undo(page):
    desk = page.desk
    page.aim(TARGET)
    assert desk.message == ""
    assert desk.phase is Phase.PLANNED
    page.cast()
    page.worker.work()
    assert page.worker.state.message == ""
    assert desk.phase is Phase.LANDED
    page.correct()
    page.worker.work()
    assert [one.try_number for one in desk.tries] == [1, 2]
    page.replay(desk.tries[0].number)
    assert page.player.duration == pytest.approx(desk.shown(desk.tries[0]).duration)
    page.undo()
    assert "taken back" in desk.message
    page.aim_polar(1.2, -20.0)
    assert desk.phase is Phase.PLANNED
    assert desk.preview.target_xy[0] < 0


class Learning:
    """Stands for a fit: returns the same policy after some reports, or is stopped in between."""

    def __init__(self, policy):
        self.policy, self.counts, self.during = policy, [], None

    def learned_anew(self, casts, count, report):
        report(Progress(task="2/4 fit", done=1, total=4))
        if self.during is not None:
            self.during()
        self.counts.append((len(casts), count))
        return Learned(policy=self.policy, fitted_count=count)


def test_a_fit_to_all_casts_is_long_work_that_leaves_out_what_was_undone(page, policy):
    session, desk = page.desk.session, page.desk
    page.refit()
    page.worker.work()
    assert "only a session that prepare_aim returned" in page.worker.state.message
    session._learning = learning = Learning(policy)
    for _ in range(3):
        page.aim(TARGET)
        page.cast()
        page.worker.work()
    page.undo()
    learning.during = lambda: (_ for _ in ()).throw(InputError("no disk"))
    page.refit()
    assert page.worker.state.name == "a fit to all casts"
    page.worker.work()
    assert page.worker.state.message == "no disk"
    assert session.fitted_count == 0
    learning.during = None
    page.refit()
    page.worker.work()
    assert page.worker.state.message == ""
    assert learning.counts == [(2, 3)]
    assert session.fitted_count == 3
    assert len(session.aimer.casts) == 2
    assert "fits 3 casts" in desk.message
    assert desk.phase is Phase.READY


def test_the_page_says_that_a_new_fit_is_worth_it(page, monkeypatch):
    page.refresh()
    assert not page.cast_controls._due.visible
    monkeypatch.setattr(AimSession, "refit_reason", "15 casts are known")
    page.refresh()
    assert page.cast_controls._due.visible
    assert "15 casts are known" in page.cast_controls._due.content


def test_a_bad_target_is_said_and_changes_nothing(page):
    page.aim((9.0, 9.0))
    assert "out of reach" in page.desk.message
    assert page.desk.phase is Phase.READY


def test_a_rig_that_fails_leaves_its_sentence_and_the_page(page, own):
    own.failures = 3
    page.aim(TARGET)
    page.cast()
    page.worker.work()
    assert "protective stop" in page.worker.state.message
    assert "protective stop" in status_text(page.desk, page.worker.state)
    page.cast()
    page.worker.work()
    assert page.desk.phase is Phase.LANDED


def test_a_rig_that_is_no_simulator_is_asked_for_twice(page):
    assert page.rig_is_real
    page.desk.rig.description["rig"] = "virtual"
    assert not page.rig_is_real


def test_a_folder_is_looked_at_with_sliders(page):
    page.aim(TARGET)
    page.cast()
    page.worker.work()
    page.look_controls.open(str(page.look_controls._folder.value))
    page.look_controls._boxes["believed"].value = True
    page.look_controls.show(0)
    assert set(page.look_controls._shown) == {"measured", "believed"}
    page.look_controls._resimulate()
    assert "sliders" in page.look_controls._shown
    page.aim(TARGET)
    assert page.look_controls._shown == {}


def test_the_map_lies_on_the_table_and_says_what_its_colours_mean(page):
    page.show_map(True)
    assert page._map.visible
    # Below it is the table's top; the lines and the target lie above it.
    assert 0.0 < page._map.position[2] < LIFT
    legend = page.playback._legend
    assert legend.visible
    assert "25 and more" in legend.content
    page.show_map(False)
    assert not page._map.visible
    assert not legend.visible


def test_a_map_without_a_model_is_refused_in_a_sentence(rig, engine):
    page = Page(Desk(rig, engine), Finished(), lambda report: None, port=0)
    page.guard(lambda: page.show_map(True))
    assert "no model yet" in page.desk.message
    assert page.playback._map.disabled
    page.close()


def test_what_is_dark_is_drawn_in_lighter_colours(page):
    page.aim(TARGET)
    page.cast()
    page.worker.work()
    page._landed(page.desk.last.target_xy)
    for dark, paint in ((True, DARK), (False, LIGHT)):
        page.set_dark(dark)
        assert page.solid._cable.color == paint.cable
        landing = f"/marks/tries/{page.desk.last.number}/ball"
        assert page.server.scene._handle_from_node_name[landing].color == paint.text


def test_places_that_the_camera_is_blind_at_are_marked_from_the_session_on(page):
    names = page.server.scene._handle_from_node_name
    hatch = [f"/room/blind/{number}/hatch" for number in range(2)]
    places = ((-1.08, 0.42, 0.16), (0.5, 0.9, 0.05))
    for count in (0, 2, 1):
        page.desk.session.sight = CameraSight(position=(0.0, 0.9, 2.2), blind=places[:count])
        page.refresh()
        assert [name in names for name in hatch] == [number < count for number in range(2)]
    page.set_dark(True)
    assert np.all(names[hatch[0]].colors == DARK.reach)
    page.desk.session.sight = None
    page.refresh()
    assert hatch[0] not in names


def test_the_last_miss_is_written_over_no_other_number(page, own):
    names = page.server.scene._handle_from_node_name
    page.aim(TARGET)
    page.cast()
    page.worker.work()
    own.offset = np.array([-0.3, 0.1])
    for _ in range(2):
        page.correct()
        page.worker.work()
    tries = page.desk.tries_at(page.desk.last.target_xy)
    # Two at one place, and one beyond the text of both.
    ends = [(-0.01, 0.0), (-0.3, 0.0), (0.0, 0.0)]
    near = [
        dataclasses.replace(one, final_xy=page.desk.last.target_xy + end)
        for one, end in zip(tries, ends, strict=True)
    ]
    page._marks.landings(near)
    shown = [f"/marks/tries/{one.number}/label" in names for one in near]
    assert shown == [False, True, True]
    assert all(f"/marks/tries/{one.number}/ball" in names for one in near)


def test_the_arm_waits_at_its_start_while_the_ghost_moves(page):
    page.aim(TARGET)
    cast = page.desk.preview.cast
    acts = dict(page.player._acts)
    assert np.ptp(acts[page.ghost].joint_path.q, axis=0).max() > 0.1
    still = acts[page.solid]
    assert np.array_equal(still.joints_at(cast.duration), cast.joints_at(0.0))


def test_a_twin_is_not_asked_for_twice(page):
    page.desk.rig.description |= {"rig": "ur", "is_twin": False}
    assert page.rig_is_real
    page.desk.rig.description["is_twin"] = True
    assert not page.rig_is_real


def test_the_picture_of_the_camera_is_shown_and_its_trouble_said(own, engine):
    own.picture = lambda: picture
    picture = None
    page = Page(Desk(make_rig(own, Setup()), engine), Finished(), lambda report: None, port=0)
    camera = page.camera_controls
    camera.close()
    camera.look()
    assert not camera._folder.visible
    picture = np.zeros((108, 1920, 3), dtype=np.uint8)
    picture[..., 0] = 200
    camera.look()
    assert camera._folder.visible
    # Blue comes first in the rig's picture, last in the page's.
    assert camera._image.image.shape == (27, 480, 3)
    assert camera._image.image[0, 0].tolist() == [0, 0, 200]
    picture = np.zeros((4, 4))
    camera.look()
    assert "must be uint8 of shape [v, u, 3]" in camera._text.content
    page.close()


def test_a_rig_without_a_camera_shows_no_picture(page):
    page.camera_controls.look()
    assert not page.camera_controls._folder.visible


def test_the_tour_leads_to_the_first_cast_and_ends_there(page):
    assert tour_text(page.desk, page.worker.state).count("✓") == 4
    page.aim(TARGET)
    assert "▶ **Cast.**" in tour_text(page.desk, page.worker.state)
    page.cast()
    page.worker.work()
    assert tour_text(page.desk, page.worker.state) == ""
    assert not page.cast_controls._tour.visible


def test_the_tour_follows_the_steps_of_the_work(rig, engine):
    desk, worker = Desk(rig, engine), Finished()
    assert "▶" not in tour_text(desk, worker.state)
    seen = []

    def work(report):
        for task in ("1/4 casts", "Casting", "2/4 fit", "Tuning 1.5 %"):
            report(Progress(task=task))
            seen.append(tour_text(desk, worker.state))

    worker.submit("getting ready", work)
    worker.work()
    assert ["▶ **Cast a few" in text for text in seen] == [True, True, False, False]
    assert ["▶ **Fit" in text for text in seen] == [False, False, True, True]


def test_texts_state_the_plan_and_the_tries(page):
    preview = page.desk.aim(TARGET)
    text = plan_text(preview, page.desk)
    assert "1.188 m, 14.6°, try 1" in text
    assert f"{preview.proposal.trajectory.duration:.2f} s" in text
    page.desk.cast()
    assert "| 1 | 1.19 m, 15° |" in tries_text(page.desk)
    assert "from the target" in status_text(page.desk, page.worker.state)
