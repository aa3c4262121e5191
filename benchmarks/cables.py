"""One model for many cables beside a model for each: errors of landings and at targets, and time.

Cables are drawn from the ranges that `tune` searches, with another seed than those of the training.
For each, the landings of random casts are compared with those that the model of many cables
predicts at its parameters ("many"), with those of the same after it learned from some casts of this
cable ("refined"), and with those of a model that was trained on many casts of this cable alone
("own"). Each then plans casts at targets, which are simulated. The parameters are known exactly, so
that all errors are those of the models.

Each cable is kept in --out: the same command goes on where it was stopped. Intervals hold 90 % of
2,000 bootstrap draws of the cables.
"""

import dataclasses
import functools
import pathlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.common import Table
from cablecast.cli.progress import console_progress
from cablecast.data.schema import ENDPOINT_COLUMNS
from cablecast.data.simulate import simulate_actions
from cablecast.motion.feasibility import feasible_uniform
from cablecast.pipeline.engine import make_engine
from cablecast.pipeline.many_cables import CABLE_COUNT, DT, REFINE_COUNT, SEGMENT_COUNT
from cablecast.runs.folder import Parts
from cablecast.runs.progress import Progress, ProgressCallback
from cablecast.runs.workers import LOCAL
from cablecast.tuning.space import draw_cables

TEST_SEED = 1
"""Seed of the cables; those of the training have another."""
ACTION_SEED = 99
DRAW_COUNT = 2000

KINDS = ("own", "many", "refined")
QUANTILES = (("median", 0.5), ("90th percentile", 0.9))

Rows = list[dict[str, dict[str, Any]]]
"""Results of each cable by the kind of model."""


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
    refine: int = REFINE_COUNT
    """Simulated casts that the model of many cables is refined with."""
    candidates: int = 20_000
    """Motions that planning chooses from."""
    segment_count: int | None = None
    """Segments of the cables tested; what the convergence study chose where None."""
    dt: float | None = None
    """Time step of their simulation [s]."""
    workers: str = LOCAL
    """Who simulates: local, ray, or ray:ADDRESS."""
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
    "refine": 200,
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


class Tested:
    """One cable, and the policies for it."""

    def __init__(self, args: Args, number: int, report: ProgressCallback):
        self.args, self.report = args, report
        self.setup = tested_setup(args, number)
        self.engine = make_engine(args.segment_count, args.dt)
        size = f"{args.simulated}-{args.segment_count}-{args.dt}"
        self.own_folder = args.out / "own" / f"{self.setup.cable.name}-{size}"

    def policy(self, kind: str, model: cc.ManyCablesModel) -> cc.ForwardSearchPolicy:
        """Return the policy of one kind."""
        args, setup = self.args, self.setup
        engine = {"segment_count": args.segment_count, "dt": args.dt}
        search: dict[str, Any] = {"candidate_count": args.candidates, "progress": self.report}
        if kind != "own":
            refine = args.refine if kind == "refined" else 0
            params = setup.cable.params
            return cc.policy_for_cable(model, params, setup, refine=refine, **engine, **search)
        simulated = cc.simulate(
            setup,
            count=args.simulated,
            workers=args.workers,
            out=self.own_folder / "dataset",
            progress=self.report,
            **engine,
        )
        return cc.train(
            simulated,
            epochs=args.epochs,
            out=self.own_folder / f"model-{args.epochs}-{args.candidates}",
            **search,
        )

    def measure(self, kind: str, model: cc.ManyCablesModel) -> dict[str, Any]:
        """Return the errors of a policy [% of cable length], and the time to its first plan [s]."""
        began = time.monotonic()
        policy = self.policy(kind, model)
        policy.plan(r=1.1, theta_deg=16.7)
        seconds = time.monotonic() - began
        if kind == "own":
            # The time of the first run, which simulated and trained.
            parts = Parts(self.own_folder)
            seconds = parts.get_or_make("seconds", lambda: {"seconds": seconds})["seconds"]
        actions = feasible_uniform(self.args.casts, self.setup, seed=ACTION_SEED)
        targets = cc.load_targets()
        return {
            "seconds": seconds,
            "errors": self._pct(policy.model.predict(actions) - self._land(actions)),
            "misses": self._pct(self._land(policy.plan(targets).actions) - targets),
            "inside": policy.inside_coverage(targets).tolist(),
        }

    def _land(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        params = self.setup.cable.params
        columns = simulate_actions(actions, params, self.setup, self.engine)
        return np.stack([columns[name] for name in ENDPOINT_COLUMNS], axis=-1)

    def _pct(self, offset: NDArray[np.float64]) -> list[float | None]:
        """Return lengths [% of cable length]; None where a simulated cast has no landing."""
        distance = 100.0 * np.linalg.norm(offset, axis=1) / self.setup.cable.length
        return [round(float(d), 4) if np.isfinite(d) else None for d in distance]


def errors_of(row: dict[str, dict[str, Any]], kind: str, name: str) -> NDArray[np.float64]:
    """Return the errors of one cable's model that can be compared with those of the others.

    Args:
        row: Results of the cable by the kind of model.
        kind: Kind of model.
        name: "errors" of all casts, or "misses" at the targets that all models can reach.
    """
    values = np.array([np.nan if v is None else v for v in row[kind][name]])
    if name == "misses":
        values = values[np.all([result["inside"] for result in row.values()], axis=0)]
    return values[np.isfinite(values)]


def interval(rows: Rows, value: Callable[[Rows], float]) -> str:
    """Return a figure of some cables, and the ends of its 90 % bootstrap interval."""
    rng = np.random.default_rng(0)
    picks = rng.integers(len(rows), size=(DRAW_COUNT, len(rows)))
    low, high = np.nanquantile([value([rows[i] for i in pick]) for pick in picks], (0.05, 0.95))
    return f"{value(rows):.2f} ({low:.2f} to {high:.2f})"


def _pooled(kind: str, name: str, quantile: float) -> Callable[[Rows], float]:
    """Return what takes a quantile over the casts of all cables."""

    def value(rows: Rows) -> float:
        every = np.concatenate([errors_of(row, kind, name) for row in rows])
        # Small models may have no target that all of them reach.
        return float(np.quantile(every, quantile)) if len(every) else np.nan

    return value


def _ratio(kind: str, name: str, quantile: float) -> Callable[[Rows], float]:
    own, other = _pooled("own", name, quantile), _pooled(kind, name, quantile)
    return lambda rows: other(rows) / own(rows)


def print_tables(args: Args, rows: Rows) -> None:
    """Print the errors of each cable, and those of all."""
    table = []
    for number, row in enumerate(rows):
        params = tested_setup(args, number).cable.params
        medians = [
            f"{np.median(some):.2f}" if len(some) else "-"
            for name in ("errors", "misses")
            for some in (errors_of(row, kind, name) for kind in KINDS)
        ]
        shown = (f"{params.bend_stiffness:.1e}", f"{params.mass:.3f}", f"{params.friction:.2f}")
        table.append((number, *shown, *medians))
    columns = ("cable", "EI [N·m²]", "mass [kg]", "friction", *KINDS)
    title = "Median error of landings, and median miss at targets, in % of cable length"
    columns = (*columns, *(f"{kind}, targets" for kind in KINDS))
    print(Table(title=title, columns=columns, rows=table))
    overall = []
    for what, name in (("landing", "errors"), ("at targets", "misses")):
        for label, quantile in QUANTILES:
            for kind in KINDS:
                error = interval(rows, _pooled(kind, name, quantile))
                ratio = interval(rows, _ratio(kind, name, quantile))
                overall.append((what, label, kind, error, ratio))
    title = f"Casts of all {len(rows)} cables together, in % of cable length"
    print(Table(title=title, columns=("error", "of", "model", "value", "over own"), rows=overall))
    seconds = [(k, f"{np.median([row[k]['seconds'] for row in rows]):.1f}") for k in KINDS]
    title = "From known parameters to the first plan [s], median"
    print(Table(title=title, columns=("model", "time"), rows=seconds))


def main(args: Args) -> int:
    """Run the benchmark and print its tables."""
    args = dataclasses.replace(args, **QUICK) if args.quick else args
    rows: Rows = []
    with console_progress() as progress:
        if args.model is None:
            setup, folder = cc.Setup(cable=args.cable), args.out / f"model-{args.cables}"
            model = cc.train_cables(
                setup,
                cables=args.cables,
                epochs=args.epochs_many,
                workers=args.workers,
                out=folder,
                progress=progress,
            )
        else:
            model = cc.ManyCablesModel.load(args.model)
        shared = f"{args.cable}-{args.casts}-{args.candidates}-{args.segment_count}-{args.dt}"
        places = {
            "own": f"own-{args.simulated}-{args.epochs}",
            "many": f"many-{model.fingerprint}",
            "refined": f"refined-{model.fingerprint}-{args.refine}",
        }
        for number in range(args.tested):
            tested, row = Tested(args, number, progress), {}
            for kind, place in places.items():
                parts = Parts(args.out / "results" / f"{place}-{shared}")
                row[kind] = parts.get_or_make(
                    f"{number:03d}", functools.partial(tested.measure, kind, model)
                )
            rows.append(row)
            progress(Progress(task="Cables", done=number + 1, total=args.tested, unit="cables"))
    print_tables(args, rows)
    return 0
