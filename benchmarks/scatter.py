"""Scatter of equal casts, and what tells it and the error of the simulator beforehand.

After a few casts the loop of `cablecast aim` chooses a first cast at each of some targets. Each is
made several times, with other chances. The scatter of its landings, and the distance from their
middle to the landing that the simulators expect, are compared with what they are judged by before:
the sensitivity to the action, the friction, and how far the simulators part. The stated scatter
along each axis is that of the plan. No correction of one cast of a rig lands nearer than the casts
scatter.

Each target is kept in --out: the same command goes on where it was stopped, and shares fits and
models with `benchmarks casts`.
"""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.after_casts import AfterCasts
from benchmarks.common import Table
from benchmarks.places import Luck, Place, equal_casts, some_targets
from cablecast.aiming.ensemble import miss_sizes
from cablecast.aiming.predictor import log_scatters
from cablecast.aiming.residual import FRICTION_SIZE
from cablecast.cli.progress import console_progress
from cablecast.motion.action import mirror_to_right
from cablecast.runs.progress import Progress

COLUMNS = ("rig", "cable", "targets", "scatter", "stated", "distance", "lost", "error")
RANK_COLUMNS = ("told by", "with the scatter", "with the error")
SIZE_COLUMNS = ("size along each axis", "targets", "error", "q1", "q3", "within 8 %")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args(AfterCasts):
    """Scatter of equal casts beside what is stated."""

    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    """Cables."""
    targets: int = 12
    """Targets in each laboratory."""
    repeats: int = 6
    """Equal casts at each."""


def cast_again(place: Place, args: Args) -> list[dict[str, Any]]:
    """Return landings of equal casts at each target of a place, and what was known before."""
    session, rows = None, []
    length = place.setup.cable.length
    for index, target in enumerate(some_targets(args.targets, place.lab)):
        name = f"scatter-{args.calibration}-{args.repeats}-{index:03d}"
        row = place.parts.get(name)
        if row is None:
            session = session or place.session("aim", args.calibration).session
            predictor = session.predictor
            proposal = session.propose(target)
            action, side = mirror_to_right(proposal.action.to_array()[None])
            found = predictor.ensemble.evaluate(action, side)
            luck = Luck(place.rig, 100_000 + 100 * index)
            landings = np.array(equal_casts(luck, proposal.trajectory, args.repeats)) / length
            row = {
                "landings": [xy.tolist() if np.isfinite(xy).all() else None for xy in landings],
                "stated": proposal.scatter / length,
                "simulated": (found.landing_xy[0] * (side[0], 1.0) / length).tolist(),
                "sensitivity": float(predictor.beliefs.sensitivities(action)[0]),
                "friction": float(found.frictions[0]),
                "spread": float(found.spreads[0]),
            }
            place.parts.put(name, row)
        rows.append(row)
        task = f"{place.name} {place.lab} {place.setup.cable.name}, equal casts"
        place.report(Progress(task=task, done=index + 1, total=args.targets, unit="targets"))
    return rows


def measured(rows: list[dict[str, Any]]) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return what equal casts did, each of shape [target].

    Returns:
        Standard deviation along each axis, median distance from their middle, distance from there
        to the simulated landing [cable lengths]; and the share without a landing [-].
    """
    found = []
    for row in rows:
        every = row["landings"]
        landings = np.array([xy for xy in every if xy is not None], dtype=float)
        if len(landings) < 2:
            found.append((np.nan, np.nan, np.nan, 1.0))
            continue
        deviation = np.sqrt(landings.var(axis=0, ddof=1).mean())
        middle = np.median(landings, axis=0)
        distance = np.median(np.linalg.norm(landings - middle, axis=1))
        error = np.linalg.norm(middle - row["simulated"])
        found.append((deviation, distance, error, 1.0 - len(landings) / len(every)))
    deviation, distance, error, lost = np.array(found).T
    return deviation, distance, error, lost


def rank_rows(rows: list[dict[str, Any]]) -> list[tuple[str, str, str]]:
    """Return the rank correlations of what was known before with scatter and error."""
    from scipy.stats import spearmanr

    deviation, _, error, _ = measured(rows)
    known = np.isfinite(deviation) & np.isfinite(error)
    told = {key: np.array([row[key] for row in rows]) for key in ("sensitivity", "friction")}
    kinds = {
        "sensitivity to the action": told["sensitivity"],
        "friction": told["friction"],
        "both": log_scatters(told["sensitivity"], told["friction"]),
        "spread of the simulators": np.array([row["spread"] for row in rows]),
    }
    return [
        (
            kind,
            f"{spearmanr(values[known], deviation[known]).statistic:.2f}",
            f"{spearmanr(values[known], error[known]).statistic:.2f}",
        )
        for kind, values in kinds.items()
    ]


def size_rows(rows: list[dict[str, Any]], parts: int = 3) -> list[tuple]:
    """Return error statistics of the targets, grouped by the expected size of the error."""
    error = measured(rows)[2]
    spread, friction = (np.array([row[key] for row in rows]) for key in ("spread", "friction"))
    size = np.hypot(miss_sizes(spread), FRICTION_SIZE * friction)
    known = np.flatnonzero(np.isfinite(error))
    found = []
    for part in np.array_split(known[np.argsort(size[known])], parts):
        sizes, errors = 100.0 * size[part], 100.0 * error[part]
        quartiles = (f"{value:.1f}" for value in np.quantile(errors, (0.5, 0.25, 0.75)))
        near = f"{100.0 * np.mean(errors < 8.0):.0f} %"
        found.append((f"{sizes[0]:.1f} to {sizes[-1]:.1f}", len(part), *quartiles, near))
    return found


def main(args: Args) -> int:
    """Run the benchmark and print its tables."""
    shared = args.place_args()
    every, table = [], []
    with console_progress() as progress:
        for cable in args.cables:
            here = []
            for lab in args.labs:
                here += cast_again(Place(shared, args.rig, lab, cable, progress), args)
            deviation, distance, error, lost = measured(here)
            stated = np.median([row["stated"] for row in here])
            numbers = (np.nanmedian(deviation), stated, np.nanmedian(distance), np.mean(lost))
            percent = (f"{100.0 * number:.1f}" for number in (*numbers, np.nanmedian(error)))
            table.append((args.rig, cable, len(here), *percent))
            every += here
    title = "Medians over targets in % of cable length; lost: casts without a landing [%]"
    print(Table(title=title, columns=COLUMNS, rows=table))
    title = f"Rank correlation at {len(every)} targets"
    print(Table(title=title, columns=RANK_COLUMNS, rows=rank_rows(every)))
    title = "Error by the size that spread and friction tell, in % of cable length"
    print(Table(title=title, columns=SIZE_COLUMNS, rows=size_rows(every)))
    return 0
