"""Time from five casts on a cable to the first aimed one, on this computer.

The rig makes its casts before the clock starts. Then each part is timed: the fit with its six
simulators, the simulated casts and the model that learns from them, and the choice of the first
cast. A short warm-up run compiles missing kernels first; --cold skips it.
"""

import dataclasses
import itertools
import tempfile
import time

import cablecast as cc
from benchmarks.common import Table
from benchmarks.places import open_rig
from cablecast.cli.progress import console_progress
from cablecast.files import core_count

COLUMNS = ("cable", "fit [s]", "casts and model [s]", "first choice [s]", "together [s]")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Time from a few casts to the first aimed one."""

    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    """Cables."""
    lab: int = 0
    """Seed of the laboratory."""
    calibration: int = cc.AimConfig.calibration_count
    """Casts before the first aimed one."""
    count: int = cc.AimConfig.simulated_count
    """Simulated casts that the model learns from."""
    epochs: int = cc.AimConfig.epochs
    """Largest number of passes over them."""
    target: tuple[float, float] = (1.05, 15.0)
    """Target of the first aimed cast: distance from the base [m] and angle to the right [deg]."""
    device: str = "cpu"
    """Device that simulates and trains: "cpu" or "cuda"."""
    cold: bool = False
    """Skip the warm-up run: times then include the compilation of missing kernels."""


def timed(cable: str, args: Args) -> tuple[float, ...]:
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


def main(args: Args) -> int:
    """Run the benchmark and print its table."""
    if not args.cold:
        few = dataclasses.replace(args, count=200, epochs=2)
        for cable in args.cables:
            timed(cable, few)
    rows = [(cable, *(f"{value:.0f}" for value in timed(cable, args))) for cable in args.cables]
    title = f"From {args.calibration} casts to the first aimed one, {core_count()} cores"
    if args.device != "cpu":
        title += f" and {args.device}"
    print(Table(title=title, columns=COLUMNS, rows=rows))
    return 0
