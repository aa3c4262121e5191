"""Error at targets, after casts before the first target and within a session.

casts: for each rig, laboratory, cable and number of casts, `prepare_aim` fits the simulator and
trains a model, and each target is cast at several times in turn. Every target starts from the same
casts, so that a first try after five casts is just that. Medians come with the interval that holds
90 % of 2,000 bootstrap draws.

sessions: a session aims at targets in turn, as `cablecast aim` does, and every cast counts for
later targets; once with new fits to all casts of the session where it says that they are due, and
once without. Both are the same up to the first new fit, so only the targets after it are compared.

A cast without a landing counts as a miss of 100 %. Each target is kept in --out: the same command
resumes where it was stopped, and adds what a larger one asks for.
"""

import dataclasses
import itertools
import pathlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.common import Table
from benchmarks.places import (
    FINE_TUNING_MIN,
    METHODS,
    MISSED_PCT,
    Found,
    ModelArgs,
    Place,
    RigArgs,
    random_targets,
    try_count,
)
from cablecast.cli.progress import console_progress
from cablecast.errors import InputError
from cablecast.evaluation.evaluate import difference_interval, median_interval
from cablecast.files import write_bytes
from cablecast.report import style
from cablecast.rigs.virtual.sensing import CameraErrorModel
from cablecast.runs.progress import ProgressCallback

COLUMNS = ("rig", "cable", "casts", "method", "targets", "try", "median", "q1", "q3", "missed")
REGION_COLUMNS = ("rig", "cable", "casts", "method", "try", "landings", "in 50 %", "in 90 %")


@dataclasses.dataclass(frozen=True, kw_only=True)
class CastsArgs(ModelArgs):
    """Error at targets against the number of real casts."""

    rigs: tuple[str, ...] = ("virtual", "strange")
    """Rigs among virtual, strange, even, patchy, engine, example."""
    labs: tuple[int, ...] = (0, 1, 2)
    """Seeds of the laboratories."""
    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    """Cables."""
    methods: tuple[str, ...] = METHODS
    """Methods among aim, full gain, one simulator, simulated, fine-tuning, paper."""
    targets: int = 200
    """Targets of each rig and cable, shared among the laboratories."""
    counts: tuple[int, ...] = (0, 2, 3, 5, 10, 20, 50, 100, 280)
    """Numbers of real casts before the first target."""
    tries: int = 4
    """Casts at each target."""
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


def run(args: CastsArgs, report: ProgressCallback) -> Found:
    """Return the results by rig, cable, number of casts and method."""
    found: Found = {}
    for name in args.rigs:
        for cable in args.cables:
            for lab, own in zip(args.labs, args.shares, strict=True):
                here = Place(args, name, lab, cable, max(args.counts), report)
                for count in args.counts:
                    for method in args.methods:
                        if count < {"fine-tuning": FINE_TUNING_MIN, "paper": 2}.get(method, 0):
                            continue
                        rows = here.results(method, count, own, args.tries)
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
            landed = np.array([share for share in shares if share is not None])
            inside = [100.0 * np.mean(landed < share) for share in (0.5, 0.9)]
            found_in = (f"{share:.0f}" for share in inside)
            rows_of_regions.append((name, cable, count, method, number + 1, len(landed), *found_in))
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


def print_blind(found: Found, args: CastsArgs) -> None:
    """Print how many targets the camera of the virtual rig is blind at, and misses without them."""
    xy = np.concatenate(
        [random_targets(own, lab) for lab, own in zip(args.labs, args.shares, strict=True)]
    )
    blind = CameraErrorModel.load().sight.is_blind_at(xy)
    print(f"The virtual rig's camera is blind at {blind.sum()} of these {len(xy)} targets.\n")
    if not blind.any():
        return
    seen = {
        key: [row for row, unseen in zip(rows, blind, strict=True) if not unseen]
        for key, rows in found.items()
        if key[0].startswith("virtual")
    }
    print_misses(seen, args.tries, ", at the others")


def casts(args: CastsArgs) -> int:
    """Run the benchmark and print its tables."""
    args = dataclasses.replace(args, **QUICK) if args.quick else args
    if unknown := sorted(set(args.methods) - set(METHODS)):
        raise InputError(f"unknown method {unknown[0][:40]!r}: one of {', '.join(METHODS)}")
    with console_progress() as progress:
        found = run(args, progress)
    print_misses(found, args.tries)
    print_regions(found, args.tries)
    if any(rig.startswith("virtual") for rig in args.rigs):
        print_blind(found, args)
    print_differences(found)
    if args.figure is not None:
        draw(found, args.figure)
    return 0


SESSION_COLUMNS = (
    "cable",
    "lab",
    "model",
    "targets",
    "median",
    "q1",
    "q3",
    "missed",
    "hit",
    "casts",
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SessionsArgs(RigArgs):
    """First tries of a session with and without new fits."""

    cables: tuple[str, ...] = ("cable_2",)
    """Cables."""
    targets: int = 12
    """Targets of each session."""
    tries: int = 2
    """Casts at one target at most."""


def aim_in_turn(place: Place, args: SessionsArgs, refit: bool) -> list[dict[str, Any]]:
    """Return the casts at each target in turn.

    Args:
        place: Cable and laboratory.
        args: Settings.
        refit: True to allow new fits of the simulator.
    """
    kind = "refit" if refit else "kept"
    name = f"session-{args.calibration}-{args.tries}-{kind}"
    targets = random_targets(args.targets, place.lab)
    stored = [place.parts.get(f"{name}-{index:03d}") for index in range(len(targets))]
    if all(row is not None for row in stored):
        return [row for row in stored if row is not None]
    session = cc.prepare_aim(
        place.rig,
        args.aim_config(args.calibration, tries=args.tries, refit=refit),
        casts=place.casts(args.calibration),
        out=place.models / name,
        progress=place.progress,
    )
    rows = []
    for index, target in enumerate(targets):
        if (row := stored[index]) is not None:
            rows.append(row)
            continue
        result = cc.aim(session, place.rig, target, progress=place.progress)
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


def sessions(args: SessionsArgs) -> int:
    """Run the benchmark and print its table."""
    table: list[tuple] = []
    with console_progress() as progress:
        for cable in args.cables:
            found: dict[str, list] = {"kept": [], "new fit": []}
            for lab in args.labs:
                place = Place(args, args.rig, lab, cable, args.calibration, progress)
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
    print(Table(title=title, columns=SESSION_COLUMNS, rows=table))
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


COLORS = (style.BLUE, style.VERMILLION, style.GREEN, style.PURPLE, style.SKY)


def draw(found: Found, path: pathlib.Path) -> None:
    """Draw misses against tries; against the number of real casts where there are several numbers.

    Args:
        found: Results by rig, cable, number of casts and method.
        path: PNG file to write.
    """
    names = list(dict.fromkeys((name, cable) for name, cable, _, _ in found))
    by_count = len({count for _, _, count, _ in found}) > 1
    with style.styled():
        width = max(4.0, 0.33 * style.PAGE_WIDTH * len(names))
        figure = style.new_figure(width + 1.4 * by_count, 2.9)
        axes = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
        for axis, (name, cable) in zip(axes, names, strict=True):
            here = {
                key[2:]: np.array([row["miss_pct"] for row in rows])
                for key, rows in found.items()
                if key[:2] == (name, cable)
            }
            (_over_counts if by_count else _over_tries)(axis, here)
            targets = len(next(iter(here.values())))
            axis.set(title=f"{cable}, {name} rig: {targets} targets")
            axis.grid(axis="y", color=style.FAINT)
        axes[0].set(ylabel="miss [% of cable length]")
        if by_count:
            figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center")
        else:
            axes[0].legend()
        write_bytes(path, style.png_bytes(figure))


def _over_tries(axis, here: dict[tuple[int, str], NDArray[np.float64]]) -> None:
    """Draw medians with their intervals, and a band from quartile to quartile, for each line."""
    for ((count, method), misses), color in zip(
        here.items(), itertools.cycle(COLORS), strict=False
    ):
        tries = np.arange(1, misses.shape[1] + 1)
        q1, q3 = np.quantile(misses, (0.25, 0.75), axis=0)
        axis.fill_between(tries, q1, q3, color=color, alpha=0.15, linewidth=0)
        _medians(axis, tries, misses.T, color, f"{method}, {count} casts before")
        axis.set(xlabel="try", xticks=tries, ylim=(0, None))


def _over_counts(axis, here: dict[tuple[int, str], NDArray[np.float64]]) -> None:
    """Draw medians with their intervals: the first try of every method, and later ones dashed."""
    from matplotlib.ticker import LogLocator, StrMethodFormatter

    counts = sorted({count for count, _ in here})
    methods = dict.fromkeys(method for _, method in here)
    for method, color in zip(methods, itertools.cycle(COLORS), strict=False):
        own = [count for count in counts if (count, method) in here]
        tries = min(here[count, method].shape[1] for count in own)
        for number in range(tries):
            label = method if tries == 1 else f"{method}, try {number + 1}"
            misses = [here[count, method][:, number] for count in own]
            places = [counts.index(count) for count in own]
            _medians(axis, places, misses, color, label, "-" if number == 0 else "--")
    axis.set(xlabel="real casts before the first target", yscale="log")
    axis.set_xticks(range(len(counts)), [str(count) for count in counts])
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.minorticks_off()


def _medians(axis, places, misses, color, label: str, linestyle: str = "-") -> None:
    """Draw medians of misses, with the intervals that hold 90 % of bootstrap draws."""
    middle, low, high = np.array([median_interval(values) for values in misses]).T
    axis.errorbar(
        places,
        middle,
        (middle - low, high - middle),
        marker="o",
        markersize=4,
        capsize=2,
        color=color,
        linestyle=linestyle,
        label=label,
    )
