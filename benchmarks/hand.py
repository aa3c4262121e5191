"""Cables that a hand swings, without a robot: what a fit finds, and whether its intervals hold.

Each cable is drawn from what is believed of one. A hand swings it over a table, as in the films of
`tools/film.py hand`: from side to side, without a turn. What a film or a motion capture gives, the
places of the held end and of the free one at a frame rate and with noise, is imported and fitted.
The cable is simulated by the engine that the fit uses, more finely.

Some films are made and tracked, too, with a marker and with a tag on the hand.
"""

import csv
import dataclasses
import io
import json
import pathlib
import sys
import tempfile
from collections.abc import Iterator

import numpy as np
from tools.film import hand_motion
from tools.film import main as make_films

import cablecast as cc
from benchmarks.result import Table
from cablecast.cable import Cable, CableParams
from cablecast.engines.warp_ import EngineWarp
from cablecast.exports.facts import INTERVAL_PCT, CableModel
from cablecast.files import read_text, write_text
from cablecast.pipeline.import_casts import import_casts
from cablecast.pipeline.track_video import TrackConfig, join_casts, track_video
from cablecast.setup import Setup
from cablecast.tuning.fit import FitConfig
from cablecast.tuning.space import ParamPrior, SearchSpace
from cablecast.tuning.tuned import Tuned

FINE = (80, 2.5e-4)
"""Segments and step [s] of the cables that are swung."""
REST = 1.2
"""Time after the swing [s]."""
TAG = 7
"""Number of the tag on the hand."""
HANDS = (
    ("a blue marker", (), TrackConfig(grip_hue=242.0)),
    ("a tag of 3 cm", ("--tag", str(TAG)), TrackConfig(grip_tag=TAG)),
)
"""What shows the hand in films: its name, how they are made, and how they are tracked."""
WANTED = (
    *("bend_stiffness_per_mass", "twist_stiffness", "endpoint_mass", "friction"),
    *("spinning_friction", "rolling_friction", "linear_damping", "angular_damping"),
)
"""Numbers that are looked for; a mass is weighed."""
FILMED = ("friction", "bend_stiffness_per_mass")
"""Numbers that a swing determines surely."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Fit made cables to swings of a hand.

    Attributes:
        cable: Cable that all are variants of.
        count: Number of cables.
        swings: Swings of each.
        rate: Frames per second [1/s].
        noise: Standard deviation of a coordinate of a marker [m].
        films: Films that are made with a marker on the hand, and as many with a tag.
        seed: Seed of cables, swings and noise.
    """

    cable: str = "cable_1"
    count: int = 10
    swings: int = 4
    rate: float = 60.0
    noise: float = 1e-3
    films: int = 2
    seed: int = 0


def made_cables(cable: Cable, count: int, seed: int) -> list[Cable]:
    """Return cables drawn from what is believed of one, its material included."""
    space = SearchSpace.for_cable(cable, FitConfig().materials)
    points = ParamPrior.for_cable(cable, space).draw(count + 1, seed)[1:]
    return [cable.with_params(space.to_params(point)) for point in points]


def swung(cable: Cable, args: Args, rng: np.random.Generator) -> str:
    """Return a table for `cablecast import` of some swings of a cable."""
    setup = Setup(cable=args.cable)
    table = io.StringIO()
    writer = csv.writer(table)
    writer.writerow(("cast", "time_s", "x_m", "y_m", "grip_x_m", "grip_y_m"))
    for swing in range(args.swings):
        path = hand_motion(setup.workspace, rng)
        duration = float(path.duration[0]) + REST
        rollout = EngineWarp(*FINE).rollout(cable, path, duration=duration, sample_dt=1 / 240)
        times = np.arange(0.0, rollout.times[-1], 1.0 / args.rate)
        places = [np.interp(times, rollout.times, rollout.endpoint_xy[0, :, k]) for k in (0, 1)]
        places += list(path.evaluate(times)[0, :, :2].T)
        noisy = np.array(places) + args.noise * rng.normal(size=(4, len(times)))
        # What waits before the swing is still.
        writer.writerows((swing, *row) for row in np.column_stack([times, *noisy]).round(5))
    return table.getvalue()


def fitted(cable: Cable, args: Args, rng: np.random.Generator) -> Tuned:
    """Return the fit to swings of a cable."""
    setup = Setup(cable=args.cable)
    # A scale tells the mass of a cable, and of what hangs at its end.
    weighed = setup.cable.with_params(mass=cable.params.mass)
    setup = dataclasses.replace(
        setup, cable=dataclasses.replace(weighed, deviations={"mass": 1.02})
    )
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "swings.csv"
        write_text(file, swung(cable, args, rng))
        casts = import_casts(file, setup, report=lambda line: print(line, file=sys.stderr))
        return cc.tune(casts, config=FitConfig(ensemble_iterations=0))


def filmed(args: Args) -> Iterator[tuple]:
    """Yield what films of a hand tell of a cable, by what shows the hand."""
    setup = Setup(cable=args.cable)
    for hand, options, looks in HANDS:
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            films = ["hand", name, "--cable", args.cable, "--seed", str(args.seed)]
            make_films([*films, "--count", str(args.films), *options])
            looks = dataclasses.replace(looks, tags=folder / "tags.yaml")
            tracked = [folder / f"track-{number}" for number in range(args.films)]
            for video, out in zip(sorted(folder.glob("*.mp4")), tracked, strict=True):
                track_video(video, setup, config=looks, out=out)
            join_casts(tracked, folder / "casts.csv")
            casts = import_casts(folder / "casts.csv", setup)
            truth = CableParams(**json.loads(read_text(folder / "truth.json")))
        tuned = cc.tune(casts, config=FitConfig(ensemble_iterations=0))
        intervals = CableModel(cable=setup.cable, posterior=tuned.posterior).intervals()
        for number in FILMED:
            low, high = intervals[number]
            of = [value(one, number) for one in (setup.cable.params, truth, tuned.params)]
            yield (hand, number, *of, f"{low:.3g} to {high:.3g}")


def value(params: CableParams, name: str) -> float:
    """Return one of `WANTED`."""
    if name == "bend_stiffness_per_mass":
        return float(np.asarray(params.bend_stiffness) / np.asarray(params.mass))
    return float(np.asarray(getattr(params, name)))


def main(args: Args) -> Iterator[Table]:
    """Yield how narrow the intervals are, how many hold, and what films of a hand tell."""
    held: dict[str, list[bool]] = {name: [] for name in WANTED}
    width: dict[str, list[float]] = {name: [] for name in WANTED}
    distances = []
    for number, cable in enumerate(
        made_cables(Setup(cable=args.cable).cable, args.count, args.seed)
    ):
        rng = np.random.default_rng([args.seed, number])
        tuned = fitted(cable, args, rng)
        distances.append(tuned.metrics["validation"]["tuned"]["mean_pct"])
        after = CableModel(cable=tuned.setup.cable, posterior=tuned.posterior).intervals()
        believed = Tuned.believed(tuned.setup)
        before = CableModel(cable=cable, posterior=believed.posterior).intervals()
        for name in WANTED:
            low, high = after[name]
            held[name].append(low <= value(cable.params, name) <= high)
            ratio = np.log(high / max(low, 1e-9)) / np.log(
                before[name][1] / max(before[name][0], 1e-9)
            )
            width[name].append(float(ratio))
        print(number, distances[-1], {n: held[n][-1] for n in WANTED}, file=sys.stderr, flush=True)
    columns = (
        "number",
        f"{INTERVAL_PCT:g} % interval over the believed one",
        "intervals that hold [%]",
    )
    rows = [(n, float(np.median(width[n])), 100.0 * float(np.mean(held[n]))) for n in WANTED]
    every = [one for values in held.values() for one in values]
    rows.append(("all", None, 100.0 * float(np.mean(every))))
    yield Table(f"{args.count} made cables, {args.swings} swings of a hand each", columns, rows)
    columns = ("on the hand", "number", "in the cable's file", "true", "fitted", "90 % interval")
    yield Table("Films of a hand", columns, list(filmed(args)))
    columns = ("simulated against measured free end, on the way, median [% of length]",)
    yield Table("Distance that is left", columns, [(float(np.median(distances)),)])
