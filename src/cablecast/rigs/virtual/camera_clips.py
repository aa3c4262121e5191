"""Rendered clips of made-up motions, on which the errors of the virtual camera are measured."""

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.shape import arm_shape, sight_clearance
from cablecast.arm.ur import ArmUR
from cablecast.cable import load_cable
from cablecast.motion.trajectory import JointPath, joints_at
from cablecast.rigs.virtual.camera import VirtualCamera, track_film
from cablecast.rigs.virtual.camera_drawing import FilmedTrial
from cablecast.vision.calibration import Calibration
from cablecast.vision.tracker import sight_of

Array = NDArray[np.float64]

_ARM = ArmUR()
"""Arm that hides part of the table."""
_NODE_COUNT = 16
_DT = 0.01


@dataclasses.dataclass(frozen=True, kw_only=True)
class Clip:
    """True and tracked endpoints in the frames of one clip.

    Attributes:
        times: Times of the frames [s], shape [frame].
        points: True endpoint [m], shape [frame, 3].
        tracked_xy: Endpoint that the tracker reported, NaN where it saw nothing [m], shape
            [frame, 2].
        clearance: Distance of the line of sight from the arm, infinite without an arm [m], shape
            [frame].
        marker_z: Height at which the tracker believed the marker [m].
        blind: Places of other green things, as x, y and radius [m], shape [place, 3].
    """

    times: Array
    points: Array
    tracked_xy: Array
    clearance: Array
    marker_z: float
    blind: Array

    @property
    def on_blind(self) -> NDArray[np.bool_]:
        """Frames in which the endpoint lies on or by another green thing, shape [frame]."""
        to_place = self.points[:, None, :2] - self.blind[:, :2]
        return np.any(np.hypot(*np.moveaxis(to_place, -1, 0)) < self.blind[:, 2], axis=1)

    @property
    def speed(self) -> Array:
        """Speed of the endpoint over the table [m/s], shape [frame]."""
        return np.linalg.norm(np.gradient(self.points[:, :2], self.times, axis=0), axis=-1)


def clip_trial(rng: np.random.Generator, index: int) -> FilmedTrial:
    """Make up a motion: the endpoint glides from place to place, every other time past an arm.

    Args:
        rng: Draws the motion.
        index: Number of the clip, which decides whether there is an arm.
    """
    cable = load_cable(("cable_1", "cable_2", "cable_3")[index % 3])
    duration = rng.uniform(0.35, 0.9)
    times = np.arange(int(duration / _DT) + 12, dtype=np.float64) * _DT
    u = np.clip(times / duration, 0.0, 1.0)
    glide = u**3 * (10 - 15 * u + 6 * u * u)
    joint_path = None
    grip = np.array([rng.uniform(-0.4, 0.4), rng.uniform(0.5, 0.75)])
    if index % 2:
        theta = rng.uniform(-0.9, 0.9)
        reach = rng.uniform(0.5, 0.85)
        turn = rng.uniform(-0.15, 0.15) * glide
        yaw = theta + turn
        grip = np.stack([reach * np.sin(yaw), reach * np.cos(yaw)], axis=-1)
        still = np.zeros_like(times)
        poses = np.stack([grip[:, 0], grip[:, 1], still + 0.02, yaw, still], axis=1)
        q = _ARM.inverse(poses)
        joint_path = JointPath(times=times, q=q, qd=np.gradient(q, times, axis=0))
        # Towards the arm's silhouette, which hides some of the way.
        passing = grip[0] * rng.uniform(0.45, 1.0) + rng.normal(0, 0.03, 2)
        away = rng.normal(0, 1.0, 2)
        away *= rng.uniform(0.12, 0.3) / np.linalg.norm(away)
        ends = np.stack([passing + away, passing - away * rng.uniform(-0.3, 1.0)])
    else:
        ends = rng.uniform([-1.25, 0.12], [1.25, 1.42], (2, 2))
    ends = np.clip(ends, [-1.34, 0.04], [1.34, 1.46])
    path = ends[0] + glide[:, None] * (ends[1] - ends[0])
    share = np.linspace(0.0, 1.0, _NODE_COUNT)[:, None]
    start = np.broadcast_to(grip, path.shape)
    level = start[:, None] + share * (path - start)[:, None]
    # A bow, so that the marker points in all directions.
    across = np.stack([-(path - start)[:, 1], (path - start)[:, 0]], axis=-1)
    bow = rng.uniform(-0.6, 0.6) * np.sin(np.pi * share)
    nodes = np.concatenate(
        [level + bow * across[:, None], np.full((*level.shape[:2], 1), cable.radius)], axis=-1
    )
    return FilmedTrial(cable=cable, times=times, nodes=nodes, joint_path=joint_path)


def measure(
    camera: VirtualCamera,
    calibration: Calibration,
    clip_count: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
) -> list[Clip]:
    """Film and track made-up motions.

    Args:
        camera: Camera that films.
        calibration: Calibration that the tracker works with.
        clip_count: Number of motions.
        seed: Seed of the motions.
        progress: Called with the number of finished clips.
    """
    clips = []
    for index in range(clip_count):
        rng = np.random.default_rng([seed, index])
        trial = clip_trial(rng, index)
        film = camera.film(trial, seed=int(rng.integers(2**31)))
        tracker = track_film(film, calibration)
        times, tracked_xy = tracker.frames
        points = trial.shape_at(times)[:, -1]
        clearance = np.full(len(times), np.inf)
        if trial.joint_path is not None:
            shape = arm_shape(joints_at(trial.joint_path, times), _ARM)
            clearance = sight_clearance(points, calibration.view.position, shape)
        clips.append(
            Clip(
                times=times,
                points=points,
                tracked_xy=tracked_xy,
                clearance=clearance,
                marker_z=trial.cable.radius,
                blind=np.reshape(sight_of(tracker).blind, (-1, 3)),
            )
        )
        if progress is not None:
            progress(index + 1)
    return clips
