"""The stages of `cablecast reproduce`: which verbs run, on what, in which folders."""

import dataclasses
import json
import pathlib
from collections.abc import Callable
from typing import Any

from cablecast.cli.options import Device
from cablecast.cli.repeat import Combination
from cablecast.cli.run_folder import METRICS_FILE
from cablecast.cli.stages import Stage

CABLES = ("cable_1", "cable_2", "cable_3")
METHODS = ("polar", "gaussian-process", "real", "sim", "fine-tuning", "correction")
"""Polar casting, the Gaussian process of D_sim, the forward model of D_real, of D_sim, and of D_sim
fine-tuned on D_real, which are the paper's; and the forward model corrected by D_real, ours."""
BEST_METHOD = "correction"

TARGET_COUNT = 32

# What the expected end is told from, on two cores; measured times take over as stages finish.
SECONDS_PER_TRIAL = 0.6
# Polar casting swings the cable up and pulls it in slowly: its motions last four times as long.
SECONDS_PER_POLAR_TRIAL = 2.0
SECONDS_PER_SIMULATION = 1.5e-3

REPEATED: tuple[Combination, ...] = ("1.2", "1.8", "1.5-psi", "1.8-psi")
"""The combinations that the paper repeated on the robot (section V-E)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Budget:
    """How much of everything is done.

    Attributes:
        cables: On which cables; every method is tried on the first.
        tune_trials: Casts on the rig to tune with, a quarter of them to validate (section V-D).
        real_trials: Casts on the rig to fine-tune with (section V-F).
        grid: Values of each action variable when coverage is measured (section V-E).
        grid_psi: The same where the wrist turns.
        coarse_generations: Generations of the search for parameters on a coarse cable.
        fine_generations: Generations at full resolution.
        repeat_actions: Actions that are repeated for each candidate of system parameters.
        repeat_casts: Casts of each (section V-E).
        casts: Simulated casts (section V-F).
        epochs: How often at most the training goes through them.
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


def make_stages(
    out: pathlib.Path, budget: Budget, rig: str, seed: int, device: Device
) -> list[Stage]:
    """All stages in order: the first cable with every method, the others with the best.

    Args:
        out: Where everything lies.
        budget: How much of everything is done.
        rig: What carries out the casts.
        seed: Of everything that is drawn by chance.
        device: Where is simulated and trained.
    """
    maker = _StageMaker(out=out, budget=budget, rig=rig, seed=seed, device=device)
    stages: list[Stage] = []
    for place, cable in enumerate(budget.cables):
        stages += maker.of_cable(cable, is_first=place == 0)
    return stages


@dataclasses.dataclass(frozen=True, kw_only=True)
class _StageMaker:
    """Makes stages; a verb is made when its turn comes, because it reads what others left."""

    out: pathlib.Path
    budget: Budget
    rig: str
    seed: int
    device: Device

    def of_cable(self, cable: str, is_first: bool) -> list[Stage]:
        """The stages of one cable."""
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

    def _chosen(self) -> dict[str, Any]:
        """r0, v_max and psi as `cablecast select` chose them with the first cable, as options."""
        file = self.out / self.budget.cables[0] / "select" / METRICS_FILE
        choice = json.loads(file.read_text())["choice"]
        return {"r0": choice["r0"], "v_max": choice["v_max"], "psi": choice["with_psi"]}

    def _collect(self, cable: str, purpose: str) -> Stage:
        is_tune = purpose == "tune"
        count = self.budget.tune_trials if is_tune else self.budget.real_trials

        def work() -> None:
            from cablecast.cli.collect import Collect

            # What to tune with is cast before the system parameters are chosen (section V-F).
            chosen = {} if is_tune else self._chosen()
            Collect(
                rig=self.rig,
                purpose="tune" if is_tune else "real",
                cable=cable,
                count=count,
                out=self.out / cable / f"{purpose}-data",
                seed=self.seed,
                **chosen,
            ).run()

        title = f"{count} casts on the rig to {'tune' if is_tune else 'learn'} from"
        return self._stage(cable, f"{purpose}-data", title, SECONDS_PER_TRIAL * count, work)

    def _tune(self, cable: str) -> Stage:
        def work() -> None:
            from cablecast.cli.tune import Tune

            Tune(
                cable=cable,
                dataset=self.out / cable / "tune-data",
                out=self.out / cable / "tune",
                seed=self.seed,
                device=self.device,
                coarse_generations=self.budget.coarse_generations,
                fine_generations=self.budget.fine_generations,
            ).run()

        share = self.budget.coarse_generations / FULL.coarse_generations
        trials = self.budget.tune_trials / FULL.tune_trials
        return self._stage(cable, "tune", "tune the simulator", 150.0 * share * trials, work)

    def _repeat(self, cable: str) -> Stage:
        count = self.budget.repeat_actions * len(REPEATED) * self.budget.repeat_casts

        def work() -> None:
            from cablecast.cli.repeat import Repeat

            Repeat(
                rig=self.rig,
                cable=cable,
                combinations=REPEATED,
                repeats=self.budget.repeat_casts,
                action_count=self.budget.repeat_actions,
                out=self.out / cable / "repeat",
                seed=self.seed,
            ).run()

        title = f"{count} casts on the rig to see how they repeat"
        return self._stage(cable, "repeat", title, SECONDS_PER_TRIAL * count, work)

    def _select(self, cable: str) -> Stage:
        def work() -> None:
            from cablecast.cli.select import Select

            Select(
                cable=cable,
                params=self.out / cable / "tune",
                repeat=self.out / cable / "repeat",
                out=self.out / cable / "select",
                grid=self.budget.grid,
                grid_psi=self.budget.grid_psi,
                device=self.device,
            ).run()

        count = 9 * self.budget.grid**3 + 1.5 * self.budget.grid_psi**4
        return self._stage(
            cable, "select", "choose r0, v_max and psi", SECONDS_PER_SIMULATION * count, work
        )

    def _simulate(self, cable: str) -> Stage:
        def work() -> None:
            from cablecast.cli.simulate import Simulate

            Simulate(
                cable=cable,
                params=self.out / cable / "tune",
                count=self.budget.casts,
                out=self.out / cable / "dataset",
                seed=self.seed,
                device=self.device,
                **self._chosen(),
            ).run()

        return self._stage(
            cable,
            "dataset",
            f"{self.budget.casts:,} simulated casts",
            SECONDS_PER_SIMULATION * self.budget.casts,
            work,
        )

    def _train(self, cable: str, method: str, is_first: bool) -> Stage:
        simulated, real = self.out / cable / "dataset", self.out / cable / "real-data"
        # The first cable's network of D_sim is evaluated on its own, too, and trained only once.
        start = self.out / cable / "model-sim" if is_first else None
        sources: dict[str, dict[str, Any]] = {
            "gaussian-process": {"dataset": simulated, "method": "gaussian-process"},
            "real": {"real": real, "mode": "real"},
            "sim": {"dataset": simulated},
            "fine-tuning": {
                "dataset": simulated,
                "real": real,
                "method": "fine-tuning",
                "start": start,
            },
            "correction": {
                "dataset": simulated,
                "real": real,
                "method": "correction",
                "start": start,
            },
        }

        def work() -> None:
            from cablecast.cli.train import Train

            Train(
                cable=cable,
                out=self.out / cable / f"model-{method}",
                seed=self.seed,
                device=self.device,
                epochs=self.budget.epochs,
                candidate_count=self.budget.candidates,
                **sources[method],
            ).run()

        share = self.budget.casts / FULL.casts
        training = 90.0 * share * self.budget.epochs / FULL.epochs
        expected = {
            # Each of its steps multiplies with a matrix of all pairs of casts.
            "gaussian-process": 300.0 * share**2,
            "real": 15.0,
            "fine-tuning": 30.0,
            "correction": 20.0 if is_first else training,
        }
        return self._stage(
            cable,
            f"model-{method}",
            f"learn ({method})",
            expected.get(method, training),
            work,
        )

    def _evaluate(self, cable: str, method: str) -> Stage:
        def work() -> None:
            from cablecast.cli.evaluate import Evaluate

            Evaluate(
                cable=cable,
                model=None if method == "polar" else self.out / cable / f"model-{method}",
                policy="polar" if method == "polar" else "model",
                rig=self.rig,
                repeats=self.budget.repeats,
                out=self.out / cable / f"evaluate-{method}",
                seed=self.seed,
            ).run()

        count = TARGET_COUNT * self.budget.repeats
        seconds = SECONDS_PER_POLAR_TRIAL if method == "polar" else SECONDS_PER_TRIAL
        return self._stage(
            cable,
            f"evaluate-{method}",
            f"{count} casts on the rig at the targets ({method})",
            seconds * count,
            work,
        )
