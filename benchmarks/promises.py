"""Random laboratories: whether the chances of a hit that are stated before casts are kept.

Laboratories and cables are drawn as in `benchmarks.labs`, up to a length of 1.5 m, and played by
the virtual rig, each with the seed of a laboratory that no other benchmark uses. The swing is tuned
where `check` advises it. Five targets are drawn over the part of the table that `check` calls
reachable. Stated are what `check` says of a target before any cast, and what `aim` says of each
cast and of all tries before the first one.
Each laboratory is kept in --out: the same command resumes where it was stopped.
"""

import contextlib
import dataclasses
import functools
import itertools
import pathlib
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.common import REACHED_BY, hit_share
from benchmarks.labs import describe, drawn_place, kept
from benchmarks.places import HIT_PCT, MISSED_PCT, distances_from_mean
from benchmarks.result import Table, code_key
from cablecast.aiming.propose import hit_chances
from cablecast.evaluation.evaluate import median_interval
from cablecast.motion.polar import PullReach, cast_paces
from cablecast.motion.trajectory import plan_trajectory
from cablecast.pipeline.check import LabCheck, check_tuned
from cablecast.rigs.checked import CheckedRig
from cablecast.rigs.virtual import RigVirtual, VirtualConfig
from cablecast.runs.folder import Parts

LAB_SEED = 500
"""Seed of the virtual laboratory of the first random one."""
LENGTH_MAX = 1.5
"""Length of the longest cable [m]."""
BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
"""Bounds of stated chances that count as one class."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PromisesArgs:
    """Stated chances of a hit in random laboratories."""

    count: int = 60
    """Number of laboratories that reach something."""
    targets: int = 5
    """Targets of each."""
    tries: int = 6
    """Casts at each target that is not hit before."""
    first: int = 0
    """Seed of the first laboratory."""
    minutes: float = 1e6
    """Time after which no other laboratory is begun, and the tables are of those that are done
    [min]."""
    out: pathlib.Path = pathlib.Path("runs/benchmarks/promises")
    """Folder of the results, in which the same command resumes."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResetsArgs:
    """Swings in random laboratories."""

    equal: int = 4
    """Equal polar casts straight ahead with each swing."""
    count: int = 100
    """Seeds of laboratories, of which many have no table that holds the cable."""
    out: pathlib.Path = pathlib.Path("runs/benchmarks/resets")
    """Folder of the results, in which the same command resumes."""


def targets_of(checked: LabCheck, count: int, seed: int) -> list[NDArray[np.float64]]:
    """Return places of the table that casts of some believed cable reach [m]."""
    rng, found = np.random.default_rng([seed, 71]), []
    while len(found) < count:
        place = drawn_place(checked.setup, rng)
        if float(checked.chance(place)) > 0.0:
            found.append(place)
    return found


def play(args: PromisesArgs, seed: int) -> dict[str, Any]:
    """Return what was stated and hit in a laboratory, or why it was refused."""
    start = time.process_time()
    found, checked = begin(seed)
    found["targets"] = []
    if checked is None:
        return found
    setup = checked.setup
    if not checked.reaches_anything:
        return found | {"refused": "check", "reason": "; ".join(checked.limits)}
    config = cc.AimConfig(tries=args.tries)
    lab_config = VirtualConfig(lab_seed=LAB_SEED + seed)
    with cc.make_rig(RigVirtual(setup, 0, lab_config), setup, time_limit=None) as rig:
        try:
            session = cc.prepare_aim(rig, config, progress=cc.ignore)
        except cc.CablecastError as error:
            return found | {"refused": "aim", "reason": str(error)}
        for place in targets_of(checked, args.targets, seed):
            found["targets"].append(aim_at(session, rig, checked, place))
    return found | {"processor_seconds": time.process_time() - start}


def begin(seed: int) -> tuple[dict[str, Any], LabCheck | None]:
    """Return a laboratory as plain values, and what `check` finds; None where it is refused.

    The swing is tuned where `check` advises it.
    """
    lab = describe(seed)
    found: dict[str, Any] = {"lab": lab, "refused": ""}
    if lab["cable"]["length"] > LENGTH_MAX:
        return found | {"refused": "length"}, None
    try:
        setup = cc.Setup.from_dict(lab)
        checked = cc.check(setup, changes=False)
    except cc.CablecastError as error:
        return found | {"refused": "description", "reason": str(error)}, None
    last = tuned(checked) if checked.swing_words else checked
    return found | {"before": swing_row(checked), "after": swing_row(last)}, last


def swing_row(checked: LabCheck) -> dict[str, Any]:
    """Return what `check` says of a swing, and how much of the table casts reach with it."""
    return {
        "straight": checked.resets_straight,
        "possible": bool(np.isfinite(checked.reset_offset)),
        "lays_out": checked.lays_out,
        "reached": float(checked.shares[0]),
    }


def tuned(checked: LabCheck) -> LabCheck:
    """Return the check with a tuned swing, where that is better."""
    try:
        return check_tuned(checked) or checked
    except cc.CablecastError:
        return checked


def aim_at(
    session: cc.AimSession, rig: CheckedRig, checked: LabCheck, place: NDArray[np.float64]
) -> dict[str, Any]:
    """Return what was stated of a target, and what became of it."""
    row: dict[str, Any] = {"xy": place.tolist(), "outlook": checked.outlook_at(place), "within": []}
    row |= {"stated": [], "miss_pct": [], "family": [], "stop": ""}

    def note(proposal: cc.Proposal) -> None:
        left = session.config.tries - proposal.try_number + 1
        family = proposal.action.family
        if not row["within"]:
            chances = hit_chances(proposal.expected, proposal.goal, family, left)
            row["within"] = chances.tolist()
        row["stated"].append(proposal.hit_chance)
        row["family"].append(family)

    try:
        result = cc.aim(session, rig, place, on_proposal=note, progress=cc.ignore)
    except cc.CablecastError as error:
        # The rig failed to make the last of them, and none before it hit.
        return row | {"stop": str(error), "miss_pct": [MISSED_PCT] * len(row["stated"])}
    row["miss_pct"] = [cast.miss_pct if cast.landed else MISSED_PCT for cast in result.casts[0]]
    stop = result.stops[0]
    if stop is not None:
        row["stop"] = stop.reason.name
        if not row["within"]:
            # Left before the first cast: what was stated is the chance of the cast not made.
            row["within"] = [stop.proposal.hit_chance]
    return row


def promises(args: PromisesArgs) -> Iterator[Table]:
    """Yield how often what was stated held, and what became of the laboratories."""
    end = time.monotonic() + 60.0 * args.minutes
    parts = Parts(args.out / code_key(__name__) / f"{args.targets}-{args.tries}")
    found: list[dict[str, Any]] = []
    ran = 0
    for seed in range(args.first, args.first + 20 * args.count):
        if ran == args.count:
            break
        lab = kept(parts, seed, end, functools.partial(play, args, seed))
        if lab is not None:
            found.append(lab)
            ran += not lab["refused"]
    if ran < args.count:
        print(f"{ran} of {args.count} laboratories are done: the same command goes on")
    rows = [row for lab in found for row in lab["targets"]]
    yield outcomes(found)
    yield checks(found, args.tries)
    yield casts(rows)
    yield misses(rows, args.tries)


def hits(row: dict[str, Any], tries: int) -> list[bool]:
    """Return whether a target was hit within 1, 2, ... tries; one that was left was not."""
    hit = [miss <= HIT_PCT for miss in row["miss_pct"]]
    return [any(hit[: number + 1]) for number in range(tries)]


def outcomes(found: Sequence[dict[str, Any]]) -> Table:
    """Return how many laboratories were played, and why others were not."""
    names = {
        "": "played",
        "length": f"not drawn for: a cable longer than {LENGTH_MAX:g} m",
        "description": "refused: the description",
        "check": "refused: by check",
        "aim": "given up by aim before a target",
    }
    rows = [(words, sum(lab["refused"] == name for lab in found)) for name, words in names.items()]
    return Table("Laboratories", ("outcome", "labs"), [row for row in rows if row[1]])


def resets(args: ResetsArgs) -> Iterator[Table]:
    """Yield how swings lay the cable out in simulation, and where equal polar casts land."""
    parts = Parts(args.out / code_key(__name__) / f"{args.equal}")
    found: list[dict[str, Any]] = []
    for seed in range(args.count):
        lab = kept(parts, seed, float("inf"), functools.partial(swings, args, seed))
        found += [lab] if lab and not lab["refused"] else []
    simulated, played = [], []
    both = [lab for lab in found if min(len(lab[n]["xy"]) for n in ("before", "after")) > 1]
    for name, words in (("before", "the standard one"), ("after", "a tuned one where better")):
        own = [lab[name] for lab in found]
        kinds = [sum(row[kind] for row in own) for kind in ("possible", "straight", "lays_out")]
        reached = 100.0 * float(np.median([row["reached"] for row in own]))
        simulated.append((words, len(own), *kinds, reached))
        apart = np.array([_apart(lab, name) for lab in both])
        close = hit_share(int(np.sum(apart <= HIT_PCT)), len(apart))
        played.append((words, len(both), *median_interval(apart), *close))
    columns = ("swing", "labs", "the arm can follow", "reset straight", "polar casts straight")
    yield Table("Swings", (*columns, "of the table reached, median [%]"), simulated)
    columns = ("swing", "labs", "median [% of length]", "low", "high")
    columns += (f"within {HIT_PCT:g} % [% of labs]", "low", "high")
    yield Table("Equal polar casts, distance from their middle", columns, played)


def swings(args: ResetsArgs, seed: int) -> dict[str, Any]:
    """Return what `begin` does, and where equal polar casts straight ahead end with each swing.

    They end at `xy` [m]; one that did not land is left out.
    """
    found, checked = begin(seed)
    if checked is None:
        return found
    before = cc.Setup.from_dict(found["lab"])
    for name, setup in (("before", before), ("after", checked.setup)):
        again = name == "after" and setup == before
        found[name]["xy"] = found["before"]["xy"] if again else equal_casts(setup, seed, args.equal)
    return found


def equal_casts(setup: cc.Setup, seed: int, count: int) -> list[list[float]]:
    """Return where equal polar casts straight ahead end [m]; none where the arm follows none."""
    motion = None
    with contextlib.suppress(cc.CablecastError):
        reach = PullReach.of(setup)
        for pace in cast_paces(setup):
            with contextlib.suppress(cc.CablecastError):
                motion = plan_trajectory(reach.ahead(pace), setup)
                break
    ends: list[list[float]] = []
    if motion is None:
        return ends
    rig = RigVirtual(setup, 0, VirtualConfig(lab_seed=LAB_SEED + seed))
    with cc.make_rig(rig, setup, time_limit=None) as checked:
        for _ in range(count):
            with contextlib.suppress(cc.CablecastError):
                checked.reset()
                xy = checked.execute(motion).endpoint_xy[-1]
                ends += [xy.tolist()] if np.isfinite(xy).all() else []
    return ends


def _apart(lab: dict[str, Any], name: str) -> float:
    """Return the median distance of equal casts from their mean [% of cable length]."""
    ends = np.array(lab[name]["xy"])
    return float(np.median(distances_from_mean(ends, lab["lab"]["cable"]["length"])))


def checks(found: Sequence[dict[str, Any]], tries: int) -> Table:
    """Return the share of targets that was hit by what `check` says of them before any cast.

    Next to it are the shares in either half of the laboratories, every other one.
    """
    table = []
    played = [lab for lab in found if not lab["refused"]]
    for name, words in REACHED_BY.items():
        own = [
            (number % 2, hits(row, tries))
            for number, lab in enumerate(played)
            for row in lab["targets"]
            if row["outlook"] == name
        ]
        for number in range(tries):
            halves = [[hit[number] for half, hit in own if half == which] for which in (0, 1)]
            means = [100.0 * float(np.mean(half)) if half else None for half in halves]
            shares = hit_share(sum(hit[number] for _, hit in own), len(own))
            table.append((words, number + 1, len(own), *shares, *means))
    columns = ("reached by", "tries", "targets", "hit [%]", "low", "high", "one half", "other half")
    return Table("What check says before any cast", columns, table)


def casts(rows: Sequence[dict[str, Any]]) -> Table:
    """Return the chances that `aim` stated of casts, and of all tries, and how often they held."""
    groups = {
        "the first cast": [(row["stated"][:1], row["miss_pct"][:1]) for row in rows],
        "a later cast": [(row["stated"][1:], row["miss_pct"][1:]) for row in rows],
    }
    table = []
    for name, pairs in groups.items():
        stated = np.array([chance for chances, _ in pairs for chance in chances])
        hit = np.array([m <= HIT_PCT for _, misses in pairs for m in misses])
        table += classes(name, stated, hit)
    for number in (2, 4):
        own = [row for row in rows if len(row["within"]) >= number]
        stated = np.array([row["within"][number - 1] for row in own])
        hit = np.array([hits(row, number)[-1] for row in own])
        table += classes(f"{number} tries", stated, hit)
    columns = ("of", "stated between [%]", "number", "stated, mean [%]", "hit [%]", "low", "high")
    return Table("What aim says before casts", columns, table)


def classes(name: str, stated: NDArray[np.float64], hit: NDArray[np.bool_]) -> list[tuple]:
    """Return a row for each class of stated chances, and one for all of them."""
    rows = []
    for low, high in (*itertools.pairwise(BINS), (0.0, 1.0)):
        last = high == BINS[-1]
        own = (stated >= low) & ((stated <= high) if last else (stated < high))
        if own.any():
            words = "any" if (low, high) == (0.0, 1.0) else f"{100 * low:.0f} to {100 * high:.0f}"
            mean = 100.0 * float(stated[own].mean())
            count = int(own.sum())
            rows.append((name, words, count, mean, *hit_share(int(hit[own].sum()), count)))
    return rows


def misses(rows: Sequence[dict[str, Any]], tries: int) -> Table:
    """Return the misses after each try; a target that was hit or left keeps its last miss."""
    table = []
    own = [row["miss_pct"] for row in rows if row["miss_pct"]]
    shares = 100.0 * np.mean([hits(row, tries) for row in rows], axis=0)
    for number, hit in enumerate(shares.tolist()):
        values = np.array([misses[min(number, len(misses) - 1)] for misses in own])
        table.append((number + 1, len(values), *median_interval(values), hit))
    columns = ("tries", "targets", "median", "low", "high", "hit of all targets [%]")
    return Table("Miss after each try [% of cable length]", columns, table)
