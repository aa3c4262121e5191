"""Strikes with a whip on another author's benchmark (whip_world.py).

Search: the whip is known, and its simulation may run 600 times for each target. Transfer: nothing
is known of the whip but what is believed of whips. It is simulated by fewer links with longer
steps. The first try is the move that misses least on average over whips as they are believed to be.
Then that model is fitted to the tips of the tries that were seen, and a move near these is searched
for in it.
"""

import dataclasses
import functools
import pathlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.result import Table, code_key
from benchmarks.whip_world import (
    DT,
    LINKS,
    SAMPLE_DT,
    TARGETS,
    Whip,
    World,
    durations,
    hand,
    moves,
)
from cablecast.cable import Cable
from cablecast.conventions import Array
from cablecast.runs.folder import Parts, fingerprint
from cablecast.task import closest
from cablecast.tuning.tips import TipBelief, TipPosterior, TipSwing, air_cable, fit_tips

HIT = 0.03
"""Distance within which the published target is struck [m]."""
BUDGET = 600
"""Simulations that a search may take."""
DRAWN, SPREAD_COUNT = 4096, 64
"""Moves of which the first ones are chosen by where the hand goes, and number of the first ones."""
START_COUNT, START_STEPS = 3, 32
"""First moves that are refined, and simulations for each."""
DIFFERENCE, RADIUS, RADII = 0.02, 0.15, (2e-3, 0.4)
"""Step of a difference, first radius of trust, and its bounds, in unit coordinates [-]."""
MODEL_RADII = 0.1, 1e-4
"""First and last radius of trust of quadratic models, in unit coordinates [-]."""

BELIEVED = air_cable(1.6, 0.13, 0.06, 0.25, 0.024)
DEVIATIONS = (1.3, 1.5, 2.0, 2.0, 1.0)
"""What is believed of a whip: length, mass per length, stiffness over it and damping time, each
within a factor. The benchmark's has 1.8 m, 0.17 kg/m, 0.105 m^4/s² and 0.38 s, and no drag."""
MODEL_NODES, MODEL_DT = 12, 5e-4
"""Links of the model of an unknown whip, and its step [s]; the world has 25 and 0.1 ms."""
CANDIDATES, APART, BELIEVED_COUNT = 24, 0.1, 8
"""First tries among which whips as they are believed decide, least distance between two of them in
unit coordinates, and number of the whips."""
ALIKE = 0.3
"""Distance of moves, in unit coordinates, over which errors of the model are much alike [-]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Strike the six targets of the whip's benchmark.

    Attributes:
        targets: Numbers of the targets, from 1.
        tries: Number of tries with an unknown whip; 0 leaves them out.
        seed: Seed of the searches.
        out: Folder of the finished targets, in which the same command resumes.
    """

    targets: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    tries: int = 3
    seed: int = 0
    out: pathlib.Path = pathlib.Path("runs/benchmarks/whip")


@dataclasses.dataclass(frozen=True, eq=False)
class Point:
    """A move that was simulated.

    Attributes:
        unit: Move in unit coordinates, shape [9].
        tip: Path of its tip [m], shape [step, 3].
        miss: Closest distance from the target [m].
        place: Step of the closest point.
    """

    unit: Array
    tip: Array
    miss: float
    place: float

    @classmethod
    def of(cls, unit: Array, tip: Array, target: Array) -> "Point":
        """Return the point of a move whose tip was simulated, until a whip that broke."""
        good = np.isfinite(tip).all(axis=1)
        tip = tip[: max(int(np.argmin(good)), 2)] if not good.all() else tip
        miss, place = closest(tip, target)
        return cls(unit, tip, float(miss), float(place))

    def at(self, place: float) -> Array:
        """Return the tip at a step [m], shape [3]."""
        place = min(place, len(self.tip) - 1.001)
        before = int(place)
        return self.tip[before] + (place - before) * (self.tip[before + 1] - self.tip[before])


class _OverError(Exception):
    """A search is over: the target is struck, or the budget used up."""


class Search:
    """A search for a move that strikes a target.

    First moves are those of many draws whose hand passes the direction of the target and stops
    beyond: the draws cost no simulation. The best of them are refined by steps of Gauss and Newton
    within a radius of trust, over the offset of the closest point across the path. Near the whip's
    full reach that offset cannot vanish: quadratic models of the miss itself follow (COBYQA).

    Args:
        play: Returns the path of the tip of a move [m], shape [step, 3].
        target: Target [m], shape [3].
        seed: Seed of the draws.
        within: Distance at which the search ends [m].
    """

    def __init__(
        self,
        play: Callable[[Array], Array],
        target: Sequence[float] | Array,
        seed: int,
        *,
        within: float = HIT,
    ):
        self.play, self.target = play, np.array(target)
        self.within = within
        self.rng = np.random.default_rng(seed)
        self.points: list[Point] = []

    @property
    def count(self) -> int:
        """Simulations so far."""
        return len(self.points)

    @property
    def best(self) -> Point:
        """Best move so far."""
        return min(self.points, key=lambda point: point.miss)

    def run(self, known: Sequence[Array] = ()) -> Point:
        """Return the best move near moves that were tried, or anywhere where none were."""
        try:
            first = [self.try_(unit) for unit in (known or self.spread())]
            first.sort(key=lambda point: point.miss)
            for point in first[:START_COUNT]:
                self.step(point)
            self.follow()
        except _OverError:
            pass
        return self.best

    def try_(self, unit: Array) -> Point:
        """Simulate a move."""
        point = Point.of(unit, self.play(unit), self.target)
        self.points.append(point)
        if self.best.miss <= self.within or self.count >= BUDGET:
            raise _OverError
        return point

    def spread(self) -> Array:
        """Return first moves, shape [move, 9]."""
        from scipy.stats import qmc

        units = qmc.Sobol(9, rng=self.rng).random(DRAWN)
        values = moves(units)
        start, end = hand(values[:, :4]), hand(values[:, 4:8])
        way = self.target / np.linalg.norm(self.target)
        normal = np.cross(start, end)
        beside = np.abs(normal @ way) / np.linalg.norm(normal, axis=1)
        reach = sum(link[0] for link in LINKS)
        order = np.argsort(beside - end @ way / reach, kind="stable")
        return units[order[: 4 * SPREAD_COUNT : 4]]

    def step(self, point: Point) -> None:
        """Refine a move by steps of Gauss and Newton."""
        end, radius, fails, slope, age = self.count + START_STEPS, RADIUS, 0, None, 0
        while radius > RADII[0] and self.count < end:
            if slope is None:
                slope, best = self.slope(point, min(DIFFERENCE, radius))
                point, age = min(point, best, key=lambda one: one.miss), 0
            tried = self.try_(np.clip(point.unit + self.move(point, slope, radius), 0.0, 1.0))
            moved, age = tried.unit - point.unit, age + 1
            expected = point.miss - np.linalg.norm(
                self.across(point, point.at(point.place) - self.target + slope @ moved)
            )
            # Broyden's update.
            change = tried.at(point.place) - point.at(point.place) - slope @ moved
            slope = slope + np.outer(change, moved) / max(moved @ moved, 1e-12)
            gain = point.miss - tried.miss
            point = tried if gain > 0.0 else point
            if gain > 0.5 * expected:
                radius, fails = min(1.7 * radius, RADII[1]), 0
            elif gain > 0.1 * expected:
                fails = 0
            else:
                radius, fails = 0.4 * float(np.linalg.norm(moved)) + 1e-6, fails + 1
            if fails >= 2 and age > 2:
                slope, fails = None, 0

    def slope(self, point: Point, size: float) -> tuple[Array, Point]:
        """Return the derivative of the tip by the move, [3, 9], and the best move on the way."""
        tried = []
        for number, value in enumerate(point.unit):
            unit = point.unit.copy()
            unit[number] += size if value < 0.5 else -size
            tried.append(self.try_(unit))
        columns = [
            (one.at(point.place) - point.at(point.place)) / (one.unit - point.unit)[number]
            for number, one in enumerate(tried)
        ]
        return np.stack(columns, axis=1), min(tried, key=lambda one: one.miss)

    def across(self, point: Point, offset: Array) -> Array:
        """Return what of an offset lies across the path at its closest point."""
        before = min(max(int(point.place), 1), len(point.tip) - 2)
        way = point.tip[before + 1] - point.tip[before - 1]
        return offset - way * (way @ offset) / max(way @ way, 1e-12)

    def move(self, point: Point, slope: Array, radius: float) -> Array:
        """Return the step within a radius after which the offset is least, shape [9]."""
        offset = self.across(point, point.at(point.place) - self.target)
        matrix = np.stack([self.across(point, column) for column in slope.T], axis=1)
        free, step = np.ones(len(point.unit), dtype=bool), np.zeros(len(point.unit))
        for _ in range(len(free)):
            u, s, vt = np.linalg.svd(matrix[:, free], full_matrices=False)
            damping = 1e-6 * s[0] ** 2
            while True:
                step = np.zeros(len(free))
                step[free] = -vt.T @ (s / (s**2 + damping) * (u.T @ offset))
                if np.linalg.norm(step) <= radius or damping > 1e6 * s[0] ** 2:
                    break
                damping *= 1.5
            low = (point.unit <= 1e-9) & (step < 0.0)
            out = free & (low | ((point.unit >= 1.0 - 1e-9) & (step > 0.0)))
            if not out.any() or out.sum() == free.sum():
                break
            free &= ~out
        return step

    def follow(self) -> None:
        """Follow quadratic models of the miss about the best move until the search is over."""
        from scipy.optimize import minimize

        def miss(unit: Array) -> float:
            return self.try_(np.clip(unit, 0.0, 1.0)).miss

        while True:
            start, bounds = self.best.unit, [(0.0, 1.0)] * len(self.best.unit)
            radii = {"initial_tr_radius": MODEL_RADII[0], "final_tr_radius": MODEL_RADII[1]}
            minimize(miss, start, method="COBYQA", bounds=bounds, options=radii)


class WhipModel:
    """The model of an unknown whip, as `fit_tips` plays it."""

    def motion(self, unit: Array, duration: float) -> tuple[Array, float]:
        """Return a move and its duration [s]."""
        return unit, duration

    def play(self, motion: tuple[Array, float], cables: Sequence[Cable]) -> SimpleNamespace:
        """Return the tips of whips at every `SAMPLE_DT` [m], shape [whip, sample, 3]."""
        return SimpleNamespace(tip=np.array([simulated(cable)(*motion) for cable in cables]))


def simulated(cable: Cable) -> Callable[..., Array]:
    """Return the model of a whip: the tip of a move at every `SAMPLE_DT` [m], as `World.swing`."""
    params = cable.params
    whip = Whip(
        length=cable.length,
        mass=float(params.mass),
        bend_stiffness=float(params.bend_stiffness),
        damping_time=float(params.damping_time),
        node_count=MODEL_NODES,
    )
    world, every = World(whip, MODEL_DT), round(SAMPLE_DT / MODEL_DT)
    return lambda *motion: world.swing(*motion)[::every]


def search(number: int, seed: int) -> dict[str, Any]:
    """Search for a move at a target with the known whip."""
    start = time.process_time()
    found = Search(World(Whip(), DT).swing, TARGETS[number - 1], seed)
    miss = found.run().miss
    return {"miss": miss, "count": found.count, "seconds": time.process_time() - start}


def transfer(number: int, seed: int, tries: int) -> dict[str, Any]:
    """Return the misses [m] of tries at a target with an unknown whip, and the time of each [s]."""
    world, target = World(Whip(), DT), np.array(TARGETS[number - 1])
    belief = TipBelief(cable=BELIEVED, deviations=DEVIATIONS)
    seen: list[TipSwing] = []
    posterior: TipPosterior | None = None
    misses: list[float] = []
    seconds: list[float] = []
    for _ in range(tries):
        start = time.process_time()
        if not seen:
            unit = robust(belief, target, seed)
        else:
            posterior = fit_tips(
                WhipModel(),
                belief,
                seen,
                known=None if posterior is None else posterior.points,
                draw_count=64,
                start_count=3,
                steps=6,
                seed=len(seen),
            )
            play = corrected(simulated(posterior.cable), seen[-1])
            aim = Search(play, target, seed, within=0.1 * HIT)
            unit = aim.run([one.unit for one in seen]).unit
        seconds.append(time.process_time() - start)
        tip = world.swing(unit)
        misses.append(float(closest(tip, target)[0]))
        seen.append(TipSwing(unit=unit, tip=tip[:: round(SAMPLE_DT / DT)]))
        if misses[-1] <= HIT:
            # The same swing again.
            misses += [misses[-1]] * (tries - len(misses))
            break
    return {"misses": misses, "seconds": seconds}


def robust(belief: TipBelief, target: Array, seed: int) -> Array:
    """Return the first try: of good moves of the most likely whip, the one that most whips bear."""
    found = Search(simulated(BELIEVED), target, seed, within=0.0)
    found.run()
    units: list[Array] = []
    for point in sorted(found.points, key=lambda point: point.miss):
        if all(np.linalg.norm(point.unit - unit) > APART for unit in units):
            units.append(point.unit)
        if len(units) == CANDIDATES:
            break
    drawn = belief.draw(BELIEVED_COUNT, np.random.default_rng(seed))
    plays = [simulated(cable) for cable in belief.cables(drawn)]
    misses = [[Point.of(unit, play(unit), target).miss for play in plays] for unit in units]
    return units[int(np.argmin(np.mean(misses, axis=1)))]


def corrected(plain: Callable[[Array], Array], last: TipSwing) -> Callable[[Array], Array]:
    """Return a model to which is added what it gets wrong of the last try, near it."""
    # A longer move than the last is followed for longer than that was seen.
    error = np.zeros((round(float(durations(np.ones((1, 9)))[0]) / SAMPLE_DT) + 2, 3))
    played = plain(last.unit)
    size = min(len(played), len(last.tip))
    error[:size] = last.tip[:size] - played[:size]
    error[size:] = error[size - 1]

    def play(unit: Array) -> Array:
        """Return the path of a move."""
        tip = plain(unit)
        share = np.exp(-0.5 * np.sum((unit - last.unit) ** 2) / ALIKE**2)
        return tip + share * error[: len(tip)]

    return play


def main(args: Args) -> Iterator[Table]:
    """Strike the targets, and yield a table of searches and one of tries with an unknown whip."""
    folder = args.out / code_key(__name__) / f"seed-{args.seed}-tries-{args.tries}"
    parts = Parts(folder, fingerprint({"seed": args.seed, "tries": args.tries}))
    rows = []
    for number in args.targets:
        found = parts.get_or_make(f"search-{number}", functools.partial(search, number, args.seed))
        print(number, found, file=sys.stderr, flush=True)
        rows.append((number, *TARGETS[number - 1], 100.0 * found["miss"], found["count"]))
    columns = ("target", "x [m]", "y [m]", "z [m]", "closest approach [cm]", "simulations")
    yield Table("Known whip: search", columns, rows)
    if not args.tries:
        return
    rows = []
    for number in args.targets:
        made = functools.partial(transfer, number, args.seed, args.tries)
        found = parts.get_or_make(f"transfer-{number}", made)
        print(number, found, file=sys.stderr, flush=True)
        misses = [100.0 * miss for miss in found["misses"]]
        rows.append((number, *misses, max(found["seconds"])))
    heads = [f"try {number} [cm]" for number in range(args.tries)]
    columns = ("target", *heads, "most time of one core [s]")
    yield Table("Unknown whip: fit, then aim", columns, rows)
