"""Takes of a motion-capture system, as OptiTrack Motive and Vicon export them, in our frame."""

import csv
import dataclasses
import itertools
import pathlib

import numpy as np

from cablecast.camera.tags import rigid_fit
from cablecast.conventions import Array
from cablecast.errors import InputError
from cablecast.files import JSON_SIZE_MAX, cells_of, read_numbers, read_text
from cablecast.workspace import Workspace

_UNITS = {"meters": 1.0, "m": 1.0, "centimeters": 0.01, "cm": 0.01, "millimeters": 1e-3, "mm": 1e-3}
_SECTIONS = ("Trajectories", "Segments", "Objects")
_SOLVED = ("Rigid Body Marker", "Bone Marker")
"""Types of Motive that are no measurement, but where a body that was fitted has its markers."""
_MISFIT_MAX = 0.005
"""Largest distance between a measured point and where the fit puts it [m]."""
_SPREAD_MIN = 0.2
"""Smallest extent of the measured points across their longest line [m]."""
_ENDINGS = (".csv", ".txt", ".tsv")
"""Endings of the files of a folder that are takes."""
_MOVED, _LEAD = 0.003, 0.05
"""Way of the grip by which a motion has started [m], and time before it that is kept [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MocapFrame:
    """Rotation, shape [3, 3], and origin [m] of a system's frame in ours."""

    rotation: Array
    origin: Array

    @classmethod
    def load(cls, path: pathlib.Path) -> "MocapFrame":
        """Fit the frame to three measured points or more.

        Args:
            path: CSV file with a row for each point: x_m, y_m, z_m in our frame, and mocap_x_m,
                mocap_y_m, mocap_z_m as the system measures it.
        """
        columns = ("x_m", "y_m", "z_m", "mocap_x_m", "mocap_y_m", "mocap_z_m")
        places, points = np.split(np.array(read_numbers(path, columns, 3)), 2, axis=1)
        across = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)[1]
        if across < _SPREAD_MIN / 2:
            raise InputError(f"the points of {path} lie in a line: measure some beside it")
        R, t = rigid_fit(points, places)
        misfit = np.linalg.norm(points @ R.T + t - places, axis=1)
        if misfit.max() > _MISFIT_MAX:
            raise InputError(
                f"point {int(misfit.argmax()) + 1} of {path} misses the rigid fit by "
                f"{1e3 * misfit.max():.1f} mm, above {1e3 * _MISFIT_MAX:g} mm: are all in metres, "
                "and is none mixed up?"
            )
        return cls(rotation=R, origin=t)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Take:
    """A recording of a motion-capture system.

    Attributes:
        path: File that it was read from.
        times: Times of the frames [s], shape [frame].
        points: Places of markers, and of the origins of rigid bodies, by their names, NaN where
            not seen [m], shape [frame, 3].
    """

    path: pathlib.Path
    times: Array
    points: dict[str, Array]

    @classmethod
    def load(cls, path: pathlib.Path, frame: MocapFrame) -> "Take":
        """Read a take as Motive (CSV) or Vicon (Nexus, Tracker; CSV or ASCII) exports it."""
        try:
            rows = cells_of(read_text(path, JSON_SIZE_MAX))
        except FileNotFoundError as error:
            raise InputError(str(error)) from None
        except csv.Error as error:
            raise InputError(f"{path} is no CSV file: {error}") from None
        rows = [[cell.strip() for cell in row] for row in rows]
        while rows and not any(rows[-1]):
            rows.pop()
        if rows and rows[0] and rows[0][0] == "Format Version":
            times, points = _motive(path, rows)
        elif any(row and row[0] in _SECTIONS for row in rows):
            times, points = _vicon(path, rows)
        else:
            raise InputError(
                f"{path} is no take of Motive (first cell `Format Version`) or Vicon (a section "
                f"{', '.join(_SECTIONS)})"
            )
        if not points or len(times) < 2 or not np.all(np.diff(times) > 0):
            raise InputError(f"{path} holds no positions at ascending times")
        moved = {name: p @ frame.rotation.T + frame.origin for name, p in points.items()}
        return cls(path=path, times=times, points=moved)

    def point(self, name: str) -> Array:
        """Return a marker or body by its name, with or without that of its subject, [frame, 3].

        Raises:
            InputError: There is none, or more than one; names those that there are.
        """
        found = [n for n in self.points if name in (n, n.rpartition(":")[2])]
        if name in self.points or len(found) == 1:
            return self.points[name if name in self.points else found[0]]
        names = ", ".join([n for n in found or self.points if n][:12])
        what = (
            f"{len(found)} points {name[:40]!r}: name one of"
            if found
            else f"no point {name[:40]!r}, of"
        )
        raise InputError(f"{self.path} has {what} {names}")


def take_files(folder: pathlib.Path) -> list[pathlib.Path]:
    """Return the files of a folder that are takes, in the order of their names."""
    return sorted(file for file in folder.iterdir() if file.suffix.lower() in _ENDINGS)


@dataclasses.dataclass(frozen=True, kw_only=True)
class MocapNames:
    """Names of the points that make a cast.

    Attributes:
        frame: CSV file of the measured points; see `MocapFrame.load`.
        end: Marker or body at the cable's free end.
        grip: Marker or body on the gripper, above where it holds the cable; and a second one, ahead
            of it, whose direction from the first gives the gripper's turn.
    """

    frame: pathlib.Path
    end: str
    grip: tuple[str, ...]

    def table(self, path: pathlib.Path, workspace: Workspace) -> tuple[list[str], dict[str, Array]]:
        """Return casts as `read_recordings` reads them, one for each take, a file or a folder.

        The grip's height and turn count from the first frame, in which the gripper is at the reset.
        """
        if not 1 <= len(self.grip) <= 2:
            raise InputError(f"the grip has one point or two, not {len(self.grip)}")
        files = take_files(path) if path.is_dir() else [path]
        frame, names, parts = MocapFrame.load(self.frame), [], []
        for file in files:
            take = Take.load(file, frame)
            end, grip = take.point(self.end), take.point(self.grip[0])
            seen = np.flatnonzero(np.isfinite(grip[:, 0]))
            if not len(seen):
                raise InputError(f"{file}: {self.grip[0]!r} was never seen")
            way = np.linalg.norm(grip - grip[seen[0]], axis=1)
            if not np.any(way > _MOVED):
                raise InputError(f"{file}: {self.grip[0]!r} does not move")
            times = take.times - (take.times[np.argmax(way > _MOVED)] - _LEAD)
            turn = np.zeros(len(times))
            if len(self.grip) == 2:
                x, y = (take.point(self.grip[1]) - grip)[:, :2].T
                known = np.isfinite(x)
                turn = np.where(known, 0.0, np.nan)
                turn[known] = np.unwrap(np.arctan2(x[known], y[known]))
                turn -= turn[known][0] if known.any() else 0.0
            height = workspace.grip_height + grip[:, 2] - grip[seen[0], 2]
            columns = [times, end[:, 0], end[:, 1], grip[:, 0], grip[:, 1], height, turn]
            parts.append(np.column_stack(columns)[times >= 0])
            names += [file.stem] * len(parts[-1])
        keys = ("time_s", "x_m", "y_m", "grip_x_m", "grip_y_m", "grip_z_m", "grip_yaw_rad")
        table = np.concatenate(parts) if parts else np.empty((0, len(keys)))
        return names, dict(zip(keys, table.T, strict=True))


def _motive(path: pathlib.Path, rows: list[list[str]]) -> tuple[Array, dict[str, Array]]:
    """Return times and points of a take of Motive, whose header has four to six rows."""
    # Notes of the take may hold commas, and so shift the cells behind them.
    units = [unit for name, unit in itertools.pairwise(rows[0]) if name == "Length Units"]
    if not units:
        raise InputError(f"{path} does not say its Length Units in line 1: export with the header")
    first = next((i for i, row in enumerate(rows) if i and row and _number(row[0]) is not None), 0)
    head = [row for row in rows[1:first] if any(row)]
    if len(head) < 4:
        raise InputError(f"{path} lacks the rows of names over its columns: export them, too")
    kinds, axes, parts = head[0], head[-1], head[-2]
    names = next((row for row in head if "Name" in row[:2]), head[1])
    columns: dict[str, dict[str, int]] = {}
    taken: set[tuple[str, str, bool]] = set()
    for solved in (False, True):
        for i in range(2, min(map(len, (kinds, names, parts, axes)))):
            if parts[i] == "Position" and (kinds[i] in _SOLVED) == solved:
                name = names[i].strip('"')
                if (name, axes[i], solved) in taken:
                    raise InputError(f"{path} has two points {name[:40]!r}: rename one of them")
                taken.add((name, axes[i], solved))
                columns.setdefault(name, {}).setdefault(axes[i], i)
    return _columns(path, rows[first:], first, 1, columns, units[0])


def _vicon(path: pathlib.Path, rows: list[list[str]]) -> tuple[Array, dict[str, Array]]:
    """Return times and points of the sections of a take of Vicon that hold places."""
    times, points = np.empty(0), {}
    for start in (i for i, row in enumerate(rows) if row and row[0] in _SECTIONS):
        if len(rows) < start + 5 or not (rate := _number((rows[start + 1] or [""])[0])):
            raise InputError(f"{path}: section {rows[start][0]} lacks its rate, names or units")
        names, axes, units = rows[start + 2 : start + 5]
        body = list(itertools.takewhile(any, rows[start + 5 :]))
        if not body:
            continue
        columns, name, unit = {}, "", "mm"
        for i, axis in enumerate(axes[2:], start=2):
            name = names[i] if i < len(names) and names[i] else name
            if axis.removeprefix("T") in columns.setdefault(name, {}):
                raise InputError(f"{path} has two points {name[:40]!r}: rename one of them")
            columns[name][axis.removeprefix("T")] = i
            if axis.removeprefix("T") in ("X", "Y", "Z") and i < len(units):
                unit = units[i]
        frames, found = _columns(path, body, start + 5, 0, columns, unit)
        if len(times) and len(frames) != len(times):
            raise InputError(f"{path}: its sections differ in their number of frames")
        times, points = (frames - frames[0]) / rate, points | found
    return times, points


def _columns(
    path: pathlib.Path,
    rows: list[list[str]],
    first: int,
    clock: int,
    columns: dict[str, dict[str, int]],
    unit: str,
) -> tuple[Array, dict[str, Array]]:
    """Return a column of times and the points whose columns X, Y and Z there are [m]."""
    if unit.lower() not in _UNITS:
        raise InputError(f"{path}: length unit {unit[:20]!r} must be metres, centimetres or mm")

    def column(index: int) -> Array:
        """Return a column of numbers, NaN where a cell is empty."""
        cells = [row[index] if index < len(row) else "" for row in rows]
        for line, cell in enumerate(cells, start=first + 1):
            if cell and _number(cell) is None:
                raise InputError(f"line {line} of {path}: {cell[:40]!r} is not a number")
        return np.array([float(cell or "nan") for cell in cells])

    scale, whole = _UNITS[unit.lower()], {n: at for n, at in columns.items() if {*"XYZ"} <= {*at}}
    return column(clock), {
        name: scale * np.stack([column(at[axis]) for axis in "XYZ"], axis=-1)
        for name, at in whole.items()
    }


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
