"""The map of repeated landings with their confidence ellipses, after figure 7 of the paper."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cablecast.evaluation.repeatability import Repeatability
from cablecast.report.style import INK, MUTED, VERMILLION, draw_workspace, new_figure, styled
from cablecast.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MARGIN = 0.06  # Of white around the table [m].
_LEFT_MAX = -0.25  # Every panel shows the table from here on [m].
_COLUMNS_MAX = 2
_PANEL_WIDTH, _PANEL_HEIGHT = 5.6, 3.75  # [inch]
_NUMBERED_MAX = 60  # More actions than these would hide their landings behind their numbers.


def repeatability_map(results: Sequence[Repeatability], workspace: Workspace) -> "Figure":
    """One panel per combination: the landings of each action in its colour, with their ellipse.

    Args:
        results: What was measured, one per combination.
        workspace: Table and reach.
    """
    columns = min(len(results), _COLUMNS_MAX)
    rows = -(-len(results) // columns)
    figure = new_figure(_PANEL_WIDTH * columns, _PANEL_HEIGHT * rows + 0.3)
    with styled():
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, result in zip(panels, results, strict=False):
            _draw(axes, result, workspace)
        for axes in panels[len(results) :]:
            axes.set_visible(False)
        _draw_legend(figure, panels[0])
    return figure


def _draw(axes: "Axes", result: Repeatability, workspace: Workspace) -> None:
    import matplotlib as mpl
    from matplotlib.patheffects import withStroke

    draw_workspace(axes, workspace)
    reach = workspace.reach(result.cable.length)
    angle = np.linspace(-np.pi / 2, np.pi / 2, 181)
    arc = reach * np.stack([np.sin(angle), np.cos(angle)])
    axes.plot(*arc, color=MUTED, linewidth=0.8, linestyle=(0, (1, 2)), zorder=1)
    # Neighbours in the grid land close to one another: give them colours far apart.
    colors = mpl.colormaps["tab20"].colors  # pyright: ignore[reportAttributeAccessIssue]
    numbered = len(result.actions) <= _NUMBERED_MAX
    for number, action in enumerate(result.actions):
        color = colors[(7 * number) % len(colors)]
        axes.plot(*action.landed_xy.T, "o", color=color, markersize=2.2, zorder=3)
        if (ellipse := action.ellipse) is not None:
            axes.plot(*ellipse.outline().T, color=color, linewidth=0.9, zorder=3)
        if not len(action.landed_xy):
            continue
        if action.off_table_count:
            axes.plot(*action.mean_xy, "^", color=VERMILLION, markersize=7, alpha=0.55, zorder=2.5)
        if numbered:
            axes.annotate(
                str(number),
                tuple(action.mean_xy),
                xytext=(3, 3),
                textcoords="offset points",
                fontsize=5.5,
                color=INK,
                path_effects=[withStroke(linewidth=1.5, foreground="white")],
                zorder=5,
            )
    scatter = "no scatter" if np.isnan(result.scatter_pct) else f"{result.scatter_pct:.2f} %"
    axes.set_title(
        f"{result.label}: {scatter}, {100 * result.off_table_share:.0f} % off the table",
        color=INK,
    )
    lost = sum(not len(action.landed_xy) for action in result.actions)
    if lost:
        axes.text(
            0.99,
            0.02,
            f"{lost} of {len(result.actions)} actions never stayed on the table",
            transform=axes.transAxes,
            ha="right",
            color=MUTED,
            fontsize=7.5,
        )
    landed_x = np.concatenate([action.landed_xy[:, 0] for action in result.actions])
    half_width = workspace.table_width / 2 + _MARGIN
    # Grids of actions cast to the right: the empty left of the table would only shrink the rest.
    left = float(np.min(landed_x, initial=_LEFT_MAX)) - 2 * _MARGIN
    axes.set_xlim(max(-half_width, left), half_width)
    axes.set_ylim(-0.1, max(workspace.table_depth, reach) + _MARGIN)


def _draw_legend(figure: "Figure", axes: "Axes") -> None:
    handles = [
        axes.plot([], [], "o", color=INK, markersize=3)[0],
        axes.plot([], [], color=INK, linewidth=0.9)[0],
        axes.plot([], [], "^", color=VERMILLION, markersize=7, alpha=0.55)[0],
    ]
    labels = [
        "landings of one action",
        "95 % confidence ellipse (chi-squared)",
        "some casts of the action left the table",
    ]
    figure.legend(handles, labels, loc="outside lower center", ncols=3, columnspacing=1.6)
