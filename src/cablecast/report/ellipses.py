"""The map of repeated casts, after figure 8 of the paper: landings, ellipses, mean errors."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cablecast.evaluation.repeatability import confidence_ellipse
from cablecast.report.style import (
    BLUE,
    GREEN,
    INK,
    PAGE_WIDTH,
    PURPLE,
    SKY,
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
    from matplotlib.figure import Figure

# Neighbouring targets must differ; the palette goes round.
_COLORS = (BLUE, VERMILLION, GREEN, PURPLE, SKY)


def ellipse_map(
    trials: Mapping[str, NDArray], workspace: Workspace, cable_length: float
) -> "Figure":
    """Draw targets and landings of an evaluation with repeated casts.

    Args:
        trials: Columns of trials.csv.
        workspace: Table and reach.
        cable_length: Cable length r_c [m].
    """
    from matplotlib.patheffects import withStroke

    reach = workspace.reach(cable_length)
    figure = new_figure(PAGE_WIDTH, panel_height(workspace, PAGE_WIDTH, radius=reach))
    halo = [withStroke(linewidth=2.2, foreground="white")]
    with styled():
        axes = figure.add_subplot()
        draw_workspace(axes, workspace)
        draw_half_circle(axes, reach)
        landed = np.stack([trials["landed_x_m"], trials["landed_y_m"]], axis=-1)
        for target in np.unique(trials["target"]).astype(int):
            rows = trials["target"] == target
            xy = np.array([trials["target_x_m"][rows][0], trials["target_y_m"][rows][0]])
            color = _COLORS[target % len(_COLORS)]
            found = landed[rows][np.isfinite(landed[rows]).all(axis=1)]
            if len(found):
                axes.plot(*found.T, "o", color=color, markersize=3.5, alpha=0.8, zorder=4)
                line = np.stack([xy, found.mean(axis=0)])
                axes.plot(*line.T, color=color, linewidth=1.0, linestyle=(0, (3, 1.6)), zorder=3)
            if (ellipse := confidence_ellipse(found)) is not None:
                axes.fill(
                    *ellipse.outline().T,
                    facecolor=color,
                    edgecolor=color,
                    alpha=0.25,
                    zorder=2,
                )
            if len(found) < rows.sum():
                axes.plot(*(xy + [0.0, 0.05]), "^", color=VERMILLION, markersize=5, zorder=5)
            axes.plot(*xy, "x", color=INK, markersize=4, zorder=5)
            axes.annotate(
                str(target),
                (float(xy[0]), float(xy[1])),
                xytext=(4, 3),
                textcoords="offset points",
                fontsize=7.5,
                color=color,
                fontweight="bold",
                path_effects=halo,
                zorder=6,
            )
        frame_workspace(axes, workspace, radius=reach)
    return figure
