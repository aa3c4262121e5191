"""A camera that a process of its own reads: films, bad sources, missing frames."""

import os
import pathlib
import signal
import threading
import time

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.camera.settings import CameraSettings
from cablecast.errors import CameraError
from cablecast.vision.broadcast import Broadcast
from cablecast.vision.live import KEPT_COUNT, SLOT_COUNT, LiveCamera
from cablecast.vision.video import FilmWriter, encode_jpeg

# Streams count in microseconds, films in milliseconds.
TICK, FILM_TICK = 2e-6, 0.51e-3


# A stream opens at once only if its first picture fills the buffers that it is recognised by.
GRAIN = np.random.default_rng(0).integers(0, 60, (120, 160, 3), np.uint8)


def picture(value):
    return GRAIN + np.uint8(value)


@pytest.fixture
def broadcast():
    broadcast = Broadcast(160, 120, 60.0)
    broadcast.latest = encode_jpeg(picture(0))
    yield broadcast
    broadcast.unplug()


def read_or_none(camera):
    """Return the next frame; None where the stream has ended."""
    try:
        return camera.read()
    except CameraError:
        return None


def send_when_seen(broadcast, count, first=100.0):
    """Send frames of rising brightness once somebody looks."""

    def send():
        while not broadcast.viewers:
            time.sleep(0.01)
        for index in range(count):
            broadcast.send(encode_jpeg(picture(5 * index % 180)), first + index / 60)

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    return thread


def wait_until_all_is_read(camera):
    """Wait until the camera's process has slept for a while: nothing more is on its way."""
    seen = ""
    while set(seen[-20:]) != {"S"} or len(seen) < 20:
        stat = pathlib.Path(f"/proc/{camera._process.pid}/stat").read_text()
        seen += stat.rpartition(")")[2].split()[0]
        time.sleep(0.02)


def test_every_frame_of_a_film_arrives_however_slowly_it_is_looked_at(tmp_path):
    count = 2 * SLOT_COUNT
    with FilmWriter(tmp_path / "a.mkv", 60.0) as film:
        for index in range(count):
            film.write(picture(5 * index), index / 60 + 0.001 * (index % 3))
    with LiveCamera(CameraSettings(source=str(tmp_path / "a.mkv"))) as camera:
        assert (camera.facts.kind, camera.facts.width, camera.facts.height) == ("file", 160, 120)
        # The process waits for room when the first is fetched.
        wait_until_all_is_read(camera)
        frames = list(camera)
        assert camera.dropped_count == 0
        assert camera.read() is None
    expected = np.arange(count) / 60 + 0.001 * (np.arange(count) % 3)
    np.testing.assert_allclose([f.time for f in frames], expected, atol=FILM_TICK)
    assert np.all(np.diff([f.image.mean() for f in frames]) > 3)


def test_frames_of_a_stream_have_the_times_of_the_camera_and_not_of_their_arrival(broadcast):
    thread = send_when_seen(broadcast, 10, first=5000.0)
    with LiveCamera(CameraSettings(source=broadcast.url)) as camera:
        frames = [camera.read() for _ in range(10)]
    thread.join()
    times = [frame.time for frame in frames if frame is not None]
    np.testing.assert_allclose(times, 5000.0 + np.arange(10) / 60, atol=TICK)


def test_frames_that_nobody_fetches_are_dropped_and_counted(broadcast):
    count = 3 * SLOT_COUNT
    with LiveCamera(CameraSettings(source=broadcast.url)) as camera:
        send_when_seen(broadcast, count).join()
        broadcast.unplug()
        seen = 0
        while (frame := read_or_none(camera)) is not None:
            assert frame.time >= 100.0
            seen += 1
        assert seen >= SLOT_COUNT
        # What the network still holds when it is cut is lost as well, and nobody can count it.
        assert 0 < camera.dropped_count <= count - seen


def test_while_a_trial_is_filmed_every_frame_waits_until_there_is_no_room(broadcast):
    with LiveCamera(CameraSettings(source=broadcast.url)) as camera:
        camera.keep(every=True)
        send_when_seen(broadcast, 3 * SLOT_COUNT).join()
        frames = [camera.read() for _ in range(3 * SLOT_COUNT)]
        assert camera.dropped_count == 0
        times = [frame.time for frame in frames if frame is not None]
        np.testing.assert_allclose(times, 100.0 + np.arange(3 * SLOT_COUNT) / 60, atol=TICK)
        send_when_seen(broadcast, KEPT_COUNT + 2 * SLOT_COUNT, first=200.0).join()
        wait_until_all_is_read(camera)
        broadcast.unplug()
        seen = 0
        while read_or_none(camera) is not None:
            seen += 1
        assert seen == KEPT_COUNT
        assert camera.dropped_count == 2 * SLOT_COUNT


def test_one_bad_time_stamp_costs_one_frame(broadcast, monkeypatch):
    with LiveCamera(CameraSettings(source=broadcast.url)) as camera:
        reports = iter([{"slot": 0, "time": t, "arrival": t} for t in (10.0, 110.0, 10.05, 10.07)])
        monkeypatch.setattr(camera, "_report", lambda timeout: next(reports))
        assert [camera.read().time for _ in range(2)] == [10.0, 110.0]
        with pytest.raises(CameraError, match=r"10\.050000 s follows 110\.000000 s"):
            camera.read()
        assert camera.read().time == 10.07


def test_a_camera_that_is_unplugged_or_silent_is_an_error_that_says_so(broadcast):
    with LiveCamera(CameraSettings(source=broadcast.url)) as camera:
        with pytest.raises(CameraError, match=r"no frame for 0\.2 s: is it still plugged in"):
            camera.read(timeout=0.2)
        broadcast.unplug()
        with pytest.raises(CameraError, match="stopped: is it still plugged in"):
            camera.read()


def test_a_stream_without_stamps_is_read_by_the_clock_of_this_computer(broadcast):
    url = broadcast.url.replace(".nut", ".mjpg")
    thread = send_when_seen(broadcast, 6)
    begin = time.monotonic()
    with LiveCamera(CameraSettings(source=url, clock="arrival")) as camera:
        # The first tells the size of the pictures.
        frames = [camera.read() for _ in range(5)]
    thread.join()
    times = [frame.time for frame in frames if frame is not None]
    assert begin < times[0] < times[-1] < time.monotonic()
    assert times == [frame.arrival for frame in frames if frame is not None]


def test_a_source_that_cannot_be_opened_is_one_clear_line(tmp_path):
    with pytest.raises(CameraError, match=r"none\.mp4 cannot be opened: there is no such video"):
        LiveCamera(CameraSettings(source=str(tmp_path / "none.mp4")))


def test_a_reading_process_that_dies_is_an_error_and_not_a_wait(broadcast):
    with LiveCamera(CameraSettings(source=broadcast.url)) as camera:
        assert camera._process is not None
        os.kill(camera._process.pid, signal.SIGKILL)
        with pytest.raises(CameraError, match=r"the process that reads camera source .* ended"):
            camera.read()
    with pytest.raises(CameraError, match="closed"):
        camera.read()
