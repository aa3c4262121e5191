"""CheckedRig: any rig behind checks of its answers, a time limit, and errors of one line.

A rig may be foreign code, and a wrong unit or frame looks like data. Each check refuses what no
real trial can give, and names the value and the bound.
"""

import inspect
import json
import math
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from types import FrameType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import Arm, limit_violations
from cablecast.camera.settings import CameraSight
from cablecast.cast import ControllerLog, EndpointTrack, TrialStatus
from cablecast.errors import (
    CablecastError,
    RigError,
    StoppedError,
    check_count,
    check_number,
)
from cablecast.motion.measured import SAMPLES_MIN
from cablecast.motion.trajectory import JointPath, Trajectory, joints_at
from cablecast.rigs.base import Rig, RigLifecycle, error_line, foreign_code, purpose_seed
from cablecast.setup import Setup

TIME_LIMIT = 120.0
"""Longest time of one reset or one trial [s]; both take some 20 s on a robot."""
ATTEMPT_COUNT = 3
"""Number of attempts at a trial before it is given up."""
RETRY_STRIDE = 1_000_000
"""What the index of a trial grows by with each further attempt."""
DESCRIPTION_SIZE_MAX = 100_000
"""Longest description of a rig, as JSON [character]."""
SAMPLE_COUNT_MAX = 100_000
"""Most samples of a track, and most reports of its joints: minutes at 500 Hz."""
END_TIME_MAX = 120.0
"""Longest time from the end of a motion to the last sample [s]."""
REACH_MARGIN = 0.5
"""Largest distance of a seen endpoint beyond the reach of arm and cable [m]: a raised endpoint
seems to lie farther out to a camera."""
EDGE_MARGIN = 0.05
"""Largest distance beyond the table's edge of an endpoint that came to rest on it [m]."""
SPEED_MIN_BOUND = 60.0
"""An endpoint may always be this fast [m/s]: the tip of a light rope that cracks in the air was
seen at 40 in the strike laboratory."""
SPEED_RATIO_MAX = 10.0
"""Largest speed of the endpoint as a multiple of the gripper's."""
JUMP_MAX = 0.1
"""Largest error by which an endpoint may seem to jump from sample to sample [m]."""
JOINT_ANGLE_MAX = 4 * np.pi
"""Largest joint angle [rad], twice what a UR arm can turn."""
JOINT_LAG_MAX = 0.3
"""Longest time by which joints trail their set points [s]."""
JOINT_OFFSET_MAX = 0.5
"""Largest distance of joints from their set points besides that lag [rad]."""

_DEPTH_MAX = 20
_CLOCK_TOLERANCE = 1e-3
_REPORT_LEAD_MAX = 10.0
"""An arm may report its joints from this long before the motion on [s]."""
_NEAR_DISTANCE = 0.3
"""Few endpoints lie nearer to the base than this [m]: tells millimetres from centimetres."""

_HEIGHT_MAX = 10.0
"""Largest height of a tip above or below the base frame [m]."""

_METHODS = ("reset", "execute", "close")

Answer = TypeVar("Answer")


class CheckedRig(RigLifecycle):
    """A rig whose every answer is checked; `make_rig` returns one.

    Its `seek`, `execute_many`, `picture` and `sight` are None if the rig itself has no such method.
    Whatever the rig raises comes out as a CablecastError, but for KeyboardInterrupt. As a context
    manager it closes the rig at the end, and an error in closing never hides an earlier one.

    Args:
        rig: Any object that answers the `Rig` contract.
        setup: Set-up that the rig was made for; answers are checked against it.
        time_limit: Longest time of one reset or one trial [s]; None for no limit. It holds in the
            main thread of systems with interval timers.

    Attributes:
        watch: Called with each motion before it is played, and again with its track.

    Raises:
        RigError: The object is no rig, or its description is no plain dictionary.
        InputError: The time limit is out of bounds.
    """

    def __init__(self, rig: Rig, setup: Setup, *, time_limit: float | None = TIME_LIMIT):
        super().__init__()
        if missing := missing_parts(rig):
            raise RigError(f"a {type(rig).__name__} is no rig: it lacks {', '.join(missing)}")
        if time_limit is not None:
            time_limit = check_number("time_limit", time_limit, 0.01, 1e6, "s")
        self.rig: Any = rig
        self.setup = setup
        self.time_limit = time_limit
        self.watch: Callable[[Trajectory, EndpointTrack | None], None] = lambda motion, track: None
        self.description: dict[str, Any] = check_description(
            self._call("description", lambda: rig.description)
        )
        self.seek = self._seek if has_method(rig, "seek") else None
        self.execute_many = self._execute_many if has_method(rig, "execute_many") else None
        self.picture = self._picture if has_method(rig, "picture") else None
        self.sight = self._sight if has_method(rig, "sight") else None
        # Otherwise the trials of all purposes would be scattered alike.
        if self.seek is not None and not takes(self.rig.seek, 0, "tune"):
            raise RigError(
                "the rig's seek must take an index and a purpose, seek(index, purpose=''), and "
                "draw differently for each purpose"
            )

    def reset(self) -> None:
        """Bring cable and arm to the reset state."""
        self._check_open()
        self._is_reset = False
        self._call("reset", self.rig.reset)
        self._is_reset = True

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        """Play one motion from the reset state, and report where the endpoint went.

        Raises:
            RigError: There was no reset since the last motion, the rig failed or took too long, or
                its answer is impossible.
        """
        self._use_reset()
        self.watch(trajectory, None)
        track = self._call("execute", lambda: self.rig.execute(trajectory))
        return self._checked(track, trajectory)

    def close(self) -> None:
        """Release the rig's resources; may be called twice.

        Where another error is on its way, an error in closing is added to it as a note.
        """
        if self._closed:
            return
        super().close()
        earlier = sys.exc_info()[1]
        try:
            self._call("close", self.rig.close)
        except CablecastError as error:
            if earlier is None:
                raise
            earlier.add_note(f"closing the rig failed as well: {error}")

    def _execute_many(
        self,
        trajectories: Sequence[Trajectory],
        progress: Callable[[int], None] | None = None,
    ) -> list[EndpointTrack]:
        """Reset and execute for each trajectory, and check every answer."""
        self._check_open()
        self._is_reset = False
        for trajectory in trajectories:
            self.watch(trajectory, None)
        tracks = self._call(
            "execute_many",
            lambda: list(self.rig.execute_many(trajectories, progress)),
            count=len(trajectories),
        )
        if len(tracks) != len(trajectories):
            raise RigError(
                f"the rig's execute_many returned {len(tracks)} tracks for {len(trajectories)} "
                "motions"
            )
        return [
            self._checked(track, trajectory)
            for track, trajectory in zip(tracks, trajectories, strict=True)
        ]

    def _checked(self, track: EndpointTrack, trajectory: Trajectory) -> EndpointTrack:
        checked = check_track(track, trajectory, self.setup)
        self.watch(trajectory, checked)
        return checked

    def _seek(self, index: int, purpose: str = "") -> None:
        """Let the next trial be the index-th of a purpose."""
        self._check_open()
        index = check_count("trial index", index, 0)
        # Refuses what is no purpose.
        purpose_seed(0, purpose)
        self._call("seek", lambda: self.rig.seek(index, purpose))

    def _picture(self) -> NDArray[np.uint8] | None:
        """Return the latest picture of the rig's camera; None where there is none yet."""
        self._check_open()
        return check_picture(self._call("picture", lambda: self.rig.picture()))

    def _sight(self) -> CameraSight | None:
        """Return what the rig's camera cannot see; None where the rig does not know."""
        self._check_open()
        sight = self._call("sight", lambda: self.rig.sight())
        if sight is None or isinstance(sight, CameraSight):
            return sight
        found = type(sight).__name__
        raise RigError(f"the rig's sight is a {found}: it must be a CameraSight, or None")

    def _call(self, name: str, call: Callable[[], Answer], count: int = 1) -> Answer:
        """Return what a method of the rig returns, within the time of some trials."""
        limit = None if self.time_limit is None else self.time_limit * max(count, 1)
        with foreign_code(f"the rig's {name} failed"):
            return call_within(limit, f"the rig's {name}", call)


def has_method(rig: object, name: str) -> bool:
    """Return whether a rig has a method of a name."""
    return callable(getattr(rig, name, None))


def missing_parts(rig: object) -> list[str]:
    """Return the names of what an object lacks to be a rig."""
    if isinstance(rig, type):
        return [*_METHODS, "description"]
    missing = [name for name in _METHODS if not has_method(rig, name)]
    # Not read here: a description may be computed, and fail.
    if not hasattr(type(rig), "description") and not hasattr(rig, "description"):
        missing.append("description")
    return missing


def takes(function: Callable[..., Any], *values: object) -> bool:
    """Return whether a function can be called with some values; True where it does not say."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return True
    try:
        signature.bind(*values)
    except TypeError:
        return False
    return True


class TrialFailedError(RigError):
    """A trial failed for good; the message begins with `failed`."""


def seek_trial(rig: Rig, index: int, purpose: str) -> None:
    """Let the next trial of a rig that draws by chance be the index-th of a purpose."""
    seek = getattr(rig, "seek", None)
    if callable(seek):
        seek(index, purpose)


def attempt_trial(
    rig: Rig, motion: Trajectory, *, index: int, purpose: str, count: int = ATTEMPT_COUNT
) -> tuple[EndpointTrack, int]:
    """Reset a rig and play one motion, again and again until it succeeds.

    Args:
        rig: Rig to play it on.
        motion: Motion to play.
        index: Number of the trial, which a rig that draws by chance draws from.
        purpose: Purpose of the trial, one of `PURPOSES` or none.
        count: Number of attempts.

    Returns:
        The track, and the number of failures before it.

    Raises:
        TrialFailedError: All attempts failed, or a person stopped one.
    """
    reason = ""
    for failures in range(count):
        try:
            # Drawn anew: with the same luck, a trial that failed by chance would fail again.
            seek_trial(rig, index + failures * RETRY_STRIDE, purpose)
            rig.reset()
            track = rig.execute(motion)
            if track.status is not TrialStatus.ABORTED:
                return track, failures
            reason = " ".join(track.note.split()) or "the rig reported it as aborted"
        except StoppedError as error:
            raise TrialFailedError(f"failed because: {error}") from error
        # A rig is foreign code: whatever it raises, the trial has failed.
        except Exception as error:
            reason = str(error) if isinstance(error, RigError) else error_line(error)
    raise TrialFailedError(f"failed {count} times, the last time because: {reason}")


def check_picture(picture: object) -> NDArray[np.uint8] | None:
    """Return a picture of a rig's camera, BGR, shape [v, u, 3]; None where there is none yet.

    Raises:
        RigError: It is no such picture.
    """
    if picture is None:
        return None
    found = type(picture).__name__
    if isinstance(picture, np.ndarray):
        shape = picture.shape
        if picture.dtype == np.uint8 and len(shape) == 3 and shape[2] == 3 and picture.size:
            return picture
        found = f"an array of {picture.dtype} and shape {shape}"
    raise RigError(f"the rig's picture is {found}: it must be uint8 of shape [v, u, 3], or None")


def check_description(description: object) -> dict[str, Any]:
    """Return a rig's description as plain values of its own.

    Raises:
        RigError: It is no dictionary of text, numbers, lists and dictionaries, holds a number that
            is not finite, or is too large.
    """
    if not isinstance(description, Mapping):
        raise RigError(
            f"the rig's description is a {type(description).__name__}: it must be a dictionary"
        )
    plain = _plain(description, "description", 0)
    size = len(json.dumps(plain))
    if size > DESCRIPTION_SIZE_MAX:
        raise RigError(
            f"the rig's description has {size} characters: it must have at most "
            f"{DESCRIPTION_SIZE_MAX}"
        )
    return plain


def _plain(value: Any, place: str, depth: int) -> Any:
    """Return a copy made of dictionaries, lists, text, numbers, truth values and None."""
    if depth > _DEPTH_MAX:
        raise RigError(f"the rig's {place[:60]} is nested deeper than {_DEPTH_MAX} levels")
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise RigError(f"the rig's {place} has the key {str(key)[:40]!r}, which is no text")
        return {str(k): _plain(v, f"{place}[{k[:40]!r}]", depth + 1) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v, f"{place}[{i}]", depth + 1) for i, v in enumerate(value)]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, str):
        try:
            value.encode()
        except UnicodeEncodeError:
            raise RigError(f"the rig's {place} is text that cannot be written in UTF-8") from None
    elif isinstance(value, float):
        if not math.isfinite(value):
            raise RigError(f"the rig's {place} = {value} is not finite")
    elif isinstance(value, int):
        if abs(value) >= 2**63:
            raise RigError(f"the rig's {place} is a number of more than 63 bits")
    elif value is not None:
        raise RigError(
            f"the rig's {place} is a {type(value).__name__}: it must be text, a number, a list or "
            "a dictionary"
        )
    return value


def check_track(track: object, trajectory: Trajectory, setup: Setup) -> EndpointTrack:
    """Return what a rig answered to a motion, if a real trial can have given it.

    Args:
        track: Answer of the rig.
        trajectory: Motion that it was asked for.
        setup: Gives the reach of arm and cable, and the table.

    Raises:
        RigError: It is no track, or one that is impossible; names the value and the bound.
    """
    if not isinstance(track, EndpointTrack):
        kind = type(track).__name__
        raise RigError(f"the rig's execute returned {kind}: it must return an EndpointTrack")
    if not isinstance(track.status, TrialStatus):
        raise RigError(f"the rig's track has status {track.status!r:.60}: it must be a TrialStatus")
    end = trajectory.duration + END_TIME_MAX
    _check_times(track.times, "track", -_CLOCK_TOLERANCE, end)
    # A simulation that broke, or a trial that was stopped, has no place to check.
    if track.status not in (TrialStatus.NON_FINITE, TrialStatus.ABORTED):
        _check_places(track, trajectory, setup)
        if setup.strike is not None:
            _check_heights(track)
        else:
            _check_status(track, setup)
            _check_rest(track, trajectory)
    if track.joint_path is not None:
        if not isinstance(track.joint_path, JointPath):
            kind = type(track.joint_path).__name__
            raise RigError(f"the rig's track has a {kind} as joint_path: it must be a JointPath")
        # An arm that was stopped is not where it was commanded, and no row keeps its joints.
        if track.status is not TrialStatus.ABORTED:
            _check_joints(track.joint_path, trajectory, end, setup.arm)
    log = track.controller_log
    if log is not None and not isinstance(log, ControllerLog):
        raise RigError("the rig's track has a controller_log that is no ControllerLog")
    if log is not None and not (
        track.joint_path is not None and len(log.times) == len(track.joint_path.times)
    ):
        raise RigError(
            f"the rig's track has {len(log.times)} reports of a controller: there must be one for "
            "each time of its joint_path"
        )
    return track


def _check_times(times: NDArray[np.float64], what: str, low: float, high: float) -> None:
    """Refuse times that are not seconds since the motion began."""
    if times.size > SAMPLE_COUNT_MAX:
        raise RigError(
            f"the rig's {what} has {times.size} samples: it must have at most {SAMPLE_COUNT_MAX}"
        )
    if not np.all(np.isfinite(times)):
        raise RigError(f"the rig's {what} has a time that is not finite")
    falls = np.flatnonzero(np.diff(times) <= 0.0)
    if len(falls):
        before, after = times[falls[0]], times[falls[0] + 1]
        raise RigError(
            f"the times of the rig's {what} do not rise: {after:g} s follows {before:g} s"
        )
    first, last = float(times[0]), float(times[-1])
    if first < low or first > high:
        raise RigError(
            f"the rig's {what} begins at {first:g} s, outside [{low:g}, {high:g}]: its times must "
            "be seconds since the motion began"
        )
    if last > high:
        units = ((1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds"))
        unit = next((name for scale, name in units if last / scale <= high), "no seconds")
        raise RigError(
            f"the rig's {what} ends at {last:g} s: it must end within {END_TIME_MAX:g} s of its "
            f"motion, by {high:.4g} s; its times look like {unit}"
        )


def _check_places(track: EndpointTrack, trajectory: Trajectory, setup: Setup) -> None:
    """Refuse endpoints that are out of reach, or too fast."""
    xy = track.endpoint_xy
    if np.any(np.isinf(xy)):
        raise RigError("the rig's track has an infinite endpoint: what was not seen must be NaN")
    seen = np.flatnonzero(np.all(np.isfinite(xy), axis=1))
    distance = np.hypot(*xy[seen].T)
    reach = _reach(trajectory, setup) + REACH_MARGIN
    if len(seen) and np.max(distance) > reach:
        far = float(np.max(distance))
        middle = float(np.median(distance))
        unit = ""
        for scale, name in ((1e3, "millimetres"), (1e2, "centimetres")):
            if _NEAR_DISTANCE * scale <= middle <= reach * scale:
                unit = f"; it looks like {name}"
                break
        raise RigError(
            f"the rig's track has an endpoint {far:g} m from the base: arm and cable reach "
            f"{reach - REACH_MARGIN:.3g} m, so that it may be at most {reach:.3g} m{unit}"
        )
    step = np.hypot(*np.diff(xy[seen], axis=0).T)
    bound = max(SPEED_MIN_BOUND, SPEED_RATIO_MAX * setup.motion.v_max)
    apart = np.diff(track.times[seen])
    fast = np.flatnonzero(step > bound * apart + JUMP_MAX)
    if len(fast):
        at = fast[0]
        raise RigError(
            f"the endpoint of the rig's track moves {step[at]:.3g} m in {apart[at]:.3g} s, faster "
            f"than {bound:g} m/s: times must be seconds, and what was not seen NaN"
        )


def _reach(trajectory: Trajectory, setup: Setup) -> float:
    """Return the largest distance of the endpoint from the base [m]."""
    cable = setup.cable
    path = trajectory.grip_path
    times = np.linspace(path.knots[0, 0], path.duration[0], 100)
    grip = path.evaluate(times)[0, :, :2]
    # A motion that was not planned for this arm may go farther than the arm's r_max.
    r_max = max(setup.workspace.r_max, float(np.max(np.hypot(*grip.T))))
    return r_max + cable.length + cable.attachment_length


def _check_status(track: EndpointTrack, setup: Setup) -> None:
    """Refuse a status that contradicts the last sample."""
    last = track.endpoint_xy[-1]
    seen = bool(np.all(np.isfinite(last)))
    if track.status is TrialStatus.OCCLUDED and seen:
        raise RigError(
            f"the rig's track has status OCCLUDED, but ends at ({last[0]:.3f}, {last[1]:.3f}) m: "
            "its last sample must be NaN"
        )
    if track.status is not TrialStatus.OK:
        return
    if not seen:
        raise RigError(
            "the rig's track has status OK without a final endpoint: its last sample must be finite"
        )
    workspace = setup.workspace
    if workspace.edge_distance(last) < -EDGE_MARGIN:
        raise RigError(
            f"the rig's track has status OK, but ends at ({last[0]:.3f}, {last[1]:.3f}) m, off the "
            f"table: |x| <= {workspace.half_width:g} m and {workspace.y_min:g} <= y <= "
            f"{workspace.y_max:g} m"
        )


def _check_heights(track: EndpointTrack) -> None:
    """Refuse a swing in the air without heights of the tip, or with impossible ones."""
    if track.endpoint_z is None:
        if track.status is not TrialStatus.OK:
            return
        raise RigError("the rig's track of a swing has no endpoint_z, the height of the tip")
    if np.any(np.abs(track.endpoint_z) > _HEIGHT_MAX):
        high = float(np.nanmax(np.abs(track.endpoint_z)))
        raise RigError(
            f"the rig's track has a tip at a height of {high:g} m: at most {_HEIGHT_MAX:g} m, so "
            "that it looks like another unit"
        )


def _check_rest(track: EndpointTrack, trajectory: Trajectory) -> None:
    """Refuse a last sample at which the endpoint cannot lie at rest yet."""
    last, end = float(track.times[-1]), trajectory.duration
    if track.status is TrialStatus.OK and last < end - _CLOCK_TOLERANCE:
        raise RigError(
            f"the rig's track has status OK, but ends at {last:.3g} s, before its motion does at "
            f"{end:.3g} s: its last sample must be where the cable came to rest"
        )


def _check_joints(joints: JointPath, trajectory: Trajectory, end: float, arm: Arm) -> None:
    """Refuse reported joints that cannot be those of the motion."""
    if len(joints.times) == 0:
        raise RigError("the rig reports joints without any time: None stands for no report")
    _check_times(joints.times, "report of its joints", -_REPORT_LEAD_MAX, end)
    q = joints.q
    if q.shape[1] != arm.joint_count:
        raise RigError(f"the rig reports {q.shape[1]} joints: the arm has {arm.joint_count}")
    if not np.all(np.isfinite(q)):
        raise RigError("the rig reports a joint angle that is not finite")
    if not np.all(np.isfinite(joints.qd)):
        raise RigError("the rig reports a joint rate that is not finite")
    if peak := next(limit_violations([q], [JOINT_ANGLE_MAX]), None):
        raise RigError(
            f"the rig reports the {arm.joint_names[peak.joint]} joint at {abs(peak.value):.4g} "
            f"rad: at most {JOINT_ANGLE_MAX:.4g} rad; it looks like degrees"
        )
    command = trajectory.joint_path
    if command is None:
        return
    during = joints.times[joints.times >= 0.0]
    if len(during) < SAMPLES_MIN:
        raise RigError(
            f"the rig reports joints at {len(during)} times since the motion began: at least "
            f"{SAMPLES_MIN}, or None for no report"
        )
    off = _offsets(joints, command)
    tick, joint = np.unravel_index(int(np.argmax(off)), off.shape)
    if off[tick, joint] > JOINT_OFFSET_MAX:
        raise RigError(
            f"the rig reports the {arm.joint_names[joint]} joint at {q[tick, joint]:.4g} rad at "
            f"{joints.times[tick]:.3g} s, {off[tick, joint]:.3g} rad from where it was commanded: "
            f"at most {JOINT_OFFSET_MAX:g} rad"
        )
    first, last = float(joints.times[0]), float(joints.times[-1])
    if first > JOINT_LAG_MAX or last < trajectory.duration - JOINT_LAG_MAX:
        raise RigError(
            f"the rig reports joints from {first:.3g} to {last:.3g} s of a motion of "
            f"{trajectory.duration:.3g} s: they may lack its first and last {JOINT_LAG_MAX:g} s at "
            "most; None stands for no report"
        )


def _offsets(joints: JointPath, command: JointPath) -> NDArray[np.float64]:
    """Return the distance of reports from all set points of the last moments, [report, joint]."""
    lags = np.linspace(0.0, JOINT_LAG_MAX, 13)
    near = joints_at(command, joints.times[:, None] - lags)
    off = np.maximum(near.min(axis=1) - joints.q, joints.q - near.max(axis=1))
    return np.maximum(off, 0.0)


_GRACE_MIN, _GRACE_MAX = 0.5, 10.0
"""Shortest and longest time from one interruption to the next [s]: the code that was interrupted
may first stop an arm and close its connections."""
_LIMIT_MAX = 1e8
"""Timers take no longer ones [s]."""


class _TimeIsUp(BaseException):
    """Interrupts the call; no Exception, so that `except Exception` does not swallow it."""


def call_within(limit: float | None, what: str, call: Callable[[], Answer]) -> Answer:
    """Return what a call returns, unless it takes too long.

    A call that takes too long is interrupted where it stands, so that its own `finally` clauses
    run. One that goes on all the same is interrupted again and again. The limit holds in the main
    thread of a system with interval timers; elsewhere there is none. Code in another language is
    interrupted when it returns to Python.

    Args:
        limit: Longest time of the call [s]; None for no limit.
        what: Name of the call in the error.
        call: Function without arguments.

    Raises:
        RigError: The call took too long.
    """
    has_timers = hasattr(signal, "setitimer")
    if limit is None or not has_timers or threading.current_thread() is not threading.main_thread():
        return call()
    limit = min(limit, _LIMIT_MAX)
    armed, fired = True, False

    def interrupt(signum: int, frame: FrameType | None) -> None:
        nonlocal fired
        if armed:
            fired = True
            raise _TimeIsUp

    too_long = RigError(
        f"{what} took longer than its time limit of {limit:g} s; --time-limit (time_limit of "
        "make_rig) allows more"
    )
    grace = min(max(limit, _GRACE_MIN), _GRACE_MAX)
    start = time.monotonic()
    handler_before = signal.signal(signal.SIGALRM, interrupt)
    timer_before = signal.setitimer(signal.ITIMER_REAL, limit, grace)
    try:
        answer = call()
        armed = False
    except BaseException as error:
        armed = False
        # A clause of the interrupted code that failed in turn is no better answer.
        if fired and not isinstance(error, KeyboardInterrupt):
            raise too_long from (None if isinstance(error, _TimeIsUp) else error)
        raise
    finally:
        armed = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL if handler_before is None else handler_before)
        if timer_before[0] > 0.0:
            left = max(timer_before[0] - (time.monotonic() - start), 1e-3)
            signal.setitimer(signal.ITIMER_REAL, left, timer_before[1])
    if fired:
        raise too_long
    return answer
