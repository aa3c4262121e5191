"""Figures of casts at targets: every try with its stated region, hits against tries, the joints."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cast import Cast
from cablecast.evaluation.evaluate import Evaluation
from cablecast.motion.trajectory import joints_at
from cablecast.report.style import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    MUTED,
    PAGE_WIDTH,
    PURPLE,
    SKY,
    TABLE,
    VERMILLION,
    annotate,
    color_scale,
    draw_grid,
    draw_workspace,
    legend_strip,
    new_figure,
    styled,
    workspace_view,
)
from cablecast.report.words import place_text
from cablecast.setup import Setup
from cablecast.task import WITHIN_PCT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

REGION_SHARE = 0.9
"""Probability of the stated regions that are drawn [-]."""

PANELS_MAX = 40
"""Most targets that `target_panels` draws."""

# Neighbouring targets must differ; the palette goes round. Vermillion means a cast that is lost.
_COLORS = (BLUE, GREEN, PURPLE, SKY, MUTED)
_FEW_TARGETS = 8
_DASHED: Any = (0, (4, 3))
_SPAN_MIN, _SPAN_SHARE = 0.12, 1.2  # Half of a panel: least [cable lengths], over the misses [-].
_TRIES_MIN = 3  # Tries that an axis shows at least.
_STEPS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)  # Between the ticks of a panel [m].
_CURVE_DT = 0.02  # Between the points of the curves of joints [s].


@styled()
def tries_map(
    evaluation: Evaluation,
    *,
    within_pct: float = WITHIN_PCT,
    beyond_xy: Sequence[NDArray[np.float64]] = (),
) -> "Figure":
    """Draw every try (`repeat`) on the table, how far each missed, and hits against tries.

    Many targets are summarised by the share within a distance after each try.

    Args:
        evaluation: Every try at every target.
        within_pct: Distance at which a cast has hit [% of cable length].
        beyond_xy: Targets out of reach that were asked for, too [m]; none is hit.
    """
    workspace = evaluation.setup.workspace
    view = workspace_view(workspace)
    heights = (view.height(PAGE_WIDTH), 2.9)
    figure = new_figure(PAGE_WIDTH, sum(heights) + 0.4)
    grid = figure.add_gridspec(2, 2, height_ratios=heights, width_ratios=(1.5, 1.0))
    table = figure.add_subplot(grid[0, :])
    curves, hits = (figure.add_subplot(grid[1, column]) for column in (0, 1))
    draw_workspace(table, workspace, view)
    few = len(evaluation.target_xy) <= _FEW_TARGETS
    for index, target in enumerate(evaluation.target_xy):
        color = _COLORS[index % len(_COLORS)] if few else BLUE
        top = _draw_tries(table, evaluation, index, color, within_pct)
        table.plot(*target, "o", markersize=9, color="none", markeredgecolor=INK, zorder=3.5)
        if few:
            style: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": 8, "halo": 2.2}
            annotate(table, place_text(target), (target[0], top), (0, 7), zorder=7, **style)
    for xy in beyond_xy:
        table.plot(*xy, "x", color=INK, markersize=7, zorder=5)
    (_draw_misses if few else _draw_try_curves)(curves, evaluation, within_pct)
    _draw_hits(hits, evaluation, within_pct, len(evaluation.target_xy) + len(beyond_xy))
    target = ("target", "o", {"markersize": 9, "color": "none", "markeredgecolor": INK})
    beyond = ("out of reach", "x", {"color": INK, "markersize": 7})
    _legend(figure, evaluation, [target, *[beyond][: len(beyond_xy)]])
    return figure


def _legend(figure: "Figure", evaluation: Evaluation, first: Sequence[Any]) -> None:
    entries: list[tuple[str, str, dict[str, Any]]] = [
        *first,
        ("hit", "o", {"color": BLUE, "markersize": 6}),
        ("miss", "o", {"color": "white", "markeredgecolor": BLUE, "markersize": 6}),
        ("nine of ten landings were expected in here", "-", {"color": FAINT, "linewidth": 7}),
    ]
    if not np.isfinite(evaluation.errors_pct).all():
        entries.append(("a try without a landing", "^", {"color": VERMILLION, "markersize": 6}))
    legend_strip(figure, entries, columns=min(len(entries), 4))


def _draw_tries(
    axes: "Axes", evaluation: Evaluation, index: int, color: str, within_pct: float
) -> float:
    """Draw the tries at one target, and return the largest y of these and the target [m]."""
    target, landed_xy = evaluation.target_xy[index], evaluation.landed_xy
    rows = np.flatnonzero(evaluation.target_index == index)
    for row in rows:
        if (proposal := evaluation.casts[row].proposal) is not None:
            outline = proposal.expected.ellipse(REGION_SHARE).outline()
            axes.fill(*outline.T, color=color, alpha=0.10, linewidth=0, zorder=1.5)
            axes.plot(*outline.T, color=color, alpha=0.5, linewidth=0.7, zorder=1.6)
    landed = [row for row in rows if np.isfinite(evaluation.errors_pct[row])]
    axes.plot(*landed_xy[landed].T, "-", color=color, linewidth=0.8, zorder=3)
    for row in landed:
        dot = _dot(color, evaluation.errors_pct[row] <= within_pct)
        axes.plot(*landed_xy[row], "o", zorder=4, **dot)
    if len(landed) < len(rows):
        axes.plot(*target, "^", markersize=5, color=VERMILLION, markeredgecolor="none", zorder=3.6)
    return max([target[1], *landed_xy[landed, 1]])


def _dot(color: str, is_hit: bool) -> dict[str, Any]:
    """Return the style of the dot of a landing: full of a hit, hollow of a miss."""
    return {"color": color if is_hit else "white", "markeredgecolor": color, "markersize": 5}


def _draw_misses(axes: "Axes", evaluation: Evaluation, within_pct: float) -> None:
    """Draw the miss of each try at each of a few targets."""
    style: dict[str, Any]
    for index, target in enumerate(evaluation.target_xy):
        rows = evaluation.target_index == index
        color = _COLORS[index % len(_COLORS)]
        tries, errors = 1 + evaluation.repeat[rows], evaluation.errors_pct[rows]
        axes.plot(tries, errors, "-", color=color, label=place_text(target))
        for number, error in zip(tries, errors, strict=True):
            axes.plot(number, error, "o", **_dot(color, error <= within_pct))
    lost = 1 + evaluation.repeat[np.isnan(evaluation.errors_pct)]
    mark: dict[str, Any] = {"color": VERMILLION, "transform": axes.get_xaxis_transform()}
    axes.plot(lost, np.full(len(lost), 0.97), "^", markersize=6, zorder=4, **mark)
    _count_tries(axes, evaluation)
    top = max(1.5 * within_pct, 1.1 * float(np.nanmax(evaluation.errors_pct, initial=0.0)))
    axes.set(ylabel="miss [% of cable length]", ylim=(0, top))
    axes.axhline(within_pct, color=INK, linewidth=1.0, linestyle=_DASHED, zorder=2)
    style = {"xycoords": ("axes fraction", "data"), "ha": "right", "va": "bottom", "fontsize": 7.5}
    annotate(axes, f"hit: {within_pct:g} %", (0.99, within_pct), (0, 1), halo=2.2, **style)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2)


def _count_tries(axes: "Axes", evaluation: Evaluation) -> None:
    """Let the x axis count the tries from 1."""
    from matplotlib.ticker import MaxNLocator

    last = max(_TRIES_MIN, 1 + int(evaluation.repeat.max(initial=0)))
    axes.set(xlabel="try", xlim=(0.5, last + 0.5))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    draw_grid(axes)


def _draw_try_curves(axes: "Axes", evaluation: Evaluation, within_pct: float) -> None:
    """Draw the share of targets that were within a distance after each try."""
    count = len(evaluation.target_xy)
    last = np.full(count, np.inf)
    errors = np.nan_to_num(evaluation.errors_pct, nan=np.inf)
    repeat = evaluation.repeat
    tries = 1 + int(repeat.max(initial=0))
    scale = color_scale("viridis", 0.85, 0.1, max(tries - 1, 1))
    for number in range(tries):
        last[evaluation.target_index[repeat == number]] = errors[repeat == number]
        known = np.sort(last[np.isfinite(last)])
        share = 100.0 * np.arange(1, len(known) + 1) / count
        label = "first try" if number == 0 else f"try {number + 1}, or the last before it"
        axes.step(known, share, where="post", label=label, color=scale.to_rgba(number))
    axes.axvline(within_pct, color=INK, linewidth=1.0, linestyle=_DASHED, zorder=2)
    style: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "fontsize": 7.5, "halo": 2.2}
    annotate(axes, f"hit: {within_pct:g} %", (within_pct, 0.02), (3, 0), **style)
    axes.set(xlabel="miss [% of cable length]", ylabel="targets [%]", ylim=(0, 102), xlim=(0, 30))
    axes.legend(loc="lower right", fontsize=8)
    draw_grid(axes)


def _draw_hits(axes: "Axes", evaluation: Evaluation, within_pct: float, asked: int) -> None:
    """Draw how many of the targets that were asked for are hit by each try."""
    hit = evaluation.errors_pct <= within_pct
    tries = np.arange(1 + int(evaluation.repeat.max(initial=0)))
    counts = [len({*evaluation.target_index[hit & (evaluation.repeat <= one)]}) for one in tries]
    shares = 100.0 * np.array(counts) / asked
    axes.bar(1 + tries, shares, width=0.6, color=BLUE, zorder=2)
    for number, share, count in zip(1 + tries, shares, counts, strict=True):
        style: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": 8}
        annotate(axes, f"{count} of {asked}", (number, share), (0, 2), **style)
    _count_tries(axes, evaluation)
    axes.set(ylabel="targets hit by this try [%]", ylim=(0, 115), yticks=range(0, 101, 25))


@styled()
def target_panels(evaluation: Evaluation, within_pct: float = WITHIN_PCT) -> "Figure":
    """Draw the tries at each target at large: numbered landings, stated regions, the tolerance.

    Args:
        evaluation: Every try at every target.
        within_pct: Distance at which a cast has hit [% of cable length].
    """
    from matplotlib.patches import Circle, Rectangle

    count, size, columns = len(evaluation.target_xy), PAGE_WIDTH / 3, 3
    rows = -(-count // columns)
    figure = new_figure(PAGE_WIDTH, rows * (size + 0.35) + 0.6)
    grid = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    table, length = evaluation.setup.workspace, evaluation.cable.length
    for index, (axes, target) in enumerate(zip(grid, evaluation.target_xy, strict=False)):
        corner = (-table.half_width, table.y_min)
        area = (2 * table.half_width, table.y_max - table.y_min)
        axes.add_patch(Rectangle(corner, *area, facecolor=TABLE, edgecolor=MUTED, zorder=0))
        _draw_tries(axes, evaluation, index, BLUE, within_pct)
        (x, y), radius = target, within_pct / 100.0 * length
        axes.add_patch(Circle((x, y), radius, facecolor="none", edgecolor=INK, zorder=3.5))
        axes.plot(x, y, "+", color=INK, markersize=7, zorder=3.5)
        own = evaluation.target_index == index
        tries = [cast for cast, mine in zip(evaluation.casts, own, strict=True) if mine]
        for number, cast in enumerate(tries, start=1):
            if cast.landed:
                annotate(axes, str(number), cast.final_xy, (5, 3), halo=2.2, zorder=6)
        _title_panel(axes, tries, place_text(target))
        misses = evaluation.errors_pct[own] / 100.0
        span = length * max(_SPAN_MIN, _SPAN_SHARE * float(np.nanmax(misses, initial=0.0)))
        axes.set(aspect="equal", xlim=(x - span, x + span), ylim=(y - span, y + span))
        step = next((one for one in _STEPS if 2 * one >= span), _STEPS[-1])
        ticks = step * np.arange(-(span // step), span // step + 1)
        labels = [f"{100 * tick:.0f}" for tick in ticks]
        axes.set_xticks(x + ticks, labels)
        axes.set_yticks(y + ticks, labels)
        axes.tick_params(length=0, labelsize=7.5)
    for axes in grid[count:]:
        axes.remove()
    for axes in grid[max(0, count - columns) : count]:
        axes.set_xlabel("from the target [cm]", fontsize=8)
    hit = (f"within {within_pct:g} % of the cable: a hit", "-", {"color": INK, "linewidth": 1.0})
    _legend(figure, evaluation, [hit])
    return figure


def _title_panel(axes: "Axes", tries: Sequence[Cast], place: str) -> None:
    """Name a target, and below it the tries without a landing."""
    axes.set_title(place if tries else f"{place}: not cast at")
    lost = [
        f"{number}: {cast.status.words}"
        for number, cast in enumerate(tries, start=1)
        if not cast.landed
    ]
    style: dict[str, Any] = {"xycoords": "axes fraction", "color": VERMILLION, "fontsize": 7.5}
    annotate(axes, ", ".join(lost), (0.03, 0.03), (0, 0), halo=2.2, zorder=6, **style)


def tracking_error(cast: Cast) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the times of the arm's reports [s], and measured minus commanded joint angles [rad].

    Their shapes are [report] and [report, joint]. There are none where the arm reported nothing.
    """
    measured, commanded = cast.track.joint_path, cast.joint_path
    if measured is None or commanded is None:
        return np.zeros(0), np.zeros((0, 0))
    return measured.times, measured.q - joints_at(commanded, measured.times)


@styled()
def joint_curves(casts: Sequence[Cast], setup: Setup) -> "Figure | None":
    """Draw angle, speed and tracking error of each joint in each cast, next to their limits.

    It is None without casts that have joints.
    """
    paths = [(cast, path) for cast in casts if (path := cast.joint_path) is not None]
    if not paths:
        return None
    limits, names = setup.arm.limits, setup.arm.joint_names
    figure = new_figure(PAGE_WIDTH, 4.6)
    grid = figure.subplots(3, len(names), sharex=True, sharey="row", squeeze=False)
    for cast, path in paths:
        times = np.arange(0.0, float(path.times[-1]), _CURVE_DT)
        speeds = np.stack([np.interp(times, path.times, rate) for rate in path.qd.T], axis=-1)
        curves = (times, joints_at(path, times)), (times, speeds), tracking_error(cast)
        color = BLUE if cast.hit else MUTED
        for row, (at, values) in zip(grid, curves, strict=True):
            for axes, value in zip(row, values.T, strict=False):
                axes.plot(at, np.degrees(value), color=color, linewidth=0.7, alpha=0.8)
    middle = np.degrees(limits.middle)
    bounds = (
        (middle - np.degrees(limits.position), middle + np.degrees(limits.position)),
        (-np.degrees(limits.velocity), np.degrees(limits.velocity)),
    )
    for row, pair in zip(grid, bounds, strict=False):
        for bound in pair:
            for axes, value in zip(row, bound, strict=True):
                axes.axhline(value, color=VERMILLION, linewidth=1.0, linestyle=_DASHED)
    for axes, name in zip(grid[0], names, strict=True):
        axes.set_title(name, fontsize=8)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]", fontsize=7.5)
    labels = ("angle [deg]", "speed [deg/s]", "tracking\nerror [deg]")
    for row, label in zip(grid, labels, strict=True):
        row[0].set_ylabel(label)
        for axes in row:
            axes.tick_params(labelsize=7.5)
            draw_grid(axes)
    entries: list[tuple[str, str, dict[str, Any]]] = [
        ("casts that hit", "-", {"color": BLUE}),
        ("other casts", "-", {"color": MUTED}),
        ("limit", "-", {"color": VERMILLION, "dashes": (4, 3)}),
    ]
    legend_strip(figure, entries)
    return figure
