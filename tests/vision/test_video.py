"""Video files, and films whose frames carry their own times."""

import io
import resource
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.errors import InputError, MissingExtraError
from cablecast.vision.video import FilmWriter, JpegMuxer, read_video, write_video

RATE = 60.0
# Films count in milliseconds.
FILM_TICK = 0.51e-3


@pytest.fixture
def video(tmp_path):
    """Forty small frames that grow brighter."""
    frames = (np.full((96, 128, 3), 5 * i, np.uint8) for i in range(40))
    assert write_video(tmp_path / "a.mp4", frames, RATE) == 40
    return tmp_path / "a.mp4"


def test_frames_come_back_in_order_with_their_times(video):
    info, frames = read_video(video)
    pairs = list(frames)
    assert (info.width, info.height, info.frame_count) == (128, 96, 40)
    np.testing.assert_allclose([t for t, _ in pairs], np.arange(40) / RATE, atol=1e-3)
    assert np.all(np.diff([image.mean() for _, image in pairs]) > 0)


def test_a_file_that_is_missing_or_no_video_is_refused(tmp_path):
    file = tmp_path / "b.mp4"
    with pytest.raises(InputError, match="there is no video"):
        read_video(file)
    for content in (b"", b"not a video at all", bytes(5000)):
        file.write_bytes(content)
        with pytest.raises(InputError, match="no video that can be read"):
            read_video(file)


def test_a_video_that_was_cut_short_is_refused(video):
    # The index of an MP4 stands at its end, so the frames' data is what is missing: zero it.
    content = bytearray(video.read_bytes())
    start = content.index(b"mdat") + 4
    moov = content.index(b"moov")
    cut = start + (moov - start) // 8
    content[cut : moov - 4] = bytes(moov - 4 - cut)
    video.write_bytes(content)
    _, frames = read_video(video)
    with pytest.raises(InputError, match=r"damaged|no frame"):
        list(frames)


def test_nothing_is_left_of_a_video_whose_frames_fail(tmp_path):
    def film():
        with FilmWriter(tmp_path / "a.mkv", 60.0) as film:
            film.write(np.zeros((48, 64, 3), np.uint8), 0.0)
            assert len(list(tmp_path.iterdir())) == 1
            raise RuntimeError("the camera fails")

    with pytest.raises(RuntimeError, match="the camera fails"):
        film()
    assert list(tmp_path.iterdir()) == []

    def frames():
        yield np.zeros((96, 128, 3), np.uint8)
        raise RuntimeError("the renderer fails")

    with pytest.raises(RuntimeError, match="renderer"):
        write_video(tmp_path / "a.mp4", frames(), RATE)
    assert list(tmp_path.iterdir()) == []


def test_frames_keep_their_uneven_times(tmp_path):
    times = [7.0, 7.0167, 7.0333, 7.0912, 7.1, 7.1167]
    with FilmWriter(tmp_path / "a.mkv", 60.0) as film:
        for index, time in enumerate(times):
            film.write(np.full((48, 64, 3), 20 * index, np.uint8), time)
    info, frames = read_video(tmp_path / "a.mkv")
    pairs = list(frames)
    assert (info.width, info.height, info.rate) == (64, 48, 60.0)
    np.testing.assert_allclose([t for t, _ in pairs], np.array(times) - 7.0, atol=FILM_TICK)
    assert np.all(np.diff([image.mean() for _, image in pairs]) > 10)


WRITER = """
import pathlib, sys
import numpy as np
from cablecast.vision.video import FilmWriter

film = FilmWriter(pathlib.Path(sys.argv[1]), 60.0)
for index in range(100_000):
    film.write(np.full((48, 64, 3), index % 250, np.uint8), index / 60 + 0.002 * (index % 3))
    print(index, flush=True)
"""


def test_what_a_killed_process_filmed_can_be_read_but_for_the_last_frame(tmp_path):
    words = [sys.executable, "-c", WRITER, str(tmp_path / "a.mkv")]
    with subprocess.Popen(words, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        for _ in range(40):
            process.stdout.readline()
        process.kill()
        process.stdout.read()
    (part,) = tmp_path.iterdir()
    times = np.array([time for time, _ in read_video(part)[1]])
    assert len(times) >= 39
    index = np.arange(len(times))
    np.testing.assert_allclose(times, index / 60 + 0.002 * (index % 3), atol=FILM_TICK)


def test_a_film_that_fills_the_disk_is_an_error_of_the_system_and_leaves_nothing(tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    noise = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)

    def film():
        with FilmWriter(tmp_path / "a.mkv", 60.0) as film:
            for index in range(100):
                film.write(noise, index / 60)

    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            film()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []


def test_a_film_without_its_library_is_refused_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with (
        pytest.raises(MissingExtraError, match="needs PyAV"),
        FilmWriter(tmp_path / "a.mkv", 60.0) as film,
    ):
        film.write(np.zeros((48, 64, 3), np.uint8), 0.0)
    assert list(tmp_path.iterdir()) == []


def test_a_time_before_the_first_frame_is_refused():
    with pytest.raises(InputError, match="time of a picture = -1"):
        JpegMuxer(io.BytesIO(), "nut", 64, 48, 60.0).write(b"", -1.0)


def test_frames_of_odd_size_keep_it(tmp_path):
    frames = (np.full((51, 37, 3), 10 * index, np.uint8) for index in range(5))
    assert write_video(tmp_path / "a.mp4", frames, RATE) == 5
    info, read = read_video(tmp_path / "a.mp4")
    assert (info.width, info.height, len(list(read))) == (37, 51, 5)
