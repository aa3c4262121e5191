"""Speed of every engine on the same actions, each with the accuracy it reaches.

All rates are whole rollouts of the same duration on one core unless a row says otherwise, after
kernels are compiled and models are built; what that takes is a table of its own. Accuracy is the
distance of the endpoint from that of a fine EngineWarp in double precision, along the whole track
and at its end.
"""

import dataclasses
import importlib.util
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Table, random_actions, write_json
from cablecast.cable import Cable, CableParams, load_cable
from cablecast.engines.warp_ import EngineWarp
from cablecast.engines.warp_.engine import DEFAULT_DT, DEFAULT_SEGMENT_COUNT
from cablecast.machine import core_count
from cablecast.motion.action import MotionConfig
from cablecast.motion.cast import cast_grip_paths
from cablecast.motion.grip_path import GripPath
from cablecast.workspace import Workspace

FINE_SEGMENT_COUNT = 80
FINE_DT = 2.5e-4
SAMPLE_DT = 0.1
DATASET_SIZE = 36_000
"""Transitions of the paper's simulated dataset."""
COMMON = (20, 1e-3)
"""Segments and step at which engines are compared [-, s]."""
REPEATS = 3
"""The best of so many counts for EngineWarp: other programs only ever make it slower."""
CUDA_TOLERANCE_PCT = 0.5
"""How far the median landing on a GPU may be from that on a CPU in single precision: the order of
rounding differs, and a cast is sensitive [% of cable length]."""

DISTINCT_COUNT = 1024
"""How many different motions there are in a batch, or else worlds would come to rest together."""
ROBUST_COUNT = 10_000
ROBUST_BATCH = 2_000
ROBUST_V_MAX = 1.8
"""The fastest casts of the paper [m/s]."""
LENGTH_ERROR_MAX = 0.01
"""Above this a cable has visibly not kept its length [-]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Rollouts per second of every installed engine, with the accuracy reached.

    Attributes:
        cable: Which preset, or a YAML file.
        count: How many random feasible actions, at v_max 1.5 m/s with psi.
        seed: Of the actions.
        duration: Of a rollout [s].
        world_count: How many worlds EngineWarp gets at once where its rate is measured; the actions
            are repeated.
        convergence: Also measure how MuJoCo's distance changes with its segments and step; minutes.
        json: Also write the figures to this file.
    """

    cable: str = "cable_1"
    count: int = 12
    seed: int = 0
    duration: float = 3.0
    world_count: int = 2048
    convergence: bool = True
    json: pathlib.Path | None = None


def has(library: str) -> bool:
    return importlib.util.find_spec(library) is not None


@dataclasses.dataclass(frozen=True)
class Job:
    """The motions that every engine plays, and where the endpoint should go.

    Attributes:
        cable: The cable.
        paths: The motions.
        all_paths: These and others like them, all different, for engines that play many at a time.
        duration: Of every rollout [s].
        reference: Positions of the endpoint [m], shape [motion, time, 3].
        times: Theirs [s], shape [time].
    """

    cable: Cable
    paths: GripPath
    all_paths: GripPath
    duration: float
    reference: NDArray[np.float64]
    times: NDArray[np.float64]

    def many(self, world_count: int) -> GripPath:
        """As many motions, of which the first are those that every engine plays."""
        return self.all_paths[np.arange(world_count) % len(self.all_paths)]

    def play(self, engine: Any, paths: GripPath | None = None):
        """A rollout and the seconds that it took."""
        start = time.perf_counter()
        rollout = engine.rollout(
            self.cable,
            self.cable.params,
            self.paths if paths is None else paths,
            duration=self.duration,
            sample_dt=SAMPLE_DT,
        )
        return rollout, time.perf_counter() - start

    def errors(self, rollout) -> tuple[float, float, float, float, int]:
        """Median and p90 along the track and at rest [% of cable length], and non-finite worlds."""
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
    actions = random_actions(max(args.count, DISTINCT_COUNT), args.seed)
    all_paths = cast_grip_paths(actions, MotionConfig(), Workspace())
    paths = all_paths[: args.count]
    fine = EngineWarp(
        segment_count=FINE_SEGMENT_COUNT, dt=FINE_DT, precision="double", rest_speed=0.0
    )
    rollout = fine.rollout(cable, cable.params, paths, duration=args.duration, sample_dt=SAMPLE_DT)
    return Job(cable, paths, all_paths, args.duration, rollout.endpoint_xyz, rollout.times)


def compared(job: Job, world_count: int) -> Table:
    """Every engine on one core, with ratios to MuJoCo and PyBullet."""
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
    """How MuJoCo approaches the fine EngineWarp as its segments and step shrink."""
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


def scaling(job: Job, world_count: int) -> list[Table]:
    """EngineWarp at its defaults over threads, worlds and segments."""
    cores = core_count()
    counts = sorted({1, 2, cores, *[2**k for k in range(1, 8) if 2**k <= cores]})

    def rate(worlds: int, **options) -> float:
        engine = EngineWarp(**options)
        paths = job.many(worlds)
        job.play(engine)
        return worlds / min(job.play(engine, paths)[1] for _ in range(REPEATS))

    threads = Table(
        f"EngineWarp at its defaults over threads, {world_count} worlds",
        ("threads", "rollouts/s", "x one thread", f"{DATASET_SIZE} transitions [s]"),
        [],
    )
    for thread_count in counts:
        value = rate(world_count, thread_count=thread_count)
        first = threads.rows[0][1] if threads.rows else value
        threads.rows.append((thread_count, value, value / first, DATASET_SIZE / value))
    worlds = Table(
        "EngineWarp at its defaults over worlds, one thread", ("worlds", "rollouts/s"), []
    )
    for count in (1, 8, 64, 512, 4096):
        worlds.rows.append((count, rate(count, thread_count=1)))
    segments = Table(
        f"EngineWarp over segments, one thread, {DEFAULT_DT * 1e3:g} ms, {world_count} worlds",
        ("segments", "rollouts/s", "node steps/s"),
        [],
    )
    for count in (10, 20, 40, 80, 160):
        value = rate(world_count, thread_count=1, segment_count=count)
        segments.rows.append((count, value, value * count * job.duration / DEFAULT_DT))
    return [threads, worlds, segments]


# Runs in a process of its own: peak memory and compilation can be measured once in a process.
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
    engine.rollout(cable, cable.params, path, duration=0.1)
    seconds.append(time.perf_counter() - start)
status = pathlib.Path("/proc/self/status")
peak = float("nan")
if status.exists():
    # Unlike ru_maxrss this does not count what the parent process had when it started us.
    peak = 1024.0 * float(status.read_text().split("VmHWM:")[1].split()[0])
print(json.dumps([seconds, peak]))
"""


def _child(name: str, worlds: int, cache: str | None = None) -> tuple[list[float], float]:
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
    """Memory that each world takes, and the time before the first step."""
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


def cuda(job: Job) -> Table | None:
    """EngineWarp on the first CUDA device, with its landings against those of the CPU."""
    import warp as wp

    if not wp.is_cuda_available():
        return None
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
    worlds = 1024
    while True:
        free = device.free_memory
        try:
            seconds = job.play(engine, job.many(worlds))[1]
        except (RuntimeError, MemoryError):
            break
        used = max(0, free - device.free_memory) / worlds / 1024
        table.rows.append((worlds, worlds / seconds, used))
        worlds *= 4
        if worlds > 2**22:
            break
    return table


def robust(job: Job, count: int, seed: int) -> Table:
    """Worlds with parameters drawn over the whole allowed range, and the fastest casts.

    Parameters are drawn by their logarithm, over five decades at most, so that light and soft
    cables come as often as others. Beside the worlds that become non-finite stand those whose
    neighbours in the batch fared otherwise than in another batch.
    """
    from cablecast.cable import PARAM_BOUNDS

    rng = np.random.default_rng(seed)
    low, high = np.array(list(PARAM_BOUNDS.values())).T
    floor = np.maximum(low, high * 1e-5)
    values = floor * (high / floor) ** rng.uniform(size=(count, len(low)))
    values = np.clip(values, low, high)
    config = MotionConfig(v_max=ROBUST_V_MAX)
    paths = cast_grip_paths(random_actions(500, seed, config), config, Workspace())
    paths = paths[np.arange(count) % len(paths)]
    engine = EngineWarp()
    broken, unmarked, stretched, spoilt = 0, 0, 0, 0
    for start in range(0, count, ROBUST_BATCH):
        batch = np.arange(start, min(start + ROBUST_BATCH, count))

        def play(rows, **options):
            params = CableParams.from_array(values[rows])
            return engine.rollout(
                job.cable,
                params,
                paths[rows],
                duration=job.duration,
                sample_dt=SAMPLE_DT,
                **options,
            )

        rollout = play(batch, record_nodes=True)
        assert rollout.nodes is not None
        whole = np.isfinite(rollout.nodes).all(axis=(1, 2, 3))
        broken += int((~rollout.finite).sum())
        unmarked += int((rollout.finite & ~whole).sum())
        edges = np.linalg.norm(np.diff(rollout.nodes, axis=2), axis=3)
        error = np.abs(edges * engine.segment_count / job.cable.length - 1.0).max(axis=(1, 2))
        stretched += int((error[whole] > LENGTH_ERROR_MAX).sum())
        # Every world again, among others than before.
        order = rng.permutation(len(batch))
        again = play(batch[order]).endpoint_xyz
        same = (again == rollout.endpoint_xyz[order]) | (
            np.isnan(again) & np.isnan(rollout.endpoint_xyz[order])
        )
        spoilt += int((~same.all(axis=(1, 2))).sum())
    table = Table(
        f"EngineWarp at its defaults, parameters over the whole allowed range, v_max "
        f"{ROBUST_V_MAX:g} m/s",
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


def main(args: Args) -> None:
    job = prepare(args)
    tables = []

    def show(table: Table | None) -> None:
        if table is not None:
            print(table, flush=True)
            tables.append(table)

    show(compared(job, args.world_count))
    if args.convergence and has("mujoco"):
        show(agreement(job))
    for table in scaling(job, args.world_count):
        show(table)
    show(footprint())
    show(robust(job, ROBUST_COUNT, args.seed))
    show(cuda(job))
    write_json(args.json, tables)
