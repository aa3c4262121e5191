"""The page of strikes: what differs from casts onto a table, against an engine as the rig."""

import dataclasses

import numpy as np
import pytest
from PIL import Image
from tests.view.conftest import drain

from cablecast.aiming.config import AimConfig
from cablecast.cast import TrialStatus
from cablecast.cli.main import main
from cablecast.errors import InputError
from cablecast.motion.joint_move import JointMoves
from cablecast.pipeline.collect import collect
from cablecast.pipeline.strike import prepare_strike
from cablecast.rigs.engine import RigSwing
from cablecast.rigs.make import make_rig
from cablecast.runs.progress import ignore
from cablecast.setup import Setup, StrikeConfig
from cablecast.tuning.tips import fit_tips
from cablecast.view.desk import Desk, Phase
from cablecast.view.film import FilmConfig
from cablecast.view.page import Page
from cablecast.view.shapes import Surface, drawn_rods, swing_extent, viewpoint
from cablecast.view.words import plan_text, status_text, tour_text, tries_text
from cablecast.view.worker import Worker, WorkState

pytest.importorskip("viser")

SETUP = Setup(strike=StrikeConfig(watch_time=1.6))
TARGET, FAR = (1.2, 0.9), (3.0, 0.9)
FEW = {"move_count": 64, "cable_count": 2}
# Rounding of coordinates of some metres in double precision [m].
ROUNDING = 1e-9


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Return a folder in which the swings of believed cables are simulated."""
    folder = tmp_path_factory.mktemp("strike")
    rig = make_rig(RigSwing(SETUP, SETUP.cable, segment_count=12), SETUP)
    prepare_strike(rig, out=folder, progress=ignore, **FEW)
    return folder


@pytest.fixture
def rig():
    heavy = dataclasses.replace(SETUP.cable.params, drag_coefficient=1.4, mass=0.05)
    cable = dataclasses.replace(SETUP.cable, params=heavy)
    return make_rig(RigSwing(SETUP, cable, segment_count=12), SETUP)


def coarse_fit(*args, **options):
    """Fit a cable from few starts: how well it is known is no matter here."""
    return fit_tips(*args, **(options | {"draw_count": 12, "start_count": 1}))


@pytest.fixture
def page(rig, engine, prepared, tmp_path, monkeypatch):
    for name, count in (("MOVE_COUNT", 64), ("CABLE_COUNT", 2)):
        monkeypatch.setattr(f"cablecast.pipeline.strike.{name}", count)
    monkeypatch.setattr("cablecast.aiming.strike.fit_tips", coarse_fit)
    (tmp_path / "prior.npz").write_bytes((prepared / "prior.npz").read_bytes())
    desk = Desk(rig, engine)
    config = AimConfig(within_pct=0.2)

    def prepare(report):
        desk.open_session(desk.task.prepare(rig, config, out=tmp_path, progress=report), report)

    opened = Page(desk, Worker(), prepare, tmp_path, port=0)
    opened.prepare()
    drain(opened.worker)
    yield opened
    opened.close()


def strike(page, target=TARGET):
    page.aim(target)
    drain(page.worker)
    page.cast()
    drain(page.worker)


def test_a_person_points_swings_and_corrects_and_aim_goes_on_with_the_same_folder(
    page, rig, tmp_path, drawn
):
    desk = page.desk
    assert desk.phase is Phase.READY
    assert "Click on the plane of the swing" in status_text(desk, page.worker.state)
    assert tour_text(desk, WorkState()).count("✓") == 1
    page.aim(TARGET)
    # A plan may take seconds: a person sees that it is under way.
    assert page.worker.state.name == "a plan"
    drain(page.worker)
    assert page.worker.state.message == ""
    assert desk.phase is Phase.PLANNED
    plan = plan_text(desk.preview, desk)
    assert "| target | 1.20 m ahead, 0.90 m high, try 1 |" in plan
    assert "| chance of a hit | " in plan
    assert "table" not in plan
    assert np.all(desk.preview.limit_shares <= 1.0)
    assert [field.value for field in page._target_fields] == list(TARGET)
    assert {"/marks/expected", "/figures/plan/cable"} <= drawn(page.server).keys()
    page.cast()
    drain(page.worker)
    assert page.worker.state.message == ""
    one = desk.last
    assert "the nearest point of its path is" in desk.message
    assert f"{one.miss_pct * SETUP.cable.length:.1f} cm" in tries_text(desk)
    assert not one.hit
    page.correct()
    drain(page.worker)
    assert desk.last.try_number == 2
    page.stage.player.seek(page.stage.player.duration)
    ball = drawn(page.server)[f"/marks/tries/{desk.last.number}/ball"]
    surface = page.stage.table.surface
    assert np.allclose(ball.position[:2], surface.flat(desk.last.outcome))
    session = prepare_strike(rig, out=tmp_path, progress=ignore, **FEW)
    assert len(session.casts) == len(desk.tries)
    assert session.casts[0].goal.is_same(one.target_xy)


def test_a_place_that_cannot_be_struck_is_said_at_once_with_the_nearest_that_can(page, drawn):
    page.aim(TARGET)
    drain(page.worker)
    page.aim(page.desk.task.from_typed(*FAR))
    drain(page.worker)
    said = status_text(page.desk, page.worker.state)
    assert "3.00 m ahead, 0.90 m high cannot be struck: the nearest point" in said
    assert page.desk.phase is Phase.READY
    assert "/marks/target" not in drawn(page.server)


def test_a_swing_that_is_discarded_tells_nothing(page):
    first = page.desk.aim(TARGET).proposal.action
    strike(page)
    page.undo()
    assert page.desk.last is None
    assert page.desk.aim(TARGET).proposal.action == first


def test_another_target_is_one_that_swings_pass_far_from_the_last(page):
    page.desk.aim(TARGET)
    other = page.desk.other_target()
    page.desk.aim(other)
    target = page.stage.table.surface.flat(other)
    assert np.linalg.norm(target - TARGET) > 0.1


def test_a_swing_that_was_not_seen_says_so(page, monkeypatch):
    unseen = page.desk.rig.rig.execute

    def execute(trajectory):
        track = unseen(trajectory)
        nowhere = np.full_like(track.endpoint_xy, np.nan)
        return dataclasses.replace(
            track, status=TrialStatus.NON_FINITE, endpoint_xy=nowhere, endpoint_z=nowhere[:, 0]
        )

    monkeypatch.setattr(page.desk.rig.rig, "execute", execute)
    strike(page)
    assert "non-finite" in page.desk.message + page.worker.state.message


def test_swings_of_a_folder_are_looked_at_with_sliders_and_filmed(page, tmp_path):
    strike(page)
    page.look.open(str(tmp_path))
    page.look.tick("believed", True)
    page.look.slide()
    assert set(page.look.shown) == {"measured", "believed", "sliders"}
    assert "misses by" in page.look._text.content
    config = FilmConfig(width=128, height=96, frames_per_second=5)
    page.desk.task.film(tmp_path, [page.desk.last])(tmp_path / "swing.gif", config, ignore)
    with Image.open(tmp_path / "swing.gif") as picture:
        assert picture.n_frames > 3


def test_the_map_shows_where_swings_pass(page, drawn):
    page.show_map(True)
    picture = page.desk.task.map(page.desk.session)
    assert "/marks/map" in drawn(page.server)
    low, high = picture.low, picture.high
    rows, columns = picture.image.shape[:2]
    u, v = (np.array(TARGET) - low) / (high - low) * [columns, rows]
    near = picture.image[::-1][int(v) - 2 : int(v) + 3, int(u) - 2 : int(u) + 3, 3]
    assert near.any()
    assert not picture.image[0, 0, 3]


def test_a_person_is_told_the_box_that_the_cable_can_be_in(page):
    assert "out of its reach" in page.desk.task.danger(None)
    assert "The cable can be anywhere in x" in page.desk.task.danger(page.desk.session)


def test_the_plane_of_the_swing_is_where_swings_are_and_is_met_from_both_sides():
    surface, moves = Surface.of(SETUP), JointMoves.of(SETUP)
    q = np.array(moves.start)
    root = moves.stick.root(moves.arm.frames(q)[-1])
    flat = surface.flat(root)
    point = surface.points(flat)
    assert np.allclose(point, root, atol=ROUNDING)
    normal = surface.axes[:, 2]
    for side in (1.0, -1.0):
        eye = point + side * 2.0 * normal + [0.0, 0.3, 0.1]
        assert np.allclose(surface.pick(eye, point - eye), flat, atol=ROUNDING)
        assert surface.pick(eye, eye - point) is None
    assert np.allclose(drawn_rods(q, SETUP).ends[-1, 1], root, atol=ROUNDING)
    assert len(drawn_rods(q, SETUP, tool_alone=True).radii) == 1


@pytest.mark.parametrize("aspect", [0.46, 1.2])
def test_the_whole_plane_is_seen_from_its_side(aspect):
    low, high = swing_extent(SETUP)
    surface = Surface.of(SETUP)
    position, look_at, fov = viewpoint(SETUP, aspect, panel=True)
    forward = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    corners = np.array([low, high, [low[0], high[1]], [high[0], low[1]]])
    points = surface.points(corners) - position
    depth = points @ forward
    across = points @ right / depth / np.tan(fov / 2) / aspect
    up = points @ np.cross(right, forward) / depth / np.tan(fov / 2)
    assert np.abs(across).max() < 1.0
    assert np.abs(up).max() < 1.0
    # On a phone the panel covers the lower part.
    assert aspect > 1.0 or up.min() > 0.1
    # Ahead is to the right.
    assert surface.axes[:, 0] @ right > 0.5


def test_a_rig_s_casts_onto_a_table_are_not_looked_at_on_a_page_of_strikes(page, tmp_path):
    flat = Setup()
    collect(make_rig("engine", flat), count=1, out=tmp_path / "casts", progress=ignore)
    with pytest.raises(InputError, match="another strike section"):
        page.look.open(str(tmp_path / "casts"))


def test_the_verb_serves_strikes_of_a_lab_and_of_an_option(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lab.yaml").write_text("strike: {watch_time: 1.2}\n")
    served = []
    monkeypatch.setattr(
        "cablecast.view.page.serve", lambda rig, out, **rest: served.append((rig.setup, out))
    )
    for words in (["--setup", "lab.yaml"], ["--task", "strike"], []):
        assert not main(["view", "--rig", "engine", *words])
    kinds = [(setup.strike is not None, out.name) for setup, out in served]
    assert kinds == [(True, "strike"), (True, "strike"), (False, "aim")]
