"""Simulated against measured tracks of the endpoint, from above, one panel per trial."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cablecast.report.style import (
    BLUE,
    INK,
    MUTED,
    PAGE_WIDTH,
    VERMILLION,
    draw_workspace,
    frame_workspace,
    new_figure,
    panel_height,
    styled,
)
from cablecast.tuning.tracks import MeasuredTracks
from cablecast.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 3
_LEGEND_HEIGHT = 0.4  # [inch]


def chosen_tracks(mean_distances: NDArray[np.float64], count: int = 9) -> list[int]:
    """Choose trials worth a look, evenly from the best simulated to the worst.

    Args:
        mean_distances: Mean distance of each trial [m], shape [trial]; NaN where nothing could be
            compared.
        count: Largest number of trials.

    Returns:
        Indices of trials by rising distance; best, median and worst are among them.
    """
    order = np.argsort(mean_distances, kind="stable")
    order = order[np.isfinite(mean_distances[order])]
    if not len(order):
        return []
    places = np.unique(np.round(np.linspace(0, len(order) - 1, count)).astype(int))
    return [int(order[place]) for place in places]


def track_panels(
    tracks: MeasuredTracks,
    simulated: Sequence[tuple[str, NDArray[np.float64]]],
    workspace: Workspace,
    trial_indices: Sequence[int],
    cable_length: float,
) -> "Figure":
    """Draw measured tracks as points every 100 ms, and simulated ones as lines through such points.

    Args:
        tracks: Tracks that a rig measured.
        simulated: Labels and simulated endpoints at the measured times [m], shape
            [trial, sample, 2]: one or two, of which the last is the one to look at.
        workspace: Table and base.
        trial_indices: Indices of the trials to draw.
        cable_length: Cable length r_c, of which distances are a percentage [m].
    """
    row_count = -(-max(len(trial_indices), 1) // _COLUMNS)
    height = panel_height(workspace, PAGE_WIDTH / _COLUMNS)
    figure = new_figure(PAGE_WIDTH, height * row_count + _LEGEND_HEIGHT)
    colors = (MUTED, BLUE)[-len(simulated) :]
    with styled():
        grid = figure.subplots(row_count, _COLUMNS, squeeze=False)
        for axes in grid.ravel()[len(trial_indices) :]:
            axes.set_axis_off()
        for axes, trial in zip(grid.ravel(), trial_indices, strict=False):
            draw_workspace(axes, workspace, ticks=False)
            seen = tracks.compared[trial]
            measured = tracks.endpoint_xy[trial, seen]
            for (_, xy), color in zip(simulated, colors, strict=True):
                _draw_track(axes, xy[trial, seen], color)
            axes.plot(*measured.T, ".", color=VERMILLION, markersize=3.2, zorder=5)
            axes.plot(*measured[-1], "o", color=VERMILLION, markersize=5, zorder=6)
            apart = np.linalg.norm(simulated[-1][1][trial, seen] - measured, axis=1)
            percent = 100.0 * apart / cable_length
            axes.set_title(f"trial {trial}: mean {percent.mean():.1f} %, end {percent[-1]:.1f} %")
            frame_workspace(axes, workspace)
        handles = [
            grid[0, 0].plot([], [], color=color, linewidth=1.6, label=label)[0]
            for (label, _), color in zip(simulated, colors, strict=True)
        ]
        handles += grid[0, 0].plot(
            [], [], "o", color=VERMILLION, markersize=4, label="measured every 100 ms"
        )
        figure.legend(
            handles=handles, loc="outside lower center", ncols=len(handles), labelcolor=INK
        )
    return figure


def _draw_track(axes: "Axes", xy: NDArray[np.float64], color: str) -> None:
    axes.plot(*xy.T, color=color, linewidth=1.4, zorder=3)
    axes.plot(*xy.T, ".", color=color, markersize=2.2, zorder=4)
    axes.plot(*xy[-1], "o", color=color, markersize=4.5, zorder=4)
