"""Error at targets against the number of real casts, for every way to use them.

For each rig, laboratory, cable and number of casts, the simulator is fitted to the casts, a model
learns from simulated ones, and each target is cast at some times in turn. Every target begins anew
with the same casts, so that a first try after five casts is a first try after five casts. A cast
without a landing counts as a miss of 100 %.

Each piece of work is kept in --out: the same command goes on where it was stopped, and adds what a
larger one asks for. Medians come with the interval that holds 90 % of 2,000 bootstrap draws.
"""

import dataclasses
import pathlib
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.common import Table
from benchmarks.strange_rig import Scatter, StrangeRig
from cablecast.cli.progress import console_progress
from cablecast.datasets.reader import Dataset
from cablecast.datasets.store import CastStore
from cablecast.errors import InputError
from cablecast.policies.forward_search import ForwardSearchPolicy
from cablecast.rigs.checked import CheckedRig
from cablecast.rigs.virtual import RigVirtual, VirtualConfig
from cablecast.runs.parts import Parts
from cablecast.runs.progress import Progress, ProgressCallback

METHODS = ("aim", "full gain", "simulated", "correction", "fine-tuning", "paper")
"""aim: this package's loop. full gain: the same with every miss taken at face value. simulated: the
model of the fit, no casts in landing space. correction, fine-tuning: `train` with the real casts.
paper: Differential Evolution, then fine-tuning where there are enough casts."""

MISSED_PCT = 100.0
"""Miss of a cast without a landing [% of cable length]."""
FIT_MAX = 20
"""Casts that the simulator is fitted to at most: more hardly change the fit (docs/tuning.md)."""
REAL_MIN = {"correction": 19, "fine-tuning": 19}
"""Casts that a method needs."""
DRAW_COUNT = 2000

COLUMNS = ("rig", "cable", "casts", "method", "targets", "try", "median", "q1", "q3", "missed")
REGION_COLUMNS = ("rig", "cable", "casts", "try", "landings", "in 50 %", "in 90 %")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Error at targets against the number of real casts."""

    rigs: tuple[str, ...] = ("virtual", "strange")
    """Rigs: virtual, strange, or scattering, which is strange with three times the scatter."""
    labs: tuple[int, ...] = (0, 1, 2)
    """Seeds of the laboratories."""
    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    """Cables."""
    counts: tuple[int, ...] = (0, 2, 3, 5, 10, 20, 50, 100, 280)
    """Numbers of real casts before the first target."""
    methods: tuple[str, ...] = METHODS
    """Methods, some of aim, full gain, simulated, correction, fine-tuning, paper."""
    targets: int = 200
    """Targets of each rig and cable, shared among the laboratories."""
    tries: int = 4
    """Casts at each target."""
    simulated: int = 16_000
    """Simulated casts that each model learns from."""
    epochs: int = 60
    """Largest number of passes over them."""
    candidates: int = 20_000
    """Motions that planning chooses from."""
    quick: bool = False
    """Use the strange rig, one laboratory, one cable, 8 targets, and small models only."""
    out: pathlib.Path = pathlib.Path("runs/benchmarks/casts")
    """Folder of the results, which the same command goes on with."""
    figure: pathlib.Path | None = None
    """Picture of the medians to write, such as docs/images/casts.png."""


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


class _Luck:
    """A rig whose n-th cast at each target draws other chances."""

    def __init__(self, rig: CheckedRig, first: int):
        self.rig, self.first = rig, first
        self.setup, self.description = rig.setup, rig.description

    def seek(self, index: int, purpose: str = "") -> None:
        self.rig.seek(self.first + index, purpose)

    def reset(self) -> None:
        self.rig.reset()

    def execute(self, trajectory: cc.Trajectory) -> cc.EndpointTrack:
        return self.rig.execute(trajectory)


class FixedSession:
    """Casts the plan of a policy again and again, as without a loop."""

    def __init__(self, policy: ForwardSearchPolicy):
        self.policy = policy

    def misses(self, rig: _Luck, target: NDArray[np.float64], tries: int) -> dict[str, list]:
        motion = self.policy.plan(target).trajectories[0]
        rows = []
        for number in range(tries):
            rig.seek(number, "aim")
            rig.reset()
            rows.append(rig.execute(motion).final_xy)
        length = self.policy.setup.cable.length
        return {"miss_pct": [_miss(xy, target, length) for xy in rows], "square": []}


class LoopSession:
    """Aims with a session that knows some casts.

    Args:
        session: Session that knows the casts.
        full_gain: Whether every miss is taken at face value.
    """

    def __init__(self, session: cc.AimSession, full_gain: bool):
        self.session = session
        self.full_gain = full_gain

    def misses(self, rig: _Luck, target: NDArray[np.float64], tries: int) -> dict[str, list]:
        session = self.session.fork()
        rows: dict[str, list] = {"miss_pct": [], "square": []}
        for _ in range(tries):
            if self.full_gain:
                known = session.aimer.experience
                scales = dataclasses.replace(known.residual.scales, noise=1e-4)
                known.residual = dataclasses.replace(known.residual, scales=scales)
            proposal = session.propose(target)
            trial = session.cast(rig, proposal)  # pyright: ignore[reportArgumentType]
            miss = trial.miss_pct
            rows["miss_pct"].append(miss if np.isfinite(miss) else MISSED_PCT)
            offset = trial.final_xy - proposal.expected_xy
            square = float(offset @ np.linalg.solve(proposal.covariance, offset))
            rows["square"].append(square if np.isfinite(square) else None)
        return rows


def _miss(xy: NDArray[np.float64], target: NDArray[np.float64], length: float) -> float:
    miss = 100.0 * float(np.linalg.norm(xy - target)) / length
    return miss if np.isfinite(miss) else MISSED_PCT


def open_rig(name: str, lab: int, setup: cc.Setup) -> CheckedRig:
    """Return a rig of a laboratory."""
    if name == "virtual":
        return cc.make_rig(RigVirtual(setup, 0, VirtualConfig(lab_seed=lab)), setup)
    scatter = {"strange": 1.0, "scattering": 3.0}
    if name not in scatter:
        raise InputError(f"unknown rig {name[:40]!r}: one of virtual, strange, scattering")
    return cc.make_rig(StrangeRig(setup, 0, lab, Scatter().times(scatter[name])), setup)


def some_targets(count: int, lab: int) -> NDArray[np.float64]:
    """Return targets drawn about the paper's 32, of which none is repeated [m], [target, 2]."""
    rng = np.random.default_rng([lab, 29])
    paper = cc.load_targets()
    workspace = cc.Workspace()
    chosen: list[NDArray[np.float64]] = []
    while len(chosen) < count:
        xy = paper[rng.integers(len(paper))] + rng.uniform(-0.05, 0.05, 2)
        if workspace.on_table(xy):
            chosen.append(xy)
    return np.array(chosen)


class Place:
    """One cable in one laboratory: its casts, and the models that learned from them."""

    def __init__(self, args: Args, name: str, lab: int, cable: str, report: ProgressCallback):
        self.args, self.name, self.lab, self.report = args, name, lab, report
        self.setup = cc.Setup(cable=cable)
        self.rig = open_rig(name, lab, self.setup)
        size = f"{args.simulated}-{args.epochs}"
        self.folder = args.out / f"{name}-{lab}-{cable}"
        self.parts = Parts(self.folder / f"results-{size}")
        self.models = self.folder / f"models-{size}"

    def casts(self, count: int, first: int = 0) -> Dataset | None:
        """Return the casts from the first one on; a larger count begins with a smaller one."""
        if count <= first:
            return None
        largest = max(self.args.counts)
        numbers = {"tune": min(largest, FIT_MAX), "real": max(largest - FIT_MAX, 0)}
        every, chosen = CastStore(self.setup), CastStore(self.setup)
        for purpose, number in numbers.items():
            if number:
                folder = self.folder / "casts" / f"{purpose}-{number}"
                settings: dict[str, Any] = {"purpose": purpose, "sampling": "uniform"}
                seed = 0 if purpose == "tune" else 1
                every.add_dataset(
                    cc.collect(
                        self.rig,
                        count=number,
                        seed=seed,
                        out=folder,
                        progress=self.report,
                        **settings,
                    )
                )
        for cast in every.casts[first:count]:
            chosen.add(cast)
        return chosen.dataset()

    def tuned(self, count: int, paper: bool) -> cc.Tuned | None:
        """Return what some casts say of the cable; None without casts."""
        few = self.casts(min(count, FIT_MAX))
        if few is None:
            return None
        return cc.tune(
            few,
            config=cc.TuneConfig() if paper else cc.FitConfig(),
            validation_count=1 if paper else 0,
            out=self.folder / "fits" / f"{count}{'-paper' if paper else ''}",
            progress=self.report,
        )

    def policy(self, count: int, paper: bool) -> ForwardSearchPolicy:
        """Return the model of casts that were simulated with what some casts taught."""
        folder = self.models / f"{count}{'-paper' if paper else ''}"
        tuned = self.tuned(count, paper)
        simulated = cc.simulate(
            self.setup,
            tuned,
            count=self.args.simulated,
            out=folder / "dataset",
            progress=self.report,
        )
        return cc.train(
            simulated,
            epochs=self.args.epochs,
            candidate_count=self.args.candidates,
            out=folder / "model",
            progress=self.report,
        )

    def session(self, method: str, count: int) -> LoopSession | FixedSession:
        """Return what casts at targets by a method."""
        policy = self.policy(count, method == "paper")
        if method in ("aim", "full gain"):
            return LoopSession(self._known(policy, count), method == "full gain")
        if method == "simulated" or (method == "paper" and count < REAL_MIN["fine-tuning"]):
            return FixedSession(policy)
        real = self.casts(count)
        if real is None:
            raise InputError(f"method {method} needs casts")
        real = dataclasses.replace(real, info=real.info | {"kind": "real"})
        simulated = cc.read_dataset(policy_dataset(self.models, count, method == "paper"))
        how: Any = "correction" if method == "correction" else "fine-tuning"
        model: Any = policy.model
        return FixedSession(cc.train(simulated, real, method=how, start=model))

    def _known(self, policy: ForwardSearchPolicy, count: int) -> cc.AimSession:
        """Return a session that knows some casts."""
        session = cc.AimSession(
            policy,
            casts=self.casts(min(count, FIT_MAX)),
            tuned=self.tuned(count, paper=False),
            within_pct=0.01,
            tries=1000,
        )
        rest = self.casts(count, FIT_MAX)
        if rest is not None:
            session.add_casts(rest)
        return session

    def results(self, method: str, count: int, targets: int) -> list[dict[str, Any]]:
        """Return the results at the targets of this place, and make those that are missing."""
        rows, session = [], None
        for index, target in enumerate(some_targets(targets, self.lab)):
            name = f"{method.replace(' ', '-')}-{count}-{self.args.tries}-{index:03d}"
            stored = self.parts.get(name)
            if stored is None:
                began = time.monotonic()
                session = session or self.session(method, count)
                luck = _Luck(self.rig, 1000 * (index + 1))
                stored = session.misses(luck, target, self.args.tries)
                stored["seconds"] = round(time.monotonic() - began, 2)
                self.parts.put(name, stored)
            rows.append(stored)
            task = f"{self.name} {self.lab} {self.setup.cable.name}, {count} casts, {method}"
            self.report(Progress(task=task, done=index + 1, total=targets, unit="targets"))
        return rows


def policy_dataset(models: pathlib.Path, count: int, paper: bool) -> pathlib.Path:
    """Return the folder of the simulated casts of a model."""
    return models / f"{count}{'-paper' if paper else ''}" / "dataset"


def interval(values: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the median and the ends of its 90 % bootstrap interval."""
    rng = np.random.default_rng(0)
    draws = np.median(rng.choice(values, (DRAW_COUNT, len(values))), axis=1)
    return float(np.median(values)), *(float(q) for q in np.quantile(draws, (0.05, 0.95)))


def run(args: Args, report: ProgressCallback) -> dict[tuple[str, str, int, str], list[dict]]:
    """Return the results by rig, cable, number of casts and method."""
    found: dict[tuple[str, str, int, str], list[dict]] = {}
    for name in args.rigs:
        for cable in args.cables:
            for place, lab in enumerate(args.labs):
                own = len(range(place, args.targets, len(args.labs)))
                here = Place(args, name, lab, cable, report)
                for count in args.counts:
                    for method in args.methods:
                        if count < REAL_MIN.get(method, 0) or (method == "paper" and count < 2):
                            continue
                        rows = here.results(method, count, own)
                        found.setdefault((name, cable, count, method), []).extend(rows)
    return found


def print_tables(found: dict[tuple[str, str, int, str], list[dict]], tries: int) -> None:
    """Print the misses of every try, and how often the stated regions held."""
    rows_of_misses: list[tuple] = []
    rows_of_regions: list[tuple] = []
    for (name, cable, count, method), rows in found.items():
        misses = np.array([row["miss_pct"] for row in rows])
        for number in range(tries if method in ("aim", "full gain") else 1):
            values = misses[:, number]
            median, low, high = interval(values)
            q1, q3 = np.quantile(values, (0.25, 0.75))
            lost = 100.0 * np.mean(values >= MISSED_PCT)
            spread = f"{median:.1f} ({low:.1f} to {high:.1f})"
            quartiles = (f"{q1:.1f}", f"{q3:.1f}", f"{lost:.1f}")
            row = (name, cable, count, method, len(values), number + 1, spread, *quartiles)
            rows_of_misses.append(row)
            if method != "aim":
                continue
            squares = [row["square"][number] for row in rows]
            known = np.array([s for s in squares if s is not None])
            inside = [100.0 * np.mean(known < -2.0 * np.log1p(-share)) for share in (0.5, 0.9)]
            shares = (f"{share:.0f}" for share in inside)
            rows_of_regions.append((name, cable, count, number + 1, len(known), *shares))
    title = "Miss of each try in % of cable length; missed: casts without a landing [%]"
    print(Table(title=title, columns=COLUMNS, rows=rows_of_misses))
    title = "Landings within the regions that were stated before the cast [%]"
    print(Table(title=title, columns=REGION_COLUMNS, rows=rows_of_regions))


def draw(found: dict[tuple[str, str, int, str], list[dict]], path: pathlib.Path) -> None:
    """Draw the medians of first and corrected tries over the number of casts."""
    import matplotlib.pyplot as plt

    from cablecast.files import write_bytes
    from cablecast.report.style import png_bytes

    names = list(dict.fromkeys((name, cable) for name, cable, _, _ in found))
    figure, axes = plt.subplots(1, len(names), figsize=(3.4 * len(names), 3.2), sharey=True)
    for axis, (name, cable) in zip(np.atleast_1d(axes), names, strict=True):
        counts = sorted({n for a, b, n, m in found if (a, b, m) == (name, cable, "aim")})
        tries = len(found[name, cable, counts[0], "aim"][0]["miss_pct"]) if counts else 0
        for number in range(tries):
            bars = [
                interval(np.array([r["miss_pct"][number] for r in found[name, cable, n, "aim"]]))
                for n in counts
            ]
            middle, low, high = np.array(bars).T
            label = "first try" if number == 0 else f"after {number} correction(s)"
            axis.errorbar(
                counts, middle, (middle - low, high - middle), marker="o", capsize=2, label=label
            )
        axis.set(title=f"{cable}, {name} rig", xlabel="real casts before", xscale="symlog")
        axis.grid(alpha=0.3)
    first = np.atleast_1d(axes)[0]
    first.set(ylabel="median miss [% of cable length]", ylim=(0, None))
    first.legend(fontsize=7)
    write_bytes(path, png_bytes(figure))


def main(args: Args) -> int:
    """Run the benchmark and print its tables."""
    args = dataclasses.replace(args, **QUICK) if args.quick else args
    if unknown := sorted(set(args.methods) - set(METHODS)):
        raise InputError(f"unknown method {unknown[0][:40]!r}: one of {', '.join(METHODS)}")
    with console_progress() as progress:
        found = run(args, progress)
    print_tables(found, args.tries)
    if args.figure is not None:
        draw(found, args.figure)
    return 0
