"""A table whose wood is brown and grained: `camera check` accepts it, and the tracker is exact."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("cv2")

from tests.vision.player import glide

from cablecast.camera.settings import CameraSettings
from cablecast.rigs.virtual.camera import TrialFilm, VirtualCamera, track_film
from cablecast.rigs.virtual.config import CameraConfig, LightConfig
from cablecast.setup import Setup
from cablecast.vision.check import CameraCheck
from cablecast.vision.live import CameraFacts, Frame
from cablecast.vision.plane import SeenPlane
from cablecast.vision.tags import load_cv2
from cablecast.vision.trials import calibrate_camera

WIDTH, RATE, FRAMES = 1120, 60.0, 36
EVEN = LightConfig(drift=0.0, flicker=0.0, step=0.0)
START, END = (0.0, 1.22), (0.55, 0.95)
# As on a white table [mm].
RMS_MAX = 1.2


def laid_with_wood(camera):
    """Draw wood below all but the tags' paper."""
    cv2, rng = load_cv2(), np.random.default_rng(2)
    height, width = camera.on_table.shape
    grain = rng.normal(0.0, 1.0, (height // 3, width // 60 + 2)).astype(np.float32)
    grain = cv2.resize(grain, (width, height), interpolation=cv2.INTER_CUBIC)
    plain = camera.on_table.astype(np.uint8)
    for tag in camera.layout.tags:
        centre = np.array([tag.x, tag.y])
        paper = (tag.corners[:, :2] - centre) * 1.3 + centre
        corners = camera.view.to_image(np.column_stack([paper, np.zeros(4)]))
        cv2.fillConvexPoly(plain, np.round(corners).astype(np.int32), 0)
    wood = camera.background * np.array([0.42, 0.62, 0.82]) * (1 + 0.12 * grain)[..., None]
    camera.background = np.where(plain[..., None] > 0, wood, camera.background).astype(np.uint8)


def test_a_wooden_table_needs_no_change():
    config = CameraConfig(exposure=0.001, light=EVEN).resized(WIDTH)
    camera = VirtualCamera(config)
    laid_with_wood(camera)
    lens = camera.view.lens
    size = {"width": lens.width, "height": lens.height}
    settings = CameraSettings(source="0", rate=RATE, lens=lens, clock_offset_sd=1e-3, **size)
    setup = Setup(camera=settings)
    # It starts where a reset lays the end.
    trial = glide(START, END, rest=0.05, grip=(0.0, setup.workspace.reset_y), bow=0.0)
    facts = CameraFacts(kind="device", backend="V4L2", fourcc="MJPG", exposure=1e-3, **size)
    check = CameraCheck(setup, facts)
    # Before the cast the scene stands still; the last pictures are those that are calibrated with.
    still = dataclasses.replace(trial, times=np.array([FRAMES / RATE]), nodes=trial.nodes[:1])
    before, images = TrialFilm(camera, still, 3), []
    for frame in before.arrivals:
        images = [*images[-3:], before.frame(frame)]
        time = before.time(frame) + 1.0
        check.look(Frame(time=time, arrival=900.0 + time, image=images[-1]))
    advice = check.report().advice()
    assert [line for line in advice if "something of the marker's colour" not in line] == []
    plane = SeenPlane.of(setup)
    tracker = track_film(TrialFilm(camera, trial, 3), calibrate_camera(images, setup.camera, plane))
    times, xy = tracker.frames
    errors = 1e3 * np.linalg.norm(xy - trial.shape_at(times)[:, -1, :2], axis=1)
    assert np.isfinite(errors).all()
    assert np.sqrt(np.mean(errors**2)) < RMS_MAX
