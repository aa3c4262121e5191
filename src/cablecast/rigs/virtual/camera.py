"""The camera over the virtual table: draws what it would see, whole frames or pieces of them.

A piece equals that part of the whole frame, so a tracker that asks only for the surroundings of the
marker sees the same as one that is given the whole video, and in a small part of the time. The
camera is calibrated as a person calibrates the real one: with a board, then with the tags.
"""

import functools
from typing import Self

import numpy as np

from cablecast.camera.tags import TagLayout, default_layout
from cablecast.cast import EndpointTrack
from cablecast.conventions import Array
from cablecast.motion.trajectory import JointPath, joints_at
from cablecast.rigs.virtual.config import CameraConfig, Mount
from cablecast.rigs.virtual.drawing import Drawing, FilmedTrial, Image, draw_background
from cablecast.setup import Setup
from cablecast.vision.calibration import Board, Calibration, calibrate_lens, calibrate_view
from cablecast.vision.tags import load_cv2
from cablecast.vision.tracker import EndpointTracker, Grab, MarkerConfig, TrackerConfig, Window
from cablecast.workspace import Workspace

_PAD = 24
"""Rim drawn around a piece, so that blurs at its edge come out as in the whole frame [px]."""
_BAND_ROWS = 12
"""Rows that a rolling shutter draws as of one instant [px]: at 15 us a row and 5 m/s, half of them
are 0.5 mm."""
_FLICKER_RATE = 13.3
"""Beat of the lamps against the frames [1/s]."""
_TINT = 0.02
"""Amplitude of the change of colour [-]."""
_BOARD_COUNT = 12
_EMPTY_COUNT = 3


class VirtualCamera:
    """A webcam on a stand over the table of the virtual laboratory.

    Args:
        config: Lens, place, and troubles; mounted to see all of the table if None.
        workspace: Gives the table's size and place.
        layout: Tags on the table; those of `default_layout` if None.
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

    @classmethod
    def of(cls, setup: Setup, config: CameraConfig | None = None, seed: int = 0) -> Self:
        """Return the camera over the table and the tags of a set-up."""
        layout = None if setup.camera is None else setup.camera.tags
        return cls(config, setup.workspace, layout, seed)

    def film(self, trial: FilmedTrial, seed: int = 0) -> "TrialFilm":
        """Return a film of one trial, whose light and noise are drawn from a seed."""
        return TrialFilm(self, trial, seed)

    def picture(self, track: EndpointTrack, setup: Setup, seed: int = 0) -> Image | None:
        """Return the table at the end of a trial, BGR, shape [v, u, 3]; None without its nodes.

        The seed draws light and noise.
        """
        if track.nodes is None or not np.all(np.isfinite(track.nodes[-1])):
            return None
        now, path = np.zeros(1), None
        if track.joint_path is not None:
            q = joints_at(track.joint_path, track.times[-1:])
            path = JointPath(times=now, q=q, qd=np.zeros_like(q))
        trial = FilmedTrial.of(setup, now, track.nodes[-1:], path)
        return self.film(trial, seed).frame(TrialFilm.LEAD)

    def empty_frame(self, seed: int = 0) -> Image:
        """Draw a picture of the table without cable and arm."""
        return self.expose(self.background, (0, 0), np.ones(3), seed, 0)

    @functools.cached_property
    def _rays(self) -> Array:
        """Lines of sight of every eighth pixel in the base frame, shape [v / 8, u / 8, 3]."""
        v, u = np.mgrid[0 : self.config.height : 8, 0 : self.config.width : 8].astype(float)
        ideal = self.view.lens.undistort(np.stack([u, v], axis=-1))
        ray = np.concatenate([ideal, np.ones((*ideal.shape[:-1], 1))], axis=-1)
        return ray @ np.asarray(self.view.rotation)

    def board_frame(self, board: Board, rotation: Array, centre: Array, seed: int) -> Image:
        """Draw a picture of a calibration board that a person holds before the camera.

        Args:
            board: Board that is held.
            rotation: Rotation of the board's axes (x along its width, y down its height, z away
                from the viewer) into the base frame, shape [3, 3].
            centre: Centre of the board in the base frame [m], shape [3].
            seed: Seed of the noise.
        """
        cv2 = load_cv2()
        square_px, rim = 40, 20
        picture = np.pad(board.picture(square_px), rim, constant_values=255)
        size = np.array([board.column_count, board.row_count]) * board.square
        position, normal, ray = np.asarray(self.view.position), rotation[:, 2], self._rays
        scale = (centre - position) @ normal / (ray @ normal)
        local = (position + scale[..., None] * ray - centre) @ rotation[:, :2] + size / 2
        grid = local / board.square * square_px + rim - 0.5
        # Resizing aligns the corners of pixels, so the coarse grid's samples lie 3.5 px off.
        shift = np.array([[1, 0, -3.5], [0, 1, -3.5]], dtype=np.float32)
        extent = (self.config.width, self.config.height)
        maps = []
        for axis in (0, 1):
            coarse = np.where(scale > 0, grid[..., axis], -1e4).astype(np.float32)
            fine = cv2.resize(coarse, None, fx=8, fy=8, interpolation=cv2.INTER_LINEAR)
            edge = cv2.BORDER_REPLICATE
            maps.append(
                cv2.warpAffine(fine, shift, extent, flags=cv2.INTER_LINEAR, borderMode=edge)
            )
        drawn, inside = (
            cv2.remap(source, maps[0], maps[1], cv2.INTER_LINEAR, borderValue=0)
            for source in (cv2.GaussianBlur(picture, (0, 0), 1.0), np.full_like(picture, 255))
        )
        image = self.background.copy()
        # All but the board's surroundings stays as it is.
        left, top, width, height = cv2.boundingRect(inside)
        part = np.s_[top : top + height, left : left + width]
        cover = (inside[part].astype(np.float32) / 255)[..., None]
        mixed = image[part] * (1 - cover) + (0.8 * drawn[part][..., None] + 25.0) * cover
        image[part] = np.clip(mixed, 0, 255).astype(np.uint8)
        return self.expose(image, (0, 0), np.ones(3), seed, 0)

    def expose(
        self,
        canvas: Image,
        corner: tuple[int, int],
        gains: Array,
        seed: int,
        frame: int,
        rows: Array | None = None,
    ) -> Image:
        """Return what the sensor makes of a piece at a corner [px]: lens blur, brightness, noise.

        Blue, green and red are brighter by the gains [-] than in even light, and each row by a gain
        of its own, shape [v], where `rows` has them.
        """
        cv2 = load_cv2()
        config = self.config
        if config.blur > 0:
            canvas = cv2.GaussianBlur(canvas, (5, 5), config.blur, borderType=cv2.BORDER_REPLICATE)
        if rows is None:
            table = np.clip(np.arange(256)[:, None] * gains, 0, 255).astype(np.uint8)
            canvas = cv2.LUT(canvas, table[:, None, :])
        else:
            lit = canvas * (rows[:, None] * gains)[:, None].astype(np.float32)
            canvas = np.clip(lit, 0, 255, out=lit).astype(np.uint8)
        if config.noise == 0:
            return canvas
        shift_u, shift_v, turn = np.random.default_rng([seed, frame, 5]).integers(0, [128, 128, 4])
        height, width = canvas.shape[:2]
        top, left = corner[1] + shift_v, corner[0] + shift_u
        # Turned after it is cut out: OpenCV does that in a fraction of the time that numpy takes.
        if turn & 1:
            top = self.noise.shape[0] - top - height
        if turn & 2:
            left = self.noise.shape[1] - left - width
        piece = self.noise[top : top + height, left : left + width]
        if turn:
            piece = cv2.flip(piece, {1: 0, 2: 1, 3: -1}[int(turn)])
        return cv2.add(canvas, piece, dtype=cv2.CV_8U)


class TrialFilm:
    """The frames of one trial; frame 0 is taken at `start` before the motion starts.

    Args:
        camera: Camera that films.
        trial: Motion of cable and arm.
        seed: Seed of light and noise.
    """

    LEAD = 12
    """Frames before the motion starts."""

    def __init__(self, camera: VirtualCamera, trial: FilmedTrial, seed: int):
        self.camera = camera
        self.trial = trial
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
        self._lamp_phase = rng.uniform(0, 2 * np.pi)
        self._drawn: tuple[int, dict[int, Drawing]] = (-1, {})

    def time(self, frame: int) -> float:
        """Return the middle of the exposure of a frame's middle row, since the motion began [s]."""
        return (frame - self.LEAD) * self.frame_dt

    @property
    def arrivals(self) -> list[int]:
        """Frames that the camera does not leave out."""
        return [frame for frame in range(self.frame_count) if not self.is_dropped(frame)]

    def is_dropped(self, frame: int) -> bool:
        """Return whether the camera leaves a frame out."""
        return self._luck(frame)[0] < self.camera.config.dropped

    def _luck(self, frame: int) -> Array:
        """Return two draws that decide what becomes of a frame; the first one always arrives."""
        return np.random.default_rng([self.seed, frame, 7]).random(2) if frame > 0 else np.ones(2)

    def frame(self, frame: int) -> Image:
        """Draw a whole frame, BGR, shape [v, u, 3]."""
        config = self.camera.config
        return self.piece(frame, (0, 0, config.width, config.height))

    def grab(self, frame: int) -> Grab:
        """Return what draws pieces of a frame."""
        return lambda window: self.piece(frame, window)

    def piece(self, frame: int, window: Window) -> Image:
        """Draw a piece of a frame, equal to that part of the whole frame.

        The window is left, top, right, bottom [px], the last two excluded.
        """
        config = self.camera.config
        while self._luck(frame)[1] < config.repeated:
            frame -= 1
        left, top = max(window[0] - _PAD, 0), max(window[1] - _PAD, 0)
        right = min(window[2] + _PAD, config.width)
        bottom = min(window[3] + _PAD, config.height)
        canvas = self.camera.background[top:bottom, left:right].copy()
        on_table = self.camera.on_table[top:bottom, left:right]
        band_rows = _BAND_ROWS if config.row_time else config.height
        for band in range(top // band_rows, -(-bottom // band_rows)):
            first = max(band * band_rows, top)
            rows = slice(first - top, min((band + 1) * band_rows, bottom) - top)
            self._drawing(frame, band).paint(canvas[rows], (left, first), on_table[rows])
        gains = self._gains(self.time(frame))
        rows = None
        if config.light.lamp_flicker:
            from_middle = np.arange(top, bottom, dtype=float) - (config.height - 1) / 2
            rows = self._lamp(self.time(frame) + config.row_time * from_middle)
        image = self.camera.expose(canvas, (left, top), gains, self.seed, frame, rows)
        return image[window[1] - top : window[3] - top, window[0] - left : window[2] - left]

    def _drawing(self, frame: int, band: int) -> Drawing:
        """Return what moves as a band of rows sees it: with a rolling shutter, each a bit later."""
        if self._drawn[0] != frame:
            self._drawn = (frame, {})
        drawings, camera, config = self._drawn[1], self.camera, self.camera.config
        if band not in drawings:
            time = self.time(frame)
            if config.row_time:
                middle = (band + 0.5) * _BAND_ROWS - 0.5
                time += config.row_time * (middle - (config.height - 1) / 2)
            drawings[band] = Drawing(config, camera.view, camera.shade, self.trial, time)
        return drawings[band]

    def _gains(self, time: float) -> Array:
        """Return the brightness of blue, green and red as a multiple of that of even light."""
        light, phases = self.camera.config.light, self._phases
        gain = self._base
        gain *= 1 + light.drift * np.sin(2 * np.pi * time / light.drift_period + phases[0])
        gain *= 1 + light.flicker * np.sin(2 * np.pi * _FLICKER_RATE * time + phases[1])
        gain *= 1 + self._step * (time > self._step_time)
        warm = _TINT * np.sin(2 * np.pi * time / light.drift_period + phases[2])
        turned = np.clip(time / light.balance_time, 0.0, 1.0)
        return (
            gain
            * np.array([1 - warm, 1.0, 1 + warm])
            * light.cast
            * np.power(light.balance, turned)
        )

    def _lamp(self, times: Array) -> Array:
        """Return the light of the lamps during exposures about some times [-], shape [time]."""
        light = self.camera.config.light
        left = light.lamp_flicker * np.sinc(light.lamp_rate * self.camera.config.exposure)
        return 1.0 + left * np.sin(2 * np.pi * light.lamp_rate * times + self._lamp_phase)


def track_film(
    film: TrialFilm, calibration: Calibration, marker: MarkerConfig | None = None
) -> EndpointTracker:
    """Run the tracker over a film, drawing only what it looks at.

    It looks for a marker of the hue that is drawn where none is given.
    """
    config = film.camera.config
    trial = film.trial
    tracker = EndpointTracker(
        calibration.view,
        film.camera.workspace,
        TrackerConfig(
            marker=marker or MarkerConfig(hue=config.marker_hue),
            marker_z=trial.cable.radius,
            row_time=config.row_time,
        ),
        start_xy=trial.nodes[0, -1, :2],
    )
    for frame in film.arrivals:
        tracker.update(film.time(frame), film.grab(frame))
    return tracker


def board_pictures(camera: VirtualCamera, seed: int = 0, board: Board | None = None) -> list[Image]:
    """Draw pictures of a board, the default one if None, held over the table at several angles.

    The seed draws its places and the noise.
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
        centre = mount.scale * np.array([across, along, up]) + [0.0, mount.centre_y, 0.0]
        pictures.append(camera.board_frame(board, R, centre, seed + index))
    return pictures


def calibrate_virtual_camera(camera: VirtualCamera, seed: int = 0) -> Calibration:
    """Return a calibration from rendered pictures alone; the seed is that of the board's places."""
    lens = calibrate_lens(board_pictures(camera, seed), Board()).lens
    frames = [camera.empty_frame(seed + 1000 + index) for index in range(_EMPTY_COUNT)]
    return calibrate_view(frames, camera.layout, lens=lens)
