"""The map of targets and landings, after figure 8 of the paper."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cablecast.conventions import mirror_xy
from cablecast.evaluation.evaluate import Evaluation
from cablecast.report.style import (
    BLUE,
    ERROR_COLORS,
    INK,
    MUTED,
    PAGE_WIDTH,
    SKY,
    VERMILLION,
    draw_half_circle,
    draw_workspace,
    frame_workspace,
    new_figure,
    panel_height,
    styled,
)
from cablecast.track import TrialStatus
from cablecast.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MARGIN = 0.1  # White around the table, with room for labels [m].
_LEGEND_HEIGHT = 0.5  # Legend below the table [inch].
_BAR_WIDTH = 0.9  # Colour bar on the right, with its label [inch].
_COVERAGE_CELL = 0.01  # Cells in which the coverage is drawn [m].


def landing_map(
    evaluation: Evaluation,
    workspace: Workspace,
    *,
    simulated_xy: NDArray[np.float64] | None = None,
    simulated_radius: float = 0.0,
) -> "Figure":
    """Draw targets, landings, and a dashed line from each target to where its casts landed.

    Args:
        evaluation: Casts to draw.
        workspace: Table and reach.
        simulated_xy: Predicted landings of the policy's candidates [m], on one half of the table,
            shape [candidate, 2]; shades the coverage if given.
        simulated_radius: Distance that a candidate covers about its landing [m].
    """
    reach = workspace.reach(evaluation.cable.length)
    height = panel_height(workspace, PAGE_WIDTH - _BAR_WIDTH, margin=_MARGIN, radius=reach)
    figure = new_figure(PAGE_WIDTH, height + _LEGEND_HEIGHT)
    with styled():
        axes = figure.add_subplot()
        draw_workspace(axes, workspace)
        if simulated_xy is not None:
            _draw_coverage(axes, workspace, simulated_xy, simulated_radius)
        frame_workspace(axes, workspace, margin=_MARGIN, radius=reach)
        _draw_reach(axes, workspace, reach)
        _draw_landings(figure, axes, evaluation)
    return figure


def _draw_coverage(axes: "Axes", workspace: Workspace, simulated_xy, radius: float) -> None:
    from scipy.spatial import KDTree

    half_width = workspace.half_width
    x = np.arange(-half_width, half_width + _COVERAGE_CELL, _COVERAGE_CELL)
    y = np.arange(workspace.y_min, workspace.y_max + _COVERAGE_CELL, _COVERAGE_CELL)
    points = np.stack(np.meshgrid(x, y), axis=-1)
    both_halves = np.concatenate([simulated_xy, mirror_xy(simulated_xy)])
    distance, _ = KDTree(both_halves).query(points, distance_upper_bound=4 * radius)
    covered = np.minimum(distance / radius, 3.0)
    axes.contourf(x, y, covered, levels=[-1.0, 1.0], colors=[SKY], alpha=0.16, zorder=0.7)
    axes.text(
        -half_width + 0.03,
        workspace.y_max - 0.03,
        "shaded: where simulated casts land",
        color=BLUE,
        fontsize=8,
        va="top",
        zorder=1,
    )


def _draw_reach(axes: "Axes", workspace: Workspace, reach: float) -> None:
    arm = workspace.r_max
    draw_half_circle(axes, reach, linestyle=(0, (1, 2)))
    draw_half_circle(axes, arm, linestyle=(0, (4, 3)))
    # The arc of the arm passes between targets: its label stands at its foot, clear of them, or
    # where the arc leaves a narrow table.
    side = min(arm, workspace.half_width)
    foot = (side, float(np.sqrt(arm**2 - side**2)))
    for text, xy, ha in (
        (f"reach of arm and cable, {reach:.2f} m", (0.0, reach), "center"),
        (f" reach of the arm,\n {arm:.2f} m", foot, "left"),
    ):
        axes.annotate(
            text,
            xy,
            xytext=(0, 3),
            textcoords="offset points",
            ha=ha,
            va="bottom",
            color=MUTED,
            fontsize=7.5,
        )
    axes.annotate(
        "robot base",
        (0.0, 0.0),
        xytext=(20, -5),
        textcoords="offset points",
        color=INK,
        fontsize=8,
        ha="left",
        va="top",
    )


def _draw_landings(figure: "Figure", axes: "Axes", evaluation: Evaluation) -> None:
    import matplotlib as mpl
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize
    from matplotlib.patheffects import withStroke

    errors_pct = evaluation.errors_pct
    known = np.isfinite(errors_pct)
    top = max(10.0, float(np.max(errors_pct[known], initial=0.0)))
    colors = LinearSegmentedColormap.from_list(
        "errors", mpl.colormaps[ERROR_COLORS](np.linspace(0.0, 0.82, 64))
    )
    scale = ScalarMappable(Normalize(0.0, top), colors)
    lost: set[int] = set()
    for trial, error_pct in zip(evaluation.trials, errors_pct, strict=True):
        if trial.status is not TrialStatus.OK:
            lost.add(trial.target_index)
            continue
        color = colors(error_pct / top)
        line = np.stack([trial.target_xy, trial.landed_xy])
        axes.plot(*line.T, color=color, linewidth=1.1, linestyle=(0, (3, 1.6)), zorder=3)
        axes.plot(
            *trial.landed_xy,
            "o",
            color=color,
            markersize=5,
            markeredgecolor="white",
            markeredgewidth=0.6,
            zorder=4,
        )
    halo = [withStroke(linewidth=2.2, foreground="white")]
    for index, xy in enumerate(evaluation.target_xy):
        axes.plot(*xy, "o", markersize=8, color="none", markeredgecolor=INK, zorder=3.5)
        if index in lost:
            axes.plot(*xy, "^", markersize=5, color=VERMILLION, markeredgecolor="none", zorder=3.4)
        axes.annotate(
            str(index),
            xy,
            xytext=(5, 4.5),
            textcoords="offset points",
            fontsize=7,
            path_effects=halo,
            zorder=5,
        )
    bar = figure.colorbar(scale, ax=axes, shrink=0.6, aspect=26, pad=0.01)
    bar.set_label("error [% of cable length]")
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    handles = [
        axes.plot([], [], "o", markersize=8, color="none", markeredgecolor=INK)[0],
        axes.plot([], [], "o", markersize=5.5, color=colors(0.5))[0],
    ]
    labels = ["target", "landing, joined to its target"]
    if lost:
        handles.append(axes.plot([], [], "^", markersize=6.5, color=VERMILLION)[0])
        labels.append("a cast without a landing (off the table or hidden)")
    # A legend of the figure, not of the axes: the layout then keeps room for it below.
    figure.legend(handles, labels, loc="outside lower center", ncols=3, columnspacing=1.6)
