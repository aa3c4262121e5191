"""Times on this computer: waits of a person who aims, and of a Ray cluster.

waits: what a person waits for while aiming: the check, the fit with its six simulators, the
simulated casts, the choice of the first cast and of each further one, what is learned from a
landing, and the session when it is opened again. The rig's own time is left out. A short warm-up
run compiles missing kernels first; --cold skips it.

cluster: simulates the same dataset with one thread here, then with one and with two Ray workers of
one core. The clock runs from the first motion that is sent to the last shard that is written;
starting the cluster is timed by itself. Files must be equal to the bit.
"""

import contextlib
import dataclasses
import pathlib
import tempfile
import time
from collections.abc import Iterator
from typing import Literal

import numpy as np

import cablecast as cc
from benchmarks.places import open_rig, random_targets
from benchmarks.result import Table
from cablecast.cli.progress import console_progress
from cablecast.data.simulate import SIMULATED_COUNT, simulate_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.files import core_count
from cablecast.runs.progress import Progress
from cablecast.setup import Setup


@dataclasses.dataclass(frozen=True, kw_only=True)
class WaitsArgs:
    """What a person waits for while aiming, in seconds of the clock and of the processor."""

    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    """Cables."""
    rig: str = "virtual"
    """Rig, as in `python -m benchmarks casts`."""
    lab: int = 0
    """Seed of the laboratory."""
    targets: int = 12
    """Targets of the session."""
    tries: int = 2
    """Casts at each target."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Device that simulates: "cpu" or "cuda"."""
    cold: bool = False
    """Skip the warm-up run: times then include the compilation of missing kernels."""


def time_session(cable: str, args: WaitsArgs) -> dict[str, list[tuple[float, float]]]:
    """Prepare a session, aim, and open it again; the rig's own time is not counted.

    Returns:
        Seconds of the clock and of all cores of this process, by what was waited for.
    """
    seconds: dict[str, list[tuple[float, float]]] = {}

    @contextlib.contextmanager
    def timed(name: str) -> Iterator[None]:
        start = time.perf_counter(), time.process_time()
        yield
        took = time.perf_counter() - start[0], time.process_time() - start[1]
        seconds.setdefault(name, []).append(took)

    setup = cc.Setup(cable=cable)
    config = cc.AimConfig(
        within_pct=0.01, tries=args.tries, force=True, refit=False, device=args.device
    )
    with (
        open_rig(args.rig, args.lab, setup) as rig,
        console_progress() as progress,
        tempfile.TemporaryDirectory() as out,
    ):
        with timed("check"):
            cc.check(setup, progress=progress)
        casts = cc.collect(
            rig,
            count=config.calibration_count,
            sampling="spread",
            pace=config.pace,
            progress=progress,
        )

        def prepare(tuned: cc.Tuned | None = None) -> cc.AimSession:
            return cc.prepare_aim(rig, config, casts=casts, tuned=tuned, out=out, progress=progress)

        with timed("fit"):
            tuned = cc.tune(casts, validation_count=0, out=f"{out}/tune", progress=progress)
        with timed("simulated casts"):
            session = prepare(tuned)
        session.pilot(rig, progress)
        for index, target in enumerate(random_targets(args.targets, args.lab)):
            for number in range(args.tries):
                with timed("a try" if index or number else "first plan"):
                    proposal = session.propose(target)
                track = session.play(rig, proposal.trajectory, proposal.number)
                with timed("a landing"):
                    session.observe(proposal, track)
        with timed(f"opening it with {len(session.casts)} casts"):
            prepare()
    return seconds


def waits(args: WaitsArgs) -> Iterator[Table]:
    """Yield the times of each part."""
    if not args.cold:
        for cable in args.cables:
            time_session(cable, dataclasses.replace(args, targets=1, tries=1))
    columns, rows = ["wait"], {}
    for cable in args.cables:
        columns += [f"{cable} [s]", "CPU [s]"]
        for name, seconds in time_session(cable, args).items():
            medians = np.median(seconds, axis=0)
            rows.setdefault(name, []).extend(f"{value:.2f}" for value in medians)
    title = f"Waits, medians where there are several, {core_count()} cores"
    if args.device != "cpu":
        title += f" and {args.device}"
    table = [(name, *cells) for name, cells in rows.items()]
    yield Table(title=title, columns=tuple(columns), rows=table)


@dataclasses.dataclass
class ClusterArgs:
    count: int = SIMULATED_COUNT
    """Simulated casts."""
    workers: tuple[int, ...] = (1, 2)
    """Numbers of workers with one core each."""
    rounds: int = 1
    """Rounds over all of them; the fastest of each is printed."""


def cluster(args: ClusterArgs) -> Iterator[Table]:
    engine = EngineWarp(thread_count=1)
    # Kernels are compiled before any clock runs.
    with tempfile.TemporaryDirectory() as folder:
        simulate_dataset(folder, Setup(), None, engine, count=16)
    seconds: dict[int, list[float]] = {}
    starts: dict[int, float] = {}
    with tempfile.TemporaryDirectory(prefix="cablecast-") as name:
        root = pathlib.Path(name)
        for number in range(args.rounds):
            for workers in (0, *args.workers):
                folder = root / f"{number}-{workers}"
                started, took = time_cluster(folder, engine, args.count, workers)
                starts[workers] = started
                seconds.setdefault(workers, []).append(took)
                print(f"round {number}, {workers} workers: {took:.1f} s", flush=True)
                check_equal(root / "0-0", folder)
    alone = min(seconds[0])
    rows = []
    for workers, times in seconds.items():
        who = f"Ray, {workers} workers" if workers else "this process, one thread"
        rate = args.count / min(times)
        cells = (f"{starts[workers]:.1f}", f"{min(times):.1f}", f"{rate:.0f}")
        rows.append((who, *cells, f"{alone / min(times):.2f}"))
    columns = ("who", "start [s]", "time [s]", "casts/s", "x one thread")
    yield Table(title=f"{args.count} casts of cable_1", columns=columns, rows=rows)


def time_cluster(
    folder: pathlib.Path, engine: EngineWarp, count: int, workers: int
) -> tuple[float, float]:
    """Return the time [s] that a cluster takes to start, and that of simulating with it."""
    start = time.perf_counter()
    if workers:
        import ray

        ray.init(num_cpus=workers, include_dashboard=False, log_to_driver=False)
    started = time.perf_counter() - start
    marks: list[float] = []

    def mark(progress: Progress) -> None:
        marks.append(time.perf_counter())

    try:
        where = "ray" if workers else "local"
        simulate_dataset(folder, Setup(), None, engine, count=count, workers=where, progress=mark)
    finally:
        if workers:
            ray.shutdown()
    return started, marks[-1] - marks[0]


def check_equal(one: pathlib.Path, other: pathlib.Path) -> None:
    """Stop if the rows of two datasets differ in a bit."""
    for file in sorted(one.rglob("*.parquet")):
        if file.read_bytes() != (other / file.relative_to(one)).read_bytes():
            raise SystemExit(f"{file.name} differs")
