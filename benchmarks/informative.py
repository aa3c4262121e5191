"""Calibration casts that teach most, beside random ones and those that `aim` begins with.

Casts that teach most (`collect --sampling informative`) are chosen before any cast, from what is
believed of the cable; or the first two are, and each later one after a fit to those before it, from
its posterior. Fits to these casts, to random ones, and to casts whose landings are spread over the
table, which `aim` makes, are compared on other, random casts of the rig.
"""

import dataclasses
import pathlib
import tempfile

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.common import Table
from benchmarks.places import open_rig
from cablecast.cli.progress import console_progress
from cablecast.data.dataset import Dataset
from cablecast.data.record import collect_dataset
from cablecast.data.store import CastStore
from cablecast.evaluation.evaluate import median_interval
from cablecast.motion.feasibility import feasible_uniform
from cablecast.pipeline.engine import make_engine
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.progress import Progress, ProgressCallback
from cablecast.runs.workers import LOCAL
from cablecast.tuning.tracks import MeasuredTracks, TrackObjective

COLUMNS = ("casts", "chosen", "fits", "other casts", "median", "q1", "q3", "better than random")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Fits to the casts that teach most, to random ones, and to spread ones."""

    rig: str = "strange"
    """Rig: virtual, strange, scattering, even, patchy, engine or example."""
    labs: tuple[int, ...] = (0, 1, 2)
    """Seeds of the laboratories."""
    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    """Cables."""
    counts: tuple[int, ...] = (2, 3, 5)
    """Casts to fit."""
    others: int = 40
    """Random casts to measure the fits with."""
    repeats: int = 2
    """Draws of the random casts."""
    workers: str = LOCAL
    """Who simulates for the fits: local, ray, or ray:ADDRESS."""
    out: pathlib.Path | None = None
    """Folder that keeps casts and fits and lets a stopped run go on."""


def main(args: Args) -> int:
    """Run the benchmark and print its table."""
    errors: dict[tuple[int, str], list[NDArray[np.float64]]] = {}
    with tempfile.TemporaryDirectory() as temporary, console_progress() as progress:
        out = args.out or pathlib.Path(temporary)
        for cable in args.cables:
            for lab in args.labs:
                place = out / f"{args.rig}-{lab}-{cable}"
                for key, values in compare(args, cable, lab, place, progress).items():
                    errors.setdefault(key, []).extend(values)
    rows = []
    for (count, kind), values in sorted(errors.items()):
        every = np.concatenate(values)
        median, low, high = median_interval(every)
        q1, q3 = np.quantile(every, (0.25, 0.75))
        pairs = [np.median(a) for a in values]
        random = [np.median(a) for a in errors[count, "random"]]
        per = len(random) // len(pairs)
        wins = [a < b for k, a in enumerate(pairs) for b in random[k * per : (k + 1) * per]]
        rows.append(
            (
                count,
                kind,
                len(values),
                len(every),
                f"{median:.1f} ({low:.1f} to {high:.1f})",
                f"{q1:.1f}",
                f"{q3:.1f}",
                f"{sum(wins)} of {len(wins)}" if kind != "random" else "",
            )
        )
    title = "Simulated against measured landing of other casts, in % of cable length"
    print(Table(title=title, columns=COLUMNS, rows=rows))
    return 0


def first(casts: Dataset, count: int) -> Dataset:
    """Return the first casts of a dataset."""
    every, chosen = CastStore(casts.setup), CastStore(casts.setup)
    every.add_dataset(casts)
    chosen.casts = every.casts[:count]
    return chosen.dataset()


def one_by_one(
    rig: CheckedRig,
    begun: Dataset,
    count: int,
    workers: str,
    place: pathlib.Path,
    report: ProgressCallback,
) -> Dataset:
    """Return casts each of which tells most after a fit to those before it.

    Args:
        rig: Rig that makes the casts.
        begun: First casts.
        count: Number of casts with them.
        workers: Who simulates for the fits.
        place: Folder that keeps fits and casts.
        report: Told what is done.
    """
    store = CastStore(rig.setup)
    store.add_dataset(begun)
    for number in range(len(begun), count):
        report(Progress(task=f"{rig.setup.cable.name}: cast {number + 1} after a fit to {number}"))
        out = place / f"fit-before-{number}"
        tuned = cc.tune(store.dataset(), validation_count=0, workers=workers, out=out)
        out = place / f"next-{number}"
        made = cc.collect(rig, count=1, sampling="informative", tuned=tuned, seed=number, out=out)
        store.add_dataset(made)
    return store.dataset()


def compare(
    args: Args, cable: str, lab: int, place: pathlib.Path, report: ProgressCallback
) -> dict[tuple[int, str], list[NDArray[np.float64]]]:
    """Return the errors of fits on other casts [% of cable length], by casts and choice."""
    setup = cc.Setup(cable=cable)
    rig = open_rig(args.rig, lab, setup)
    most = max(args.counts)

    def cast(name: str, actions: NDArray[np.float64]) -> Dataset:
        return collect_dataset(place / name, rig, setup, purpose="tune", actions=actions)

    others = cast("others", feasible_uniform(args.others, setup, seed=99))
    tracks = MeasuredTracks.from_dataset(others)
    telling = cc.collect(rig, count=most, sampling="informative", out=place / "informative")
    sets = [
        ("most telling", telling),
        ("one by one", one_by_one(rig, first(telling, 2), most, args.workers, place, report)),
    ]
    for repeat in range(args.repeats):
        actions = feasible_uniform(most, setup, seed=200 + repeat)
        sets.append(("random", cast(f"random-{repeat}", actions)))
    errors: dict[tuple[int, str], list[NDArray[np.float64]]] = {}
    for count in args.counts:
        spread = cc.collect(rig, count=count, sampling="spread", out=place / f"spread-{count}")
        for number, (kind, casts) in enumerate([*sets, ("spread", spread)]):
            report(Progress(task=f"{cable}, laboratory {lab}: fit to {count} {kind} casts"))
            tuned = cc.tune(
                first(casts, count),
                validation_count=0,
                workers=args.workers,
                out=place / f"fit-{count}-{kind.replace(' ', '-')}-{number}",
            )
            fitted = setup.cable.with_material(tuned.dynamics.material)
            objective = TrackObjective(make_engine(), fitted, tracks)
            final = objective.distances(tuned.params).final[0] / setup.cable.length
            errors.setdefault((count, kind), []).append(100.0 * final[np.isfinite(final)])
    return errors
