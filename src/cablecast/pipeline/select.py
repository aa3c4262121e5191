"""select: choose r0, v_max and whether the wrist turns."""

import dataclasses
import os
from typing import Any

from cablecast.cable import Cable, CableParams
from cablecast.engines import EngineName, make_engine
from cablecast.engines.base import Engine, engine_settings
from cablecast.engines.spread import spread
from cablecast.errors import InputError, check_argument_types, check_count, check_number
from cablecast.evaluation.coverage import (
    R0_CHOICES,
    SCATTER_BOUNDS,
    SCATTER_MAX_PCT,
    V_MAX_CHOICES,
    Candidate,
    choose,
    choose_r0,
    covered_share,
    measure_coverage,
    outlines,
    polar_casting_region,
)
from cablecast.files import write_bytes
from cablecast.pipeline.places import folder_or_temporary, require
from cablecast.pipeline.repeat import Repeated, combination
from cablecast.report.maps import coverage_figure
from cablecast.report.style import png_bytes
from cablecast.runs.folder import RunFolder, settings_differences
from cablecast.runs.progress import DONE_NOTE, Progress, ProgressCallback, show
from cablecast.runs.workers import LOCAL, connected
from cablecast.setup import Setup
from cablecast.tuning.tuned import Tuned

COVERAGE_FOLDER = "coverage"
FIGURE_FILE = "coverage.png"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Selection:
    """Set-up with the chosen r0 and v_max, whether the wrist turns, and why, as in metrics.json."""

    setup: Setup
    with_psi: bool
    metrics: dict[str, Any]


@check_argument_types
def select(
    setup: Setup,
    tuned: Tuned | CableParams | None = None,
    *,
    repeated: Repeated | list[dict[str, Any]] | None = None,
    scatter_max_pct: float = SCATTER_MAX_PCT,
    grid: int = 15,
    grid_psi: int = 10,
    engine: EngineName = "warp",
    device: str = "cpu",
    workers: str = LOCAL,
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = show,
) -> Selection:
    """Compare what grids of casts cover for several r0 and v_max, and choose (section V-E).

    Nine combinations of r0 and v_max are simulated without a turn of the wrist, and the three
    speeds of the best r0 with one.

    Args:
        setup: Cable, workspace and arm.
        tuned: Result of `tune`, or parameters of the cable; the cable's own if None.
        repeated: Result of `repeat`, or its metrics, to weigh against coverage; coverage alone
            decides if None.
        scatter_max_pct: Largest acceptable scatter of repeated casts, the standard deviation of the
            distance to their mean landing [% of cable length].
        grid: Values of each action variable without a turn of the wrist; the paper has 15.
        grid_psi: Values of each action variable with one; the paper has 10, and half as many turns.
        engine: Simulator, see `make_engine`.
        device: "cpu" or "cuda".
        workers: Who simulates: "local", "ray" for a cluster on this machine, or "ray:ADDRESS".
        out: Folder that keeps the results and a figure, and lets a stopped run go on; none where
            None.
        progress: Receives the number of combinations done.

    Raises:
        InputError: A value out of bounds, or a folder that holds something else.
        MissingExtraError: shapely or matplotlib is missing.
    """
    check_number("scatter_max_pct", scatter_max_pct, *SCATTER_BOUNDS, "% of cable length")
    check_count("grid", grid, 1, 100)
    check_count("grid_psi", grid_psi, 1, 40)
    require("measuring coverage", "shapely", *(["matplotlib"] if out is not None else []))
    tuned = Tuned.of(tuned, setup)
    simulator = make_engine(engine, device=device)
    rows = _scatter_rows(repeated, setup.cable)
    settings = {
        **setup.to_settings(),
        **tuned.dynamics.to_dict(),
        "repeatability": rows,
        "scatter_max_pct": scatter_max_pct,
        "grid": grid,
        "grid_psi": grid_psi,
        "engine": engine_settings(simulator),
    }
    with folder_or_temporary(out) as folder:
        run = RunFolder.open(folder, "select", settings)
        metrics = run.metrics
        if metrics is None:
            with run.locked(), connected(workers):
                metrics = _survey(
                    run,
                    setup,
                    tuned,
                    spread(simulator, workers),
                    (grid, grid_psi),
                    rows,
                    scatter_max_pct,
                    progress,
                )
                if out is not None:
                    figure = coverage_figure(metrics, setup.workspace, setup.cable.length)
                    write_bytes(run.path / FIGURE_FILE, png_bytes(figure))
                    run.finish(metrics)
        else:
            progress(Progress(task=f"Selecting for {setup.cable.name}", note=DONE_NOTE))
    choice = metrics["choice"]
    return Selection(
        setup=setup.with_motion(r0=choice["r0"], v_max=choice["v_max"]),
        with_psi=choice["with_psi"],
        metrics=metrics,
    )


def _survey(
    run: RunFolder,
    setup: Setup,
    tuned: Tuned,
    engine: Engine,
    grids: tuple[int, int],
    rows: list[dict[str, Any]],
    scatter_max_pct: float,
    progress: ProgressCallback,
) -> dict[str, Any]:
    """Measure what each combination covers, choose one, and return the metrics."""
    pairs = [(r0, v_max) for r0 in R0_CHOICES for v_max in V_MAX_CHOICES]
    results: list[dict[str, Any]] = []

    def report(note: str = "") -> None:
        total = len(pairs) + len(V_MAX_CHOICES)
        task = f"Coverage of {setup.cable.name}"
        done = len(results)
        progress(Progress(task=task, done=done, total=total, unit="combinations", note=note))

    def measure(r0: float, v_max: float, with_psi: bool) -> None:
        grid, grid_psi = grids
        counts = (grid_psi,) * 3 + (max(grid_psi // 2, 1),) if with_psi else (grid,) * 3

        def coverage() -> dict[str, Any]:
            report(f"r0 = {r0:g} m, v_max = {v_max:g} m/s" + " with psi" * with_psi)
            moved = setup.with_motion(r0=r0, v_max=v_max)
            dynamics = tuned.dynamics.without_curl()
            return measure_coverage(moved, dynamics, engine, counts)

        name = f"r0_{r0:g}-v_max_{v_max:g}" + "-psi" * with_psi
        results.append(run.parts(COVERAGE_FOLDER).get_or_make(name, coverage))

    for r0, v_max in pairs:
        measure(r0, v_max, False)
    best_r0, _ = choose_r0([_candidate(result) for result in results])
    for v_max in V_MAX_CHOICES:
        measure(best_r0, v_max, True)
    report()
    for result in results:
        key = combination(result)
        result["repeatability"] = next((row for row in rows if combination(row) == key), None)
    best, reasons = choose([_candidate(result) for result in results], scatter_max_pct)
    polar = polar_casting_region(setup)
    radius = setup.workspace.reach(setup.cable.length)
    return {
        "cable": setup.cable.name,
        "half_disc_radius_m": radius,
        "coverage": results,
        "polar_casting": {
            "share": covered_share(polar, radius),
            "outline_xy": [xy for part in outlines(polar) for xy in part.round(4).tolist()],
        },
        "choice": {
            "r0": best.r0,
            "v_max": best.v_max,
            "with_psi": best.with_psi,
            "reasons": list(reasons),
        },
    }


def load_repeated(folder: str | os.PathLike[str], cable: Cable) -> list[dict[str, Any]]:
    """Return what `cablecast repeat` measured of each combination."""
    run = RunFolder.read(folder)
    metrics = run.metrics if run is not None and run.command == "repeat" else None
    if run is None or metrics is None:
        raise InputError(f"{folder} holds no finished run of `cablecast repeat`")
    if differences := settings_differences(run.settings["cable"], cable.to_dict()):
        raise InputError(f"{folder} was made with another cable: {'; '.join(differences)}")
    return metrics["combinations"]


def _scatter_rows(
    repeated: Repeated | list[dict[str, Any]] | None, cable: Cable
) -> list[dict[str, Any]]:
    if not isinstance(repeated, Repeated):
        return list(repeated or [])
    for result in repeated.results.values():
        if result.cable.name != cable.name:
            raise InputError(f"the repeated casts are of {result.cable.name}, not of {cable.name}")
    return repeated.metrics["combinations"]


def _candidate(result: dict[str, Any]) -> Candidate:
    repeated = result.get("repeatability") or {}
    r0, v_max, with_psi = combination(result)
    return Candidate(
        r0=r0,
        v_max=v_max,
        with_psi=with_psi,
        coverage=result["share"],
        scatter_pct=repeated.get("distance_sd_pct"),
        off_table_share=repeated.get("off_table_share"),
    )
