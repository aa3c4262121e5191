"""Laboratories in which benchmarks cast: a rig, its casts, and what learned from them."""

import dataclasses
import pathlib
import runpy
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.strange_rig import (
    SAMPLE_DT,
    Scatter,
    StrangeRig,
    other_params,
    world_draws,
)
from cablecast.aiming.session import FittedModel
from cablecast.data.dataset import Dataset
from cablecast.data.store import CastStore
from cablecast.errors import InputError
from cablecast.learning.policy import ForwardSearchPolicy
from cablecast.pipeline.simulate import simulate_to_aim
from cablecast.rigs.checked import CheckedRig, seek_trial
from cablecast.rigs.engine import RigEngine
from cablecast.rigs.virtual import RigVirtual, VirtualConfig
from cablecast.runs.folder import Parts
from cablecast.runs.progress import Progress, ProgressCallback
from cablecast.runs.workers import LOCAL

LOOPS = ("aim", "full gain", "one simulator")
"""Methods that look where a cast landed before the next one. aim: this package's loop. full gain:
the same with every miss taken at face value. one simulator: the same without an ensemble."""
METHODS = (*LOOPS, "simulated", "fine-tuning", "paper")
"""simulated: the model of the fit, no casts in landing space. fine-tuning: `train` with the real
casts. paper: Differential Evolution, then fine-tuning where there are enough casts."""

RIGS = ("virtual", "strange", "scattering", "even", "patchy", "engine", "example")
"""virtual: the package's laboratory. strange: other parameters, uneven friction, curl, servo, and
scatter. scattering: strange with three times the scatter. even: strange with one friction
everywhere. patchy: strange with the mean friction along the way of the free end. engine: the engine
that the learner simulates with, set to other parameters. example: the rig of the documentation's
example."""
DIFFERENCES: dict[str, dict[str, Any]] = {
    "strange": {},
    "scattering": {"scatter": Scatter().times(3.0)},
    "even": {"unevenness": 0.0},
    "patchy": {"along": True},
}
"""Arguments of the strange rig by name of the rig."""
EXAMPLE_RIG = pathlib.Path(__file__).parents[1] / "examples" / "05_your_own_rig.py"

MISSED_PCT = 100.0
"""Miss of a cast without a landing [% of cable length]."""
FIT_MAX = 20
"""Casts that the simulator is fitted to at most: more hardly change the fit (docs/tuning.md)."""
FINE_TUNING_MIN = 50
"""Casts that fine-tuning needs: some of them have no landing to learn from."""

Found = dict[tuple[str, str, int, str], list[dict]]
"""Results at the targets by rig, cable, number of casts and method."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ModelArgs:
    """Settings of the models, and the folder that keeps them."""

    simulated: int = 16_000
    """Simulated casts that each model learns from."""
    epochs: int = 60
    """Largest number of passes over them."""
    candidates: int = 20_000
    """Motions that planning chooses from."""
    out: pathlib.Path = pathlib.Path("runs/benchmarks/casts")
    """Folder of the results, which the same command goes on with."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlaceArgs(ModelArgs):
    """Casts that a place makes before the first target, and models that learn from them."""

    counts: tuple[int, ...] = (0, 2, 3, 5, 10, 20, 50, 100, 280)
    """Numbers of real casts before the first target."""
    tries: int = 4
    """Casts at each target."""
    workers: str = LOCAL
    """Who simulates for fits and models: local, ray, or ray:ADDRESS."""


class Luck:
    """A rig whose n-th cast at each target draws other chances."""

    def __init__(self, rig: CheckedRig, first: int):
        self.rig, self.first = rig, first
        self.setup, self.description = rig.setup, rig.description
        if hasattr(rig, "sight"):
            self.sight = rig.sight

    def seek(self, index: int, purpose: str = "") -> None:
        seek_trial(self.rig, self.first + index, purpose)

    def reset(self) -> None:
        self.rig.reset()

    def execute(self, trajectory: cc.Trajectory) -> cc.EndpointTrack:
        return self.rig.execute(trajectory)


def equal_casts(rig: Luck, motion: cc.Trajectory, count: int) -> list[NDArray[np.float64]]:
    """Return the landings of some casts of one motion, each with other chances [m]."""
    landings = []
    for number in range(count):
        rig.seek(number, "aim")
        rig.reset()
        landings.append(rig.execute(motion).final_xy)
    return landings


class FixedSession:
    """Casts the plan of a policy again and again, as without a loop."""

    def __init__(self, policy: ForwardSearchPolicy):
        self.policy = policy

    def misses(self, rig: Luck, target: NDArray[np.float64], tries: int) -> dict[str, list]:
        motion = self.policy.plan(target).trajectories[0]
        rows = equal_casts(rig, motion, tries)
        length = self.policy.setup.cable.length
        return {"miss_pct": [_miss(xy, target, length) for xy in rows], "share": []}


class LoopSession:
    """Aims with a session that knows some casts.

    Args:
        session: Session that knows the casts.
        full_gain: True to take every miss at face value.
    """

    def __init__(self, session: cc.AimSession, full_gain: bool):
        self.session = session
        self.full_gain = full_gain

    def misses(self, rig: Luck, target: NDArray[np.float64], tries: int) -> dict[str, list]:
        session = self.session.fork()
        rows: dict[str, list] = {"miss_pct": [], "share": []}
        for _ in range(tries):
            if self.full_gain:
                experience = session.predictor.experience
                scales = dataclasses.replace(experience.residual.scales, noise=1e-4)
                residual = dataclasses.replace(experience.residual, scales=scales)
                experience = dataclasses.replace(experience, residual=residual)
                session.predictor = dataclasses.replace(session.predictor, experience=experience)
            proposal = session.propose(target)
            cast = session.cast(rig, proposal)  # pyright: ignore[reportArgumentType]
            miss = cast.miss_pct
            rows["miss_pct"].append(miss if np.isfinite(miss) else MISSED_PCT)
            # Probability of the region that just holds the landing.
            share = proposal.law.share(cast.square)
            rows["share"].append(share if np.isfinite(share) else None)
        return rows


def try_count(method: str, tries: int) -> int:
    """Return the tries of a method at a target: one where no cast depends on those before."""
    return tries if method in LOOPS else 1


def _miss(xy: NDArray[np.float64], target: NDArray[np.float64], length: float) -> float:
    miss = 100.0 * float(np.linalg.norm(xy - target)) / length
    return miss if np.isfinite(miss) else MISSED_PCT


def open_rig(name: str, lab: int, setup: cc.Setup) -> CheckedRig:
    """Return a rig of a laboratory; that of the example is the same in all of them."""
    if name == "virtual":
        return cc.make_rig(RigVirtual(setup, 0, VirtualConfig(lab_seed=lab)), setup)
    if name == "engine":
        params = cc.CableParams(**other_params(setup, world_draws(setup, lab)))
        return cc.make_rig(RigEngine(cc.EngineWarp(), setup, params, sample_dt=SAMPLE_DT), setup)
    if name == "example":
        example = runpy.run_path(str(EXAMPLE_RIG))
        return cc.make_rig(example["make_rig"](setup, lab), setup)
    if name not in DIFFERENCES:
        raise InputError(f"unknown rig {name[:40]!r}: one of {', '.join(RIGS)}")
    return cc.make_rig(StrangeRig(setup, 0, lab, **DIFFERENCES[name]), setup)


def fit_name(count: int, paper: bool) -> str:
    """Return the name of the fit to some casts, and of its model: that of the largest fit at most.

    Args:
        count: Casts before the first target.
        paper: True for the paper's search in place of least squares.
    """
    return f"{min(count, FIT_MAX)}{'-paper' if paper else ''}"


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

    def __init__(self, args: PlaceArgs, name: str, lab: int, cable: str, report: ProgressCallback):
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
        begun, fitted = min(largest, cc.AimConfig().calibration_count), min(largest, FIT_MAX)
        every = CastStore(self.setup)
        parts: list[tuple[str, int, dict[str, Any]]] = [
            ("spread", begun, {"purpose": "tune", "sampling": "spread"}),
            ("tune", fitted - begun, {"purpose": "tune", "sampling": "uniform"}),
            ("real", largest - fitted, {"purpose": "real", "sampling": "uniform", "seed": 1}),
        ]
        for name, number, settings in parts:
            if number:
                folder = self.folder / "casts" / f"{name}-{number}"
                made = cc.collect(
                    self.rig, count=number, out=folder, progress=self.report, **settings
                )
                every.add_dataset(made)
        return every.dataset(range(first, min(count, len(every))))

    def tuned(self, count: int, paper: bool) -> cc.Tuned:
        """Return what some casts say of the cable; what is believed of it without casts."""
        few = self.casts(min(count, FIT_MAX))
        if few is None:
            return cc.Tuned.believed(self.setup)
        return cc.tune(
            few,
            config=cc.TuneConfig() if paper else cc.FitConfig(),
            validation_count=1 if paper else 0,
            out=self.folder / "fits" / fit_name(count, paper),
            workers=self.args.workers,
            progress=self.report,
        )

    def policy(self, count: int, paper: bool) -> ForwardSearchPolicy:
        """Return the model of casts that were simulated with what some casts taught."""
        folder = self.models / fit_name(count, paper)
        tuned = self.tuned(count, paper)
        simulated = simulate_to_aim(
            self.setup,
            tuned,
            count=self.args.simulated,
            workers=self.args.workers,
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
        if method in LOOPS:
            known = self._known(policy, count, ensemble=method != "one simulator")
            return LoopSession(known, method == "full gain")
        if method == "simulated" or (method == "paper" and count < FINE_TUNING_MIN):
            return FixedSession(policy)
        real = self.casts(count)
        if real is None:
            raise InputError(f"method {method} needs casts")
        real = dataclasses.replace(real, info=real.info | {"kind": "real"})
        simulated = cc.read_dataset(self.models / fit_name(count, method == "paper") / "dataset")
        model: Any = policy.model
        return FixedSession(cc.train(simulated, real, start=model))

    def _known(
        self, policy: ForwardSearchPolicy, count: int, *, ensemble: bool = True
    ) -> cc.AimSession:
        """Return a session that knows some casts."""
        tuned = self.tuned(count, paper=False)
        if not ensemble:
            tuned = dataclasses.replace(tuned, ensemble=None)
        casts = self.casts(min(count, FIT_MAX))
        model = FittedModel(
            policy=policy, tuned=tuned, fitted_count=0 if casts is None else len(casts)
        )
        config = cc.AimConfig(within_pct=0.01, tries=1000)
        session = cc.AimSession(model, casts=casts, config=config)
        rest = self.casts(count, FIT_MAX)
        if rest is not None:
            session.add_casts(rest)
        session.look(self.rig)
        return session

    def results(self, method: str, count: int, targets: int) -> list[dict[str, Any]]:
        """Return the results at the targets of this place, and make those that are missing."""
        rows, session = [], None
        tries = try_count(method, self.args.tries)
        task = f"{self.name} {self.lab} {self.setup.cable.name}, {count} casts, {method}"
        for index, target in enumerate(some_targets(targets, self.lab)):
            name = f"{method.replace(' ', '-')}-{count}-{tries}-{index:03d}"
            stored = self.parts.get(name)
            if stored is None:
                if session is None:
                    # From here on it takes time, which is what progress is told by.
                    self._report(task, index, targets)
                    session = self.session(method, count)
                began = time.monotonic()
                luck = Luck(self.rig, 1000 * (index + 1))
                stored = session.misses(luck, target, tries)
                stored["seconds"] = round(time.monotonic() - began, 2)
                self.parts.put(name, stored)
                self._report(task, index + 1, targets)
            rows.append(stored)
        return rows

    def _report(self, task: str, done: int, total: int) -> None:
        self.report(Progress(task=task, done=done, total=total, unit="targets"))
