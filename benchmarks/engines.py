"""Speed of every engine on the same actions, each with the accuracy it reaches.

All rates are whole rollouts of the same duration, on one core or on a graphics card, after kernels
are compiled and models are built. Accuracy is the distance of the endpoint from that of a fine
EngineWarp in double precision, along the whole track and at its end.
"""

import dataclasses
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import has, random_casts
from benchmarks.result import Table
from cablecast.cable import Cable, load_cable
from cablecast.engines.warp_ import EngineWarp
from cablecast.engines.warp_.engine import DEFAULT_DT, DEFAULT_SEGMENT_COUNT
from cablecast.motion.grip_path import GripPath

FINE_SEGMENT_COUNT = 80
FINE_DT = 2.5e-4
SAMPLE_DT = 0.1
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
    """

    cable: str = "cable_1"
    count: int = 12
    seed: int = 0
    duration: float = 3.0
    world_count: int = 2048


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
    yield from cuda(job)
