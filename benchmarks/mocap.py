"""Motion capture of cables held at both ends: EngineWarp and published figures.

The data are those of DEFORM (arXiv 2406.05931): a cable with 12 or so markers, of which the first
two and the last two are held and moved, 5 s at 100 Hz. Parameters of the cable are fitted to the
training sequences; then the engine plays the held-out ones from their first frame to their last
with nothing but the motion of the held markers. The error is the data set's own: the mean absolute
difference of a coordinate over all markers and frames.

`--data` is a folder with NAME_train.npz and NAME_eval.npz for each cable: `positions`, an array
[sequence, frame, marker, 3] in metres with z up, and `rate_hz`. docs/engine.md says how to make
them.
"""

import dataclasses
import functools
import itertools
import pathlib
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.result import Table, code_key
from cablecast.cable import Cable, CableParams
from cablecast.conventions import Array, tangent
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath
from cablecast.runs.folder import Parts, fingerprint

LINEAR_DENSITY = 0.02
"""Mass per length [kg/m]: without contact only stiffness over mass matters."""
SMOOTH = 2e-3
"""Distance below which an error counts by its square [m]."""
ARC_FRAMES, ARC_POINTS = 10, 50
"""Frames between those whose curves are measured, and points of each piece of a curve."""
START_FRAMES = 5
"""First frames, from which the velocities at the start are taken."""
LENGTH_STEPS = 10
"""Steps of Newton's method towards equal segments."""
SMOOTHING = 3.0
"""Weight of the third differences of a shape relative to its distance from the markers."""
DRAWS = 6
"""Random draws for each further start of a fit."""
HELD = 2
"""Markers that are held at each end."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Fit a cable to motion capture, and play held-out sequences.

    Attributes:
        data: Folder with NAME_train.npz and NAME_eval.npz.
        segment_count: Number of segments.
        dt: Longest step [s].
        iterations: Largest number of steps of the fit from each start.
        starts: Number of starts of each fit; one that is not the first is the best of some draws.
        sets: Number of sets of numbers that are fitted, of `SETS`; all where None.
        out: Folder of the fits, in which the same command resumes.
    """

    data: pathlib.Path
    segment_count: int = 44
    dt: float = 5e-4
    iterations: int = 12
    starts: int = 3
    sets: int | None = None
    out: pathlib.Path = pathlib.Path("runs/benchmarks/mocap")


@dataclasses.dataclass(frozen=True)
class Unknown:
    """A number that is fitted.

    Attributes:
        name: Name for the table.
        start: Value to start from.
        low: Lower bound.
        high: Upper bound.
        logarithmic: True to fit its logarithm.
    """

    name: str
    start: float
    low: float
    high: float
    logarithmic: bool = True

    def value(self, x: float) -> float:
        """Return the number that a coordinate of the fit stands for."""
        raw = float(np.exp(x)) if self.logarithmic else x
        return float(np.clip(raw, self.low, self.high))

    def coordinate(self, value: float) -> float:
        """Return the coordinate of the fit that stands for a number."""
        return float(np.log(value)) if self.logarithmic else value

    @property
    def step(self) -> float:
        """Step of a finite difference."""
        return 0.05 if self.logarithmic else 1e-3


BEND = Unknown("bend_stiffness", 1e-3, 1e-6, 0.1)
TWIST = Unknown("twist_stiffness", 1e-4, 1e-7, 1.0)
AIR = Unknown("linear_damping", 0.1, 1e-3, 5.0)
TURN = Unknown("angular_damping", 150.0, 0.1, 200.0)
NEAR_OFFSET = Unknown("near_offset", 0.0, -0.03, 0.03, logarithmic=False)
FAR_OFFSET = Unknown("far_offset", 0.0, -0.03, 0.03, logarithmic=False)
LENGTH = Unknown("length_factor", 1.0, 0.97, 1.03, logarithmic=False)

DAMPING = Unknown("damping_time", 0.1, 1e-4, 0.5)

SETS: dict[str, tuple[Unknown, ...]] = {
    "bending, twist, air, material": (BEND, TWIST, AIR, DAMPING),
    "and grip offsets, length": (BEND, TWIST, AIR, DAMPING, NEAR_OFFSET, FAR_OFFSET, LENGTH),
    "angular damping in place of material": (BEND, TWIST, AIR, TURN),
}
"""Numbers that are fitted, by the name of the row."""

PUBLISHED = {"dlo2": 0.97}
"""Error of the authors' learned model of a cable on their held-out sequences, of which the data set
has more than the files here [cm] (arXiv 2406.05931)."""


class Sequences:
    """Sequences of one cable.

    Args:
        path: File with `positions` [m], shape [sequence, frame, marker, 3], and `rate_hz`.
    """

    def __init__(self, path: pathlib.Path):
        with np.load(path, allow_pickle=False) as data:
            positions = np.asarray(data["positions"], dtype=float)
            rate = float(data["rate_hz"])
        if positions.ndim != 4 or positions.shape[-1] != 3 or positions.shape[2] < 2 * HELD + 1:
            raise InputError(
                f"{path} has positions of shape {positions.shape}: [sequence, frame, marker, 3]"
            )
        self.markers = positions
        self.times = np.arange(positions.shape[1]) / rate

    def __len__(self) -> int:
        return len(self.markers)

    def grip(self, sequence: int, held: int, other: int, offset: float, outward: float) -> GripPath:
        """Return the path of an end that two markers hold.

        Args:
            sequence: Number of the sequence.
            held: Marker where the free part starts.
            other: Marker behind it.
            offset: Distance from `held` to the end of the free part, into the cable [m].
            outward: 1 at the near end, whose direction points into the cable, -1 at the far end.
        """
        markers = self.markers[sequence]
        inward = markers[:, held] - markers[:, other]
        inward /= np.linalg.norm(inward, axis=-1, keepdims=True)
        direction = inward * outward
        yaw = np.unwrap(np.arctan2(direction[:, 0], direction[:, 1]))
        pitch = np.arcsin(np.clip(direction[:, 2], -1.0, 1.0))
        place = markers[:, held] + offset * inward
        return GripPath.fit(self.times, np.column_stack([place, yaw, pitch]))


def curves(points: Array, ends: Array) -> tuple[Any, Array]:
    """Return splines through points with given directions at the ends.

    Args:
        points: Points along a cable [m], shape [shape, point, 3].
        ends: Directions at the first and at the last point, shape [2, shape, 3].

    Returns:
        Function of a coordinate, and the coordinate of each point [m], shape [point].
    """
    from scipy.interpolate import CubicSpline

    chords = np.linalg.norm(np.diff(points, axis=1), axis=-1)
    along = np.pad(np.cumsum(chords.mean(axis=0)), (1, 0))
    bounds: Any = ((1, ends[0]), (1, ends[1]))
    return CubicSpline(along, points, axis=1, bc_type=bounds), along


def arcs(points: Array, ends: Array) -> Array:
    """Return the distance of each point along its curve [m], shape [shape, point]."""
    curve, along = curves(points, ends)
    fine = np.linspace(along[:-1], along[1:], ARC_POINTS, axis=-1)
    steps = np.linalg.norm(np.diff(curve(fine), axis=2), axis=-1).sum(axis=2)
    return np.pad(np.cumsum(steps, axis=1), ((0, 0), (1, 0)))


def inextensible(nodes: Array, rates: Array, length: float) -> CableState:
    """Return the state nearest to a shape whose segments have equal lengths that do not change.

    Args:
        nodes: Nodes, of which both ends stay [m], shape [node, 3].
        rates: Their velocities [m/s], same shape.
        length: Length of a segment [m].
    """
    nodes, rates = nodes.copy(), rates.copy()

    def remove(values: Array, excess: Array) -> None:
        """Move inner nodes along the edges so that an excess of each edge goes."""
        edges = np.diff(nodes, axis=0)
        unit = edges / np.linalg.norm(edges, axis=1, keepdims=True)
        slopes = np.zeros((len(unit), *nodes.shape))
        rows = np.arange(len(unit))
        slopes[rows, rows], slopes[rows, rows + 1] = -unit, unit
        inner = slopes[:, 1:-1].reshape(len(unit), -1)
        values[1:-1] -= np.linalg.lstsq(inner, excess, rcond=None)[0].reshape(-1, 3)

    for _ in range(LENGTH_STEPS):
        remove(nodes, np.linalg.norm(np.diff(nodes, axis=0), axis=1) - length)
    edges = np.diff(nodes, axis=0)
    remove(rates, np.sum(np.diff(rates, axis=0) * edges, axis=1) / length)
    return dataclasses.replace(CableState.at_rest(nodes[None]), velocities=rates[None])


def start_state(points: Array, ends: Array, times: Array, length: float, count: int) -> CableState:
    """Return the state in which a sequence starts.

    Args:
        points: Ends of the free part and free markers in the first frames [m], shape
            [frame, point, 3].
        ends: Directions at both ends in these frames, shape [2, frame, 3].
        times: Times of the frames [s], shape [frame].
        length: Length of the cable [m].
        count: Number of segments.
    """
    # A parabola over the first frames gives position and velocity.
    powers = np.vander(times, 3, increasing=True)
    found = np.linalg.lstsq(powers, points.reshape(len(times), -1), rcond=None)[0]
    place, velocity = found[:2].reshape(2, *points.shape[1:])
    along = arcs(place[None], ends[:, :1])[0]
    along *= length / along[-1]
    first, last = ends[:, 0] * (length / count)
    nodes = smooth(place, along, np.stack([first, last]), count)
    rates = smooth(velocity, along, (ends[:, 1] - ends[:, 0]) / times[1] * (length / count), count)
    return inextensible(nodes, rates, length / count)


def smooth(values: Array, along: Array, edges: Array, count: int) -> Array:
    """Return values at equal distances along a cable, as smooth as the noise of markers allows.

    Args:
        values: Values at points, the ends first and last, shape [point, 3].
        along: Distance of each point along the cable, shape [point].
        edges: Difference of the values over the first and over the last segment, shape [2, 3].
        count: Number of segments.
    """
    at = along / along[-1] * count
    before = np.minimum(at.astype(int), count - 1)
    rows = np.arange(len(at))
    reads = np.zeros((len(at), count + 1))
    reads[rows, before], reads[rows, before + 1] = before + 1 - at, at - before
    bends = np.diff(np.eye(count + 1), 3, axis=0)
    held = np.zeros((2, count + 1))
    held[0, :2], held[1, -2:] = (-1, 1), (-1, 1)
    # What the grips hold counts as certain.
    weights = np.where((rows == 0) | (rows == len(at) - 1), 1e3, 1.0)
    system = np.concatenate([weights[:, None] * reads, SMOOTHING * bends, 30.0 * held])
    wanted = np.concatenate([weights[:, None] * values, np.zeros((len(bends), 3)), 30.0 * edges])
    return np.asarray(np.linalg.lstsq(system, wanted, rcond=None)[0], dtype=float)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scene:
    """A sequence as the engine plays it.

    Attributes:
        cable: Cable, as long as that of the sequence.
        near: Path of the near grip.
        far: Path of the far grip.
        state: State in which the sequence starts.
        along: Distance of both grips and of the free markers along the cable [m], shape [point].
    """

    cable: Cable
    near: GripPath
    far: GripPath
    state: CableState
    along: Array


class Player:
    """Plays sequences with given numbers, and compares markers.

    Args:
        sequences: Sequences to play.
        args: Resolution.
    """

    def __init__(self, sequences: Sequences, args: Args):
        self.sequences, self.args = sequences, args

    def play(self, values: dict[str, float]) -> Array:
        """Return where the free markers go [m], shape [sequence, frame, marker, 3]."""
        scenes = [self.scene(row, values) for row in range(len(self.sequences))]
        count, times = self.args.segment_count, self.sequences.times
        engine = EngineWarp(segment_count=count, dt=self.args.dt, table=False)
        rollout = engine.rollout(
            [scene.cable for scene in scenes],
            GripPath.stack([scene.near for scene in scenes]),
            CableState.stack([scene.state for scene in scenes]),
            duration=float(times[-1]),
            sample_dt=float(times[1]),
            far_path=GripPath.stack([scene.far for scene in scenes]),
            record_nodes=True,
        )
        return np.stack(
            [
                markers_of(
                    nodes, np.linspace(0.0, scene.cable.length, count + 1), scene.along[1:-1]
                )
                for nodes, scene in zip(rollout.nodes, scenes, strict=True)
            ]
        )

    def scene(self, row: int, values: dict[str, float]) -> Scene:
        """Return what the engine needs to play a sequence with given numbers."""
        sequences, count, times = self.sequences, self.args.segment_count, self.sequences.times
        near = sequences.grip(row, HELD - 1, 0, values.get("near_offset", 0.0), 1.0)
        far = sequences.grip(row, -HELD, -1, values.get("far_offset", 0.0), -1.0)
        poses = [path.evaluate(times)[0] for path in (near, far)]
        ends = np.stack([tangent(pose[:, 3], pose[:, 4]) for pose in poses])
        inner = sequences.markers[row, :, HELD:-HELD]
        points = np.concatenate([poses[0][:, None, :3], inner, poses[1][:, None, :3]], axis=1)
        # What the cable measures from grip to grip, and where its markers are.
        along = arcs(points[::ARC_FRAMES], ends[:, ::ARC_FRAMES]).mean(axis=0)
        along *= values.get("length_factor", 1.0)
        cable = cable_of(float(along[-1]), values)
        first = slice(0, START_FRAMES)
        state = start_state(points[first], ends[:, first], times[first], cable.length, count)
        return Scene(cable=cable, near=near, far=far, state=state, along=along)

    def errors(self, values: dict[str, float]) -> Array:
        """Return the differences of free markers [m]; a world that breaks is 1 m off."""
        measured = self.sequences.markers[:, :, HELD:-HELD]
        return np.nan_to_num(self.play(values) - measured, nan=1.0)

    def error_cm(self, values: dict[str, float]) -> tuple[float, float]:
        """Return the mean absolute difference over all markers, and over free ones [cm]."""
        free = 100.0 * float(np.mean(np.abs(self.errors(values))))
        marker_count = self.sequences.markers.shape[2]
        return free * (marker_count - 2 * HELD) / marker_count, free


def cable_of(length: float, values: dict[str, float]) -> Cable:
    """Return a cable of a length [m] with fitted numbers."""
    params = CableParams(
        twist_stiffness=values.get("twist_stiffness", 1e-3),
        bend_stiffness=values["bend_stiffness"],
        mass=LINEAR_DENSITY * length,
        endpoint_mass=0.0,
        lateral_friction=0.5,
        worksurface_friction=0.5,
        spinning_friction=0.0,
        rolling_friction=0.0,
        linear_damping=values.get("linear_damping", 0.0),
        angular_damping=values.get("angular_damping", 0.0),
        damping_time=values.get("damping_time", 0.0),
    )
    return Cable(name="mocap", length=length, diameter=0.01, params=params)


def markers_of(nodes: Array, at: Array, inner: Array) -> Array:
    """Return the places of markers on a cable [m], shape [..., marker, 3]; NaN once it broke.

    Args:
        nodes: Nodes [m], shape [..., node, 3].
        at: Distance of each node along the cable [m], shape [node].
        inner: Distance of each marker [m], shape [marker].
    """
    from scipy.interpolate import CubicSpline

    places = np.full((*nodes.shape[:-2], len(inner), 3), np.nan)
    sound = np.isfinite(nodes).all(axis=(-2, -1))
    places[sound] = CubicSpline(at, nodes[sound], axis=-2)(inner)
    return places


def fit(
    player: Player,
    unknowns: tuple[Unknown, ...],
    iterations: int,
    known: dict[str, float] | None = None,
    starts: int = 1,
) -> dict[str, float]:
    """Return the numbers with the least error on the sequences, from several starts.

    One start is that of the unknowns, one the numbers that a fit of fewer found, so that more
    numbers never follow the sequences less. The others are the best of random draws.

    Args:
        player: Plays the sequences.
        unknowns: Numbers to fit.
        iterations: Largest number of steps from each start.
        known: Numbers that a fit of fewer unknowns found, if there was one.
        starts: Number of starts, apart from this one.
    """
    rng = np.random.default_rng(0)
    first = [coordinates_of(unknowns, found) for found in ({}, known) if found is not None]
    drawn = rng.uniform(*bounds_of(unknowns), size=(DRAWS * (starts - 1), len(unknowns)))
    drawn = sorted(drawn, key=lambda x: loss(player.errors(values_of(unknowns, x)).reshape(-1, 3)))
    found = [descend(player, unknowns, iterations, x) for x in (*first, *drawn[: starts - 1])]
    return min(found, key=lambda result: result[0])[1]


def values_of(unknowns: tuple[Unknown, ...], x: Array) -> dict[str, float]:
    """Return the numbers at some coordinates."""
    return {u.name: u.value(v) for u, v in zip(unknowns, x, strict=True)}


def coordinates_of(unknowns: tuple[Unknown, ...], values: dict[str, float]) -> Array:
    """Return the coordinates of some numbers; those that are missing are at their start."""
    return np.array([u.coordinate(values.get(u.name, u.start)) for u in unknowns])


def bounds_of(unknowns: tuple[Unknown, ...]) -> Array:
    """Return the lowest and the highest coordinates, shape [2, unknown]."""
    return np.array([[u.coordinate(u.low), u.coordinate(u.high)] for u in unknowns]).T


def loss(errors: Array) -> float:
    """Return the mean distance of markers [m], shape [marker, 3], smooth at 0."""
    return float(np.mean(np.sqrt(np.sum(errors**2, axis=1) + SMOOTH**2)))


def descend(
    player: Player, unknowns: tuple[Unknown, ...], iterations: int, x: Array
) -> tuple[float, dict[str, float]]:
    """Return the least loss near some coordinates, and its numbers (Levenberg and Marquardt)."""

    def residuals(x: Array) -> Array:
        return player.errors(values_of(unknowns, x)).reshape(-1, 3)

    low, high = bounds_of(unknowns)
    errors, damping = residuals(x), 1e-2
    for _ in range(iterations):
        slopes = np.stack(
            [
                (residuals(x + u.step * row) - errors) / u.step
                for u, row in zip(unknowns, np.eye(len(x)), strict=True)
            ],
            axis=-1,
        )
        # Weights turn the sum of squares into a sum of distances.
        weights = 1.0 / np.sqrt(np.sum(errors**2, axis=1) + SMOOTH**2)
        flat = slopes.reshape(-1, len(x))
        spread = np.repeat(weights, 3)
        normal = (flat * spread[:, None]).T @ flat
        gradient = (flat * spread[:, None]).T @ errors.ravel()
        before, improved = loss(errors), False
        for _ in range(6):
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), -gradient)
            trial = np.asarray(np.clip(x + step, low, high), dtype=float)
            tried = residuals(trial)
            if loss(tried) < before:
                x, errors, damping, improved = trial, tried, damping / 3.0, True
                break
            damping *= 5.0
        if not improved or before - loss(errors) < 1e-4 * before:
            break
    return loss(errors), values_of(unknowns, x)


def find_cables(folder: pathlib.Path) -> list[str]:
    """Return the names of the cables in a folder.

    Raises:
        InputError: There is none.
    """
    names = sorted(path.name.removesuffix("_train.npz") for path in folder.glob("*_train.npz"))
    if not names:
        raise InputError(f"{folder} holds no file NAME_train.npz")
    return names


def main(args: Args) -> Iterator[Table]:
    """Fit, play held-out sequences, and yield the table."""
    unsaid = ("data", "out", "sets")
    settings = {key: value for key, value in vars(args).items() if key not in unsaid}
    rows: list[tuple[Any, ...]] = []
    for name in find_cables(args.data):
        files = [args.data / f"{name}_{part}.npz" for part in ("train", "eval")]
        folder = args.out / code_key(__name__) / name
        fits = Parts(folder, fingerprint(settings, *(file.read_bytes() for file in files)))
        train, held_out = (Player(Sequences(file), args) for file in files)
        values: dict[str, float] | None = None
        for number, (label, unknowns) in enumerate(itertools.islice(SETS.items(), args.sets)):
            make = functools.partial(fit, train, unknowns, args.iterations, values, args.starts)
            values = fits.get_or_make(f"fit-{number}", make)
            trained, tested = train.error_cm(values), held_out.error_cm(values)
            found = ", ".join(f"{key} {value:.3g}" for key, value in values.items())
            rows.append((name, label, *trained, *tested, found))
            print(rows[-1], file=sys.stderr, flush=True)
        if name in PUBLISHED:
            words = "published: the authors' learned model, on all of their held-out sequences"
            rows.append((name, words, None, None, PUBLISHED[name], None, None))
    columns = (
        *("cable", "fitted", "training [cm]", "its free markers [cm]"),
        *("held out [cm]", "its free markers [cm]", "found"),
    )
    yield Table(title="Mean absolute error", columns=columns, rows=rows)
