"""Draw the figures of docs/engine.md, docs/robot.md and docs/reset.md.

    python tools/make_docs_figures.py docs/images

docs/engine.md: the quantities that the engine computes with.

docs/robot.md: mounting, marker and tags, light, network. The arm, the table, the box, the tags and
the camera are those of examples/twin.yaml, so that the distances are those of a lab that works.

docs/reset.md: a cast lays the cable aside, and the reset brings it back, as the fast engine
simulates it. The side view shows height over distance from the base.
"""

import argparse
import dataclasses
import pathlib
from typing import Any

import numpy as np

from cablecast.arm.shape import GRIPPER_ROD_COUNT, arm_shape
from cablecast.camera.tags import default_layout
from cablecast.engines.warp_ import EngineWarp
from cablecast.files import write_bytes
from cablecast.motion.action import Action
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.grip_path import GripPath
from cablecast.motion.polar import reset_path, reset_pose
from cablecast.report.style import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    SKY,
    TABLE,
    VERMILLION,
    compact_png,
    new_figure,
    styled,
)
from cablecast.setup import Setup, load_setup

ROOT = pathlib.Path(__file__).parents[1]
DPI = 130
ACTION = Action(theta1=np.radians(-50), theta2=np.radians(35), r2=0.70, psi=np.radians(60))
"""Cast before the reset."""
SAMPLE_DT = 0.02
HANGING = 1e-9
"""Speed below which a gripper stands still [m/s]."""
LINK, GRIPPER = "#c4ccd6", "#52606d"
MARKER_GREEN = "#3fa34d"
POST_HEIGHT = 2.0
TIP_SPEED = 5.0
SWING = 1.7
"""How far the end of the cable swings [m]; docs/robot.md says so as well."""
HEADINGS_DEG = np.array([12.0, 40.0, 62.0, 56.0, 27.0, 2.0, 0.0])
"""Directions of the drawn chain's segments below the horizontal."""
SEGMENT_LENGTH, CABLE_RADIUS = 0.1, 0.012


def measure(axes: Any, start: Any, end: Any, text: str, offset: Any, **style: Any) -> None:
    """Draw a dimension: an arrow with two heads, and its name beside it."""
    axes.annotate(
        "",
        xy=end,
        xytext=start,
        arrowprops={
            "arrowstyle": "<->",
            "color": VERMILLION,
            "lw": 1.1,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )
    middle = (np.asarray(start, dtype=float) + np.asarray(end, dtype=float)) / 2
    axes.text(*(middle + offset), text, color=VERMILLION, **{"va": "center", **style})


def point_out(axes: Any, text: str, at: Any, place: Any, color: str = INK, **style: Any) -> None:
    """Write a text with a thin line to what it names."""
    line = {"arrowstyle": "-", "color": color, "lw": 0.7, "shrinkA": 2, "shrinkB": 2}
    axes.annotate(text, at, place, color=color, arrowprops=line, **style)


def draw_rods(axes: Any, setup: Setup, columns: tuple[int, int]) -> None:
    """Draw the arm in its reset pose, seen along the third axis.

    Args:
        axes: Axes in metres.
        setup: Lab.
        columns: Coordinates that are drawn across and upwards.
    """
    home = setup.arm.inverse(np.asarray(reset_pose(setup.workspace), dtype=float))
    shape = arm_shape(home[None], setup.arm)
    first_of_gripper = len(shape.radii) - GRIPPER_ROD_COUNT
    order = np.argsort(shape.ends[0, :, :, 2].max(axis=-1)) if columns == (0, 1) else range(99)
    for rod in [r for r in order if r < len(shape.radii)]:
        ends = shape.ends[0, rod][:, columns]
        along = np.linalg.norm(ends[1] - ends[0])
        normal = np.array([0.0, 1.0])
        if along > 1e-6:
            normal = np.array([ends[0, 1] - ends[1, 1], ends[1, 0] - ends[0, 0]]) / along
        turn = np.linspace(0.0, np.pi, 20)
        forward = np.array([normal[1], -normal[0]])
        cap = np.cos(turn)[:, None] * normal + np.sin(turn)[:, None] * forward
        radius = shape.radii[rod]
        outline = np.concatenate([ends[1] + radius * cap, ends[0] - radius * cap])
        color = GRIPPER if rod >= first_of_gripper else LINK
        axes.fill(*outline.T, facecolor=color, edgecolor=INK, linewidth=0.6)


def bare(axes: Any, title: str) -> None:
    """Prepare axes without ticks."""
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title(title)


def draw_side(axes: Any, setup: Setup) -> None:
    """Draw the lab from the side: y to the right, z up."""
    workspace, arm, cable = setup.workspace, setup.arm, setup.cable
    bare(axes, "a   from the side")
    floor, edge = -0.75, 0.12
    far, base = workspace.y_max, arm.base_height
    x, z = far / 2, POST_HEIGHT
    axes.plot([x, x], [floor, z], color="#e4e7eb", lw=5, zorder=0)
    draw_rods(axes, setup, (1, 2))
    # Before the arm's foot, which stands on it.
    axes.fill_between([-0.35, edge], floor, base, color=TABLE, lw=0, zorder=3)
    axes.plot([-0.35, edge], [base, base], color=MUTED, lw=1, zorder=3)
    axes.text(-0.32, -0.6, "stand, does\nnot sway", color=MUTED, va="center", zorder=4)
    axes.fill_between([edge + 0.02, far], -0.06, 0.0, color=TABLE, lw=0, zorder=3)
    axes.plot([edge + 0.02, far], [0, 0], color=MUTED, lw=1, zorder=3)
    axes.text(far, -0.14, "table", color=MUTED, ha="right")
    grip = np.array([workspace.reset_y, workspace.grip_height])
    end = workspace.reset_y + cable.length
    axes.plot([grip[0], end], [grip[1], cable.radius], color=BLUE, lw=2.5, zorder=4)
    axes.plot([end - 0.04, end], [cable.radius] * 2, color=MARKER_GREEN, lw=5, zorder=4)
    point_out(axes, "green marker", (end - 0.01, 0.03), (end - 0.06, 0.26), MARKER_GREEN)
    point_out(axes, "cable", (0.9, 0.0), (0.84, -0.2), BLUE)
    axes.fill([x - 0.05, x + 0.05, x + 0.05, x - 0.05], [z - 0.1, z - 0.1, z, z], color=INK)
    for y in (edge, far):
        axes.plot([x, y], [z - 0.1, 0.0], color=SKY, lw=0.8, ls="--", zorder=1)
    axes.text(x + 0.12, z - 0.05, "camera, level, sees\nthe whole table", va="center")
    axes.text(x + 0.05, -0.6, "post beside the table", color=MUTED, va="center")
    flange = grip[1] + arm.gripper_length
    measure(axes, (-0.45, 0.0), (-0.45, base), "base_height", (-0.03, 0.0), ha="right")
    for height in (0.0, base):
        axes.plot([-0.48, -0.35], [height, height], color=VERMILLION, lw=0.6)
    side = grip[0] + 0.12
    measure(axes, (side, grip[1]), (side, flange), "gripper_length", (0.03, 0.02))
    axes.plot([grip[0], side + 0.03], [flange, flange], color=VERMILLION, lw=0.6)
    axes.text(
        -0.8, 1.2, "The gripper points down,\nand holds the cable\nsideways, 2 cm above\nthe table."
    )
    axes.set(xlim=(-0.85, 1.72), ylim=(floor, 2.1))


def draw_above(axes: Any, setup: Setup) -> None:
    """Draw the lab from above: x to the right, y up."""
    workspace, robot = setup.workspace, setup.robot
    bare(axes, "b   from above")
    half = workspace.half_width
    x = [-half, half, half, -half]
    y = [workspace.y_min, workspace.y_min, workspace.y_max, workspace.y_max]
    axes.fill(x, y, facecolor=TABLE, edgecolor=MUTED)
    turn = np.linspace(0, 2 * np.pi, 200)
    axes.plot(SWING * np.sin(turn), SWING * np.cos(turn), color=VERMILLION, ls="--", lw=1.2)
    axes.text(
        0,
        -1.33,
        "keep clear: 1.7 m around the base,\nnobody inside while a command runs",
        color=VERMILLION,
        ha="center",
        va="center",
    )
    if robot is not None:
        low, high = robot.box_low, robot.box_high
        axes.plot(
            [low[0], high[0], high[0], low[0], low[0]],
            [low[1], low[1], high[1], high[1], low[1]],
            color=BLUE,
            lw=1.4,
        )
        axes.text(
            low[0] + 0.04,
            high[1] - 0.12,
            "box of the lab file,\nsafety planes",
            color=BLUE,
            va="top",
        )
        for obstacle in robot.obstacles:
            place = obstacle.start[:2]
            axes.plot(*place, "o", color=INK, markersize=7)
            point_out(axes, "camera post:\nan obstacle", place, (0.6, 1.15), ha="left")
    draw_rods(axes, setup, (0, 1))
    reset_y = workspace.reset_y
    axes.plot([0, 0], [reset_y, reset_y + setup.cable.length], color=BLUE, lw=2.5)
    axes.plot(
        [0, 0],
        [reset_y + setup.cable.length - 0.04, reset_y + setup.cable.length],
        color=MARKER_GREEN,
        lw=5,
    )
    axes.plot([-1.7, -1.57], [-1.38, -1.38], color=VERMILLION, lw=9, solid_capstyle="butt")
    axes.text(-1.72, -1.66, "you, with the\nemergency stop", color=VERMILLION)
    axes.text(0.0, 1.37, "table, symmetric about the arm's axis", color=MUTED, ha="center")
    axes.set(xlim=(-1.75, 1.75), ylim=(-1.75, 1.75))


def draw_mounting(setup: Setup) -> Any:
    """Return the figure of step 1."""
    figure = new_figure(10.0, 4.9)
    with styled():
        left, right = figure.subplots(1, 2)
        draw_side(left, setup)
        draw_above(right, setup)
    return figure


def draw_tags(axes: Any, setup: Setup) -> None:
    """Draw the tags on the table from above."""
    workspace = setup.workspace
    bare(axes, "a   tags on the table, flat, along its edges")
    half = workspace.half_width
    y = [workspace.y_min, workspace.y_min, workspace.y_max, workspace.y_max]
    axes.fill([-half, half, half, -half], y, facecolor=TABLE, edgecolor=MUTED)
    layout = default_layout(workspace)
    for tag in layout.tags:
        axes.fill(
            tag.x + np.array([-1, 1, 1, -1]) * 0.05,
            tag.y + np.array([-1, -1, 1, 1]) * 0.05,
            color=INK,
        )
        axes.plot([tag.x], [tag.y], "+", color="white", markersize=4)
        below = -0.12 if tag.y > 0.3 else 0.08
        axes.text(tag.x, tag.y + below, str(tag.id), ha="center", fontsize=7, color=MUTED)
    axes.plot(0, 0, "o", color=GRIPPER, markersize=12)
    axes.annotate(
        "x",
        (0.05, 0),
        (0.42, 0),
        color=BLUE,
        va="center",
        arrowprops={"arrowstyle": "<-", "color": BLUE},
    )
    axes.annotate(
        "y",
        (0, 0.06),
        (0, 0.42),
        color=BLUE,
        ha="center",
        arrowprops={"arrowstyle": "<-", "color": BLUE},
    )
    axes.text(0.0, -0.13, "axis of the first joint: x = y = 0", ha="center", color=BLUE)
    axes.text(
        0.0, 0.62, "measure each centre (+) from there,\nor let the robot touch them", ha="center"
    )
    axes.set(xlim=(-half - 0.05, half + 0.05), ylim=(-0.25, workspace.y_max + 0.08))


def draw_marker(axes: Any) -> None:
    """Draw the end of the cable with its marker, in millimetres."""
    bare(axes, "b   marker")
    axes.fill([-80, 0, 0, -80], [-4, -4, 4, 4], color=BLUE)
    axes.fill([-19, 19, 19, -19], [-8, -8, 8, 8], color=MARKER_GREEN)
    axes.fill([19, 45, 45, 19], [-2, -2, 2, 2], color=MUTED)
    axes.plot([0, 0], [-14, 30], color=INK, lw=0.8, ls="--")
    axes.text(0, 33, "the cable ends in the marker's middle", ha="center")
    measure(axes, (-19, -17), (19, -17), "38 mm", (0, -8), ha="center")
    measure(axes, (57, -8), (57, 8), "16 mm", (4, 0))
    axes.text(-80, 9, "cable", color=BLUE)
    axes.text(32, 6, "hook", color=MUTED, ha="center")
    axes.text(-80, -46, "green tape, all around the cable", color=MARKER_GREEN)
    axes.set(xlim=(-84, 84), ylim=(-52, 44))


def draw_blur(axes: Any) -> None:
    """Draw how far a moving marker smears, in millimetres."""
    bare(axes, f"c   light: a tip at {TIP_SPEED:g} m/s")
    rows = ((1 / 120, "1/120 s", "too long to tune with"), (1 / 1000, "1/1000 s", "sharp"))
    for row, (exposure, name, words) in enumerate(rows):
        smear = 1e3 * TIP_SPEED * exposure
        y = -34.0 * row
        for shift in np.linspace(0.0, smear, 40):
            axes.fill(
                shift + np.array([0, 38, 38, 0]),
                y + np.array([-8, -8, 8, 8]),
                color=MARKER_GREEN,
                alpha=min(1.0, 4.0 / 40 + (smear < 10) * 0.1),
                lw=0,
            )
        axes.plot([0, 38, 38, 0, 0], y + np.array([-8, -8, 8, 8, -8]), color=INK, lw=0.8)
        axes.text(-6, y, name, ha="right", va="center")
        axes.text(90, y, f"smears {smear:.0f} mm:\n{words}", va="center")
    axes.set(xlim=(-42, 165), ylim=(-50, 22))


def draw_seeing(setup: Setup) -> Any:
    """Return the figure of step 2."""
    figure = new_figure(10.0, 3.9)
    with styled():
        grid = figure.add_gridspec(2, 2, width_ratios=(1.55, 1.0))
        draw_tags(figure.add_subplot(grid[:, 0]), setup)
        draw_marker(figure.add_subplot(grid[0, 1]))
        draw_blur(figure.add_subplot(grid[1, 1]))
    return figure


def box(
    axes: Any, x: float, y: float, width: float, height: float, text: str, **style: Any
) -> None:
    """Draw a box with a text in its middle."""
    axes.fill(
        [x, x + width, x + width, x],
        [y, y, y + height, y + height],
        facecolor=style.pop("facecolor", TABLE),
        edgecolor=style.pop("edgecolor", INK),
        linewidth=1.0,
    )
    axes.text(x + width / 2, y + height / 2, text, ha="center", va="center", **style)


def draw_network() -> Any:
    """Return the figure of step 3."""
    figure = new_figure(10.0, 3.4)
    with styled():
        left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1.45, 1.0)})
        bare(left, "a   a cable of your own, and fixed addresses")
        box(left, 0, 1.2, 2.3, 1.5, "your computer\ncablecast\n192.168.1.10")
        box(
            left,
            4.6,
            1.2,
            2.5,
            1.5,
            "controller of the arm\n192.168.1.20\n(address of the lab file)",
        )
        left.plot([2.3, 4.6], [1.95, 1.95], color=BLUE, lw=3)
        left.text(3.45, 2.1, "network cable", color=BLUE, ha="center")
        left.text(
            3.45,
            1.76,
            "29999  dashboard\n30002  programs\n30004  RTDE",
            color=MUTED,
            ha="center",
            va="top",
            fontsize=8,
        )
        box(left, 0.2, -0.6, 1.9, 0.9, "camera\nUSB or stream", edgecolor=MUTED)
        left.plot([1.15, 1.15], [0.3, 1.2], color=MUTED, lw=2)
        box(left, 4.9, -0.6, 1.9, 0.9, "pendant with\nemergency stop", edgecolor=VERMILLION)
        left.plot([5.85, 5.85], [0.3, 1.2], color=MUTED, lw=2)
        left.text(
            3.45,
            -0.2,
            "no Wi-Fi:\nafter 0.2 s of silence\nthe controller stops the arm",
            color=VERMILLION,
            ha="center",
            va="center",
        )
        left.set(xlim=(-0.2, 7.3), ylim=(-0.8, 2.9))
        bare(right, "b   remote control, on an e-Series")
        box(right, 0, 0, 4.6, 2.9, "", facecolor="#ffffff")
        right.fill([0, 4.6, 4.6, 0], [2.45, 2.45, 2.9, 2.9], color=INK)
        right.text(
            0.1, 2.67, "Run   Program   Installation   Move", color="white", va="center", fontsize=8
        )
        box(
            right,
            3.55,
            2.5,
            0.95,
            0.35,
            "Remote",
            facecolor=GREEN,
            edgecolor=GREEN,
            color="white",
            fontsize=8,
        )
        steps = (
            "1  Settings, System, Remote Control: enable",
            "2  this button, upper right corner: Remote",
            "3  Settings, Security, Services: allow",
            "    29999, 30002, 30004",
            "4  speed slider: 100 %",
            "5  Installation, Payload: as in the lab file",
        )
        for row, text in enumerate(steps):
            right.text(0.15, 2.15 - 0.36 * row, text, va="center", fontsize=8.5)
        point_out(right, "", (4.02, 2.48), (3.3, 1.8), GREEN)
        right.set(xlim=(-0.1, 4.8), ylim=(-0.15, 3.0))
    return figure


def simulate() -> tuple[GripPath, np.ndarray, np.ndarray]:
    """Return the gripper's path through a reset after a cast, and the cable's shapes in it.

    Returns:
        Path, times [s], and nodes [m], shape [step, node, 3].
    """
    setup, engine = Setup(), EngineWarp()
    cable = setup.cable
    # The engine's cable ends at the endpoint; with the hook it is as long as the real one.
    whole = dataclasses.replace(
        cable, length=cable.length + cable.attachment_length, attachment_length=0.0
    )
    cast = cast_grip_paths(ACTION.to_array()[None], setup)
    thrown = engine.rollout(whole, cast).final_state
    path = reset_path(cast.evaluate(cast.duration[:, None])[0, 0], setup)
    rollout = engine.rollout(whole, path, thrown, sample_dt=SAMPLE_DT, record_nodes=True)
    if rollout.nodes is None:
        raise SystemExit("the engine records no shapes")
    return path, rollout.times, rollout.nodes[0]


def phases(path: GripPath, times: np.ndarray) -> list[tuple[str, float, float]]:
    """Return name, beginning and end [s] of each part; at both the gripper stands still."""
    speed = np.abs(path.evaluate(times, 1)[0]).max(axis=1)
    height = path.evaluate(times)[0, :, 2]
    still = speed < HANGING
    hang = times[still & (height > height.max() / 2) & (times < path.duration[0])]
    low = times[still & (height < height.max() / 2) & (times > hang[-1])]
    return [("lift", 0.0, hang[0]), ("swing", hang[-1], low[0])]


def draw_reset() -> Any:
    """Return the figure of a reset: from the side, and the cable before and after from above."""
    path, times, nodes = simulate()
    grip = path.evaluate(times)[0]
    figure = new_figure(9.0, 2.9)
    with styled():
        panels = figure.subplots(1, 3, gridspec_kw={"width_ratios": (1.5, 1.5, 1)})
        for axes, (name, begin, end) in zip(panels[:2], phases(path, times), strict=True):
            rows = np.flatnonzero((times >= begin) & (times <= end + SAMPLE_DT))
            # Seen from the side: distance from the base's axis.
            radius = np.hypot(nodes[..., 0], nodes[..., 1])
            for row in rows[np.linspace(0, len(rows) - 1, 9).round().astype(int)]:
                share = (times[row] - begin) / max(end - begin, 1e-9)
                axes.plot(
                    radius[row], nodes[row, :, 2], color=BLUE, alpha=0.2 + 0.8 * min(share, 1.0)
                )
                axes.plot(radius[row, -1], nodes[row, -1, 2], "o", color=VERMILLION, markersize=3)
            axes.plot(np.hypot(grip[rows, 0], grip[rows, 1]), grip[rows, 2], color=INK, lw=1.2)
            axes.axhline(0.0, color=MUTED, lw=1.0)
            axes.set(xlim=(0, 1.65), ylim=(-0.06, 0.95), xlabel="distance from the base [m]")
            axes.set_aspect("equal")
            axes.set_title(f"{name}, {end - begin:.1f} s")
        panels[0].set_ylabel("height [m]")
        axes = panels[2]
        axes.plot(*nodes[0, :, :2].T, color=SKY, lw=2, label="before")
        axes.plot(*nodes[-1, :, :2].T, color=BLUE, lw=2, label="after")
        for row in (0, -1):
            axes.plot(*nodes[row, -1, :2], "o", color=VERMILLION, markersize=4)
        axes.set(xlim=(-0.55, 0.55), ylim=(0.35, 1.45), xlabel="x [m]", ylabel="y [m]")
        axes.set_aspect("equal")
        axes.set_title("after the pull, from above")
        axes.legend(loc="upper left")
    return figure


def arrow(axes: Any, start: Any, end: Any, color: str) -> None:
    """Draw an arrow from start to end."""
    axes.annotate(
        "",
        xy=end,
        xytext=start,
        arrowprops={
            "arrowstyle": "-|>,head_width=0.22,head_length=0.4",
            "color": color,
            "linewidth": 1.4,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )


def chain_nodes() -> np.ndarray:
    """Return nodes (y, z) of a cable that comes down from a grip to the table, shape [node, 2]."""
    angle = -np.radians(HEADINGS_DEG)
    edges = SEGMENT_LENGTH * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    nodes = np.vstack([np.zeros(2), np.cumsum(edges, axis=0)])
    return nodes - [0.0, nodes[-1, 1]]


def draw_chain(axes: Any) -> None:
    """Draw a cable as the engine sees it: segments between nodes, with what acts on them."""
    nodes = chain_nodes()
    edges = np.diff(nodes, axis=0)
    table, left, right = -CABLE_RADIUS, -0.12, 0.62
    axes.fill_between([left, right], table, table - 0.02, color=TABLE, linewidth=0)
    axes.plot([left, right], [table, table], color=MUTED, linewidth=1.0)
    # Cells reach from the middle of one segment to the middle of the next; half a cell at the ends.
    middles = 0.5 * (nodes[1:] + nodes[:-1])
    count = len(edges)
    for node in range(count + 1):
        first = middles[node - 1] if node > 0 else nodes[0]
        last = middles[node] if node < count else nodes[-1]
        cell = np.stack([first, nodes[node], last])
        color = SKY if node % 2 == 0 else BLUE
        axes.plot(*cell.T, color=color, linewidth=9, alpha=0.5, solid_capstyle="butt")
    axes.plot(*nodes.T, color=INK, linewidth=1.0)
    axes.plot(*nodes[1:-1].T, "o", color=INK, markersize=5)
    axes.plot(*nodes[-1], "o", color=VERMILLION, markersize=10)

    x, z = nodes[0]
    axes.fill([x - 0.1, x, x, x - 0.1], [z - 0.03, z - 0.03, z + 0.03, z + 0.03], INK)
    axes.plot([x, x + 0.1], [z, z], color=VERMILLION, linewidth=1.0, linestyle="--")
    axes.text(x - 0.1, z + 0.04, "gripper: holds place, direction and roll", va="bottom")
    half, whole = 0.5 * (middles[0] + nodes[0]), 0.5 * (nodes[2] + middles[2])
    point_out(axes, "half a cell", half, half + [-0.1, -0.1], BLUE)
    point_out(axes, "cell of a node", whole, whole + [-0.2, -0.06], BLUE)

    # The angle at a node.
    node = 2
    before, after = edges[node - 1], edges[node]
    axes.plot(
        *np.stack([nodes[node], nodes[node] + before]).T,
        color=VERMILLION,
        linewidth=1.0,
        linestyle="--",
    )
    first, last = np.arctan2([after[1], before[1]], [after[0], before[0]])
    arc = np.linspace(first, last, 20)
    bow = nodes[node] + 0.075 * np.stack([np.cos(arc), np.sin(arc)], axis=1)
    axes.plot(*bow.T, color=VERMILLION, linewidth=1.2)
    point_out(axes, "angle φ:\nenergy EI φ² / (2 l)", bow[14], bow[14] + [0.06, 0.05], VERMILLION)

    # The length of a segment.
    across = np.array([-edges[3][1], edges[3][0]]) / SEGMENT_LENGTH * 0.03
    ends = nodes[3:5] + across
    axes.annotate(
        "",
        ends[1],
        ends[0],
        arrowprops={"arrowstyle": "<->", "color": MUTED, "shrinkA": 0, "shrinkB": 0},
    )
    axes.text(*(ends.mean(axis=0) + [0.012, 0.0]), "length l, fixed", color=MUTED)

    # Weight and normal force where the cable lies.
    arrow(axes, nodes[4], nodes[4] - [0, 0.05], INK)
    axes.text(nodes[4, 0] - 0.012, nodes[4, 1] - 0.04, "m g", ha="right")
    arrow(axes, nodes[6] - [0, CABLE_RADIUS], nodes[6] + [0, 0.075], GREEN)
    axes.text(nodes[6, 0] - 0.012, nodes[6, 1] + 0.055, "N", ha="right", color=GREEN)
    point_out(
        axes,
        "free end: half a segment\nand the attachment",
        nodes[-1],
        nodes[-1] + [-0.04, 0.1],
        VERMILLION,
    )
    axes.set_xlim(left - 0.01, right + 0.04)
    axes.set_ylim(-0.06, nodes[0, 1] + 0.08)
    bare(axes, "a   A chain of segments between nodes")


def draw_cone(axes: Any) -> None:
    """Draw Coulomb's cone at a node."""
    axes.fill_between([-1.15, 1.15], 0, -0.12, color=TABLE, linewidth=0)
    axes.plot([-1.15, 1.15], [0, 0], color=MUTED, linewidth=1.0)
    normal, friction = 1.1, 0.5
    half = friction * normal
    axes.fill([0, -half, half], [0, normal, normal], color=SKY, alpha=0.35, linewidth=0)
    turn = np.linspace(0, 2 * np.pi, 80)
    axes.fill(half * np.cos(turn), normal + 0.09 * np.sin(turn), color=SKY, alpha=0.55, linewidth=0)
    arrow(axes, (0, 0), (0, normal), INK)
    axes.text(0.05, normal + 0.16, "N", ha="center")
    arrow(axes, (0, 0), (-half, normal), VERMILLION)
    axes.text(-half - 0.07, normal + 0.14, "slides: μ N\nagainst the sliding", ha="right")
    axes.texts[-1].set_color(VERMILLION)
    arrow(axes, (0, 0), (0.2, normal), GREEN)
    axes.text(half + 0.06, normal + 0.14, "sticks:\ninside", color=GREEN, ha="left")
    arrow(axes, (0.12, 0.12), (0.72, 0.12), BLUE)
    axes.text(0.78, 0.24, "contact's\nvelocity", color=BLUE, va="center")
    axes.plot(0, 0, "o", color=INK, markersize=5)
    axes.set_xlim(-1.5, 1.45)
    axes.set_ylim(-0.2, 1.75)
    bare(axes, "b   Coulomb's cone at each node")


def draw_roll(axes: Any) -> None:
    """Draw a segment that slides and rolls, seen from its end."""
    axes.fill_between([-1.3, 1.3], -1, -1.12, color=TABLE, linewidth=0)
    axes.plot([-1.3, 1.3], [-1, -1], color=MUTED, linewidth=1.0)
    turn = np.linspace(0, 2 * np.pi, 120)
    axes.fill(np.cos(turn), np.sin(turn), color=SKY, alpha=0.35, linewidth=0)
    axes.plot(np.cos(turn), np.sin(turn), color=BLUE, linewidth=1.2)
    axes.plot([0, 0], [0, -1], color=MUTED, linewidth=0.9, linestyle="--")
    axes.text(0.07, -0.62, "R", color=MUTED)
    arrow(axes, (0, 0), (1.25, 0), INK)
    axes.text(1.3, 0.0, "v", va="center")
    arc = np.radians(np.linspace(150, 40, 30))
    axes.plot(0.62 * np.cos(arc), 0.62 * np.sin(arc), color=BLUE, linewidth=1.4)
    arrow(
        axes,
        (0.62 * np.cos(arc[-3]), 0.62 * np.sin(arc[-3])),
        (0.62 * np.cos(arc[-1]), 0.62 * np.sin(arc[-1])),
        BLUE,
    )
    axes.text(0, 0.74, "spin ω", color=BLUE, ha="center")
    axes.plot(0, 0, "o", color=INK, markersize=4)
    arrow(axes, (0, -1), (0.55, -1), BLUE)
    axes.text(0.6, -0.86, "v − ω R", color=BLUE, va="center")
    axes.text(0, -1.2, "friction ≤ μ N on v − ω R\ntorque ≤ ρ N against ω", ha="center", va="top")
    axes.set_xlim(-1.5, 1.6)
    axes.set_ylim(-1.85, 1.15)
    bare(axes, "c   A segment from its end")


def draw_engine() -> Any:
    """Return the figure of the engine's quantities."""
    figure = new_figure(8.6, 4.8)
    with styled():
        grid = figure.add_gridspec(2, 2, width_ratios=(1.9, 1.0))
        draw_chain(figure.add_subplot(grid[:, 0]))
        draw_cone(figure.add_subplot(grid[0, 1]))
        draw_roll(figure.add_subplot(grid[1, 1]))
    return figure


def main() -> None:
    """Draw and write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=pathlib.Path, help="folder of the PNG files")
    out = parser.parse_args().out
    setup = load_setup(ROOT / "examples" / "twin.yaml")
    for name, figure in (
        ("engine.png", draw_engine()),
        ("reset.png", draw_reset()),
        ("robot-mounting.png", draw_mounting(setup)),
        ("robot-marker.png", draw_seeing(setup)),
        ("robot-network.png", draw_network()),
    ):
        content = compact_png(figure, DPI)
        write_bytes(out / name, content)
        print(f"{out / name}: {len(content) / 1024:.0f} KB")


if __name__ == "__main__":
    main()
