"""Throughput of a Ray cluster on this machine beside one thread of this process.

    python -m benchmarks cluster

Simulates the same dataset with one thread here, then with one and with two workers of one core.
The clock runs from the first motion that is sent to the last shard that is written; starting the
cluster is timed by itself. Files must be equal to the bit.
"""

import dataclasses
import pathlib
import tempfile
import time

from benchmarks.common import Table
from cablecast.data.simulate import SIMULATED_COUNT, simulate_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.runs.progress import Progress
from cablecast.setup import Setup


@dataclasses.dataclass
class Args:
    count: int = SIMULATED_COUNT
    """Simulated casts."""
    workers: tuple[int, ...] = (1, 2)
    """Numbers of workers with one core each."""
    rounds: int = 1
    """Rounds over all of them; the fastest of each is printed."""


def main(args: Args) -> int:
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
                started, took = timed(folder, engine, args.count, workers)
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
    print(Table(title=f"{args.count} casts of cable_1", columns=columns, rows=rows))
    return 0


def timed(
    folder: pathlib.Path, engine: EngineWarp, count: int, workers: int
) -> tuple[float, float]:
    """Return the time [s] that a cluster takes to start, and that of simulating with it."""
    began = time.perf_counter()
    if workers:
        import ray

        ray.init(num_cpus=workers, include_dashboard=False, log_to_driver=False)
    started = time.perf_counter() - began
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
