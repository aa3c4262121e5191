"""The report of strikes: the plane of the swing with every try, and one HTML page."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cablecast.cast import Cast
from cablecast.conventions import Array
from cablecast.motion.joint_move import JointMoves, SwingPlane, swing_shape
from cablecast.motion.trajectory import joints_at
from cablecast.report.page import render_template, run_settings
from cablecast.report.style import (
    BLUE,
    FAINT,
    INK,
    MUTED,
    PAGE_WIDTH,
    annotate,
    draw_grid,
    legend_strip,
    new_figure,
    styled,
    svg_uri,
)
from cablecast.report.tables import flatten_settings
from cablecast.report.words import chance_text, miss_text, place_text, verdict_text
from cablecast.setup import Setup

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STRIKE_PAGE, STRIKE_PICTURE = "report.html", "tries.png"
_PANELS_MAX = 12
"""Most targets that have a panel of their own."""


def plane_text(point: Array, plane: SwingPlane) -> str:
    """Return a point [m], shape [3], by its place in the plane of the swing."""
    ahead, height, away = plane.coordinates(point).tolist()
    aside = f", {100 * abs(away):.0f} cm out of the plane" if abs(away) >= 0.005 else ""
    return f"{ahead:.2f} m ahead, {height:.2f} m high{aside}"


def target_text(value: Array, setup: Setup) -> str:
    """Return a target by its place on the table, or in the plane of the swing, in short."""
    if setup.strike is None:
        return place_text(value)
    ahead, height, _ = SwingPlane.of(JointMoves.of(setup)).coordinates(value).tolist()
    return f"{ahead:.2f} m, {height:.2f} m high"


def envelope_text(low: Array, high: Array) -> str:
    """Return where the cable can be in any swing, from the corners of a box [m], shape [3]."""
    sides = (f"{a} {low[k]:.2f} to {high[k]:.2f} m" for k, a in enumerate("xyz"))
    return f"the cable can be anywhere in {', '.join(sides)}"


@styled()
def strike_map(tries: Sequence[Sequence[Cast]], setup: Setup) -> "Figure":
    """Draw a panel for each target: the plane of the swing with arm, tips and closest points.

    Args:
        tries: Casts at each target, in order.
        setup: Set-up with a strike section.
    """
    plane = SwingPlane.of(JointMoves.of(setup))
    shown = [casts for casts in tries if casts][:_PANELS_MAX]
    columns = min(len(shown), 3)
    rows = -(-len(shown) // max(columns, 1))
    figure = new_figure(PAGE_WIDTH, max(rows, 1) * 3.4 + 0.5)
    grid = figure.subplots(max(rows, 1), max(columns, 1), squeeze=False).ravel().tolist()
    for axes, casts in zip(grid, shown, strict=False):
        _draw_target(axes, casts, setup, plane)
    for axes in grid[len(shown) :]:
        axes.remove()
    if note := _left_out(tries):
        figure.suptitle(note, x=0.01, ha="left", fontsize=9)
    legend_strip(
        figure,
        [
            ("target", "o", {"color": "none", "markeredgecolor": INK, "markersize": 8}),
            ("path of the tip, last try", "-", {"color": BLUE}),
            ("earlier tries", "-", {"color": FAINT}),
            ("arm and stick at the closest point", "-", {"color": MUTED, "linewidth": 4}),
        ],
        columns=4,
    )
    return figure


def _left_out(tries: Sequence[Sequence[Cast]]) -> str:
    """Return that some targets have no panel for want of room; nothing where all have one."""
    count = sum(bool(casts) for casts in tries)
    return f"The first {_PANELS_MAX} of {count} targets" if count > _PANELS_MAX else ""


def _draw_target(axes: "Axes", casts: Sequence[Cast], setup: Setup, plane: SwingPlane) -> None:
    target = casts[0].target_xy
    u, v, _ = plane.coordinates(target)
    for cast in casts:
        last = cast is casts[-1]
        path = plane.coordinates(cast.track.path)
        axes.plot(*path[:, :2].T, color=BLUE if last else FAINT, linewidth=1.2 if last else 0.8)
        if np.isfinite(cast.outcome).all():
            near = plane.coordinates(cast.outcome)
            axes.plot(near[0], near[1], "o", color=BLUE if cast.hit else MUTED, markersize=4)
            annotate(axes, str(cast.try_number), (near[0], near[1]), (4, 3), halo=2.0, fontsize=7)
    cast = casts[-1]
    if cast.joint_path is not None and np.isfinite(cast.outcome).all():
        moves = JointMoves.of(setup)
        step = int(np.nanargmin(np.linalg.norm(cast.track.path - target, axis=1)))
        when = float(cast.track.times[step])
        joints = cast.track.joint_path or cast.joint_path
        shape = swing_shape(joints_at(joints, [when])[0], moves.arm, moves.stick)
        for ends in plane.coordinates(shape.ends):
            axes.plot(*ends[:, :2].T, color=MUTED, linewidth=4, solid_capstyle="round", zorder=1)
        if cast.track.nodes is not None:
            axes.plot(*plane.coordinates(cast.track.nodes[step])[:, :2].T, color=INK, linewidth=1)
    axes.plot(u, v, "o", color="none", markeredgecolor=INK, markersize=8, zorder=5)
    axes.set(aspect="equal", title=plane_text(target, plane))
    axes.set_xlabel("ahead of the base [m]", fontsize=8)
    axes.set_ylabel("height [m]", fontsize=8)
    draw_grid(axes)


def strike_page(
    tries: Sequence[Sequence[Cast]],
    setup: Setup,
    config: Mapping[str, Any],
    facts: Sequence[str],
    refusals: Sequence[str] = (),
) -> str:
    """Return the whole page, with its figure inside.

    Args:
        tries: Casts at each target, in order.
        setup: Set-up with a strike section.
        config: Contents of config.json.
        facts: Sentences about the cable and where it can be.
        refusals: Why each further target cannot be struck.
    """
    plane = SwingPlane.of(JointMoves.of(setup))
    rows = [
        (
            plane_text(cast.target_xy, plane),
            str(cast.try_number),
            str(cast.action),
            chance_text(cast.proposal.hit_chance),
            miss_text(cast),
            "hit" if cast.hit else "missed",
        )
        for casts in tries
        for cast in casts
        if cast.proposal is not None
    ]
    if note := _left_out(tries):
        facts = [f"{note} are drawn; the table below has every try", *facts]
    return render_template(
        "strike.html",
        cable=setup.cable,
        verdict=verdict_text(tries, len(refusals)),
        figure=svg_uri(strike_map(tries, setup)),
        facts=[*(f"{text[:1].upper()}{text[1:]}" for text in refusals), *facts],
        rows=rows,
        settings=[("Aiming", flatten_settings(config["settings"])), *run_settings(config)],
    )
