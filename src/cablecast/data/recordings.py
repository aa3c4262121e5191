"""Casts that others recorded: a table of samples, one cast after the other.

A row is one moment of one cast. It may hold the endpoint, the joints, the grip, or some of them:
cells are empty where something was not measured at that time.
"""

import bisect
import hashlib
import pathlib
import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import Arm
from cablecast.cable import Cable
from cablecast.cast import Cast, EndpointTrack, TrialStatus
from cablecast.conventions import Array
from cablecast.data.mocap import MocapNames, take_files
from cablecast.errors import COUNT_MAX, InputError
from cablecast.files import read_bytes, read_csv
from cablecast.motion.casting import Action
from cablecast.motion.trajectory import JointPath
from cablecast.rigs.checked import JOINT_ANGLE_MAX
from cablecast.setup import Setup
from cablecast.workspace import Workspace

CAST_COLUMN, TIME_COLUMN = "cast", "time_s"
TRACK_COLUMNS = ("x_m", "y_m")
_JOINT = re.compile(r"q\d+_rad")
GRIP_COLUMNS = ("grip_x_m", "grip_y_m")
YAW_COLUMN = "grip_yaw_rad"
GRIP_OPTIONS = ("grip_z_m", YAW_COLUMN)
ACTION_COLUMNS = ("theta1_rad", "theta2_rad", "r2_m", "psi_rad")
PACE_COLUMN = "pace"
_LIKE_OURS = ("grip_", "theta1", "theta2", "r2", "psi", "pace")
"""Beginnings of names that only a slip keeps from being known columns."""

TABLE_SIZE_MAX = 2**31

# An endpoint that moves by more than this in the last moments has not come to rest [m], [s].
_REST_DISTANCE = 0.01
_REST_TIME = 0.2
_SAMPLES_MIN = 4
# No clock of a cast counts further [s], and nothing of it is farther away [m].
_TIME_MAX, _DISTANCE_MAX = 1e10, 100.0
# A joint that leaves its neighbours in time by more is a spike [rad]: in 34 ms one turns 0.1 rad.
_SPIKE = 0.3
# Joints and grip may move unseen for as long [s]: logs have steps of up to 34 ms.
_GAP_MAX = 0.25
# Joints that differ by less have not moved [rad], nor has a grip [m].
_STILL = 0.01
_UNSOUND_MAX = 0.2
# The time between two rows of a cast is no more, and its first row no later [s].
_STEP_MAX, _START_MAX = 10.0, 10.0
# Rows of a cast are no farther apart in the median [s].
_STEP_MEDIAN_MAX = 2.0
# Units that are mistaken for those of our columns, and how many of them are one of ours.
_MISTAKEN = {"rad": ("degrees", 57.3), "m": ("mm", 1e3), "s": ("ns", 1e9)}
# Nothing turns a grip faster [rad/s], measured over a time [s], nor farther [rad].
_YAW_RATE_MAX, _YAW_TIME, _YAW_MAX = 20.0, 0.1, 4.0 * np.pi
_EMPTY = ("", "na", "n/a", "#n/a", "null", "none", "-")
# Cables stretch, and markers are seen a little off [m].
_REACH_SLACK = 0.05


class Recording(NamedTuple):
    """One recorded cast, by its name in the table; the reported joints are those of its track."""

    name: str
    cast: Cast


def read_recordings(
    path: str | pathlib.Path,
    setup: Setup,
    report: Callable[[str], None] = lambda line: None,
    mocap: MocapNames | None = None,
) -> list[Recording]:
    """Read a table of recorded casts.

    Logs are taken as they are: of rows with the same time the first one counts, filled up by the
    others; rows with an absurd value, and those by which time runs back, are left out. A cast of
    which more than a fifth is left out, or whose joints moved unseen, is left out whole.

    Args:
        path: CSV or Parquet file with the columns `cast`, `time_s`, `x_m` and `y_m`, and with the
            joints (`q1_rad`, `q2_rad`, ...), the grip (`grip_x_m`, `grip_y_m`, and where they are
            known `grip_z_m`, `grip_yaw_rad`) or the action (`theta1_rad`, `theta2_rad`, `r2_m`,
            `psi_rad`, and `pace`, 1 where it is not known).
        setup: Set-up of the casts; gives the table, and the height of a grip without one.
        report: Told in one line what of a cast is left out, and why.
        mocap: Names of the points, where the path is a take of Motive or Vicon, or a folder of
            them, one cast each.

    Returns:
        The casts in the order in which they first appear.

    Raises:
        InputError: There is no such file, a column is missing, a cell is no number, or no cast is
            sound.
    """
    path = pathlib.Path(path)
    if mocap is None:
        names, columns = _read_table(path, joint_columns(setup.arm), report)
    else:
        names, columns = mocap.table(path, setup.workspace)
    groups: dict[str, list[int]] = {}
    for row, name in enumerate(names):
        groups.setdefault(name, []).append(row)
    if not groups:
        raise InputError(f"{path} holds no casts")
    casts: list[Recording] = []
    lost: list[InputError] = []
    for name, rows in groups.items():
        cells = {c: values[rows] for c, values in columns.items()}
        where = f"{path}, cast {name[:40]!r}"
        try:
            sound = _sound(where, cells, np.array(rows) + 1, report, of_take=mocap is not None)
            casts.append(_recording(where, name, sound, setup))
        except InputError as error:
            lost.append(error)
    if not casts:
        more = f" ({len(lost) - 1} more casts cannot be used either)" if len(lost) > 1 else ""
        raise InputError(f"{lost[0]}{more}")
    for error in lost:
        report(f"{error}: the cast is left out")
    return casts


def _sound(
    where: str,
    columns: dict[str, Array],
    rows: NDArray[np.int64],
    report: Callable[[str], None],
    *,
    of_take: bool,
) -> dict[str, Array]:
    """Return the sound rows of a cast, and report the others by their numbers from 1.

    Those of a take, which is cut off where the motion begins, are reported by their times.
    """
    from scipy.ndimage import median_filter

    columns, rows = _interleaved(columns, rows)
    times = columns[TIME_COLUMN]
    why = [""] * len(times)
    for name, values in columns.items():
        bound = {TIME_COLUMN: _TIME_MAX}.get(name, _DISTANCE_MAX)
        bound = JOINT_ANGLE_MAX if _JOINT.fullmatch(name) else bound
        absurd = np.abs(values) > bound
        if name == TIME_COLUMN:
            absurd |= np.isnan(values)
        if _JOINT.fullmatch(name):
            known = np.flatnonzero(np.isfinite(values) & ~absurd)
            # The median of three is the nearest place between the neighbours.
            leaps = np.abs(values[known] - median_filter(values[known], 3))
            absurd[known] |= leaps > _SPIKE
        unit = name.rpartition("_")[2]
        other, count = _MISTAKEN.get(unit, ("", 0.0))
        for row in np.flatnonzero(absurd):
            is_other = bound < abs(values[row]) < count * bound
            hint = f", beyond {bound:g} {unit}: is it in {other}?" if is_other else ""
            why[row] = why[row] or f"{name} = {values[row]:g}{hint}"
    left = np.array([not words for words in why])
    steps = np.diff(np.unique(times[left]))
    if len(steps) and (step := float(np.median(steps))) > _STEP_MEDIAN_MAX:
        raise InputError(
            f"{where}: its rows are {step:g} s apart in the median, above {_STEP_MEDIAN_MAX:g} s: "
            f"is {TIME_COLUMN} in seconds?"
        )
    # Logs begin with rows of another time, or end with them: those about most others are the cast.
    order = np.flatnonzero(left)[np.argsort(times[left], kind="stable")]
    series = np.split(order, np.flatnonzero(np.diff(times[order]) > _STEP_MAX) + 1)
    longest = max(series, key=len)
    for row in np.setdiff1d(order, longest):
        why[row], left[row] = f"time {times[row]:g} s, far from the others", False
    far = len(order) - len(longest)
    if len(longest) and (start := float(times[longest[0]])) > _START_MAX:
        raise InputError(
            f"{where}: its times begin at {start:.10g} s, and time_s counts from the start of the "
            "motion: subtract the time at which it started"
        )
    rising = _ascending(times[left])
    latest = np.maximum.accumulate(np.where(rising, times[left], -np.inf))
    for row, before, is_sound in zip(np.flatnonzero(left), latest, rising, strict=True):
        if not is_sound:
            order = f"after {before:g} s" if np.isfinite(before) else "before those that rise"
            why[row] = f"time {times[row]:g} s {order}"
    out = np.array([bool(words) for words in why])
    if out.any():
        at = int(np.argmax(out))
        more = f" and {out.sum() - 1} more" if out.sum() > 1 else ""
        name = f"the frame {times[at]:.3f} s after the start" if of_take else f"row {rows[at]}"
        words = f"{where}: {name} ({why[at]}){more} of {len(out)} rows cannot be used"
        if (out.sum() - far) > _UNSOUND_MAX * len(out) or out.all():
            raise InputError(words)
        report(words)
    kept, places = np.unique(times[~out], return_inverse=True)
    if doubled := np.count_nonzero(~out) - len(kept):
        report(f"{where}: {doubled} rows repeat the time of the row before")
    found = {}
    for name, values in columns.items():
        found[name] = np.full(len(kept), np.nan)
        # The first row of a time is written last.
        known = np.flatnonzero(np.isfinite(values[~out]))[::-1]
        found[name][places[known]] = values[~out][known]
    return found


def _interleaved(
    columns: dict[str, Array], rows: NDArray[np.int64]
) -> tuple[dict[str, Array], NDArray[np.int64]]:
    """Return rows by their time where these are two logs, one after the other."""
    times = columns[TIME_COLUMN]
    kinds = np.array([np.isfinite(v) for name, v in columns.items() if name != TIME_COLUMN])
    kinds = np.unique(kinds, axis=1, return_inverse=True)[1].ravel()
    parts = [times[kinds == kind] for kind in np.unique(kinds)]
    # A log with cells that are empty now and then is no other log.
    if len(parts) != 2 or np.isnan(times).any() or np.all(np.diff(times) >= 0.0):
        return columns, rows
    if any(np.any(np.diff(part) < 0.0) for part in parts):
        return columns, rows
    order = np.argsort(times, kind="stable")
    return {name: values[order] for name, values in columns.items()}, rows[order]


def _ascending(times: Array) -> NDArray[np.bool_]:
    """Return which times are of the longest series that never falls."""
    ends: list[float] = []
    last: list[int] = []
    before = np.full(len(times), -1)
    for index, time in enumerate(times.tolist()):
        place = bisect.bisect_right(ends, time)
        before[index] = last[place - 1] if place else -1
        ends[place : place + 1], last[place : place + 1] = [time], [index]
    kept = np.zeros(len(times), dtype=bool)
    index = last[-1] if last else -1
    while index >= 0:
        kept[index] = True
        index = before[index]
    return kept


def joint_columns(arm: Arm) -> tuple[str, ...]:
    """Return the names of the columns of the joints: q1_rad, q2_rad and so on."""
    return tuple(f"q{joint}_rad" for joint in range(1, arm.joint_count + 1))


def file_digest(path: pathlib.Path) -> str:
    """Return the checksum of a file, or of the takes in a folder."""
    files = take_files(path) if path.is_dir() else [path]
    content = b"".join(read_bytes(file, TABLE_SIZE_MAX) for file in files)
    return hashlib.sha256(content).hexdigest()[:16]


def _read_table(
    path: pathlib.Path, joints: tuple[str, ...], report: Callable[[str], None]
) -> tuple[list[str], dict[str, Array]]:
    """Return the name of each row's cast, and the known columns; NaN where a cell is empty."""
    required = (CAST_COLUMN, TIME_COLUMN, *TRACK_COLUMNS)
    if path.suffix.lower() in (".parquet", ".pq"):
        table = _read_parquet(path, required)
    else:
        rows = read_csv(path, required, TABLE_SIZE_MAX)
        table = {name: [row[name] for row in rows] for name in (rows[0] if rows else required)}
    count = len(table[CAST_COLUMN])
    if count > COUNT_MAX:
        raise InputError(f"{path} has {count} rows, more than {COUNT_MAX}")
    known = (TIME_COLUMN, *TRACK_COLUMNS, *joints, *GRIP_COLUMNS, *GRIP_OPTIONS)
    known += (*ACTION_COLUMNS, PACE_COLUMN)
    if more := [name for name in table if _JOINT.fullmatch(name) and name not in joints]:
        raise InputError(
            f"{path} has the column {more[0]}, and the arm of the lab file {len(joints)} joints"
        )
    meant = [c for c in table if c.startswith(_LIKE_OURS) and c not in known]
    if meant:
        report(f"{path}: nothing is read of the columns {', '.join(meant)[:200]}")
    columns = {name: _numbers(path, name, table[name]) for name in known if name in table}
    for group in (joints, GRIP_COLUMNS, ACTION_COLUMNS):
        missing = [name for name in group if name not in columns]
        if missing and len(missing) < len(group):
            raise InputError(f"{path} has {group[0]} or its like, but lacks {', '.join(missing)}")
    return [str(value).strip() for value in table[CAST_COLUMN]], columns


def _read_parquet(path: pathlib.Path, required: tuple[str, ...]) -> dict[str, list[Any]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(pa.BufferReader(read_bytes(path, TABLE_SIZE_MAX)))
    except FileNotFoundError as error:
        raise InputError(str(error)) from None
    except (pa.ArrowException, OSError) as error:
        line = " ".join(str(error).split())[:200]
        raise InputError(f"{path} is no Parquet file that can be read: {line}") from None
    if missing := [name for name in required if name not in table.column_names]:
        raise InputError(f"{path} lacks the columns {', '.join(missing)}")
    return {name: table[name].to_pylist() for name in table.column_names}


def _numbers(path: pathlib.Path, name: str, cells: list[Any]) -> Array:
    """Return a column as numbers; NaN where a cell is empty."""
    values = np.full(len(cells), np.nan)
    for row, cell in enumerate(cells):
        if cell is None or (isinstance(cell, str) and cell.strip().lower() in _EMPTY):
            continue
        try:
            values[row] = float(cell)
        except (TypeError, ValueError):
            raise InputError(
                f"{path}: {name} = {str(cell)[:40]!r} in row {row + 1} is not a number"
            ) from None
    return values


def _recording(where: str, name: str, columns: dict[str, Array], setup: Setup) -> Recording:
    joints = joint_columns(setup.arm)
    times = columns[TIME_COLUMN]
    xy = np.stack([columns[column] for column in TRACK_COLUMNS], axis=-1)
    seen = np.all(np.isfinite(xy), axis=1)
    if seen.sum() < _SAMPLES_MIN:
        raise InputError(f"{where}: the endpoint was seen {seen.sum()} times, not {_SAMPLES_MIN}")
    # Rows of the joints alone, before the first and after the last look at the endpoint or between
    # them, are no samples of the track; a look that failed is a row without joints.
    motion = {
        group: np.all([np.isfinite(columns[c]) for c in group], axis=0)
        for group in (joints, GRIP_COLUMNS)
        if group[0] in columns
    }
    moved = np.any(list(motion.values()), axis=0) if motion else np.zeros(len(times), dtype=bool)
    looks = seen | ~moved
    # A tracker that lost the marker a moment before the end saw where it came to rest.
    last_seen = times[seen][-1]
    if times[looks][-1] <= last_seen + _REST_TIME:
        looks &= times <= last_seen
    joint_path = _joint_path(where, columns, joints, motion.get(joints))
    grip = _grip(where, columns, motion.get(GRIP_COLUMNS), setup.workspace)
    try:
        action = _action(columns)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    if joint_path is None and grip is None and action is None:
        raise InputError(f"{where}: there are neither joints, nor a grip, nor an action")
    path = grip or (joint_path and (joint_path.times, setup.arm.grip_pose(joint_path.q)))
    if path is not None:
        _check_reach(where, times[seen], xy[seen], *path, setup.cable)
    track = EndpointTrack(
        times=times[looks],
        endpoint_xy=np.where(seen[looks, None], xy[looks], np.nan),
        status=_status(times[looks], xy[looks], setup.workspace),
        joint_path=joint_path,
    )
    # The end of the motion, or of the track where no motion was recorded.
    moved_times = grip[0] if grip is not None else track.times
    moved_times = joint_path.times if joint_path is not None else moved_times
    cast = Cast(
        action=action,
        duration=float(moved_times[-1]),
        joint_path=None,
        track=track,
        purpose="tune",
        grip=grip,
    )
    return Recording(name, cast)


def _check_reach(
    where: str, times: Array, xy: Array, grip_times: Array, poses: Array, cable: Cable
) -> None:
    """Refuse an endpoint that is too far from the grip for the cable between them.

    Raises:
        InputError: It is, in more than a fifth of the looks.
    """
    grip = np.stack([np.interp(times, grip_times, poses[:, axis]) for axis in (0, 1)], axis=-1)
    far = np.linalg.norm(xy - grip, axis=1)
    length = cable.length + cable.attachment_length
    if np.mean(far > length + _REACH_SLACK) > _UNSOUND_MAX:
        raise InputError(
            f"{where}: the endpoint is up to {far.max():.2f} m from the grip, and the cable is "
            f"{length:.2f} m long: are both in metres and in one frame (docs/conventions.md), and "
            "is base_yaw_deg that of the arm?"
        )


def _joint_path(
    where: str,
    columns: dict[str, Array],
    names: tuple[str, ...],
    known: NDArray[np.bool_] | None,
) -> JointPath | None:
    """Return the joints of the rows in which they are known; None if there are none.

    Raises:
        InputError: They moved unseen for too long.
    """
    if known is None or not np.any(known):
        return None
    times, q = columns[TIME_COLUMN][known], np.stack([columns[n][known] for n in names], axis=-1)
    _check_gaps(f"{where}: the joints moved", times, q)
    qd = np.gradient(q, times, axis=0) if len(q) > 1 else np.zeros_like(q)
    return JointPath(times=times, q=q, qd=qd)


def _check_gaps(what: str, times: Array, values: Array) -> None:
    """Refuse a motion [rad or m], shape [tick, axis], that was not seen for too long.

    Raises:
        InputError: It was not.
    """
    moves = np.abs(np.diff(values, axis=0)).max(axis=1) > _STILL
    gaps = np.where(moves, np.diff(times), 0.0)
    if gaps.max(initial=0.0) > _GAP_MAX:
        at = int(np.argmax(gaps))
        raise InputError(
            f"{what} unseen for {gaps[at]:.2f} s from {times[at]:g} s on, more than {_GAP_MAX:g} s"
        )


def _grip(
    where: str, columns: dict[str, Array], known: NDArray[np.bool_] | None, workspace: Workspace
) -> tuple[Array, Array] | None:
    """Return times and poses of the grip; a height or yaw without a sample is that of the reset.

    Raises:
        InputError: It moved unseen for too long.
    """
    if known is None or not np.any(known):
        return None
    times = columns[TIME_COLUMN][known]
    poses = np.zeros((len(times), 5))
    poses[:, 2] = workspace.grip_height
    for column, name in enumerate((*GRIP_COLUMNS, *GRIP_OPTIONS)):
        values = columns[name][known] if name in columns else np.empty(0)
        seen = np.isfinite(values)
        if not np.any(seen):
            continue
        at, values = times[seen], values[seen]
        if name == YAW_COLUMN:
            farthest, values = np.abs(values).max(), np.unwrap(values)
            grid = np.arange(at[0], at[-1] + _YAW_TIME, _YAW_TIME)
            rates = np.abs(np.diff(np.interp(grid, at, values))) / _YAW_TIME
            if farthest > _YAW_MAX or rates.max(initial=0.0) > _YAW_RATE_MAX:
                raise InputError(
                    f"{where}: {YAW_COLUMN} goes to {farthest:.1f}, at up to "
                    f"{rates.max(initial=0.0):.1f} rad/s, and a grip at most to {_YAW_MAX:.1f} rad "
                    f"at {_YAW_RATE_MAX:g} rad/s: is it in degrees?"
                )
        _check_gaps(f"{where}: the grip moved", at, values[:, None])
        # Yaw and height may have a rate of their own.
        poses[:, column] = np.interp(times, at, values)
    return times, poses


def _action(columns: dict[str, Array]) -> Action | None:
    """Return the first action that is stated; None without one."""
    if ACTION_COLUMNS[0] not in columns:
        return None
    stated = [columns[column] for column in ACTION_COLUMNS]
    pace = columns.get(PACE_COLUMN, np.ones(len(stated[0])))
    stated = np.stack([*stated, np.nan_to_num(pace, nan=1.0)], axis=-1)
    stated = stated[np.all(np.isfinite(stated), axis=1)]
    return Action.from_array(stated[0]) if len(stated) else None


def _status(times: Array, xy: Array, workspace: Workspace) -> TrialStatus:
    """Return how a cast ended: off the table, at rest in sight, or unknown."""
    seen = np.all(np.isfinite(xy), axis=1)
    if not workspace.on_table(xy[seen][-1]):
        return TrialStatus.OFF_TABLE
    late = seen & (times >= times[-1] - _REST_TIME)
    # Of fewer looks, with the one before: a single place never moves.
    late[np.flatnonzero(seen & (times <= times[-1] - _REST_TIME + 1e-9))[-1:]] = True
    if not seen[-1] or np.ptp(xy[late], axis=0).max() > _REST_DISTANCE:
        return TrialStatus.OCCLUDED
    return TrialStatus.OK
