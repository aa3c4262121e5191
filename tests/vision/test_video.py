"""Video files."""

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.errors import InputError
from cablecast.vision.video import read_video, write_video

RATE = 60.0


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


def test_a_missing_video_is_refused(tmp_path):
    with pytest.raises(InputError, match="there is no video"):
        read_video(tmp_path / "b.mp4")


@pytest.mark.parametrize("content", [b"", b"not a video at all", bytes(5000)])
def test_a_file_that_is_no_video_is_refused(content, tmp_path):
    file = tmp_path / "b.mp4"
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
    def frames():
        yield np.zeros((96, 128, 3), np.uint8)
        raise RuntimeError("the renderer fails")

    with pytest.raises(RuntimeError, match="renderer"):
        write_video(tmp_path / "a.mp4", frames(), RATE)
    assert list(tmp_path.iterdir()) == []
