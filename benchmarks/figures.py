"""Draw the figure of docs/engine.md: the quantities that the engine computes with."""

import dataclasses
import pathlib

import numpy as np

from cablecast import files
from cablecast.report import style

# Directions of the segments in the drawing, below the horizontal; all have the same length.
HEADINGS_DEG = np.array([12.0, 40.0, 62.0, 56.0, 27.0, 2.0, 0.0])
SEGMENT_LENGTH = 0.1
CABLE_RADIUS = 0.012


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Figures of the documentation that are drawn by a program.

    Attributes:
        docs: Folder that gets images/engine.png.
    """

    docs: pathlib.Path = pathlib.Path("docs")


def arrow(axes, start, end, color, width=1.4):
    axes.annotate(
        "",
        xy=end,
        xytext=start,
        arrowprops={
            "arrowstyle": "-|>,head_width=0.22,head_length=0.4",
            "color": color,
            "linewidth": width,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )


def bare(axes, title: str) -> None:
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title(title)


def chain_nodes():
    """Return nodes (y, z) of a cable that comes down from a grip to the table, shape [node, 2]."""
    angle = -np.radians(HEADINGS_DEG)
    edges = SEGMENT_LENGTH * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    nodes = np.vstack([np.zeros(2), np.cumsum(edges, axis=0)])
    return nodes - [0.0, nodes[-1, 1]]


def label(axes, text, at, place, color) -> None:
    """Write a text with a thin line to the thing that it names."""
    axes.annotate(
        text,
        at,
        np.asarray(at) + place,
        color=color,
        arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.6, "shrinkB": 4},
    )


def draw_chain(axes) -> None:
    nodes = chain_nodes()
    edges = np.diff(nodes, axis=0)
    table, left, right = -CABLE_RADIUS, -0.12, 0.62
    axes.fill_between([left, right], table, table - 0.02, color=style.TABLE, linewidth=0)
    axes.plot([left, right], [table, table], color=style.MUTED, linewidth=1.0)
    # Cells reach from the middle of one segment to the middle of the next; half a cell at the ends.
    middles = 0.5 * (nodes[1:] + nodes[:-1])
    count = len(edges)
    for node in range(count + 1):
        first = middles[node - 1] if node > 0 else nodes[0]
        last = middles[node] if node < count else nodes[-1]
        cell = np.stack([first, nodes[node], last])
        color = style.SKY if node % 2 == 0 else style.BLUE
        axes.plot(*cell.T, color=color, linewidth=9, alpha=0.5, solid_capstyle="butt")
    axes.plot(*nodes.T, color=style.INK, linewidth=1.0)
    axes.plot(*nodes[1:-1].T, "o", color=style.INK, markersize=5)
    axes.plot(*nodes[-1], "o", color=style.VERMILLION, markersize=10)

    x, z = nodes[0]
    axes.fill([x - 0.1, x, x, x - 0.1], [z - 0.03, z - 0.03, z + 0.03, z + 0.03], style.INK)
    axes.plot([x, x + 0.1], [z, z], color=style.VERMILLION, linewidth=1.0, linestyle="--")
    axes.text(x - 0.1, z + 0.04, "gripper: holds place, direction and roll", va="bottom")
    label(axes, "half a cell", 0.5 * (middles[0] + nodes[0]), [-0.1, -0.1], style.BLUE)
    label(axes, "cell of a node", 0.5 * (nodes[2] + middles[2]), [-0.2, -0.06], style.BLUE)

    # The angle at a node.
    node = 2
    before, after = edges[node - 1], edges[node]
    axes.plot(
        *np.stack([nodes[node], nodes[node] + before]).T,
        color=style.VERMILLION,
        linewidth=1.0,
        linestyle="--",
    )
    first, last = np.arctan2([after[1], before[1]], [after[0], before[0]])
    arc = np.linspace(first, last, 20)
    bow = nodes[node] + 0.075 * np.stack([np.cos(arc), np.sin(arc)], axis=1)
    axes.plot(*bow.T, color=style.VERMILLION, linewidth=1.2)
    label(axes, "angle φ:\nenergy EI φ² / (2 l)", bow[14], [0.06, 0.05], style.VERMILLION)

    # The length of a segment.
    across = np.array([-edges[3][1], edges[3][0]]) / SEGMENT_LENGTH * 0.03
    ends = nodes[3:5] + across
    axes.annotate(
        "",
        ends[1],
        ends[0],
        arrowprops={"arrowstyle": "<->", "color": style.MUTED, "shrinkA": 0, "shrinkB": 0},
    )
    axes.text(*(ends.mean(axis=0) + [0.012, 0.0]), "length l, fixed", color=style.MUTED)

    # Weight and normal force where the cable lies.
    arrow(axes, nodes[4], nodes[4] - [0, 0.05], style.INK)
    axes.text(nodes[4, 0] - 0.012, nodes[4, 1] - 0.04, "m g", ha="right")
    arrow(axes, nodes[6] - [0, CABLE_RADIUS], nodes[6] + [0, 0.075], style.GREEN)
    axes.text(nodes[6, 0] - 0.012, nodes[6, 1] + 0.055, "N", ha="right", color=style.GREEN)
    label(
        axes,
        "free end: half a segment\nand the attachment",
        nodes[-1],
        [-0.04, 0.1],
        style.VERMILLION,
    )
    axes.set_xlim(left - 0.01, right + 0.04)
    axes.set_ylim(-0.06, nodes[0, 1] + 0.08)
    bare(axes, "a   A chain of segments between nodes")


def draw_cone(axes) -> None:
    axes.fill_between([-1.15, 1.15], 0, -0.12, color=style.TABLE, linewidth=0)
    axes.plot([-1.15, 1.15], [0, 0], color=style.MUTED, linewidth=1.0)
    normal, friction = 1.1, 0.5
    half = friction * normal
    axes.fill([0, -half, half], [0, normal, normal], color=style.SKY, alpha=0.35, linewidth=0)
    turn = np.linspace(0, 2 * np.pi, 80)
    axes.fill(
        half * np.cos(turn), normal + 0.09 * np.sin(turn), color=style.SKY, alpha=0.55, linewidth=0
    )
    arrow(axes, (0, 0), (0, normal), style.INK)
    axes.text(0.05, normal + 0.16, "N", ha="center")
    arrow(axes, (0, 0), (-half, normal), style.VERMILLION)
    axes.text(-half - 0.07, normal + 0.14, "slides: μ N\nagainst the sliding", ha="right")
    axes.texts[-1].set_color(style.VERMILLION)
    arrow(axes, (0, 0), (0.2, normal), style.GREEN)
    axes.text(half + 0.06, normal + 0.14, "sticks:\ninside", color=style.GREEN, ha="left")
    arrow(axes, (0.12, 0.12), (0.72, 0.12), style.BLUE)
    axes.text(0.78, 0.24, "contact's\nvelocity", color=style.BLUE, va="center")
    axes.plot(0, 0, "o", color=style.INK, markersize=5)
    axes.set_xlim(-1.5, 1.45)
    axes.set_ylim(-0.2, 1.75)
    bare(axes, "b   Coulomb's cone at each node")


def draw_roll(axes) -> None:
    axes.fill_between([-1.3, 1.3], -1, -1.12, color=style.TABLE, linewidth=0)
    axes.plot([-1.3, 1.3], [-1, -1], color=style.MUTED, linewidth=1.0)
    turn = np.linspace(0, 2 * np.pi, 120)
    axes.fill(np.cos(turn), np.sin(turn), color=style.SKY, alpha=0.35, linewidth=0)
    axes.plot(np.cos(turn), np.sin(turn), color=style.BLUE, linewidth=1.2)
    axes.plot([0, 0], [0, -1], color=style.MUTED, linewidth=0.9, linestyle="--")
    axes.text(0.07, -0.62, "R", color=style.MUTED)
    arrow(axes, (0, 0), (1.25, 0), style.INK)
    axes.text(1.3, 0.0, "v", va="center")
    arc = np.radians(np.linspace(150, 40, 30))
    axes.plot(0.62 * np.cos(arc), 0.62 * np.sin(arc), color=style.BLUE, linewidth=1.4)
    arrow(
        axes,
        (0.62 * np.cos(arc[-3]), 0.62 * np.sin(arc[-3])),
        (0.62 * np.cos(arc[-1]), 0.62 * np.sin(arc[-1])),
        style.BLUE,
    )
    axes.text(0, 0.74, "spin ω", color=style.BLUE, ha="center")
    axes.plot(0, 0, "o", color=style.INK, markersize=4)
    arrow(axes, (0, -1), (0.55, -1), style.BLUE)
    axes.text(0.6, -0.86, "v − ω R", color=style.BLUE, va="center")
    axes.text(0, -1.2, "friction ≤ μ N on v − ω R\ntorque ≤ ρ N against ω", ha="center", va="top")
    axes.set_xlim(-1.5, 1.6)
    axes.set_ylim(-1.85, 1.15)
    bare(axes, "c   A segment from its end")


def main(args: Args) -> None:
    figure = style.new_figure(8.6, 4.8)
    with style.styled():
        grid = figure.add_gridspec(2, 2, width_ratios=(1.9, 1.0))
        draw_chain(figure.add_subplot(grid[:, 0]))
        draw_cone(figure.add_subplot(grid[0, 1]))
        draw_roll(figure.add_subplot(grid[1, 1]))
    images = args.docs / "images"
    images.mkdir(parents=True, exist_ok=True)
    files.write_bytes(images / "engine.png", style.compact_png(figure, 150))
    print(f"written: {images / 'engine.png'}")
