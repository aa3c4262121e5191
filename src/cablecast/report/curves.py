"""Figures of numbers: errors beside the paper's, errors by target, and the learning curve."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cablecast.cast import TrialStatus
from cablecast.evaluation.evaluate import ErrorSummary, Evaluation
from cablecast.evaluation.published import PublishedRow
from cablecast.report.style import (
    BLUE,
    FAINT,
    FIVE_NUMBERS,
    INK,
    MUTED,
    PAGE_WIDTH,
    SKY,
    VERMILLION,
    new_figure,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def error_boxes(
    ours: Sequence[tuple[str, ErrorSummary]], published: Sequence[PublishedRow]
) -> "Figure":
    """Draw our five numbers as boxes above those of the paper.

    Args:
        ours: Labels and summaries; those without errors are left out.
        published: Rows of the paper's tables.
    """
    rows: list[tuple[str, str, tuple[float, ...]]] = []
    for label, summary in ours:
        if summary.count:
            rows.append((label, BLUE, _five(summary)))
    rows += [(f"paper, real UR5: {row.method}", MUTED, _five(row)) for row in published]
    figure = new_figure(PAGE_WIDTH, 0.34 * len(rows) + 0.75)
    with styled():
        axes = figure.add_subplot()
        for place, (_, color, (median, q1, q3, low, high)) in enumerate(rows):
            axes.plot([low, high], [place, place], color=color, linewidth=1.1, zorder=2)
            axes.barh(place, q3 - q1, left=q1, height=0.52, color=color, alpha=0.28, zorder=2)
            axes.plot([median, median], [place - 0.31, place + 0.31], color=color, linewidth=2.6)
            axes.annotate(
                f"median {median:.1f}" if color == BLUE else f"median {median:.0f}",
                (high, place),
                xytext=(6, 0),
                textcoords="offset points",
                va="center",
                color=color if color == BLUE else INK,
                fontweight="bold" if color == BLUE else "normal",
            )
        axes.set_yticks(range(len(rows)), [label for label, _, _ in rows])
        axes.invert_yaxis()
        axes.set_xlim(0.0, None)
        axes.set_xlabel(
            "error [% of cable length]; line from least to greatest, box between the quartiles"
        )
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        axes.grid(axis="x", color=FAINT, linewidth=0.6)
        axes.set_axisbelow(True)
    return figure


def _five(summary: ErrorSummary | PublishedRow) -> tuple[float, ...]:
    return tuple(getattr(summary, name) for name in FIVE_NUMBERS)


def target_errors(evaluation: Evaluation) -> "Figure":
    """Draw the error of every cast by target, and the error that the policy had planned for."""
    figure = new_figure(PAGE_WIDTH, 2.9)
    errors_pct, planned_pct = evaluation.errors_pct, evaluation.planned_errors_pct
    places = np.array([trial.target_index for trial in evaluation.trials])
    lost = np.array([trial.status is not TrialStatus.OK for trial in evaluation.trials])
    with styled():
        axes = figure.add_subplot()
        axes.vlines(places, 0.0, errors_pct, color=SKY, linewidth=3.2, zorder=2)
        axes.plot(places, errors_pct, "o", color=BLUE, markersize=5, zorder=3, label="landed")
        axes.plot(
            places, planned_pct, "_", color=INK, markersize=9, markeredgewidth=1.6, label="planned"
        )
        if np.any(lost):
            axes.plot(
                places[lost],
                np.zeros(int(lost.sum())),
                "^",
                color=VERMILLION,
                markersize=7,
                clip_on=False,
                zorder=4,
                label="no landing",
            )
        median = evaluation.summary.median_pct
        if np.isfinite(median):
            axes.axhline(median, color=BLUE, linewidth=1.0, linestyle=(0, (4, 3)), zorder=1)
            axes.annotate(
                f"median {median:.1f} %",
                (1.0, median),
                xycoords=("axes fraction", "data"),
                xytext=(4, 0),
                textcoords="offset points",
                va="center",
                color=BLUE,
            )
        axes.set_xticks(range(len(evaluation.target_xy)))
        axes.tick_params(axis="x", labelsize=7.5, length=0)
        axes.set_xlim(-0.8, len(evaluation.target_xy) - 0.2)
        axes.set_ylim(0.0, None)
        axes.set_xlabel("target, numbered as on the map")
        axes.set_ylabel("error [% of cable length]")
        axes.grid(axis="y", color=FAINT, linewidth=0.6)
        axes.set_axisbelow(True)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2)
    return figure


def learning_curve(curve: Sequence[Mapping[str, Any]], cable_length: float) -> "Figure":
    """Draw training and held-out loss over the epochs, as mean distances in % of cable length.

    Args:
        curve: Rows with `epoch`, `loss` [m] and `held_out_loss` [m].
        cable_length: Cable length r_c [m].
    """
    return learning_curves([("", curve)], cable_length)


def learning_curves(
    curves: Sequence[tuple[str, Sequence[Mapping[str, Any]]]], cable_length: float
) -> "Figure":
    """Draw several learning curves above each other, as `learning_curve` draws one.

    Args:
        curves: Title and rows of each.
        cable_length: Cable length r_c [m].
    """
    figure = new_figure(PAGE_WIDTH, 2.6 * len(curves))
    with styled():
        for axes, (title, curve) in zip(
            figure.subplots(len(curves), squeeze=False)[:, 0], curves, strict=True
        ):
            axes.set_title(title)
            _draw_learning_curve(axes, curve, cable_length)
    return figure


def _draw_learning_curve(
    axes: "Axes", curve: Sequence[Mapping[str, Any]], cable_length: float
) -> None:
    from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

    epochs = [row["epoch"] for row in curve]
    for key, color, label in (
        ("loss", SKY, "training rows"),
        ("held_out_loss", BLUE, "held-out rows"),
    ):
        losses_pct = [100.0 * row[key] / cable_length for row in curve]
        axes.plot(epochs, losses_pct, color=color, linewidth=1.8)
        axes.annotate(
            f"{label}, {losses_pct[-1]:.2f} %",
            (epochs[-1], losses_pct[-1]),
            xytext=(6, 6 if key == "held_out_loss" else -6),
            textcoords="offset points",
            va="center",
            color=color,
            annotation_clip=False,
        )
    axes.set_yscale("log")
    axes.set_xlabel("epoch")
    axes.set_ylabel("mean distance\n[% of cable length]")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(epochs[0], epochs[-1])
    axes.grid(axis="y", color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
