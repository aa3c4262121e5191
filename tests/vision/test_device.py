"""What is asked of a camera, in which order, and what it answers."""

import pytest

pytest.importorskip("cv2")

import cv2

from cablecast.camera.settings import CameraSettings
from cablecast.errors import CameraError
from cablecast.vision.live import open_capture


class FakeDevice:
    """A USB camera that keeps the order of what it is asked."""

    def __init__(self, number, backend, answers=None):
        self.opened_as = (number, backend)
        self.asked = []
        self.values = answers or {}

    def isOpened(self):
        return True

    def getBackendName(self):
        return "V4L2"

    def set(self, key, value):
        self.asked.append((key, value))
        if key not in self.values:
            self.values[key] = value
        return True

    def get(self, key):
        return self.values.get(key, -1.0)


SETTINGS = CameraSettings(source="/dev/video2", exposure=0.001, focus=12.0)


def test_a_device_is_asked_for_format_size_rate_focus_and_exposure_in_that_order(monkeypatch):
    monkeypatch.setattr(cv2, "VideoCapture", FakeDevice)
    device, _ = open_capture(SETTINGS)
    assert device.opened_as == (2, cv2.CAP_V4L2)
    assert device.asked == [
        (cv2.CAP_PROP_FOURCC, cv2.VideoWriter_fourcc(*"MJPG")),
        (cv2.CAP_PROP_FRAME_WIDTH, 1920),
        (cv2.CAP_PROP_FRAME_HEIGHT, 1080),
        (cv2.CAP_PROP_FPS, 60.0),
        (cv2.CAP_PROP_AUTOFOCUS, 0),
        (cv2.CAP_PROP_FOCUS, 12.0),
        (cv2.CAP_PROP_AUTO_WB, 0),
        (cv2.CAP_PROP_AUTO_EXPOSURE, 3.0),
        (cv2.CAP_PROP_AUTO_EXPOSURE, 1.0),
        # V4L2 counts in tenths of a millisecond.
        (cv2.CAP_PROP_EXPOSURE, 10),
    ]


def facts_of(answers, monkeypatch):
    """Return what is known of a device that answers so, whatever it was asked for."""
    monkeypatch.setattr(cv2, "VideoCapture", lambda n, b: FakeDevice(n, b, answers))
    return open_capture(SETTINGS)[1]


def test_the_answers_of_a_device_are_read_back_and_what_it_does_not_know_is_unknown(monkeypatch):
    facts = facts_of(
        {
            cv2.CAP_PROP_EXPOSURE: 156.0,
            cv2.CAP_PROP_AUTO_EXPOSURE: 3.0,
            cv2.CAP_PROP_AUTO_WB: 1.0,
        },
        monkeypatch,
    )
    assert (facts.kind, facts.width, facts.height) == ("device", 1920, 1080)
    assert facts.fourcc == "MJPG"
    assert facts.exposure == pytest.approx(0.0156)
    assert facts.auto_exposure is True
    assert facts.autofocus is False
    assert facts.auto_balance is True
    unknown = (cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_AUTO_EXPOSURE, cv2.CAP_PROP_AUTOFOCUS)
    silent = dict.fromkeys(unknown, -1.0) | {cv2.CAP_PROP_FOURCC: 0.0}
    facts = facts_of(silent, monkeypatch)
    assert facts.exposure is facts.auto_exposure is facts.autofocus is None
    assert facts.fourcc == ""


@pytest.mark.parametrize(
    ("source", "words"),
    [("7", "no other program"), ("rtsp://h/1", "its address"), ("a.mp4", "no such video")],
)
def test_a_source_that_does_not_open_is_named_with_advice(source, words, monkeypatch):
    class Closed:
        def __init__(self, *arguments):
            pass

        def isOpened(self):
            return False

    monkeypatch.setattr(cv2, "VideoCapture", Closed)
    with pytest.raises(CameraError, match=words) as caught:
        open_capture(CameraSettings(source=source))
    assert f"camera source {source} cannot be opened" in str(caught.value)
    assert "\n" not in str(caught.value)
