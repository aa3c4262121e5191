"""What a check of a camera advises."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.camera.settings import CameraSettings
from cablecast.errors import CameraError, InputError
from cablecast.rigs.virtual.camera import TrialFilm, VirtualCamera
from cablecast.rigs.virtual.config import CameraConfig, LightConfig
from cablecast.rigs.virtual.drawing import FilmedTrial
from cablecast.setup import Setup
from cablecast.vision.check import CameraCheck
from cablecast.vision.live import Brightness, CameraFacts, Frame, FrameWatch

STREAM = CameraFacts(kind="stream", backend="FFMPEG", width=64, height=64)
DEVICE = CameraFacts(
    kind="device", backend="V4L2", width=64, height=64, fourcc="MJPG", exposure=0.001
)
SETTINGS = CameraSettings(source="0", width=64, height=64, clock_offset_sd=0.001)


def check(facts, times, arrivals, dropped=0, value=120, **settings):
    setup = Setup(camera=dataclasses.replace(SETTINGS, **settings))
    looked = CameraCheck(setup, facts)
    rng = np.random.default_rng(0)
    for time, arrival in zip(times, arrivals, strict=True):
        image = np.clip(rng.normal(value, 3, (64, 64, 3)), 0, 255).astype(np.uint8)
        looked.look(Frame(time=float(time), arrival=float(arrival), image=image))
    return looked.report(dropped)


def even(count=60, rate=60.0, start=0.0):
    return start + np.arange(count) / rate


def test_stamps_that_are_counted_and_not_measured_are_found_out_and_a_slow_clock_is_none():
    report = check(STREAM, even(rate=25.0), even(start=900.0))
    assert report.counted_stamps
    assert any("set `clock: arrival`" in line for line in report.advice())
    report = check(STREAM, even(start=500.0), even(rate=20.0, start=900.0))
    assert not report.counted_stamps
    assert not any("frames/s" in line for line in report.advice())


def test_a_device_that_does_not_do_what_it_was_told_is_named_point_by_point():
    facts = dataclasses.replace(
        DEVICE, width=48, fourcc="YUYV", exposure=0.016, auto_exposure=True, autofocus=True
    )
    report = check(facts, even(rate=30.0), even(rate=30.0, start=900.0), dropped=3)
    said = " / ".join(report.advice())
    for words in (
        "the pictures have 48 x 64 px",
        "the pixel format is YUYV, not MJPG",
        "30.0 frames/s come instead of 60",
        "dropped 3 frames",
        "exposure is automatic",
        "the exposure is 16.00 ms, not 1.00 ms",
        "focus is automatic",
        # 5 m/s for 16 ms.
        "smears 80 mm",
        "0 of the layout's 11 tags",
    ):
        assert words in said
    assert report.blur == pytest.approx(0.08)


@pytest.fixture(scope="module")
def good():
    """Return the report on a device that does what it was told."""
    return check(DEVICE, even(), even(start=900.0))


def test_a_device_that_does_it_is_left_in_peace_but_for_what_it_cannot_know(good):
    assert [line for line in good.advice() if "tags" not in line and "lens" not in line] == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"repeated_count": 7}, "7 of 60 frames are the one before again"),
        ({"px_per_m": 300.0}, "the marker is"),
        ({"refocused": 0.6}, "the focus changed in"),
    ],
)
def test_repeated_frames_a_marker_of_few_pixels_and_a_lost_focus_are_told(good, changes, words):
    fine = dataclasses.replace(good, px_per_m=400.0)
    assert not any(words in line for line in fine.advice())
    assert any(words in line for line in dataclasses.replace(fine, **changes).advice())


def test_too_much_light_is_told_and_two_frames_say_nothing():
    report = check(DEVICE, even(), even(start=900.0), value=255)
    assert any("is saturated: less light" in line for line in report.advice())
    with pytest.raises(InputError, match="2 frames say nothing"):
        check(DEVICE, even(2), even(2))


def lit_check(facts, frame_rate, light, row_time=0.0, seconds=1.5, **settings):
    """Return a check of a table without cable, in a light, by the virtual camera."""
    config = CameraConfig(
        frame_rate=frame_rate, exposure=0.001, row_time=row_time, light=light
    ).resized(320)
    nodes = np.full((1, 4, 3), [0.0, -3.0, 0.0])
    cable = Setup().cable
    still = FilmedTrial(cable=cable, times=np.array([seconds]), nodes=nodes, joint_path=None)
    film = TrialFilm(VirtualCamera(config), still, 4)
    asked = {"width": 320, "height": 180, "rate": frame_rate, **settings}
    setup = Setup(camera=dataclasses.replace(SETTINGS, **asked))
    looked = CameraCheck(setup, dataclasses.replace(facts, width=320, height=180))
    for frame in film.arrivals:
        time = film.time(frame) + 3.0
        looked.look(Frame(time=time, arrival=900.0 + time, image=film.frame(frame)))
    return looked.report()


EVEN = LightConfig(drift=0.0, flicker=0.0, step=0.0)


@pytest.mark.parametrize(("frame_rate", "amplitude"), [(30.0, 0.1), (60.0, 0.3), (120.0, 0.1)])
def test_flicker_is_recognised_by_its_beat_and_weighed_against_blur(frame_rate, amplitude):
    light = dataclasses.replace(EVEN, lamp_flicker=amplitude, lamp_rate=100.2)
    report = lit_check(DEVICE, frame_rate, light)
    assert report.flicker is not None
    assert report.flicker.rate == 100.0
    # A white table is saturated in the brightest phase.
    assert 0.5 * amplitude < report.flicker.amplitude < 1.2 * amplitude
    assert report.flicker.row_time is None
    assert any("exposure of 10.0 ms, too, but a tip at 5 m/s" in line for line in report.advice())


def test_even_light_and_a_slow_change_of_it_are_no_flicker():
    for light in (EVEN, dataclasses.replace(EVEN, drift=0.1, drift_period=4.0)):
        assert lit_check(DEVICE, 60.0, light).flicker is None


def test_rolling_bands_tell_the_row_time():
    row_time = 0.8 / 60 / 180
    light = dataclasses.replace(EVEN, lamp_flicker=0.3, lamp_rate=100.2)
    report = lit_check(DEVICE, 60.0, light, row_time=row_time * 320 / 1920)
    assert report.flicker is not None
    assert report.flicker.row_time == pytest.approx(row_time, rel=0.1)
    assert any("set `row_time: " in line for line in report.advice())


def test_a_white_balance_that_drifts_is_told():
    light = dataclasses.replace(EVEN, balance=(1.0, 0.85, 1.0), balance_time=1.5)
    report = lit_check(DEVICE, 60.0, light)
    said = [line for line in report.advice() if "white balance" in line]
    assert len(said) == 1
    assert said[0].startswith("green changed by -")
    told = dataclasses.replace(report, facts=dataclasses.replace(DEVICE, auto_balance=True))
    assert any("white balance is automatic" in line for line in told.advice())


def test_a_lens_that_loses_its_focus_is_told_in_each_frame(good):
    small = CameraConfig().resized(960)
    sharp, blurred = (VirtualCamera(dataclasses.replace(small, blur=blur)) for blur in (0.7, 2.5))
    first = sharp.empty_frame(0)
    watch = FrameWatch("0", Brightness.of(first))
    for k, gain in enumerate((1.0, 0.4, 1.2)):
        image = np.clip(gain * sharp.empty_frame(k), 0, 255).astype(np.uint8)
        assert watch.look(Frame(time=k / 60, arrival=k / 60, image=image))
    out_of_focus = blurred.empty_frame(0)
    with pytest.raises(CameraError, match=r"out of focus: edges are 0\.\d\d times as sharp"):
        watch.look(Frame(time=1.0, arrival=1.0, image=out_of_focus))
    for image, words in ((first, []), (out_of_focus, ["the picture is blurred: focus the lens"])):
        told = dataclasses.replace(good, brightness=Brightness.of(image))
        assert [line[:38] for line in told.advice() if "focus" in line] == words
