"""The tracker on rendered frames: how exact it is, and that it never guesses."""

import dataclasses
import functools

import numpy as np
import pytest

pytest.importorskip("cv2")

from tests.vision.player import CABLE, glide

from cablecast.arm.shape import arm_shape, sight_clearance
from cablecast.arm.ur import ArmUR
from cablecast.camera.lens import CameraView, Lens
from cablecast.cast import TrialStatus
from cablecast.errors import InputError
from cablecast.motion.trajectory import JointPath, joints_at
from cablecast.rigs.virtual.camera import VirtualCamera, track_film
from cablecast.rigs.virtual.config import CameraConfig, LightConfig
from cablecast.vision.calibration import Calibration
from cablecast.vision.tags import load_cv2
from cablecast.vision.tracker import (
    EndpointTracker,
    MarkerConfig,
    TrackerConfig,
    grab_of,
    green_places,
    pick_marker,
    sample_path,
    sight_of,
    track_samples,
    trial_status,
)
from cablecast.workspace import Workspace

# What the project asks of the tracker [m].
ERROR_RMS = 3e-3
# At most this far off in any frame: a tracker that took another green thing would be off by more.
ERROR_MAX = 8e-3
# So far below the arm's silhouette no part of the marker is in sight, so far beside it all is [m].
DEEP, CLEAR = -0.02, 0.035
# A pixel of a picture that is 320 px wide, on the table [m].
COARSE_PX = 0.012
ARM = ArmUR()


def still_arm(theta, reach):
    """Return an arm that holds its gripper over one place."""
    pose = [reach * np.sin(theta), reach * np.cos(theta), 0.02, theta, 0.0]
    q = ARM.inverse(np.array([pose, pose]))
    return JointPath(times=np.array([0.0, 10.0]), q=q, qd=np.zeros_like(q))


def hidden_place(camera, arm):
    """Where on the table the arm hides most [m], shape [2]."""
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 81), np.linspace(0.3, 0.7, 41))
    points = np.stack([x, y, np.full_like(x, CABLE.radius)], axis=-1).reshape(-1, 3)
    shape = arm_shape(joints_at(arm, np.zeros(len(points))), ARM)
    clearance = sight_clearance(points, camera.view.position, shape)
    assert clearance.min() < DEEP
    return points[clearance.argmin(), :2]


def follow(camera, calibration, trial, seed=0):
    """Track a film: return the tracker, the truth in its frames, and what it reported."""
    film = camera.film(trial, seed)
    tracker = track_film(film, calibration)
    times, xy = tracker.frames
    return tracker, trial.shape_at(times)[:, -1], xy


def errors(truth, xy):
    distance = np.linalg.norm(xy - truth[:, :2], axis=1)
    return distance[np.isfinite(distance)]


WAYS = [
    ((-1.25, 0.15), (-0.4, 1.35)),
    ((1.25, 1.38), (0.35, 0.9)),
    ((0.0, 1.22), (0.75, 0.7)),
    ((-0.6, 0.25), (0.6, 0.3)),
    ((0.55, 1.05), (1.3, 0.2)),
]


def test_the_endpoint_is_found_within_three_millimetres_all_over_the_table(
    virtual_camera, calibration
):
    all_errors, seen_count, frame_count = [], 0, 0
    for seed, (start, end) in enumerate(WAYS):
        tracker, truth, xy = follow(virtual_camera, calibration, glide(start, end), seed)
        all_errors.append(errors(truth, xy))
        seen_count += len(all_errors[-1])
        frame_count += len(xy)
        track = tracker.track()
        assert track.status is TrialStatus.OK
        # Samples come every 100 ms from the beginning of the motion.
        np.testing.assert_allclose(track.times, 0.1 * np.arange(6))
        sampled = glide(start, end).shape_at(track.times)[:, -1, :2]
        assert np.linalg.norm(track.endpoint_xy - sampled, axis=1).max() < ERROR_MAX
    joined = np.concatenate(all_errors)
    assert np.sqrt(np.mean(joined**2)) < ERROR_RMS
    assert joined.max() < ERROR_MAX
    # Nothing hides the marker on these ways.
    assert seen_count > 0.98 * frame_count


def test_blur_noise_and_unsteady_light_do_not_lose_the_marker(calibration, workspace):
    config = CameraConfig(
        noise=8.0,
        exposure=1 / 100,
        light=LightConfig(drift=0.25, drift_period=0.5, flicker=0.08, step=0.25),
    )
    trial = glide((0.5, 1.2), (-0.5, 0.75), duration=0.45)
    camera = VirtualCamera(config, workspace)
    _, truth, xy = follow(camera, calibration, trial, seed=5)
    found = errors(truth, xy)
    assert len(found) > 0.9 * len(xy)
    assert np.sqrt(np.mean(found**2)) < ERROR_RMS


def test_a_rolling_shutter_shifts_the_times_of_rows_and_not_the_endpoint(calibration, workspace):
    # A sensor that takes a whole frame's time to read its rows.
    row_time = 1 / 60 / 1080
    camera = VirtualCamera(CameraConfig(exposure=0.001, row_time=row_time), workspace)
    trial = glide((0.1, 0.4), (0.3, 1.4), duration=0.35, rest=0.0)
    film = camera.film(trial, 3)
    rms = {}
    for assumed in (0.0, row_time):
        config = TrackerConfig(marker_z=CABLE.radius, row_time=assumed)
        tracker = EndpointTracker(calibration.view, workspace, config, start_xy=(0.1, 0.4))
        for frame in range(10, film.frame_count):
            tracker.update(film.time(frame), film.grab(frame))
        times, xy = tracker.frames
        rms[assumed] = np.sqrt(np.mean(errors(trial.shape_at(times)[:, -1], xy) ** 2))
    assert rms[row_time] < ERROR_RMS
    # Eight milliseconds at up to 5 m/s: the sensor's effect is real, and it is undone.
    assert rms[0.0] > 2 * rms[row_time]


def test_below_the_arm_nothing_is_reported_and_behind_it_the_marker_is_found_again(
    virtual_camera, calibration
):
    arm = still_arm(0.0, 0.75)
    place = hidden_place(virtual_camera, arm)
    way = np.array([0.3, 0.03])
    trial = glide(place - way, place + way, duration=0.9, joint_path=arm, grip=(0.0, 0.75))
    tracker, truth, xy = follow(virtual_camera, calibration, trial, seed=2)
    times, _ = tracker.frames
    clearance = sight_clearance(
        truth, virtual_camera.view.position, arm_shape(joints_at(arm, times), ARM)
    )
    seen = np.isfinite(xy).all(axis=1)
    assert (clearance < DEEP).sum() >= 3
    assert not seen[clearance < DEEP].any()
    clear_after = np.flatnonzero((clearance > CLEAR) & (np.arange(len(times)) > clearance.argmin()))
    # A search of the whole image comes every third frame.
    assert seen[clear_after[3:]].all()
    assert errors(truth, xy).max() < ERROR_MAX
    assert tracker.track().status is TrialStatus.OK


def test_an_endpoint_that_ends_or_stays_below_the_arm_is_occluded_and_has_no_landing(
    virtual_camera, calibration
):
    arm = still_arm(0.0, 0.75)
    end = hidden_place(virtual_camera, arm)
    for start, duration in (((-0.4, 0.5), 0.4), (end, 0.1)):
        trial = glide(start, end, duration, joint_path=arm, grip=(0.0, 0.75))
        tracker, _, xy = follow(virtual_camera, calibration, trial)
        track = tracker.track()
        assert track.status is TrialStatus.OCCLUDED
        assert np.isnan(track.endpoint_xy[-1]).all()
        assert np.isnan(track.final_xy).all()
        # A marker that is never in sight is not replaced by another green thing.
        assert np.isfinite(xy).any() == (start is not end)


def test_an_endpoint_that_leaves_the_table_is_off_table(virtual_camera, calibration):
    trial = glide((1.0, 1.1), (1.45, 1.1), z=-0.2)
    tracker, _, xy = follow(virtual_camera, calibration, trial)
    assert tracker.track().status is TrialStatus.OFF_TABLE
    on_table = np.isfinite(xy).all(axis=1)
    assert on_table[:10].all()
    assert np.isnan(tracker.track().final_xy).all()


def test_a_film_that_goes_dark_gives_nothing_and_the_marker_is_found_when_light_returns(
    virtual_camera, calibration, workspace
):
    trial = glide((0.1, 1.2), (0.6, 1.0))
    film = virtual_camera.film(trial, 1)
    config = TrackerConfig(marker_z=CABLE.radius)
    tracker = EndpointTracker(calibration.view, workspace, config, start_xy=(0.1, 1.2))
    dark = range(15, 27)
    for frame in range(film.frame_count):
        grab = film.grab(frame)

        def piece(window, grab=grab, lit=frame not in dark):
            image = grab(window)
            return image if lit else np.zeros_like(image)

        tracker.update(film.time(frame), piece)
    _, xy = tracker.frames
    seen = np.isfinite(xy).all(axis=1)
    assert not seen[list(dark)].any()
    assert seen[: dark.start].all()
    assert seen[dark.stop + 3 :].all()


def test_times_of_frames_must_rise(calibration, workspace):
    tracker = EndpointTracker(calibration.view, workspace)
    black = np.zeros((1080, 1920, 3), np.uint8)
    tracker.update(0.0, grab_of(black))
    with pytest.raises(InputError, match="must rise"):
        tracker.update(0.0, grab_of(black))


def test_a_sample_between_frames_lies_between_their_points_and_never_across_a_gap():
    times = np.arange(7) / 30
    xy = np.stack([times, 2 * times], axis=1)
    xy[3] = np.nan
    sampled = sample_path(times, xy, np.array([0.0, 0.05, 0.1, 0.11, 0.15]))
    np.testing.assert_allclose(sampled[:2], [[0.0, 0.0], [0.05, 0.1]], atol=1e-12)
    assert np.isnan(sampled[2:4]).all()
    np.testing.assert_allclose(sampled[4], [0.15, 0.3], atol=1e-12)


@pytest.mark.parametrize(
    ("last_seen", "velocity", "status"),
    [
        ((1.30, 0.8), (3.0, 0.0), TrialStatus.OFF_TABLE),
        ((1.30, 0.8), (-0.1, 0.0), TrialStatus.OCCLUDED),
        ((0.0, 1.48), (0.0, 0.05), TrialStatus.OFF_TABLE),
        ((0.1, 0.02), (0.0, 0.0), TrialStatus.OCCLUDED),
        ((0.2, 0.4), (1.0, 0.0), TrialStatus.OCCLUDED),
    ],
    ids=["on its way out", "on its way in", "on the brink", "by the robot", "in the middle"],
)
def test_a_lost_endpoint_is_off_the_table_only_if_it_was_leaving(last_seen, velocity, status):
    times = np.arange(13) / 60
    xy = np.full((13, 2), np.nan)
    xy[:6] = np.asarray(last_seen) + (times[:6] - times[5])[:, None] * np.asarray(velocity)
    samples = sample_path(times, xy, np.array([0.0, 0.1, 0.2]))
    assert trial_status(times, xy, samples, Workspace()) is status


def test_an_endpoint_that_swept_past_the_edge_and_came_back_has_landed():
    times = np.arange(31) / 60
    x = 1.30 + 0.15 * np.sin(np.pi * np.arange(31) / 30)
    xy = np.stack([x, np.full(31, 0.8)], axis=1)
    samples = sample_path(times, xy, np.arange(6) * 0.1)
    assert trial_status(times, xy, samples, Workspace()) is TrialStatus.OK
    assert trial_status(times[:16], xy[:16], samples[:3], Workspace()) is TrialStatus.OFF_TABLE


RESTING = np.full((31, 2), [0.4, 0.9])
SLIDING = RESTING + np.linspace(-0.5, 0.0, 31)[:, None] * [1.0, 0.0]


@pytest.mark.parametrize(
    ("xy", "missed", "status"),
    [
        (RESTING, 1, TrialStatus.OK),
        (RESTING, 4, TrialStatus.OK),
        (RESTING, 8, TrialStatus.OCCLUDED),
        (SLIDING, 1, TrialStatus.OCCLUDED),
    ],
    ids=["one frame", "some frames", "too many frames", "still moving"],
)
def test_no_landing_hangs_on_the_last_frame(xy, missed, status):
    times = np.arange(31) / 60
    seen = xy.copy()
    seen[-missed:] = np.nan
    samples, found = track_samples(times, seen, np.arange(6) * 0.1, Workspace())
    assert found is status
    if status is TrialStatus.OK:
        np.testing.assert_allclose(samples[-1], [0.4, 0.9], atol=1e-12)
    else:
        assert np.isnan(samples[-1]).all()


@pytest.mark.parametrize(("hue", "width"), [(122.0, 1920), (90.0, 1280), (240.0, 960)])
def test_a_marker_of_any_colour_is_picked_from_a_picture(hue, width):
    config = dataclasses.replace(CameraConfig(), marker_hue=hue).resized(width)
    camera = VirtualCamera(config)
    image = camera.film(glide((0.6, 0.9), (0.6, 0.9)), 1).frame(3)
    found = pick_marker(image, camera.view, camera.workspace, (0.62, 0.92))
    assert found is not None
    # Of the drawn marker, which has a lighter middle; a pixel is 1.6 to 3.3 mm.
    assert found.hue == pytest.approx(hue, abs=6.0)
    assert found.length == pytest.approx(0.038, abs=0.004)
    assert found.width == pytest.approx(0.016, abs=0.003)
    assert pick_marker(image, camera.view, camera.workspace, (-0.5, 0.9)) is None


# The hue of the drawn cable_1, least difference that is told apart, and errors there [m].
CABLE_HUE, HUE_APART = 13.2, 20.0


@pytest.mark.parametrize("apart", [HUE_APART, -HUE_APART])
def test_a_marker_of_nearly_the_cable_s_hue_is_picked_and_followed(apart, small_calibration):
    hue = (CABLE_HUE + apart) % 360
    camera, calibration = small_calibration
    light = dataclasses.replace(camera.config.light, flicker=0.0, drift=0.0)
    camera.config = dataclasses.replace(camera.config, marker_hue=hue, light=light)
    trial = glide((-0.3, 0.9), (0.5, 1.1), rest=0.0)
    film = camera.film(trial, 4)
    found = pick_marker(film.frame(3), calibration.view, camera.workspace, (-0.3, 0.9))
    assert found is not None
    assert abs((found.hue - hue + 180) % 360 - 180) < 8.0
    # As is the marker of another hue, whose cable is not told apart.
    tracker = track_film(film, calibration, MarkerConfig(hue=found.hue))
    times, xy = tracker.frames
    found_errors = errors(trial.shape_at(times)[:, -1], xy)
    assert len(found_errors) == len(xy)
    assert np.sqrt(np.mean(found_errors**2)) < ERROR_RMS


def test_a_marker_of_the_cable_s_own_hue_is_refused_with_another_tape(small_calibration):
    camera, calibration = small_calibration
    camera.config = dataclasses.replace(camera.config, marker_hue=CABLE_HUE + 3.0)
    image = camera.film(glide((0.0, 1.2), (0.0, 1.2)), 1).frame(3)
    with pytest.raises(InputError, match=r"hue of 1\d deg.*at least 20 deg away, best of 19\d"):
        pick_marker(image, calibration.view, camera.workspace, (0.0, 1.2))


@pytest.fixture(scope="module")
def small_calibration():
    """Return a camera with 1280 columns, and its calibration."""
    camera = VirtualCamera(dataclasses.replace(CameraConfig(), exposure=0.001).resized(1280))
    return camera, Calibration(view=camera.view, rms_px=0.0, rms=0.0, corners={})


EVEN = LightConfig(drift=0.0, flicker=0.0, step=0.0)
# What the project asks of a tracker in bad light, against even light.
ERROR_RATIO, FOUND_MIN = 1.2, 0.98


@pytest.fixture(scope="module")
def lit_errors(virtual_camera, calibration):
    """Return a function that tracks one motion in a light: share of frames found, rms error [m]."""
    usual = virtual_camera.config
    trial = glide((-0.6, 0.75), (0.6, 1.1), rest=0.0)

    def look(light=EVEN, marker=None, **changes):
        config = dataclasses.replace(usual, exposure=0.001, light=light, **changes)
        virtual_camera.config = config
        tracker = track_film(virtual_camera.film(trial, 4), calibration, marker)
        times, xy = tracker.frames
        found = errors(trial.shape_at(times)[:, -1], xy)
        return len(found) / len(xy), float(np.sqrt(np.mean(found**2)))

    yield look
    virtual_camera.config = usual


@pytest.fixture(scope="module")
def even_rms(lit_errors):
    """Return the rms error [m] in even light, by the time that the sensor takes for a row [s]."""
    return functools.cache(lambda row_time: lit_errors(row_time=row_time)[1])


LIGHTS = {
    "flicker 100 Hz": {"light": dataclasses.replace(EVEN, lamp_flicker=0.5)},
    "flicker 120 Hz": {
        "light": dataclasses.replace(EVEN, lamp_flicker=0.5, lamp_rate=120.0),
        "frame_rate": 30.0,
    },
    "bands": {"light": dataclasses.replace(EVEN, lamp_flicker=0.3), "row_time": 1.4e-5},
    "green cast": {"light": dataclasses.replace(EVEN, cast=(1.0, 1.3, 1.0))},
    "too little green": {"light": dataclasses.replace(EVEN, cast=(1.0, 0.7, 1.0))},
    "blue cast": {"light": dataclasses.replace(EVEN, cast=(1.3, 1.0, 1.0))},
    "white balance": {
        "light": dataclasses.replace(EVEN, balance=(1.0, 1.3, 0.7), balance_time=0.4)
    },
    "dim": {"light": dataclasses.replace(EVEN, cast=(0.4, 0.4, 0.4))},
    "blue tape": {"marker_hue": 240.0},
    "LED green": {"marker_hue": 159.0, "marker": MarkerConfig()},
    "lost frames": {"dropped": 0.1},
}


@pytest.mark.parametrize("name", LIGHTS)
def test_light_and_colour_cost_neither_frames_nor_accuracy(lit_errors, even_rms, name):
    found, rms = lit_errors(**LIGHTS[name])
    assert found >= FOUND_MIN
    assert rms < ERROR_RATIO * even_rms(LIGHTS[name].get("row_time", 0.0))


def test_the_camera_knows_the_green_things_that_lie_on_the_table(virtual_camera, calibration):
    trial = glide((0.2, 0.8), (0.4, 0.9), duration=0.1, rest=0.0)
    tracker = track_film(virtual_camera.film(trial, seed=3), calibration)
    sight = sight_of(tracker)
    np.testing.assert_allclose(sight.position, virtual_camera.config.view.position, atol=0.02)
    # A cloth and a bottle cap; the marker itself is none of them.
    places = [(-1.08, 0.42), (-0.95, 1.18), (0.2, 0.8), (0.9, 1.1)]
    np.testing.assert_array_equal(sight.is_blind_at(places), [True, True, False, False])
    blind = np.array(sight.blind)
    assert (blind[:, 2] < 0.2).all()
    # One that has seen nothing knows of none.
    fresh = EndpointTracker(calibration.view, virtual_camera.workspace)
    assert sight_of(fresh).blind == ()


def test_a_green_thing_is_as_large_for_a_camera_that_is_turned():
    workspace = Workspace()
    view = CameraConfig.over(workspace).resized(320).view
    c = s = np.sqrt(0.5)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    view = dataclasses.replace(view, rotation=tuple(map(tuple, turn @ view.rotation)))
    v, u = np.mgrid[: view.lens.height, : view.lens.width]
    places = view.to_table(np.stack([u, v], axis=-1).astype(float))
    ((x, y, radius),) = green_places(
        np.linalg.norm(places - [0.3, 0.9], axis=-1) < 0.1, view, workspace
    )
    assert np.hypot(x - 0.3, y - 0.9) < COARSE_PX
    # A circle of the area of the square about the thing.
    assert radius == pytest.approx(0.1 * np.sqrt(4.0 / np.pi), abs=COARSE_PX)


WIDE = Lens(
    width=1920,
    height=1080,
    focal=(1150.0, 1150.0),
    centre=(959.5, 539.5),
    distortion=(-0.2, 0.02, 0.0, 0.0, 0.0),
)


def looking(position, lens):
    """Return a camera at a place that looks at the middle of the table."""
    forward = np.array([0.0, 0.75, 0.0]) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward])
    rotation = tuple(map(tuple, axes))
    return CameraView(lens=lens, rotation=rotation, position=tuple(np.asarray(position, float)))


@functools.cache
def bare(width, height):
    """Return a noisy picture of a table."""
    noise = np.random.default_rng(7).integers(0, 5, (height, width, 3))
    return (200 + noise).astype(np.uint8)


def painted(view, xy, marker):
    """Return a picture of a table with a marker along x, and nothing else."""
    cv2, fine = load_cv2(), 4
    turn = np.linspace(-np.pi / 2, np.pi / 2, 12)
    end = marker.width / 2 * np.column_stack([np.cos(turn), np.sin(turn)])
    end[:, 0] += (marker.length - marker.width) / 2
    outline = np.concatenate([end, -end]) + xy
    pixels = view.to_image(np.column_stack([outline, np.full(len(outline), CABLE.radius)]))
    low = np.floor(pixels.min(axis=0)).astype(int) - 8
    size = np.ceil(pixels.max(axis=0)).astype(int) + 8 - low
    patch = np.zeros((fine * size[1], fine * size[0]), np.float32)
    corners = np.round((pixels - low + 0.5) * fine - 0.5).astype(np.int32)
    cv2.fillPoly(patch, [corners], 1.0)
    patch = cv2.GaussianBlur(cv2.resize(patch, size, interpolation=cv2.INTER_AREA), (0, 0), 0.8)
    image = bare(view.lens.width, view.lens.height).copy()
    part = image[low[1] : low[1] + size[1], low[0] : low[0] + size[0]]
    part[:] = part + patch[..., None] * (np.array([40.0, 180.0, 40.0]) - 200.0)
    return image


@pytest.mark.parametrize(
    ("view", "end"),
    [
        (looking([0.16, 0.75, 1.8], Lens.from_view(1920, 1080, np.radians(78))), (-1.0, 0.6)),
        (looking([1.04, 0.75, 1.8], Lens.from_view(1920, 1080, np.radians(78))), (-1.0, 0.6)),
        (looking([0.0, 0.09, 1.8], Lens.from_view(1920, 1080, np.radians(78))), (0.3, 1.0)),
        (looking([0.0, 0.749, 1.7], WIDE), (1.15, 1.3)),
    ],
    ids=["5 degrees off", "30 degrees off", "from the robot's side", "wide lens"],
)
def test_a_marker_may_look_smaller_where_it_lands(view, end):
    start = np.array([0.0, 1.2])
    tracker = EndpointTracker(view, Workspace(), TrackerConfig(exposure_max=1e-3), start)
    for frame in range(30):
        share = min(max((frame - 2) / 20, 0.0), 1.0)
        xy = start + share**2 * (3 - 2 * share) * (np.array(end) - start)
        image = painted(view, xy, tracker.config.marker)
        found = tracker.update(frame / 60, grab_of(image))
        assert np.linalg.norm(found - xy) < 1e-3
    assert tracker.track().status is TrialStatus.OK
