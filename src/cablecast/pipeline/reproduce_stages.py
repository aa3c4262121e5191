"""The stages of `reproduce`: which verbs run, on what, in which folders."""

import contextlib
import dataclasses
import pathlib
from collections.abc import Callable, Iterator
from typing import Any

from cablecast.data.dataset import Dataset, read_dataset
from cablecast.errors import InputError, check_seed
from cablecast.learning.network import ForwardModel
from cablecast.learning.policy import ForwardSearchPolicy, PolarCastingPolicy, Policy
from cablecast.pipeline.collect import collect
from cablecast.pipeline.evaluate import evaluate
from cablecast.pipeline.repeat import Combination, repeat
from cablecast.pipeline.select import load_repeated, select
from cablecast.pipeline.simulate import simulate
from cablecast.pipeline.train import train
from cablecast.pipeline.tune import tune
from cablecast.rigs.checked import CheckedRig
from cablecast.rigs.make import make_rig
from cablecast.runs.folder import Parts
from cablecast.runs.progress import ProgressCallback, Stage
from cablecast.setup import Setup
from cablecast.tuning.tune import TuneConfig
from cablecast.tuning.tuned import load_tuned

CABLES = ("cable_1", "cable_2", "cable_3")
METHODS = ("polar", "gaussian-process", "real", "sim", "fine-tuning")
"""Polar casting, the Gaussian process of D_sim, the forward model of D_real, of D_sim, and of D_sim
fine-tuned on D_real."""
BEST_METHOD = "fine-tuning"

TARGET_COUNT = 32

# The expected end is told from these, on two cores; measured times take over as stages finish.
SECONDS_PER_TRIAL = 0.6
# Polar casting swings the cable up and pulls it in slowly: its motions last four times as long.
SECONDS_PER_POLAR_TRIAL = 2.0
SECONDS_PER_SIMULATION = 1.5e-3

REPEATED: tuple[Combination, ...] = ("1.2", "1.8", "1.5-psi", "1.8-psi")
"""The combinations that the paper repeated on the robot (section V-E)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Budget:
    """Amount of everything that is done.

    Attributes:
        cables: Names of the cables; every method is tried on the first.
        tune_trials: Casts on the rig to tune with, a quarter of them to validate (section V-D).
        real_trials: Casts on the rig to fine-tune with (section V-F).
        grid: Values of each action variable when coverage is measured (section V-E).
        grid_psi: The same where the wrist turns.
        coarse_generations: Generations of the search for parameters on a coarse cable.
        fine_generations: Generations at full resolution.
        repeat_actions: Actions that are repeated for each candidate of system parameters.
        repeat_casts: Casts of each (section V-E).
        casts: Simulated casts (section V-F).
        epochs: Largest number of passes of the training over them.
        candidates: Motions that a policy chooses from (section V-F).
        repeats: Casts at each target (section VI).
    """

    cables: tuple[str, ...] = CABLES
    tune_trials: int = 80
    real_trials: int = 200
    grid: int = 15
    grid_psi: int = 10
    coarse_generations: int = 60
    fine_generations: int = 25
    repeat_actions: int = 30
    repeat_casts: int = 5
    casts: int = 36_000
    epochs: int = 100
    candidates: int = 50_000
    repeats: int = 5


FULL = Budget()
QUICK = Budget(
    cables=("cable_1",),
    tune_trials=32,
    real_trials=40,
    grid=7,
    grid_psi=6,
    coarse_generations=30,
    fine_generations=15,
    repeat_actions=8,
    repeat_casts=3,
    casts=12_000,
    epochs=50,
    candidates=20_000,
    repeats=1,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class StageMaker:
    """Makes the stages of a reproduction; each reads what the ones before it left.

    Attributes:
        out: Folder of all results.
        setup: Workspace, arm and motion settings; each stage takes its own cable.
        budget: Amount of everything.
        rig: Rig that carries out the casts, as `make_rig` takes it.
        seed: Seed of everything that is drawn by chance.
        device: "cpu" or "cuda".
        workers: Who tunes, selects and simulates; see `check_workers`.
        report: Told how far the work within a stage is.
    """

    out: pathlib.Path
    setup: Setup
    budget: Budget
    rig: str
    seed: int
    device: str
    workers: str
    progress: ProgressCallback

    def __post_init__(self):
        check_seed(self.seed)
        if self.budget.repeats < 1 or not self.budget.cables:
            raise InputError("a reproduction needs at least one cable and one cast at each target")

    def stages(self) -> list[Stage]:
        """Return all stages: the first cable with every method, the others with the best."""
        stages: list[Stage] = []
        for place, cable in enumerate(self.budget.cables):
            stages += self._of_cable(cable, is_first=place == 0)
        return stages

    def _of_cable(self, cable: str, is_first: bool) -> list[Stage]:
        stages = [self._collect(cable, "tune"), self._tune(cable)]
        if is_first:
            stages += [self._repeat(cable), self._select(cable)]
        stages += [self._simulate(cable), self._collect(cable, "real")]
        methods = METHODS if is_first else (BEST_METHOD,)
        stages += [self._train(cable, m, is_first) for m in methods if m != "polar"]
        return stages + [self._evaluate(cable, method) for method in methods]

    def _stage(
        self, cable: str, name: str, title: str, expected: float, work: Callable[[], None]
    ) -> Stage:
        return Stage(
            name=f"{cable}/{name}",
            title=f"{cable}: {title}",
            folder=self.out / cable / name,
            expected=expected,
            work=work,
        )

    def _setup(self, cable: str) -> Setup:
        """Return the set-up with a cable."""
        setup = self.setup
        return dataclasses.replace(setup, cable=cable)

    def _chosen(self, cable: str) -> tuple[Setup, bool]:
        """Return the set-up and psi as `select` chose them with the first cable."""
        folder = self.out / self.budget.cables[0] / "select"
        metrics = Parts(folder).get("metrics")
        if metrics is None:
            raise InputError(f"{folder} holds no choice of system parameters")
        choice = metrics["choice"]
        setup = self._setup(cable).with_motion(r0=choice["r0"], v_max=choice["v_max"])
        return setup, choice["with_psi"]

    @contextlib.contextmanager
    def _open_rig(self, setup: Setup) -> Iterator[CheckedRig]:
        with make_rig(self.rig, setup, self.seed) as rig:
            yield rig

    def _dataset(self, cable: str, name: str) -> Dataset:
        return read_dataset(self.out / cable / name)

    def _collect(self, cable: str, purpose: Any) -> Stage:
        is_tune = purpose == "tune"
        count = self.budget.tune_trials if is_tune else self.budget.real_trials

        def work() -> None:
            # Casts to tune with are made before the system parameters are chosen (section V-F).
            setup, psi = (self._setup(cable), True) if is_tune else self._chosen(cable)
            with self._open_rig(setup) as rig:
                collect(
                    rig,
                    purpose=purpose,
                    count=count,
                    psi=psi,
                    seed=self.seed,
                    out=self.out / cable / f"{purpose}-data",
                    progress=self.progress,
                )

        title = f"{count} casts on the rig to {'tune' if is_tune else 'learn'} from"
        return self._stage(cable, f"{purpose}-data", title, SECONDS_PER_TRIAL * count, work)

    def _tune(self, cable: str) -> Stage:
        budget = self.budget

        def work() -> None:
            config = TuneConfig(
                coarse_generations=budget.coarse_generations,
                fine_generations=budget.fine_generations,
                seed=self.seed,
            )
            tune(
                self._dataset(cable, "tune-data"),
                config=config,
                device=self.device,
                workers=self.workers,
                out=self.out / cable / "tune",
                progress=self.progress,
            )

        share = budget.coarse_generations / FULL.coarse_generations
        trials = budget.tune_trials / FULL.tune_trials
        return self._stage(cable, "tune", "tune the simulator", 150.0 * share * trials, work)

    def _repeat(self, cable: str) -> Stage:
        budget = self.budget
        count = budget.repeat_actions * len(REPEATED) * budget.repeat_casts

        def work() -> None:
            with self._open_rig(self._setup(cable)) as rig:
                repeat(
                    rig,
                    combinations=REPEATED,
                    repeats=budget.repeat_casts,
                    action_count=budget.repeat_actions,
                    seed=self.seed,
                    out=self.out / cable / "repeat",
                    progress=self.progress,
                )

        title = f"{count} casts on the rig to see how they repeat"
        return self._stage(cable, "repeat", title, SECONDS_PER_TRIAL * count, work)

    def _select(self, cable: str) -> Stage:
        budget = self.budget

        def work() -> None:
            setup = self._setup(cable)
            select(
                setup,
                load_tuned(self.out / cable / "tune", setup),
                repeated=load_repeated(self.out / cable / "repeat", setup.cable),
                grid=budget.grid,
                grid_psi=budget.grid_psi,
                device=self.device,
                workers=self.workers,
                out=self.out / cable / "select",
                progress=self.progress,
            )

        count = 9 * budget.grid**3 + 1.5 * budget.grid_psi**4
        return self._stage(
            cable, "select", "choose r0, v_max and psi", SECONDS_PER_SIMULATION * count, work
        )

    def _simulate(self, cable: str) -> Stage:
        count = self.budget.casts

        def work() -> None:
            setup, psi = self._chosen(cable)
            simulate(
                setup,
                load_tuned(self.out / cable / "tune", setup),
                count=count,
                psi=psi,
                seed=self.seed,
                device=self.device,
                workers=self.workers,
                out=self.out / cable / "dataset",
                progress=self.progress,
            )

        title = f"{count:,} simulated casts"
        return self._stage(cable, "dataset", title, SECONDS_PER_SIMULATION * count, work)

    def _train(self, cable: str, method: str, is_first: bool) -> Stage:
        # Casts to learn from, and the method that `train` knows it by.
        sources: dict[str, tuple[bool, bool, Any]] = {
            "gaussian-process": (True, False, "gaussian-process"),
            "real": (False, True, "network"),
            "sim": (True, False, "network"),
            "fine-tuning": (True, True, "network"),
        }

        def work() -> None:
            simulated, real, name = sources[method]
            # The first cable's network of D_sim is evaluated on its own, too, and trained once.
            start = None
            if is_first and simulated and real:
                start = ForwardModel.load(self.out / cable / "model-sim")
            train(
                self._dataset(cable, "dataset") if simulated else None,
                self._dataset(cable, "real-data") if real else None,
                method=name,
                start=start,
                epochs=self.budget.epochs,
                candidate_count=self.budget.candidates,
                seed=self.seed,
                device=self.device,
                out=self.out / cable / f"model-{method}",
                progress=self.progress,
            )

        share = self.budget.casts / FULL.casts
        training = 90.0 * share * self.budget.epochs / FULL.epochs
        expected = {
            # Each of its steps multiplies with a matrix of all pairs of casts.
            "gaussian-process": 300.0 * share**2,
            "real": 15.0,
            "fine-tuning": 30.0 if is_first else 30.0 + training,
        }
        title = f"learn ({method})"
        return self._stage(cable, f"model-{method}", title, expected.get(method, training), work)

    def _evaluate(self, cable: str, method: str) -> Stage:
        def work() -> None:
            policy: Policy
            if method == "polar":
                policy = PolarCastingPolicy(setup=self._setup(cable))
            else:
                policy = ForwardSearchPolicy.load(self.out / cable / f"model-{method}")
            with self._open_rig(policy.setup) as rig:
                evaluate(
                    policy,
                    rig,
                    repeats=self.budget.repeats,
                    device=self.device,
                    out=self.out / cable / f"evaluate-{method}",
                    progress=self.progress,
                )

        count = TARGET_COUNT * self.budget.repeats
        seconds = SECONDS_PER_POLAR_TRIAL if method == "polar" else SECONDS_PER_TRIAL
        title = f"{count} casts on the rig at the targets ({method})"
        return self._stage(cable, f"evaluate-{method}", title, seconds * count, work)
