"""Strikes in the air on the benchmark of Iterative Residual Policy (irp_world.py).

Each goal is a task of its own: nothing is known of the rope but what is believed of ropes, and the
aim starts anew. A try that hit is repeated, as its world makes the same swing again. Published
methods know no rope either, but were trained on 54 million swings of the same simulator; their
first try is the best mean action over 64 training ropes. The rows say what an aim sees.
"""

import concurrent.futures
import csv
import dataclasses
import functools
import io
import pathlib
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.irp_world import (
    FLANGE_BEYOND,
    HALF_WIDTH,
    MOVING,
    PIXELS_PER_M,
    ROOT_BEYOND,
    SPEEDS,
    START_DEG,
    STICK,
    TURNS_DEG,
    Rope,
    World,
    arm,
    draw_goals,
    draw_ropes,
    middle_of,
    pixel_error,
    pixels_of,
    respond,
)
from benchmarks.result import Table, code_key
from cablecast.aiming.strike import StrikeAim, StrikePrior
from cablecast.conventions import Array
from cablecast.engines.swing import SwingModel
from cablecast.engines.warp_ import EngineWarp
from cablecast.files import write_bytes
from cablecast.motion.joint_move import JointMoves, Stick
from cablecast.report import style
from cablecast.runs.folder import Parts, fingerprint
from cablecast.task import closest
from cablecast.tuning.tips import TipBelief, air_cable

KINDS = ("interpolation", "extrapolation")
DATA = pathlib.Path(__file__).parent / "data"

SEGMENT_COUNT, ENGINE_DT = 24, 1e-3
BELIEVED = air_cable(0.95, 0.06, 0.03, 0.3, 0.0173, drag_ratio=0.15)
DEVIATIONS = (1.5, 2.2, 2.0, 2.5, 2.0)
"""What is believed of a rope: length, mass per length, stiffness over it, damping time and drag
along it over that across, each within a factor. The benchmark's ropes have 0.5 to 1.6 m, 13 to
178 g/m, 0.014 to 0.046 m^4/s², 0.5 s and some 0.27."""
NOISE = 0.01
"""Deviation of a coordinate of a tip in the row with noise [m]."""
IMPULSE = 1e-3
"""Largest impulse at the tip at the start, in the row with impulses [N·s]."""
WITHIN, PIXEL_WEIGHT = 5e-3, 0.3
"""Distance at which a try has hit [m], and weight of the pixel metric, so that a try that is a
pixel off by it has not [-]."""
LEAST_DRAWN = 0.02
"""Error below which one is drawn as this [cm]: the metric's least value is 0."""


@dataclasses.dataclass(frozen=True)
class Row:
    """What an aim sees and does.

    Attributes:
        words: Name in the table.
        options: Options of `StrikeAim`.
        noise: Deviation of a coordinate [m].
        pixels: Whether it sees pixels of 2.34 cm.
        impulse: Whether swings start with an impulse.
    """

    words: str
    options: dict[str, Any] = dataclasses.field(default_factory=dict)
    noise: float = 0.0
    pixels: bool = False
    impulse: bool = False


ROWS = {
    "aim": Row("exact tip every 10 ms"),
    "pixels": Row("pixels of 2.34 cm every 10 ms", pixels=True),
    "image": Row("what IRP sees: pixels without time", {"timed": False}, pixels=True),
    "noise": Row("noise of 1 cm", noise=NOISE),
    "impulse": Row("an impulse at every start", impulse=True),
    "fit": Row("no correction", {"corrects": False}),
    "prior": Row("no fit: next best mean action", {"fits": False}),
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Strike the goals of IRP's benchmark.

    Attributes:
        ropes: Number of ropes of each kind.
        goals: Number of goals on each rope.
        tries: Number of tries at each goal.
        rows: Rows of `ROWS`.
        seed: Seed of ropes and goals; those of 0 are in `data/irp_goals.csv`.
        actions: Number of actions of which those of a goal may hit it, for other seeds.
        workers: Processes, each of one thread.
        out: Folder of the finished goals, in which the same command resumes.
    """

    ropes: int = 5
    goals: int = 25
    tries: int = 16
    rows: tuple[str, ...] = ("aim",)
    seed: int = 0
    actions: int = 256
    workers: int = 2
    out: pathlib.Path = pathlib.Path("runs/benchmarks/irp")


@functools.cache
def model() -> SwingModel:
    """Return the simulated arm: it moves as the benchmark's, whatever its limits."""
    start = tuple(np.radians(START_DEG).tolist())
    low, high = (tuple(np.radians([turn[side] for turn in TURNS_DEG]).tolist()) for side in (0, 1))
    moves = JointMoves(
        arm=arm(),
        stick=Stick(length=FLANGE_BEYOND + STICK + ROOT_BEYOND),
        start=start,
        joints=MOVING,
        low=(SPEEDS[0], *low),
        high=(SPEEDS[1], *high),
    )
    engine = EngineWarp(segment_count=SEGMENT_COUNT, dt=ENGINE_DT, table=False, thread_count=1)
    return SwingModel(moves=moves, engine=engine, respond=respond)


@functools.cache
def prior(file: pathlib.Path) -> StrikePrior:
    """Return the simulated swings of believed ropes, made once."""
    belief = TipBelief(cable=BELIEVED, deviations=DEVIATIONS)
    if file.is_file():
        with np.load(file) as stored:
            return StrikePrior(
                model=model(),
                belief=belief,
                units=stored["units"],
                tips=stored["tips"],
                checked=False,
            )
    made = StrikePrior.simulate(model(), belief, checked=False)
    content = io.BytesIO()
    np.savez(content, units=made.units, tips=made.tips)
    write_bytes(file, content.getvalue())
    return made


def problems(args: Args) -> list[tuple[str, Rope, NDArray[np.int_]]]:
    """Return the kind, the rope and the pixels of its goals, for each rope."""
    if args.seed != 0:
        return [
            (kind, rope, draw_goals(rope, args.goals, args.actions, args.seed))
            for kind in KINDS
            for rope in draw_ropes(kind, args.ropes, args.seed)
        ]
    found: dict[tuple[str, Rope], list[list[int]]] = {}
    with (DATA / "irp_goals.csv").open() as file:
        for row in csv.DictReader(file):
            rope = Rope(float(row["length_m"]), float(row["density_kg_m"]))
            pixel = [int(row["forward_pixel"]), int(row["up_pixel"])]
            found.setdefault((row["kind"], rope), []).append(pixel)
    chosen: list[tuple[str, Rope, NDArray[np.int_]]] = []
    for kind in KINDS:
        ropes = [(key, goals) for key, goals in found.items() if key[0] == kind][: args.ropes]
        chosen += [(*key, np.array(goals)[: args.goals]) for key, goals in ropes]
    return chosen


def strike(
    row: Row, rope: Rope, pixel: NDArray[np.int_], tries: int, file: pathlib.Path, seed: int
) -> dict[str, list[float]]:
    """Return errors by pixel and distance [m] and the time of one core [s] of each try."""
    world, plane = _world(rope), float(arm().frames(np.radians(START_DEG))[-1][0, 3])
    rng = np.random.default_rng([seed, *pixel.tolist(), round(1e3 * rope.length)])
    goal = np.array([plane, *middle_of(pixel)])

    def loss(tip: Array) -> float:
        """Return the pixel metric, whose least value is zero, with little weight."""
        tip = tip[np.isfinite(tip[:, 0]), 1:]
        return PIXEL_WEIGHT * pixel_error(tip, pixel) if len(tip) else 1.0

    aim = StrikeAim(prior(file), goal, within=WITHIN, loss=loss, seed=seed, **row.options)
    found: dict[str, list[float]] = {"pixel": [], "distance": [], "seconds": []}
    for _ in range(tries):
        repeated = any(one.miss <= WITHIN for one in aim.tries)
        if repeated and not row.impulse:
            # The same swing again.
            found["pixel"].append(found["pixel"][-1])
            found["distance"].append(found["distance"][-1])
            found["seconds"].append(0.0)
            continue
        start = time.process_time()
        unit = aim.propose()
        seconds = time.process_time() - start
        impulse = rng.uniform(-IMPULSE, IMPULSE) if row.impulse else 0.0
        path = world.swing(unit, impulse).path
        seen = path + row.noise * rng.normal(size=path.shape)
        if not row.options.get("timed", True):
            seen = middle_of(pixels_of(seen))
        elif row.pixels:
            seen = middle_of(np.floor((seen + HALF_WIDTH) * PIXELS_PER_M))
        start = time.process_time()
        if not repeated:
            aim.observe(unit, _in_space(seen, plane))
        seconds += time.process_time() - start
        found["distance"].append(float(closest(path, middle_of(pixel))[0]))
        found["pixel"].append(pixel_error(path, pixel))
        found["seconds"].append(seconds)
    return found


@functools.lru_cache(maxsize=4)
def _world(rope: Rope) -> World:
    return World(rope)


def _in_space(path: Array, plane: float) -> Array:
    """Return a path of the plane in space [m], shape [step, 3]."""
    return np.concatenate([np.full((len(path), 1), plane), path], axis=1)


def _job(parts: Parts, name: str, *job: Any) -> tuple[str, dict[str, Any]]:
    return name, parts.get_or_make(name, functools.partial(strike, *job))


def main(args: Args) -> Iterator[Table]:
    """Strike the goals of every row, and yield a table of errors and one of times."""
    settings = {"belief": repr(BELIEVED), "deviations": DEVIATIONS, "tries": args.tries}
    folder = args.out / code_key(__name__)
    file = folder / "prior.npz"
    # Before processes part, so that each of them has it.
    print(len(prior(file).motion.end), "moves", file=sys.stderr)
    parts = Parts(folder / f"seed-{args.seed}", fingerprint(settings))
    cases = problems(args)
    jobs = {}
    # Goal by goal, so that what is done when time is up is a fair part of all.
    for name in args.rows:
        for number in range(args.goals):
            for at, (kind, rope, goals) in enumerate(cases):
                key = f"{name}-{kind}-{at}-{number}"
                jobs[key] = (ROWS[name], rope, goals[number], args.tries, file, args.seed)
    found: dict[str, dict[str, Any]] = {}
    with concurrent.futures.ProcessPoolExecutor(args.workers) as pool:
        futures = [pool.submit(_job, parts, key, *job) for key, job in jobs.items()]
        for future in concurrent.futures.as_completed(futures):
            key, values = future.result()
            found[key] = values
            print(key, np.round(100.0 * np.array(values["distance"]), 1), file=sys.stderr)
    yield from tables(args, found)


def tables(args: Args, found: dict[str, dict[str, Any]]) -> Iterator[Table]:
    """Yield errors and times of finished goals by their names."""
    # In one order, whichever was done first.
    found = dict(sorted(found.items()))
    columns = ("kind", "method", "try", "mean", "low", "high", "distance", "median", "goals")
    rows: list[tuple[Any, ...]] = []
    for name in args.rows:
        for kind in KINDS:
            done = [v for key, v in found.items() if key.startswith(f"{name}-{kind}-")]
            if not done:
                continue
            pixel = 100.0 * np.array([v["pixel"] for v in done])
            distance = 100.0 * np.array([v["distance"] for v in done])
            low, high = interval(pixel)
            for number, (ours, apart) in enumerate(zip(pixel.T, distance.T, strict=True)):
                errors = (ours.mean(), low[number], high[number], apart.mean(), np.median(apart))
                rows.append((kind, ROWS[name].words, number, *errors, len(done)))
    with (DATA / "irp_published.csv").open() as file:
        published = {(r["panel"], r["method"], r["stat"]): r for r in csv.DictReader(file)}
    for kind, panel in zip(KINDS, ("interp", "extrap"), strict=True):
        for method in ("IRP", "SysID", "DeltaReg") if "aim" in args.rows else ():
            stats = [published[panel, method, stat] for stat in ("mean", "ci_lo", "ci_hi")]
            for number in range(args.tries):
                errors = (float(stat[f"iter{number}"]) for stat in stats)
                rows.append((kind, f"published: {method}", number, *errors, None, None, 125))
    yield Table("Error of each try [cm], from 0", columns, rows)
    times = []
    for name in args.rows:
        done = [v["seconds"] for key, v in found.items() if key.startswith(f"{name}-")]
        spent = [s for seconds in done for s in seconds[1:] if s > 0.01]
        if spent:
            times.append((ROWS[name].words, np.median(spent), *np.percentile(spent, [90, 100])))
    yield Table("Time of one core for each try [s]", ("method", "median", "p90", "most"), times)


def interval(values: Array, middle: Callable[..., Array] = np.mean) -> tuple[Array, Array]:
    """Return the 95 % interval of a middle over goals, shape [goal, try], by resampling goals."""
    rng = np.random.default_rng(0)
    rows = rng.integers(len(values), size=(1000, len(values)))
    low, high = np.percentile(middle(values[rows], axis=1), [2.5, 97.5], axis=0)
    return low, high


def draw(rows: Iterable[Mapping[str, Any]]) -> bytes:
    """Draw errors against tries, ours and the published ones, as a PNG file.

    `rows` are those of the first table by the names of their columns.
    """
    rows = list(rows)
    shown = dict.fromkeys(row["method"] for row in rows)
    with style.styled():
        figure = style.new_figure(style.PAGE_WIDTH, 3.2)
        axes = figure.subplots(1, len(KINDS), sharey=True)
        for axis, kind in zip(axes, KINDS, strict=True):
            for number, method in enumerate(shown):
                own = [row for row in rows if (row["kind"], row["method"]) == (kind, method)]
                if not own:
                    continue
                tries = [row["try"] for row in own]
                low, middle, high = (
                    np.maximum([row[name] for row in own], LEAST_DRAWN)
                    for name in ("low", "mean", "high")
                )
                color = f"C{number}"
                axis.fill_between(tries, low, high, color=color, alpha=0.15, linewidth=0)
                published = method.startswith("published")
                label, dashes = (method, "--") if published else (f"cablecast: {method}", "-")
                axis.plot(tries, middle, color=color, linestyle=dashes, label=label)
            axis.set(title=kind, xlabel="try")
            style.log_scale(axis, "y")
            axis.grid(axis="y", color=style.FAINT)
        axes[0].set(ylabel="mean error by the pixel metric [cm]")
        axes[1].legend(fontsize=6, loc="lower right", bbox_to_anchor=(1.0, 0.1))
        return style.png_bytes(figure)
