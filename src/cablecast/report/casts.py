"""Casts drawn as frames: the cable's shape at successive times, and the gripper's path."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cablecast.evaluation.evaluate import Evaluation, TargetCast
from cablecast.report.style import (
    INK,
    MUTED,
    PAGE_WIDTH,
    TIME_COLORS,
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
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 2
_BAR_HEIGHT = 0.5  # Colour bar below the panels, with its label [inch].
_GRIP_SAMPLES = 120


def chosen_casts(evaluation: Evaluation, count: int = 6) -> list[int]:
    """Choose trials worth a look: from the nearest to the farthest landing, and one without.

    Args:
        evaluation: All casts.
        count: Largest number of trials, at least 2.

    Returns:
        Indices of trials, by rising error; a trial without a landing comes last.
    """
    errors_pct = evaluation.errors_pct
    landed = np.flatnonzero(np.isfinite(errors_pct))
    landed = landed[np.argsort(errors_pct[landed], kind="stable")]
    lost = np.flatnonzero(~np.isfinite(errors_pct))[:1]
    shown = min(len(landed), count - len(lost))
    # Evenly over the order of errors, so that best, median and worst are among them.
    picks = np.unique(np.round(np.linspace(0, len(landed) - 1, shown)).astype(int)) if shown else []
    return [int(index) for index in (*landed[picks], *lost)]


def cast_frames(
    evaluation: Evaluation, workspace: Workspace, trial_indices: Sequence[int]
) -> "Figure":
    """Draw one panel per trial, seen from above.

    Args:
        evaluation: All casts.
        workspace: Table and base.
        trial_indices: Indices of the trials to draw.
    """
    trials = [evaluation.trials[index] for index in trial_indices]
    end = max(float(trial.track.times[-1]) for trial in trials)
    row_count = -(-len(trials) // _COLUMNS)
    height = panel_height(workspace, PAGE_WIDTH / _COLUMNS)
    figure = new_figure(PAGE_WIDTH, height * row_count + _BAR_HEIGHT)
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    with styled():
        grid = figure.subplots(row_count, _COLUMNS, squeeze=False)
        scale = ScalarMappable(Normalize(0.0, end), _time_colors())
        for axes in grid.ravel()[len(trials) :]:
            axes.set_axis_off()
        for axes, trial, index in zip(grid.ravel(), trials, trial_indices, strict=False):
            draw_workspace(axes, workspace, ticks=False)
            _draw_cast(axes, trial, scale)
            axes.set_title(_title(trial, float(evaluation.errors_pct[index])))
            frame_workspace(axes, workspace)
        bar = figure.colorbar(
            scale, ax=grid, orientation="horizontal", shrink=0.35, aspect=40, pad=0.02
        )
        bar.set_label("time since the motion began [s]")
        bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    return figure


def _time_colors():
    import matplotlib as mpl
    from matplotlib.colors import LinearSegmentedColormap

    # From pale to dark: the last shape, which is the result, stands out.
    colors = mpl.colormaps[TIME_COLORS](np.linspace(0.95, 0.05, 64))
    return LinearSegmentedColormap.from_list("times", colors)


def _title(trial: TargetCast, error_pct: float) -> str:
    if trial.status is TrialStatus.OK:
        return f"target {trial.target_index}: error {error_pct:.1f} %"
    return f"target {trial.target_index}: {trial.status.code.replace('_', ' ')}"


def _draw_cast(axes: "Axes", trial: TargetCast, scale) -> None:
    from matplotlib.collections import LineCollection

    track = trial.track
    if track.nodes is not None:
        # One collection: a line for each shape would take seconds.
        shapes = LineCollection(
            list(track.nodes[:-1, :, :2]),
            colors=scale.to_rgba(track.times[:-1]),
            linewidths=0.7,
            alpha=0.75,
            capstyle="round",
            zorder=2,
        )
        axes.add_collection(shapes)
        axes.plot(
            *track.nodes[-1, :, :2].T,
            color=scale.to_rgba(track.times[-1]),
            linewidth=1.9,
            solid_capstyle="round",
            zorder=3,
        )
    path = trial.trajectory.grip_path
    grip = path.evaluate(np.linspace(0.0, float(path.duration[0]), _GRIP_SAMPLES))[0]
    axes.plot(grip[:, 0], grip[:, 1], color=INK, linewidth=1.3, linestyle=(0, (1, 1)), zorder=4)
    axes.plot(*grip[0, :2], "o", color="white", markeredgecolor=INK, markersize=3.5, zorder=5)
    axes.plot(*grip[-1, :2], "o", color=INK, markersize=3.5, zorder=5)
    seen = np.isfinite(track.endpoint_xy).all(axis=1)
    axes.plot(*track.endpoint_xy[seen].T, color=MUTED, linewidth=0.6, zorder=1.5)
    axes.plot(*trial.target_xy, "+", color=VERMILLION, markersize=11, markeredgewidth=2, zorder=6)
    if trial.status is TrialStatus.OK:
        axes.plot(
            *trial.landed_xy, "o", color=VERMILLION, markersize=4, markeredgecolor="white", zorder=7
        )
