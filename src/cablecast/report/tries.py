"""The map of tries: how the casts at each target come nearer to it."""

from typing import TYPE_CHECKING

import numpy as np

from cablecast.evaluation.evaluate import Evaluation
from cablecast.report.style import (
    BLUE,
    FAINT,
    INK,
    PAGE_WIDTH,
    VERMILLION,
    draw_workspace,
    frame_workspace,
    new_figure,
    panel_height,
    styled,
)
from cablecast.track import TrialStatus
from cablecast.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MARGIN = 0.05
_CURVES_HEIGHT = 2.6


def tries_map(evaluation: Evaluation, workspace: Workspace) -> "Figure":
    """Draw every try at every target, and the share of targets within a distance by try.

    Args:
        evaluation: Casts at each target, `repeat` counts the tries.
        workspace: Table and reach.
    """
    height = panel_height(workspace, PAGE_WIDTH, margin=_MARGIN)
    figure = new_figure(PAGE_WIDTH, height + _CURVES_HEIGHT)
    with styled():
        table, curves = figure.subplots(2, height_ratios=(height, _CURVES_HEIGHT))
        draw_workspace(table, workspace)
        frame_workspace(table, workspace, margin=_MARGIN)
        for index, target in enumerate(evaluation.target_xy):
            own = [trial for trial in evaluation.trials if trial.target_index == index]
            landed = np.array(
                [trial.landed_xy for trial in own if trial.status is TrialStatus.OK]
            ).reshape(-1, 2)
            table.plot(*landed.T, "-", color=BLUE, linewidth=0.9, zorder=3)
            for number, xy in enumerate(landed):
                last = number == len(landed) - 1
                color = BLUE if last else FAINT
                table.plot(*xy, "o", color=color, markeredgecolor=BLUE, markersize=4.5, zorder=4)
            style = INK if len(landed) == len(own) else VERMILLION
            table.plot(*target, "o", markersize=9, color="none", markeredgecolor=style, zorder=3.5)
        _draw_curves(curves, evaluation)
    return figure


def _draw_curves(axes, evaluation: Evaluation) -> None:
    """Draw the share of targets that were within a distance after each try."""
    count = len(evaluation.target_xy)
    best = np.full(count, np.inf)
    errors = np.nan_to_num(evaluation.errors_pct, nan=np.inf)
    for number in range(1 + max(trial.repeat for trial in evaluation.trials)):
        for trial, error in zip(evaluation.trials, errors, strict=True):
            if trial.repeat == number:
                best[trial.target_index] = error
        known = np.sort(best[np.isfinite(best)])
        share = 100.0 * np.arange(1, len(known) + 1) / count
        label = "first try" if number == 0 else f"try {number + 1}, or the hit before it"
        axes.step(known, share, where="post", label=label)
    axes.set(
        xlabel="miss [% of cable length]",
        ylabel="targets [%]",
        ylim=(0, 102),
        xlim=(0, 30),
    )
    axes.legend(loc="lower right", fontsize=8)
