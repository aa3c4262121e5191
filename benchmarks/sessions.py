"""First tries at targets one after another, with and without new fits to all casts of the session.

A session makes a few casts to begin with, and then aims at targets in turn, as `cablecast aim`
does; every cast teaches. Once it may fit the simulator anew where the session says that it is worth
it, and once it may not. Both are the same up to the first new fit, so only the targets after it are
compared. A cast without a landing counts as a miss of 100 %.

Each target is kept in --out: the same command goes on where it was stopped, and shares fits and
models with `benchmarks casts`.
"""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.after_casts import AfterCasts
from benchmarks.common import Table
from benchmarks.places import MISSED_PCT, Place, some_targets
from cablecast.cli.progress import console_progress
from cablecast.evaluation.evaluate import median_interval

COLUMNS = ("cable", "lab", "model", "targets", "median", "q1", "q3", "missed", "hit", "casts")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args(AfterCasts):
    """First tries of a session with and without new fits."""

    cables: tuple[str, ...] = ("cable_2",)
    """Cables."""
    targets: int = 12
    """Targets of each session."""
    tries: int = 2
    """Casts at one target at most."""


def aim_in_turn(place: Place, args: Args, refit: bool) -> list[dict[str, Any]]:
    """Return the casts at each target in turn.

    Args:
        place: Cable and laboratory.
        args: Settings.
        refit: True to let the session fit the simulator anew.
    """
    kind = "refit" if refit else "kept"
    name = f"session-{args.calibration}-{args.tries}-{kind}"
    folder = place.models / name
    targets = some_targets(args.targets, place.lab)
    stored = [place.parts.get(f"{name}-{index:03d}") for index in range(len(targets))]
    if all(row is not None for row in stored):
        return [row for row in stored if row is not None]
    config = cc.AimConfig(
        tries=args.tries,
        refit=refit,
        calibration_count=args.calibration,
        simulated_count=args.simulated,
        epochs=args.epochs,
        candidate_count=args.candidates,
    )
    session = cc.prepare_aim(
        place.rig,
        config,
        casts=place.casts(args.calibration),
        out=folder,
        progress=place.report,
    )
    rows = []
    for index, target in enumerate(targets):
        if (known := stored[index]) is not None:
            rows.append(known)
            continue
        result = cc.aim(session, place.rig, target, progress=place.report)
        misses = [cast.miss_pct for cast in result.casts[0]]
        row = {
            "miss_pct": [miss if np.isfinite(miss) else MISSED_PCT for miss in misses],
            "hit": bool(result.hit[0]),
            "fitted": session.fitted_count,
            "casts": len(session.casts),
        }
        place.parts.put(f"{name}-{index:03d}", row)
        rows.append(row)
    return rows


def after_refit(rows: list[dict[str, Any]], first: int) -> NDArray[np.bool_]:
    """Return which targets were aimed at after the first new fit, shape [target]."""
    return np.array([row["fitted"] > first for row in rows])


def main(args: Args) -> int:
    """Run the benchmark and print its table."""
    shared = args.place_args()
    table: list[tuple] = []
    with console_progress() as progress:
        for cable in args.cables:
            found: dict[str, list] = {"kept": [], "new fit": []}
            for lab in args.labs:
                place = Place(shared, args.rig, lab, cable, progress)
                refitted, kept = (aim_in_turn(place, args, refit) for refit in (True, False))
                later = after_refit(refitted, args.calibration)
                for name, rows in (("kept", kept), ("new fit", refitted)):
                    chosen = [row for row, is_later in zip(rows, later, strict=True) if is_later]
                    found[name] += chosen
                    if chosen:
                        table.append((cable, lab, name, *summary(chosen)))
            if len(args.labs) > 1:
                table += [(cable, "all", name, *summary(rows)) for name, rows in found.items()]
    title = "First tries after the first new fit, in % of cable length; hit: targets hit by any try"
    print(Table(title=title, columns=COLUMNS, rows=table))
    return 0


def summary(rows: list[dict[str, Any]]) -> tuple:
    """Return targets, miss of first tries, and share of targets hit [%]."""
    misses = np.array([row["miss_pct"][0] for row in rows])
    median, low, high = median_interval(misses)
    q1, q3 = np.quantile(misses, (0.25, 0.75))
    return (
        len(rows),
        f"{median:.1f} ({low:.1f} to {high:.1f})",
        f"{q1:.1f}",
        f"{q3:.1f}",
        f"{100.0 * np.mean(misses >= MISSED_PCT):.0f}",
        f"{100.0 * np.mean([row['hit'] for row in rows]):.0f}",
        sum(len(row["miss_pct"]) for row in rows),
    )
