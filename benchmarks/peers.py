"""EngineWarp and simulators of other authors: stable step, error, rate, on two common scenes.

Other programs on the machine slow whatever runs beside them. So rates are counted in the time that
this process computes, on one thread, and EngineWarp plays before and after each of the others.

A swing needs no table: a cable without damping, clamped at one end, is let go from straight. A cast
needs Coulomb's friction, which is the only resistance here: few simulators have air, damped
rotation, rolling and spinning friction, and each has laws of its own for them.
"""

import dataclasses
import importlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import has, random_casts
from benchmarks.result import Table
from cablecast.cable import Cable, CableParams, load_cable
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.engines.warp_.engine import DEFAULT_DT, DEFAULT_SEGMENT_COUNT
from cablecast.motion.grip_path import GripPath

FINE = (160, 1.25e-4)
NEXT_FINE = (120, 1.25e-4)
"""Segments and step [s] of the converged solution, and of one whose distance shows its error."""

HEIGHT = 1.0
SWING_TIME = 1.0
CAST_TIME = 2.5
SAMPLE_DT = 0.02
STRETCHED = 1.05
"""Distance of the free end from the grip, over the cable's length, at which a world is broken."""

_RESISTANCES = ("linear_damping", "angular_damping", "rolling_friction", "spinning_friction")


def bare_params(cable: Cable) -> CableParams:
    """Return a cable's parameters with Coulomb's friction as the only resistance."""
    return dataclasses.replace(cable.params, **dict.fromkeys(_RESISTANCES, 0.0))


@dataclasses.dataclass(frozen=True)
class Scene:
    """Motions with the tracks of the free end that the converged EngineWarp finds.

    Attributes:
        cable: Cable.
        params: Parameters, shared.
        paths: Motions of the grip.
        state: Returns the initial state for a number of segments; None for the reset state.
        duration: Simulated time [s].
        times: Times of the tracks [s], shape [time].
        tracks: Tracks where segments roll, and where they slide only [m], each of shape
            [motion, time, 3].
    """

    cable: Cable
    params: CableParams
    paths: GripPath
    state: Callable[[int], CableState | None]
    duration: float
    times: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.zeros(0))
    tracks: dict[bool, NDArray[np.float64]] = dataclasses.field(default_factory=dict)

    def play(self, engine: Any, world_count: int | None = None, *, rolls: bool = True):
        """Return a rollout and the time that this process computed for it [s].

        Args:
            engine: Answers `Engine.rollout`.
            world_count: Worlds; the motions are repeated. One of each by default.
            rolls: False for a rolling friction that keeps EngineWarp's segments from rolling.
        """
        rows = np.arange(world_count or len(self.paths)) % len(self.paths)
        state, params = self.state(engine.segment_count), self.params
        if state is not None and state.world_count > 1:
            state = CableState.at_rest(state.positions[rows])
        if not rolls:
            params = dataclasses.replace(params, rolling_friction=0.1, twist_stiffness=0.0)
        start = time.process_time()
        rollout = engine.rollout(
            self.cable.with_params(params), self.paths[rows], state, self.duration, SAMPLE_DT
        )
        return rollout, time.process_time() - start

    def solved(self, segment_count: int, dt: float) -> "Scene":
        """Return the scene with the tracks of EngineWarp at a number of segments and a step [s]."""
        tracks, times = {}, self.times
        for rolls in (True, False):
            rollout = self.play(fine_engine(segment_count, dt), rolls=rolls)[0]
            tracks[rolls], times = rollout.endpoint_xyz, rollout.times
        return dataclasses.replace(self, times=times, tracks=tracks)

    def errors(self, rollout: Any, rolls: bool) -> NDArray[np.float64]:
        """Return distances of the free end from the converged tracks.

        Args:
            rollout: Rollout whose first worlds are the motions.
            rolls: True to compare with segments that roll.

        Returns:
            Distances in % of cable length, shape [motion, time].
        """
        track = np.empty_like(self.tracks[rolls])
        # An engine whose step does not divide the interval samples at times of its own.
        for world, axis in np.ndindex(len(track), 3):
            values = rollout.endpoint_xyz[world, :, axis]
            track[world, :, axis] = np.interp(self.times, rollout.times, values)
        return 100.0 * np.linalg.norm(track - self.tracks[rolls], axis=-1) / self.cable.length

    def whole(self, rollout: Any) -> NDArray[np.bool_]:
        """Return which worlds stayed finite, their cable neither torn nor thrown, shape [world]."""
        count = len(rollout.endpoint_xyz)
        grips = self.paths[np.arange(count) % len(self.paths)].evaluate(rollout.times)[..., :3]
        with np.errstate(invalid="ignore", over="ignore"):
            reach = np.linalg.norm(rollout.endpoint_xyz - grips, axis=-1)
        return np.all(reach <= STRETCHED * self.cable.length, axis=1)


def fine_engine(segment_count: int, dt: float) -> EngineWarp:
    """Return EngineWarp in double precision that plays to the end."""
    return EngineWarp(segment_count=segment_count, dt=dt, precision="double", rest_speed=0.0)


def swings(cable: Cable, pitches: NDArray[np.float64], duration: float = SWING_TIME) -> Scene:
    """Return cables that are let go from straight; those from level whip.

    Args:
        cable: Cable.
        pitches: Directions of clamp and cable above the horizontal [rad], shape [motion].
        duration: Simulated time [s].
    """
    paths = GripPath.stack([GripPath.hold([0.0, 0.0, HEIGHT, 0.0, p], 1.0) for p in pitches])

    def state(segment_count: int) -> CableState:
        along = np.linspace(0.0, cable.length, segment_count + 1)
        nodes = np.zeros((len(pitches), segment_count + 1, 3))
        nodes[..., 1] = along * np.cos(pitches)[:, None]
        nodes[..., 2] = HEIGHT + along * np.sin(pitches)[:, None]
        return CableState.at_rest(nodes)

    return Scene(cable, bare_params(cable), paths, state, duration)


def casts(cable: Cable, count: int, seed: int) -> Scene:
    """Return random feasible casts from the reset state, at v_max 1.5 m/s with psi."""
    paths = random_casts(count, seed)
    return Scene(cable, bare_params(cable), paths, lambda _: None, CAST_TIME)


SEGMENTS = 20
LADDER = tuple(1e-2 / 2**k for k in range(11))
"""Steps that are tried [s]: 10 ms, halved down to 10 microseconds."""

WARP_STEP = 1.25e-3
WARP_WORLDS = 512
"""Step [s] and worlds of EngineWarp where it is the measure of rates."""

REST_SPEED = 5e-4
"""Speed up to which EngineWarp takes a world to be at rest by default [m/s]."""

STEEPEST_DEG = 60.0
"""Swings start from here below the horizontal up to level, from where a cable whips [deg]."""

ENOUGH = 0.8
IDLE = 2
"""A shorter step is worth its time where the error falls below this share of what it was; after so
many that were not the search ends."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """EngineWarp and other simulators of cables: stable step, error, rate.

    Attributes:
        cable: Name of a preset, or a YAML file.
        swing_count: Number of swings.
        cast_count: Number of random feasible casts.
        seed: Seed of the casts.
        only: Names of those to play; all by default.
        patience: Computing time that a rollout may take, or no shorter step is tried [s].
    """

    cable: str = "cable_1"
    swing_count: int = 12
    cast_count: int = 8
    seed: int = 0
    only: tuple[str, ...] = ()
    patience: float = 60.0


@dataclasses.dataclass(frozen=True)
class Contender:
    """A simulator with the resolution that it is asked for.

    Attributes:
        name: Name in the tables.
        library: Library to import.
        package: Package to install.
        make: Returns it for a step [s], and True for a table.
        rolls: True where its segments roll on the table.
    """

    name: str
    library: str
    package: str
    make: Callable[[float, bool], Any]
    rolls: bool = True


def contenders() -> list[Contender]:
    """Return every simulator of this benchmark."""

    def engine(name: str, module: str, **options: Any):
        def make(dt: float, table: bool) -> Any:
            kind = getattr(importlib.import_module(f"cablecast.engines.{module}"), name)
            return kind(SEGMENTS, dt, **options)

        return make

    def peer(name: str, **options: Any):
        def make(dt: float, table: bool) -> Any:
            kind = getattr(importlib.import_module("benchmarks.peer_adapters"), name)
            return kind(SEGMENTS, dt, table=table, **options)

        return make

    mujoco = {"library": "mujoco", "package": "mujoco"}
    newton = {"library": "newton", "package": "newton"}
    return [
        Contender("MuJoCo", **mujoco, make=engine("EngineMujoco", "mujoco_", thread_count=1)),
        Contender(
            "MuJoCo, sliding only",
            **mujoco,
            make=engine("EngineMujoco", "mujoco_", thread_count=1, rolling=False),
            rolls=False,
        ),
        Contender("PyBullet", "pybullet", "pybullet", engine("EnginePybullet", "pybullet_")),
        Contender("PyElastica", "elastica", "pyelastica", peer("PeerElastica")),
        Contender(
            "dismech-newton",
            "dismech_newton",
            "dismech-newton",
            peer("PeerDismech"),
            rolls=False,
        ),
        Contender("Newton", **newton, make=peer("PeerNewton")),
        Contender(
            "MuJoCo Warp",
            "mujoco_warp",
            "mujoco-warp",
            peer("PeerMujocoWarp"),
        ),
    ]


def warp(segment_count: int, dt: float, rest_speed: float = 0.0) -> EngineWarp:
    """Return EngineWarp on one thread."""
    return EngineWarp(segment_count, dt, thread_count=1, rest_speed=rest_speed)


@dataclasses.dataclass
class Result:
    """Result of one simulator on one scene.

    Attributes:
        stable: Longest step tried at which every world stays whole [s]; NaN where none was sought.
        dt: Step that was played [s].
        errors: Distances from the converged tracks [% of cable length], shape [motion, time].
        rate: Simulated time in a second of computing, all worlds together.
        ratio: Rate of EngineWarp at as many segments and 1.25 ms, over this one.
    """

    stable: float
    dt: float
    errors: NDArray[np.float64]
    rate: float
    ratio: float


def warp_rate(scene: Scene) -> float:
    """Return the simulated time that EngineWarp plays in a second of computing, to the end."""
    _, seconds = scene.play(warp(SEGMENTS, WARP_STEP), WARP_WORLDS)
    return WARP_WORLDS * scene.duration / seconds


def measured(scene: Scene, engine: Any, rolls: bool) -> tuple[int, Result]:
    """Play a scene between two turns of EngineWarp.

    Returns:
        The number of worlds that did not stay whole, and what was reached.
    """
    before = warp_rate(scene)
    rollout, seconds = scene.play(engine)
    both = 0.5 * (before + warp_rate(scene))
    rate = len(scene.paths) * scene.duration / seconds
    errors = scene.errors(rollout, rolls)
    broken = int((~scene.whole(rollout)).sum())
    return broken, Result(np.nan, engine.dt, errors, rate, both / rate)


def best(
    contender: Contender, scene: Scene, steps: Sequence[float], table: bool, patience: float
) -> Result | str:
    """Return the result at the step from which on shorter ones gain little, or why there is none.

    Args:
        contender: Simulator.
        scene: Motions.
        steps: Steps to try [s], from the longest.
        table: True for a table.
        patience: Computing time that a rollout may take [s].
    """
    found, stable, idle = None, np.nan, 0
    # The first rollout compiles.
    dataclasses.replace(scene, duration=2 * SAMPLE_DT).play(contender.make(steps[0], table))
    for dt in steps:
        broken, result = measured(scene, contender.make(dt, table), contender.rolls)
        if broken == 0 and found is None:
            found, stable = result, dt
        elif broken == 0 and found is not None:
            gained = error(result) < ENOUGH * error(found)
            found, idle = (result, 0) if gained else (found, idle + 1)
        if idle == IDLE:
            break
        if 2.0 * len(scene.paths) * scene.duration / result.rate > patience:
            break
    if found is None:
        return f"{broken} of {len(scene.paths)} worlds break at {dt * 1e3:.3g} ms"
    return dataclasses.replace(found, stable=stable)


def error(result: Result) -> float:
    """Return the median error along the track [% of cable length]."""
    return float(np.median(result.errors[:, 1:]))


def played(contender: Contender, scenes: tuple[Scene, Scene], patience: float):
    """Return the results on swings and on casts; in their place a sentence that says why not."""
    if not has(contender.library):
        return (f"not installed: pip install {contender.package}",) * 2
    try:
        swing = best(contender, scenes[0], LADDER, False, patience)
        if isinstance(swing, str):
            return swing, swing
        if len(scenes[1].paths) * scenes[1].duration / swing.rate > 4.0 * patience:
            return swing, f"a second of one cable takes {1.0 / swing.rate:.0f} s to compute"
        steps = [dt for dt in LADDER if dt <= swing.dt]
        return swing, best(contender, scenes[1], steps, True, patience)
    # A library of others may fail in any way: it is a line of the table, not the end of the run.
    except Exception as failure:
        text = (str(failure).splitlines() or [""])[0]
        return (f"{type(failure).__name__}: {text}",) * 2


SWING_COLUMNS = (
    "simulator",
    "segments",
    "stable step [ms]",
    "step [ms]",
    "median [%]",
    "p90 [%]",
    "simulated s/s",
    "EngineWarp is faster by",
)
CAST_COLUMNS = (
    "simulator",
    "segments",
    "step [ms]",
    "rolls",
    "track median [%]",
    "track p90 [%]",
    "rest median [%]",
    "rest p90 [%]",
    "rollouts/s",
    "simulated s/s",
    "EngineWarp is faster by",
)


def swing_row(name: str, segments: int, result: Result) -> tuple:
    whole = np.percentile(result.errors[:, 1:], (50, 90))
    steps = ("" if np.isnan(result.stable) else result.stable * 1e3, result.dt * 1e3)
    return (name, segments, *steps, *map(float, whole), result.rate, result.ratio)


def cast_row(name: str, segments: int, rolls: bool, result: Result, duration: float) -> tuple:
    whole = np.percentile(result.errors[:, 1:], (50, 90))
    rest = np.percentile(result.errors[:, -1], (50, 90))
    errors = map(float, (*whole, *rest))
    rates = (result.rate / duration, result.rate, result.ratio)
    return (name, segments, result.dt * 1e3, "yes" if rolls else "no", *errors, *rates)


def warp_rows(scenes: tuple[Scene, Scene]) -> tuple[list[tuple], list[tuple]]:
    """Return the rows of EngineWarp on swings and on casts."""
    swing, cast = scenes
    own = Contender("EngineWarp", "warp", "warp-lang", lambda dt, table: warp(SEGMENTS, dt))
    coarse = best(own, swing, LADDER, False, np.inf)
    assert isinstance(coarse, Result)
    steps = [dt for dt in LADDER if dt <= coarse.dt]
    thrown = best(own, cast, steps, True, np.inf)
    assert isinstance(thrown, Result)
    swing_rows, cast_rows = [], []
    for segments, dt, cast_dt in (
        (SEGMENTS, coarse.dt, thrown.dt),
        (DEFAULT_SEGMENT_COUNT, DEFAULT_DT, DEFAULT_DT),
    ):
        stable = coarse.stable if segments == SEGMENTS else np.nan
        result = dataclasses.replace(warp_result(swing, segments, dt, 0.0), stable=stable)
        swing_rows.append(swing_row("EngineWarp", segments, result))
        for name, speed in (("to the end", 0.0), ("until rest", REST_SPEED)):
            result = warp_result(cast, segments, cast_dt, speed)
            row = cast_row(f"EngineWarp, {name}", segments, True, result, cast.duration)
            cast_rows.append(row)
    return swing_rows, cast_rows


def warp_result(scene: Scene, segments: int, dt: float, rest_speed: float) -> Result:
    """Return what EngineWarp reaches, its rate with many worlds at once."""
    engine = warp(segments, dt, rest_speed)
    errors = scene.errors(scene.play(engine)[0], rolls=True)
    before = warp_rate(scene)
    _, seconds = scene.play(engine, WARP_WORLDS)
    rate = WARP_WORLDS * scene.duration / seconds
    return Result(np.nan, dt, errors, rate, 0.5 * (before + warp_rate(scene)) / rate)


def next_fine(scene: Scene) -> str:
    """Return how far the next coarser solution is from the converged one, in words."""
    distances = scene.errors(scene.play(fine_engine(*NEXT_FINE))[0], rolls=True)[:, 1:]
    median, p90 = np.percentile(distances, (50, 90))
    return f"{NEXT_FINE[0]} segments are {median:.2g} % (median) and {p90:.2g} % (p90) from it"


def main(args: Args) -> Iterator[Table]:
    """Yield a table of swings, one of casts, and one of what was not played."""
    cable = load_cable(args.cable)
    pitches = -np.radians(np.linspace(STEEPEST_DEG, 0.0, args.swing_count))
    both = swings(cable, pitches), casts(cable, args.cast_count, args.seed)
    scenes = (both[0].solved(*FINE), both[1].solved(*FINE))
    fine = "% of cable length from 160 segments at 1/8 ms"
    tables = (
        Table(
            f"{args.swing_count} swings of {SWING_TIME:g} s without damping: {fine}; "
            f"{next_fine(scenes[0])}",
            SWING_COLUMNS,
            [],
        ),
        Table(
            f"{args.cast_count} casts of {CAST_TIME:g} s with Coulomb's friction alone: {fine}; "
            f"{next_fine(scenes[1])}",
            CAST_COLUMNS,
            [],
        ),
        Table("Not played", ("simulator", "scene", "reason"), []),
    )
    tables[0].rows[:], tables[1].rows[:] = warp_rows(scenes)
    for contender in contenders():
        if args.only and contender.name not in args.only:
            continue
        swing, cast = played(contender, scenes, args.patience)
        name, rolls = contender.name, contender.rolls
        for scene, result, table in (("swing", swing, tables[0]), ("cast", cast, tables[1])):
            if isinstance(result, str):
                table, row = tables[2], (name, scene, result)
            elif scene == "swing":
                row = swing_row(name, SEGMENTS, result)
            else:
                row = cast_row(name, SEGMENTS, rolls, result, CAST_TIME)
            table.rows.append(row)
            print(scene, *row, file=sys.stderr, flush=True)
    yield from tables
