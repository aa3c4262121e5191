"""The map of repeated landings with their confidence ellipses, after figure 7 of the paper."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cablecast.evaluation.repeatability import Repeatability
from cablecast.report.style import (
    INK,
    MUTED,
    VERMILLION,
    draw_half_circle,
    draw_workspace,
    frame_workspace,
    new_figure,
    panel_height,
    styled,
)
from cablecast.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LEFT_MAX = -0.25  # Every panel shows the table from here on [m].
_LEFT_MARGIN = 0.12  # White to the left of the landings [m].
_COLUMNS_MAX = 2
_PANEL_WIDTH = 5.6  # [inch]
_LEGEND_HEIGHT = 0.3  # [inch]
_NUMBERED_MAX = 60  # More actions than these would hide their landings behind their numbers.


def repeatability_map(results: Sequence[Repeatability], workspace: Workspace) -> "Figure":
    """Draw a panel per combination: the landings of each action in its colour, with an ellipse.

    Args:
        results: Measured landings, one per combination.
        workspace: Table and reach.
    """
    columns = min(len(results), _COLUMNS_MAX)
    rows = -(-len(results) // columns)
    reach = max(workspace.reach(result.cable.length) for result in results)
    height = panel_height(workspace, _PANEL_WIDTH, radius=reach)
    figure = new_figure(_PANEL_WIDTH * columns, height * rows + _LEGEND_HEIGHT)
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
    draw_half_circle(axes, reach, linestyle=(0, (1, 2)))
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
    frame_workspace(axes, workspace, radius=reach)
    # Grids of actions cast to the right: the empty left of the table would only shrink the rest.
    left = float(np.min(landed_x, initial=_LEFT_MAX)) - _LEFT_MARGIN
    axes.set_xlim(left=max(axes.get_xlim()[0], left))


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
