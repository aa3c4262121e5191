"""reproduce: every experiment of the paper, and one report of them all."""

import dataclasses
import os
import pathlib
from typing import Any

from cablecast.files import write_text
from cablecast.learning.policy import PolarCastingPolicy
from cablecast.pipeline.checks import check_way
from cablecast.pipeline.places import require
from cablecast.pipeline.reproduce_stages import FULL, Budget, StageMaker
from cablecast.runs.folder import RunFolder
from cablecast.runs.progress import Progress, ProgressCallback, StageLog, ignore, run_stages
from cablecast.runs.workers import LOCAL, check_workers, connected
from cablecast.setup import Setup
from cablecast.workspace import load_targets

REPORT_FILE = "report.html"
TABLES_FILE = "tables.md"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reproduced:
    """Results of every experiment of the paper.

    Attributes:
        path: Folder of all results.
        report: The report, an HTML page.
        tables: The tables in Markdown.
        metrics: Errors by cable and method, and the time that each stage took [s].
    """

    path: pathlib.Path
    report: pathlib.Path
    tables: pathlib.Path
    metrics: dict[str, Any]


def reproduce(
    out: str | os.PathLike[str],
    *,
    setup: Setup | None = None,
    budget: Budget = FULL,
    rig: str = "virtual",
    seed: int = 0,
    device: str = "cpu",
    workers: str = LOCAL,
    progress: ProgressCallback = ignore,
) -> Reproduced:
    """Repeat every experiment of the paper, and write one report.

    For each cable: cast on the rig, tune the simulator, choose the system parameters, simulate,
    cast again, train, and evaluate every method at the 32 targets. Work that was stopped goes on
    when it is called again with the same folder.

    Args:
        out: Folder of all results.
        setup: Workspace, arm and motion settings; the paper's where None. The cables are those of
            the budget.
        budget: Amount of everything.
        rig: Rig that carries out the casts, as `make_rig` takes it.
        seed: Seed of everything that is drawn by chance.
        device: "cpu" or "cuda".
        workers: Who simulates: "local", "ray" for a cluster on this machine, or "ray:ADDRESS".
        progress: Told how far the whole and each stage are.

    Raises:
        InputError: The folder holds something else, a value is out of bounds, or a cable does not
            fit the table.
        TargetError: A target of the paper cannot be asked for.
        JointLimitError: The arm cannot follow a polar cast.
        MissingExtraError: A library that a later stage needs is missing.
    """
    require("the reproduction", "torch", "safetensors", "matplotlib", "jinja2", "shapely")
    check_workers(workers)
    setup = setup or Setup()
    # Hours of casts must not end at a table that is too small for the third cable.
    setups = [dataclasses.replace(setup, cable=cable) for cable in budget.cables]
    check_way(setups, device)
    for first in setups[:1]:
        _ = PolarCastingPolicy(setup=first).plan(load_targets()).trajectories
    settings = {
        "setup": setup.to_settings(),
        "rig": rig,
        "seed": seed,
        "device": device,
        "budget": dataclasses.asdict(budget),
    }
    run = RunFolder.open(out, "reproduce", settings)
    maker = StageMaker(
        out=run.path,
        setup=setup,
        budget=budget,
        rig=rig,
        seed=seed,
        device=device,
        workers=workers,
        progress=progress,
    )
    with run.begun(), connected(workers):
        stages = maker.stages()
        log: StageLog = run_stages(stages, run.path, progress)
        progress(Progress(task="Writing the report"))
        times = [(stage.title, log.seconds.get(stage.name, 0.0)) for stage in stages]
        metrics = _write_report(run, budget, times)
        run.finish(metrics)
    return Reproduced(
        path=run.path,
        report=run.path / REPORT_FILE,
        tables=run.path / TABLES_FILE,
        metrics=metrics,
    )


def _write_report(run: RunFolder, budget: Budget, times: list[tuple[str, float]]) -> dict[str, Any]:
    from cablecast.report.reproduction import Reproduction, reproduction_page

    results = Reproduction(folder=run.path, cables=budget.cables)
    page, tables = reproduction_page(results, run.config, times)
    write_text(run.path / REPORT_FILE, page)
    write_text(run.path / TABLES_FILE, "\n".join(table.to_markdown() for table in tables))
    return {
        "evaluations": {cable: results.evaluations(cable) for cable in budget.cables},
        "seconds": dict(times),
    }
