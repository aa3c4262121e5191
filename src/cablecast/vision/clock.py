"""Clocks: the offset between the robot's and the camera's, from a motion of the arm both record.

Nothing needs to be stuck on the gripper. Dense optical flow (Kroeger et al., DIS, ECCV 2016) shows
how far each pixel went from one frame to the next. The flow at the points where the arm must be,
and nowhere else, tells the offset, and whether the frames are as far apart as their times say.
"""

import dataclasses
import itertools
import warnings

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import Arm
from cablecast.arm.shape import arm_shape
from cablecast.camera.lens import CameraView
from cablecast.conventions import GRAVITY, Array
from cablecast.errors import InputError
from cablecast.motion.trajectory import JointPath
from cablecast.vision.tags import load_cv2, to_grey

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
"""Way of the arm between two frames that is seen [px of the small picture]."""
_POINT_DISTANCE = 0.05
"""Distance between points of the arm whose mean stands for what is seen of it [m]."""
_STILL_ROD_COUNT = 2
"""Rods of the arm's base, which stand still and come first."""
_REST_SHARE = 0.05
"""Share of its largest speed below which the arm stands still."""
_TRAVEL_MIN = 0.15
"""Shortest way of the gripper in a record that determines an offset [m]."""
_KEPT_STRIDE = 3
"""Distance of the pixels whose flow is kept [px of the small picture]: flow is smooth."""
_FLOW_ERROR = 1.0
"""Difference of two ways above which it barely matters how far off they are, for something else is
seen there: a link that hides another, or the cable [px of the small picture]."""
_EXPLAINED_MIN = 0.7
"""Smallest share of what was seen where the arm is that its report must explain: casts of the
virtual laboratory reach nine tenths."""
_SPEED_FRAMES, _SLOWING_SPEED = 4, 0.2
"""Frames over which a speed is taken, and least speed of an endpoint that was cast [m/s]."""
_SPEED_PARTS, _MOVING_SPEED, _MOVING_WAY = 100, 0.03, 0.15
"""Parts of a long film over which a speed is taken; and speed [m/s] and extent [m] of a way that
tells something."""
_SLOWING_MIN, _TYPICAL_FRICTION = 0.35, 0.3
"""Least deceleration of a cable that friction stops [m/s²], which is a coefficient of 0.036, and a
typical coefficient [-]."""
_PAIRS, _PAIRS_MIN = 48, 12
"""Pairs of frames in which most moves, by which clocks are compared, and fewest that will do."""
_STEP, _FINE_REACH, _FINE_STEP = 0.015, 0.02, 0.002
"""Step of the search for an offset, and reach and step of the one about what it found [s]."""
_MARGIN = 0.3
"""Time by which a motion that was seen may lie outside the robot's record of it [s]."""
_PACES, _PACE_REACH = 2.0 ** np.arange(-3.5, 3.6, 0.25), 4.0
"""Paces of a film that are tried [-], as far as its motion then lasts as long as the reported one
but for a factor: the cable moves on."""
_PACE_OFF = 1.15
"""Factor by which the best pace differs from 1 where the film's rate is wrong."""
_RATES = (24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 100.0, 120.0, 240.0, 480.0, 960.0)
"""Rates of films as cameras have them [1/s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ClockOffset:
    """Offset between two clocks.

    Attributes:
        offset: Time of the robot's clock when the camera's shows zero [s].
        sd: Standard deviation of the offset [s].
        explained: Share of what the camera saw where the arm is that the robot's report explains.
        agreed: Share of the points of the arm that go as was seen there.
        frame_count: Pairs of frames that it was found from.
    """

    offset: float
    sd: float
    explained: float
    agreed: float
    frame_count: int


def check_film_rate(times: Array, xy: Array, rate: float) -> None:
    """Check that an endpoint slows as friction slows one; slow motion shows it far more gently.

    One that barely moved, or did not come to rest, tells nothing. One that was slow may have been
    pulled to its place by the arm, and gets a warning.

    Args:
        times: Times of the frames [s], shape [frame].
        xy: Positions, NaN where not seen [m], shape [frame, 2].
        rate: Frames per second that these times stand for [1/s].
    """
    seen = np.isfinite(xy).all(axis=1)
    at, places = times[seen], xy[seen]
    if len(at) < 3 * _SPEED_FRAMES:
        return
    span = max(_SPEED_FRAMES, len(at) // _SPEED_PARTS)
    way = np.linalg.norm(places[span:] - places[:-span], axis=1)
    speeds = way / (at[span:] - at[:-span])
    top = float(np.max(speeds))
    fast = int(np.flatnonzero(speeds >= 0.7 * top)[-1])
    slow = np.flatnonzero(speeds[fast:] < 0.1 * top)
    if top < _MOVING_SPEED or np.ptp(places, axis=0).max() < _MOVING_WAY or not len(slow):
        return
    slowing = 0.6 * top / float(at[fast + slow[0]] - at[fast])
    if slowing < _SLOWING_MIN:
        pace = float(np.sqrt(slowing / (_TYPICAL_FRICTION * GRAVITY)))
        words = (
            f"the endpoint slowed from {top:.2f} m/s by {slowing:.2f} m/s² only, as on a table "
            f"with a friction of {slowing / GRAVITY:.3f}: {_rate_words(pace, rate)}"
        )
        if top >= _SLOWING_SPEED:
            raise InputError(f"{words} Say the true ones (--rate)")
        warnings.warn(
            f"{words} Say the true ones (--rate), unless the arm pulled the endpoint to its place",
            stacklevel=2,
        )


def _rate_words(pace: float, rate: float) -> str:
    """Return what to do about a film that shows a second in 1 / pace seconds at a rate [1/s]."""
    near = min(_RATES, key=lambda known: abs(np.log(known * pace / rate)))
    true = near if abs(np.log(near * pace / rate)) < np.log(_PACE_OFF) else rate / pace
    return f"was it filmed with about {true:.0f} frames/s, and stored as {rate:.0f}?"


def controller_shift(clock_pairs: Array) -> float:
    """Return the time of this computer's clock when the controller's shows zero [s].

    The report that travelled fastest gives it best. `clock_pairs` are times of reports by the
    controller's clock, and of their arrival by that of this computer [s], shape [report, 2].
    """
    pairs = np.asarray(clock_pairs, dtype=float).reshape(-1, 2)
    if not len(pairs):
        raise InputError("the controller reported no times, which a camera without a clock needs")
    return float(np.min(pairs[:, 1] - pairs[:, 0]))


class CastClock:
    """Keeps small pictures of a motion of the arm, which tell afterwards whether clocks agree.

    Args:
        width: Width of the pictures of the camera [px].
        row_time: Time by which each row is exposed later than the one above it [s].
    """

    def __init__(self, width: int, row_time: float = 0.0):
        self._scale, self._row_time = _WIDTH / width, row_time
        self._kept: list[tuple[float, NDArray[np.uint8]]] = []

    def keep(self, image: NDArray[np.uint8], time: float) -> None:
        """Keep a frame, BGR, shape [v, u, 3], whose middle row has a time [s]."""
        cv2 = load_cv2()
        size = (_WIDTH, round(_WIDTH / image.shape[1] * image.shape[0]))
        grey = cv2.resize(to_grey(image), size, interpolation=cv2.INTER_AREA)
        self._kept.append((time, cv2.GaussianBlur(grey, (0, 0), _BLUR)))

    def compare(
        self, reported: JointPath, arm: Arm, view: CameraView, shift: float, reach: float
    ) -> ClockOffset | None:
        """Return by how much the camera's clock is off from what is believed of it.

        Args:
            reported: Joints as the robot reported them, by its clock [s].
            arm: Arm, its mounting and its gripper.
            view: Calibrated camera.
            shift: Time of the robot's clock when the camera's shows zero, as believed [s].
            reach: Largest offset from that which is looked for [s].

        Returns:
            The offset to add to `shift`; None where the arm barely moved in sight.
        """
        seen = self._seen(reported, arm, view)
        return None if seen is None else seen.offset(shift, reach)

    def sync(self, reported: JointPath, arm: Arm, view: CameraView) -> ClockOffset:
        """Return the offset of clocks of which nothing is known; see `compare`.

        The record of one may start or end up to half of its length before or after the other's.

        Raises:
            InputError: The arm barely moved, was not seen, moved otherwise than was seen, or the
                frames are further apart in time than their times say, or less.
        """
        grip = arm.grip_pose(reported.q)[:, :3]
        travel = float(np.linalg.norm(np.diff(grip, axis=0), axis=1).sum())
        if travel < _TRAVEL_MIN:
            raise InputError(
                f"the gripper moved {travel:.3f} m in this record: at least {_TRAVEL_MIN:g} m are "
                "needed to compare clocks"
            )
        seen = self._seen(reported, arm, view)
        if seen is None:
            raise InputError(
                f"{len(self._kept)} frames do not show the arm in motion: is it in sight, and is "
                "the film as long as the motion?"
            )
        found, share = seen.fit(), np.ptp(seen.times) / np.ptp(seen.ends)
        paces = _PACES[np.abs(np.log(_PACES / share)) < np.log(_PACE_REACH)].tolist()
        fits = [(found, 1.0), *((seen.paced(pace).fit(), pace) for pace in paces)]
        best, pace = max(fits, key=lambda fit: fit[0].agreed)
        if best.explained > _EXPLAINED_MIN and not 1 / _PACE_OFF < pace < _PACE_OFF:
            raise InputError(
                f"by the arm's way, a second of this film took {pace:.2g} s: "
                f"{_rate_words(pace, self._rate)} Say the true ones (`track --rate`), "
                "or take `clock: arrival` for a live camera that makes its times up"
            )
        if found.explained < _EXPLAINED_MIN:
            raise InputError(
                f"what the robot reports explains only {100 * found.explained:.0f} % of what the "
                "camera saw where the arm is: is the arm measured, the camera where it was "
                "calibrated, and the computer free enough to take every frame?"
            )
        return found

    @property
    def _rate(self) -> float:
        """Frames per second by their times [1/s]."""
        return (len(self._kept) - 1) / (self._kept[-1][0] - self._kept[0][0])

    def _seen(self, reported: JointPath, arm: Arm, view: CameraView) -> "_Motion | None":
        """Return the pairs of frames in which most moves; None if the arm barely does in sight."""
        points = view.to_image(_arm_points(arm, reported.q))
        keep = np.isfinite(points).all(axis=(1, 2))
        robot_times, points = reported.times[keep], self._scale * points[keep]
        if len(robot_times) < 2 or len(self._kept) <= _PAIRS_MIN:
            return None
        dt = 1.0 / self._rate
        rates = np.linalg.norm(np.gradient(points, robot_times, axis=0), axis=-1).mean(axis=1)
        if dt * rates.max() < _FLOW_MIN:
            return None
        # Outside of its motion, the arm stands as at the ends of this.
        first, last = np.flatnonzero(rates > _REST_SHARE * rates.max())[[0, -1]]
        motion = np.s_[max(first - 1, 0) : last + 2]
        times = np.array([time for time, _ in self._kept])
        bright = [image / float(image.mean() + 1.0) for _, image in self._kept]
        moved = [float(np.abs(b - a).mean()) for a, b in itertools.pairwise(bright)]
        pairs = np.sort(np.argsort(moved)[-_PAIRS:])
        flow = load_cv2().DISOpticalFlow_create(_PRESET)
        ways = [flow.calc(self._kept[i][1], self._kept[i + 1][1], None) for i in pairs]
        return _Motion(
            ends=np.stack([times[pairs], times[pairs + 1]], axis=-1),
            flow=np.concatenate([way[::_KEPT_STRIDE, ::_KEPT_STRIDE] for way in ways]),
            times=robot_times[motion],
            points=points[motion],
            row_time=self._row_time / self._scale,
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Motion:
    """What was seen between pairs of frames, and where points of the arm must have been.

    Attributes:
        ends: Times of both frames of each pair by the camera's clock [s], shape [pair, 2].
        flow: Ways of pixels between them, pair below pair [px], shape [pair * v, u, 2].
        times: Times of the robot's report by its clock [s], shape [report].
        points: Places of points of the arm in the small picture [px], shape [report, point, 2].
        row_time: Time by which each row of the small picture is exposed after the one above it [s].
    """

    ends: Array
    flow: NDArray[np.float32]
    times: Array
    points: Array
    row_time: float

    def paced(self, pace: float) -> "_Motion":
        """Return the same, where a second of the film took `pace` seconds."""
        start = self.ends.min()
        return dataclasses.replace(self, ends=start + pace * (self.ends - start))

    def fit(self) -> ClockOffset:
        """Return the offset of clocks of which nothing is known."""
        first, last = self.times[[0, -1]] - [self.ends.min(), self.ends.max()]
        shift, reach = (first + last) / 2, abs(first - last) / 2 + _MARGIN
        found = self.offset(shift, reach)
        return dataclasses.replace(found, offset=float(shift) + found.offset)

    def offset(self, shift: float, reach: float) -> ClockOffset:
        """Return the offset from a shift at which most points go as the flow has it, in a reach."""
        offsets, losses, best = np.zeros(1), np.zeros((1, len(self.ends))), 0.0
        for width, step in ((reach, _STEP), (_FINE_REACH, _FINE_STEP)):
            offsets = best + np.arange(-width, width + step / 2, step)
            losses = np.array([self._compare(shift + at)[0] for at in offsets])
            best = _parabola_minimum(offsets, losses.sum(axis=1))
        _, explained = self._compare(shift + best)
        return ClockOffset(
            offset=best,
            sd=_jackknife(offsets, losses),
            explained=explained,
            agreed=1.0 - float(losses.mean(axis=1).min()),
            frame_count=len(self.ends),
        )

    def _compare(self, shift: float) -> tuple[Array, float]:
        """Return the share of the points that go otherwise than the flow, shape [pair].

        The second is the share of the flow where the arm is that its way explains.
        """
        start, end = (self._points_at(self.ends[:, k] + shift) for k in (0, 1))
        way, place = end - start, (start / _KEPT_STRIDE).astype(np.float32)
        height, width = len(self.flow) // len(self.ends), self.flow.shape[1]
        inside = ((place >= 0) & (place <= [width - 1, height - 1])).all(axis=-1)
        place[..., 1] += height * np.arange(len(self.ends))[:, None]
        flow = load_cv2().remap(self.flow, place[..., 0], place[..., 1], 1)
        off = np.sum((flow - way) ** 2, axis=-1)
        loss = np.where(inside, off / (off + _FLOW_ERROR**2), 1.0).mean(axis=1)
        a, b = flow[inside], way[inside]
        scale = float(np.sum(a * a) * np.sum(b * b))
        explained = max(float(np.sum(a * b)), 0.0) ** 2 / scale if scale > 0 else 0.0
        return loss, explained

    def _points_at(self, times: Array) -> Array:
        """Return points of the arm as the frames of given times show them, [pair, point, 2]."""
        seen = self._between(np.repeat(times[:, None], self.points.shape[1], axis=1))
        if self.row_time:
            # Each row is exposed later than the one above it.
            middle = _KEPT_STRIDE * len(self.flow) / len(self.ends) / 2
            seen = self._between(times[:, None] + self.row_time * (seen[..., 1] - middle))
        return seen

    def _between(self, times: Array) -> Array:
        """Return points between reports, at rest before and after these, shape [pair, point, 2]."""
        at = np.clip(times, self.times[0], self.times[-1])
        after = np.clip(np.searchsorted(self.times, at), 1, len(self.times) - 1)
        low, high = self.times[after - 1], self.times[after]
        share, point = ((at - low) / (high - low))[..., None], np.arange(times.shape[1])
        return (1 - share) * self.points[after - 1, point] + share * self.points[after, point]


def _parabola_minimum(places: Array, values: Array) -> float:
    """Return the place of a minimum, between the even places about the least of some values."""
    least = int(np.clip(np.argmin(values), 1, len(values) - 2))
    left, middle, right = values[least - 1 : least + 2]
    bend, step = left - 2 * middle + right, places[1] - places[0]
    shift = 0.5 * (left - right) / bend if bend > 0 else 0.0
    return float(places[least] + step * np.clip(shift, -1.0, 1.0))


def _jackknife(offsets: Array, losses: Array) -> float:
    """Return the standard deviation of the best offset [s] by losses, shape [offset, frame]."""
    parts = np.arange(losses.shape[1]) // _RUN_LENGTH % _PART_COUNT
    left_out = [
        _parabola_minimum(offsets, losses[:, parts != part].sum(axis=1))
        for part in range(_PART_COUNT)
    ]
    return float(np.sqrt((_PART_COUNT - 1) * np.var(left_out)))


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
