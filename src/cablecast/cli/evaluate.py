"""`cablecast evaluate`: cast at targets and report the errors."""

import dataclasses
import pathlib
import typing
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Annotated, Any

from cablecast.cli.options import Device, Method, TargetOptions, TimeLimit, argument, paper_targets

if TYPE_CHECKING:
    from cablecast.learning.policy import Policy
    from cablecast.rigs.checked import CheckedRig


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evaluate(TargetOptions):
    """Cast at the paper's 32 targets, or at yours, and measure the distance from target to landing.

    Writes metrics.json, a table of every cast (trials.csv), a map of the landings (landings.png)
    and a report to open in a browser (report.html). One cast at each target takes about half a
    minute on the virtual rig and ten minutes on a robot. Each cast is stored when it is done; the
    same command resumes an interrupted evaluation. Needs a trained model: see `cablecast train`.
    """

    setup: Annotated[pathlib.Path | None, argument("FILE", "that of --model")] = None
    """Lab file that the model must have been trained for; with --policy polar, of the casts."""
    cable: Annotated[str | None, argument("CABLE", "that of --model, or cable_1")] = None
    """Cable in the gripper: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    model: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/model")] = None
    """Folder that `cablecast train` wrote."""
    policy: typing.Literal["model", "polar"] = "model"
    """Policy that plans the motions: the model, or polar casting (a swing straight out and a slow
    pull), which needs no model."""
    method: Method = "refined"
    rig: Annotated[
        str,
        argument(
            "RIG",
            text="Rig that makes the casts, as of aim; engine is the simulator of the model's "
            "training casts, and engine:warp, engine:mujoco or engine:pybullet another one with "
            "the same cable.",
        ),
    ] = "virtual"
    repeats: int = 1
    """Casts at each target; the paper makes 5."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/evaluate-RIG")] = None
    """Folder of the results; by default runs/CABLE/evaluate-polar-RIG with --policy polar, and
    runs/CABLE/evaluate-paper-RIG with --method paper."""
    seed: int = 0
    """Seed of the virtual rig."""
    device: Device = "cpu"
    """Device of the simulator, which separates the causes of the errors, too."""
    time_limit: TimeLimit = 120.0

    def run(self) -> None:
        """Evaluate, write the results, and print the table of errors."""
        from cablecast.cli.options import picked
        from cablecast.cli.progress import console_progress
        from cablecast.evaluation.published import published_rows
        from cablecast.pipeline.evaluate import (
            REPORT_FILE,
            TRIALS_FILE,
            check_evaluate,
            evaluate,
        )
        from cablecast.runs.places import cable_folder, rig_folder

        policy = self._policy()
        cable = policy.setup.cable
        verb = "evaluate" if self.policy == "model" else f"evaluate-{self.policy}"
        verb += "-paper" * (self.method == "paper")
        out = self.out or cable_folder(cable.name) / rig_folder(verb, self.rig)
        own = self.targets(policy.setup)
        if not len(own):
            paper_targets(policy.setup)
        targets = own if len(own) else None
        check_evaluate(policy, repeats=self.repeats, device=self.device, out=out)
        with self._rig(policy, out) as rig, console_progress() as progress:
            options = picked(self, "repeats", "method", "device")
            evaluation = evaluate(policy, rig, targets, **options, out=out, progress=progress)
        # The paper's errors are those of its own targets.
        print_table(evaluation.metrics, () if len(own) else published_rows(cable.name))
        print(f"metrics  {out / 'metrics.json'}\ncasts    {out / TRIALS_FILE}")
        print(f"report   {out / REPORT_FILE}")

    def _policy(self) -> "Policy":
        from cablecast.cli.options import load_lab, load_policy
        from cablecast.errors import InputError
        from cablecast.learning.policy import PolarCastingPolicy

        if self.policy == "polar":
            if self.model is not None:
                raise InputError(
                    f"--policy polar takes no model, but --model {self.model} is given"
                )
            if self.method != "refined":
                raise InputError(
                    f"--policy polar searches nothing, but --method {self.method} is given"
                )
            return PolarCastingPolicy(setup=load_lab(self.setup, self.cable))
        return load_policy(self.model, self.setup, self.cable)

    def _rig(self, policy: "Policy", out: pathlib.Path) -> "AbstractContextManager[CheckedRig]":
        """Return the rig; "engine" is the simulator of the model's training casts."""
        from cablecast.cli.options import open_rig, with_instruments
        from cablecast.learning.policy import ForwardSearchPolicy
        from cablecast.pipeline.evaluate import engine_rig

        kind, _, name = self.rig.partition(":")
        if kind == "engine" and isinstance(policy, ForwardSearchPolicy):
            return engine_rig(policy.model, self.device, name or None)
        setup = with_instruments(policy.setup, self.setup)
        return open_rig(self.rig, setup, self.seed, out, self.time_limit)


def print_table(metrics: dict[str, Any], published: Any) -> None:
    """Print the errors of metrics.json next to the paper's rows for the same cable."""
    from cablecast.cli import tables
    from cablecast.report.tables import five_cells, published_cells
    from cablecast.report.words import counted

    title = "Distance from target to landing, in % of cable length"
    caption = "The paper's rows are casts of a real UR5." if published else None
    heads = ("", "casts", "median", "q1", "q3", "min", "max")
    table = tables.make_table(title, *heads, caption=caption)
    rig = str(metrics["rig"].get("rig", "own"))
    for label, key, style in (
        (f"{rig} rig", "errors_pct", "bold"),
        (f"{rig} rig, in coverage", "errors_inside_coverage_pct", ""),
    ):
        values = metrics[key]
        table.add_row(label, str(values["count"]), *five_cells(values), style=style)
    table.add_section()
    for row in published:
        # Short, so that the table fits into 80 columns.
        method = row.method.replace("forward model", "model")
        table.add_row(f"paper: {method}", "", *published_cells(row), style="dim")
    statuses = ", ".join(f"{count} {code}" for code, count in metrics["status_counts"].items())
    tables.print_table(
        table,
        f"{counted(metrics['trial_count'], 'cast')} at "
        f"{counted(metrics['target_count'], 'target')}: {statuses}. Inside the coverage: "
        f"{counted(metrics['targets_inside_coverage'], 'target')}.",
    )
