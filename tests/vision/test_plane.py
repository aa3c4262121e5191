"""The camera beside the plane of a swing: drawn films of swings, against the truth."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("cv2")

from cablecast.arm.shape import arm_shape
from cablecast.camera.lens import CameraView, Lens
from cablecast.camera.settings import CameraSettings
from cablecast.camera.tags import Tag, TagLayout
from cablecast.cast import TrialStatus
from cablecast.engines.swing import SAMPLE_DT, swing_model
from cablecast.errors import CameraError, InputError
from cablecast.motion.joint_move import JointMoves
from cablecast.motion.trajectory import plan_trajectory
from cablecast.pipeline.camera import calibrate_table, check_camera, sync_film
from cablecast.rigs.make import make_rig
from cablecast.setup import Setup, StrikeConfig
from cablecast.vision.check import draw_report
from cablecast.vision.plane import SeenPlane
from cablecast.vision.tags import dictionary_of, load_cv2
from cablecast.vision.trials import CameraOfTrials, TrialTiming
from cablecast.vision.video import FilmWriter

cv2 = load_cv2()

RATE, EXPOSURE, START = 60.0, 0.001, 0.9
WALL, DISTANCE = 0.6, 3.2
LENS = Lens(width=1280, height=720, focal=(1350.0, 1350.0), centre=(639.5, 359.5))
PLACES = [(-0.8, 0.6), (0.9, 0.7), (2.1, 0.6), (-0.8, -0.8), (2.1, -0.8), (1.1, -0.9)]
TAGS = TagLayout(tags=tuple(Tag(id=i, x=x, y=y, size=0.16) for i, (x, y) in enumerate(PLACES)))
GREEN, GREY = (40, 160, 30), (150, 152, 149)
METAL, SHEEN, CAP = (95, 90, 88), (225, 226, 228), (120, 70, 40)
# A pixel is 2.4 mm in the plane of the swing.
RMS = 2.5e-3
# One move has two ramps, by which alone the clocks are compared [s].
CLOCK_ERROR = 0.01


class Wall:
    """Draws what a camera sees that looks straight at the wall behind a swing."""

    def __init__(self, setup):
        self.setup, self.plane = setup, SeenPlane.of(setup)
        sign = 1.0 if setup.camera.side == "right" else -1.0
        self.view = CameraView(
            lens=LENS,
            rotation=((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
            position=(0.7 * sign, -0.12, WALL + DISTANCE),
        )
        rng = np.random.default_rng(5)
        self.noise = np.abs(rng.normal(0.0, 2.0, (720, 1280, 3))).astype(np.uint8)
        # Plaster.
        rough = cv2.GaussianBlur(rng.normal(size=(720, 1280, 1)).astype(np.float32), (0, 0), 4.0)
        self.still = np.clip(GREY + 90.0 * rough[..., None], 0, 255).astype(np.uint8)
        for tag in self.plane.tags.tags:
            picture = cv2.aruco.generateImageMarker(dictionary_of(TAGS.family), tag.id, 200)
            picture = np.pad(picture, 40, constant_values=255)
            half = tag.size / 2 * 280 / 200
            corners = [(-half, half), (half, half), (half, -half), (-half, -half)]
            places = [(tag.x + x, tag.y + y, 0.0) for x, y in corners]
            pixels = self.view.to_image(places).astype(np.float32)
            whole = np.array([(0, 0), (280, 0), (280, 280), (0, 280)], dtype=np.float32) - 0.5
            H = cv2.getPerspectiveTransform(whole, pixels)
            ink = cv2.warpPerspective(picture, H, (1280, 720), flags=cv2.INTER_AREA)
            inside = cv2.warpPerspective(np.full_like(picture, 255), H, (1280, 720)) > 127
            self.still[inside] = ink[inside, None]

    def frame(self, tips, qs, number):
        """Draw tip [m] and arm [rad] at some moments of an exposure, shape [moment, ...]."""
        base, images = self.plane.base_view(self.view), []
        for tip, q in zip(tips, qs, strict=True):
            image, shape = self.still.copy(), arm_shape(q[None], self.setup.arm)
            for ends, radius in zip(shape.ends[0], shape.radii, strict=True):
                a, b = np.round(base.to_image(ends)).astype(int).tolist()
                wide = round(2.0 * radius * LENS.focal[0] / DISTANCE)
                cv2.line(image, a, b, METAL, wide)
                cv2.line(image, a, b, SHEEN, max(wide // 4, 1))
                # A cable that is strapped to the arm, and the caps of its joints.
                for share in np.arange(0.1, 1.0, 0.15):
                    spot = np.round(a + share * np.subtract(b, a)).astype(int).tolist()
                    cv2.circle(image, spot, max(wide // 6, 1), CAP, -1)
                cv2.circle(image, b, wide // 3, CAP, -1)
            # Straight down along the cable is as good as any other way.
            bar = base.to_image(tip + np.array([[0.0, 0.0, 0.011], [0.0, 0.0, -0.011]]))
            if np.isfinite(bar).all():
                a, b = np.round(16.0 * bar).astype(int).tolist()
                cv2.line(image, a, b, GREEN, 7, cv2.LINE_AA, shift=4)
            images.append(image)
        mean = cv2.addWeighted(images[0], 0.5, images[1], 0.5, 0.0)
        return cv2.add(cv2.GaussianBlur(mean, (0, 0), 0.45), np.roll(self.noise, 97 * number, 1))


def lab(source="0", side="right"):
    settings = CameraSettings(
        source=str(source),
        width=1280,
        height=720,
        rate=RATE,
        exposure=EXPOSURE,
        lens=LENS,
        tags=TAGS,
        wall=WALL,
        side=side,
        clock_offset_sd=0.001,
    )
    return Setup(camera=settings, strike=StrikeConfig(watch_time=1.3))


def swing_of(*unit):
    """Return a swing: joints that the arm reports, and the tip every `SAMPLE_DT` [m]."""
    setup = lab()
    moves = JointMoves.of(setup)
    path = plan_trajectory(moves.move(unit), setup).joint_path
    model = swing_model(setup, 16)
    tip = model.play(model.motion(unit), setup.cable).tip[0]
    return path, tip[np.isfinite(tip).all(axis=1)]


@pytest.fixture(scope="module")
def swing():
    return swing_of(0.2, 0.2, 0.3)


def film(path, setup, swing, late=0.0):
    """Film a swing that begins at `START`, by a clock that is late [s]."""
    wall, (joints, tip) = Wall(setup), swing
    times = SAMPLE_DT * np.arange(len(tip))
    with FilmWriter(path, RATE) as writer:
        for number in range(round((START + times[-1]) * RATE) + 4):
            time = number / RATE
            moments = time + late - START + EXPOSURE * np.array([-0.25, 0.25])
            tips = np.stack([np.interp(moments, times, row) for row in tip.T], axis=-1)
            qs = np.stack([np.interp(moments, joints.times, row) for row in joints.q.T], axis=-1)
            writer.write(wall.frame(tips, qs, number), time)
    return path


def timing(swing):
    joints, tip = swing
    end = START + SAMPLE_DT * (len(tip) - 1)
    return TrialTiming(
        start_time=START, end_time=end, clock_pairs=np.array([[0.0, 0.0]]), joint_path=joints
    )


def errors(track, swing):
    """Return the distances of a track from the tip [m]."""
    times = SAMPLE_DT * np.arange(len(swing[1]))
    true = np.stack([np.interp(track.times, times, row) for row in swing[1].T], axis=-1)
    return np.linalg.norm(track.path - true, axis=1)


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_tip_of_a_swing_is_seen_where_it_is_from_either_side(tmp_path, swing, side):
    source = film(tmp_path / "swing.mkv", lab(side=side), swing)
    with CameraOfTrials(lab(source, side)) as camera:
        hangs = camera.locate()
        assert np.allclose(hangs, swing[1][0], atol=RMS)
        camera.start()
        track = camera.stop(timing(swing))
        assert camera.sight() is None
    assert track.status is TrialStatus.OK
    assert track.times[0] == 0.0
    found = errors(track, swing)
    assert len(found) > 0.9 * RATE * (len(swing[1]) - 1) * SAMPLE_DT
    assert np.sqrt(np.mean(found**2)) < RMS
    # It was fast, and went far.
    assert np.ptp(track.path, axis=0).max() > 0.5


def test_a_clock_that_is_off_is_found_by_the_arm_in_the_picture(tmp_path):
    late, swing = 0.05, swing_of(1.0, 0.0, 1.0)
    source = film(tmp_path / "swing.mkv", lab(), swing, late)
    with CameraOfTrials(lab(source)) as camera:
        camera.start()
        track = camera.stop(timing(swing))
    assert "the camera's clock is off by" in track.note
    assert np.median(errors(track, swing)) < CLOCK_ERROR * 4.0
    # As `camera sync` does with the film and what the robot reported.
    log, joints = tmp_path / "log.csv", swing[0]
    head = ",".join(["time_s", *(f"q{joint}" for joint in range(1, 7))])
    rows = np.column_stack([joints.times, joints.q])
    np.savetxt(log, rows, delimiter=",", header=head, comments="")
    assert sync_film(lab(source), source, log).offset == pytest.approx(
        late - START, abs=CLOCK_ERROR
    )


def test_a_check_says_what_the_camera_sees_of_the_plane(tmp_path, swing):
    source = film(tmp_path / "swing.mkv", lab(), swing)
    setup = lab(source)
    report = check_camera(setup, seconds=0.3)
    assert report.tags_seen == tuple(range(len(PLACES)))
    assert report.px_per_m == pytest.approx(LENS.focal[0] / DISTANCE, rel=0.01)
    assert report.marker is not None
    assert report.advice() == []
    png = np.frombuffer(draw_report(report, SeenPlane.of(setup)), np.uint8)
    drawn = cv2.imdecode(png, cv2.IMREAD_COLOR)
    # The line from the stick's end to where the tip hangs.
    hung = SeenPlane.of(setup).start + [0.0, 0.3]
    u, v = np.round(Wall(setup).view.to_image([*hung, WALL])).astype(int)
    assert np.abs(drawn[v, u].astype(int) - report.image[v, u]).max() > 50


def test_a_tip_that_is_hidden_gives_a_swing_that_was_not_seen(tmp_path, swing):
    joints, tip = swing
    away = np.where(SAMPLE_DT * np.arange(len(tip))[:, None] > 0.02, [0.0, 9.0, 9.0], tip)
    source = film(tmp_path / "swing.mkv", lab(), (joints, away))
    with CameraOfTrials(lab(source)) as camera:
        camera.start()
        track = camera.stop(timing(swing))
    assert track.status is TrialStatus.OCCLUDED
    assert np.isnan(track.path).all()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"side": None}, "wall and side belong together"),
        ({"side": "above"}, "side = 'above' must be one of right, left"),
        ({"wall": -1.0}, r"camera wall = -1.* \[0, 10\]"),
        ({"tags": None}, "list the tags on the wall"),
    ],
)
def test_a_camera_of_swings_that_lacks_something_is_refused(values, words):
    with pytest.raises(InputError, match=words):
        dataclasses.replace(lab().camera, **values)


def test_the_camera_s_own_section_says_whether_it_sees_swings_or_a_table(tmp_path):
    setup = dataclasses.replace(lab(), camera=CameraSettings(source="0"))
    assert SeenPlane.of(lab()).in_air
    assert not SeenPlane.of(setup).in_air
    with pytest.raises(CameraError, match=r"swings \(wall\), which need a section `strike`"):
        CameraOfTrials(dataclasses.replace(lab(), strike=None))
    file = tmp_path / "lab.yaml"
    file.write_text(
        "cable: cable_1\nstrike: {}\ncamera:\n  source: 0\n  wall: 0.6\n  side: left\n  tags:\n"
        + "".join(f"  - {{id: {tag.id}, x: {tag.x}, y: {tag.y}}}\n" for tag in TAGS.tags)
    )
    with pytest.raises(InputError, match="sees no table"):
        calibrate_table(file, {})
    with pytest.raises(InputError, match="robot"):
        make_rig("ur", setup)
