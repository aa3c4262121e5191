"""Strikes from a direction: the tip arrives at a goal within 5 cm, within 10 deg, at 1 m/s or more.

Goals and directions are points of swings of random moves, so that some move reaches each. The rope
is known, and the engine that plans is the world: this measures the search for a move alone. The arm
is that of irp_world.py.
"""

import dataclasses
import functools
import pathlib
import sys
import time
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from benchmarks.irp import model
from benchmarks.result import Table, code_key
from cablecast.aiming.strike import StrikeAim, StrikePrior
from cablecast.cable import Cable
from cablecast.conventions import Array
from cablecast.engines.swing import SAMPLE_DT, SwingModel
from cablecast.runs.folder import Parts, fingerprint
from cablecast.task import STRIKE, Arrival, closest
from cablecast.tuning.tips import TipBelief, air_cable

ROPES = {
    "0.7 m": air_cable(0.7, 0.08, 0.03, 0.3, 0.0173, drag_ratio=0.15),
    "1.0 m": air_cable(1.0, 0.06, 0.03, 0.3, 0.0173, drag_ratio=0.15),
    "1.3 m": air_cable(1.3, 0.04, 0.03, 0.3, 0.0173, drag_ratio=0.15),
}
"""Ropes by their lengths."""
DURATION = 2.5
"""Duration of a swing [s]."""
WITHIN, WITHIN_DEG, LEAST_SPEED = 0.05, 10.0, 1.0
"""What counts: distance [m], angle [deg] and speed [m/s]."""
LATE = 0.3
"""Time from which on goals are drawn of a path [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Strike goals from their directions.

    Attributes:
        goals: Number of goals of each rope.
        searches: Largest number of searches for a goal, of which the best counts.
        seed: Seed of goals and searches.
        out: Folder of the finished goals, in which the same command resumes.
    """

    goals: int = 40
    searches: int = 3
    seed: int = 0
    out: pathlib.Path = pathlib.Path("runs/benchmarks/arrival")


@functools.cache
def world() -> SwingModel:
    """Return the arm, whose swings take `DURATION`."""
    return dataclasses.replace(model(), duration=DURATION)


def swing(rope: Cable, unit: Array) -> Array:
    """Return the tip of a move until its first contact [m], shape [step, 3]."""
    swings = world().play(world().motion(unit), rope, nodes=True)
    return swings.tip[0][: max(int(swings.contacts(np.array([0]))[0]), 2)]


def draw_goals(rope: Cable, count: int, seed: int) -> list[Arrival]:
    """Return goals with directions in which random moves pass them fast enough."""
    rng, found = np.random.default_rng([seed, round(1e3 * rope.length)]), []
    while len(found) < count:
        tip = swing(rope, rng.random(world().moves.size))
        speed = np.linalg.norm(np.diff(tip, axis=0), axis=1) / SAMPLE_DT
        steps = np.flatnonzero(speed >= LEAST_SPEED)
        steps = steps[steps >= LATE / SAMPLE_DT]
        if not len(steps):
            continue
        step = int(rng.choice(steps))
        way = tip[step + 1] - tip[step]
        found.append(
            Arrival(
                goal=tuple((0.5 * (tip[step] + tip[step + 1])).tolist()),
                direction=tuple(way.tolist()),
                dt=SAMPLE_DT,
                within_deg=WITHIN_DEG,
                least_speed=LEAST_SPEED,
            )
        )
    return found


def arrived(tip: Array, asked: Arrival) -> tuple[float, float, float]:
    """Return the distance [m], the angle [deg] and the speed [m/s] at the closest point."""
    velocity = STRIKE.arrival(tip, asked.goal, asked.dt)
    speed, way = float(np.linalg.norm(velocity)), np.array(asked.direction)
    cosine = velocity @ way / max(speed * float(np.linalg.norm(way)), 1e-12)
    angle = float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return float(closest(tip, asked.goal)[0]), angle, speed


def good(distance: float, angle: float, speed: float) -> NDArray[np.bool_]:
    """Return whether distance [m], angle [deg] and speed [m/s] are as asked, shape [3]."""
    return np.array([distance <= WITHIN, angle <= WITHIN_DEG, speed >= LEAST_SPEED])


@functools.cache
def prior(name: str, seed: int) -> StrikePrior:
    """Return the simulated swings of a rope."""
    belief = TipBelief(cable=ROPES[name], deviations=(1.0, 1.0, 1.0, 1.0, 1.0))
    return StrikePrior.simulate(world(), belief, seed, checked=False, cable_count=1)


def strike(name: str, asked: Arrival, searches: int, seed: int) -> dict[str, list[float]]:
    """Return distance [m], angle [deg], speed [m/s] and time of one core [s] of each search.

    A search whose move arrives as asked is the last.
    """
    found: dict[str, list[float]] = {"distance": [], "angle": [], "speed": [], "seconds": []}
    rope, swings = ROPES[name], prior(name, seed)
    for number in range(searches):
        start = time.process_time()
        aim = StrikeAim(swings, asked.goal, cable=rope, loss=asked, seed=seed + number)
        unit = aim.propose()
        seconds = time.process_time() - start
        made = arrived(swing(rope, unit), asked)
        for values, value in zip(found.values(), (*made, seconds), strict=True):
            values.append(value)
        if good(*made).all():
            break
    return found


def main(args: Args) -> Iterator[Table]:
    """Strike the goals of each rope, and yield a table of how many arrived as asked."""
    settings = {"seed": args.seed, "searches": args.searches, "ropes": repr(ROPES)}
    folder = args.out / code_key(__name__) / f"seed-{args.seed}-searches-{args.searches}"
    parts = Parts(folder, fingerprint(settings))
    rows, everything = [], []
    for name, rope in ROPES.items():
        found = []
        for number, asked in enumerate(draw_goals(rope, args.goals, args.seed)):
            made = functools.partial(strike, name, asked, args.searches, args.seed)
            found.append(parts.get_or_make(f"{name}-{number}", made))
            last = [round(values[-1], 3) for values in found[-1].values()]
            print(name, number, last, file=sys.stderr, flush=True)
        rows.append((name, *_row(found)))
        everything += found
    rows.append(("all", *_row(everything)))
    columns = (
        "rope",
        "goals",
        "first search [%]",
        f"best of {args.searches} [%]",
        "within 5 cm [%]",
        "within 10 deg [%]",
        "1 m/s or more [%]",
        "median distance [cm]",
        "median angle [deg]",
        "time of one core for a search [s]",
    )
    yield Table("Arrivals as asked", columns, rows)


def _row(found: list[dict[str, list[float]]]) -> tuple:
    """Return the number of goals, shares [%], medians, and the median time [s]."""
    made = [
        np.array([one["distance"], one["angle"], one["speed"], one["seconds"]]).T for one in found
    ]
    marks = [np.array([good(*row[:3]) for row in one]) for one in made]
    # The best of the searches at each goal: that with most of what was asked.
    best = [int(np.argmax(mark.sum(axis=1))) for mark in marks]
    first = 100.0 * float(np.mean([mark[0].all() for mark in marks]))
    every = 100.0 * float(np.mean([mark[at].all() for mark, at in zip(marks, best, strict=True)]))
    shares = 100.0 * np.mean([mark[at] for mark, at in zip(marks, best, strict=True)], axis=0)
    rows = np.array([one[at] for one, at in zip(made, best, strict=True)])
    distance, angle = np.median(rows[:, :2], axis=0)
    seconds = float(np.median(np.concatenate(made)[:, 3]))
    return len(found), first, every, *shares.tolist(), 100.0 * distance, float(angle), seconds
