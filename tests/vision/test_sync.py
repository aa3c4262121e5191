"""The camera's clock against the robot's, with one cast and over the network."""

import dataclasses
import re

import numpy as np
import pytest

pytest.importorskip("cv2")

from tests.vision.player import Player

from cablecast.camera.settings import CameraSettings
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.errors import CameraError, InputError
from cablecast.motion.trajectory import plan_trajectory
from cablecast.pipeline.camera import SYNC_ACTION, sync_camera
from cablecast.rigs.base import RigLifecycle
from cablecast.rigs.virtual.camera import TrialFilm, VirtualCamera
from cablecast.rigs.virtual.camera_stream import CameraStream
from cablecast.rigs.virtual.config import CameraConfig
from cablecast.rigs.virtual.drawing import FilmedTrial
from cablecast.setup import Setup, StrikeConfig
from cablecast.vision.clock import CastClock, ClockOffset
from cablecast.vision.tracker import EndpointTracker
from cablecast.vision.trials import CameraOfTrials

RATE, CLOCK = 30.0, 321.25
WIDTH, HEIGHT = 480, 270
# Where the shutter rolls, drawing takes longer: fewer frames, but all of the time between two of
# them goes by from the first row to the last.
ROLLING_RATE = 15.0
ROLLING = {"frame_rate": ROLLING_RATE, "row_time": 0.9 / ROLLING_RATE / HEIGHT}
# Of 255; little, since in so small a picture a cast moves hardly more than the usual noise does.
NOISE = 0.5
# It was 0.2 ms; without regard to the rows it would be off by some of the 60 ms of a frame.
ROLLING_OFFSET_MAX = 0.0015
# Which frames see a cast, and with what noise, is not the same twice over the network.
OFFSET_MAX = 0.005
SD_MAX = 0.005


class PlayedRig(RigLifecycle):
    """A rig whose arm is played before the virtual camera."""

    def __init__(self, player, camera, aborts=False):
        super().__init__()
        self.player, self.camera, self.aborts = player, camera, aborts
        self.description = {}

    def reset(self):
        self.camera.check(self.player.rewind())
        super().reset()

    def execute(self, trajectory):
        self._use_reset()
        self.camera.start()
        if self.aborts:
            self.camera.cancel()
            return EndpointTrack(
                times=np.zeros(1), endpoint_xy=np.zeros((1, 2)), status=TrialStatus.ABORTED
            )
        timing = self.player.cast()
        path = self.player.trial.joint_path
        return self.camera.stop(dataclasses.replace(timing, joint_path=path))


@pytest.fixture(scope="module")
def config():
    config = dataclasses.replace(CameraConfig(), frame_rate=RATE, exposure=0.002, noise=NOISE)
    return config.resized(WIDTH)


@pytest.fixture(scope="module")
def stream(config):
    with CameraStream(Setup(), config, clock=CLOCK) as stream:
        yield stream


@pytest.fixture(scope="module")
def setup(stream):
    camera = CameraSettings(source=stream.url, width=WIDTH, height=HEIGHT, rate=RATE)
    return Setup(camera=camera)


@pytest.fixture(scope="module")
def trial(setup):
    trajectory = plan_trajectory(SYNC_ACTION, setup)
    path = trajectory.joint_path
    assert path is not None
    times = np.arange(0.0, path.times[-1] + 0.3, 0.01)
    poses = trajectory.grip_path.evaluate(np.minimum(times, trajectory.duration), 0)[0]
    nodes = poses[:, None, :3] + np.linspace(0, 1, 6)[:, None] * np.array(
        [0.0, setup.cable.length, -0.014]
    )
    return FilmedTrial(cable=setup.cable, times=times, nodes=nodes, joint_path=path)


@pytest.fixture(scope="module")
def player(stream, trial):
    player = Player(stream, trial)
    yield player
    player.close()


def test_a_cast_tells_the_offset_of_the_clocks_where_the_shutter_rolls(config, setup, trial):
    config, path = dataclasses.replace(config, **ROLLING), trial.joint_path
    # Frames see other moments of the cast than if both clocks began with it.
    shift = 0.5 / RATE
    reported = dataclasses.replace(path, times=path.times + shift)
    late = dataclasses.replace(trial, times=trial.times + shift, joint_path=reported)
    camera = VirtualCamera(config, setup.workspace, None, 0)
    film, clock = TrialFilm(camera, late, 1), CastClock(config.width, config.row_time)
    for frame in range(film.LEAD, film.frame_count):
        clock.keep(film.frame(frame), film.time(frame) + CLOCK)
    found = clock.sync(reported, setup.arm, camera.view)
    assert found.offset == pytest.approx(-CLOCK, abs=ROLLING_OFFSET_MAX)


def test_one_cast_tells_the_offset_of_the_clocks_over_the_network(setup, player):
    # The camera above the table sees casts, whatever else is swung in the laboratory.
    setup = dataclasses.replace(setup, strike=StrikeConfig())
    found = sync_camera(setup, lambda _, camera: PlayedRig(player, camera))
    assert found.offset == pytest.approx(-CLOCK, abs=OFFSET_MAX)
    assert 0 < found.sd < SD_MAX


def test_a_cast_that_was_aborted_tells_nothing(setup, player):
    with pytest.raises(CameraError, match="the cast was aborted"):
        sync_camera(setup, lambda _, camera: PlayedRig(player, camera, aborts=True))


@pytest.fixture(scope="module")
def kept(config, setup, trial):
    """Return the small pictures of a cast, the times of which are the robot's."""
    camera = VirtualCamera(config, setup.workspace, None, 0)
    film, clock = TrialFilm(camera, trial, 1), CastClock(config.width)
    for frame in range(film.LEAD, film.frame_count):
        clock.keep(film.frame(frame), film.time(frame))
    return clock, camera.view


@pytest.mark.parametrize("off", [0.0, 0.03, -0.9, 0.9])
def test_each_cast_tells_by_how_much_the_clocks_are_off(kept, setup, trial, off):
    clock, view = kept
    found = clock.compare(trial.joint_path, setup.arm, view, -off, 1.0)
    assert found is not None
    assert found.offset == pytest.approx(off, abs=OFFSET_MAX)
    assert found.sd < SD_MAX
    assert found.explained > 0.7


def test_a_cast_whose_arm_stands_still_tells_nothing_of_the_clocks(kept, setup, trial):
    clock, view = kept
    path = trial.joint_path
    still = dataclasses.replace(path, q=np.repeat(path.q[:1], len(path.q), axis=0))
    assert clock.compare(still, setup.arm, view, 0.0, 1.0) is None


def test_a_motion_that_the_robot_did_not_make_is_refused(kept, setup, trial):
    clock, view = kept
    path = trial.joint_path
    other = dataclasses.replace(path, q=path.q * [-1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    with pytest.raises(InputError, match="explains only"):
        clock.sync(other, setup.arm, view)


@pytest.mark.parametrize("stored", [RATE / 8, RATE / 1.2, RATE * 2])
def test_a_film_of_another_rate_is_refused_and_the_true_one_named(kept, setup, trial, stored):
    clock, view = kept
    other = CastClock(WIDTH)
    for time, image in clock._kept:
        other._kept.append((time * RATE / stored, image))
    words = rf"filmed with about 30 frames/s, and stored as {stored:.0f}\?"
    with pytest.raises(InputError, match=words):
        other.sync(trial.joint_path, setup.arm, view)


@pytest.fixture(scope="module")
def cast(setup, player):
    """Return a function that films a cast: its timing, and what is said of its clocks."""
    camera = dataclasses.replace(setup.camera, clock_offset=-CLOCK, exposure=0.002)
    with CameraOfTrials(dataclasses.replace(setup, camera=camera)) as trials:

        def cast(late=0.0):
            trials.check(player.rewind() + late)
            trials.start()
            timing = player.cast()
            path = player.trial.joint_path
            return timing, trials.stop(dataclasses.replace(timing, joint_path=path)).note

        yield cast


def test_a_cast_whose_clocks_are_unclear_is_refused(cast, monkeypatch):
    unclear = ClockOffset(offset=0.06, sd=0.02, explained=0.5, agreed=0.5, frame_count=30)
    monkeypatch.setattr(CastClock, "compare", lambda *_: unclear)
    with pytest.raises(CameraError, match=r"only 50 % of what moved agrees .* camera sync"):
        cast()
    unseen = dataclasses.replace(unclear, explained=0.1)
    monkeypatch.setattr(CastClock, "compare", lambda *_: unseen)
    assert cast()[1] == ""


# Delays of a USB camera differ by so much from start to start [s]; a second rises only.
DELAYS = (0.1, 0.9)


def test_a_delay_that_changes_between_casts_is_corrected_and_said(stream, cast, monkeypatch):
    starts, ends, track = [], [], EndpointTracker.track

    def spy(tracker, duration=None, start=0.0):
        starts.append(start)
        ends.append(tracker.frames[0][-1])
        return track(tracker, duration, start)

    monkeypatch.setattr(EndpointTracker, "track", spy)
    for late in DELAYS:
        stream.set_clock(CLOCK + late)
        timing, note = cast(late)
        said = re.fullmatch(r".* is off by (-\d+) ms in this cast, \+- \d ms: corrected", note)
        assert said is not None
        assert float(said[1]) == pytest.approx(-1e3 * late, abs=1e3 * OFFSET_MAX)
        # The track starts with the motion, and the film ends after all of it.
        assert starts[-1] == pytest.approx(timing.start_time + CLOCK + late, abs=OFFSET_MAX)
        assert ends[-1] > timing.end_time + CLOCK + late
