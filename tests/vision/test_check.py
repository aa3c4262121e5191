"""What a check of a camera advises."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.camera.settings import CameraSettings
from cablecast.errors import InputError
from cablecast.setup import Setup
from cablecast.vision.check import CameraCheck
from cablecast.vision.live import CameraFacts, Frame

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


def test_stamps_that_are_counted_and_not_measured_are_found_out():
    report = check(STREAM, even(rate=25.0), even(start=900.0))
    assert report.counted_stamps
    assert any("set `clock: arrival`" in line for line in report.advice())


def test_a_laboratory_whose_clock_runs_slower_is_not_taken_for_one_that_counts():
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


def test_a_device_that_does_it_is_left_in_peace_but_for_what_it_cannot_know():
    report = check(DEVICE, even(), even(start=900.0))
    assert [line for line in report.advice() if "tags" not in line and "lens" not in line] == []


def test_too_much_light_is_told():
    report = check(DEVICE, even(), even(start=900.0), value=255)
    assert any("is saturated: less light" in line for line in report.advice())


def test_two_frames_say_nothing():
    with pytest.raises(InputError, match="2 frames say nothing"):
        check(DEVICE, even(2), even(2))


def test_a_marker_of_too_few_pixels_is_told():
    report = check(STREAM, even(), even(start=900.0))
    for scale, is_told in ((300.0, True), (400.0, False)):
        advice = dataclasses.replace(report, px_per_m=scale).advice()
        assert any("the marker is" in line for line in advice) == is_told
