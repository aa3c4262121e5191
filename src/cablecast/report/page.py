"""The report: one HTML file that shows what was asked, what happened, and with which settings."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

import cablecast
from cablecast.evaluation.evaluate import Evaluation
from cablecast.evaluation.metrics import ErrorSummary, summarise_errors
from cablecast.evaluation.published import published_rows
from cablecast.evaluation.results import trial_rows
from cablecast.report.casts import cast_frames, chosen_casts
from cablecast.report.curves import error_boxes, learning_curve, target_errors
from cablecast.report.landings import landing_map
from cablecast.report.style import svg_uri
from cablecast.report.template import template_environment
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
) -> str:
    """The whole page, figures inside; it refers to no other file and no other host.

    Args:
        evaluation: The casts.
        workspace: Table and reach.
        model_info: What the model says of itself: `curve`, `metrics`, `dataset`.
        config: The run's config.json.
        simulated_xy: See `landing_map`.
        simulated_radius: See `landing_map`.
    """
    environment = template_environment()
    chosen = chosen_casts(evaluation)
    published = published_rows(evaluation.cable.name)
    rig_name = _RIG_NAMES.get(evaluation.rig.get("rig", ""), config["settings"].get("rig", "rig"))
    inside = int(np.sum(evaluation.inside_coverage))
    ours = [
        (f"{rig_name}, all targets", evaluation.summary),
        (f"{rig_name}, targets in coverage", evaluation.summary_inside_coverage),
    ]
    figures = {
        "errors": svg_uri(error_boxes(ours, published)),
        "landings": svg_uri(
            landing_map(
                evaluation,
                workspace,
                simulated_xy=simulated_xy,
                simulated_radius=simulated_radius,
            )
        ),
        "targets": svg_uri(target_errors(evaluation)),
        "casts": svg_uri(cast_frames(evaluation, workspace, chosen)) if chosen else "",
    }
    if curve := model_info.get("curve"):
        figures["learning"] = svg_uri(learning_curve(curve, evaluation.cable.length))
    return environment.get_template("report.html").render(
        version=cablecast.__version__,
        cable=evaluation.cable,
        rig_name=rig_name,
        rig_kind=evaluation.rig.get("rig", ""),
        summary=evaluation.summary,
        inside_count=inside,
        target_count=len(evaluation.target_xy),
        trial_count=len(evaluation.trials),
        statuses=[(status, count) for status, count in evaluation.status_counts.items() if count],
        ok_count=evaluation.status_counts[TrialStatus.OK],
        our_rows=[
            (f"{rig_name}: all targets", evaluation.summary),
            (
                f"{rig_name}: the {inside} targets inside the simulated coverage",
                evaluation.summary_inside_coverage,
            ),
            (
                f"{rig_name}: all targets, casts without a landing counted as misses",
                evaluation.summary_misses_counted,
            ),
        ],
        published=published,
        parts=[
            ("from target to planned landing", summarise_errors(evaluation.planned_errors_pct)),
            ("from planned to actual landing", summarise_errors(evaluation.prediction_errors_pct)),
            ("from target to actual landing", evaluation.summary),
        ],
        model=model_info.get("metrics", {}),
        figures=figures,
        player=_player_data(evaluation, workspace),
        trials=trial_rows(evaluation),
        settings=flatten_settings(config["settings"]),
        dataset_settings=flatten_settings(model_info.get("dataset", {}).get("settings", {})),
        rig_settings=flatten_settings(evaluation.rig),
        config=config,
        pct=_pct,
        summary_cells=_summary_cells,
    )


def _pct(value: float | None) -> str:
    """A percentage with one decimal, a dash where there is none, "miss" where it is infinite."""
    if value is None or math.isnan(value):
        return "–"
    return "miss" if math.isinf(value) else f"{value:.1f}"


def _summary_cells(summary: ErrorSummary) -> list[str]:
    return [
        _pct(summary.median_pct),
        _pct(summary.first_quartile_pct),
        _pct(summary.third_quartile_pct),
        _pct(summary.min_pct),
        _pct(summary.max_pct),
    ]


def flatten_settings(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested settings as lines of a table: dotted names and readable values."""
    lines: list[tuple[str, str]] = []
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            lines += flatten_settings(value, f"{name}.")
        elif isinstance(value, Sequence) and not isinstance(value, str):
            lines.append((name, ", ".join(_plain(item) for item in value)))
        else:
            lines.append((name, _plain(value)))
    return lines


def _plain(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _player_data(evaluation: Evaluation, workspace: Workspace) -> dict[str, Any]:
    """What the page needs to play the first cast at each target, lengths in whole millimetres.

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
                "error": _pct(error_pct),
                "status": trial.status.code.replace("_", " "),
                "times": [round(float(time), 3) for time in trial.track.times[finite]],
                "nodes_mm": shapes[finite].reshape(int(finite.sum()), -1).astype(int).tolist(),
            }
        )
    return {
        "table_mm": [1000 * workspace.table_width, 1000 * workspace.table_depth],
        "casts": casts,
    }


def _millimetres(xy: "NDArray[np.float64]") -> list[int]:
    return [round(1000.0 * float(value)) for value in xy]
