"""Strikes on the strike laboratory, with the verb's own session: misses of each try, with floors.

Each rope has one session, as `cablecast aim --task strike` makes it: all swings count for each
target. Targets are places that a random move of the lab file passes with the true cable, drawn by a
seed, so that each can be struck. A try that hit is not the end: all tries are made.

The floor of a try is the median distance between the closest points of equal swings of its move and
their mean: the laboratory never repeats itself better.
"""

import concurrent.futures
import dataclasses
import functools
import pathlib
import sys
import time
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from benchmarks.irp import interval
from benchmarks.result import Table, code_key
from cablecast.aiming.config import AimConfig
from cablecast.cable import load_cable
from cablecast.cast import Cast
from cablecast.conventions import Array
from cablecast.motion.joint_move import JointMoves, SwingPlane
from cablecast.motion.trajectory import plan_trajectory
from cablecast.pipeline.strike import prepare_strike
from cablecast.rigs.make import make_rig
from cablecast.runs.folder import Parts, fingerprint
from cablecast.runs.progress import ignore
from cablecast.setup import Setup, StrikeConfig
from cablecast.task import STRIKE, closest

WITHIN_PCT = 0.8
"""Distance at which a try is made again as it was [% of cable length]: half a centimetre."""
EARLIEST = 0.3
"""Time before which the tip has hardly moved [s]."""
AWAY = 0.25
"""Least distance of a target from where the tip hangs at the start [m]."""
UNSEEN = 1.0
"""Miss of a swing whose tip was not seen, or that was broken off [m]."""
_DRAWN = 512
"""Random moves of which the first are taken, so that fewer targets are the first of more."""
GAP = 0.12
"""Least distance of a target from the stick's end when the tip passes [m]: a person would not set a
target where the stick is."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Strike targets on the strike laboratory.

    Attributes:
        cables: Cables.
        targets: Number of targets of each.
        tries: Number of tries at each target.
        repeats: Equal swings of a move that tell its floor.
        lab: Seed of the laboratory.
        seed: Seed of targets and rig.
        workers: Processes, each of one thread.
        out: Folder of the sessions, in which the same command resumes.
    """

    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    targets: int = 33
    tries: int = 4
    repeats: int = 3
    lab: int = 0
    seed: int = 0
    workers: int = 2
    out: pathlib.Path = pathlib.Path("runs/benchmarks/strike")


def draw_targets(setup: Setup, rig: Any, count: int, seed: int) -> Array:
    """Return places that random moves pass with the true cable [m], shape [target, 2]."""
    from scipy.stats import qmc

    moves, plane = JointMoves.of(setup), SwingPlane.of(JointMoves.of(setup))
    rng = np.random.default_rng([seed, 31])
    units = qmc.Sobol(moves.size, rng=rng).random(_DRAWN)
    units = units[moves.feasible(units)]
    found: list[Array] = []
    for number, unit in enumerate(units):
        if len(found) == count:
            break
        # Swings that nobody counts: those of a purpose of their own.
        rig.seek(number, "tune")
        rig.reset()
        track = rig.execute(plan_trajectory(moves.move(unit), setup))
        tip = plane.coordinates(track.nodes[:, -1])[:, :2]
        root = plane.coordinates(track.nodes[:, 0])[:, :2]
        good = track.times > EARLIEST
        good &= np.linalg.norm(tip - tip[0], axis=1) > AWAY
        good &= np.linalg.norm(tip - root, axis=1) > GAP
        if good.any():
            found.append(tip[rng.choice(np.flatnonzero(good))])
    return np.array(found)


def truth(cast: Cast, goal: Array) -> float:
    """Return the distance of the true path from a goal [m], in space."""
    nodes = cast.track.nodes
    return float(closest(nodes[:, -1], goal)[0]) if nodes is not None else np.nan


def floor(rig: Any, cast: Cast, goal: Array, first: int, count: int) -> float:
    """Return the median distance of closest points of equal swings from their mean [m]."""
    trajectory = plan_trajectory(cast.action, rig.setup)
    points = []
    for number in range(count):
        rig.seek(first + number, "repeat")
        rig.reset()
        track = rig.execute(trajectory)
        points.append(STRIKE.outcome_at(track.nodes[:, -1], goal))
    return float(np.median(np.linalg.norm(np.array(points) - np.mean(points, axis=0), axis=1)))


def strike(cable: str, args: Args, folder: pathlib.Path) -> list[dict[str, Any]]:
    """Return seen and true misses [m], floors [m], chances [-] and times [s] of each target."""
    # As `cablecast aim --task strike --cable CABLE` has it.
    setup = Setup(cable=load_cable(cable), strike=StrikeConfig())
    rig = make_rig(f"virtual:{args.lab}", setup, args.seed)
    config = AimConfig(within_pct=WITHIN_PCT, tries=args.tries, seed=args.seed)
    session = prepare_strike(rig, config, out=folder / cable, progress=ignore)
    parts = Parts(folder / f"{cable}-targets", fingerprint([args.tries, args.repeats, args.seed]))
    targets = np.array(
        parts.get_or_make(
            f"targets-{args.targets}",
            lambda: {"uv": draw_targets(setup, rig, args.targets, args.seed).tolist()},
        )["uv"]
    )
    made = []
    for number, goal in enumerate(session.goals(targets)):
        one = functools.partial(_strike_goal, session, rig, goal, args, number)
        row = parts.get_or_make(str(number), one)
        made.append(row)
        print(cable, number, np.round(100.0 * np.array(row["true"]), 1), file=sys.stderr)
    return made


def _strike_goal(session: Any, rig: Any, goal: Any, args: Args, number: int) -> dict[str, Any]:
    seconds = []
    while len(session.casts_at(goal.value)) < args.tries:
        start = time.process_time()
        proposal = session.propose(goal)
        seconds.append(time.process_time() - start)
        session.cast(rig, proposal)
    casts = session.casts_at(goal.value)
    length = session.setup.cable.length
    floors: list[float] = []
    for k, cast in enumerate(casts):
        first = (number * args.tries + k) * args.repeats
        earlier = [one.action for one in casts[:k]]
        if cast.action in earlier:
            # A move that was made again has the floor that it had.
            floors.append(floors[earlier.index(cast.action)])
        else:
            floors.append(floor(rig, cast, goal.value, first, args.repeats))
    return {
        "seen": _counted(cast.miss_pct * length / 100.0 for cast in casts),
        "true": _counted(truth(cast, goal.value) for cast in casts),
        "floor": _counted(floors),
        "inside": [bool(cast.proposal.expected.holds(cast.outcome, 0.9)) for cast in casts],
        "seconds": seconds,
    }


def _counted(distances: Iterable[float]) -> list[float]:
    """Return distances [m] with `UNSEEN` in place of those that are not known."""
    return [distance if np.isfinite(distance) else UNSEEN for distance in distances]


def main(args: Args) -> Iterator[Table]:
    """Strike the targets of every cable, and yield a table of misses and one of times."""
    folder = args.out / code_key(__name__) / f"lab-{args.lab}-seed-{args.seed}"
    with concurrent.futures.ProcessPoolExecutor(args.workers) as pool:
        futures = {cable: pool.submit(strike, cable, args, folder) for cable in args.cables}
        found = {cable: future.result() for cable, future in futures.items()}
    columns = ("cable", "try", "median", "low", "high", "mean", "seen", "floor", "held", "targets")
    rows: list[tuple[Any, ...]] = []
    for cable, made in [*found.items(), ("all", [row for of in found.values() for row in of])]:
        true = 100.0 * np.array([row["true"] for row in made])
        seen, floors = (np.median([row[k] for row in made], axis=0) for k in ("seen", "floor"))
        held = np.mean([row["inside"] for row in made], axis=0)
        low, high = interval(true, np.median)
        for k, own in enumerate(true.T):
            misses = (np.median(own), low[k], high[k], own.mean())
            others = (100.0 * seen[k], 100.0 * floors[k], 100.0 * held[k])
            rows.append((cable, k + 1, *misses, *others, len(made)))
    yield Table("Miss of each try [cm], from 1", columns, rows)
    spent = [s for of in found.values() for row in of for s in row["seconds"]]
    yield Table(
        "Time of one core for each plan [s]",
        ("median", "p90", "most"),
        [(np.median(spent), *np.percentile(spent, [90, 100]))],
    )
