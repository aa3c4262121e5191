"""Error at targets by the number of casts before the first target.

For each rig, laboratory, cable and number of casts, `prepare_aim` fits the simulator and
trains a model, and each target is cast at several times in turn. Every target starts from the same
casts, so that a first try after five casts is just that. Medians come with the interval that holds
90 % of 2,000 bootstrap draws.

A cast without a landing counts as a miss of 100 %. Each target is kept in --out: the same command
resumes where it was stopped, and adds what a larger one asks for.
"""

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.common import REACHED_BY, hit_share
from benchmarks.places import (
    HIT_PCT,
    METHODS,
    MISSED_PCT,
    Found,
    ModelArgs,
    Place,
    random_targets,
    try_count,
)
from benchmarks.result import Table
from cablecast.aiming.propose import hit_chances
from cablecast.cli.progress import console_progress
from cablecast.errors import InputError
from cablecast.evaluation.evaluate import difference_interval, median_interval
from cablecast.report import style
from cablecast.rigs.virtual.sensing import CameraErrorModel
from cablecast.runs.progress import ProgressCallback
from cablecast.task import LANDING, Expectation, MissLaw

KEY = ("rig", "cable", "casts", "method")
MISSES = (
    *(*KEY, "targets", "try", "median", "low", "high", "q1", "q3", "lost", "hit"),
    *("in 50 %", "in 90 %"),
)
DISTANCES = (
    *(*KEY, "r [m]", "targets", "first try", "last try", "hit", "floor", "polar", "pace"),
    "seconds",
)
DIFFERENCES = (*KEY, "targets", "try", "median", "low", "high")

RADII = (0.8, 1.05)
"""Bounds between near, middle and far targets [m]."""


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
    """Methods among aim and simulated."""
    targets: int = 200
    """Targets of each rig and cable, shared among the laboratories."""
    counts: tuple[int, ...] = (0, 2, 3, 5, 10, 20, 50, 100, 280)
    """Numbers of real casts before the first target."""
    tries: int = 4
    """Casts at each target."""
    equal: int = 0
    """Times that the last cast at each target is repeated, to see its floor; 0 or at least 2."""
    quick: bool = False
    """Use the strange rig, one laboratory, one cable, 8 targets, and small models only."""

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
                        rows = here.results(method, count, own, args.tries, args.equal)
                        found.setdefault((name, cable, count, method), []).extend(rows)
    return found


def _hits(misses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which targets were hit within 1, 2, ... tries, shape [target, try]."""
    return np.minimum.accumulate(misses, axis=1) <= HIT_PCT


def _floor(rows: list[dict[str, Any]]) -> float | None:
    """Return the median distance of equal casts from their mean [% of cable length], if known."""
    floors = [value for row in rows for value in row["floor_pct"]]
    return float(np.median(floors)) if floors else None


def misses(found: Found, which: str = "") -> Table:
    """Return the misses of every try, and how often the regions held that were stated before it."""
    rows: list[tuple] = []
    for key, casts_at in found.items():
        values = np.array([row["miss_pct"] for row in casts_at])
        for number, own in enumerate(values.T):
            q1, q3 = np.quantile(own, (0.25, 0.75))
            inside: tuple[float | None, ...] = (None, None)
            if key[-1] == "aim":
                shares = [row["share"][number] for row in casts_at]
                landed = np.array([share for share in shares if share is not None])
                inside = tuple(100.0 * float(np.mean(landed < share)) for share in (0.5, 0.9))
            lost = 100.0 * np.mean(own >= MISSED_PCT)
            hit = 100.0 * np.mean(_hits(values)[:, number])
            spread = (*median_interval(own), q1, q3, lost, hit)
            rows.append((*key, len(own), number + 1, *spread, *inside))
    title = (
        "Miss of each try in % of cable length; lost: no landing, or a length off or more [%]; "
        f"hit: share of targets with a miss of {HIT_PCT:g} % or less so far [%]"
    )
    return Table(title=title + which, columns=MISSES, rows=rows)


def distances(found: Found) -> Table:
    """Return misses, floors and motions of near, middle and far targets, for methods that aim."""
    rows = []
    for key, casts_at in found.items():
        if key[-1] != "aim":
            continue
        for low, high in itertools.pairwise((0.0, *RADII, np.inf)):
            own = [row for row in casts_at if low <= row["r"] < high]
            if not own:
                continue
            misses = np.array([row["miss_pct"] for row in own])
            families = np.array([row["family"] for row in own])
            paces = np.array([row["pace"] for row in own])[families == "sweep"]
            rows.append(
                (
                    *key,
                    f"{low:g} to {high:g}" if np.isfinite(high) else f"beyond {low:g}",
                    len(own),
                    *(float(np.median(misses[:, column])) for column in (0, -1)),
                    100.0 * float(np.mean(_hits(misses)[:, -1])),
                    _floor(own),
                    100.0 * float(np.mean(families == "polar")),
                    float(np.median(paces)) if len(paces) else None,
                    float(np.mean([row["seconds"] for row in own])),
                )
            )
    title = (
        "By distance: medians of misses and of the floor, the distance of equal casts from their "
        "mean [% of cable length]; share hit, and of polar casts [%]; median pace of sweeps; mean "
        "duration of a cast [s]"
    )
    return Table(title=title, columns=DISTANCES, rows=rows)


def outlooks(found: Found) -> Table:
    """Return how often targets were hit by what `check` says of them, and what was stated."""
    rows = []
    for key in dict.fromkeys((rig, count, method) for rig, _, count, method in found):
        every = [
            row
            for (rig, _, count, method), casts_at in found.items()
            for row in casts_at
            if (rig, count, method) == key and method == "aim"
        ]
        for calm in (True, False):
            if own := [row for row in every if row["calm"] is calm]:
                misses = np.array([row["miss_pct"] for row in own])
                stated = np.mean([_stated_chances(row, misses.shape[1]) for row in own], axis=0)
                for number, hit in enumerate(_hits(misses).sum(axis=0).tolist()):
                    rows.append(
                        (
                            *key,
                            REACHED_BY["calm" if calm else "wild"],
                            len(own),
                            number + 1,
                            *hit_share(hit, len(own)),
                            100.0 * stated[number],
                            _floor(own),
                        )
                    )
    title = (
        "Hits within so many tries by what reaches the target, as check says it: share of targets "
        "with its 90 % interval, and the chance that was stated before the first try [%]; floor: "
        "median distance of equal casts from their mean [% of cable length]"
    )
    columns = ("rig", "casts", "method", "reached by", "targets", "tries", "hit", "low", "high")
    return Table(title=title, columns=(*columns, "stated", "floor"), rows=rows)


def _stated_chances(row: Mapping[str, Any], count: int) -> NDArray[np.float64]:
    """Return the chances of a hit within 1, 2, ... tries that the first proposal stated."""
    stated, setup = row["expected"][0], cc.Setup()
    goal = LANDING.goals(setup, [0.0, 1.0], within_pct=HIT_PCT)[0]
    length = setup.cable.length
    expected = Expectation(
        mean=goal.value + [stated["miss"] * length, 0.0],
        covariance=(stated["deviation"] * length) ** 2 * np.eye(2),
        law=MissLaw(scale=stated["law_scale"], freedom=stated["law_freedom"]),
        scatter=stated["scatter"] * length,
        failure=stated["failure"],
    )
    return hit_chances(expected, goal, row["family"][0], count)


def differences(found: Found) -> Table:
    """Return how much more other methods miss than aim, at the same targets."""
    rows = []
    for key, others in found.items():
        own = found.get((*key[:-1], "aim"))
        if key[-1] == "aim" or own is None:
            continue
        for number in range(try_count(key[-1], len(own[0]["miss_pct"]))):
            theirs, ours = ([row["miss_pct"][number] for row in of] for of in (others, own))
            rows.append((*key, len(own), number + 1, *difference_interval(theirs, ours)))
    title = "Median miss less that of aim at the same targets [% of cable length]"
    return Table(title=title, columns=DIFFERENCES, rows=rows)


def sighted(found: Found, args: CastsArgs) -> Iterator[Table]:
    """Yield how many targets the virtual rig's camera is blind at, and misses without them."""
    xy = np.concatenate(
        [random_targets(own, lab) for lab, own in zip(args.labs, args.shares, strict=True)]
    )
    blind = CameraErrorModel.load().sight.is_blind_at(xy)
    title = "Targets at which the virtual rig's camera is blind"
    yield Table(title=title, columns=("blind", "targets"), rows=[(int(blind.sum()), len(xy))])
    if blind.any():
        seen = {
            key: [row for row, unseen in zip(rows, blind, strict=True) if not unseen]
            for key, rows in found.items()
            if key[0].startswith("virtual")
        }
        yield misses(seen, ", at the others")


def casts(args: CastsArgs) -> Iterator[Table]:
    """Yield misses and differences."""
    args = dataclasses.replace(args, **QUICK) if args.quick else args
    if unknown := sorted(set(args.methods) - set(METHODS)):
        raise InputError(f"unknown method {unknown[0][:40]!r}: one of {', '.join(METHODS)}")
    if args.equal == 1:
        raise InputError("--equal 1: one cast shows no floor; give 0, or 2 or more")
    with console_progress() as progress:
        found = run(args, progress)
    yield misses(found)
    yield distances(found)
    yield outlooks(found)
    if any(rig.startswith("virtual") for rig in args.rigs):
        yield from sighted(found, args)
    yield differences(found)


COLORS = (style.BLUE, style.VERMILLION, style.GREEN, style.PURPLE, style.SKY)


def draw(rows: Iterable[Mapping[str, Any]]) -> bytes:
    """Draw misses against tries.

    Args:
        rows: Rows of `misses` by the names of their columns.

    Returns:
        A PNG file.
    """
    places: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        places.setdefault((row["rig"], row["cable"]), []).append(row)
    with style.styled():
        width = max(4.0, 0.33 * style.PAGE_WIDTH * len(places))
        figure = style.new_figure(width, 2.9)
        axes = figure.subplots(1, len(places), sharey=True, squeeze=False)[0]
        for axis, ((name, cable), here) in zip(axes, places.items(), strict=True):
            _over_tries(axis, here)
            axis.set(title=f"{cable}, {name} rig: {here[0]['targets']} targets")
            axis.grid(axis="y", color=style.FAINT)
        # Once all is drawn: the axis is shared.
        axes[0].set(ylabel="miss [% of cable length]", ylim=(0, None))
        axes[0].legend()
        return style.png_bytes(figure)


def _over_tries(axis, here: list[Mapping[str, Any]]) -> None:
    """Draw medians with their intervals, and a band from quartile to quartile, for each line."""
    keys = dict.fromkeys((row["casts"], row["method"]) for row in here)
    for key, color in zip(keys, itertools.cycle(COLORS), strict=False):
        own = [row for row in here if (row["casts"], row["method"]) == key]
        tries = [row["try"] for row in own]
        low, high = ([row[name] for row in own] for name in ("q1", "q3"))
        axis.fill_between(tries, low, high, color=color, alpha=0.15, linewidth=0)
        least, middle, most = (
            np.array([row[name] for row in own]) for name in ("low", "median", "high")
        )
        axis.errorbar(
            tries,
            middle,
            (middle - least, most - middle),
            marker="o",
            markersize=4,
            capsize=2,
            color=color,
            label=f"{key[1]}, {key[0]} casts before",
        )
        axis.set(xlabel="try", xticks=tries)
