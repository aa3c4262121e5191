"""Figures on the map of the table, most after a figure of the paper."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cast import TrialStatus
from cablecast.conventions import mirror_xy
from cablecast.evaluation.evaluate import Evaluation
from cablecast.evaluation.repeatability import Repeatability, confidence_ellipse
from cablecast.learning.policy import COVERAGE_PCT
from cablecast.report.style import (
    BASE_RADIUS,
    BLUE,
    GREEN,
    INK,
    MUTED,
    PAGE_WIDTH,
    PURPLE,
    SKY,
    VERMILLION,
    annotate,
    color_scale,
    draw_color_bar,
    draw_half_circle,
    legend_panel,
    legend_strip,
    styled,
    workspace_panels,
    workspace_view,
)
from cablecast.report.words import place_text
from cablecast.setup import Setup
from cablecast.tuning.tracks import MeasuredTracks
from cablecast.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DASHED: Any = (0, (3, 1.6))
_DOTTED: Any = (0, (1, 2))
# Neighbouring targets must differ; the palette goes round.
_COLORS = (BLUE, VERMILLION, GREEN, PURPLE, SKY)


@styled()
def landing_map(
    evaluation: Evaluation, simulated_xy: NDArray[np.float64] | None = None
) -> "Figure":
    """Draw targets, landings, and a dashed line from each target to where its casts landed.

    Predicted landings of the policy's candidates [m], on one half of the table, shape
    [candidate, 2], shade what they cover.
    """
    figure, axes = _reach_panel(evaluation.setup)
    if simulated_xy is not None:
        radius = COVERAGE_PCT / 100.0 * evaluation.cable.length
        _shade_coverage(axes, evaluation.setup.workspace, simulated_xy, radius)
    errors_pct = evaluation.errors_pct
    top = max(10.0, float(np.nanmax(errors_pct, initial=0.0)))
    scale = color_scale("plasma", 0.0, 0.82, top)
    lost: set[int] = set()
    for cast, target, error_pct in zip(
        evaluation.casts, evaluation.target_index.tolist(), errors_pct, strict=True
    ):
        if cast.status is not TrialStatus.OK:
            lost.add(target)
            continue
        color = scale.to_rgba(error_pct)
        line = np.stack([evaluation.target_xy[target], cast.final_xy])
        axes.plot(*line.T, color=color, linewidth=1.1, linestyle=_DASHED, zorder=3)
        axes.plot(
            *cast.final_xy,
            "o",
            color=color,
            markersize=5,
            markeredgecolor="white",
            markeredgewidth=0.6,
            zorder=4,
        )
    for index, xy in enumerate(evaluation.target_xy):
        axes.plot(*xy, "o", markersize=8, color="none", markeredgecolor=INK, zorder=3.5)
        if index in lost:
            axes.plot(*xy, "^", markersize=5, color=VERMILLION, markeredgecolor="none", zorder=3.4)
        annotate(axes, str(index), xy, (5, 4.5), fontsize=7, halo=2.2, zorder=5)
    draw_color_bar(
        figure, axes, scale, "error [% of cable length]", shrink=0.6, aspect=26, pad=0.01
    )
    entries = [
        ("target", "o", {"markersize": 8, "color": "none", "markeredgecolor": INK}),
        ("landing, joined to its target", "o", {"markersize": 5.5, "color": scale.cmap(0.5)}),
        (
            "a cast without a landing (off the table or hidden)",
            "^",
            {"markersize": 6.5, "color": VERMILLION},
        ),
    ]
    legend_strip(figure, entries if lost else entries[:2])
    return figure


def _shade_coverage(axes: "Axes", workspace: Workspace, simulated_xy, radius: float) -> None:
    from scipy.spatial import KDTree

    half_width, cell = workspace.half_width, 0.01
    x = np.arange(-half_width, half_width + cell, cell)
    y = np.arange(workspace.y_min, workspace.y_max + cell, cell)
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


def _reach_panel(setup: Setup) -> tuple["Figure", "Axes"]:
    """Return a map of the table with the reach of arm and cable, and room for bar and legend."""
    workspace = setup.workspace
    reach, arm = workspace.reach(setup.cable.length), workspace.r_max
    view = workspace_view(workspace, margin=0.1, radius=reach)
    figure, (axes,) = workspace_panels(workspace, view, below=0.5, beside=0.9)
    draw_half_circle(axes, reach, linestyle=_DOTTED)
    draw_half_circle(axes, arm, linestyle=(0, (4, 3)))
    # The arc of the arm passes between targets: its label stands at its foot, clear of them, or
    # where the arc leaves a narrow table.
    side = min(arm, workspace.half_width)
    foot = (side, float(np.sqrt(arm**2 - side**2)))
    style: dict[str, Any] = {"va": "bottom", "color": MUTED, "fontsize": 7.5}
    above = f"reach of arm and cable, {reach:.2f} m"
    annotate(axes, above, (0.0, reach), (0, 3), ha="center", **style)
    annotate(axes, f" reach of the arm,\n {arm:.2f} m", foot, (0, 3), ha="left", **style)
    below = {"color": INK, "fontsize": 8, "ha": "center", "va": "top"}
    annotate(axes, "robot base", (0.0, -BASE_RADIUS), (0, -2), **below)
    return figure, axes


@styled()
def ellipse_map(
    trials: Mapping[str, NDArray], workspace: Workspace, cable_length: float
) -> "Figure":
    """Draw targets, landings and 95 % ellipses from trials.csv, after figure 8 of the paper."""
    reach = workspace.reach(cable_length)
    figure, (axes,) = workspace_panels(workspace, workspace_view(workspace, radius=reach))
    draw_half_circle(axes, reach, linestyle=_DOTTED)
    landed = np.stack([trials["landed_x_m"], trials["landed_y_m"]], axis=-1)
    for target in np.unique(trials["target"]).astype(int):
        rows = trials["target"] == target
        xy = np.array([trials["target_x_m"][rows][0], trials["target_y_m"][rows][0]])
        color = _COLORS[target % len(_COLORS)]
        found = landed[rows][np.isfinite(landed[rows]).all(axis=1)]
        if len(found):
            axes.plot(*found.T, "o", color=color, markersize=3.5, alpha=0.8, zorder=4)
            line = np.stack([xy, found.mean(axis=0)])
            axes.plot(*line.T, color=color, linewidth=1.0, linestyle=_DASHED, zorder=3)
        if (ellipse := confidence_ellipse(found)) is not None:
            axes.fill(*ellipse.outline().T, color=color, alpha=0.25, zorder=2)
        if len(found) < rows.sum():
            axes.plot(*(xy + [0.0, 0.05]), "^", color=VERMILLION, markersize=5, zorder=5)
        axes.plot(*xy, "x", color=INK, markersize=4, zorder=5)
        style = {"fontsize": 7.5, "color": color, "fontweight": "bold"}
        annotate(axes, str(target), xy, (4, 3), halo=2.2, zorder=6, **style)
    return figure


_NUMBERED_MAX = 60  # More actions than these would hide their landings behind their numbers.


@styled()
def repeatability_map(results: Sequence[Repeatability], workspace: Workspace) -> "Figure":
    """Draw landings of repeated actions with 95 % ellipses, after figure 7 of the paper."""
    reach = max(workspace.reach(result.cable.length) for result in results)
    landed = np.concatenate([action.landed_xy for r in results for action in r.actions])
    # Grids of actions cast to the right: the empty left of the table would only shrink the rest.
    left = min(-0.25, float(np.min(landed[:, 0], initial=0.0))) - 0.12
    left = max(left, workspace_view(workspace).x_min)
    columns = min(len(results), 2)
    figure, panels = workspace_panels(
        workspace,
        workspace_view(workspace, radius=reach, left=left),
        len(results),
        columns=columns,
        width=PAGE_WIDTH * (1.0 if columns == 2 else 0.65),
        below=0.3 if columns == 2 else 0.7,
    )
    for axes, result in zip(panels, results, strict=True):
        draw_half_circle(axes, reach, linestyle=_DOTTED)
        _draw_repeated(axes, result)
    entries = [
        ("landings of one action", "o", {"color": INK, "markersize": 3}),
        ("95 % confidence ellipse (chi-squared)", "-", {"color": INK, "linewidth": 0.9}),
        (
            "some casts of the action left the table",
            "^",
            {"color": VERMILLION, "markersize": 7, "alpha": 0.55},
        ),
    ]
    if not legend_panel(figure, panels, entries):
        legend_strip(figure, entries, columns=3 if columns == 2 else 1)
    return figure


def _draw_repeated(axes: "Axes", result: Repeatability) -> None:
    import matplotlib as mpl

    # Neighbours in the grid land close to one another: give them colours far apart.
    colors = mpl.colormaps["tab20"].colors  # pyright: ignore[reportAttributeAccessIssue]
    numbered = len(result.actions) <= _NUMBERED_MAX
    for number, action in enumerate(result.actions):
        color = colors[(7 * number) % len(colors)]
        axes.plot(*action.landed_xy.T, "o", color=color, markersize=2.2, zorder=3)
        if (ellipse := action.ellipse) is not None:
            axes.plot(*ellipse.outline().T, color=color, linewidth=0.9, zorder=3)
        if len(action.landed_xy) and action.off_table_count:
            axes.plot(*action.mean_xy, "^", color=VERMILLION, markersize=7, alpha=0.55, zorder=2.5)
        if len(action.landed_xy) and numbered:
            annotate(axes, str(number), action.mean_xy, (3, 3), fontsize=5.5, halo=1.5, zorder=5)
    scatter = "no scatter" if np.isnan(result.scatter_pct) else f"{result.scatter_pct:.2f} %"
    off_table = f"{100 * result.off_table_share:.0f} % off the table"
    axes.set_title(f"{result.label}: {scatter}, {off_table}")
    lost = sum(not len(action.landed_xy) for action in result.actions)
    if lost:
        text = f"{lost} of {len(result.actions)} actions have no landing"
        style: dict[str, Any] = {"xycoords": "axes fraction", "ha": "right", "zorder": 6}
        # Ellipses reach there; on a narrow table it stands on the robot's base.
        style["bbox"] = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
        annotate(axes, text, (0.99, 0.02), (0, 0), color=MUTED, fontsize=7.5, **style)


@styled()
def coverage_figure(
    selection: Mapping[str, Any], workspace: Workspace, cable_length: float
) -> "Figure":
    """Draw the hulls of all speeds, a panel for each r0 and action set, after the paper's figure 6.

    The selection is the metrics.json of `select`.
    """
    results = selection["coverage"]
    polar_casting_xy = np.array(selection["polar_casting"]["outline_xy"])
    panels: dict[tuple[bool, float], list[dict[str, Any]]] = {}
    for result in results:
        panels.setdefault((result["with_psi"], result["r0"]), []).append(result)
    speeds = sorted({result["v_max"] for result in results})
    palette = (VERMILLION, GREEN, BLUE)
    colors = {speed: palette[number % len(palette)] for number, speed in enumerate(speeds)}
    radius = workspace.reach(cable_length)
    side = max(radius, workspace.half_width)
    # Room for the legend to the right of the half disc.
    view = workspace_view(workspace, radius=radius, left=-side - 0.05, right=side + 1.0)
    options: dict[str, Any] = {"columns": 2, "grid": False, "ticks": False}
    figure, grid = workspace_panels(workspace, view, len(panels), **options)
    for axes, ((with_psi, r0), shown) in zip(grid, panels.items(), strict=True):
        draw_half_circle(axes, radius, closed=True)
        if len(polar_casting_xy):
            grey = {"color": MUTED, "alpha": 0.25, "linewidth": 0, "zorder": 0.6}
            axes.fill(*polar_casting_xy.T, label="polar casting", **grey)
        axes.set_title(f"r0 = {r0:g} m" + ", the wrist turns (psi)" * with_psi)
        # The fastest casts cover most, so they are drawn first.
        for result in sorted(shown, key=lambda result: -result["v_max"]):
            color = colors[result["v_max"]]
            label = f"{result['v_max']:g} m/s: {100 * result['share']:.1f} %"
            for part, hull in enumerate(result["hulls_xy"]):
                xy = np.asarray(hull, dtype=float)
                axes.fill(*xy.T, color=color, alpha=0.10, linewidth=0, zorder=2)
                name = "" if part else label
                axes.plot(*xy.T, color=color, linewidth=1.3, zorder=3, label=name)
        if any(axes.get_legend_handles_labels()):
            axes.legend(loc="upper right", fontsize=7.5, handlelength=1.2, borderaxespad=0.0)
    return figure


@styled()
def reach_map(
    setup: Setup,
    places: NDArray[np.float64],
    chances: NDArray[np.float64],
    cell: float,
    target_xy: NDArray[np.float64],
) -> "Figure":
    """Draw the share of the believed cables whose casts reach each place of the table, and targets.

    Places are the middles of squares of a width [m], shape [place, 2]; so are targets.
    """
    figure, axes = _reach_panel(setup)
    scale = color_scale("Blues", 0.0, 0.85, 100.0)
    x, y = (np.unique(places[:, axis]) for axis in (0, 1))
    # The last squares are cut at the table's edge, or stretched to it.
    far = setup.workspace.half_width, setup.workspace.y_max
    edges = [np.append(values - cell / 2, end) for values, end in zip((x, y), far, strict=True)]
    share = 100.0 * chances.reshape(len(y), len(x))
    axes.pcolormesh(*edges, share, cmap=scale.cmap, norm=scale.norm, zorder=0.7, rasterized=True)
    rest = setup.workspace.reset_y + np.array([0.0, setup.cable.length])
    axes.plot([0.0, 0.0], rest, color=VERMILLION, linewidth=1.6, zorder=3)
    style: dict[str, Any] = {"color": VERMILLION, "fontsize": 8, "halo": 2.2, "zorder": 5}
    # Along the cable, on the side on which targets have no labels.
    style |= {"rotation": 90, "ha": "right", "va": "bottom"}
    annotate(axes, "cable after a reset", (0.0, rest[0]), (-3, 0), **style)
    for target in target_xy:
        axes.plot(*target, "o", color="white", markeredgecolor=INK, markersize=8, zorder=6)
        axes.plot(*target, "o", color=INK, markersize=2.5, zorder=6)
        style = {"color": INK, "fontsize": 8, "halo": 2.2, "zorder": 6}
        annotate(axes, place_text(target), target, (7, 5), **style)
    label = "cables that this may be whose casts reach a place [%]"
    draw_color_bar(figure, axes, scale, label, shrink=0.6, aspect=26, pad=0.01)
    return figure


def spread_choice(values: NDArray[np.float64], count: int) -> list[int]:
    """Return the indices of trials spread evenly from the smallest value to the largest, those too.

    Trials with NaN are not chosen.
    """
    order = np.argsort(values, kind="stable")
    order = order[np.isfinite(values[order])]
    places = np.round(np.linspace(0, len(order) - 1, min(count, len(order))))
    return order[places.astype(int)].tolist()


@styled()
def track_panels(
    tracks: MeasuredTracks,
    default_xy: NDArray[np.float64],
    tuned_xy: NDArray[np.float64],
    workspace: Workspace,
    trial_indices: Sequence[int],
    cable_length: float,
) -> "Figure":
    """Draw measured tracks as points every 100 ms, and simulated ones as lines through such points.

    Simulated endpoints are at the measured times [m], shape [trial, sample, 2]; distances, in % of
    cable length, are those of the tuned parameters. The trials run from the nearest tracks to the
    farthest, as of `spread_choice`.
    """
    simulated = (("default", default_xy, MUTED), ("tuned", tuned_xy, BLUE))
    options: dict[str, Any] = {"columns": 3, "below": 0.7, "ticks": False}
    view = workspace_view(workspace)
    figure, panels = workspace_panels(workspace, view, len(trial_indices), **options)
    for axes, trial in zip(panels, trial_indices, strict=True):
        seen = tracks.compared[trial]
        measured = tracks.endpoint_xy[trial, seen]
        for _, xy, color in simulated:
            path = xy[trial, seen]
            axes.plot(*path.T, ".-", color=color, linewidth=1.4, markersize=2.2, zorder=3)
            axes.plot(*path[-1], "o", color=color, markersize=4.5, zorder=4)
        axes.plot(*measured.T, ".", color=VERMILLION, markersize=3.2, zorder=5)
        axes.plot(*measured[-1], "o", color=VERMILLION, markersize=5, zorder=6)
        apart = np.linalg.norm(tuned_xy[trial, seen] - measured, axis=1)
        percent = 100.0 * apart / cable_length
        rests = np.isfinite(tracks.final_xy[trial]).all()
        end = f"{'at rest' if rests else 'last seen'} {percent[-1]:.1f} %"
        axes.set_title(f"trial {trial}: mean {percent.mean():.1f} %, {end}")
    entries: list[tuple[str, str, dict[str, Any]]] = [
        (f"{name} parameters", "-", {"color": color, "linewidth": 1.6})
        for name, _, color in simulated
    ]
    entries.append(("measured every 100 ms", "o", {"color": VERMILLION, "markersize": 4}))
    if len(trial_indices) > 1:
        figure.suptitle(
            f"{len(trial_indices)} of {len(tracks.endpoint_xy)} trials, from best to worst fitted",
            x=0.01,
            ha="left",
            fontsize=9,
        )
    legend_strip(figure, entries)
    return figure


def chosen_casts(evaluation: Evaluation) -> list[int]:
    """Choose at most six trials, from the nearest to the farthest landing and one without."""
    errors_pct = evaluation.errors_pct
    lost = np.flatnonzero(~np.isfinite(errors_pct))[:1].tolist()
    return [*spread_choice(errors_pct, 6 - len(lost)), *lost]


@styled()
def cast_frames(evaluation: Evaluation, trial_indices: Sequence[int]) -> "Figure":
    """Draw the shapes of the cable over time and the path of the gripper, a panel per trial."""
    casts = [evaluation.casts[index] for index in trial_indices]
    workspace = evaluation.setup.workspace
    options: dict[str, Any] = {"columns": 2, "below": 0.5, "ticks": False}
    # The cable may hang over the sides of a narrow table.
    shapes = [cast.track.nodes for cast in casts if cast.track.nodes is not None]
    beside = max((float(np.nanmax(np.abs(s[..., 0]), initial=0.0)) for s in shapes), default=0.0)
    side = max(beside, workspace.half_width) + 0.05
    view = workspace_view(workspace, left=-side, right=side)
    figure, panels = workspace_panels(workspace, view, len(casts), **options)
    # From pale to dark: the last shape, which is the result, stands out.
    scale = color_scale("viridis", 0.95, 0.05, 100.0)
    for axes, cast, index in zip(panels, casts, trial_indices, strict=True):
        _draw_cast(axes, evaluation, index, scale)
        landed = cast.status is TrialStatus.OK
        result = f"error {evaluation.errors_pct[index]:.1f} %"
        result = result if landed else cast.status.words
        name = f"target {evaluation.target_index[index]}"
        if cast.proposal is not None:
            name = f"{place_text(cast.target_xy)}, try {cast.try_number}"
        axes.set_title(f"{name}: {result}")
    label = "time of each cast, from its start to its rest [%]"
    options = {"orientation": "horizontal", "shrink": 0.35, "aspect": 40, "pad": 0.02}
    draw_color_bar(figure, figure.axes, scale, label, **options)
    return figure


def _draw_cast(axes: "Axes", evaluation: Evaluation, index: int, scale: Any) -> None:
    from matplotlib.collections import LineCollection

    track = evaluation.casts[index].track
    if track.nodes is not None:
        colors = scale.to_rgba(100.0 * track.times / track.times[-1])
        # One collection: a line for each shape would take seconds.
        shapes = LineCollection(
            list(track.nodes[:-1, :, :2]),
            colors=colors[:-1],
            linewidths=0.7,
            alpha=0.75,
            capstyle="round",
            zorder=2,
        )
        axes.add_collection(shapes, autolim=False)
        last = {"color": colors[-1], "solid_capstyle": "round"}
        axes.plot(*track.nodes[-1, :, :2].T, linewidth=1.9, zorder=3, **last)
    path = evaluation.motions[index].grip_path
    grip = path.evaluate(np.linspace(0.0, float(path.duration[0]), 120))[0]
    axes.plot(grip[:, 0], grip[:, 1], color=INK, linewidth=1.3, linestyle=(0, (1, 1)), zorder=4)
    axes.plot(*grip[0, :2], "o", color="white", markeredgecolor=INK, markersize=3.5, zorder=5)
    axes.plot(*grip[-1, :2], "o", color=INK, markersize=3.5, zorder=5)
    seen = np.isfinite(track.endpoint_xy).all(axis=1)
    axes.plot(*track.endpoint_xy[seen].T, color=MUTED, linewidth=0.6, zorder=1.5)
    target = evaluation.aimed_xy[index]
    axes.plot(*target, "+", color=VERMILLION, markersize=11, markeredgewidth=2, zorder=6)
    if track.status is TrialStatus.OK:
        dot = {"color": VERMILLION, "markersize": 4, "markeredgecolor": "white"}
        axes.plot(*track.final_xy, "o", zorder=7, **dot)
