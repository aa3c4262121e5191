"""reproduce: every experiment of the paper, and one report of them all."""

import dataclasses
import functools
import os
import pathlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cablecast.data.dataset import read_dataset
from cablecast.engines import EngineName, make_engine
from cablecast.engines.base import engine_settings
from cablecast.errors import InputError, check_argument_types, check_seed
from cablecast.evaluation.published import BEST_METHOD
from cablecast.files import write_text
from cablecast.learning.checkpoint import check_device
from cablecast.learning.network import ForwardModel
from cablecast.learning.policy import ForwardSearchPolicy, PolarCastingPolicy, Policy
from cablecast.pipeline.collect import collect
from cablecast.pipeline.evaluate import evaluate
from cablecast.pipeline.places import require
from cablecast.pipeline.repeat import COMBINATIONS, repeat
from cablecast.pipeline.select import load_repeated, select
from cablecast.pipeline.simulate import simulate
from cablecast.pipeline.train import Method, train
from cablecast.pipeline.tune import tune
from cablecast.report.reproduction import Reproduction, reproduction_page
from cablecast.rigs.make import make_rig
from cablecast.runs.folder import Parts, RunFolder
from cablecast.runs.progress import FolderStage, Progress, ProgressCallback, run_stages, show
from cablecast.runs.workers import LOCAL, check_workers, connected
from cablecast.setup import Setup
from cablecast.task import LANDING
from cablecast.tuning.tune import TuneConfig
from cablecast.tuning.tuned import load_tuned
from cablecast.workspace import load_targets

REPORT_FILE = "report.html"
TABLES_FILE = "tables.md"

CABLES = ("cable_1", "cable_2", "cable_3")

MODELS: dict[str, tuple[bool, bool, Method]] = {
    "gaussian-process": (True, False, "gaussian-process"),
    "real": (False, True, "network"),
    "sim": (True, False, "network"),
    "fine-tuning": (True, True, "network"),
}
"""Whether a method is trained on D_sim, whether on D_real, and its name in `train`."""
OURS = "ours"
METHODS = ("polar", *MODELS, OURS)

# Rough durations on two cores, for the expected end; measured times take over as stages finish.
_SECONDS_PER_TRIAL = 0.6
# Polar casting swings the cable up and pulls it in slowly: its motions last four times as long.
_SECONDS_PER_POLAR_TRIAL = 2.0
_SECONDS_PER_SIMULATION = {"warp": 1.5e-3, "mujoco": 0.3, "pybullet": 0.8}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Budget:
    """Amount of everything that is done.

    Attributes:
        cables: Names of the cables; every method is tried on the first.
        tune_casts: Casts on the rig to tune with (section V-D).
        more_casts: Further ones, with which tuning is repeated; 0 for none.
        validation_casts: Casts to measure both with.
        real_trials: Casts on the rig to fine-tune with (section V-F).
        grid: Values of each action variable when coverage is measured (section V-E).
        grid_psi: The same where the wrist turns.
        generations: Largest number of generations of the search for parameters.
        repeat_actions: Actions that are repeated for each candidate of system parameters; all of
            the paper's grids that the arm can make if None.
        repeat_casts: Casts of each (section V-E).
        casts: Simulated casts (section V-F).
        epochs: Largest number of passes of the training over them.
        candidates: Motions that a policy chooses from (section V-F).
        repeats: Casts at each target (section VI).
    """

    cables: tuple[str, ...] = CABLES
    tune_casts: int = 60
    more_casts: int = 20
    validation_casts: int = 20
    real_trials: int = 200
    grid: int = 15
    grid_psi: int = 10
    generations: int = 200
    repeat_actions: int | None = None
    repeat_casts: int = 5
    casts: int = 36_000
    epochs: int = 100
    candidates: int = 50_000
    repeats: int = 5


FULL = Budget()
QUICK = Budget(
    cables=("cable_1",),
    tune_casts=24,
    more_casts=8,
    validation_casts=8,
    real_trials=40,
    grid=7,
    grid_psi=6,
    generations=60,
    repeat_actions=8,
    repeat_casts=3,
    casts=12_000,
    epochs=50,
    candidates=20_000,
    repeats=1,
)
QUICK_SLOW = dataclasses.replace(
    QUICK, tune_casts=12, more_casts=0, grid=3, grid_psi=3, generations=5, casts=600
)
"""Less than an hour on two cores with an engine that simulates two casts a second."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reproduced:
    """Folder of every experiment of the paper, its report (HTML), tables (Markdown) and metrics.

    These are errors by cable and method, and the time that each stage took [s].
    """

    path: pathlib.Path
    report: pathlib.Path
    tables: pathlib.Path
    metrics: dict[str, Any]

    @functools.cached_property
    def medians_pct(self) -> dict[str, float]:
        """Median error of each method on the first cable [% of cable length], best first."""
        evaluations: Mapping[str, Any] = next(iter(self.metrics["evaluations"].values()))
        medians = {name: values["errors_pct"]["median_pct"] for name, values in evaluations.items()}
        known = {name: value for name, value in medians.items() if value is not None}
        return dict(sorted(known.items(), key=lambda item: item[1]))

    @property
    def holds(self) -> bool:
        """Whether the paper's method beats both methods without simulated casts.

        These are polar casting and a network of real casts alone. The median of the network that
        was fine-tuned on real casts must be smaller than theirs.
        """
        medians = self.medians_pct
        others = [medians[name] for name in ("polar", "real") if name in medians]
        return BEST_METHOD in medians and all(medians[BEST_METHOD] < other for other in others)


@check_argument_types
def reproduce(
    out: str | os.PathLike[str],
    *,
    setup: Setup | None = None,
    budget: Budget = FULL,
    rig: str = "virtual",
    engine: EngineName = "warp",
    seed: int = 0,
    device: str = "cpu",
    workers: str = LOCAL,
    progress: ProgressCallback = show,
) -> Reproduced:
    """Repeat every experiment of the paper, and write one report.

    For each cable: cast on the rig, tune the simulator, choose the system parameters, simulate,
    cast again, train, and evaluate every method at the 32 targets. All is done as the paper says;
    our way to plan stands next to it under its own name. Work that was stopped goes on when it
    is called again with the same folder.

    Args:
        out: Folder of all results.
        setup: Workspace, arm and motion settings; the paper's if None. The cables are those of
            the budget.
        budget: Amount of everything.
        rig: Rig that carries out the casts, as `make_rig` takes it.
        engine: Simulator, see `make_engine`; the paper's is "pybullet".
        seed: Seed of all random numbers.
        device: "cpu" or "cuda".
        workers: Who simulates: "local", "ray" for a cluster on this machine, or "ray:ADDRESS".
        progress: Receives the stage and its progress.

    Raises:
        InputError: The folder holds something else, a value is out of bounds, or a cable does not
            fit the table.
        TargetError: A target of the paper cannot be asked for.
        JointLimitError: The arm cannot follow a polar cast.
        MissingExtraError: A library that a later stage needs is missing.
    """
    require("the reproduction", "torch", "safetensors", "matplotlib", "jinja2", "shapely")
    check_workers(workers)
    check_seed(seed)
    if budget.repeats < 1 or not budget.cables:
        raise InputError("a reproduction needs at least one cable and one cast at each target")
    setup = setup or Setup()
    # Hours of casts must not end at a table that is too small for the third cable.
    setups = [setup.with_cable(cable) for cable in budget.cables]
    simulator = make_engine(engine, device=device)
    check_device(device)
    for one in setups:
        LANDING.values(one, load_targets())
    _ = PolarCastingPolicy(setup=setups[0]).plan(load_targets()).trajectories
    settings = {
        "setup": setup.to_settings(),
        "rig": rig,
        "engine": engine_settings(simulator),
        "seed": seed,
        "device": device,
        "budget": dataclasses.asdict(budget),
    }
    run = RunFolder.open(out, "reproduce", settings)
    work = _Work(
        out=run.path,
        setup=setup,
        budget=budget,
        rig=rig,
        engine=engine,
        seed=seed,
        device=device,
        workers=workers,
        progress=progress,
    )
    with run.locked(), connected(workers):
        stages = work.stages()
        log = run_stages(stages, run.path, progress)
        progress(Progress(task="Writing the report"))
        times = [(stage.title, log.seconds.get(stage.name, 0.0)) for stage in stages]
        results = Reproduction(folder=run.path, cables=budget.cables)
        page, tables = reproduction_page(results, run.config, times)
        write_text(run.path / REPORT_FILE, page)
        write_text(run.path / TABLES_FILE, "\n".join(table.to_markdown() for table in tables))
        metrics = {
            "evaluations": {cable: results.evaluations(cable) for cable in budget.cables},
            "seconds": dict(times),
        }
        run.finish(metrics)
    return Reproduced(
        path=run.path,
        report=run.path / REPORT_FILE,
        tables=run.path / TABLES_FILE,
        metrics=metrics,
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Work:
    """The stages of a reproduction; each reads what the ones before it left."""

    out: pathlib.Path
    setup: Setup
    budget: Budget
    rig: str
    engine: EngineName
    seed: int
    device: str
    workers: str
    progress: ProgressCallback

    def stages(self) -> list[FolderStage]:
        """Return all stages: every method with the first cable, the last two with the others."""
        budget, stages = self.budget, []

        def add(
            cable: str, name: str, title: str, seconds: float, work: Callable[..., Any], *args: Any
        ) -> None:
            stages.append(
                FolderStage(
                    name=f"{cable}/{name}",
                    title=f"{cable}: {title}",
                    folder=self.out / cable / name,
                    expected=seconds,
                    work=functools.partial(work, cable, *args),
                )
            )

        each_simulated = _SECONDS_PER_SIMULATION[self.engine]
        tuning = each_simulated * 5.0 * budget.generations
        actions = budget.repeat_actions or 100
        repeats = actions * len(COMBINATIONS) * budget.repeat_casts
        coverage = 12 * budget.grid**3 + 1.5 * budget.grid_psi**4
        share = budget.casts / FULL.casts
        training = 90.0 * share * budget.epochs / FULL.epochs
        at_targets = len(load_targets()) * budget.repeats
        for cable in budget.cables:
            is_first = cable == budget.cables[0]
            count = budget.tune_casts + budget.more_casts + budget.validation_casts
            title = f"{count} casts on the rig to tune from"
            add(cable, "tune-data", title, _SECONDS_PER_TRIAL * count, self._collect, "tune", count)
            few, more = budget.tune_casts, budget.tune_casts + budget.more_casts
            title = f"tune the simulator with {few} casts"
            add(cable, "tune", title, tuning * few, self._tune, "tune", few)
            if more > few:
                title = f"tune the simulator with {more} casts"
                add(cable, "tune-more", title, tuning * more, self._tune, "tune-more", more)
            if is_first:
                title = "repeated casts on the rig"
                add(cable, "repeat", title, _SECONDS_PER_TRIAL * repeats, self._repeat)
                seconds = each_simulated * coverage
                add(cable, "select", "choose r0, v_max and psi", seconds, self._select)
            seconds = each_simulated * budget.casts
            add(cable, "dataset", f"{budget.casts:,} simulated casts", seconds, self._simulate)
            count = budget.real_trials
            title = f"{count} casts on the rig to fine-tune with"
            add(cable, "real-data", title, _SECONDS_PER_TRIAL * count, self._collect, "real", count)
            for method in MODELS if is_first else (BEST_METHOD,):
                # The posterior of the process is linear in the casts.
                seconds = {"gaussian-process": 30.0 + 60.0 * share, "real": 15.0}.get(
                    method, training
                )
                seconds = 30.0 if is_first and method == BEST_METHOD else seconds
                add(cable, f"model-{method}", f"train ({method})", seconds, self._train, method)
            for method in METHODS if is_first else (BEST_METHOD, OURS):
                title = f"{at_targets} casts on the rig at the targets ({method})"
                each = _SECONDS_PER_POLAR_TRIAL if method == "polar" else _SECONDS_PER_TRIAL
                name = f"evaluate-{method}"
                add(cable, name, title, each * at_targets, self._evaluate, method)
        return stages

    def _options(self, cable: str, name: str, *names: str) -> dict[str, Any]:
        """Return the folder of a stage, the callback, and the settings that its verb takes."""
        options = {"out": self.out / cable / name, "progress": self.progress}
        return options | {name: getattr(self, name) for name in names}

    def _setup(self, cable: str) -> Setup:
        return self.setup.with_cable(cable)

    def _chosen(self, cable: str) -> tuple[Setup, bool]:
        """Return the set-up and psi as `select` chose them with the first cable."""
        folder = self.out / self.budget.cables[0] / "select"
        metrics = Parts(folder).get("metrics")
        if metrics is None:
            raise InputError(f"{folder} holds no choice of system parameters")
        choice = metrics["choice"]
        setup = self._setup(cable).with_motion(r0=choice["r0"], v_max=choice["v_max"])
        return setup, choice["with_psi"]

    def _collect(self, cable: str, purpose: Any, count: int) -> None:
        # Casts to tune with are made before the system parameters are chosen (section V-F).
        setup, psi = (self._setup(cable), True) if purpose == "tune" else self._chosen(cable)
        options = self._options(cable, f"{purpose}-data", "seed")
        with make_rig(self.rig, setup, self.seed) as rig:
            collect(rig, purpose=purpose, count=count, psi=psi, **options)

    def _tune(self, cable: str, name: str, count: int) -> None:
        casts, held_out = read_dataset(self.out / cable / "tune-data"), self.budget.validation_casts
        row = np.arange(len(casts))
        # Whatever the number of casts to tune with, the last ones measure the result.
        casts = casts.rows((row < count) | (row >= len(casts) - held_out))
        tune(
            casts,
            config=TuneConfig(generations=self.budget.generations, seed=self.seed),
            validation_count=held_out,
            **self._options(cable, name, "engine", "device", "workers"),
        )

    def _repeat(self, cable: str) -> None:
        with make_rig(self.rig, self._setup(cable), self.seed) as rig:
            repeat(
                rig,
                combinations=tuple(COMBINATIONS),
                repeats=self.budget.repeat_casts,
                action_count=self.budget.repeat_actions,
                **self._options(cable, "repeat", "seed"),
            )

    def _select(self, cable: str) -> None:
        setup = self._setup(cable)
        select(
            setup,
            load_tuned(self.out / cable / "tune", setup),
            repeated=load_repeated(self.out / cable / "repeat", setup.cable),
            grid=self.budget.grid,
            grid_psi=self.budget.grid_psi,
            **self._options(cable, "select", "engine", "device", "workers"),
        )

    def _simulate(self, cable: str) -> None:
        setup, psi = self._chosen(cable)
        simulate(
            setup,
            load_tuned(self.out / cable / "tune", setup),
            count=self.budget.casts,
            psi=psi,
            **self._options(cable, "dataset", "seed", "engine", "device", "workers"),
        )

    def _train(self, cable: str, method: str) -> None:
        simulated, real, name = MODELS[method]
        # The first cable's network of D_sim is evaluated on its own, too, and trained once.
        start = None
        if simulated and real and cable == self.budget.cables[0]:
            start = ForwardModel.load(self.out / cable / "model-sim")
        train(
            read_dataset(self.out / cable / "dataset") if simulated else None,
            read_dataset(self.out / cable / "real-data") if real else None,
            method=name,
            start=start,
            epochs=self.budget.epochs,
            candidate_count=self.budget.candidates,
            **self._options(cable, f"model-{method}", "seed", "device"),
        )

    def _evaluate(self, cable: str, method: str) -> None:
        options = self._options(cable, f"evaluate-{method}", "device")
        policy: Policy = PolarCastingPolicy(setup=self._setup(cable))
        if method != "polar":
            model = BEST_METHOD if method == OURS else method
            policy = ForwardSearchPolicy.load(self.out / cable / f"model-{model}")
            options["method"] = "refined" if method == OURS else "paper"
        with make_rig(self.rig, policy.setup, self.seed) as rig:
            evaluate(policy, rig, repeats=self.budget.repeats, **options)
