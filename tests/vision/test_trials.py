"""The camera of a lab file: trials over the network against the truth, and every fault."""

import contextlib
import dataclasses
import itertools
import pathlib
import re
import time

import numpy as np
import pytest

pytest.importorskip("cv2")

from tests.vision.player import CABLE, Player, glide

from cablecast.camera.settings import CameraSettings
from cablecast.cast import TrialStatus
from cablecast.errors import CameraError, InputError, RigError
from cablecast.motion.polar import reset_pose
from cablecast.motion.trajectory import JointPath
from cablecast.rigs.checked import call_within
from cablecast.rigs.virtual.camera_stream import MOVED_TAG, CameraStream
from cablecast.rigs.virtual.config import CameraConfig
from cablecast.setup import Setup
from cablecast.vision import trials
from cablecast.vision.tracker import EndpointTracker
from cablecast.vision.trials import CameraOfTrials, TrialCamera, TrialTiming
from cablecast.vision.video import read_video

RATE, CLOCK, WIDTH, HEIGHT = 30.0, 700.0, 1280, 720
# What the project asks of the camera over the network [m].
LANDING_RMS = 3e-3


def sweep(end):
    """Return a motion from the reset state: the endpoint goes to `end` and rests there."""
    reset_y = Setup().workspace.reset_y
    start, grip = (0.0, reset_y + CABLE.length), (0.0, reset_y)
    return glide(start, end, rest=0.2, grip=grip, bow=0.0)


def now(player):
    """Return the timing of a motion that is over at once."""
    pairs = np.array([[player.time, time.monotonic()]])
    return TrialTiming(start_time=player.time, end_time=player.time, clock_pairs=pairs)


@contextlib.contextmanager
def failing(stream, fault):
    """Let the camera have a fault for a while."""
    stream.fault(fault)
    try:
        yield
    finally:
        stream.fault(None)


@pytest.fixture(scope="module")
def lens():
    """Return the lens, as a board would tell it."""
    return dataclasses.replace(CameraConfig(), frame_rate=RATE).resized(WIDTH).view.lens


@pytest.fixture(scope="module")
def stream():
    config = dataclasses.replace(CameraConfig(), frame_rate=RATE, exposure=0.002).resized(WIDTH)
    with CameraStream(Setup(), config, clock=CLOCK) as stream:
        yield stream


@pytest.fixture(scope="module")
def setup(stream, lens):
    camera = CameraSettings(
        source=stream.url,
        width=WIDTH,
        height=HEIGHT,
        rate=RATE,
        exposure=0.002,
        clock_offset=-CLOCK,
        lens=lens,
    )
    return Setup(camera=camera)


@pytest.fixture(scope="module")
def player(stream):
    player = Player(stream, sweep((0.4, 1.2)))
    yield player
    player.close()


@pytest.fixture(scope="module")
def camera(setup, player, tmp_path_factory):
    films = str(tmp_path_factory.mktemp("films"))
    settings = dataclasses.replace(setup.camera, films=films)
    with CameraOfTrials(dataclasses.replace(setup, camera=settings)) as camera:
        yield camera


def test_landings_agree_with_the_truth_and_it_is_seen_whether_the_jaws_hold_the_cable(
    camera, player
):
    assert isinstance(camera, TrialCamera)
    assert camera.description["tags_used"] == 11
    assert camera.description["camera"] == "stream"
    home = camera.setup.arm.inverse(np.asarray(reset_pose(Setup().workspace), dtype=float))
    q = np.repeat(home[None], 2, axis=0)
    standing = JointPath(times=np.array([0.0, 0.6]), q=q, qd=0 * q)
    misses = []
    for end, gap, is_held in (((-0.5, 1.0), 0.0, True), ((0.3, 1.1), 0.25, False)):
        trial = sweep(end)
        # A cable that slips out as the motion begins.
        away = trial.nodes + np.array([0.0, gap, 0.0])
        nodes = np.where(trial.times[:, None, None] > 0.05, away, trial.nodes)
        since = player.rewind(dataclasses.replace(trial, nodes=nodes, joint_path=standing))
        camera.check(since)
        found = camera.locate(since)
        assert found is not None
        misses.append(found - player.trial.nodes[0, -1, :2])
        before = camera.picture()
        camera.start()
        timing = dataclasses.replace(player.cast(), joint_path=standing)
        track = camera.stop(timing)
        # The latest picture is one of this trial's.
        assert camera.picture().shape == (HEIGHT, WIDTH, 3)
        assert camera.picture() is not before
        # The marker itself, which lay there at the begin, is no green thing of the table.
        sight = camera.sight()
        assert not sight.is_blind_at(track.endpoint_xy[0])
        assert track.status is TrialStatus.OK
        assert len(track.times) == 7
        truth = player.trial.shape_at(track.times)[:, -1, :2]
        misses += list((track.endpoint_xy - truth)[np.isfinite(track.endpoint_xy).all(axis=1)])
        misses.append(track.final_xy - truth[-1])
        assert camera.into_sight(home) is home
        assert camera.holds_cable(home, timing.end_time) is is_held
    errors = np.linalg.norm(misses, axis=1)
    assert np.sqrt(np.mean(errors**2)) < LANDING_RMS


def test_the_film_of_a_trial_is_kept_with_its_times(camera):
    films = sorted(pathlib.Path(camera.settings.films).iterdir())
    assert [film.name[-8:] for film in films][:2] == ["0000.mkv", "0001.mkv"]
    _, frames = read_video(films[0])
    times = [time for time, _ in frames]
    # Films count in milliseconds.
    np.testing.assert_allclose(np.diff(times), 1 / RATE, atol=1.01e-3)
    assert times[-1] > 0.6


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("frozen", "is frozen: .* Plug it out and in again"),
        ("black", "is dark"),
        ("exposed", "times as bright as when it was calibrated"),
        ("moved_tag", rf"tags \[{MOVED_TAG}\] were moved"),
    ],
)
def test_a_camera_that_fails_before_a_trial_says_what_to_do(camera, player, stream, fault, words):
    camera.check(player.rewind())
    with failing(stream, fault), pytest.raises(CameraError, match=words) as caught:
        camera.check(player.time)
    assert "\n" not in str(caught.value)
    camera.check(player.time)


def test_a_tag_beside_the_table_may_move_and_the_camera_may_not(setup, player, monkeypatch):
    found, places = trials.detect_tags, itertools.count()
    shift = 0.0

    def moved(*args):
        tags = found(*args)
        beside = next(iter(tags.values())) + 50.0 * next(places)
        return {i: tag + shift for i, tag in tags.items()} | {99: beside}

    monkeypatch.setattr(trials, "detect_tags", moved)
    with CameraOfTrials(setup) as camera:
        camera.check()
        shift = 2.0
        with pytest.raises(CameraError, match=r"camera was moved: .* 2\.\d px \(.* from where"):
            camera.check()


def test_a_film_that_cannot_begin_or_was_dropped_is_forgotten(camera, player, stream):
    camera.check(player.rewind())
    with failing(stream, "exposed"):
        for begin in (lambda: camera.check(player.time), camera.start):
            with pytest.raises(CameraError, match="times as bright"):
                begin()
    # Pictures that are as bright as before arrive again.
    camera.check(player.time)
    camera.start()
    camera.cancel()
    camera.cancel()
    with pytest.raises(CameraError, match="not started"):
        camera.stop(now(player))


def test_a_camera_that_fails_in_a_trial_gives_no_track(camera, player, stream):
    camera.check(player.rewind())
    camera.start()
    with failing(stream, "frozen"):
        timing = player.cast()
        with pytest.raises(CameraError, match="frozen"):
            camera.stop(timing)


def test_an_endpoint_lost_with_frames_that_found_no_room_is_an_error_of_this_computer(
    camera, player, monkeypatch
):
    camera.check(player.rewind())
    monkeypatch.setattr(camera._camera, "dropped_count", 0)
    look = EndpointTracker.update

    def lose(tracker, time, grab):
        # Frames that find no room are reported with those that do.
        camera._camera.dropped_count += 1
        return look(tracker, time, lambda window: np.zeros_like(grab(window)))

    camera.start()
    monkeypatch.setattr(EndpointTracker, "update", lose)
    with pytest.raises(CameraError, match=r"\d+ frames of this cast found no room in the memory"):
        camera.stop(player.cast())


def test_a_trial_whose_end_is_not_waited_for_leaves_the_camera_to_the_next(camera, player):
    camera.check(player.rewind())
    camera.start()
    filming, timing = camera._filming, player.cast()
    endless = dataclasses.replace(timing, end_time=timing.end_time + 50.0)
    with pytest.raises(RigError, match="longer than its time limit"):
        call_within(0.5, "the rig's execute", lambda: camera.stop(endless))
    latest = filming.latest
    camera.check(player.rewind())
    assert filming.latest is latest
    camera.start()
    assert camera.stop(player.cast()).status is TrialStatus.OK
    assert not list(pathlib.Path(camera.settings.films).glob("*.part"))


def test_clocks_that_were_never_compared_are_an_error_and_not_a_wait(camera, player, monkeypatch):
    settings = dataclasses.replace(camera.settings, clock_offset=5000.0)
    monkeypatch.setattr(camera, "settings", settings)
    # Frames still count by their arrival.
    camera.check(player.rewind())
    camera.start()
    # 5,000 s and the stream's own 700 s, but for what a busy computer takes for a frame.
    with pytest.raises(CameraError, match=r"apart: .* Run `cablecast camera sync`") as caught:
        camera.stop(now(player))
    seconds = re.search(r"(\d+) s apart", str(caught.value))
    assert seconds is not None
    assert int(seconds[1]) == pytest.approx(5700, abs=30)


def test_a_camera_that_is_unplugged_in_a_trial_is_an_error(setup, player, stream):
    player.rewind()
    with CameraOfTrials(setup) as camera:
        camera.start()
        with failing(stream, "unplugged"):
            with pytest.raises(CameraError, match="still plugged in"):
                camera.stop(player.cast())
            with pytest.raises(CameraError, match="still plugged in"):
                camera.check()


def test_a_lab_without_a_camera_and_a_camera_that_sees_no_tags_are_refused(setup, player, stream):
    with pytest.raises(CameraError, match="no section `camera`"):
        CameraOfTrials(Setup())
    no_tags = "0 of the layout's 11 tags"
    with failing(stream, "black"), pytest.raises(InputError, match=no_tags):
        CameraOfTrials(setup)
