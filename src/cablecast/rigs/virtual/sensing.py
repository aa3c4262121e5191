"""The senses of the virtual rig: a rendered camera, or the measured errors of that camera.

Both start from the cable's true motion, recorded every RECORD_DT, and return the track that a
person would get: samples every 100 ms, NaN where the marker was not seen, and a status.
"""

import functools
import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.settings import CameraSight
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.errors import InputError
from cablecast.motion.trajectory import JointPath
from cablecast.rigs.virtual.camera_error import CameraErrorModel
from cablecast.rigs.virtual.config import SENSING_NAMES
from cablecast.setup import Setup
from cablecast.vision.tracker import track_samples
from cablecast.workspace import Workspace

RECORD_DT = 0.01
"""Time between records of the cable for a camera [s]: a cubic through such shapes is exact to
micrometres, and all frames fall between two of them."""
FRAME_DT = 1.0 / 60.0
_BLIND_STATUSES = (TrialStatus.NON_FINITE, TrialStatus.ABORTED)


class Sensor(Protocol):
    """Turns what happened into what was seen."""

    @property
    def sight(self) -> CameraSight:
        """Place of the camera, and where it is blind, as far as it is known by now."""
        ...

    def observe(
        self, track: EndpointTrack, joint_path: JointPath | None, rng: np.random.Generator
    ) -> EndpointTrack:
        """Return what is seen of a trial.

        Args:
            track: True motion, with the cable's nodes every RECORD_DT.
            joint_path: Joints as they really moved; None for a table without an arm.
            rng: Draws what is left to chance.
        """
        ...


def make_sensor(name: str, setup: Setup, sample_dt: float, lab_seed: int = 0) -> Sensor | None:
    """Return the sensor of a name.

    Args:
        name: One of SENSING_NAMES.
        setup: Gives the cable, the table and the arm.
        sample_dt: Time between samples of a track [s].
        lab_seed: Seed of the laboratory.

    Returns:
        None for "exact".

    Raises:
        InputError: There is no such sensor.
        MissingExtraError: "camera" needs OpenCV, which is not installed.
    """
    if name == "exact":
        return None
    if name == "error_model":
        return SensorErrorModel(setup, sample_dt)
    if name == "camera":
        return SensorCamera(setup, sample_dt, lab_seed)
    raise InputError(f"unknown sensing {name!r}: one of {', '.join(SENSING_NAMES)}")


class SensorErrorModel:
    """Sees with the measured errors of the camera; quick, and without OpenCV.

    Args:
        setup: Gives the cable, the table and the arm.
        sample_dt: Time between samples of a track [s].
        model: Errors of the camera; where None, those that come with cablecast, for this table.
    """

    def __init__(self, setup: Setup, sample_dt: float = 0.1, model: CameraErrorModel | None = None):
        self.setup = setup
        self.sample_dt = sample_dt
        self.model = CameraErrorModel.load().over(setup.workspace) if model is None else model
        self.sight: CameraSight = self.model.sight

    def observe(
        self, track: EndpointTrack, joint_path: JointPath | None, rng: np.random.Generator
    ) -> EndpointTrack:
        """Return what is seen of a trial; see Sensor."""
        if track.status in _BLIND_STATUSES or track.nodes is None:
            return _thinned(track, self.sample_dt)
        times, nodes = _held(track, self.sample_dt)
        frames = np.arange(math.floor(times[-1] / FRAME_DT + 1e-6) + 1) * FRAME_DT
        points = _interpolate(times, nodes[:, -1], frames)
        radius, arm = self.setup.cable.radius, self.setup.arm
        xy = self.model.observe(frames, points, joint_path, radius, rng, arm)
        return _finish(track, frames, xy, times, nodes, self.setup.workspace, self.sample_dt)


class SensorCamera:
    """Sees with rendered frames and the tracker that a real camera would use.

    Args:
        setup: Gives the cable, the table and the arm.
        sample_dt: Time between samples of a track [s].
        lab_seed: Seed of the laboratory.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, setup: Setup, sample_dt: float = 0.1, lab_seed: int = 0):
        self.setup = setup
        self.sample_dt = sample_dt
        self.camera, self.calibration = _calibrated_camera(setup.workspace, lab_seed)
        self.sight = CameraSight(position=self.calibration.view.position)

    def observe(
        self, track: EndpointTrack, joint_path: JointPath | None, rng: np.random.Generator
    ) -> EndpointTrack:
        """Return what is seen of a trial; see Sensor."""
        from cablecast.rigs.virtual.camera import track_film
        from cablecast.rigs.virtual.camera_drawing import FilmedTrial
        from cablecast.vision.tracker import sight_of

        if track.status in _BLIND_STATUSES or track.nodes is None:
            return _thinned(track, self.sample_dt)
        times, nodes = _held(track, self.sample_dt)
        trial = FilmedTrial(
            cable=self.setup.cable,
            times=times,
            nodes=nodes,
            joint_path=joint_path,
            arm=self.setup.arm,
        )
        film = self.camera.film(trial, seed=int(rng.integers(2**31)))
        tracker = track_film(film, self.calibration)
        self.sight = sight_of(tracker)
        frames, xy = tracker.frames
        return _finish(track, frames, xy, times, nodes, self.setup.workspace, self.sample_dt)


@functools.lru_cache(maxsize=2)
def _calibrated_camera(workspace: Workspace, lab_seed: int):
    """Return a camera over the table of a laboratory, and its calibration."""
    from cablecast.rigs.virtual.camera import VirtualCamera
    from cablecast.rigs.virtual.camera_calibrate import calibrate_virtual_camera

    camera = VirtualCamera(workspace=workspace, seed=lab_seed)
    return camera, calibrate_virtual_camera(camera, lab_seed)


def _held(
    track: EndpointTrack, sample_dt: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and nodes as recorded, held still up to the next whole sample."""
    times, nodes = track.times, track.nodes
    if nodes is None:
        raise InputError("a camera needs the cable's nodes")
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


def _interpolate(
    times: NDArray[np.float64], values: NDArray[np.float64], at: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return values between those of some times, on a cubic spline."""
    from scipy.interpolate import CubicSpline

    if len(times) < 2:
        return np.repeat(values, len(at), axis=0)
    return CubicSpline(times, values)(np.clip(at, times[0], times[-1]))


def _thinned(track: EndpointTrack, sample_dt: float) -> EndpointTrack:
    """Return a trial that no camera needs to watch, at the times of a track."""
    step = max(1, round(sample_dt / RECORD_DT)) if len(track.times) > 1 else 1
    return EndpointTrack(
        times=track.times[::step],
        endpoint_xy=np.full_like(track.endpoint_xy[::step], np.nan),
        status=track.status,
        nodes=None if track.nodes is None else track.nodes[::step],
        joint_path=track.joint_path,
    )


def _finish(
    track: EndpointTrack,
    frames: NDArray[np.float64],
    xy: NDArray[np.float64],
    times: NDArray[np.float64],
    nodes: NDArray[np.float64],
    workspace: Workspace,
    sample_dt: float,
) -> EndpointTrack:
    """Return the track that follows from what was seen in the frames."""
    count = math.floor(times[-1] / sample_dt + 1e-6) + 1
    sample_times = np.arange(count, dtype=np.float64) * sample_dt
    endpoint_xy, status = track_samples(frames, xy, sample_times, workspace)
    return EndpointTrack(
        times=sample_times,
        endpoint_xy=endpoint_xy,
        status=status,
        nodes=nodes[np.searchsorted(times, sample_times - 1e-6)],
        joint_path=track.joint_path,
    )
