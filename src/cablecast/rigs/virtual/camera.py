"""The camera over the virtual table: draws what it would see, whole frames or pieces of them.

A piece equals that part of the whole frame, so a tracker that asks only for the surroundings of the
marker sees the same as one that is given the whole video, and in a small part of the time.

Calibrates the virtual camera as a person does the real one: a board, then the tags.

CameraStill: one picture of the virtual table, as the camera above it would take it.
"""

import functools

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.tags import TagLayout, default_layout
from cablecast.cast import EndpointTrack
from cablecast.motion.trajectory import JointPath, joints_at
from cablecast.rigs.virtual.config import CameraConfig, Mount
from cablecast.rigs.virtual.drawing import Drawing, FilmedTrial, RollingDrawing, draw_background
from cablecast.setup import Setup
from cablecast.vision.calibration import Board, Calibration, calibrate_lens, calibrate_view
from cablecast.vision.tags import load_cv2
from cablecast.vision.tracker import EndpointTracker, Grab, MarkerConfig, TrackerConfig, Window
from cablecast.workspace import Workspace

Image = NDArray[np.uint8]

_PAD = 24
"""Rim drawn around a piece, so that blurs at its edge come out as in the whole frame [px]."""


class VirtualCamera:
    """A webcam on a stand over the table of the virtual laboratory.

    Args:
        config: Lens, place, and troubles; mounted to see all of the table where None.
        workspace: Gives the table's size and place.
        layout: Tags on the table; those of `default_layout` where None.
        seed: Seed of the table's looks.
    """

    def __init__(
        self,
        config: CameraConfig | None = None,
        workspace: Workspace | None = None,
        layout: TagLayout | None = None,
        seed: int = 0,
    ):
        cv2 = load_cv2()
        self.workspace = Workspace() if workspace is None else workspace
        self.config = CameraConfig.over(self.workspace) if config is None else config
        self.layout = default_layout(self.workspace) if layout is None else layout
        self.view = self.config.view
        self.background, self.on_table, self.shade = draw_background(
            self.view, self.config, self.workspace, self.layout, seed
        )
        # One picture of noise, shifted and turned for every frame, looks as good as fresh noise and
        # costs a hundredth. Neighbouring pixels share some of it, as colours of a sensor do.
        rng = np.random.default_rng([seed, 23])
        size = (self.config.height + 128, self.config.width + 128, 3)
        noise = rng.normal(0.0, 1.0, size).astype(np.float32)
        noise = cv2.GaussianBlur(noise, (3, 3), 0.6)
        self.noise = np.round(noise * (self.config.noise / float(noise.std()))).astype(np.int16)

    def film(self, trial: FilmedTrial, seed: int = 0, marker: MarkerConfig | None = None) -> "Film":
        """Return a film of one trial.

        Args:
            trial: Motion of cable and arm.
            seed: Seed of light and noise.
            marker: Size of the marker.
        """
        return Film(self, trial, seed, marker or MarkerConfig())

    def empty_frame(self, seed: int = 0) -> Image:
        """Draw a picture of the table without cable and arm."""
        return _expose(self, self.background, (0, 0), np.ones(3), seed, 0)

    @functools.cached_property
    def _rays(self) -> NDArray[np.float64]:
        """Lines of sight of every eighth pixel in the base frame, shape [v / 8, u / 8, 3]."""
        v, u = np.mgrid[0 : self.config.height : 8, 0 : self.config.width : 8].astype(float)
        ideal = self.view.lens.undistort(np.stack([u, v], axis=-1))
        ray = np.concatenate([ideal, np.ones((*ideal.shape[:-1], 1))], axis=-1)
        return ray @ np.asarray(self.view.rotation)

    def board_frame(
        self, board: Board, rotation: NDArray[np.float64], centre: NDArray[np.float64], seed: int
    ) -> Image:
        """Draw a picture of a calibration board that a person holds before the camera.

        Args:
            board: Board that is held.
            rotation: Rotation of the board's axes (x along its width, y down its height, z away
                from the viewer) into the base frame, shape [3, 3].
            centre: Centre of the board in the base frame [m], shape [3].
            seed: Seed of the noise.
        """
        cv2 = load_cv2()
        square_px = 40
        picture = board.picture(square_px)
        rim = square_px // 2
        picture = np.pad(picture, rim, constant_values=255)
        size = np.array([board.column_count, board.row_count]) * board.square
        position, normal, ray = np.asarray(self.view.position), rotation[:, 2], self._rays
        scale = (centre - position) @ normal / (ray @ normal)
        local = (position + scale[..., None] * ray - centre) @ rotation[:, :2] + size / 2
        grid = local / board.square * square_px + rim - 0.5
        maps = [
            cv2.resize(
                np.where(scale > 0, grid[..., axis], -1e4).astype(np.float32),
                None,
                fx=8,
                fy=8,
                interpolation=cv2.INTER_LINEAR,
            )
            for axis in (0, 1)
        ]
        # Resizing aligns the corners of pixels, so the coarse grid's samples lie 3.5 px off.
        shift = np.array([[1, 0, -3.5], [0, 1, -3.5]], dtype=np.float32)
        extent = (self.config.width, self.config.height)
        maps = [
            cv2.warpAffine(
                m, shift, extent, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            for m in maps
        ]
        blurred = cv2.GaussianBlur(picture, (0, 0), 1.0)
        drawn = cv2.remap(blurred, maps[0], maps[1], cv2.INTER_LINEAR, borderValue=0)
        inside = cv2.remap(
            np.full_like(picture, 255), maps[0], maps[1], cv2.INTER_LINEAR, borderValue=0
        )
        image = self.background.copy()
        # All but the board's surroundings stays as it is.
        left, top, width, height = cv2.boundingRect(inside)
        part = np.s_[top : top + height, left : left + width]
        cover = (inside[part].astype(np.float32) / 255)[..., None]
        mixed = image[part] * (1 - cover) + (0.8 * drawn[part][..., None] + 25.0) * cover
        image[part] = np.clip(mixed, 0, 255).astype(np.uint8)
        return _expose(self, image, (0, 0), np.ones(3), seed, 0)


class Film:
    """The frames of one trial; frame 0 is taken at `start` before the motion begins.

    Args:
        camera: Camera that films.
        trial: Motion of cable and arm.
        seed: Seed of light and noise.
        marker: Size of the marker.
    """

    LEAD = 12
    """Frames before the motion begins."""

    def __init__(self, camera: VirtualCamera, trial: FilmedTrial, seed: int, marker: MarkerConfig):
        self.camera = camera
        self.trial = trial
        self.marker = marker
        self.seed = int(seed)
        self.frame_dt = 1.0 / camera.config.frame_rate
        self.start = -self.LEAD * self.frame_dt
        end = float(trial.times[-1])
        self.frame_count = self.LEAD + int(np.floor(end / self.frame_dt + 1e-6)) + 1
        rng = np.random.default_rng([self.seed, 31])
        self._phases = rng.uniform(0, 2 * np.pi, 4)
        self._step_time = rng.uniform(0.0, max(end, 1.0))
        self._step = rng.uniform(-1.0, 1.0) * camera.config.light.step
        self._base = np.exp(rng.normal(0, 0.02))
        self._drawn: tuple[int, Drawing | RollingDrawing] | None = None

    def time(self, frame: int) -> float:
        """Return the middle of the exposure of a frame's middle row, since the motion began [s]."""
        return (frame - self.LEAD) * self.frame_dt

    def frame(self, frame: int) -> Image:
        """Draw a whole frame, BGR, shape [v, u, 3]."""
        config = self.camera.config
        return self.piece(frame, (0, 0, config.width, config.height))

    def grab(self, frame: int) -> Grab:
        """Return what draws pieces of a frame."""
        return lambda window: self.piece(frame, window)

    def piece(self, frame: int, window: Window) -> Image:
        """Draw a piece of a frame, equal to that part of the whole frame.

        Args:
            frame: Index of the frame.
            window: Left, top, right, bottom [px], the last two excluded.
        """
        config = self.camera.config
        left, top = max(window[0] - _PAD, 0), max(window[1] - _PAD, 0)
        right = min(window[2] + _PAD, config.width)
        bottom = min(window[3] + _PAD, config.height)
        drawing = self._drawing(frame)
        canvas = self.camera.background[top:bottom, left:right].copy()
        drawing.paint(canvas, (left, top), self.camera.on_table[top:bottom, left:right])
        gains = self._gains(self.time(frame))
        image = _expose(self.camera, canvas, (left, top), gains, self.seed, frame)
        return image[window[1] - top : window[3] - top, window[0] - left : window[2] - left]

    def _drawing(self, frame: int) -> Drawing | RollingDrawing:
        if self._drawn is None or self._drawn[0] != frame:
            self._drawn = (frame, self._make_drawing(frame))
        return self._drawn[1]

    def _make_drawing(self, frame: int) -> Drawing | RollingDrawing:
        camera, config = self.camera, self.camera.config

        def draw(time: float) -> Drawing:
            return Drawing(config, camera.view, camera.shade, self.trial, self.marker, time)

        if config.row_time == 0.0:
            return draw(self.time(frame))
        return RollingDrawing(draw, self.time(frame), config.row_time, config.height)

    def _gains(self, time: float) -> NDArray[np.float64]:
        """Return the brightness of blue, green and red as a multiple of that of even light."""
        light, phases = self.camera.config.light, self._phases
        gain = self._base
        gain *= 1 + light.drift * np.sin(2 * np.pi * time / light.drift_period + phases[0])
        gain *= 1 + light.flicker * np.sin(2 * np.pi * light.flicker_rate * time + phases[1])
        gain *= 1 + self._step * (time > self._step_time)
        warm = light.tint * np.sin(2 * np.pi * time / light.drift_period + phases[2])
        return gain * np.array([1 - warm, 1.0, 1 + warm])


def _expose(
    camera: VirtualCamera,
    canvas: Image,
    corner: tuple[int, int],
    gains: NDArray[np.float64],
    seed: int,
    frame: int,
) -> Image:
    """Return what the sensor makes of a drawn piece: lens blur, brightness, noise."""
    cv2 = load_cv2()
    config = camera.config
    if config.blur > 0:
        canvas = cv2.GaussianBlur(canvas, (5, 5), config.blur, borderType=cv2.BORDER_REPLICATE)
    table = np.clip(np.arange(256)[:, None] * gains, 0, 255).astype(np.uint8)
    canvas = cv2.LUT(canvas, table[:, None, :])
    if config.noise == 0:
        return canvas
    shift_u, shift_v, turn = np.random.default_rng([seed, frame, 5]).integers(0, [128, 128, 4])
    height, width = canvas.shape[:2]
    top, left = corner[1] + shift_v, corner[0] + shift_u
    # Turned after it is cut out: OpenCV does that in a fraction of the time that numpy takes.
    if turn & 1:
        top = camera.noise.shape[0] - top - height
    if turn & 2:
        left = camera.noise.shape[1] - left - width
    piece = camera.noise[top : top + height, left : left + width]
    if turn:
        piece = cv2.flip(piece, {1: 0, 2: 1, 3: -1}[int(turn)])
    return cv2.add(canvas, piece, dtype=cv2.CV_8U)


def track_film(film: Film, calibration: Calibration, start_known: bool = True) -> EndpointTracker:
    """Run the tracker over a film, drawing only what it looks at.

    Args:
        film: Film to watch.
        calibration: Calibration of the camera that the tracker works with.
        start_known: Whether the tracker is told where the endpoint begins.
    """
    trial = film.trial
    tracker = EndpointTracker(
        calibration.view,
        film.camera.workspace,
        TrackerConfig(marker=film.marker, marker_z=trial.cable.radius),
        start_xy=trial.nodes[0, -1, :2] if start_known else None,
    )
    for frame in range(film.frame_count):
        tracker.update(film.time(frame), film.grab(frame))
    return tracker


_BOARD_COUNT = 12
_EMPTY_COUNT = 3


def board_pictures(
    camera: VirtualCamera, seed: int = 0, board: Board | None = None
) -> list[NDArray[np.uint8]]:
    """Draw pictures of a calibration board, held over the table at several angles.

    Args:
        camera: Camera to hold the board before.
        seed: Seed of the board's places and of the noise.
        board: Board to hold; the default one where None.
    """
    cv2 = load_cv2()
    rng = np.random.default_rng([seed, 41])
    board, mount = board or Board(), Mount.over(camera.workspace)
    pictures = []
    for index in range(_BOARD_COUNT):
        # Face up, tilted by up to half a radian, anywhere from just above the table to halfway up.
        R = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3))[0] @ np.diag([1.0, -1.0, -1.0])
        across, along = rng.uniform(-0.8, 0.8), rng.uniform(-0.4, 0.4)
        up = rng.uniform(0.5, 1.3)
        if mount.quarter_turns:
            across, along = along, across
        centre = np.array(
            [mount.scale * across, mount.centre_y + mount.scale * along, mount.scale * up]
        )
        pictures.append(camera.board_frame(board, R, centre, seed + index))
    return pictures


def calibrate_virtual_camera(camera: VirtualCamera, seed: int = 0) -> Calibration:
    """Return a calibration from rendered pictures alone.

    Args:
        camera: Camera to calibrate.
        seed: Seed of the board's places and of the noise.
    """
    lens = calibrate_lens(board_pictures(camera, seed), Board()).lens
    frames = [camera.empty_frame(seed + 1000 + index) for index in range(_EMPTY_COUNT)]
    return calibrate_view(frames, camera.layout, lens=lens)


class CameraStill:
    """Draws how a trial ended.

    Args:
        setup: Gives the table, its tags, the cable and the arm.
        lab_seed: Seed of the laboratory, and so of the table's looks.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, setup: Setup, lab_seed: int = 0):
        self._setup = setup
        layout = None if setup.camera is None else setup.camera.tags
        self._camera = VirtualCamera(None, setup.workspace, layout, lab_seed)

    def picture(self, track: EndpointTrack, seed: int = 0) -> Image | None:
        """Return the table at the end of a trial, BGR, shape [v, u, 3].

        Args:
            track: Trial with its nodes.
            seed: Seed of light and noise.

        Returns:
            The picture; None where the trial has no shape to draw.
        """
        if track.nodes is None or not np.all(np.isfinite(track.nodes[-1])):
            return None
        now, path = np.zeros(1), None
        if track.joint_path is not None:
            q = joints_at(track.joint_path, track.times[-1:])
            path = JointPath(times=now, q=q, qd=np.zeros_like(q))
        trial = FilmedTrial(
            cable=self._setup.cable,
            times=now,
            nodes=track.nodes[-1:],
            joint_path=path,
            arm=self._setup.arm,
        )
        film = self._camera.film(trial, seed)
        return film.frame(film.LEAD)
