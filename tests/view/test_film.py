import dataclasses
import io
import re

import numpy as np
import pytest

from cablecast.errors import InputError
from cablecast.motion.casting import Action
from cablecast.motion.trajectory import plan_trajectory
from cablecast.setup import Setup
from cablecast.view.film import FilmConfig, Painter, camera_behind_robot, frame_times, write_film
from cablecast.view.look import Shot, ShownCast
from cablecast.view.shapes import TABLE, viewpoint

SETUP = Setup()
TARGET = np.array([-0.6, 1.2])
SMALL = FilmConfig(width=128, height=72, frames_per_second=4)


@pytest.fixture(scope="module")
def shot():
    """Return a cast of a straight cable that is turned to the right."""
    times = np.linspace(0.0, 1.0, 11)
    turn = np.linspace(0.0, 1.0, 11)[:, None]
    s = np.linspace(0.6, 1.2, 9)[None]
    nodes = np.stack([s * np.sin(turn), s * np.cos(turn), np.full((11, 9), 0.01)], axis=-1)
    motion = plan_trajectory(Action(theta1=-0.5, theta2=0.3, r2=0.6), SETUP)
    cast = ShownCast(times=times, path=nodes[:, -1, :2], nodes=nodes, joint_path=motion.joint_path)
    return Shot(cast=cast, target_xy=TARGET, caption="moves", result="rests")


def test_a_camera_sees_what_it_looks_at_in_the_middle_and_far_things_small():
    view = camera_behind_robot(SETUP, 200, 100)
    look_at = viewpoint(SETUP, 2.0)[1]
    assert np.allclose(view.to_image(look_at), [100.0, 50.0])
    near, far = view.to_image(look_at + [[0.5, 0.0, 0.0], [0.5, 0.5, 0.0]])
    assert near[0] > far[0] > 100.0
    assert near[1] > far[1]


def test_the_table_is_painted_with_the_cable_where_it_is(shot):
    painter = Painter(SETUP, 320, 180)
    before, after = (np.asarray(painter.frame(shot, time), dtype=int) for time in (0.0, 1.0))
    camera = camera_behind_robot(SETUP, 320, 180)
    x, y = camera.to_image(shot.cast.nodes[-1, 6])
    column, row = round(float(x)), round(float(y))
    # The cable is blue and a pixel or two wide, on a table that is nearly red.
    patch = np.s_[row - 2 : row + 3, column - 2 : column + 3]
    blueness = [(image[patch][..., 2] - image[patch][..., 0]).max() for image in (before, after)]
    assert blueness[0] < 0
    assert blueness[1] > 60
    x, y = camera.to_image(np.array([1.1, 0.2, 0.0]))
    assert np.allclose(after[round(float(y)), round(float(x))], TABLE, atol=12)


def test_a_cast_off_the_table_has_no_landing_although_it_was_seen_to_its_end(shot):
    painter = Painter(SETUP, 320, 180)

    def picture(one, *tries):
        return np.asarray(painter.frame(one, one.cast.duration, tries))

    lost = dataclasses.replace(shot, landed=False)
    assert np.any(picture(shot) != picture(lost))
    aimless = [dataclasses.replace(one, target_xy=None) for one in (shot, lost)]
    np.testing.assert_array_equal(*map(picture, aimless))
    # Nor does the picture of a later try show one.
    elsewhere = dataclasses.replace(shot.cast, path=shot.cast.path - [0.8, 0.0])
    earlier = [dataclasses.replace(one, cast=elsewhere) for one in (shot, lost)]
    alone, landed, unlanded = (picture(shot, *tries) for tries in ((), earlier[:1], earlier[1:]))
    assert np.any(alone != landed)
    np.testing.assert_array_equal(alone, unlanded)


def test_frames_are_evenly_spaced_in_slow_motion_and_show_the_rest(shot):
    slow = FilmConfig(speed=0.25, frames_per_second=25)
    times = frame_times(shot.cast.duration, slow)
    assert np.allclose(np.diff(times), 0.01)
    assert times[-1] > shot.cast.duration


@pytest.mark.parametrize("rate", [4, 15])
def test_a_gif_holds_every_frame_and_its_duration(rate, shot, tmp_path):
    from PIL import Image

    config = dataclasses.replace(SMALL, frames_per_second=rate)
    seen = []
    write_film(tmp_path / "a.gif", SETUP, [shot], config, lambda p: seen.append(p.done))
    frames = len(frame_times(shot.cast.duration, config))
    assert seen == list(range(1, frames + 1))
    with Image.open(tmp_path / "a.gif") as film:
        assert film.size == (128, 72)
        durations = []
        for frame in range(film.n_frames):
            film.seek(frame)
            durations.append(film.info["duration"])
    # Equal frames are stored once, with the time of both.
    assert abs(sum(durations) - frames * 1000 / rate) <= 5


def test_an_mp4_plays_every_frame(shot, tmp_path):
    import av

    write_film(tmp_path / "a.mp4", SETUP, [shot], SMALL)
    with av.open(io.BytesIO((tmp_path / "a.mp4").read_bytes())) as film:
        assert film.streams.video[0].codec_context.name == "h264"
        assert sum(1 for _ in film.decode(video=0)) == len(frame_times(shot.cast.duration, SMALL))


def test_a_page_of_its_own_asks_for_nothing_from_elsewhere(shot, tmp_path):
    write_film(tmp_path / "a.html", SETUP, [shot], SMALL)
    text = (tmp_path / "a.html").read_text()
    assert "__VISER_EMBED_DATA__=" in text
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=\"?(https?:)?//", text)


def test_a_film_of_a_bad_size_of_an_unknown_kind_or_of_nothing_is_refused(shot, tmp_path):
    for changes, words in (
        ({"width": 127}, "must be even"),
        ({"height": 9}, "height = 9 is outside"),
        ({"frames_per_second": 0}, "frames_per_second = 0"),
        ({"speed": 0.0}, "speed = 0"),
    ):
        with pytest.raises(InputError, match=words):
            FilmConfig(**changes)
    with pytest.raises(InputError, match=r"one of \.html, \.mp4, \.gif"):
        write_film(tmp_path / "a.avi", SETUP, [shot], SMALL)
    with pytest.raises(InputError, match="casts to film = 0"):
        write_film(tmp_path / "a.gif", SETUP, [], SMALL)
    quick = dataclasses.replace(SMALL, frames_per_second=60)
    with pytest.raises(InputError, match="frames_per_second of a GIF = 60 is outside"):
        write_film(tmp_path / "a.gif", SETUP, [shot], quick)
