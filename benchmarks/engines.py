"""Speed of every engine on the same actions, each with the accuracy it reaches.

All rates are whole rollouts of the same duration on one core unless a row says otherwise, after
kernels are compiled and models are built; the time for that is a table of its own. Accuracy is the
distance of the endpoint from that of a fine EngineWarp in double precision, along the whole track
and at its end.
"""

import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import has, random_casts
from benchmarks.result import Table
from cablecast.cable import PAPER_PARAMS, PARAMS, Cable, load_cable
from cablecast.engines.warp_ import EngineWarp
from cablecast.engines.warp_.engine import DEFAULT_DT, DEFAULT_SEGMENT_COUNT
from cablecast.files import core_count
from cablecast.motion.grip_path import GripPath
from cablecast.setup import Setup

# Runs in a process of its own: a process can measure its peak memory and compilation only once.
_CHILD = """
import json, pathlib, sys, time
from cablecast.cable import load_cable
from cablecast.engines import make_engine
from cablecast.motion.grip_path import GripPath
name, worlds = sys.argv[1], int(sys.argv[2])
cable = load_cable("cable_1")
path = GripPath.stack([GripPath.hold([0.0, 0.6, 0.02, 0.0, 0.0], 0.1)] * worlds)
seconds = []
engine = make_engine(name)
for _ in range(2):
    start = time.perf_counter()
    engine.rollout(cable, path, duration=0.1)
    seconds.append(time.perf_counter() - start)
status = pathlib.Path("/proc/self/status")
peak = float("nan")
if status.exists():
    # Unlike ru_maxrss this does not count what the parent process had when it started us.
    peak = 1024.0 * float(status.read_text().split("VmHWM:")[1].split()[0])
print(json.dumps([seconds, peak]))
"""


def _child(name: str, worlds: int, cache: str | None = None) -> tuple[list[float], float]:
    """Return the times of two rollouts [s] and the peak memory [byte] of a process of its own.

    Args:
        name: Name of the engine.
        worlds: Number of worlds.
        cache: Folder of compiled kernels; the user's where None.
    """
    environment = dict(os.environ)
    if cache is not None:
        environment["WARP_CACHE_PATH"] = cache
    out = subprocess.run(
        [sys.executable, "-c", _CHILD, name, str(worlds)],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(out.stdout.strip().splitlines()[-1])


def footprint() -> Table:
    """Measure the memory of each world, and the time before the first step."""
    table = Table(
        "Memory per world in memory at once (PyBullet: one after the other, so only results), and "
        "what the first rollout takes beyond the second",
        ("engine", "memory per world [KiB]", "compile [s]", "compile, cached [s]"),
        [],
    )
    for name, few, many in (("warp", 512, 33_280), ("mujoco", 4, 64), ("pybullet", 2, 12)):
        if name != "warp" and not has(name):
            continue
        with tempfile.TemporaryDirectory() as cache:
            (first, second), _ = _child(name, few, cache)
            cold = first - second
        (first, second), least = _child(name, few)
        _, most = _child(name, many)
        memory = (most - least) / (many - few) / 1024
        table.rows.append((name, memory, cold, first - second))
    return table


BATCH = 2_000
CAST_COUNT = 500
V_MAX = 1.8
"""Speed of the paper's fastest casts [m/s]."""
LENGTH_ERROR_MAX = 0.01
"""Relative error above which a cable has visibly not kept its length [-]."""


def draw_params(count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return random parameters of cables, shape [count, 10].

    They are drawn by their logarithm, over five decades at most, so that light and soft cables come
    as often as others.

    Args:
        count: Number of cables.
        rng: Source of the draws.
    """
    low, high = np.array([PARAMS[name].bounds for name in PAPER_PARAMS]).T
    floor = np.maximum(low, high * 1e-5)
    values = floor * (high / floor) ** rng.uniform(size=(count, len(low)))
    return np.clip(values, low, high)


def robust(cable: Cable, duration: float, count: int, seed: int) -> Table:
    """Count worlds that fail with random parameters and the fastest casts.

    Worlds that move differently with other neighbours in their batch are counted, too.

    Args:
        cable: Geometry.
        duration: Duration of a rollout [s].
        count: Number of worlds.
        seed: Seed of the draws.
    """
    rng = np.random.default_rng(seed)
    values = draw_params(count, rng)
    paths = random_casts(CAST_COUNT, seed, Setup().with_motion(v_max=V_MAX))
    paths = paths[np.arange(count) % len(paths)]
    engine = EngineWarp()
    broken, unmarked, stretched, spoilt = 0, 0, 0, 0
    for start in range(0, count, BATCH):
        batch = np.arange(start, min(start + BATCH, count))

        def play(rows, **options):
            drawn = dict(zip(PAPER_PARAMS, values[rows].T, strict=True))
            return engine.rollout(
                cable.with_params(**drawn), paths[rows], duration=duration, **options
            )

        rollout = play(batch, record_nodes=True)
        assert rollout.nodes is not None
        whole = np.isfinite(rollout.nodes).all(axis=(1, 2, 3))
        broken += int((~rollout.finite).sum())
        unmarked += int((rollout.finite & ~whole).sum())
        edges = np.linalg.norm(np.diff(rollout.nodes, axis=2), axis=3)
        error = np.abs(edges * engine.segment_count / cable.length - 1.0).max(axis=(1, 2))
        stretched += int((error[whole] > LENGTH_ERROR_MAX).sum())
        # Every world again, among others than before.
        order = rng.permutation(len(batch))
        again = play(batch[order]).endpoint_xyz
        same = (again == rollout.endpoint_xyz[order]) | (
            np.isnan(again) & np.isnan(rollout.endpoint_xyz[order])
        )
        spoilt += int((~same.all(axis=(1, 2))).sum())
    table = Table(
        f"EngineWarp at its defaults, parameters over the whole allowed range, v_max {V_MAX:g} m/s",
        (
            "worlds",
            "non-finite",
            "[%]",
            "of these not marked",
            "other than among other worlds",
            f"a length off by {100 * LENGTH_ERROR_MAX:g} %",
        ),
        [],
    )
    table.rows.append((count, broken, 100.0 * broken / count, unmarked, spoilt, stretched))
    return table


FINE_SEGMENT_COUNT = 80
FINE_DT = 2.5e-4
SAMPLE_DT = 0.1
DATASET_SIZE = 36_000
"""Number of transitions in the paper's simulated dataset."""
COMMON = (20, 1e-3)
"""Segments and step at which engines are compared [-, s]."""
REPEATS = 3
"""Number of runs of EngineWarp, of which the fastest counts: other programs only slow it down."""
CUDA_GAIN = 1.05
"""Least gain of rate by a larger batch on a GPU at which one four times larger follows [-]."""
CUDA_TOLERANCE_PCT = 0.5
"""Largest median distance between landings on a GPU and on a CPU in single precision: the order of
rounding differs, and a cast is sensitive [% of cable length]."""

DISTINCT_COUNT = 1024
"""Number of different motions in a batch; with fewer, worlds would come to rest together."""
ROBUST_COUNT = 10_000
"""Number of worlds with random parameters."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Rollouts per second of every installed engine, with the accuracy reached.

    Attributes:
        cable: Name of a preset, or a YAML file.
        count: Number of random feasible actions, at v_max 1.5 m/s with psi.
        seed: Seed of the actions.
        duration: Duration of a rollout [s].
        world_count: Worlds that EngineWarp gets at once where its rate is measured; the actions are
            repeated.
        robust_count: Worlds with random parameters.
        convergence: Measure how MuJoCo's distance changes with its segments and step, too; minutes.
    """

    cable: str = "cable_1"
    count: int = 12
    seed: int = 0
    duration: float = 3.0
    world_count: int = 2048
    robust_count: int = ROBUST_COUNT
    convergence: bool = True


@dataclasses.dataclass(frozen=True)
class Job:
    """Motions that every engine plays, and the reference for the endpoint.

    Attributes:
        cable: Cable with its parameters.
        paths: Motions that every engine plays.
        all_paths: These and others like them, all different, for engines that play many at a time.
        duration: Duration of every rollout [s].
        reference: Positions of the endpoint [m], shape [motion, time, 3].
        times: Times of the reference [s], shape [time].
    """

    cable: Cable
    paths: GripPath
    all_paths: GripPath
    duration: float
    reference: NDArray[np.float64]
    times: NDArray[np.float64]

    def many(self, world_count: int) -> GripPath:
        """Return a number of motions, of which the first are those that every engine plays."""
        return self.all_paths[np.arange(world_count) % len(self.all_paths)]

    def play(self, engine: Any, paths: GripPath | None = None):
        """Return a rollout and the time that it took [s]."""
        start = time.perf_counter()
        rollout = engine.rollout(
            self.cable,
            self.paths if paths is None else paths,
            duration=self.duration,
            sample_dt=SAMPLE_DT,
        )
        return rollout, time.perf_counter() - start

    def errors(self, rollout) -> tuple[float, float, float, float, int]:
        """Return errors of a rollout, and its number of non-finite worlds.

        Returns:
            Median and 90th percentile along the track, the same at rest [% of cable length], and
            the number of worlds.
        """
        count = len(self.paths)
        xyz = rollout.endpoint_xyz[:count]
        # An engine whose step does not divide the interval samples at times of its own.
        track = np.empty((count, len(self.times), 3))
        for world in range(count):
            for axis in range(3):
                track[world, :, axis] = np.interp(self.times, rollout.times, xyz[world, :, axis])
        error = 100.0 * np.linalg.norm(track - self.reference, axis=-1) / self.cable.length
        fine = rollout.finite[:count]
        error = np.where(fine[:, None], error, np.nan)
        whole, rest = error[:, 1:], error[:, -1]
        values = [np.nanmedian(whole), np.nanpercentile(whole, 90)]
        values += [np.nanmedian(rest), np.nanpercentile(rest, 90)]
        return (*(round(float(v), 3) for v in values), int((~fine).sum()))


ERROR_COLUMNS = ("track median [%]", "track p90 [%]", "rest median [%]", "rest p90 [%]", "broken")


def prepare(args: Args) -> Job:
    cable = load_cable(args.cable)
    all_paths = random_casts(max(args.count, DISTINCT_COUNT), args.seed)
    paths = all_paths[: args.count]
    fine = EngineWarp(
        segment_count=FINE_SEGMENT_COUNT, dt=FINE_DT, precision="double", rest_speed=0.0
    )
    rollout = fine.rollout(cable, paths, duration=args.duration, sample_dt=SAMPLE_DT)
    return Job(cable, paths, all_paths, args.duration, rollout.endpoint_xyz, rollout.times)


def compared(job: Job, world_count: int) -> Table:
    """Compare every engine on one core, with ratios to MuJoCo and PyBullet."""
    segments, dt = COMMON
    many = job.many(world_count)

    def warp(what: str, segment_count: int, step: float, **options):
        engine = EngineWarp(segment_count=segment_count, dt=step, thread_count=1, **options)
        job.play(engine)
        plays = [job.play(engine, many) for _ in range(REPEATS)]
        seconds = min(seconds for _, seconds in plays)
        return (f"warp{what}", segment_count, step * 1e3, world_count / seconds, plays[0][0])

    rows = [
        warp(", to the end", segments, dt, rest_speed=0.0),
        warp("", segments, dt),
        warp(", double", segments, dt, precision="double"),
        warp(", defaults", DEFAULT_SEGMENT_COUNT, DEFAULT_DT),
    ]

    def other(what: str, engine):
        rollout, seconds = job.play(engine)
        rate = len(job.paths) / seconds
        return (what, engine.segment_count, engine.dt * 1e3, rate, rollout)

    mujoco_rate = pybullet_rate = float("nan")
    if has("mujoco"):
        from cablecast.engines.mujoco_ import EngineMujoco

        rows.append(other("mujoco", EngineMujoco(segments, dt, thread_count=1)))
        mujoco_rate = rows[-1][3]
        sliding = EngineMujoco(segments, dt, thread_count=1, rolling=False)
        rows.append(other("mujoco, sliding only", sliding))
    if has("pybullet"):
        from cablecast.engines.pybullet_ import EnginePybullet

        rows.append(other("pybullet", EnginePybullet()))
        pybullet_rate = rows[-1][3]
    table = Table(
        f"One core: whole rollouts of {job.duration:g} s per second, and distance from "
        f"{FINE_SEGMENT_COUNT} segments at {FINE_DT * 1e3:g} ms over {len(job.paths)} actions, "
        "in % of cable length",
        (
            "engine",
            "segments",
            "step [ms]",
            "rollouts/s",
            "x mujoco",
            "x pybullet",
            *ERROR_COLUMNS,
        ),
        [],
    )
    for what, segment_count, step, rate, rollout in rows:
        ratios = (rate / mujoco_rate, rate / pybullet_rate)
        table.rows.append((what, segment_count, step, rate, *ratios, *job.errors(rollout)))
    return table


def agreement(job: Job) -> Table:
    """Measure MuJoCo's distance from the fine EngineWarp as its segments and step shrink."""
    from cablecast.engines.mujoco_ import EngineMujoco

    table = Table(
        "MuJoCo against the fine EngineWarp, in % of cable length",
        ("rolls", "segments", "step [ms]", *ERROR_COLUMNS),
        [],
    )
    for rolling in (False, True):
        for segments in (20, 40):
            for dt in (1e-3, 2.5e-4):
                engine = EngineMujoco(segments, dt, rolling=rolling)
                errors = job.errors(job.play(engine)[0])
                table.rows.append((str(rolling), segments, dt * 1e3, *errors))
    return table


def scaling(job: Job, world_count: int) -> Table:
    """Measure EngineWarp at its defaults over threads."""
    cores, paths = core_count(), job.many(world_count)
    counts = sorted({1, 2, cores, *[2**k for k in range(1, 8) if 2**k <= cores]})

    table = Table(
        f"EngineWarp at its defaults over threads, {world_count} worlds",
        ("threads", "rollouts/s", "x one thread", f"{DATASET_SIZE} transitions [s]"),
        [],
    )
    for thread_count in counts:
        engine = EngineWarp(thread_count=thread_count)
        job.play(engine)
        value = world_count / min(job.play(engine, paths)[1] for _ in range(REPEATS))
        first = table.rows[0][1] if table.rows else value
        table.rows.append((thread_count, value, value / first, DATASET_SIZE / value))
    return table


def cuda(job: Job) -> Iterator[Table]:
    """Measure EngineWarp on the first CUDA device, with its landings against those of the CPU."""
    import warp as wp

    if not wp.is_cuda_available():
        return
    device = wp.get_device("cuda")
    cpu = job.play(EngineWarp(rest_speed=0.0))[0]
    engine = EngineWarp(device="cuda", rest_speed=0.0)
    first, seconds = job.play(engine)
    distance = np.linalg.norm(first.endpoint_xy[:, -1] - cpu.endpoint_xy[:, -1], axis=-1)
    median = float(100.0 * np.median(distance) / job.cable.length)
    table = Table(
        f"EngineWarp at its defaults on {device.name}: first launch {seconds:.1f} s; landings "
        f"{median:.3g} % (median) from the CPU's, allowed {CUDA_TOLERANCE_PCT} %",
        ("worlds", "rollouts/s", "memory per world [KiB]"),
        [],
    )
    worlds, rate, last = 1024, 0.0, 0.0
    while rate >= CUDA_GAIN * last:
        paths = job.many(worlds)
        last, rate = rate, worlds / min(job.play(engine, paths)[1] for _ in range(REPEATS))
        # The largest batch so far is this one.
        used = wp.get_mempool_used_mem_high(device) / worlds / 1024
        table.rows.append((worlds, rate, used))
        worlds *= 4
    yield table


def main(args: Args) -> Iterator[Table]:
    job = prepare(args)
    yield compared(job, args.world_count)
    if args.convergence and has("mujoco"):
        yield agreement(job)
    yield scaling(job, args.world_count)
    yield footprint()
    yield robust(job.cable, job.duration, args.robust_count, args.seed)
    yield from cuda(job)
