"""One model for many cables beside a model for each: errors of landings and at targets, and time.

Cables are drawn from the ranges that `tune` searches, with another seed than those of the training.
For each, the landings of random casts are compared with those that the model of many cables
predicts at its parameters, and with those of a model that was trained on casts of this cable alone.
Both models then plan casts at targets, which are simulated. The parameters are known exactly, so
that all errors are those of the models.

Each cable is kept in --out: the same command goes on where it was stopped. Intervals hold 90 % of
2,000 bootstrap draws of the cables.
"""

import dataclasses
import pathlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.common import Table
from cablecast.cli.progress import console_progress
from cablecast.datasets.schema import ENDPOINT_COLUMNS
from cablecast.datasets.simulate import simulate_actions
from cablecast.motion.feasibility import feasible_uniform
from cablecast.pipeline.many_cables import CABLE_COUNT, DT, SEGMENT_COUNT
from cablecast.pipeline.simulate import make_engine
from cablecast.runs.parts import Parts
from cablecast.runs.progress import Progress, ProgressCallback
from cablecast.tuning.cables import draw_cables

TEST_SEED = 1
"""Seed of the cables; those of the training have another."""
ACTION_SEED = 99
DRAW_COUNT = 2000


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """One model for many cables beside a model for each."""

    model: pathlib.Path | None = None
    """Model that `cablecast train --cables` made; one is trained in --out where there is none."""
    cables: int = CABLE_COUNT
    """Cables of that training."""
    epochs_many: int = 40
    """Epochs of that training."""
    cable: str = "cable_1"
    """Cable around which the others are drawn."""
    tested: int = 20
    """Cables to test."""
    casts: int = 300
    """Casts of each to predict."""
    simulated: int = 16_000
    """Simulated casts that the model of one cable learns from."""
    epochs: int = 60
    """Largest number of passes over them."""
    candidates: int = 20_000
    """Motions that planning chooses from."""
    segment_count: int | None = None
    """Segments of the cables tested; what the convergence study chose where None."""
    dt: float | None = None
    """Time step of their simulation [s]."""
    quick: bool = False
    """Test three cables with small models only."""
    out: pathlib.Path = pathlib.Path("runs/benchmarks/cables")
    """Folder of the results, which the same command goes on with."""


QUICK: dict[str, Any] = {
    "cables": 3000,
    "epochs_many": 20,
    "tested": 3,
    "casts": 60,
    "simulated": 600,
    "epochs": 20,
    "candidates": 2000,
    "segment_count": SEGMENT_COUNT,
    "dt": DT,
}


def tested_setup(args: Args, number: int) -> cc.Setup:
    """Return the set-up of one of the cables."""
    base = cc.load_cable(args.cable)
    values = draw_cables(base, args.tested, TEST_SEED).to_array()[number]
    name, params = f"random_{number:02d}", cc.CableParams.from_array(values)
    return cc.Setup(cable=dataclasses.replace(base, name=name, params=params))


def own_policy(
    args: Args, setup: cc.Setup, report: ProgressCallback
) -> tuple[cc.ForwardSearchPolicy, float]:
    """Return the policy that was trained for one cable alone, and the time that it took [s]."""
    size = f"{args.simulated}-{args.segment_count}-{args.dt}"
    folder = args.out / "own" / f"{setup.cable.name}-{size}"
    parts = Parts(folder)
    began = time.monotonic()
    simulated = cc.simulate(
        setup,
        count=args.simulated,
        segment_count=args.segment_count,
        dt=args.dt,
        out=folder / "dataset",
        progress=report,
    )
    policy = cc.train(
        simulated,
        epochs=args.epochs,
        candidate_count=args.candidates,
        out=folder / f"model-{args.epochs}-{args.candidates}",
        progress=report,
    )
    policy.plan(r=1.1, theta_deg=16.7)
    seconds = time.monotonic() - began
    return policy, parts.get_or_make("seconds", lambda: {"seconds": seconds})["seconds"]


def measure(
    args: Args, model: cc.ManyCablesModel, number: int, report: ProgressCallback
) -> dict[str, Any]:
    """Return the errors of both models for one cable [% of cable length]."""
    setup = tested_setup(args, number)
    params = setup.cable.params
    own, own_seconds = own_policy(args, setup, report)
    began = time.monotonic()
    many = cc.policy_for_cable(model, params, setup, candidate_count=args.candidates)
    many.plan(r=1.1, theta_deg=16.7)
    many_seconds = time.monotonic() - began
    engine = make_engine(args.segment_count, args.dt)

    def land(actions: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = simulate_actions(actions, setup, params, engine)
        return np.stack([columns[name] for name in ENDPOINT_COLUMNS], axis=-1)

    actions = feasible_uniform(args.casts, setup, seed=ACTION_SEED)
    landing_xy = land(actions)
    result: dict[str, Any] = {"own_seconds": own_seconds, "many_seconds": many_seconds}
    targets = cc.load_targets()
    within = own.inside_coverage(targets) & many.inside_coverage(targets)
    result["targets"] = int(within.sum())
    for name, policy in (("own", own), ("many", many)):
        errors = _pct(policy.model.predict(actions) - landing_xy, setup)
        result[f"{name}_errors"] = errors
        plan = policy.plan(targets[within])
        result[f"{name}_misses"] = _pct(land(plan.actions) - targets[within], setup)
    return result


def _pct(offset: NDArray[np.float64], setup: cc.Setup) -> list[float]:
    """Return the lengths of finite offsets [% of cable length]."""
    distance = 100.0 * np.linalg.norm(offset, axis=1) / setup.cable.length
    return distance[np.isfinite(distance)].round(4).tolist()


def interval(
    rows: list[dict[str, Any]], value: Callable[[list[dict[str, Any]]], float]
) -> tuple[float, float, float]:
    """Return a figure of some cables, and the ends of its 90 % bootstrap interval."""
    rng = np.random.default_rng(0)
    draws = [
        value([rows[i] for i in rng.integers(len(rows), size=len(rows))]) for _ in range(DRAW_COUNT)
    ]
    low, high = np.quantile(draws, (0.05, 0.95))
    return value(rows), float(low), float(high)


def _pooled(name: str, quantile: float) -> Callable[[list[dict[str, Any]]], float]:
    """Return what takes a quantile over the casts of all cables."""

    def value(rows: list[dict[str, Any]]) -> float:
        return float(np.quantile(np.concatenate([row[name] for row in rows]), quantile))

    return value


def print_tables(args: Args, rows: list[dict[str, Any]]) -> None:
    """Print the errors of each cable, and those of all."""
    table = []
    for number, row in enumerate(rows):
        params = tested_setup(args, number).cable.params
        own, many = np.median(row["own_errors"]), np.median(row["many_errors"])
        misses = (np.median(row[f"{n}_misses"]) if row["targets"] else np.nan for n in _NAMES)
        shown = (f"{params.bend_stiffness:.1e}", f"{params.mass:.3f}", f"{params.friction:.2f}")
        pair = (f"{own:.2f}", f"{many:.2f}", f"{many / own:.2f}")
        table.append((number, *shown, *pair, *(f"{miss:.2f}" for miss in misses)))
    columns = ("cable", "EI [N·m²]", "mass [kg]", "friction", "own", "many", "ratio")
    title = "Median error of landings, and miss at targets, in % of cable length"
    print(Table(title=title, columns=(*columns, "own, targets", "many, targets"), rows=table))
    overall = []
    for what, name in (("landing", "errors"), ("at targets", "misses")):
        for label, quantile in (("median", 0.5), ("90th percentile", 0.9)):
            own, many = (_pooled(f"{model}_{name}", quantile) for model in _NAMES)
            figures = (
                interval(rows, own),
                interval(rows, many),
                interval(rows, lambda some, own=own, many=many: many(some) / own(some)),
                interval(rows, lambda some, own=own, many=many: many(some) - own(some)),
            )
            cells = (f"{v:.2f} ({low:.2f} to {high:.2f})" for v, low, high in figures)
            overall.append((what, label, *cells))
    title = f"All {len(rows)} cables together, in % of cable length"
    columns = ("error", "of casts", "own model", "model of many", "ratio", "difference")
    print(Table(title=title, columns=columns, rows=overall))
    seconds = [
        (name, f"{np.median([row[f'{name}_seconds'] for row in rows]):.1f}") for name in _NAMES
    ]
    title = "From known parameters to the first plan [s], median"
    print(Table(title=title, columns=("model", "time"), rows=seconds))


_NAMES = ("own", "many")


def main(args: Args) -> int:
    """Run the benchmark and print its tables."""
    args = dataclasses.replace(args, **QUICK) if args.quick else args
    with console_progress() as progress:
        for number in range(args.tested):
            own_policy(args, tested_setup(args, number), progress)
        if args.model is None:
            setup, folder = cc.Setup(cable=args.cable), args.out / f"model-{args.cables}"
            model = cc.train_cables(
                setup, cables=args.cables, epochs=args.epochs_many, out=folder, progress=progress
            )
        else:
            model = cc.ManyCablesModel.load(args.model)
        size = f"{args.simulated}-{args.epochs}-{args.segment_count}-{args.dt}"
        parts = Parts(args.out / f"results-{model.fingerprint}-{size}")
        rows = []
        for number in range(args.tested):
            name = f"{args.casts}-{args.candidates}-{number:03d}"
            rows.append(parts.get_or_make(name, lambda n=number: measure(args, model, n, progress)))
            progress(Progress(task="Cables", done=number + 1, total=args.tested, unit="cables"))
    print_tables(args, rows)
    return 0
