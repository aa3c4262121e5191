"""The camera over the virtual table, and the model of its errors."""

import dataclasses
import itertools
import json

import numpy as np
import pytest

from cablecast.arm.shape import arm_shape, sight_clearance
from cablecast.arm.ur import ArmUR
from cablecast.errors import InputError
from cablecast.motion.trajectory import JointPath, joints_at
from cablecast.rigs.virtual.config import CameraConfig, LightConfig
from cablecast.rigs.virtual.sensing import CameraErrorModel

CABLE_RADIUS = 0.0055
ARM = ArmUR()
# Two distributions estimated from some 180 frames of four clips each [m].
MEAN_AGREEMENT = 0.4e-3
RMS_AGREEMENT = 0.5e-3
# Parts of the frames near the arm in which the marker is seen, from some ninety frames.
SEEN_AGREEMENT = 0.15


def quiet(model, **changes):
    """Return a model without its random errors."""
    zero = ("place_sd", "noise_sd", "noise_per_speed", "edge_sd", "hidden_spread", "miss_rate")
    return dataclasses.replace(
        model, **{name: 0.0 for name in zero} | {"blind": (), "delay": 0.0} | changes
    )


def arm_at(theta, reach, arm=ARM):
    pose = [reach * np.sin(theta), reach * np.cos(theta), 0.02, theta, 0.0]
    q = arm.inverse(np.array([pose, pose]))
    return JointPath(times=np.array([0.0, 1.0]), q=q, qd=np.zeros_like(q))


def observe(model, points, joint_path=None, seed=0):
    times = np.arange(len(points)) / 60
    rng = np.random.default_rng(seed)
    return model.observe(times, points, joint_path, CABLE_RADIUS, rng, ARM)


def test_the_error_model_sees_what_it_should_and_hides_what_geometry_hides():
    model = quiet(CameraErrorModel.load(), bias=((0.0,) * 6,) * 2)
    camera = np.array(model.camera)
    arm = arm_at(0.0, 0.75)
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 41), np.linspace(0.3, 0.7, 21))
    table = np.stack([x, y, np.full_like(x, CABLE_RADIUS)], axis=-1).reshape(-1, 3)
    clearance = sight_clearance(table, camera, arm_shape(joints_at(arm, np.zeros(len(table))), ARM))
    below_arm, clear = table[clearance.argmin()], table[clearance.argmax()]
    assert np.isnan(observe(model, below_arm[None], arm)).all()
    np.testing.assert_allclose(observe(model, clear[None], arm)[0], clear[:2], atol=1e-9)
    np.testing.assert_allclose(observe(model, below_arm[None])[0], below_arm[:2], atol=1e-9)
    assert np.isnan(observe(model, np.array([[1.40, 0.8, -0.3]]))).all()
    assert np.isnan(observe(model, np.array([[2.5, 0.8, 0.0]]))).all()


def test_a_raised_endpoint_seems_farther_from_the_camera():
    model = quiet(CameraErrorModel.load(), bias=((0.0,) * 6,) * 2)
    seen = observe(model, np.array([[1.0, 1.2, CABLE_RADIUS + 0.05]]))[0]
    camera = np.array(model.camera)
    scale = (camera[2] - CABLE_RADIUS) / (camera[2] - CABLE_RADIUS - 0.05)
    np.testing.assert_allclose(seen, camera[:2] + scale * (np.array([1.0, 1.2]) - camera[:2]))


def test_a_marker_on_another_green_thing_is_not_told_from_it():
    model = quiet(CameraErrorModel.load(), blind=((-1.0, 0.4, 0.1),))
    seen = observe(model, np.array([[-1.05, 0.42, 0.005], [-0.8, 0.4, 0.005]]))
    assert np.isnan(seen[0]).all()
    assert np.isfinite(seen[1]).all()


def test_the_noise_of_the_model_is_what_its_file_says():
    model = dataclasses.replace(
        quiet(CameraErrorModel.load(), bias=((0.0,) * 6,) * 2), noise_sd=2e-4, place_sd=5e-4
    )
    points = np.tile([0.3, 0.9, CABLE_RADIUS], (30, 1))
    errors = np.array([observe(model, points, seed=i) - points[:, :2] for i in range(300)])
    # 300 draws know a standard deviation to 4 %.
    assert errors.std(axis=1).mean() == pytest.approx(2e-4, rel=0.12)
    assert errors.mean(axis=1).std() == pytest.approx(5e-4, rel=0.12)


def test_an_error_model_survives_its_file(tmp_path):
    model = CameraErrorModel.load()
    model.save(tmp_path / "error.json")
    assert CameraErrorModel.load(tmp_path / "error.json") == model


@pytest.mark.parametrize("change", [{"bias": [[0]]}, {"noise_sd": -1.0}, {"unknown": 1}])
def test_a_damaged_error_model_is_refused(change, tmp_path):
    CameraErrorModel.load().save(tmp_path / "error.json")
    values = json.loads((tmp_path / "error.json").read_text()) | change
    (tmp_path / "error.json").write_text(json.dumps(values))
    with pytest.raises(InputError):
        CameraErrorModel.load(tmp_path / "error.json")


@pytest.fixture(scope="module")
def clips(virtual_camera, calibration):
    """Filmed and tracked motions, half of them by the arm."""
    from tools.fit_camera_error import clip_trial, measure

    # Other motions than those that the model was fitted to.
    clips = measure(virtual_camera, calibration, 4, seed=77)
    return clips, [
        clip_trial(np.random.default_rng([77, i]), i).joint_path for i in range(len(clips))
    ]


def test_the_error_model_and_the_rendered_camera_agree_in_mean_and_rms(clips):
    model = CameraErrorModel.load()
    rendered, drawn, seen_rendered, seen_drawn = [], [], 0, 0
    for i, (clip, joint_path) in enumerate(zip(*clips, strict=True)):
        xy = model.observe(
            clip.times,
            clip.points,
            joint_path,
            clip.marker_z,
            np.random.default_rng(i),
            ARM,
        )
        rendered.append(clip.tracked_xy - clip.points[:, :2])
        drawn.append(xy - clip.points[:, :2])
        near = np.abs(clip.clearance) < 0.06
        seen_rendered += np.isfinite(clip.tracked_xy[near, 0]).sum()
        seen_drawn += np.isfinite(xy[near, 0]).sum()
    near_count = sum((np.abs(clip.clearance) < 0.06).sum() for clip in clips[0])
    ours, theirs = (np.concatenate(errors) for errors in (rendered, drawn))
    ours, theirs = (e[np.isfinite(e).all(axis=1)] for e in (ours, theirs))
    assert np.linalg.norm(ours.mean(axis=0) - theirs.mean(axis=0)) < MEAN_AGREEMENT
    rms = [np.sqrt(np.mean(np.sum(e**2, axis=1))) for e in (ours, theirs)]
    assert abs(rms[0] - rms[1]) < RMS_AGREEMENT
    assert abs(seen_rendered - seen_drawn) / near_count < SEEN_AGREEMENT


def test_a_fit_to_clips_finds_the_errors_that_they_were_made_with(
    clips, virtual_camera, calibration
):
    from tools.fit_camera_error import fit_error_model

    truth = dataclasses.replace(
        quiet(CameraErrorModel.load()), noise_sd=3e-4, delay=0.004, bias=((2e-3, *(0.0,) * 5),) * 2
    )
    made = []
    for i, clip in enumerate(clips[0]):
        rng = np.random.default_rng(i)
        xy = truth.observe(clip.times, clip.points, None, clip.marker_z, rng, ARM)
        nowhere, no_arm = np.empty((0, 3)), np.full(len(xy), np.inf)
        made.append(dataclasses.replace(clip, tracked_xy=xy, clearance=no_arm, blind=nowhere))
    found = fit_error_model(made, virtual_camera, calibration, 0)
    assert found.noise_sd == pytest.approx(3e-4, rel=0.1)
    assert found.delay == pytest.approx(0.004, rel=0.05)
    # The fit's camera stands where its calibration says, a millimetre from the model's.
    np.testing.assert_allclose([row[0] for row in found.bias], 2e-3, atol=3e-4)


def test_a_piece_of_a_frame_equals_that_part_of_the_whole(virtual_camera):
    from tools.fit_camera_error import clip_trial

    film = virtual_camera.film(clip_trial(np.random.default_rng([0, 1]), 1), seed=4)
    whole = film.frame(25)
    assert whole.shape == (1080, 1920, 3)
    for left, top, right, bottom in (
        (900, 500, 1100, 640),
        (0, 0, 90, 70),
        (1850, 900, 1920, 1080),
    ):
        piece = film.piece(25, (left, top, right, bottom))
        np.testing.assert_array_equal(piece, whole[top:bottom, left:right])


def test_films_of_equal_seeds_are_equal_and_others_differ_in_light_and_noise(virtual_camera):
    from tools.fit_camera_error import clip_trial

    trial = clip_trial(np.random.default_rng([0, 0]), 0)
    window = (800, 400, 1000, 600)
    one, same, other = (virtual_camera.film(trial, seed).piece(9, window) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)


STEADY = LightConfig(drift=0.0, flicker=0.0, step=0.0)


def small_film(light=STEADY, duration=1.0, **changes):
    """Return a film of a cable at rest, of few pixels and without noise."""
    pytest.importorskip("cv2")
    from cablecast.cable import load_cable
    from cablecast.rigs.virtual.camera import VirtualCamera
    from cablecast.rigs.virtual.drawing import FilmedTrial

    config = dataclasses.replace(CameraConfig(noise=0.0).resized(320), light=light, **changes)
    times = np.arange(round(duration / 0.02) + 1) * 0.02
    line = np.linspace([0.0, 0.6, 0.005], [0.0, 1.2, 0.005], 6)
    nodes = np.repeat(line[None], len(times), axis=0)
    trial = FilmedTrial(cable=load_cable("cable_1"), times=times, nodes=nodes, joint_path=None)
    return VirtualCamera(config).film(trial)


def test_lamps_flicker_as_much_as_the_exposure_leaves_of_it():
    for exposure, left in ((0.001, 0.984), (0.005, 0.637), (0.01, 0.0)):
        light = dataclasses.replace(STEADY, lamp_flicker=0.1)
        film = small_film(light, exposure=exposure)
        bright = np.array([film.frame(i).mean() for i in range(film.LEAD, film.LEAD + 30)])
        swing = np.ptp(bright) / 2 / bright.mean()
        # Frames at 60 1/s meet the lamp's 100 Hz at three phases, of which two are 1.5 A apart.
        assert 0.75 * 0.1 * left - 1e-3 < swing < 0.1 * left + 0.01


def test_a_rolling_shutter_makes_bands_of_the_flicker():
    row_time = 0.9 / 60 / 180
    light = dataclasses.replace(STEADY, lamp_flicker=0.3)
    bands, even = (small_film(light, row_time=t, exposure=0.001).frame(20) for t in (row_time, 0.0))
    ratio = bands[:, 40:280].mean(axis=(1, 2)) / even[:, 40:280].mean(axis=(1, 2))
    peaks = np.abs(np.fft.rfft(ratio - ratio.mean()))
    # 15 ms from the first row to the last are one and a half periods of 100 Hz.
    assert int(peaks.argmax()) in (1, 2)
    assert np.ptp(ratio) > 0.4


def test_a_white_balance_drifts_within_its_time_and_stays():
    light = dataclasses.replace(STEADY, balance=(1.0, 0.8, 1.0), balance_time=0.5)
    film = small_film(light)
    first, half, last = (film.frame(film.LEAD + i).mean(axis=(0, 1)) for i in (0, 15, 55))
    assert (half / first)[1] == pytest.approx(0.8**0.5, abs=0.02)
    np.testing.assert_allclose(last / first, [1.0, 0.8, 1.0], atol=0.03)


def test_frames_are_left_out_and_repeated_as_often_as_it_was_asked():
    film = small_film(duration=5.0, dropped=0.2, repeated=0.1)
    count = len(film.arrivals)
    # Four standard deviations of 300 draws.
    assert 1 - count / film.frame_count == pytest.approx(0.2, abs=0.1)
    film = small_film(duration=2.0, repeated=0.3, noise=3.0)
    pieces = [film.piece(i, (150, 20, 180, 40)) for i in range(film.frame_count)]
    same = [np.array_equal(a, b) for a, b in itertools.pairwise(pieces)]
    assert np.mean(same) == pytest.approx(0.3, abs=0.17)


def test_shapes_too_far_apart_in_time_are_not_filmed(cable):
    pytest.importorskip("cv2")
    from cablecast.rigs.virtual.drawing import FilmedTrial

    with pytest.raises(InputError, match=r"0\.100 s"):
        FilmedTrial(
            cable=cable, times=np.arange(3) * 0.1, nodes=np.zeros((3, 5, 3)), joint_path=None
        )
