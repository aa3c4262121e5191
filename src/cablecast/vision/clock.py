"""Clocks: the offset between the robot's and the camera's, from a motion of the arm both record.

Nothing needs to be stuck on the gripper. Dense optical flow (Kroeger et al., DIS, ECCV 2016) shows
how far each pixel went from one frame to the next. Whatever moves is the arm, or hangs on it: its
mean velocity gives the offset roughly, since a cable moves as well, and later than the arm. The
flow at the points where the arm must be, and nowhere else, then gives it exactly.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import Arm
from cablecast.arm.shape import arm_shape
from cablecast.camera.lens import CameraView
from cablecast.conventions import GRAVITY
from cablecast.errors import InputError
from cablecast.motion.trajectory import JointPath
from cablecast.vision.tags import load_cv2

Array = NDArray[np.float64]

_FRAME_COUNT_MIN = 30
"""Fewest frames that determine an offset."""
_EXPLAINED_MIN = 0.5
"""Smallest share of the mean velocity in the picture that the robot's report must explain."""
_REFINE_COUNT = 3
_PART_COUNT = 8
"""Parts of the record that are left out in turn, whose scatter is the offset's uncertainty."""
_RUN_LENGTH = 3
"""Frames in a row that are left out together, since errors of neighbours are correlated."""
_WIDTH = 480
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
"""Shortest way of the gripper in a record that determines an offset [m]."""
_KEPT_STRIDE = 3
"""Distance of the pixels whose flow is kept [px of the small picture]: flow is smooth."""
_FLOW_ERROR = 1.0
"""Difference of two ways above which it hardly matters how far off they are, for something else is
seen there: a link that hides another, or the cable [px of the small picture]."""
_EXPLAINED_MIN_ARM = 0.7
"""Smallest share of what was seen where the arm is that its report must explain: casts of the
virtual laboratory reach nine tenths."""
_SPEED_FRAMES, _SLOWING_SPEED = 4, 0.2
"""Frames over which a speed is taken, and least speed of an endpoint that was cast [m/s]."""
_SLOWING_MIN, _USUAL_FRICTION = 0.35, 0.3
"""Least deceleration of a cable that friction stops [m/s²], which is a coefficient of 0.036, and a
usual coefficient [-]."""
_CAST_PAIRS, _CAST_PAIRS_MIN = 36, 12
"""Pairs of frames of a cast in which the arm is fastest, and fewest that tell about its clock."""
_CAST_SEARCHES = ((0.3, 0.015), (0.02, 0.002))
"""Half widths and steps of the searches for the clock's offset of a cast [s]."""
_SEARCHES = ((0.08, 0.004), (0.006, 0.0005))
"""Half widths and steps of the searches about the rough offset [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ClockOffset:
    """Offset between two clocks.

    Attributes:
        offset: Time of the robot's clock when the camera's shows zero [s].
        sd: Standard deviation of the offset [s].
        explained: Share of the variance of what the camera saw that the robot's report explains.
        frame_count: Frames that it was found from.
    """

    offset: float
    sd: float
    explained: float
    frame_count: int


def check_film_rate(times: Array, xy: Array, rate: float) -> None:
    """Check that an endpoint slows as friction slows one; slow motion shows it far more gently.

    One that hardly moved, or did not come to rest, tells nothing.

    Args:
        times: Times of the frames [s], shape [frame].
        xy: Positions, NaN where not seen [m], shape [frame, 2].
        rate: Frames per second that these times stand for [1/s].

    Raises:
        InputError: No table is as slippery as this film would have it.
    """
    seen = np.isfinite(xy).all(axis=1)
    at, places = times[seen], xy[seen]
    if len(at) < 3 * _SPEED_FRAMES:
        return
    way = np.linalg.norm(places[_SPEED_FRAMES:] - places[:-_SPEED_FRAMES], axis=1)
    speeds = way / (at[_SPEED_FRAMES:] - at[:-_SPEED_FRAMES])
    top = float(np.max(speeds))
    fast = int(np.flatnonzero(speeds >= 0.7 * top)[-1])
    slow = np.flatnonzero(speeds[fast:] < 0.1 * top)
    if top < _SLOWING_SPEED or not len(slow):
        return
    slowing = 0.6 * top / float(at[fast + slow[0]] - at[fast])
    if slowing < _SLOWING_MIN:
        factor = np.sqrt(_USUAL_FRICTION * GRAVITY / slowing)
        raise InputError(
            f"the endpoint slowed from {top:.2f} m/s by {slowing:.2f} m/s² only, as on a table "
            f"with a friction of {slowing / GRAVITY:.3f}: was it filmed in slow motion, with "
            f"about {factor * rate:.0f} frames/s stored as {rate:.0f}? Say the true ones (--rate)"
        )


def controller_shift(clock_pairs: Array) -> float:
    """Return the time of this computer's clock when the controller's shows zero [s].

    The report that travelled fastest gives it best. `clock_pairs` are times of reports by the
    controller's clock, and of their arrival by that of this computer [s], shape [report, 2].
    """
    pairs = np.asarray(clock_pairs, dtype=float).reshape(-1, 2)
    if not len(pairs):
        raise InputError("the controller reported no times, which a camera without a clock needs")
    return float(np.min(pairs[:, 1] - pairs[:, 0]))


def rough_offset(
    times: Array,
    seen: Array,
    reported: Callable[[Array], Array],
    low: float,
    high: float,
    step: float = 0.01,
) -> float:
    """Return the offset at which a report explains best what the camera saw [s].

    The signal that was seen at times of the camera's clock, shape [frame], may be any multiple of
    the one reported by the robot's, plus a constant: its scale depends on what part of the arm was
    seen. Either is NaN where there is none. Offsets from low to high [s] are searched in steps.

    Raises:
        InputError: There are too few frames, or the two have nothing in common.
    """
    keep = np.isfinite(seen)
    times, seen = times[keep], seen[keep]
    if len(times) < _FRAME_COUNT_MIN:
        raise InputError(
            f"{len(times)} frames show the motion: at least {_FRAME_COUNT_MIN} are needed"
        )
    offset, explained = _best(times, seen, reported, np.arange(low, high + step, step))
    if explained < _EXPLAINED_MIN:
        raise InputError(
            f"what the robot reports explains only {100 * explained:.0f} % of what the camera saw "
            f"in {len(times)} frames: is the gripper in sight, nothing else in motion, the film as "
            "fast as the world, and the computer free enough to take every frame?"
        )
    return offset


def _parabola_minimum(places: Array, values: Array) -> float:
    """Return the place of a minimum, between the even places about the least of some values."""
    least = int(np.clip(np.argmin(values), 1, len(values) - 2))
    left, middle, right = values[least - 1 : least + 2]
    bend, step = left - 2 * middle + right, places[1] - places[0]
    shift = 0.5 * (left - right) / bend if bend > 0 else 0.0
    return float(places[least] + step * np.clip(shift, -1.0, 1.0))


def _best(
    times: Array, seen: Array, reported: Callable[[Array], Array], offsets: Array
) -> tuple[float, float]:
    """Return the offset that explains most, refined by a parabola, and how much it explains."""
    best, step = float(offsets[0]), float(offsets[1] - offsets[0])
    for _ in range(_REFINE_COUNT):
        shares = np.array([_explained(seen, reported(times + offset)) for offset in offsets])
        if not np.isfinite(shares).any():
            return best, 0.0
        best, step = float(offsets[int(np.nanargmax(shares))]), float(offsets[1] - offsets[0])
        offsets = best + np.linspace(-step, step, 9)
    left, middle, right = (
        _explained(seen, reported(times + best + shift)) for shift in (-step, 0.0, step)
    )
    bend = left - 2 * middle + right
    if np.isfinite(bend) and bend < 0:
        best += float(np.clip(0.5 * step * (left - right) / bend, -step, step))
    return best, float(np.nan_to_num(_explained(seen, reported(times + best))))


def _explained(seen: Array, reported: Array) -> float:
    """Return the share of the variance of one signal that a line of the other explains."""
    both = np.isfinite(reported)
    if both.sum() < _FRAME_COUNT_MIN / 2 or both.sum() < 0.5 * len(seen):
        return np.nan
    a, b = seen[both] - seen[both].mean(), reported[both] - reported[both].mean()
    scale = float(a @ a) * float(b @ b)
    # A motion seen backwards is another motion.
    return float(max(a @ b, 0.0) ** 2 / scale) if scale > 0 else np.nan


class SeenMotion:
    """Follows what moves from frame to frame; each row is exposed `row_time` [s] after the last."""

    def __init__(self, row_time: float = 0.0):
        self.row_time = row_time
        self._flow = load_cv2().DISOpticalFlow_create(_PRESET)
        self._last: NDArray[np.uint8] | None = None
        self._last_time = 0.0
        self.times: list[float] = []
        self.ends: list[tuple[float, float]] = []
        self.velocities: list[Array] = []
        self.flows: list[NDArray[np.float16]] = []
        self.scale = 1.0

    def look(self, image: NDArray[np.uint8], time: float) -> None:
        """Look at the next frame, BGR, shape [v, u, 3], whose middle row has a time [s]."""
        grey = small_grey(image)
        self.scale = _WIDTH / image.shape[1]
        if self._last is not None:
            self.compare(self._last, self._last_time, grey, time)
        self._last, self._last_time = grey, time

    def compare(
        self, before: NDArray[np.uint8], start: float, after: NDArray[np.uint8], end: float
    ) -> None:
        """Keep the flow between two pictures of `small_grey` and of two times [s]."""
        flow = self._flow.calc(before, after, None)
        moves = np.linalg.norm(flow, axis=-1) > _FLOW_MIN
        rows, middle, velocity = np.flatnonzero(moves.any(axis=1)), (start + end) / 2, np.zeros(2)
        if moves.sum() > _AREA_MIN * moves.size:
            velocity = flow[moves].mean(axis=0).astype(float) / self.scale / (end - start)
            row = float(np.mean(rows)) - (len(after) - 1) / 2
            middle += self.row_time * row / self.scale
        self.flows.append(flow[::_KEPT_STRIDE, ::_KEPT_STRIDE].astype(np.float16))
        self.ends.append((start, end))
        self.times.append(middle)
        self.velocities.append(velocity)


def small_grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture, BGR, as small, grey and smooth as flow is found in."""
    cv2 = load_cv2()
    size = (_WIDTH, round(_WIDTH / image.shape[1] * image.shape[0]))
    grey = cv2.resize(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), size, interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(grey, (0, 0), _BLUR)


class CastClock:
    """Keeps small pictures of a cast, which tell afterwards whether its clocks agreed.

    Args:
        width: Width of the pictures of the camera [px].
        row_time: Time by which each row is exposed later than the one above it [s].
    """

    def __init__(self, width: int, row_time: float = 0.0):
        self._scale, self._row_time = _WIDTH / width, row_time
        self._kept: list[tuple[float, NDArray[np.uint8]]] = []

    def keep(self, image: NDArray[np.uint8], time: float) -> None:
        """Keep a frame, BGR, shape [v, u, 3], of a time [s]."""
        self._kept.append((time, small_grey(image)))

    def compare(
        self, reported: JointPath, arm: Arm, view: CameraView, shift: float
    ) -> ClockOffset | None:
        """Return by how much the camera's clock is off from what is believed of it.

        Args:
            reported: Joints as the robot reported them, by its clock [s].
            arm: Arm, its mounting and its gripper.
            view: Calibrated camera.
            shift: Time of the robot's clock when the camera's shows zero, as believed [s].

        Returns:
            The offset to add to `shift`; None where the arm hardly moved in sight.
        """
        points = view.to_image(_arm_points(arm, reported.q))
        keep = np.isfinite(points).all(axis=(1, 2))
        robot_times, points = reported.times[keep], points[keep]
        if len(robot_times) < 2 or len(self._kept) < 2:
            return None
        times = np.array([time for time, _ in self._kept]) + shift
        # Where the arm is fast, a shift of time shows most.
        rates = np.gradient(points, robot_times, axis=0)
        speeds = np.linalg.norm(rates, axis=-1).mean(axis=1) * self._scale
        ways = np.interp(times[:-1], robot_times, speeds, 0.0, 0.0) * np.diff(times)
        fast = np.sort(np.argsort(-ways)[:_CAST_PAIRS])
        if len(fast) < _CAST_PAIRS_MIN or ways[fast].mean() < _FLOW_MIN:
            return None
        seen = SeenMotion(self._row_time)
        seen.scale = self._scale
        for i in fast:
            (start, before), (end, after) = self._kept[i : i + 2]
            seen.compare(before, start + shift, after, end + shift)
        points, offset = points * self._scale, 0.0
        offsets, losses = np.zeros(1), np.zeros((1, len(fast)))
        for width, step in _CAST_SEARCHES:
            offsets = offset + np.arange(-width, width + step / 2, step)
            losses = np.array([_compare(seen, robot_times, points, at)[0] for at in offsets])
            offset = _parabola_minimum(offsets, losses.sum(axis=1))
        _, explained = _compare(seen, robot_times, points, offset)
        sd = _jackknife(offsets, losses)
        return ClockOffset(offset=offset, sd=sd, explained=explained, frame_count=len(fast))


def sync_by_motion(
    seen: SeenMotion, reported: JointPath, arm: Arm, view: CameraView
) -> ClockOffset:
    """Return the offset of the clocks from a swing of the arm that the camera saw.

    Args:
        seen: Motion in the picture.
        reported: Joints as the robot reported them, with times by its own clock [s]. The record of
            one may start or end up to half of its length before or after that of the other.
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
    times = np.array(seen.times)
    if not len(times):
        raise InputError("a film of two frames at least is needed to compare clocks")
    dt = float(np.median(np.diff(seen.ends)))
    first, last = robot_times[0] - times[0], robot_times[-1] - times[-1]
    margin = 0.5 * min(float(np.ptp(robot_times)), float(np.ptp(times)))
    low, high = min(first, last) - margin, max(first, last) + margin
    signal = np.array(seen.velocities) @ axis
    offset = rough_offset(times, signal, reported_speed(robot_times, way, dt), low, high)
    # The offset at which most points of the arm go as the flow has it where they are.
    points = points * seen.scale
    for width, step in _SEARCHES:
        offsets = offset + np.arange(-width, width + step / 2, step)
        losses = np.array([_compare(seen, robot_times, points, at)[0] for at in offsets])
        offset = _parabola_minimum(offsets, losses.sum(axis=1))
    _, explained = _compare(seen, robot_times, points, offset)
    if explained < _EXPLAINED_MIN_ARM:
        raise InputError(
            f"what the robot reports explains only {100 * explained:.0f} % of what the camera saw "
            "where the arm is: is the arm measured, and is the camera where it was calibrated?"
        )
    sd = _jackknife(offsets, losses)
    return ClockOffset(offset=offset, sd=sd, explained=explained, frame_count=len(seen.flows))


def _jackknife(offsets: Array, losses: Array) -> float:
    """Return the standard deviation of the best offset [s] by losses, shape [offset, frame]."""
    parts = np.arange(losses.shape[1]) // _RUN_LENGTH % _PART_COUNT
    left_out = [
        _parabola_minimum(offsets, losses[:, parts != part].sum(axis=1))
        for part in range(_PART_COUNT)
    ]
    return float(np.sqrt((_PART_COUNT - 1) * np.var(left_out)))


def _compare(
    seen: SeenMotion, robot_times: Array, points: Array, offset: float
) -> tuple[Array, float]:
    """Return the share of the points in each frame that go otherwise than the flow, shape [frame].

    The second is the share of the flow where the arm is that its way explains.
    """
    height = _KEPT_STRIDE * seen.flows[0].shape[0]
    before, after = np.array(seen.ends).T + offset
    start = _points_at(before, robot_times, points, seen, height)
    way = _points_at(after, robot_times, points, seen, height) - start
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
    inside = np.isfinite(off)
    loss = np.where(inside, off / (off + _FLOW_ERROR**2), 1.0).mean(axis=1)
    a, b = flow[inside], way[inside]
    scale = float(np.sum(a * a) * np.sum(b * b))
    explained = max(float(np.sum(a * b)), 0.0) ** 2 / scale if scale > 0 else 0.0
    return loss, explained


def _points_at(
    times: Array, robot_times: Array, points: Array, seen: SeenMotion, height: int
) -> Array:
    """Return points of the arm as the frames of given times show them, shape [frame, point, 2]."""

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


def _arm_points(arm: Arm, q: Array) -> Array:
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

    Before and after its record of times [s] and ways along a line [px], shape [report], an arm that
    stands at the record's end stands still; of one that moves there the speed is NaN.
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
