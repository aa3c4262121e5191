"""The map of targets and landings, after figure 8 of the paper.

The map of tries: how the casts at each target come nearer to it.

The map of repeated casts, after figure 8 of the paper: landings, ellipses, mean errors.

The map of repeated landings with their confidence ellipses, after figure 7 of the paper.

The figure of coverage, after figure 6 of the paper: every hull within the half disc.

Simulated against measured tracks of the endpoint, from above, one panel per trial.

Casts drawn as frames: the cable's shape at successive times, and the gripper's path.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cast import TrialStatus
from cablecast.conventions import mirror_xy
from cablecast.evaluation.evaluate import Evaluation, TargetCast
from cablecast.evaluation.repeatability import Repeatability, confidence_ellipse
from cablecast.report.style import (
    BLUE,
    ERROR_COLORS,
    FAINT,
    GREEN,
    INK,
    MUTED,
    PAGE_WIDTH,
    PURPLE,
    SKY,
    TIME_COLORS,
    VERMILLION,
    draw_half_circle,
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
    from numpy.typing import NDArray

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


_MARGIN__tries = 0.05
_CURVES_HEIGHT = 2.6


def tries_map(evaluation: Evaluation, workspace: Workspace) -> "Figure":
    """Draw every try at every target, and the share of targets within a distance by try.

    Args:
        evaluation: Casts at each target, `repeat` counts the tries.
        workspace: Table and reach.
    """
    height = panel_height(workspace, PAGE_WIDTH, margin=_MARGIN__tries)
    figure = new_figure(PAGE_WIDTH, height + _CURVES_HEIGHT)
    with styled():
        table, curves = figure.subplots(2, height_ratios=(height, _CURVES_HEIGHT))
        draw_workspace(table, workspace)
        frame_workspace(table, workspace, margin=_MARGIN__tries)
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


_LEFT_MAX = -0.25  # Every panel shows the table from here on [m].
_LEFT_MARGIN = 0.12  # White to the left of the landings [m].
_COLUMNS_MAX = 2
_PANEL_WIDTH = 5.6  # [inch]
_LEGEND_HEIGHT__repeatability = 0.3  # [inch]
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
    figure = new_figure(_PANEL_WIDTH * columns, height * rows + _LEGEND_HEIGHT__repeatability)
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


_COLUMNS__tracks = 3
_LEGEND_HEIGHT__tracks = 0.4  # [inch]


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
    row_count = -(-max(len(trial_indices), 1) // _COLUMNS__tracks)
    height = panel_height(workspace, PAGE_WIDTH / _COLUMNS__tracks)
    figure = new_figure(PAGE_WIDTH, height * row_count + _LEGEND_HEIGHT__tracks)
    colors = (MUTED, BLUE)[-len(simulated) :]
    with styled():
        grid = figure.subplots(row_count, _COLUMNS__tracks, squeeze=False)
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
