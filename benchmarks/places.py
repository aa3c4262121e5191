"""Laboratories in which benchmarks cast: rigs, their casts, and models fitted to them."""

import dataclasses
import functools
import math
import pathlib
import runpy
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.result import code_key
from benchmarks.strange_rig import (
    SAMPLE_DT,
    StrangeRig,
    other_params,
    world_draws,
)
from cablecast.data.dataset import Dataset
from cablecast.data.store import CastStore
from cablecast.errors import InputError
from cablecast.learning.policy import ForwardSearchPolicy
from cablecast.pipeline.check import LabCheck
from cablecast.rigs.checked import CheckedRig, seek_trial
from cablecast.rigs.engine import RigEngine
from cablecast.rigs.virtual import RigVirtual, VirtualConfig
from cablecast.runs.folder import Parts
from cablecast.runs.progress import Progress, ProgressCallback

METHODS = ("aim", "simulated")
"""aim: this package's loop. simulated: the policy of the fitted simulator alone."""

RIGS = ("virtual", "strange", "even", "patchy", "chain", "engine", "example")
"""virtual: the package's laboratory. strange: other parameters, uneven friction, curl, servo, and
scatter. even: strange with one friction everywhere. patchy: strange with the mean friction along
the way of the free end. chain: strange with one friction and a chain of capsules in MuJoCo as its
cable. engine: the package's engine with other parameters. example: the rig of the
documentation's example."""
DIFFERENCES: dict[str, dict[str, Any]] = {
    "strange": {},
    "even": {"unevenness": 0.0},
    "patchy": {"along": True},
    "chain": {"unevenness": 0.0, "chain": True},
}
"""Arguments of the strange rig by name of the rig."""
EXAMPLE_RIG = pathlib.Path(__file__).parents[1] / "examples" / "05_your_own_rig.py"

MISSED_PCT = 100.0
"""Miss of a cast without a landing [% of cable length]."""
HIT_PCT = cc.AimConfig.within_pct
"""Miss up to which a target is hit [% of cable length]."""
FIT_MAX = 20
"""Casts that the simulator is fitted to at most: more hardly change the fit."""

Found = dict[tuple[str, str, int, str], list[dict]]
"""Results at the targets by rig, cable, number of casts and method."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ModelArgs:
    """Settings of the models, and the folder that keeps them."""

    simulated: int = cc.AimConfig.simulated_count
    """Simulated casts that each model is trained on."""
    epochs: int = cc.AimConfig.epochs
    """Largest number of passes over them."""
    candidates: int = cc.AimConfig.candidate_count
    """Motions that planning chooses from."""
    out: pathlib.Path = pathlib.Path("runs/benchmarks/casts")
    """Folder of the results, in which the same command resumes."""

    def aim_config(self, calibration_count: int, **settings: Any) -> cc.AimConfig:
        """Return settings of aiming with these models."""
        return cc.AimConfig(
            calibration_count=calibration_count,
            simulated_count=self.simulated,
            epochs=self.epochs,
            candidate_count=self.candidates,
            **settings,
        )


class Luck:
    """A rig whose n-th cast at each target has its own random draws."""

    def __init__(self, rig: CheckedRig, first: int):
        self.rig, self.first = rig, first
        self.setup, self.description = rig.setup, rig.description
        self.sight = rig.sight

    def seek(self, index: int, purpose: str = "") -> None:
        seek_trial(self.rig, self.first + index, purpose)

    def reset(self) -> None:
        self.rig.reset()

    def execute(self, trajectory: cc.Trajectory) -> cc.EndpointTrack:
        return self.rig.execute(trajectory)


def equal_casts(rig: Luck, motion: cc.Trajectory, count: int) -> list[NDArray[np.float64]]:
    """Return the landings of repeated casts of one motion, each with its own random draws [m]."""
    landings = []
    for number in range(count):
        rig.seek(number, "aim")
        rig.reset()
        landings.append(rig.execute(motion).final_xy)
    return landings


def planned_misses(
    policy: ForwardSearchPolicy, rig: Luck, target: NDArray[np.float64], tries: int
) -> dict[str, list]:
    """Return the misses [% of cable length] of a policy's plan, cast again and again."""
    motion = policy.plan(target).trajectories[0]
    length = policy.setup.cable.length
    misses = [
        100.0 * float(np.linalg.norm(xy - target)) / length
        for xy in equal_casts(rig, motion, tries)
    ]
    return {"miss_pct": [_counted(miss) for miss in misses], "share": []}


def aimed_misses(
    session: cc.AimSession,
    rig: Luck,
    target: NDArray[np.float64],
    tries: int,
    *,
    equal_count: int = 0,
) -> dict[str, list]:
    """Return the misses [% of cable length] of a session, which stays as it was.

    Args:
        session: Session with the casts before the target.
        rig: Rig to cast on.
        target: Target [m], shape [2].
        tries: Number of casts.
        equal_count: Number of times that the last cast is repeated.

    Returns:
        For each try, `miss_pct`; `share`, the probability of the stated region that just holds the
        landing, None without one; `expected`, what was stated before it; `family` and `pace` of
        its motion, and the `seconds` that it takes.
        `floor_pct` holds the distances of equal casts of the last action from their mean.
    """
    session = session.fork()
    rows: dict[str, list] = {name: [] for name in ("miss_pct", "share", "expected", "family")}
    rows |= {"pace": [], "seconds": [], "floor_pct": []}
    for _ in range(tries):
        proposal = session.propose(target)
        cast = session.cast(rig, proposal)
        share = proposal.expected.law.probability(cast.square)
        rows["miss_pct"].append(_counted(cast.miss_pct))
        rows["share"].append(share if np.isfinite(share) else None)
        rows["expected"].append(_stated(proposal))
        rows["family"].append(proposal.action.family)
        rows["pace"].append(float(proposal.action.to_array()[-1]))
        rows["seconds"].append(proposal.trajectory.duration)
        last = proposal.trajectory
    if equal_count:
        landings = np.array(equal_casts(rig, last, equal_count))
        apart = distances_from_mean(landings, session.setup.cable.length)
        rows["floor_pct"] = [_counted(miss) for miss in apart.tolist()]
    return rows


def distances_from_mean(landings: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Return how far equal casts land from their mean [% of cable length], shape [cast].

    Landings [m] have the shape [cast, 2]; those that are NaN are left out of the mean.
    """
    offsets = 100.0 * (landings - np.nanmean(landings, axis=0)) / length
    # Deviations from the mean of so few are too small.
    return math.sqrt(len(landings) / (len(landings) - 1)) * np.linalg.norm(offsets, axis=1)


def _stated(proposal: cc.Proposal) -> dict[str, float]:
    """Return what was stated before a cast: distances in cable lengths."""
    expected, length = proposal.expected, proposal.setup.cable.length
    return {
        "miss": proposal.expected_miss,
        "deviation": float(np.sqrt(0.5 * np.trace(expected.covariance))) / length,
        "scatter": expected.scatter / length,
        "failure": expected.failure,
        "law_scale": expected.law.scale,
        "law_freedom": expected.law.freedom,
    }


def _counted(miss_pct: float) -> float:
    return miss_pct if np.isfinite(miss_pct) else MISSED_PCT


def try_count(method: str, tries: int) -> int:
    """Return the tries of a method at a target: one where no cast depends on those before."""
    return tries if method == "aim" else 1


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


def random_targets(count: int, lab: int) -> NDArray[np.float64]:
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
    """One cable in one laboratory: its casts, and the models that were fitted to them.

    Args:
        args: Settings of the models.
        name: Name of the rig.
        lab: Seed of the laboratory.
        cable: Name of the cable.
        largest: Largest number of casts before the first target.
        progress: Called with the progress of each step.
    """

    def __init__(
        self,
        args: ModelArgs,
        name: str,
        lab: int,
        cable: str,
        largest: int,
        progress: ProgressCallback,
    ):
        self.args, self.name, self.lab = args, name, lab
        self.largest, self.progress = largest, progress
        self.setup = cc.Setup(cable=cable)
        self.rig = open_rig(name, lab, self.setup)
        size = f"{args.simulated}-{args.epochs}"
        self.folder = args.out / code_key(__name__) / f"{name}-{lab}-{cable}"
        self.parts = Parts(self.folder / f"results-{size}-{args.candidates}")
        self.models = self.folder / f"models-{size}"

    def casts(self, count: int, first: int = 0) -> Dataset | None:
        """Return the casts from the first one on; a larger count starts with a smaller one."""
        if count <= first:
            return None
        spread = min(self.largest, cc.AimConfig.calibration_count)
        fitted = min(self.largest, FIT_MAX)
        every = CastStore(self.setup)
        parts: list[tuple[str, int, dict[str, Any]]] = [
            (
                "spread",
                spread,
                {"purpose": "tune", "sampling": "spread", "pace": cc.AimConfig().pace},
            ),
            ("tune", fitted - spread, {"purpose": "tune", "sampling": "uniform"}),
            ("real", self.largest - fitted, {"purpose": "real", "sampling": "uniform", "seed": 1}),
        ]
        for name, number, settings in parts:
            if number:
                folder = self.folder / "casts" / f"{name}-{number}"
                made = cc.collect(
                    self.rig, count=number, out=folder, progress=self.progress, **settings
                )
                every.add_dataset(made)
        return every.dataset(range(first, min(count, len(every))))

    def tuned(self, count: int) -> cc.Tuned | None:
        """Return the fit to the first casts; None without casts."""
        fitted = self.casts(min(count, FIT_MAX))
        if fitted is None:
            return None
        return cc.tune(
            fitted,
            validation_count=0,
            out=self.folder / "fits" / str(min(count, FIT_MAX)),
            progress=self.progress,
        )

    def session(self, count: int) -> cc.AimSession:
        """Return a session after the first casts, which keeps nothing of what follows.

        As in `aim`, a polar cast comes after them.
        """
        session = cc.prepare_aim(
            self.rig,
            self.args.aim_config(0, within_pct=0.01, tries=1000),
            casts=self.casts(min(count, FIT_MAX)),
            tuned=self.tuned(count),
            # A fit to more casts than the largest is that one.
            out=self.models / str(min(count, FIT_MAX)),
            progress=self.progress,
        ).fork()
        rest = self.casts(count, FIT_MAX)
        if rest is not None:
            session.add_casts(rest)
        if count:
            session.pilot(self.rig, self.progress)
        return session

    def player(
        self, method: str, count: int, equal_count: int = 0
    ) -> Callable[..., dict[str, list]]:
        """Return what casts by a method: a function of rig, target and number of tries."""
        session = self.session(count)
        if method == "simulated":
            return functools.partial(planned_misses, session.model.policy)
        return functools.partial(aimed_misses, session, equal_count=equal_count)

    def results(
        self, method: str, count: int, targets: int, tries: int, equal_count: int = 0
    ) -> list[dict[str, Any]]:
        """Return the results at the targets of this place, and make those that are missing."""
        rows, play = [], None
        tries = try_count(method, tries)
        task = f"{self.name} {self.lab} {self.setup.cable.name}, {count} casts, {method}"
        for index, target in enumerate(random_targets(targets, self.lab)):
            name = f"{method.replace(' ', '-')}-{count}-{tries}-{equal_count}-{index:03d}"
            stored = self.parts.get(name)
            if stored is None:
                if play is None:
                    self._report(task, index, targets)
                    play = self.player(method, count, equal_count)
                stored = play(Luck(self.rig, 1000 * (index + 1)), target, tries)
                self.parts.put(name, stored)
                self._report(task, index + 1, targets)
            calm = self.checked.is_calm(target)
            rows.append({**stored, "r": float(np.hypot(*target)), "calm": calm})
        return rows

    @functools.cached_property
    def checked(self) -> LabCheck:
        """What casts reach, as `check` says it before any cast."""
        return cc.check(self.setup, changes=False)

    def _report(self, task: str, done: int, total: int) -> None:
        self.progress(Progress(task=task, done=done, total=total, unit="targets"))
