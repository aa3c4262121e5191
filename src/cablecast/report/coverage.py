"""The figure of coverage, after figure 6 of the paper: every hull within the half disc."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cablecast.report.style import (
    BLUE,
    GREEN,
    MUTED,
    PAGE_WIDTH,
    VERMILLION,
    draw_half_circle,
    draw_workspace,
    frame_workspace,
    new_figure,
    styled,
)
from cablecast.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

_COLUMNS = 2
_LEGEND_WIDTH = 1.0  # Room to the right of the half disc [m].
_PANEL_HEIGHT = 2.2  # [inch]
# By rising speed; the fastest casts cover most, so they are drawn first.
_SPEED_COLORS = (VERMILLION, GREEN, BLUE)


def coverage_figure(
    results: Sequence[dict[str, Any]],
    polar_casting_xy: "NDArray[np.float64]",
    workspace: Workspace,
    cable_length: float,
) -> "Figure":
    """Draw a panel for each r0 without psi and for each with, and in it a hull for each speed.

    Args:
        results: Result of `Coverage.to_dict` for every combination.
        polar_casting_xy: Outline of what polar casting reaches [m], shape [vertex, 2].
        workspace: Table and reach.
        cable_length: Cable length r_c [m].
    """
    panels: dict[tuple[bool, float], list[dict[str, Any]]] = {}
    for result in results:
        panels.setdefault((result["with_psi"], result["r0"]), []).append(result)
    speeds = sorted({result["v_max"] for result in results})
    colors = {speed: _SPEED_COLORS[k % len(_SPEED_COLORS)] for k, speed in enumerate(speeds)}
    row_count = -(-len(panels) // _COLUMNS)
    figure = new_figure(PAGE_WIDTH, _PANEL_HEIGHT * row_count + 0.1)
    with styled():
        grid = figure.subplots(row_count, _COLUMNS, squeeze=False).ravel()
        for axes in grid[len(panels) :]:
            axes.set_axis_off()
        for axes, ((with_psi, r0), shown) in zip(grid, panels.items(), strict=False):
            _draw_ground(axes, workspace, workspace.reach(cable_length), polar_casting_xy)
            axes.set_title(f"r0 = {r0:g} m" + ", the wrist turns (psi)" * with_psi)
            for result in sorted(shown, key=lambda result: -result["v_max"]):
                _draw_hull(axes, result, colors[result["v_max"]])
            axes.legend(loc="upper right", fontsize=7.5, handlelength=1.2, borderaxespad=0.0)
    return figure


def _draw_ground(axes: "Axes", workspace: Workspace, radius: float, polar_casting_xy) -> None:
    draw_workspace(axes, workspace, grid=False, ticks=False)
    draw_half_circle(axes, radius, closed=True)
    if len(polar_casting_xy):
        axes.fill(
            *polar_casting_xy.T,
            color=MUTED,
            alpha=0.25,
            linewidth=0,
            zorder=0.6,
            label="polar casting",
        )
    side = max(radius, workspace.half_width)
    frame_workspace(axes, workspace, radius=radius, left=-side - 0.05, right=side + _LEGEND_WIDTH)


def _draw_hull(axes: "Axes", result: dict[str, Any], color: str) -> None:
    label = f"{result['v_max']:g} m/s: {100 * result['share']:.1f} %"
    for hull in result["hulls_xy"]:
        xy = np.asarray(hull, dtype=float)
        axes.fill(*xy.T, color=color, alpha=0.10, linewidth=0, zorder=2)
        axes.plot(*xy.T, color=color, linewidth=1.3, zorder=3, label=label)
        label = None
