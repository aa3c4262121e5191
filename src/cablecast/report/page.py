"""Tables for people: the same rows as HTML in the report and as Markdown in a README.

The report: one HTML file that shows what was asked, what happened, and with which settings.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

import cablecast
from cablecast.cast import TrialStatus
from cablecast.evaluation.coverage import PUBLISHED_CANDIDATES
from cablecast.evaluation.evaluate import ErrorSummary, Evaluation, summarise_errors, trial_rows
from cablecast.evaluation.published import PUBLISHED_ROWS, PublishedRow, published_rows
from cablecast.report.curves import error_boxes, learning_curve, target_errors
from cablecast.report.maps import cast_frames, chosen_casts, landing_map
from cablecast.report.style import (
    FIVE_HEADS,
    five_cells,
    flatten_settings,
    pct,
    published_cells,
    svg_uri,
    template_environment,
)
from cablecast.tuning.tune import PUBLISHED_SIMULATION_COUNT, published_tuning
from cablecast.workspace import Workspace

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclasses.dataclass(frozen=True, kw_only=True)
class Row:
    """One row of a table.

    Attributes:
        cells: Text of each cell, the first being the name of the row.
        kind: "ours", "paper", or empty; decides its style.
    """

    cells: tuple[str, ...]
    kind: str = ""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Table:
    """A table with a title.

    Attributes:
        title: Heading.
        heads: Names of the columns.
        rows: Rows below the heads.
        note: Text below the table.
    """

    title: str
    heads: tuple[str, ...]
    rows: tuple[Row, ...]
    note: str = ""

    def to_markdown(self) -> str:
        """Return the table in GitHub's Markdown, with its title and note."""
        lines = [f"**{self.title}**", ""]
        lines.append("| " + " | ".join(self.heads) + " |")
        lines.append("|" + "---|" * len(self.heads))
        for row in self.rows:
            cells = [f"**{cell}**" if row.kind == "ours" and cell else cell for cell in row.cells]
            lines.append("| " + " | ".join(cells) + " |")
        if self.note:
            lines += ["", self.note]
        return "\n".join(lines) + "\n"


def method_table(
    evaluations: Mapping[str, Mapping[str, Any]],
    names: Mapping[str, str],
    key: str,
    title: str,
    *,
    published: bool = True,
) -> Table:
    """Make table II: every method on cable 1, and the paper's rows below.

    Args:
        evaluations: Contents of metrics.json of `cablecast evaluate` by method.
        names: Names of the methods; those of the paper as the paper's rows have them.
        key: Name of the summary of errors, e.g. `errors_pct`.
        title: Heading of the table.
        published: True to show the paper's rows, too; it counts no misses.
    """
    rows = []
    best = min(
        (m for m in evaluations if evaluations[m][key]["median_pct"] is not None),
        key=lambda m: evaluations[m][key]["median_pct"],
        default=None,
    )
    for method, metrics in evaluations.items():
        landed = metrics["status_counts"].get("ok", 0)
        cells = (names.get(method, method), f"{landed} of {metrics['trial_count']}")
        rows.append(
            Row(cells=cells + five_cells(metrics[key]), kind="ours" if method == best else "")
        )
    rows += [
        Row(cells=(f"paper: {row.method}", "", *published_cells(row)), kind="paper")
        for row in PUBLISHED_ROWS
        if published and row.table == "II"
    ]
    return Table(title=title, heads=("method", "landed", *FIVE_HEADS), rows=tuple(rows))


def cable_table(
    evaluations: Mapping[str, Mapping[str, Any]], key: str, title: str, *, published: bool = True
) -> Table:
    """Make table III: the best method on every cable, each with the paper's row.

    Args:
        evaluations: Contents of metrics.json of `cablecast evaluate` by cable.
        key: Name of the summary of errors.
        title: Heading of the table.
        published: True to show the paper's rows, too; it counts no misses.
    """
    rows = []
    for cable, metrics in evaluations.items():
        landed = metrics["status_counts"].get("ok", 0)
        cells = (cable, f"{landed} of {metrics['trial_count']}", *five_cells(metrics[key]))
        rows.append(Row(cells=cells, kind="ours"))
        for row in PUBLISHED_ROWS:
            if published and (row.cable, row.method) == (cable, BEST_METHOD_PUBLISHED):
                cells = (f"paper: {cable}", "", *published_cells(row))
                rows.append(Row(cells=cells, kind="paper"))
    return Table(title=title, heads=("cable", "landed", *FIVE_HEADS), rows=tuple(rows))


BEST_METHOD_PUBLISHED = "forward model, D_sim + D_real"

SPLIT_PARTS = {
    "repeatability": "equal casts land apart",
    "mismatch": "the simulator is not the rig",
    "model": "the model is not the simulator",
    "plan": "no cast is expected to land on the target",
}
"""Cause of each part of an error, in words; see `cablecast.evaluation.evaluate`."""


def measured_table(
    evaluations: Mapping[str, Mapping[str, Any]], names: Mapping[str, str], cable: str
) -> Table:
    """Make a table of measurements that tell where the errors of each method begin.

    Args:
        evaluations: Contents of metrics.json of `cablecast evaluate` by method.
        names: Names of the methods.
        cable: Name of the cable that was cast.
    """
    rows = [
        Row(
            cells=(
                names.get(method, method),
                f"{metrics['targets_inside_coverage']} of {metrics['target_count']}",
                pct(metrics["errors_inside_coverage_pct"]["median_pct"]),
                pct(metrics["prediction_errors_pct"]["median_pct"]),
            )
        )
        for method, metrics in evaluations.items()
    ]
    return Table(
        title=f"Where the errors on {cable} begin",
        heads=("method", "targets in its coverage", "median error there", "from the expected"),
        rows=tuple(rows),
        note="A target is in the coverage of a method that expects one of its casts to land there. "
        "From the expected: median distance between the expected and the actual landing of a "
        "cast, whatever the target. In % of cable length.",
    )


def split_table(evaluations: Mapping[str, Mapping[str, Any]], title: str) -> Table | None:
    """Make a table of errors split into their causes; None where none was split.

    Args:
        evaluations: Contents of metrics.json of `cablecast evaluate` by the name of their row.
        title: Heading of the table.
    """
    splits = {
        name: metrics["error_split"]
        for name, metrics in evaluations.items()
        if metrics.get("error_split")
    }
    if not splits:
        return None
    rows = []
    for name, split in splits.items():
        # A part that was not measured is not there.
        parts = [part for part in SPLIT_PARTS if split["parts"].get(part, {}).get("rms_pct")]
        whole = ("", pct(split["rms_pct"]), "100")
        rows.append(Row(cells=(name, *whole), kind="ours"))
        for part in parts:
            values = split["parts"][part]
            cells = (pct(values["median_pct"]), pct(values["rms_pct"]), pct(values["share_pct"], 0))
            rows.append(Row(cells=(SPLIT_PARTS[part], *cells)))
        outside = split["outside_coverage"]
        count = f"{outside['cast_count']} of {split['cast_count']} casts"
        share = pct(outside["share_pct"], 0)
        rows.append(Row(cells=(f"at targets outside the coverage: {count}", "", "", share)))
    note = (
        "Median and root mean square of the length of each part, in % of cable length, over the "
        "casts that landed; and its share in the mean square of the whole error. The parts are "
        "vectors that add up to the whole: one that pulls others back has a negative share."
    )
    if any(split["repeats"] == 1 for split in splits.values()):
        note += (
            " With one cast at each target, the scatter of equal casts cannot be told from the "
            "simulator's deviation."
        )
    return Table(title=title, heads=("", "median", "rms", "share [%]"), rows=tuple(rows), note=note)


def coverage_table(selection: Mapping[str, Any]) -> Table:
    """Make a table of the coverage of every combination of system parameters, beside the paper's.

    Args:
        selection: Contents of metrics.json of `cablecast select`.
    """
    published = {(c.r0, c.v_max, c.with_psi): c for c in PUBLISHED_CANDIDATES}
    chosen = selection["choice"]
    rows = []
    for result in selection["coverage"]:
        key = (result["r0"], result["v_max"], result["with_psi"])
        paper = published.get(key)
        repeat = result.get("repeatability") or {}
        low, high = sorted(result["share_by_ratio"].values())
        rows.append(
            Row(
                cells=(
                    f"r0 = {key[0]:g} m, v_max = {key[1]:g} m/s" + ", psi" * key[2],
                    str(result["feasible_count"]),
                    pct(100 * result["share"]),
                    f"{100 * low:.1f} to {100 * high:.1f}",
                    pct(100 * paper.coverage) if paper else "",
                    pct(repeat.get("scatter_pct"), 2) if repeat else "",
                    pct(paper.scatter_pct, 2) if paper else "",
                    pct(100 * repeat["off_table_share"]) if repeat else "",
                    pct(100 * paper.off_table_share) if paper and paper.off_table_share else "",
                ),
                kind="ours" if key == tuple(chosen[n] for n in ("r0", "v_max", "with_psi")) else "",
            )
        )
    polar = selection["polar_casting"]["share"]
    rows.append(Row(cells=("polar casting", "", pct(100 * polar), *[""] * 6)))
    ratio = selection["coverage"][0]["hull_ratio"]
    ratios = " and ".join(selection["coverage"][0]["share_by_ratio"])
    return Table(
        title="Coverage in % of the half disc, and repeatability in % of cable length",
        heads=(
            "",
            "casts",
            "coverage",
            f"with hull ratios {ratios}",
            "paper",
            "scatter",
            "paper",
            "off table",
            "paper",
        ),
        rows=tuple(rows),
        note=f"Coverage by concave hulls of ratio {ratio:g}; the paper does not state its own.",
    )


def tuning_table(tunings: Mapping[str, Mapping[str, Any]]) -> Table:
    """Make table I: the simulator's distance from the rig before and after tuning.

    Args:
        tunings: Contents of metrics.json of `cablecast tune` by cable.
    """
    rows = []
    for cable, metrics in tunings.items():
        default, tuned = (metrics["validation"][name] for name in ("default", "tuned"))
        cells = (
            pct(default["final_median_pct"]),
            pct(tuned["final_median_pct"]),
            pct(default["mean_pct"]),
            pct(tuned["mean_pct"]),
            f"{metrics['simulation_count']:,}",
        )
        rows.append(Row(cells=(cable, *cells), kind="ours"))
        if (paper := published_tuning(cable)) is not None:
            cells = (
                pct(paper.default_final_pct),
                pct(paper.tuned_final_pct),
                pct(paper.default_mean_pct),
                pct(paper.tuned_mean_pct),
                f"about {PUBLISHED_SIMULATION_COUNT:,}",
            )
            rows.append(Row(cells=(f"paper: {cable}", *cells), kind="paper"))
    return Table(
        title="Distance between simulated and measured endpoints on validation casts",
        heads=(
            "",
            "at rest, default",
            "at rest, tuned",
            "on the way, default",
            "on the way, tuned",
            "simulations",
        ),
        rows=tuple(rows),
        note="At rest: median of the final distance. On the way: equation 4. In % of cable length.",
    )


def time_table(times: Sequence[tuple[str, float]]) -> Table:
    """Make a table of the time that each stage took.

    Args:
        times: Title and time [s] of each stage.
    """
    rows = [Row(cells=(title, f"{seconds / 60:.1f}")) for title, seconds in times]
    total = sum(seconds for _, seconds in times)
    rows.append(Row(cells=("all", f"{total / 60:.1f}"), kind="ours"))
    return Table(title="Time of each stage", heads=("stage", "min"), rows=tuple(rows))


_RIG_NAMES = {"virtual": "virtual rig", "engine": "simulator itself"}


def report_page(
    evaluation: Evaluation,
    workspace: Workspace,
    model_info: Mapping[str, Any],
    config: Mapping[str, Any],
    *,
    simulated_xy: "NDArray[np.float64] | None" = None,
    simulated_radius: float = 0.0,
    tries: str = "",
) -> str:
    """Return the whole page, figures inside; it refers to no other file and no other host.

    Args:
        evaluation: Casts to report.
        workspace: Table and reach.
        model_info: Description of the model: `curve`, `metrics`, `dataset`; empty without one.
        config: The run's config.json.
        simulated_xy: See `landing_map`.
        simulated_radius: See `landing_map`.
        tries: Map of several tries at each target as a data URI, if there were several.
    """
    model = model_info.get("metrics", {})
    published = published_rows(evaluation.cable.name)
    rig_kind = evaluation.rig.get("rig", "")
    rig_name = _rig_name(rig_kind or config["settings"].get("rig"))
    inside = int(np.sum(evaluation.inside_coverage))
    figures = _figures(evaluation, workspace, rig_name, published, simulated_xy, simulated_radius)
    if tries:
        figures["tries"] = tries
    if curve := model_info.get("curve"):
        figures["learning"] = svg_uri(learning_curve(curve, evaluation.cable.length))
    return (
        template_environment()
        .get_template("report.html")
        .render(
            version=cablecast.__version__,
            cable=evaluation.cable,
            rig_name=rig_name,
            rig_kind=rig_kind,
            summary=evaluation.summary,
            inside_count=inside,
            target_count=len(evaluation.target_xy),
            trial_count=len(evaluation.trials),
            statuses=[(s, count) for s, count in evaluation.status_counts.items() if count],
            ok_count=evaluation.status_counts[TrialStatus.OK],
            our_rows=_our_rows(evaluation, rig_name, inside),
            published=[
                (f"paper, table {row.table}: {row.method}", published_cells(row))
                for row in published
            ],
            parts=_part_rows(evaluation),
            model=model,
            learned_from=_sources(model),
            figures=figures,
            player=_player_data(evaluation, workspace),
            trials=trial_rows(evaluation),
            settings=flatten_settings(config["settings"]),
            dataset_settings=flatten_settings(model_info.get("dataset", {}).get("settings", {})),
            rig_settings=flatten_settings(evaluation.rig),
            config=config,
            pct=pct,
        )
    )


def _rig_name(kind: Any) -> str:
    return _RIG_NAMES.get(kind, kind) if isinstance(kind, str) else "rig"


def _sources(model: Mapping[str, Any]) -> str:
    """Return how many casts of which kind a model learned from."""
    simulated = model.get("training_count", 0) + model.get("held_out_count", 0)
    counts = {"simulated casts": simulated, "casts on a rig": model.get("real_used_count", 0)}
    return " and ".join(f"{count:,} {kind}" for kind, count in counts.items() if count)


def _figures(
    evaluation: Evaluation,
    workspace: Workspace,
    rig_name: str,
    published: tuple[PublishedRow, ...],
    simulated_xy: "NDArray[np.float64] | None",
    simulated_radius: float,
) -> dict[str, str]:
    """Return the figures of the casts as data URIs, by the name that the template calls them."""
    ours = [
        (f"{rig_name}, all targets", evaluation.summary),
        (f"{rig_name}, targets in coverage", evaluation.summary_inside_coverage),
    ]
    landings = landing_map(
        evaluation, workspace, simulated_xy=simulated_xy, simulated_radius=simulated_radius
    )
    chosen = chosen_casts(evaluation)
    return {
        "errors": svg_uri(error_boxes(ours, published)),
        "landings": svg_uri(landings),
        "targets": svg_uri(target_errors(evaluation)),
        "casts": svg_uri(cast_frames(evaluation, workspace, chosen)) if chosen else "",
    }


_Rows = list[tuple[str, int, tuple[str, ...]]]
"""Name, number of casts, and the five numbers of each row."""


def _rows(summaries: Mapping[str, ErrorSummary]) -> _Rows:
    return [(name, row.count, five_cells(row.to_dict())) for name, row in summaries.items()]


def _our_rows(evaluation: Evaluation, rig_name: str, inside: int) -> _Rows:
    return _rows(
        {
            f"{rig_name}: all targets": evaluation.summary,
            f"{rig_name}: the {inside} targets inside the simulated coverage": (
                evaluation.summary_inside_coverage
            ),
            f"{rig_name}: all targets, casts without a landing counted as misses": (
                evaluation.summary_misses_counted
            ),
        }
    )


def _part_rows(evaluation: Evaluation) -> _Rows:
    return _rows(
        {
            "from target to planned landing": summarise_errors(evaluation.planned_errors_pct),
            "from planned to actual landing": summarise_errors(evaluation.prediction_errors_pct),
            "from target to actual landing": evaluation.summary,
        }
    )


def _player_data(evaluation: Evaluation, workspace: Workspace) -> dict[str, Any]:
    """Return the first cast at each target for the player, lengths in whole millimetres.

    Casts whose rig does not see the cable's shape are left out.
    """
    casts = []
    for trial, error_pct in zip(evaluation.trials, evaluation.errors_pct, strict=True):
        nodes = trial.track.nodes
        if trial.repeat or nodes is None:
            continue
        shapes = np.round(1000.0 * nodes[..., :2])
        finite = np.isfinite(shapes).all(axis=(1, 2))
        casts.append(
            {
                "target": trial.target_index,
                "target_mm": _millimetres(trial.target_xy),
                "predicted_mm": _millimetres(trial.predicted_xy),
                "error": pct(error_pct),
                "status": trial.status.code.replace("_", " "),
                "times": [round(float(time), 3) for time in trial.track.times[finite]],
                "nodes_mm": shapes[finite].reshape(int(finite.sum()), -1).astype(int).tolist(),
            }
        )
    corners = np.array(
        [[-workspace.half_width, workspace.y_min], [workspace.half_width, workspace.y_max]]
    )
    return {
        "workspace": workspace.to_dict(),
        "table_mm": [_millimetres(corner) for corner in corners],
        "casts": casts,
    }


def _millimetres(xy: "NDArray[np.float64]") -> list[int]:
    return [round(1000.0 * float(value)) for value in xy]
