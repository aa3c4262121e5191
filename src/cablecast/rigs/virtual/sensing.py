"""The senses of the virtual rig: a rendered camera, or the measured errors of that camera.

Both start from the cable's true motion, recorded every RECORD_DT, and return the track that a
person would get: samples every 100 ms, NaN where the marker was not seen, and a status.

In the error model geometry is computed: the apparent place of an endpoint above the marker's plane,
and what the arm, the table's edge and the image's border hide. The rest was measured on rendered
clips of the paper's table by tools/fit_camera_error.py, which writes camera_error.json.
"""

import dataclasses
import functools
import math
import pathlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import Arm
from cablecast.arm.shape import arm_shape, sight_clearance
from cablecast.camera.settings import CameraSight
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.conventions import Array
from cablecast.errors import InputError, check_ranges
from cablecast.files import read_json, write_json
from cablecast.motion.trajectory import JointPath, joints_at
from cablecast.rigs.virtual.config import DEFAULT_CENTRE_Y, CameraConfig, Mount, clutter_place
from cablecast.setup import Setup
from cablecast.vision.tracker import track_samples
from cablecast.workspace import Workspace

RECORD_DT = 0.01
"""Time between records of the cable for a camera [s]: a cubic through such shapes is exact to
micrometres, and all frames fall between two of them."""
MODEL_PATH = pathlib.Path(__file__).with_name("camera_error.json")
"""Error model that comes with cablecast."""
_FRAME_DT = 1.0 / 60.0
_BLIND_STATUSES = (TrialStatus.NON_FINITE, TrialStatus.ABORTED)
_PLACE_SCALE = 0.02
"""Distance within which a marker lies on about the same ground: its own size [m]."""
_BELOW_Z = -0.004
"""Height below which an endpoint hangs over the table's edge [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraErrorModel:
    """Distribution of what the tracker reports, given where the endpoint is.

    Attributes:
        camera: Place of the camera that the calibration found [m].
        seen_low: Smallest x and y of the table's plane that the image shows [m].
        seen_high: Largest x and y of the table's plane that the image shows [m].
        bias: Mean error along x and y as a quadratic polynomial: coefficients of 1, x, y', x²,
            x y', y'² with y' = y - centre_y [m], shape [2, 6] as nested tuples.
        place_sd: Error that stays while the endpoint stays, from what it lies on [m].
        noise_sd: Error of one frame [m].
        noise_per_speed: Further error of one frame per speed [s].
        edge_sd: Error of one frame while the arm covers some of the marker [m].
        edge_clearance: Distance from the arm's silhouette below which it covers some [m].
        delay: Delay of the track [s].
        hidden_clearance: Distance between the line of sight and the arm at which the marker is
            hidden in half of the cases [m].
        hidden_spread: Width of the change from seen to hidden, of a logistic function [m].
        blind: Places where the tracker cannot tell the marker from another green thing, each as x,
            y and radius [m], shape [place, 3] as nested tuples.
        miss_rate: Share of the frames in which a marker in plain sight is missed [-].
        centre_y: y of the table's middle [m].
        sources: Origin of the values, as plain values.
    """

    camera: tuple[float, float, float]
    seen_low: tuple[float, float]
    seen_high: tuple[float, float]
    bias: tuple[tuple[float, ...], tuple[float, ...]]
    place_sd: float
    noise_sd: float
    noise_per_speed: float
    edge_sd: float
    edge_clearance: float
    delay: float
    hidden_clearance: float
    hidden_spread: float
    blind: tuple[tuple[float, ...], ...]
    miss_rate: float
    centre_y: float = DEFAULT_CENTRE_Y
    sources: dict[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self):
        for name, shape in (("bias", (2, 6)), ("camera", (3,)), ("seen_low", (2,))):
            if np.shape(getattr(self, name)) != shape:
                raise InputError(
                    f"camera error {name} has shape {np.shape(getattr(self, name))}, not {shape}"
                )
        check_ranges(
            self,
            {
                "place_sd": (0.0, 1.0, "m"),
                "noise_sd": (0.0, 1.0, "m"),
                "noise_per_speed": (0.0, 1.0, "s"),
                "edge_sd": (0.0, 1.0, "m"),
                "hidden_spread": (0.0, 1.0, "m"),
                "miss_rate": (0.0, 1.0, ""),
            },
            "camera error",
        )

    def save(self, path: pathlib.Path) -> None:
        """Write the model as JSON."""
        write_json(path, dataclasses.asdict(self))

    @classmethod
    def load(cls, path: pathlib.Path = MODEL_PATH) -> "CameraErrorModel":
        """Read a model; by default the one that comes with cablecast."""
        try:
            values: dict[str, Any] = read_json(path)
            values |= {name: tuple(values[name]) for name in ("camera", "seen_low", "seen_high")}
            for name in ("bias", "blind"):
                values[name] = tuple(tuple(row) for row in values[name])
            return cls(**values)
        except InputError:
            raise
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path} is no camera error model ({error!r})") from None

    def over(self, workspace: Workspace) -> "CameraErrorModel":
        """Return the model of the same camera, mounted over another table than the paper's.

        A picture does not change when everything in it grows, so that the errors grow with the
        height of the camera.
        """
        default = Workspace()
        edges = ("half_width", "y_min", "y_max")
        if all(getattr(workspace, name) == getattr(default, name) for name in edges):
            return self
        mount = Mount.over(workspace)
        scale = mount.scale
        camera = np.array(self.camera)
        turn = np.array([[0.0, -1.0], [1.0, 0.0]]) if mount.quarter_turns else np.eye(2)
        corners = (np.array([self.seen_low, self.seen_high]) - camera[:2]) @ (scale * turn).T
        camera[1] += mount.centre_y - self.centre_y
        camera[2] *= scale
        corners += camera[:2]
        # A quadratic of turned and scaled places is a quadratic again: nine places tell it.
        x, y = (values.ravel() for values in np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]))
        there = np.stack([x, y], axis=-1)
        errors = _quadratic(there @ turn / scale) @ np.asarray(self.bias).T @ (scale * turn).T
        bias = np.linalg.lstsq(_quadratic(there), errors, rcond=None)[0].T
        blind = []
        for x, y, radius in self.blind:
            place = clutter_place(x, y, workspace)
            if place is not None:
                blind.append((*place, radius))
        return dataclasses.replace(
            self,
            camera=tuple(camera.tolist()),
            seen_low=tuple(corners.min(axis=0).tolist()),
            seen_high=tuple(corners.max(axis=0).tolist()),
            bias=tuple(tuple(row) for row in bias.tolist()),
            noise_sd=self.noise_sd * scale,
            edge_sd=self.edge_sd * scale,
            blind=tuple(blind),
            centre_y=mount.centre_y,
        )

    def apparent(self, points: Array, marker_z: float) -> Array:
        """Return where endpoints [m], shape [..., 3], seem to be to a tracker, shape [..., 2].

        It believes them at one height [m].
        """
        camera = np.asarray(self.camera)
        scale = (camera[2] - marker_z) / (camera[2] - points[..., 2])
        return camera[:2] + scale[..., None] * (points[..., :2] - camera[:2])

    @functools.cached_property
    def sight(self) -> CameraSight:
        """Place of the camera, and where it is blind, as a look at the empty table tells."""
        return CameraSight(position=self.camera, blind=tuple((x, y, r) for x, y, r in self.blind))

    def _hidden(
        self,
        times: Array,
        points: Array,
        joint_path: JointPath | None,
        rng: np.random.Generator,
        arm: Arm,
    ) -> tuple[NDArray[np.bool_], Array]:
        """Return which frames cannot show the marker, and how far the arm is from its sight [m]."""
        on_ground = self.apparent(points, 0.0)
        hidden = np.any((on_ground < self.seen_low) | (on_ground > self.seen_high), axis=-1)
        # What hangs over the table's edge is hidden by it, or shows the marker from its narrow end.
        hidden |= points[..., 2] < _BELOW_Z
        hidden |= self.sight.is_blind_at(on_ground)
        clearance = np.full(len(times), np.inf)
        # One draw a trial: a marker that rests half covered is seen in all frames or in none.
        quantile = np.clip(rng.uniform(), 1e-6, 1 - 1e-6)
        if joint_path is not None:
            shape = arm_shape(joints_at(joint_path, times), arm)
            clearance = sight_clearance(points, self.camera, shape)
            spread = self.hidden_spread * np.log(quantile / (1 - quantile))
            hidden |= clearance < self.hidden_clearance + spread
        return hidden | (rng.uniform(size=len(times)) < self.miss_rate), clearance

    def observe(
        self,
        times: Array,
        points: Array,
        joint_path: JointPath | None,
        marker_z: float,
        rng: np.random.Generator,
        arm: Arm,
    ) -> Array:
        """Return what the tracker would report in each frame.

        Args:
            times: Times of the frames, rising [s], shape [frame].
            points: True places of the endpoint [m], shape [frame, 3].
            joint_path: Joints as they really moved; None for a table without an arm.
            marker_z: Height at which the tracker believes the marker [m].
            rng: Draws what is left to chance.
            arm: Arm whose joints these are.

        Returns:
            x and y [m], NaN where the marker would not be seen, shape [frame, 2].
        """
        hidden, clearance = self._hidden(times, points, joint_path, rng, arm)
        seen = self.apparent(points, marker_z)
        velocity = np.gradient(seen, times, axis=0) if len(times) > 1 else np.zeros_like(seen)
        speed = np.linalg.norm(velocity, axis=-1)
        error = bias_terms(seen, self.centre_y) @ np.asarray(self.bias).T - self.delay * velocity
        error += self._place_error(seen, rng)
        sd = np.hypot(self.noise_sd, self.noise_per_speed * speed)
        sd = np.where(clearance < self.edge_clearance, np.hypot(sd, self.edge_sd), sd)
        error += sd[:, None] * rng.normal(size=seen.shape)
        return np.where(hidden[:, None], np.nan, seen + error)

    def _place_error(self, seen: Array, rng: np.random.Generator) -> Array:
        """Draw an error that changes with the place and not with time, shape [frame, 2]."""
        # Waves across the table in random directions: nearby places have nearby errors.
        waves = rng.normal(0.0, 1.0 / _PLACE_SCALE, (8, 2))
        phases = rng.uniform(0.0, 2 * np.pi, (2, 8))
        angle = seen @ waves.T
        return self.place_sd * np.stack(
            [np.cos(angle + phase).sum(axis=-1) / 2.0 for phase in phases], axis=-1
        )


def bias_terms(xy: Array, centre_y: float = DEFAULT_CENTRE_Y) -> Array:
    """Return the terms of the bias polynomial at places [m], shape [..., 6]."""
    return _quadratic(xy - [0.0, centre_y])


def _quadratic(xy: Array) -> Array:
    """Return 1, x, y, x², x y and y² of some places, shape [..., 6]."""
    x, y = xy[..., 0], xy[..., 1]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


class Sensor:
    """Turns what happened into what was seen.

    Args:
        setup: Gives the cable, the table and the arm.
        sample_dt: Time between samples of a track [s].

    Attributes:
        sight: Place of the camera, and where it is blind, as far as it is known by now.
    """

    sight: CameraSight

    def __init__(self, setup: Setup, sample_dt: float = 0.1):
        self.setup = setup
        self.sample_dt = sample_dt

    def observe(
        self, track: EndpointTrack, joint_path: JointPath | None, rng: np.random.Generator
    ) -> EndpointTrack:
        """Return what is seen of a trial, from its true motion with nodes every RECORD_DT.

        The joints are as they really moved, None for a table without an arm.

        Raises:
            InputError: The cable was recorded too rarely for a camera.
        """
        if track.status in _BLIND_STATUSES or track.nodes is None:
            step = max(1, round(self.sample_dt / RECORD_DT)) if len(track.times) > 1 else 1
            return EndpointTrack(
                times=track.times[::step],
                endpoint_xy=np.full_like(track.endpoint_xy[::step], np.nan),
                status=track.status,
                nodes=None if track.nodes is None else track.nodes[::step],
                joint_path=track.joint_path,
            )
        times, nodes = _held(track.times, track.nodes, self.sample_dt)
        frames, xy = self._look(times, nodes, joint_path, rng)
        count = math.floor(times[-1] / self.sample_dt + 1e-6) + 1
        sample_times = np.arange(count, dtype=np.float64) * self.sample_dt
        endpoint_xy, status = track_samples(frames, xy, sample_times, self.setup.workspace)
        return EndpointTrack(
            times=sample_times,
            endpoint_xy=endpoint_xy,
            status=status,
            nodes=nodes[np.searchsorted(times, sample_times - 1e-6)],
            joint_path=track.joint_path,
        )

    def _look(
        self, times: Array, nodes: Array, joint_path: JointPath | None, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Return times of frames [s], and where the endpoint is seen in each [m], [frame, 2]."""
        raise NotImplementedError


class SensorErrorModel(Sensor):
    """Sees with the measured errors of the camera; quick, and without OpenCV."""

    def __init__(self, setup: Setup, sample_dt: float = 0.1):
        super().__init__(setup, sample_dt)
        self.model = CameraErrorModel.load().over(setup.workspace)
        self.sight = self.model.sight

    def _look(
        self, times: Array, nodes: Array, joint_path: JointPath | None, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        from scipy.interpolate import CubicSpline

        frames = np.arange(math.floor(times[-1] / _FRAME_DT + 1e-6) + 1) * _FRAME_DT
        if len(times) > 1:
            points = CubicSpline(times, nodes[:, -1])(np.clip(frames, times[0], times[-1]))
        else:
            points = np.repeat(nodes[:, -1], len(frames), axis=0)
        radius, arm = self.setup.cable.radius, self.setup.arm
        return frames, self.model.observe(frames, points, joint_path, radius, rng, arm)


class SensorCamera(Sensor):
    """Sees with rendered frames and the tracker that a real camera would use.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(
        self,
        setup: Setup,
        sample_dt: float = 0.1,
        lab_seed: int = 0,
        config: CameraConfig | None = None,
    ):
        super().__init__(setup, sample_dt)
        self.camera, self.calibration = _calibrated_camera(setup.workspace, lab_seed, config)
        self.sight = CameraSight(position=self.calibration.view.position)

    def _look(
        self, times: Array, nodes: Array, joint_path: JointPath | None, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        from cablecast.rigs.virtual.camera import track_film
        from cablecast.rigs.virtual.drawing import FilmedTrial
        from cablecast.vision.tracker import sight_of

        trial = FilmedTrial.of(self.setup, times, nodes, joint_path)
        film = self.camera.film(trial, seed=int(rng.integers(2**31)))
        tracker = track_film(film, self.calibration)
        self.sight = sight_of(tracker)
        return tracker.frames


@functools.lru_cache(maxsize=2)
def _calibrated_camera(workspace: Workspace, lab_seed: int, config: CameraConfig | None):
    """Return a camera over the table of a laboratory, and its calibration."""
    from cablecast.rigs.virtual.camera import VirtualCamera, calibrate_virtual_camera

    camera = VirtualCamera(config, workspace, seed=lab_seed)
    return camera, calibrate_virtual_camera(camera, lab_seed)


def _held(times: Array, nodes: Array, sample_dt: float) -> tuple[Array, Array]:
    """Return times and nodes as recorded, held still up to the next whole sample."""
    if len(times) > 1 and np.max(np.diff(times)) > 1.5 * RECORD_DT:
        raise InputError(
            f"the cable was recorded every {np.max(np.diff(times)):.3f} s: a camera needs it every "
            f"{RECORD_DT} s"
        )
    end = math.ceil(times[-1] / sample_dt - 1e-6) * sample_dt
    # The cable rests when its record ends.
    count = round((end - times[-1]) / RECORD_DT)
    more = times[-1] + RECORD_DT * np.arange(1, count + 1)
    return np.concatenate([times, more]), np.concatenate([nodes, np.repeat(nodes[-1:], count, 0)])
