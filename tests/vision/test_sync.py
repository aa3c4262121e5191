"""The camera's clock against the robot's, with one cast and over the network."""

import dataclasses
import re

import numpy as np
import pytest

pytest.importorskip("cv2")

from tests.vision.player import Player

from cablecast.camera.settings import CameraSettings
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.errors import CameraError
from cablecast.motion.trajectory import plan_trajectory
from cablecast.pipeline.camera import SYNC_ACTION, sync_camera
from cablecast.rigs.base import RigLifecycle
from cablecast.rigs.virtual.camera import Film, VirtualCamera
from cablecast.rigs.virtual.camera_stream import CameraStream
from cablecast.rigs.virtual.config import CameraConfig
from cablecast.rigs.virtual.drawing import FilmedTrial
from cablecast.setup import Setup
from cablecast.vision.clock import (
    CastClock,
    ClockOffset,
    SeenMotion,
    reported_speed,
    sync_by_motion,
)
from cablecast.vision.trials import CameraOfTrials

RATE, CLOCK = 30.0, 321.25
WIDTH, HEIGHT = 640, 360
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
        timing = self.player.cast()
        if self.aborts:
            self.camera.cancel()
            return EndpointTrack(
                times=np.zeros(1), endpoint_xy=np.zeros((1, 2)), status=TrialStatus.ABORTED
            )
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
    nodes = poses[:, None, :3] + np.linspace(0, 1, 6)[:, None] * np.array([0.0, 0.5, -0.014])
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
    film, seen = Film(camera, late, 1), SeenMotion(config.row_time)
    for frame in range(film.frame_count):
        seen.look(film.frame(frame), film.time(frame) + CLOCK)
    found = sync_by_motion(seen, reported, setup.arm, camera.view)
    assert found.offset == pytest.approx(-CLOCK, abs=ROLLING_OFFSET_MAX)


def test_one_cast_tells_the_offset_of_the_clocks_over_the_network(setup, player):
    found = sync_camera(setup, lambda camera: PlayedRig(player, camera))
    assert found.offset == pytest.approx(-CLOCK, abs=OFFSET_MAX)
    assert 0 < found.sd < SD_MAX


def test_an_arm_that_rests_at_the_ends_of_its_record_rests_beyond_them():
    times = np.linspace(0.0, 1.0, 101)
    at = np.array([-3.0, 0.5, 4.0])
    still = reported_speed(times, 100 * (3 * times**2 - 2 * times**3), 0.02)(at)
    # The fastest point of that way is its middle, at 150 px/s.
    np.testing.assert_allclose(still, [0.0, 150.0, 0.0], rtol=1e-3)
    moving = reported_speed(times, 100 * times, 0.02)(at)
    np.testing.assert_allclose(moving, [np.nan, 100.0, np.nan])


def test_a_cast_that_was_aborted_tells_nothing(setup, player):
    with pytest.raises(CameraError, match="the cast was aborted"):
        sync_camera(setup, lambda camera: PlayedRig(player, camera, aborts=True))


@pytest.fixture(scope="module")
def kept(config, setup, trial):
    """Return the small pictures of a cast, the times of which are the robot's."""
    camera = VirtualCamera(config, setup.workspace, None, 0)
    film, clock = Film(camera, trial, 1), CastClock(config.width)
    for frame in range(film.LEAD, film.frame_count):
        clock.keep(film.frame(frame), film.time(frame))
    return clock, camera.view


@pytest.mark.parametrize("off", [0.0, 0.03, -0.11, 0.2])
def test_each_cast_tells_by_how_much_the_clocks_are_off(kept, setup, trial, off):
    clock, view = kept
    found = clock.compare(trial.joint_path, setup.arm, view, -off)
    assert found is not None
    assert found.offset == pytest.approx(off, abs=OFFSET_MAX)
    assert found.sd < SD_MAX
    assert found.explained > 0.7


def test_a_cast_whose_arm_stands_still_tells_nothing_of_the_clocks(kept, setup, trial):
    clock, view = kept
    path = trial.joint_path
    still = dataclasses.replace(path, q=np.repeat(path.q[:1], len(path.q), axis=0))
    assert clock.compare(still, setup.arm, view, 0.0) is None


def test_a_cast_whose_clocks_are_off_is_corrected_if_that_is_clear_and_else_refused(
    setup, player, monkeypatch
):
    off = 0.05
    camera = dataclasses.replace(setup.camera, clock_offset=-CLOCK + off, exposure=0.002)
    with CameraOfTrials(dataclasses.replace(setup, camera=camera)) as trials:

        def cast():
            trials.check(player.rewind() - off)
            trials.start()
            timing = player.cast()
            return trials.stop(dataclasses.replace(timing, joint_path=player.trial.joint_path))

        cast()
        assert trials.clock_words is not None
        assert re.search(
            r"off by -(4\d|5\d) ms in this cast, \+- \d ms: corrected", trials.clock_words
        )
        unclear = ClockOffset(offset=0.06, sd=0.02, explained=0.5, frame_count=30)
        monkeypatch.setattr(CastClock, "compare", lambda *_: unclear)
        with pytest.raises(CameraError, match=r"only 50 % of what moved agrees .* camera sync"):
            cast()
        unseen = dataclasses.replace(unclear, explained=0.1)
        monkeypatch.setattr(CastClock, "compare", lambda *_: unseen)
        cast()
        assert trials.clock_words is None
