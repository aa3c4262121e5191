"""The report of an evaluation: one HTML file with its casts, errors and settings."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast
from cablecast.cast import TrialStatus
from cablecast.evaluation.evaluate import ErrorSummary, Evaluation, summarise_errors, trial_rows
from cablecast.evaluation.published import PublishedRow, published_rows
from cablecast.report.curves import error_boxes, learning_curves, target_errors
from cablecast.report.maps import cast_frames, chosen_casts, landing_map
from cablecast.report.style import svg_uri
from cablecast.report.tables import (
    FIVE_HEADS,
    Row,
    Table,
    five_cells,
    flatten_settings,
    paper_rows,
    pct,
)
from cablecast.report.tries import REGION_SHARE
from cablecast.report.words import place_text
from cablecast.workspace import load_targets

SettingsLists = list[tuple[str, list[tuple[str, str]]]]
"""Titles and lines of the settings at the end of a page."""

_RIG_NAMES = {"virtual": "virtual rig", "engine": "simulator itself"}


def render_template(name: str, **values: Any) -> str:
    """Return a page of this package; all text is escaped, and a missing name is an error."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("cablecast", "report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    return environment.get_template(name).render(version=cablecast.__version__, **values)


def run_settings(config: Mapping[str, Any]) -> SettingsLists:
    """Return the versions and the circumstances of a run from its config.json."""
    facts = {name: config[name] for name in ("commit", "started", "cpu_count") if name in config}
    facts["commit"] = facts.get("commit") or "not in a git repository"
    return [("Versions", flatten_settings(config["versions"])), ("Run", flatten_settings(facts))]


def report_page(
    evaluation: Evaluation,
    model_info: Mapping[str, Any],
    config: Mapping[str, Any],
    *,
    simulated_xy: NDArray[np.float64] | None = None,
) -> str:
    """Return the whole page, figures inside; it refers to no other file and no other host.

    Simulated landings are those of `landing_map`. The model has `curve`, `metrics` and `dataset`,
    and is empty without one.
    """
    model = model_info.get("metrics", {})
    kind, rig_name = rig_names(evaluation, config)
    published = paper_figures(evaluation)
    ours = [
        (f"{rig_name}, all targets", evaluation.summary),
        (f"{rig_name}, targets in coverage", evaluation.summary_inside_coverage),
    ]
    figures = {
        "errors": svg_uri(error_boxes(ours, published)),
        "landings": svg_uri(landing_map(evaluation, simulated_xy)),
        "targets": svg_uri(target_errors(evaluation)),
        **shared_figures(evaluation, model_info),
    }
    dataset_settings = model_info.get("dataset", {}).get("settings", {})
    return render_template(
        "report.html",
        cable=evaluation.cable,
        rig_name=rig_name,
        rig_kind=kind,
        summary=evaluation.summary,
        inside_count=int(np.sum(evaluation.inside_coverage)),
        target_count=len(evaluation.target_xy),
        trial_count=len(evaluation.casts),
        statuses=[(s, count) for s, count in evaluation.status_counts.items() if count],
        ok_count=evaluation.status_counts[TrialStatus.OK],
        published=bool(published),
        known_cable=bool(published_rows(evaluation.cable.name)),
        errors=error_table(evaluation, rig_name, published),
        parts=_part_table(evaluation),
        model=model,
        learned_from=_sources(model),
        figures=figures,
        # Further casts at a target repeat the first one.
        player=player_data(evaluation.rows(np.flatnonzero(evaluation.repeat == 0))),
        trials=trial_rows(evaluation),
        settings=[
            ("Evaluation", flatten_settings(config["settings"])),
            ("Rig", flatten_settings(evaluation.rig)),
            ("Dataset that the model was trained on", flatten_settings(dataset_settings)),
            *run_settings(config),
        ],
        pct=pct,
    )


def shared_figures(evaluation: Evaluation, model_info: Mapping[str, Any]) -> dict[str, str]:
    """Return the figures of casts and of the model's training, each where there is something."""
    figures = {}
    if chosen := chosen_casts(evaluation):
        figures["casts"] = svg_uri(cast_frames(evaluation, chosen))
    if len(curve := model_info.get("curve", [])) > 1:
        figures["learning"] = svg_uri(learning_curves([("", curve)], evaluation.cable.length))
    return figures


def rig_names(evaluation: Evaluation, config: Mapping[str, Any]) -> tuple[str, str]:
    """Return the kind of the rig, empty for one of another's, and its name for a reader."""
    kind = evaluation.rig.get("rig", "")
    rig = kind or config["settings"].get("rig")
    return kind, _RIG_NAMES.get(rig, rig) if isinstance(rig, str) else "rig"


def paper_figures(evaluation: Evaluation) -> Sequence[PublishedRow]:
    """Return the paper's errors of the cable; none for other targets than its own."""
    is_paper = np.array_equal(evaluation.target_xy, load_targets())
    return published_rows(evaluation.cable.name) if is_paper else ()


def _sources(model: Mapping[str, Any]) -> str:
    """Return how many casts of which kind a model was trained on."""
    simulated = model.get("training_count", 0) + model.get("held_out_count", 0)
    counts = {"simulated casts": simulated, "casts on a rig": model.get("real_used_count", 0)}
    return " and ".join(f"{count:,} {kind}" for kind, count in counts.items() if count)


def _summary_row(name: str, summary: ErrorSummary, kind: str = "") -> Row:
    return Row((name, str(summary.count), *five_cells(summary.to_dict())), kind)


def error_table(
    evaluation: Evaluation, rig_name: str, published: Sequence[PublishedRow] = ()
) -> Table:
    """Return the errors of an evaluation above those of the paper."""
    inside = f"the {np.sum(evaluation.inside_coverage)} targets inside the simulated coverage"
    lost = len(evaluation.casts) - evaluation.status_counts[TrialStatus.OK]
    rows = [
        _summary_row(f"{rig_name}: all targets", evaluation.summary, "ours"),
        _summary_row(f"{rig_name}: {inside}", evaluation.summary_inside_coverage),
    ]
    if lost:
        missed = f"all targets, {lost} casts without a landing counted as misses"
        rows.append(_summary_row(f"{rig_name}: {missed}", evaluation.summary_misses_counted))
    return Table(title="", heads=("", "casts", *FIVE_HEADS), rows=(*rows, *paper_rows(published)))


def _part_table(evaluation: Evaluation) -> Table:
    planned = summarise_errors(evaluation.planned_errors_pct)
    missed = summarise_errors(evaluation.prediction_errors_pct)
    rows = (
        _summary_row("from target to planned landing", planned),
        _summary_row("from planned to actual landing", missed),
        _summary_row("from target to actual landing", evaluation.summary),
    )
    heads = ("distance [% of cable length]", "casts", *FIVE_HEADS)
    return Table(title="", heads=heads, rows=rows)


def player_data(evaluation: Evaluation) -> dict[str, Any]:
    """Return every cast for the player, lengths in whole millimetres.

    A cast whose rig does not see the cable's shape has the grip and the free end alone.
    """
    casts = []
    for row, cast in enumerate(evaluation.casts):
        track, proposal = cast.track, cast.proposal
        nodes = track.nodes
        if nodes is None:
            path = evaluation.motions[row].grip_path
            grip = path.evaluate(np.minimum(track.times, float(path.duration[0])))[0, :, :2]
            nodes = np.stack([grip, track.endpoint_xy], axis=1)
        shapes = np.round(1000.0 * nodes[..., :2])
        finite = np.isfinite(shapes).all(axis=(1, 2))
        name = f"target {evaluation.target_index[row]}"
        if proposal is not None:
            name = f"{place_text(proposal.goal.value)}, try {proposal.try_number}"
        result = f"{evaluation.errors_pct[row]:.1f} % off"
        result = result if cast.landed else cast.status.words
        one: dict[str, Any] = {
            "label": f"{name}: {'hit, ' * cast.hit}{result}",
            "target_mm": _millimetres(evaluation.aimed_xy[row]),
            "is_seen": track.nodes is not None,
            "times": [round(float(time), 3) for time in track.times[finite]],
            "nodes_mm": [shape.ravel().astype(int).tolist() for shape in shapes[finite]],
        }
        if proposal is not None:
            outline = proposal.expected.ellipse(REGION_SHARE).outline()
            one["region_mm"] = np.round(1000.0 * outline).astype(int).ravel().tolist()
            one["within_mm"] = round(10.0 * proposal.goal.within_pct * evaluation.cable.length)
        if finite.any():
            casts.append(one)
    table = evaluation.setup.workspace
    corners = [(-table.half_width, table.y_min), (table.half_width, table.y_max)]
    return {"table_mm": [_millimetres(corner) for corner in corners], "casts": casts}


def _millimetres(xy: Iterable[float]) -> list[int]:
    return [round(1000.0 * float(value)) for value in xy]
