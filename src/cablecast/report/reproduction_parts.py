"""The sections of a reproduction's report: what each experiment found, beside the paper."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from cablecast.evaluation.metrics import ErrorSummary
from cablecast.evaluation.published import PUBLISHED_ROWS
from cablecast.report.coverage import coverage_figure
from cablecast.report.curves import error_boxes
from cablecast.report.ellipses import ellipse_map
from cablecast.report.method_order import order_of_methods
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


def all_parts(results: Reproduction) -> list[Part]:
    """Return every section whose stages have been run, in the order of the paper."""
    makers = (tuning_part, selection_part, model_part, method_part, cable_part, split_part)
    parts = (maker(results) for maker in makers)
    return [part for part in parts if part is not None]


def tuning_part(results: Reproduction) -> Part | None:
    """Report section V-D: the simulator's distance from the rig before and after tuning."""
    tunings = results.tunings()
    if not tunings:
        return None
    lead = results.cables[0]
    return Part(
        title="Tuning the simulator (table I)",
        paragraphs=[
            "Differential Evolution looked for the ten parameters with which simulated endpoints "
            "stay nearest to measured ones, on some casts of the rig; the distances are those "
            "of other casts, which it never saw. Default parameters are those that were believed "
            "of the cable before anything was measured; the paper's are PyBullet's.",
        ],
        tables=[tuning_table(tunings)],
        figures=results.picture(
            lead, "tune", "tracks.png", f"Measured and simulated tracks of {lead}, validation casts"
        ),
    )


def selection_part(results: Reproduction) -> Part | None:
    """Report section V-E: coverage and repeatability, and what was chosen."""
    selection = results.metrics(results.cables[0], "select")
    if selection is None:
        return None
    setup = results.setup(results.cables[0])
    polar = np.array(selection["polar_casting"]["outline_xy"])
    figure = coverage_figure(selection["coverage"], polar, setup.workspace, setup.cable.length)
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


def model_part(results: Reproduction) -> Part | None:
    """Report section V-F: what was learned from which data."""
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
            "A network first learns from casts that were simulated with the tuned parameters. The "
            "rig's deviation from them is then learned from its own casts in two ways: the network "
            "goes on training with them, as in the paper, or it stays as it is and a correction is "
            "added that also tells its own uncertainty.",
            *told,
        ],
        figures=figures,
    )


def method_part(results: Reproduction) -> Part | None:
    """Report section VI: every method on the first cable."""
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


def cable_part(results: Reproduction) -> Part | None:
    """Report section VI: the best method on every cable."""
    evaluations = results.best_evaluations()
    if not evaluations:
        return None
    figures = []
    for cable, metrics in evaluations.items():
        trials, workspace = results.trials(cable, BEST_METHOD), results.setup(cable).workspace
        figure = ellipse_map(trials, workspace, metrics["cable_length_m"])
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


def split_part(results: Reproduction) -> Part | None:
    """Split the errors into causes: the best method on every cable, the others on the first."""
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
            "Each planned cast was also played in the tuned simulator and predicted by the network "
            "alone. That splits the way from a target to a landing into steps with one cause each: "
            "what the plan leaves, what the correction adds, the difference between the network "
            "and the simulator it learned from (fine-tuning makes them differ on purpose), the "
            "difference between the simulator and the rig, and the scatter of equal casts.",
        ],
        tables=tables,
    )


def summary(values: Mapping[str, Any]) -> ErrorSummary:
    """Return a summary of errors from what metrics.json holds."""
    numbers = {name: np.nan if value is None else float(value) for name, value in values.items()}
    return ErrorSummary(**(numbers | {"count": values["count"]}))  # pyright: ignore[reportArgumentType]
