"""SeenMotion: how the arm moves in the picture, for comparing the camera's clock with the robot's.

Nothing needs to be stuck on the gripper: whatever moves while the arm swings is the arm, or hangs
on it. Dense optical flow (Kroeger et al., DIS, ECCV 2016) tells how far its pixels went.
"""

import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.ur import ArmUR
from cablecast.camera.lens import CameraView
from cablecast.errors import InputError
from cablecast.filming.clock import ClockOffset, fit_offset
from cablecast.motion.joint_path import JointPath
from cablecast.tracking.opencv import load_cv2

Array = NDArray[np.float64]

WIDTH = 480
"""Width of the pictures in which the flow is found [px]: the arm is large and moves as a whole."""
_PRESET, _BLUR = 0, 1.5
"""The quickest of OpenCV's presets, which holds still areas still, and a blur against noise [px].
Of those that were tried on two rendered casts at 30 frames/s these were off least: 1.9 ms."""
_FLOW_MIN = 0.6
"""Way of a pixel between two frames below which it stands still [px of the small picture]."""
_AREA_MIN = 0.002
"""Share of the picture that must move for the motion to be the arm's."""
_REST_SHARE = 0.05
"""Share of its largest speed below which the arm stands still."""
_POINT_DISTANCE = 0.05
"""Distance between points of the arm whose mean stands for what is seen of it [m]."""
_TRAVEL_MIN = 0.15
"""Shortest way of the gripper in a record that tells an offset [m]."""


class SeenMotion:
    """Follows what moves from frame to frame.

    Args:
        row_time: Time by which each row is exposed later than the one above it [s].
    """

    def __init__(self, row_time: float = 0.0):
        self._row_time = row_time
        self._flow = load_cv2().DISOpticalFlow_create(_PRESET)
        self._last: NDArray[np.uint8] | None = None
        self._last_time = 0.0
        self.times: list[float] = []
        self.frame_dts: list[float] = []
        self.velocities: list[Array] = []

    def look(self, image: NDArray[np.uint8], time: float) -> None:
        """Look at the next frame.

        Args:
            image: Frame, BGR, shape [v, u, 3].
            time: Time of its middle row [s].
        """
        cv2 = load_cv2()
        scale = WIDTH / image.shape[1]
        size = (WIDTH, round(scale * image.shape[0]))
        grey = cv2.resize(
            cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), size, interpolation=cv2.INTER_AREA
        )
        grey = cv2.GaussianBlur(grey, (0, 0), _BLUR)
        if self._last is not None:
            flow = self._flow.calc(self._last, grey, None)
            moves = np.linalg.norm(flow, axis=-1) > _FLOW_MIN
            dt, rows = time - self._last_time, np.flatnonzero(moves.any(axis=1))
            middle = time - dt / 2
            velocity = np.zeros(2)
            if moves.sum() > _AREA_MIN * moves.size:
                velocity = flow[moves].mean(axis=0).astype(float) / scale / dt
                row = float(np.mean(rows)) - (size[1] - 1) / 2
                middle += self._row_time * row / scale
            self.times.append(middle)
            self.frame_dts.append(dt)
            self.velocities.append(velocity)
        self._last, self._last_time = grey, time


def sync_by_motion(
    seen: SeenMotion, reported: JointPath, arm: ArmUR, view: CameraView
) -> ClockOffset:
    """Return the offset of the clocks from a swing of the arm that the camera saw.

    Args:
        seen: Motion in the picture.
        reported: Joints as the robot reported them, with times by its own clock [s]. The record of
            one may begin or end up to half of its length before or after that of the other.
        arm: Arm, its mounting and its gripper.
        view: Calibrated camera.

    Raises:
        InputError: The arm hardly moved, was not seen, or moved otherwise than was seen.
    """
    grip = arm.grip_pose(reported.q)[:, :3]
    travel = float(np.linalg.norm(np.diff(grip, axis=0), axis=1).sum())
    if travel < _TRAVEL_MIN:
        raise InputError(
            f"the gripper moved {travel:.3f} m in this record: at least {_TRAVEL_MIN:g} m are "
            "needed to compare clocks"
        )
    pixels = view.to_image(_arm_points(arm, reported.q)).mean(axis=1)
    keep = np.isfinite(pixels).all(axis=1)
    if keep.sum() < 2:
        raise InputError("the arm is never in sight of the camera")
    robot_times, pixels = reported.times[keep], pixels[keep]
    # The direction along which it moves most, in the picture.
    axis = np.linalg.svd(pixels - pixels.mean(axis=0), full_matrices=False)[2][0]
    way = (pixels - pixels.mean(axis=0)) @ axis
    times, dts = np.array(seen.times), np.array(seen.frame_dts)
    if not len(times):
        raise InputError("a film of two frames at least is needed to compare clocks")
    dt = float(np.median(dts))
    first, last = robot_times[0] - times[0], robot_times[-1] - times[-1]
    margin = 0.5 * min(float(np.ptp(robot_times)), float(np.ptp(times)))
    low, high = min(first, last) - margin, max(first, last) + margin
    signal = np.array(seen.velocities) @ axis
    return fit_offset(times, signal, reported_speed(robot_times, way, dt), low, high, 0.01)


def _arm_points(arm: ArmUR, q: Array) -> Array:
    """Return points along the moving links, as many as each is long [m], shape [time, point, 3]."""
    joints = [frame[..., :3, 3] for frame in arm.frames(q)][1:] + [arm.grip_pose(q)[..., :3]]
    points = []
    for start, end in itertools.pairwise(joints):
        count = max(round(float(np.linalg.norm(end[0] - start[0])) / _POINT_DISTANCE), 1)
        share = ((np.arange(count) + 0.5) / count)[:, None]
        points.append(start[:, None] + share * (end - start)[:, None])
    return np.concatenate(points, axis=1)


def reported_speed(times: Array, way: Array, dt: float) -> Callable[[Array], Array]:
    """Return mean speeds over the time between two frames.

    Before and after its record an arm that stands at the record's end stands still; of one that
    moves there nothing is known, and its speed is NaN.

    Args:
        times: Times of the record, rising [s], shape [report].
        way: Way along a line [px], shape [report].
        dt: Time between two frames [s].
    """
    speeds = np.abs(np.diff(way) / np.diff(times))
    still = _REST_SHARE * speeds.max()
    left = way[0] if speeds[0] <= still else np.nan
    right = way[-1] if speeds[-1] <= still else np.nan

    def speed(at: Array) -> Array:
        ahead, behind = (
            np.interp(at + side * dt / 2, times, way, left=left, right=right) for side in (1, -1)
        )
        return (ahead - behind) / dt

    return speed
