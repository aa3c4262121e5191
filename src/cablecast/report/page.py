"""The report: one HTML file that shows what was asked, what happened, and with which settings."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

import cablecast
from cablecast.evaluation.evaluate import Evaluation
from cablecast.evaluation.metrics import ErrorSummary, summarise_errors
from cablecast.evaluation.published import PublishedRow, published_rows
from cablecast.evaluation.results import trial_rows
from cablecast.report.casts import cast_frames, chosen_casts
from cablecast.report.curves import error_boxes, learning_curve, target_errors
from cablecast.report.landings import landing_map
from cablecast.report.style import svg_uri
from cablecast.report.template import template_environment
from cablecast.report.text import five_cells, flatten_settings, pct, published_cells
from cablecast.track import TrialStatus
from cablecast.workspace import Workspace

if TYPE_CHECKING:
    from numpy.typing import NDArray

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
