"""Times on this computer: from calibration casts to the first aimed one, and of a Ray cluster.

preparation: the rig makes its casts before the clock starts. Then each part is timed: the fit with
its six simulators, the simulated casts and the training on them, and the choice of the
first cast. A short warm-up run compiles missing kernels first; --cold skips it.

cluster: simulates the same dataset with one thread here, then with one and with two Ray workers of
one core. The clock runs from the first motion that is sent to the last shard that is written;
starting the cluster is timed by itself. Files must be equal to the bit.
"""

import dataclasses
import itertools
import pathlib
import tempfile
import time
from collections.abc import Iterator

import cablecast as cc
from benchmarks.places import open_rig
from benchmarks.result import Table
from cablecast.cli.progress import console_progress
from cablecast.data.simulate import SIMULATED_COUNT, simulate_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.files import core_count
from cablecast.runs.progress import Progress
from cablecast.setup import Setup

PREPARATION_COLUMNS = (
    "cable",
    "fit [s]",
    "casts and model [s]",
    "first choice [s]",
    "together [s]",
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PreparationArgs:
    """Time from calibration casts to the first aimed one."""

    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    """Cables."""
    lab: int = 0
    """Seed of the laboratory."""
    calibration: int = cc.AimConfig.calibration_count
    """Casts before the first aimed one."""
    count: int = cc.AimConfig.simulated_count
    """Simulated casts that the model is trained on."""
    epochs: int = cc.AimConfig.epochs
    """Largest number of passes over them."""
    target: tuple[float, float] = (1.05, 15.0)
    """Target of the first aimed cast: distance from the base [m] and angle to the right [deg]."""
    device: str = "cpu"
    """Device that simulates and trains: "cpu" or "cuda"."""
    cold: bool = False
    """Skip the warm-up run: times then include the compilation of missing kernels."""


def time_preparation(cable: str, args: PreparationArgs) -> tuple[float, ...]:
    """Return the times of the parts and of all [s]."""
    r, theta_deg = args.target
    with (
        open_rig("virtual", args.lab, cc.Setup(cable=cable)) as rig,
        console_progress() as progress,
        tempfile.TemporaryDirectory() as out,
    ):
        casts = cc.collect(rig, count=args.calibration, sampling="spread", progress=progress)
        moments = [time.perf_counter()]
        tuned = cc.tune(casts, validation_count=0, progress=progress)
        moments.append(time.perf_counter())
        session = cc.prepare_aim(
            rig,
            cc.AimConfig(simulated_count=args.count, epochs=args.epochs, device=args.device),
            casts=casts,
            tuned=tuned,
            out=out,
            progress=progress,
        )
        moments.append(time.perf_counter())
        session.propose(r=r, theta_deg=theta_deg)
        moments.append(time.perf_counter())
    parts = [after - before for before, after in itertools.pairwise(moments)]
    return (*parts, sum(parts))


def preparation(args: PreparationArgs) -> Iterator[Table]:
    """Yield the times of each part."""
    if not args.cold:
        few = dataclasses.replace(args, count=200, epochs=2)
        for cable in args.cables:
            time_preparation(cable, few)
    rows = [
        (cable, *(f"{value:.0f}" for value in time_preparation(cable, args)))
        for cable in args.cables
    ]
    title = f"From {args.calibration} casts to the first aimed one, {core_count()} cores"
    if args.device != "cpu":
        title += f" and {args.device}"
    yield Table(title=title, columns=PREPARATION_COLUMNS, rows=rows)


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
            ray.shutdown()  # pyright: ignore[reportPossiblyUnboundVariable]
    return started, marks[-1] - marks[0]


def check_equal(one: pathlib.Path, other: pathlib.Path) -> None:
    """Stop if the rows of two datasets differ in a bit."""
    for file in sorted(one.rglob("*.parquet")):
        if file.read_bytes() != (other / file.relative_to(one)).read_bytes():
            raise SystemExit(f"{file.name} differs")
