"""Fit with and without a material: what damping, curl and an attachment with size are worth.

Casts of each cable in each copy of a laboratory are collected, as `cablecast aim` makes them, and
random ones. The first are fitted with the ten parameters alone, and with the values of the
material, too, where they are likelier with these; the random ones tell how far the simulated
endpoint then is from the measured one.
"""

import dataclasses
import pathlib
import tempfile
from typing import Any

import numpy as np

from benchmarks.common import Table, write_json
from benchmarks.places import open_rig
from cablecast.cable import ROD_ARM
from cablecast.cli.progress import console_progress
from cablecast.data.dataset import Dataset
from cablecast.data.store import CastStore
from cablecast.pipeline.collect import AnySampling, collect
from cablecast.pipeline.tune import tune
from cablecast.runs.workers import LOCAL
from cablecast.setup import Setup
from cablecast.tuning.fit import FitConfig

COLUMNS = (
    "cable",
    "laboratory",
    "fit",
    "damping time [ms]",
    "curl [rad]",
    "attachment [mm]",
    "yield [1/m]",
    "on the way, mean [%]",
    "at rest, median [%]",
    "q1",
    "q3",
)
NO_MATERIAL: dict[str, Any] = {"materials": ()}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Fits with and without a material.

    Attributes:
        rig: Rig: virtual, strange, scattering, even, patchy, engine or example.
        cables: Names of the cables.
        labs: Seeds of the laboratories.
        fitted: Casts to fit.
        sampling: Sampling of the casts to fit: spread, uniform or grid.
        others: Random casts to measure the fit with.
        seed: Seed of the casts.
        workers: Who simulates for the fits: local, ray, or ray:ADDRESS.
        out: Folder that keeps the casts and lets a stopped run go on.
        json: File that gets the figures, too.
    """

    rig: str = "virtual"
    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    labs: tuple[int, ...] = (0, 1, 2)
    fitted: int = 5
    sampling: AnySampling = "spread"
    others: int = 60
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
                for settings in (NO_MATERIAL, {}):
                    table.rows.append(fitted(casts, lab, settings, args))
                    print(*table.rows[-1], flush=True)
    print(table)
    write_json(args.json, [table])


def collected(cable: str, lab: int, args: Args, out: pathlib.Path) -> Dataset:
    """Return the casts to fit, and then the others."""
    setup = Setup(cable=cable)
    rig = open_rig(args.rig, lab, setup)
    every = CastStore(setup)
    with rig, console_progress() as progress:
        parts: tuple[tuple[str, int, AnySampling], ...] = (
            ("tune", args.fitted, args.sampling),
            ("real", args.others, "uniform"),
        )
        for purpose, count, sampling in parts:
            made = collect(
                rig,
                count=count,
                seed=args.seed,
                purpose=purpose,
                sampling=sampling,
                out=out / f"{args.rig}-{cable}-{lab}-{sampling}-{count}",
                progress=progress,
            )
            every.add_dataset(made)
    return every.dataset()


def fitted(casts: Dataset, lab: int, settings: dict[str, Any], args: Args) -> tuple:
    with console_progress() as progress:
        tuned = tune(
            casts,
            config=FitConfig(seed=args.seed, **settings),
            validation_count=args.others,
            workers=args.workers,
            progress=progress,
        )
    row = tuned.metrics["validation"]["tuned"]
    params = tuned.params
    damping_time, curvature, arm = (
        float(np.asarray(value))
        for value in (params.damping_time, params.rest_curvature, params.attachment_arm)
    )
    names = ("mean", "final_median", "final_first_quartile", "final_third_quartile")
    return (
        casts.cable.name,
        lab,
        "ten parameters" if settings else "as the casts ask",
        1e3 * damping_time,
        round(curvature * casts.cable.length, 2),
        round(1e3 * arm / ROD_ARM, 1),
        round(float(np.asarray(params.yield_curvature))),
        *(row[f"{name}_pct"] for name in names),
    )
