"""`cablecast evaluate`: cast at the 32 targets and report how near the cable landed."""

import dataclasses
import pathlib
import sys
import typing
from typing import TYPE_CHECKING, Annotated, Any

from cablecast.cli.options import (
    DEFAULT_CABLE,
    Device,
    argument,
    cable_folder,
    check_same_cable,
    evaluation_folder,
    find_model,
)

if TYPE_CHECKING:
    from cablecast.cable import Cable
    from cablecast.models.landing import LandingModel
    from cablecast.policies.forward_search import ForwardSearchPolicy
    from cablecast.policies.polar_casting import PolarCastingPolicy
    from cablecast.rigs.base import Rig
    from cablecast.workspace import Workspace

TRIALS_FILE = "trials.csv"
LANDINGS_FILE = "landings.png"
REPORT_FILE = "report.html"
CASTS_FOLDER = "casts"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Cast at the paper's 32 targets and measure how far from them the cable lands.

    Writes metrics.json, a table of every cast (trials.csv), a map of the landings (landings.png)
    and a report to open in a browser (report.html). Every cast is kept in the folder casts when it
    is done, so an evaluation that was stopped goes on when it is started again. Needs a trained
    model: see `cablecast train`.
    """

    cable: Annotated[str | None, argument("CABLE", "that of --model, or cable_1")] = None
    """Which cable: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    model: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/model")] = None
    """Folder that `cablecast train` wrote."""
    policy: typing.Literal["model", "polar"] = "model"
    """What chooses the motions: the model, or polar casting, a swing straight out and a slow pull,
    which needs no model."""
    rig: Annotated[str, argument("RIG")] = "virtual"
    """What carries out the casts: virtual (a laboratory in software, whose cable differs from the
    model's), engine (the simulator that the model learned from), or your own robot as
    package.module:factory."""
    repeats: int = 1
    """How many casts at each target; the paper makes 5."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/evaluate-RIG")] = None
    """Where to put the results; with --policy polar by default runs/CABLE/evaluate-polar-RIG."""
    seed: int = 0
    """Chooses all that the virtual rig draws by chance."""
    device: Device = "cpu"
    """Where the simulator runs with --rig engine; other rigs do not need one."""

    def run(self) -> None:
        """Evaluate, write the results, and print the table of errors."""
        from cablecast.cable import load_cable
        from cablecast.cli.run_folder import RunFolder
        from cablecast.evaluation.published import published_rows

        asked = load_cable(self.cable) if self.cable else None
        model, policy, chosen_by = None, None, {}
        if self.policy == "model":
            model, policy = load_policy(self.model, asked)
            chosen_by = {"model_fingerprint": model.fingerprint, "policy": policy.info}
        else:
            policy = polar_policy(self.model, asked)
            chosen_by = {"policy": {"name": "polar casting"} | dataclasses.asdict(policy.cast)}
        settings = {
            "cable": policy.cable.to_dict(),
            **chosen_by,
            "rig": self.rig,
            "repeats": self.repeats,
            "seed": self.seed,
            "device": self.device,
        }
        name = evaluation_folder(self.rig)
        if self.policy != "model":
            name = name.replace("evaluate-", f"evaluate-{self.policy}-", 1)
        out = self.out or cable_folder(policy.cable.name) / name
        run = RunFolder.open(out, "evaluate", settings)
        if run.metrics is None:
            self._cast(run, policy, model)
        print_table(run.metrics or {}, published_rows(policy.cable.name))
        print(f"metrics  {out / 'metrics.json'}\ncasts    {out / TRIALS_FILE}")
        print(f"report   {out / REPORT_FILE}")

    def _cast(self, run: Any, policy: Any, model: "LandingModel | None") -> None:
        from cablecast.datasets.progress import console_progress
        from cablecast.evaluation.evaluate import evaluate_policy
        from cablecast.evaluation.kept_trials import KeptTrials
        from cablecast.evaluation.results import evaluation_metrics, save_trials
        from cablecast.files import write_bytes, write_text
        from cablecast.policies.forward_search import COVERAGE_PCT
        from cablecast.report.landings import landing_map
        from cablecast.report.page import report_page
        from cablecast.report.style import png_bytes
        from cablecast.workspace import load_targets

        rig = make_rig_for(self.rig, model, policy.cable, policy.workspace, self.seed, self.device)
        try:
            run.begin()
            with console_progress(f"Casting on the {self.rig} rig") as progress:
                evaluation = evaluate_policy(
                    policy,
                    rig,
                    load_targets(),
                    policy.cable,
                    policy.config,
                    policy.workspace,
                    repeats=self.repeats,
                    kept=KeptTrials(run.path / CASTS_FOLDER),
                    progress=progress,
                )
        finally:
            rig.close()
        print("Drawing the report", file=sys.stderr)
        metrics = evaluation_metrics(evaluation)
        if model is not None and "params" in model.info["dataset"]["settings"]:
            metrics["error_split"] = self._split(evaluation, policy, model)
        save_trials(evaluation, run.path / TRIALS_FILE)
        coverage = {}
        if model is not None:
            coverage = {
                "simulated_xy": policy.predicted_xy,
                "simulated_radius": COVERAGE_PCT / 100 * policy.cable.length,
            }
        figure = landing_map(evaluation, policy.workspace, **coverage)
        write_bytes(run.path / LANDINGS_FILE, png_bytes(figure))
        info = {} if model is None else model.info
        page = report_page(evaluation, policy.workspace, info, run.config, **coverage)
        write_text(run.path / REPORT_FILE, page)
        run.finish(metrics)

    def _split(self, evaluation: Any, policy: Any, model: "LandingModel") -> dict[str, Any] | None:
        from cablecast.evaluation.split import split_errors

        engine = make_rig_for("engine", model, policy.cable, policy.workspace, 0, self.device)
        try:
            split = split_errors(evaluation, model, engine)
        finally:
            engine.close()
        return None if split is None else split.to_dict()


def load_policy(
    folder: pathlib.Path | None, asked: "Cable | None"
) -> "tuple[LandingModel, ForwardSearchPolicy]":
    """The model of a folder and the search that was prepared with it.

    Args:
        folder: What `cablecast train` wrote; the one by default where None.
        asked: The cable that it must have been trained for, or None.
    """
    from cablecast.models.load import load_model
    from cablecast.policies.forward_search import ForwardSearchPolicy

    folder = find_model(folder, asked)
    model = load_model(folder)
    policy = ForwardSearchPolicy.load(folder, model)
    check_same_cable(asked, policy.cable, folder)
    return model, policy


def polar_policy(folder: pathlib.Path | None, asked: "Cable | None") -> "PolarCastingPolicy":
    """Polar casting with a cable.

    Raises:
        InputError: A model was named, too.
    """
    from cablecast.cable import load_cable
    from cablecast.errors import InputError
    from cablecast.policies.polar_casting import PolarCastingPolicy
    from cablecast.workspace import Workspace

    if folder is not None:
        raise InputError(f"--policy polar takes no model, but --model {folder} was given")
    return PolarCastingPolicy(cable=asked or load_cable(DEFAULT_CABLE), workspace=Workspace())


def make_rig_for(
    spec: str,
    model: "LandingModel | None",
    cable: "Cable",
    workspace: "Workspace",
    seed: int,
    device: str = "cpu",
) -> "Rig":
    """The rig of a command line; "engine" is the simulator exactly as a model knew it.

    Args:
        spec: See `make_rig`.
        model: Says which parameters and resolution its dataset was simulated with; None for the
            defaults.
        cable: The cable in the gripper.
        workspace: Table and arm.
        seed: Seed of everything that the rig draws by chance.
        device: Where the simulator of the rig "engine" runs.
    """
    from cablecast.rigs.base import make_rig

    if spec != "engine" or model is None:
        return make_rig(spec, cable, workspace, seed)
    from cablecast.cable import CableParams
    from cablecast.engines.warp_ import EngineWarp
    from cablecast.errors import InputError
    from cablecast.motion.servo import ServoModel
    from cablecast.rigs.engine import RigEngine

    settings = model.info["dataset"]["settings"]
    if "params" not in settings:
        raise InputError("the model has seen no simulated cast: its simulator is unknown")
    engine = EngineWarp(
        segment_count=settings["engine"]["segment_count"],
        dt=settings["engine"]["dt"],
        device=device,
    )
    stored = settings.get("servo")
    return RigEngine(
        engine,
        cable,
        workspace,
        CableParams(**settings["params"]),
        servo=None if stored is None else ServoModel.from_dict(stored),
    )


def print_table(metrics: dict[str, Any], published: Any) -> None:
    """Print our errors beside the paper's.

    Args:
        metrics: What metrics.json holds.
        published: Rows of the paper's tables for the same cable.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(title="Distance from target to landing, in % of cable length", box=box.SIMPLE)
    if published:
        table.caption = "The paper's rows are casts of a real UR5."
    table.add_column("", no_wrap=True)
    for name in ("casts", "median", "q1", "q3", "min", "max"):
        table.add_column(name, justify="right", no_wrap=True)
    rig = metrics["rig"].get("rig", "own")
    names = ("median_pct", "first_quartile_pct", "third_quartile_pct", "min_pct", "max_pct")
    for label, key, style in (
        (f"{rig} rig", "errors_pct", "bold"),
        (f"{rig} rig, in coverage", "errors_inside_coverage_pct", ""),
    ):
        values = metrics[key]
        cells = ("-" if values[name] is None else f"{values[name]:.1f}" for name in names)
        table.add_row(label, str(values["count"]), *cells, style=style)
    table.add_section()
    for row in published:
        cells = (f"{getattr(row, name):.0f}" for name in names)
        # Short, so that the table fits into 80 columns.
        method = row.method.replace("forward model", "model")
        table.add_row(f"paper: {method}", "", *cells, style="dim")
    console = Console()
    console.print(table)
    statuses = ", ".join(f"{count} {code}" for code, count in metrics["status_counts"].items())
    console.print(
        f"{metrics['trial_count']} casts at {metrics['target_count']} targets: {statuses}. "
        f"{metrics['targets_inside_coverage']} targets lie inside the coverage.",
        highlight=False,
        soft_wrap=True,
    )
