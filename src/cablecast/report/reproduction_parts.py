"""The sections of a reproduction's report: what each experiment found, beside the paper."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable
from cablecast.evaluation.metrics import ErrorSummary
from cablecast.evaluation.published import PUBLISHED_ROWS, published_rows
from cablecast.report.coverage import coverage_figure
from cablecast.report.curves import error_boxes
from cablecast.report.ellipses import ellipse_map
from cablecast.report.reproduction import (
    BEST_METHOD,
    METHOD_NAMES,
    Figure,
    Part,
    Reproduction,
)
from cablecast.report.style import svg_uri
from cablecast.report.tables import (
    Table,
    cable_table,
    coverage_table,
    measured_table,
    method_table,
    split_table,
    tuning_table,
)
from cablecast.workspace import Workspace

DRAW_COUNT = 2000
"""How often the targets are drawn anew to see whether the order of two methods is chance."""


def all_parts(results: Reproduction, workspace: Workspace) -> list[Part]:
    """Every section whose stages have been run, in the order of the paper."""
    makers = (tuning_part, selection_part, model_part, method_part, cable_part, split_part)
    parts = (maker(results, workspace) for maker in makers)
    return [part for part in parts if part is not None]


def tuning_part(results: Reproduction, workspace: Workspace) -> Part | None:
    """Section V-D: how far the simulator was from the rig before and after tuning."""
    tunings = results.tunings()
    if not tunings:
        return None
    lead = results.cables[0]
    return Part(
        title="Tuning the simulator (table I)",
        paragraphs=[
            "Differential Evolution looked for the ten parameters with which simulated endpoints "
            "stay nearest to measured ones, on some casts of the rig; the distances are those "
            "of other casts, which it never saw. The default row is what was believed of the cable "
            "before anything was measured; the paper's is PyBullet's default.",
        ],
        tables=[tuning_table(tunings)],
        figures=results.picture(
            lead, "tune", "tracks.png", f"Measured and simulated tracks of {lead}, validation casts"
        ),
    )


def selection_part(results: Reproduction, workspace: Workspace) -> Part | None:
    """Section V-E: coverage and repeatability, and what was chosen."""
    selection = results.metrics(results.cables[0], "select")
    if selection is None:
        return None
    config = results.config(results.cables[0], "select") or {}
    cable = Cable.from_dict(config["settings"]["cable"])
    polar = np.array(selection["polar_casting"]["outline_xy"])
    figure = coverage_figure(selection["coverage"], polar, workspace, cable.length)
    ratio = selection["coverage"][0]["hull_ratio"]
    return Part(
        title="Choosing r0, v_max and psi (figures 6 and 7)",
        paragraphs=[
            *selection["choice"]["reasons"],
            "The paper chose r0 = 0.6 m and v_max = 1.5 m/s with psi.",
        ],
        tables=[coverage_table(selection)],
        figures=[
            Figure(
                uri=svg_uri(figure),
                caption="Where the casts of each combination come to rest: concave hulls of "
                f"ratio {ratio:g} within the half disc of radius "
                f"{selection['half_disc_radius_m']:.2f} m. "
                "Grey: what polar casting reaches. After figure 6 of the paper.",
            ),
            *results.picture(
                results.cables[0],
                "repeat",
                "repeatability.png",
                "Repeated landings with 95 % ellipses. After figure 7 of the paper.",
            ),
        ],
    )


def model_part(results: Reproduction, workspace: Workspace) -> Part | None:
    """Section V-F: what was learned from which data."""
    figures: list[Figure] = []
    told = []
    for cable in results.cables:
        metrics = results.metrics(cable, f"model-{BEST_METHOD}")
        if metrics is None:
            continue
        caption = f"How the model of {cable} learned from simulated casts"
        # Fine-tuning begins with the same curve; it was done on the first cable only.
        figures += results.picture(
            cable, "model-fine-tuning", "learning_curve.png", f"{caption}, then from real ones."
        ) or results.picture(cable, f"model-{BEST_METHOD}", "learning_curve.png", f"{caption}.")
        told.append(
            f"{cable}: on simulated casts that it had not seen the median error is "
            f"{metrics['held_out_median_pct']:.1f} % of the cable's length; on casts of the rig "
            f"{metrics['real_before_median_pct']:.1f} % before it learned from any of them, and "
            f"{metrics['real_median_pct']:.1f} % after, each cast predicted by a model that had "
            "learned from the others."
        )
    if not told:
        return None
    return Part(
        title="Learning where casts land",
        paragraphs=[
            "A network first learns from casts that were simulated with the tuned parameters. What "
            "the rig does otherwise is then learned from its own casts in two ways: the network "
            "goes on training with them, as in the paper, or it stays as it is and a correction is "
            "added that also knows how far it can be trusted.",
            *told,
        ],
        figures=figures,
    )


def method_part(results: Reproduction, workspace: Workspace) -> Part | None:
    """Section VI: every method on the first cable."""
    cable = results.cables[0]
    evaluations = results.evaluations(cable)
    if not evaluations:
        return None
    ours = [(f"ours: {METHOD_NAMES[m]}", summary(v["errors_pct"])) for m, v in evaluations.items()]
    published = [row for row in PUBLISHED_ROWS if row.table == "II"]
    return Part(
        title="Every method on one cable (table II)",
        paragraphs=[
            "Distances from target to landing in % of cable length. As in the paper, casts that "
            "left the table or were hidden are left out of the first table; the second counts each "
            "as a miss.",
            *order_of_methods(results),
        ],
        tables=[
            method_table(evaluations, METHOD_NAMES, "errors_pct", f"Errors on {cable}"),
            method_table(
                evaluations,
                METHOD_NAMES,
                "errors_misses_counted_pct",
                f"Errors on {cable}, casts without a landing counted as misses",
                published=False,
            ),
            measured_table(evaluations, METHOD_NAMES, cable),
        ],
        figures=[
            Figure(
                uri=svg_uri(error_boxes(ours, published)),
                caption="The same errors as boxes, above those of the paper.",
            )
        ],
    )


def cable_part(results: Reproduction, workspace: Workspace) -> Part | None:
    """Section VI: the best method on every cable."""
    evaluations = results.best_evaluations()
    if not evaluations:
        return None
    figures = []
    for cable, metrics in evaluations.items():
        figure = ellipse_map(
            results.trials(cable, BEST_METHOD), workspace, metrics["cable_length_m"]
        )
        figures.append(
            Figure(
                uri=svg_uri(figure),
                caption=f"{cable}: targets (numbers), landings (dots), 95 % ellipses of equal "
                "casts as the paper draws them, where there are enough, and dashed lines from each "
                "target to the mean of its landings. A triangle marks a target with a cast that "
                "did not land. After figure 8 of the paper.",
            )
        )
    return Part(
        title="The best method on every cable (table III)",
        tables=[
            cable_table(evaluations, "errors_pct", f"Errors of the {METHOD_NAMES[BEST_METHOD]}"),
            cable_table(
                evaluations,
                "errors_misses_counted_pct",
                "The same, casts without a landing counted as misses",
                published=False,
            ),
        ],
        figures=figures,
    )


def split_part(results: Reproduction, workspace: Workspace) -> Part | None:
    """Where the errors come from: of the best method on every cable, and of each on the first."""
    lead = results.cables[0]
    best = {
        f"{METHOD_NAMES[BEST_METHOD]}, {cable}": metrics
        for cable, metrics in results.best_evaluations().items()
    }
    others = {
        f"{METHOD_NAMES[method]}, {lead}": metrics
        for method, metrics in results.evaluations(lead).items()
        if method != BEST_METHOD
    }
    tables: list[Table] = []
    for evaluations, title in (
        (best, "Errors of the best method, split"),
        (others, f"Errors of the other methods on {lead}, split"),
    ):
        if (table := split_table(evaluations, title)) is not None:
            tables.append(table)
    if not tables:
        return None
    return Part(
        title="Where the errors come from",
        paragraphs=[
            "Each planned cast was also played in the tuned simulator and asked of the network "
            "alone. The way from a target to a landing is so cut into steps, each with a cause of "
            "its own: what the plan leaves, what the correction adds, how the network differs from "
            "the simulator it learned from (fine-tuning makes it differ on purpose), how the "
            "simulator differs from the rig, and how far equal casts land from each other.",
        ],
        tables=tables,
    )


def order_of_methods(results: Reproduction) -> list[str]:
    """Sentences on where our order of methods differs from the paper's, each with its measure."""
    cable = results.cables[0]
    evaluations = results.evaluations(cable)
    paper = {row.method: row.median_pct for row in published_rows(cable)}
    medians = {
        method: metrics["errors_pct"]["median_pct"]
        for method, metrics in evaluations.items()
        if metrics["errors_pct"]["median_pct"] is not None and METHOD_NAMES[method] in paper
    }
    if len(medians) < 2:
        return []
    ours = sorted(medians, key=lambda method: medians[method])
    theirs = sorted(medians, key=lambda method: paper[METHOD_NAMES[method]])
    listed = ", ".join(f"{METHOD_NAMES[method]} ({medians[method]:.1f} %)" for method in ours)
    sentences = [f"By their medians, from best to worst: {listed}."]
    turned = {
        better: [
            worse
            for worse in ours[place + 1 :]
            if theirs.index(better) > theirs.index(worse)
            # The paper prints whole percents; two methods with the same one have no order there.
            and paper[METHOD_NAMES[better]] != paper[METHOD_NAMES[worse]]
        ]
        for place, better in enumerate(ours)
    }
    turned = {better: worse for better, worse in turned.items() if worse}
    if not turned:
        return [*sentences, "This is the paper's order."]
    return sentences + [
        f"Other than in the paper, {_with_median(results, better, paper)} is better than "
        + " and than ".join(_with_median(results, method, paper) for method in worse)
        + f". {_why(results, better, worse)}"
        for better, worse in turned.items()
    ]


def _with_median(results: Reproduction, method: str, paper: Mapping[str, float]) -> str:
    name = METHOD_NAMES[method]
    ours = results.evaluations(results.cables[0])[method]["errors_pct"]["median_pct"]
    return f"{name} ({ours:.1f} %, there {paper[name]:.0f} %)"


def _why(results: Reproduction, better: str, worse: Sequence[str]) -> str:
    """What was measured of some methods that tells where their difference comes from."""
    cable = results.cables[0]
    evaluations = results.evaluations(cable)
    told = []
    for method in (better, *worse):
        metrics = evaluations[method]
        parts = [f"{metrics['targets_inside_coverage']} targets in its coverage"]
        prediction = metrics["prediction_errors_pct"]["median_pct"]
        if prediction is not None:
            parts.append(f"casts {prediction:.1f} % from where it expects them")
        told.append(f"{METHOD_NAMES[method]} has " + ", ".join(parts))
    errors = _errors_by_target(results, cable, better)
    shares = " and ".join(
        f"{100 * share_of_draws(errors, _errors_by_target(results, cable, method)):.0f} % against "
        f"{METHOD_NAMES[method]}"
        for method in worse
    )
    return (
        "Measured: " + "; ".join(told) + f". With the targets drawn anew {DRAW_COUNT:,} times, "
        f"{METHOD_NAMES[better]} has the smaller median in {shares}; half would be chance."
    )


def _errors_by_target(results: Reproduction, cable: str, method: str) -> NDArray[np.float64]:
    """Errors [% of cable length], NaN without a landing, shape [target, cast]."""
    trials = results.trials(cable, method)
    targets = np.unique(trials["target"])
    return np.stack([trials["error_pct"][trials["target"] == target] for target in targets])


def share_of_draws(better: NDArray[np.float64], worse: NDArray[np.float64]) -> float:
    """How often one method has the smaller median error when the targets are drawn anew.

    Casts at one target err alike, so that whole targets are drawn, with replacement.

    Args:
        better: Errors, NaN without a landing, shape [target, cast].
        worse: Those of the other method at the same targets, same shape.

    Returns:
        Share of `DRAW_COUNT` draws; a draw without a landing counts for neither.
    """
    draws = np.random.default_rng(0).integers(len(better), size=(DRAW_COUNT, len(better)))
    medians = [
        np.nanmedian(errors[draws].reshape(DRAW_COUNT, -1), axis=1) for errors in (better, worse)
    ]
    return float(np.mean(medians[0] < medians[1]))


def summary(values: Mapping[str, Any]) -> ErrorSummary:
    """A summary of errors from what metrics.json holds."""
    numbers = {name: np.nan if value is None else float(value) for name, value in values.items()}
    return ErrorSummary(**(numbers | {"count": values["count"]}))  # pyright: ignore[reportArgumentType]
