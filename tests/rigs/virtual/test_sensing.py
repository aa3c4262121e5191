"""What the virtual rig sees: exactly, through the camera's errors, or through the camera."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("mujoco")

from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.errors import InputError
from cablecast.rigs.virtual import RigVirtual, VirtualConfig
from cablecast.rigs.virtual.sensing import SensorErrorModel

QUICK = VirtualConfig(segment_count=10, dt=2e-3, reset_time=0.1, rest_time_max=1.0, sensing="exact")
ERROR_MODEL = dataclasses.replace(QUICK, sensing="error_model")
CAMERA = dataclasses.replace(QUICK, sensing="camera")
# What the camera is allowed to be off, in any sample [m].
CAMERA_ERROR = 5e-3


def distance(track, truth):
    count = min(len(track.times), len(truth.times))
    return np.linalg.norm(track.endpoint_xy[:count] - truth.endpoint_xy[:count], axis=1)


@pytest.fixture(scope="module")
def exact(setup, small_cast, cast):
    return RigVirtual(setup, 0, QUICK).execute_many([small_cast, cast])


def test_the_error_model_sees_the_endpoint_nearly_where_it_is(setup, small_cast, cast, exact):
    tracks = RigVirtual(setup, 0, ERROR_MODEL).execute_many([small_cast, cast])
    for track, truth in zip(tracks, exact, strict=True):
        off = distance(track, truth)
        assert 0.0 < np.nanmax(off) < CAMERA_ERROR
        np.testing.assert_allclose(np.diff(track.times), 0.1, atol=1e-9)
        # The same trial: only what is seen of it differs.
        np.testing.assert_allclose(track.nodes[:9], truth.nodes[:9], atol=1e-9)
    # What is seen depends on seed and trial alone.
    alone = RigVirtual(setup, 0, ERROR_MODEL)
    alone.reset()
    again = alone.execute(small_cast).endpoint_xy
    np.testing.assert_array_equal(again, tracks[0].endpoint_xy)


def test_the_camera_in_the_loop_sees_the_endpoint_nearly_where_it_is_and_says_what_it_cannot_see(
    setup, small_cast, exact
):
    pytest.importorskip("cv2")
    rig = RigVirtual(setup, 0, CAMERA)
    before = rig.sight()
    rig.reset()
    track = rig.execute(small_cast)
    assert track.status is TrialStatus.OK
    assert 0.0 < np.nanmax(distance(track, exact[0])) < CAMERA_ERROR
    assert np.isfinite(track.endpoint_xy).all(axis=1).mean() > 0.8

    assert RigVirtual(setup, 0, QUICK).sight() is None
    measured = RigVirtual(setup, 0, ERROR_MODEL).sight()
    # A cloth and a bottle cap of the marker's colour, which are seen in the first picture.
    places = [(-1.08, 0.42), (-0.95, 1.18), (0.2, 0.8)]
    np.testing.assert_array_equal(measured.is_blind_at(places), [True, True, False])
    np.testing.assert_array_equal(rig.sight().is_blind_at(places), [True, True, False])
    assert before.blind == ()
    np.testing.assert_allclose(before.position, measured.position, atol=0.02)


def test_an_endpoint_that_leaves_the_table_is_seen_to(setup, wild):
    track = RigVirtual(setup, 2, ERROR_MODEL).execute_many([wild])[0]
    assert track.status is TrialStatus.OFF_TABLE
    assert np.isnan(track.final_xy).all()


def test_a_broken_simulation_is_not_looked_at(setup):
    sensor = SensorErrorModel(setup)
    broken = EndpointTrack(
        times=np.arange(31) * 0.01,
        endpoint_xy=np.zeros((31, 2)),
        status=TrialStatus.NON_FINITE,
        nodes=np.full((31, 5, 3), np.nan),
    )
    track = sensor.observe(broken, None, np.random.default_rng(0))
    assert track.status is TrialStatus.NON_FINITE
    np.testing.assert_allclose(track.times, [0.0, 0.1, 0.2, 0.3])
    assert np.isnan(track.endpoint_xy).all()


def test_a_record_too_coarse_for_a_camera_is_refused(setup):
    sensor = SensorErrorModel(setup)
    coarse = EndpointTrack(
        times=np.arange(4) * 0.1,
        endpoint_xy=np.zeros((4, 2)),
        status=TrialStatus.OK,
        nodes=np.zeros((4, 5, 3)),
    )
    with pytest.raises(InputError, match=r"every 0\.100 s"):
        sensor.observe(coarse, None, np.random.default_rng(0))


def test_unknown_sensing_is_refused_and_the_known_is_listed():
    with pytest.raises(InputError, match=r"'x-ray'.*exact, error_model, camera"):
        VirtualConfig(sensing="x-ray")


def test_the_picture_shows_the_cable_where_the_last_trial_left_it(setup, small_cast, cast):
    pytest.importorskip("cv2")
    rig = RigVirtual(setup, 0, ERROR_MODEL)
    assert rig.picture() is None
    pictures, views = [], []
    for trajectory in (small_cast, cast):
        rig.reset()
        track = rig.execute(trajectory)
        pictures.append(rig.picture())
        views.append(rig._camera.view.to_image(track.nodes[-1, -1:])[0])
    assert rig.picture() is pictures[1]
    marked = [green_near(picture, pixel) for picture in pictures for pixel in views]
    # Each picture shows the marker at the end of its own trial alone.
    assert [found > 0 for found in marked] == [True, False, False, True]
    rig.close()
    assert rig.picture() is None


def green_near(picture, pixel, half=12):
    """Return how many pixels near another are as green as the marker at the free end."""
    u, v = np.round(pixel).astype(int)
    blue, green, red = np.moveaxis(
        picture[v - half : v + half, u - half : u + half].astype(int), -1, 0
    )
    return int(np.sum(green - np.maximum(blue, red) > 60))
