"""Fit with and without a damping time of the material: what better physics is worth on casts.

Casts of each cable on each copy of the virtual laboratory are collected. The first are fitted with
the ten parameters alone, and with a damping time where these casts ask for one; the others tell how
far the simulated endpoint then is from the measured one.
"""

import dataclasses
import pathlib
import tempfile

from benchmarks.common import Table, write_json
from cablecast.cli.progress import console_progress
from cablecast.datasets.reader import Dataset
from cablecast.pipeline.collect import collect
from cablecast.pipeline.tune import tune
from cablecast.rigs.make import make_rig
from cablecast.rigs.virtual import RigVirtual, VirtualConfig
from cablecast.runs.workers import LOCAL
from cablecast.setup import Setup
from cablecast.tuning.least_squares import FitConfig

COLUMNS = (
    "cable",
    "laboratory",
    "fit",
    "damping time [ms]",
    "log evidence",
    "on the way, mean [%]",
    "at rest, median [%]",
    "q1",
    "q3",
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Fits with and without a damping time of the material.

    Attributes:
        cables: Names of the cables.
        labs: Seeds of the laboratories.
        fitted: Casts to fit.
        others: Casts to measure the fit with.
        seed: Seed of the casts.
        workers: Who simulates for the fits: local, ray, or ray:ADDRESS.
        out: Folder that keeps the casts and lets a stopped run go on.
        json: File that gets the figures, too.
    """

    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    labs: tuple[int, ...] = (0, 1, 2)
    fitted: int = 20
    others: int = 40
    seed: int = 0
    workers: str = LOCAL
    out: pathlib.Path | None = None
    json: pathlib.Path | None = None


def main(args: Args) -> None:
    table = Table("Simulated against measured endpoint, in % of cable length", COLUMNS, [])
    with tempfile.TemporaryDirectory() as temporary:
        out = args.out or pathlib.Path(temporary)
        for cable in args.cables:
            for lab in args.labs:
                casts = collected(cable, lab, args, out)
                for times in ((), FitConfig().damping_times):
                    table.rows.append(fitted(casts, lab, times, args))
                    print(*table.rows[-1], flush=True)
    print(table)
    write_json(args.json, [table])


def collected(cable: str, lab: int, args: Args, out: pathlib.Path) -> Dataset:
    setup = Setup(cable=cable)
    rig = make_rig(RigVirtual(setup, args.seed, VirtualConfig(lab_seed=lab)), setup)
    with rig, console_progress() as progress:
        return collect(
            rig,
            count=args.fitted + args.others,
            seed=args.seed,
            purpose="tune",
            out=out / f"{cable}-{lab}",
            progress=progress,
        )


def fitted(casts: Dataset, lab: int, times: tuple[float, ...], args: Args) -> tuple:
    config = FitConfig(damping_times=times, seed=args.seed)
    with console_progress() as progress:
        tuned = tune(
            casts,
            config=config,
            validation_count=args.others,
            workers=args.workers,
            progress=progress,
        )
    row, material = tuned.metrics["validation"]["tuned"], tuned.dynamics.material
    evidence = max((tried["evidence"] for tried in tuned.metrics["damping_evidence"]), default=None)
    names = ("mean", "final_median", "final_first_quartile", "final_third_quartile")
    return (
        casts.cable.name,
        lab,
        "damping tried" if times else "ten parameters",
        0.0 if material is None else 1e3 * float(material.damping_time),
        "-" if evidence is None else round(evidence, 1),
        *(row[f"{name}_pct"] for name in names),
    )
