"""SeenMotion: how the arm moves in the picture, for comparing the camera's clock with the robot's.

Nothing needs to be stuck on the gripper. Dense optical flow (Kroeger et al., DIS, ECCV 2016) tells
how far each pixel went from one frame to the next. Whatever moves is the arm, or hangs on it: its
mean velocity tells the offset roughly, since a cable moves as well, and later than the arm. The
flow at the points where the arm must be, and nowhere else, then tells it exactly.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.shape import arm_shape
from cablecast.arm.ur import ArmUR
from cablecast.camera.lens import CameraView
from cablecast.errors import InputError
from cablecast.filming.clock import (
    PART_COUNT,
    RUN_LENGTH,
    ClockOffset,
    fit_offset,
    jackknife_sd,
    parabola_minimum,
)
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
_STILL_ROD_COUNT = 2
"""Rods of the arm's base, which stand still and come first."""
_TRAVEL_MIN = 0.15
"""Shortest way of the gripper in a record that tells an offset [m]."""
_KEPT_STRIDE = 3
"""Distance of the pixels whose flow is kept [px of the small picture]: flow is smooth."""
_FLOW_ERROR = 1.0
"""Difference of two ways above which it hardly matters how far off they are, for something else is
seen there: a link that hides another, or the cable [px of the small picture]."""
_EXPLAINED_MIN = 0.7
"""Smallest share of what was seen where the arm is that its report must explain: casts of the
virtual laboratory reach nine tenths."""
_SEARCHES = ((0.08, 0.004), (0.006, 0.0005))
"""Half widths and steps of the searches about the rough offset [s]."""


class SeenMotion:
    """Follows what moves from frame to frame.

    Args:
        row_time: Time by which each row is exposed later than the one above it [s].
    """

    def __init__(self, row_time: float = 0.0):
        self.row_time = row_time
        self._flow = load_cv2().DISOpticalFlow_create(_PRESET)
        self._last: NDArray[np.uint8] | None = None
        self._last_time = 0.0
        self.times: list[float] = []
        self.ends: list[tuple[float, float]] = []
        self.frame_dts: list[float] = []
        self.velocities: list[Array] = []
        self.flows: list[NDArray[np.float16]] = []
        self.scale = 1.0

    def look(self, image: NDArray[np.uint8], time: float) -> None:
        """Look at the next frame.

        Args:
            image: Frame, BGR, shape [v, u, 3].
            time: Time of its middle row [s].
        """
        cv2 = load_cv2()
        self.scale = scale = WIDTH / image.shape[1]
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
                middle += self.row_time * row / scale
            self.flows.append(flow[::_KEPT_STRIDE, ::_KEPT_STRIDE].astype(np.float16))
            self.ends.append((self._last_time, time))
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
    points = view.to_image(_arm_points(arm, reported.q))
    keep = np.isfinite(points).all(axis=(1, 2))
    if keep.sum() < 2:
        raise InputError("the arm is never in sight of the camera")
    robot_times, points = reported.times[keep], points[keep]
    pixels = points.mean(axis=1)
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
    rough = fit_offset(times, signal, reported_speed(robot_times, way, dt), low, high, 0.01)
    return _refine(rough, seen, robot_times, points)


def _refine(rough: ClockOffset, seen: SeenMotion, robot_times: Array, points: Array) -> ClockOffset:
    """Return the offset at which most points of the arm go as the flow has it where they are.

    Args:
        rough: Offset to begin with.
        seen: Motion in the picture.
        robot_times: Times of the robot's reports [s], shape [report].
        points: Points of the arm in the picture at these times [px], shape [report, point, 2].
    """
    points = points * seen.scale
    offset, parts = rough.offset, np.arange(len(seen.flows)) // RUN_LENGTH % PART_COUNT
    for width, step in _SEARCHES:
        offsets = offset + np.arange(-width, width + step / 2, step)
        losses = np.array([_compare(seen, robot_times, points, at)[0] for at in offsets])
        offset = parabola_minimum(offsets, losses.sum(axis=1))
    left_out = [
        parabola_minimum(offsets, losses[:, parts != part].sum(axis=1))
        for part in range(PART_COUNT)
    ]
    _, explained = _compare(seen, robot_times, points, offset)
    if explained < _EXPLAINED_MIN:
        raise InputError(
            f"what the robot reports explains only {100 * explained:.0f} % of what the camera saw "
            "where the arm is: is the arm measured, and is the camera where it was calibrated?"
        )
    return ClockOffset(
        offset=offset,
        sd=jackknife_sd(np.array(left_out)),
        explained=explained,
        frame_count=len(seen.flows),
    )


def _compare(
    seen: SeenMotion, robot_times: Array, points: Array, offset: float
) -> tuple[Array, float]:
    """Return how much of the arm goes otherwise than the flow has it.

    Returns:
        Share of the points in each frame that go otherwise, shape [frame], and the share of what
        was seen where the arm is that its way explains.
    """
    height = _KEPT_STRIDE * seen.flows[0].shape[0]
    begin, end = (np.array([pair[side] for pair in seen.ends]) + offset for side in (0, 1))
    start = _points_at(begin, robot_times, points, seen, height)
    way = _points_at(end, robot_times, points, seen, height) - start
    place = (start / _KEPT_STRIDE).astype(np.float32)
    cv2, outside = load_cv2(), (np.nan, np.nan)
    flow = np.stack(
        [
            cv2.remap(
                seen.flows[frame].astype(np.float32),
                place[None, frame, :, 0],
                place[None, frame, :, 1],
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=outside,
            )[0]
            for frame in range(len(seen.flows))
        ]
    )
    off = np.sum((flow - way) ** 2, axis=-1)
    known = np.isfinite(off)
    loss = np.where(known, off / (off + _FLOW_ERROR**2), 1.0).mean(axis=1)
    a, b = flow[known], way[known]
    scale = float(np.sum(a * a) * np.sum(b * b))
    explained = max(float(np.sum(a * b)), 0.0) ** 2 / scale if scale > 0 else 0.0
    return loss, explained


def _points_at(
    times: Array, robot_times: Array, points: Array, seen: SeenMotion, height: int
) -> Array:
    """Return points of the arm as frames of some times show them, shape [frame, point, 2]."""

    def at(times: Array) -> Array:
        columns = [
            [np.interp(times[:, place], robot_times, points[:, place, axis]) for axis in (0, 1)]
            for place in range(points.shape[1])
        ]
        return np.moveaxis(np.array(columns), -1, 0)

    same = np.repeat(times[:, None], points.shape[1], axis=1)
    seen_at = at(same)
    if seen.row_time:
        # Each row is exposed later than the one above it.
        rows = (seen_at[..., 1] - height / 2) / seen.scale
        seen_at = at(same + seen.row_time * rows)
    return seen_at


def _arm_points(arm: ArmUR, q: Array) -> Array:
    """Return points along the moving links, as many as each is long [m], shape [time, point, 3]."""
    rods = arm_shape(q, arm).ends[:, _STILL_ROD_COUNT:]
    points = []
    for rod in range(rods.shape[1]):
        start, end = rods[:, rod, 0], rods[:, rod, 1]
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
