"""`cablecast select`: choose r0, v_max and whether the wrist turns."""

import dataclasses
import pathlib
import sys
from typing import TYPE_CHECKING, Annotated, Any

from cablecast.cli.options import DEFAULT_CABLE, Device, argument, cable_folder

if TYPE_CHECKING:
    from cablecast.cable import Cable, CableParams
    from cablecast.cli.run_folder import RunFolder
    from cablecast.evaluation.selection import Candidate
    from cablecast.motion.servo import ServoModel
    from cablecast.workspace import Workspace

SELECT_FOLDER = "select"
COVERAGE_FOLDER = "coverage"
FIGURE_FILE = "coverage.png"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Select:
    """Compare what grids of casts cover for several r0 and v_max, and choose among them.

    Nine combinations of r0 and v_max are simulated without a turn of the wrist, and the three
    speeds of the best r0 with one. With --repeat, what `cablecast repeat` measured is weighed
    against coverage. A run that was stopped goes on where it was.
    """

    cable: Annotated[str, argument("CABLE")] = DEFAULT_CABLE
    """Which cable: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    params: Annotated[pathlib.Path | None, argument("FILE", "what the cable says of itself")] = None
    """Parameters of the cable, and lag of the arm, that `cablecast tune` found (params.json)."""
    repeat: Annotated[pathlib.Path | None, argument("DIR", "coverage alone decides")] = None
    """Folder that `cablecast repeat` wrote, with the combinations to choose from."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/select")] = None
    """Where to put the results."""
    scatter_max: Annotated[float, argument("PCT")] = 3.0
    """Largest scatter of repeated casts that is acceptable, in % of cable length."""
    grid: int = 15
    """Values of each action variable without a turn of the wrist; the paper has 15 x 15 x 15."""
    grid_psi: int = 10
    """The same with one; the paper has 10 x 10 x 10 and half as many turns."""
    device: Device = "cpu"
    """Simulate on the processor or on an NVIDIA graphics card."""

    def run(self) -> None:
        """Measure, choose, draw, and print the table."""
        from cablecast.cable import load_cable
        from cablecast.cli.run_folder import RunFolder
        from cablecast.workspace import Workspace

        cable, workspace = load_cable(self.cable), Workspace()
        params, servo = load_tuned(self.params, cable)
        repeated = read_repeatability(self.repeat, cable)
        settings = {
            "cable": cable.to_dict(),
            "params": params.to_dict(),
            "servo": None if servo is None else servo.to_dict(),
            "repeatability": repeated,
            "scatter_max_pct": self.scatter_max,
            "grid": self.grid,
            "grid_psi": self.grid_psi,
            "device": self.device,
        }
        out = self.out or cable_folder(cable.name) / SELECT_FOLDER
        run = RunFolder.open(out, "select", settings)
        if run.metrics is None:
            run.begin()
            self._select(run, cable, (params, servo), workspace, repeated)
        print_choice(run.metrics or {})
        print(f"metrics  {out / 'metrics.json'}\nfigure   {out / FIGURE_FILE}")

    def _select(
        self,
        run: "RunFolder",
        cable: "Cable",
        tuned: "tuple[CableParams, ServoModel | None]",
        workspace: "Workspace",
        repeated: list[dict[str, Any]],
    ) -> None:
        from cablecast.evaluation.coverage import (
            R0_CHOICES,
            V_MAX_CHOICES,
            covered_share,
            outlines,
            polar_casting_region,
        )
        from cablecast.evaluation.selection import choose, choose_r0
        from cablecast.files import write_bytes
        from cablecast.report.coverage import coverage_figure
        from cablecast.report.style import png_bytes

        def measured(pairs, with_psi: bool) -> list[dict[str, Any]]:
            return [
                self._coverage(run, cable, tuned, workspace, r0, v_max, with_psi)
                for r0, v_max in pairs
            ]

        results = measured(((r0, v) for r0 in R0_CHOICES for v in V_MAX_CHOICES), False)
        r0, _ = choose_r0([as_candidate(result) for result in results])
        results += measured(((r0, v) for v in V_MAX_CHOICES), True)
        for result in results:
            key = combination(result)
            result["repeatability"] = next((r for r in repeated if combination(r) == key), None)
        choice = choose([as_candidate(result) for result in results], self.scatter_max)
        polar = polar_casting_region(cable, workspace)
        radius = workspace.reach(cable.length)
        figure = coverage_figure(results, outlines(polar)[0], workspace, cable.length)
        write_bytes(run.path / FIGURE_FILE, png_bytes(figure))
        run.finish(
            {
                "cable": cable.name,
                "half_disc_radius_m": radius,
                "coverage": results,
                "polar_casting": {
                    "share": covered_share(polar, radius),
                    "outline_xy": outlines(polar)[0].round(4).tolist(),
                },
                "choice": choice.to_dict(),
            }
        )

    def _coverage(
        self,
        run: "RunFolder",
        cable: "Cable",
        tuned: "tuple[CableParams, ServoModel | None]",
        workspace: "Workspace",
        r0: float,
        v_max: float,
        with_psi: bool,
    ) -> dict[str, Any]:
        """One combination, from the disk where an earlier run had come so far."""
        import json

        from cablecast.evaluation.coverage import measure_coverage
        from cablecast.files import write_json
        from cablecast.motion.action import MotionConfig

        name = f"r0_{r0:g}-v_max_{v_max:g}" + "-psi" * with_psi
        file = run.path / COVERAGE_FOLDER / f"{name}.json"
        if file.exists():
            return json.loads(file.read_text())
        from cablecast.engines.warp_ import EngineWarp

        counts = (self.grid,) * 3
        if with_psi:
            counts = (self.grid_psi,) * 3 + (max(self.grid_psi // 2, 1),)
        print(
            f"Simulating r0 = {r0:g} m, v_max = {v_max:g} m/s" + " with psi" * with_psi,
            file=sys.stderr,
        )
        engine = EngineWarp(device=self.device)
        config = MotionConfig(r0=r0, v_max=v_max)
        params, servo = tuned
        coverage = measure_coverage(config, cable, params, engine, workspace, counts, servo)
        result = coverage.to_dict()
        write_json(file, result)
        return result


def load_tuned(
    file: pathlib.Path | None, cable: "Cable"
) -> "tuple[CableParams, ServoModel | None]":
    """What `cablecast tune` found, or what the cable says of itself and an arm without lag.

    Args:
        file: Its params.json, the folder that holds it, or None.
        cable: The cable.
    """
    if file is None:
        return cable.params, None
    from cablecast.tuning import read_params, read_servo

    return read_params(file, cable), read_servo(file)


def read_repeatability(folder: pathlib.Path | None, cable: "Cable") -> list[dict[str, Any]]:
    """What `cablecast repeat` measured of each combination; nothing without a folder.

    Raises:
        InputError: The folder holds no finished run of it, or one with another cable.
    """
    if folder is None:
        return []
    from cablecast.cable import Cable
    from cablecast.cli.options import check_same_cable
    from cablecast.cli.run_folder import RunFolder
    from cablecast.errors import InputError

    config = RunFolder.read_config(folder)
    metrics = RunFolder(path=folder, config=config or {}).metrics
    if config is None or config["command"] != "repeat" or metrics is None:
        raise InputError(f"{folder} holds no finished run of `cablecast repeat`")
    check_same_cable(cable, Cable.from_dict(config["settings"]["cable"]), folder)
    return metrics["combinations"]


def combination(result: dict[str, Any]) -> tuple[float, float, bool]:
    """r0, v_max and whether the wrist turns, as coverage and repeatability both name them."""
    return result["r0"], result["v_max"], result["with_psi"]


def as_candidate(result: dict[str, Any]) -> "Candidate":
    """A combination as the choice is made from it.

    Args:
        result: Its coverage, with its repeatability where that was measured.
    """
    from cablecast.evaluation.selection import Candidate

    repeated = result.get("repeatability") or {}
    r0, v_max, with_psi = combination(result)
    return Candidate(
        r0=r0,
        v_max=v_max,
        with_psi=with_psi,
        coverage=result["share"],
        scatter_pct=repeated.get("scatter_pct"),
        off_table_share=repeated.get("off_table_share"),
    )


def print_choice(metrics: dict[str, Any]) -> None:
    """Print what every combination covers, and which was chosen.

    Args:
        metrics: What metrics.json holds.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    ratio = metrics["coverage"][0]["hull_ratio"]
    table = Table(title="Share of the reachable half disc", box=box.SIMPLE)
    table.caption = f"Concave hulls of ratio {ratio:g}; scatter in % of cable length."
    for name in ("r0 [m]", "v_max [m/s]", "psi", "casts", "coverage [%]", "scatter [%]"):
        table.add_column(name, justify="right", no_wrap=True)
    chosen = metrics["choice"]
    for row in metrics["coverage"]:
        scatter_pct = (row["repeatability"] or {}).get("scatter_pct")
        table.add_row(
            f"{row['r0']:g}",
            f"{row['v_max']:g}",
            "yes" if row["with_psi"] else "no",
            str(row["feasible_count"]),
            f"{100 * row['share']:.1f}",
            "" if scatter_pct is None else f"{scatter_pct:.2f}",
            style="bold" if combination(row) == combination(chosen) else "",
        )
    table.add_section()
    table.add_row("polar casting", "", "", "", f"{100 * metrics['polar_casting']['share']:.1f}", "")
    console = Console()
    console.print(table)
    for reason in chosen["reasons"]:
        console.print(reason, highlight=False, soft_wrap=True)
