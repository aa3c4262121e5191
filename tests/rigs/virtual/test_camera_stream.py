"""The virtual camera as a stream on the loopback address, and its faults."""

import dataclasses
import itertools
import threading

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.camera.settings import CameraSettings
from cablecast.errors import CameraError, UnknownNameError
from cablecast.rigs.virtual.camera_stream import FAULTS, MOVED_TAG, CameraStream
from cablecast.rigs.virtual.config import CameraConfig, LightConfig
from cablecast.setup import Setup
from cablecast.vision.live import LiveCamera
from cablecast.vision.tags import detect_tags

RATE, CLOCK = 30.0, 500.0
# The light is even: how much of its change a test sees would depend on how long it waited.
LIGHT = LightConfig(drift=0.0, flicker=0.0, step=0.0)
CONFIG = dataclasses.replace(CameraConfig(), frame_rate=RATE, light=LIGHT).resized(960)
# Times pass through a container that counts in microseconds.
TICK = 2e-6
# In small pictures a corner of a tag jumps by up to 2 px with the noise, and so the centre of a tag
# that lies still by half of that; the fault moves one by 20 px.
STILL_PX = 1.5


class Scene:
    """A laboratory whose clock stands still between calls."""

    def __init__(self, stream):
        self.stream = stream
        self.time = 0.0

    def play(self, duration, speed=0.0):
        """Show the cable, whose end moves to the right at some speed."""
        for _ in range(round(duration / 0.01)):
            y = np.linspace(0.6, 1.2, 10)
            x = np.full(10, speed * self.time)
            self.stream.show(self.time, None, np.column_stack([x, y, np.full(10, 0.005)]))
            self.time += 0.01
        self.stream.finish()

    def frames(self, camera, duration, speed=0.0):
        """Return what a camera sees meanwhile."""
        begin = self.time
        thread = threading.Thread(target=self.play, args=(duration, speed))
        thread.start()
        frames = []
        while not frames or frames[-1].time < CLOCK + begin + duration - 1.5 / RATE - 0.01:
            frames.append(camera.read())
        thread.join()
        return [frame for frame in frames if frame.time > CLOCK + begin]

    def connect(self):
        """Return a camera that reads the stream, which opens it only while pictures come."""
        connected = threading.Event()

        def play():
            while not connected.is_set():
                self.play(1 / RATE)

        thread = threading.Thread(target=play)
        thread.start()
        try:
            return LiveCamera(
                CameraSettings(source=self.stream.url, width=960, height=540, rate=RATE)
            )
        finally:
            connected.set()
            thread.join()


@pytest.fixture(scope="module")
def stream():
    with CameraStream(Setup(), CONFIG, clock=CLOCK) as stream:
        yield stream


@pytest.fixture(scope="module")
def scene(stream):
    return Scene(stream)


def tags(image):
    """Return centres of the tags that a picture shows [px]."""
    return {tag_id: quad.mean(axis=0) for tag_id, quad in detect_tags(image).items()}


def test_frames_come_at_whole_multiples_of_the_frame_time_each_with_fresh_noise(scene):
    with scene.connect() as camera:
        frames = scene.frames(camera, 0.4, speed=0.5)
        counts = (np.array([frame.time for frame in frames]) - CLOCK) * RATE
        np.testing.assert_allclose(counts, np.round(counts), atol=TICK * RATE)
        np.testing.assert_array_equal(np.diff(np.round(counts)), 1)
        # Nothing is sent twice, whether the scene moves or not.
        for seen in (frames, scene.frames(camera, 0.2)):
            assert all(np.any(a.image != b.image) for a, b in itertools.pairwise(seen))


def test_each_fault_looks_like_itself_and_ends(stream, scene):
    with scene.connect() as camera:
        usual = scene.frames(camera, 0.2)[-1].image
        stream.fault("frozen")
        frozen = scene.frames(camera, 0.2)
        assert all(np.array_equal(frame.image, frozen[0].image) for frame in frozen)
        stream.fault("black")
        assert scene.frames(camera, 0.2)[-1].image.mean() < 5
        stream.fault("exposed")
        assert scene.frames(camera, 0.2)[-1].image.mean() > 1.2 * usual.mean()
        stream.fault("moved_tag")
        before, after = tags(usual), tags(scene.frames(camera, 0.2)[-1].image)
        moved = [i for i in before if np.abs(after[i] - before[i]).max() > STILL_PX]
        assert moved == [MOVED_TAG]
        stream.fault("unplugged")
        # A picture or two may still be on their way.
        with pytest.raises(CameraError, match="still plugged in"):
            _ = [camera.read() for _ in range(4)]
    with pytest.raises(CameraError, match="cannot be opened"):
        scene.connect()
    stream.fault(None)
    with scene.connect() as camera:
        image = scene.frames(camera, 1.0)[-1].image
    assert image.mean() == pytest.approx(usual.mean(), rel=0.01)
    assert np.abs(tags(image)[MOVED_TAG] - before[MOVED_TAG]).max() < STILL_PX


def test_a_fault_that_does_not_exist_is_refused_with_those_that_do(stream):
    with pytest.raises(UnknownNameError, match=", ".join(FAULTS)):
        stream.fault("tired")
