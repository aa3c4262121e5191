"""Error at targets against the number of real casts, for every way to use them.

For each rig, laboratory, cable and number of casts, the simulator is fitted to the casts, a model
learns from simulated ones, and each target is cast at some times in turn. Every target begins anew
with the same casts, so that a first try after five casts is a first try after five casts. A cast
without a landing counts as a miss of 100 %.

Each piece of work is kept in --out: the same command goes on where it was stopped, and adds what a
larger one asks for. Medians come with the interval that holds 90 % of 2,000 bootstrap draws.
"""

import dataclasses
import pathlib
from typing import Any

import numpy as np

from benchmarks.common import Table
from benchmarks.places import (
    FINE_TUNING_MIN,
    METHODS,
    MISSED_PCT,
    Found,
    Place,
    PlaceArgs,
    some_targets,
    try_count,
)
from cablecast.cli.progress import console_progress
from cablecast.errors import InputError
from cablecast.evaluation.evaluate import difference_interval, median_interval
from cablecast.rigs.virtual.sensing import CameraErrorModel
from cablecast.runs.progress import ProgressCallback

COLUMNS = ("rig", "cable", "casts", "method", "targets", "try", "median", "q1", "q3", "missed")
REGION_COLUMNS = ("rig", "cable", "casts", "method", "try", "landings", "in 50 %", "in 90 %")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args(PlaceArgs):
    """Error at targets against the number of real casts."""

    rigs: tuple[str, ...] = ("virtual", "strange")
    """Rigs, some of virtual, strange, scattering, even, patchy, engine, example."""
    labs: tuple[int, ...] = (0, 1, 2)
    """Seeds of the laboratories."""
    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    """Cables."""
    methods: tuple[str, ...] = METHODS
    """Methods, some of aim, full gain, one simulator, simulated, fine-tuning, paper."""
    targets: int = 200
    """Targets of each rig and cable, shared among the laboratories."""
    quick: bool = False
    """Use the strange rig, one laboratory, one cable, 8 targets, and small models only."""
    figure: pathlib.Path | None = None
    """Picture of the misses to write: against tries, or against several numbers of casts."""

    @property
    def shares(self) -> list[int]:
        """Number of targets in each laboratory."""
        count = len(self.labs)
        return [len(range(place, self.targets, count)) for place in range(count)]


QUICK: dict[str, Any] = {
    "rigs": ("strange",),
    "labs": (0,),
    "cables": ("cable_1",),
    "counts": (2, 5),
    "methods": ("aim", "simulated"),
    "targets": 8,
    "tries": 3,
    "simulated": 1500,
    "epochs": 15,
    "candidates": 2000,
}


def run(args: Args, report: ProgressCallback) -> Found:
    """Return the results by rig, cable, number of casts and method."""
    found: Found = {}
    for name in args.rigs:
        for cable in args.cables:
            for lab, own in zip(args.labs, args.shares, strict=True):
                here = Place(args, name, lab, cable, report)
                for count in args.counts:
                    for method in args.methods:
                        if count < {"fine-tuning": FINE_TUNING_MIN, "paper": 2}.get(method, 0):
                            continue
                        rows = here.results(method, count, own)
                        found.setdefault((name, cable, count, method), []).extend(rows)
    return found


def print_misses(found: Found, tries: int, which: str = "") -> None:
    """Print the misses of every try."""
    rows_of_misses: list[tuple] = []
    for (name, cable, count, method), rows in found.items():
        misses = np.array([row["miss_pct"] for row in rows])
        for number in range(try_count(method, tries)):
            values = misses[:, number]
            median, low, high = median_interval(values)
            q1, q3 = np.quantile(values, (0.25, 0.75))
            lost = 100.0 * np.mean(values >= MISSED_PCT)
            spread = f"{median:.1f} ({low:.1f} to {high:.1f})"
            quartiles = (f"{q1:.1f}", f"{q3:.1f}", f"{lost:.1f}")
            row = (name, cable, count, method, len(values), number + 1, spread, *quartiles)
            rows_of_misses.append(row)
    title = "Miss of each try in % of cable length; missed: no landing, or a length off or more [%]"
    print(Table(title=title + which, columns=COLUMNS, rows=rows_of_misses))


def print_regions(found: Found, tries: int) -> None:
    """Print how often the regions held that were stated before each try."""
    rows_of_regions: list[tuple] = []
    for (name, cable, count, method), rows in found.items():
        if method not in ("aim", "one simulator"):
            continue
        for number in range(tries):
            shares = [row["share"][number] for row in rows]
            known = np.array([share for share in shares if share is not None])
            inside = [100.0 * np.mean(known < share) for share in (0.5, 0.9)]
            found_in = (f"{share:.0f}" for share in inside)
            rows_of_regions.append((name, cable, count, method, number + 1, len(known), *found_in))
    title = "Landings within the regions that were stated before the cast [%]"
    print(Table(title=title, columns=REGION_COLUMNS, rows=rows_of_regions))


def print_differences(found: Found) -> None:
    """Print how much more other methods miss than aim, at the same targets."""
    rows = []
    for (name, cable, count, method), others in found.items():
        own = found.get((name, cable, count, "aim"))
        if method == "aim" or own is None:
            continue
        for number in range(try_count(method, len(own[0]["miss_pct"]))):
            theirs, ours = ([row["miss_pct"][number] for row in of] for of in (others, own))
            middle, low, high = difference_interval(theirs, ours)
            spread = f"{middle:+.1f} ({low:+.1f} to {high:+.1f})"
            rows.append((name, cable, count, method, len(own), number + 1, spread))
    if rows:
        title = "Median miss less that of aim at the same targets [% of cable length]"
        columns = ("rig", "cable", "casts", "method", "targets", "try", "difference")
        print(Table(title=title, columns=columns, rows=rows))


def print_blind(found: Found, args: Args) -> None:
    """Print how many targets the camera of the virtual rig is blind at, and misses without them."""
    xy = np.concatenate(
        [some_targets(own, lab) for lab, own in zip(args.labs, args.shares, strict=True)]
    )
    blind = CameraErrorModel.load().sight.is_blind_at(xy)
    print(f"The virtual rig's camera is blind at {blind.sum()} of these {len(xy)} targets.\n")
    if not blind.any():
        return
    seen = {
        key: [row for row, unseen in zip(rows, blind, strict=True) if not unseen]
        for key, rows in found.items()
        if key[0] == "virtual"
    }
    print_misses(seen, args.tries, ", at the others")


def main(args: Args) -> int:
    """Run the benchmark and print its tables."""
    args = dataclasses.replace(args, **QUICK) if args.quick else args
    if unknown := sorted(set(args.methods) - set(METHODS)):
        raise InputError(f"unknown method {unknown[0][:40]!r}: one of {', '.join(METHODS)}")
    with console_progress() as progress:
        found = run(args, progress)
    print_misses(found, args.tries)
    print_regions(found, args.tries)
    if "virtual" in args.rigs:
        print_blind(found, args)
    print_differences(found)
    if args.figure is not None:
        from benchmarks.casts_figures import draw

        draw(found, args.figure)
    return 0
