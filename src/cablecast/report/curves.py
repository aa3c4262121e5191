"""Figures of numbers: errors next to the paper's, errors by target, and learning curves."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cablecast.cast import TrialStatus
from cablecast.evaluation.evaluate import ErrorSummary, Evaluation
from cablecast.evaluation.published import PublishedRow
from cablecast.report.style import (
    BLUE,
    INK,
    MUTED,
    PAGE_WIDTH,
    SKY,
    VERMILLION,
    annotate,
    draw_grid,
    log_scale,
    new_figure,
    styled,
)
from cablecast.report.tables import FIVE_NUMBERS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled()
def error_boxes(
    ours: Sequence[tuple[str, ErrorSummary]], published: Sequence[PublishedRow]
) -> "Figure":
    """Draw our five numbers as boxes above those of the paper; rows without errors are left out."""
    rows: list[tuple[str, ErrorSummary | PublishedRow]] = [row for row in ours if row[1].count]
    rows += [(f"paper, real UR5: {row.method}", row) for row in published]
    figure = new_figure(PAGE_WIDTH, 0.34 * len(rows) + 0.75)
    axes = figure.add_subplot()
    for place, (_, row) in enumerate(rows):
        is_ours = isinstance(row, ErrorSummary)
        color = BLUE if is_ours else MUTED
        median, q1, q3, low, high = (getattr(row, name) for name in FIVE_NUMBERS)
        axes.plot([low, high], [place, place], color=color, linewidth=1.1, zorder=2)
        axes.barh(place, q3 - q1, left=q1, height=0.52, color=color, alpha=0.28, zorder=2)
        axes.plot([median, median], [place - 0.31, place + 0.31], color=color, linewidth=2.6)
        text = f"median {median:.1f}" if is_ours else f"median {median:.0f}"
        weight = "bold" if is_ours else "normal"
        color = color if is_ours else INK
        annotate(axes, text, (high, place), (6, 0), va="center", color=color, fontweight=weight)
    axes.set_yticks(range(len(rows)), [label for label, _ in rows])
    axes.invert_yaxis()
    axes.set_xlim(0.0, None)
    axes.set_xlabel("error [% of cable length]; line from least to greatest, box between quartiles")
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    draw_grid(axes, "x")
    return figure


@styled()
def target_errors(evaluation: Evaluation) -> "Figure":
    """Draw the error of every cast by target, and the error that the policy had planned for."""
    figure = new_figure(PAGE_WIDTH, 2.9)
    places = evaluation.target_index
    lost = np.array([cast.status is not TrialStatus.OK for cast in evaluation.casts])
    errors_pct, planned_pct = evaluation.errors_pct, evaluation.planned_errors_pct
    axes = figure.add_subplot()
    axes.vlines(places, 0.0, errors_pct, color=SKY, linewidth=3.2, zorder=2)
    axes.plot(places, errors_pct, "o", color=BLUE, markersize=5, zorder=3, label="landed")
    dash: dict[str, Any] = {"color": INK, "markersize": 9, "markeredgewidth": 1.6}
    axes.plot(places, planned_pct, "_", label="planned", **dash)
    if np.any(lost):
        mark: dict[str, Any] = {"color": VERMILLION, "markersize": 7, "clip_on": False}
        axes.plot(places[lost], 0.0 * places[lost], "^", zorder=4, label="no landing", **mark)
    median = evaluation.summary.median_pct
    if np.isfinite(median):
        axes.axhline(median, color=BLUE, linewidth=1.0, linestyle=(0, (4, 3)), zorder=1)
        style = {"xycoords": ("axes fraction", "data"), "va": "center", "color": BLUE}
        annotate(axes, f"median {median:.1f} %", (1.0, median), (4, 0), **style)
    axes.set_xticks(range(len(evaluation.target_xy)))
    axes.tick_params(axis="x", labelsize=7.5, length=0)
    axes.set_xlim(-0.8, len(evaluation.target_xy) - 0.2)
    axes.set_ylim(0.0, None)
    axes.set_xlabel("target, numbered as on the map")
    axes.set_ylabel("error [% of cable length]")
    draw_grid(axes, "y")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2)
    return figure


@styled()
def learning_curves(
    curves: Sequence[tuple[str, Sequence[Mapping[str, Any]]]], cable_length: float
) -> "Figure":
    """Draw training and held-out loss over the epochs, as mean distances in % of cable length.

    Each curve has a title and rows with `epoch`, `loss` [m] and `held_out_loss` [m].
    """
    from matplotlib.ticker import MaxNLocator

    figure = new_figure(PAGE_WIDTH, 2.6 * len(curves))
    panels = figure.subplots(len(curves), squeeze=False)[:, 0]
    for axes, (title, curve) in zip(panels, curves, strict=True):
        axes.set_title(title)
        epochs = [row["epoch"] for row in curve]
        for key, color, label, shift in (
            ("loss", SKY, "training rows", -6),
            ("held_out_loss", BLUE, "held-out rows", 6),
        ):
            losses_pct = [100.0 * row[key] / cable_length for row in curve]
            axes.plot(epochs, losses_pct, color=color, linewidth=1.8)
            text = f"{label}, {losses_pct[-1]:.2f} %"
            style = {"va": "center", "color": color, "annotation_clip": False}
            annotate(axes, text, (epochs[-1], losses_pct[-1]), (6, shift), **style)
        log_scale(axes, "y")
        axes.set_xlabel("epoch")
        axes.set_ylabel("mean distance\n[% of cable length]")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlim(epochs[0], epochs[-1])
        draw_grid(axes, "y")
    return figure
