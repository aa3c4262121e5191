"""Films whose frames carry their own times."""

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.errors import InputError
from cablecast.vision.video import FilmWriter, picture, read_video

# Times are stored in microseconds.
TICK = 1e-6


def test_frames_keep_their_uneven_times(tmp_path):
    times = [7.0, 7.0167, 7.0333, 7.0912, 7.1, 7.1167]
    with FilmWriter(tmp_path / "a.mkv", 60.0) as film:
        for index, time in enumerate(times):
            film.write(np.full((48, 64, 3), 20 * index, np.uint8), time)
    info, frames = read_video(tmp_path / "a.mkv")
    pairs = list(frames)
    assert (info.width, info.height, info.rate) == (64, 48, 60.0)
    np.testing.assert_allclose([t for t, _ in pairs], np.array(times) - 7.0, atol=2 * TICK)
    assert np.all(np.diff([image.mean() for _, image in pairs]) > 10)


def test_a_film_that_was_not_finished_leaves_nothing(tmp_path):
    def film():
        with FilmWriter(tmp_path / "a.mkv", 60.0) as film:
            film.write(np.zeros((48, 64, 3), np.uint8), 0.0)
            assert len(list(tmp_path.iterdir())) == 1
            raise RuntimeError("the camera fails")

    with pytest.raises(RuntimeError, match="the camera fails"):
        film()
    assert list(tmp_path.iterdir()) == []


def test_a_time_before_the_first_frame_is_refused():
    with pytest.raises(InputError, match="time of a picture = -1"):
        picture(b"", -1.0)
