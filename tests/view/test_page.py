"""The page without a browser: what its buttons call, against a server that nobody looks at."""

import numpy as np
import pytest

from cablecast.pipeline.aim_session import AimSession
from cablecast.runs.parts import Parts
from cablecast.view.album import Album
from cablecast.view.desk import Desk, Phase
from cablecast.view.page import Page
from cablecast.view.status import plan_text, status_text, tries_text
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


def test_colours_and_the_map_are_switched(page):
    page.set_dark(True)
    page.show_map(True)
    assert page._map.visible
    page.show_map(False)
    assert not page._map.visible
    page.set_dark(False)


def test_texts_state_the_plan_and_the_tries(page):
    preview = page.desk.aim(TARGET)
    text = plan_text(preview, page.desk)
    assert "1.188 m, 14.6°, try 1" in text
    assert f"{preview.proposal.trajectory.duration:.2f} s" in text
    page.desk.cast()
    assert "| 1 | 1.19 m, 15° |" in tries_text(page.desk)
    assert "from the target" in status_text(page.desk, page.worker.state)
