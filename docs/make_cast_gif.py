"""Draw casts as a moving picture, from the report of an evaluation.

    .venv/bin/python docs/make_cast_gif.py runs/cable_1/evaluate-virtual/report.html docs/casts.gif

The report holds the shapes of the cable every 0.1 s; what lies between is interpolated. The arm is
drawn as the straight line from its base to the gripper that it is when seen from above.
"""

import argparse
import io
import json
import pathlib
import re

import numpy as np

from cablecast.files import write_bytes
from cablecast.report.style import (
    BLUE,
    INK,
    MUTED,
    SKY,
    VERMILLION,
    draw_workspace,
    new_figure,
    styled,
)
from cablecast.workspace import Workspace

FRAMES_PER_SECOND = 20
REST_SECONDS = 0.7  # How long the landed cable is looked at before the next cast.
TRAIL_SECONDS = 0.5  # How much of the free end's way is drawn behind it.
SIZE_INCHES = (6.4, 3.75)
DPI = 100
COLORS = 48


def read_casts(report: pathlib.Path) -> list[dict]:
    """The casts that a report's player shows: target, times, shapes."""
    found = re.search(
        r'<script type="application/json" id="casts">(.*?)</script>', report.read_text(), re.DOTALL
    )
    if found is None:
        raise SystemExit(f"{report} holds no casts: its rig does not see the shape of the cable")
    return json.loads(found.group(1))["casts"]


def choose_casts(casts: list[dict], count: int) -> list[dict]:
    """The casts that landed nearest, no two of them on neighbouring targets, from left to right.

    Args:
        casts: All casts.
        count: How many.
    """
    landed = [cast for cast in casts if cast["status"] == "ok"]
    landed.sort(key=lambda cast: float(cast["error"]))
    # The picture shows what the method can do where it works; the error stands beside each.
    chosen: list[dict] = []
    for cast in landed[: max(len(landed) // 2, count)]:
        apart = [np.hypot(*np.subtract(cast["target_mm"], c["target_mm"])) for c in chosen]
        if min(apart, default=np.inf) > 500:
            chosen.append(cast)
    return sorted(chosen[:count], key=lambda cast: cast["target_mm"][0])


def frames_of(cast: dict) -> np.ndarray:
    """Shapes of the cable at the frames of the picture [m], shape [frame, node, 2]."""
    from scipy.interpolate import PchipInterpolator

    times = np.array(cast["times"])
    nodes = np.array(cast["nodes_mm"]).reshape(len(times), -1, 2) / 1000.0
    at = np.arange(0.0, times[-1], 1 / FRAMES_PER_SECOND)
    # Piecewise cubic without overshoot: a cable at rest stays at rest between two samples.
    return PchipInterpolator(times, nodes, axis=0)(at)


def draw(casts: list[dict], workspace: Workspace) -> list:
    """All frames as images."""
    from PIL import Image

    figure = new_figure(*SIZE_INCHES)
    images = []
    with styled():
        axes = figure.add_subplot()
        draw_workspace(axes, workspace, ticks=False)
        half_width = workspace.table_width / 2
        axes.set_xlim(-half_width - 0.03, half_width + 0.03)
        axes.set_ylim(-0.1, workspace.table_depth + 0.1)
        for cast in casts:
            axes.plot(*np.divide(cast["target_mm"], 1000), "+", color=MUTED, markersize=9, zorder=3)
        (arm,) = axes.plot([], [], color=INK, linewidth=6, solid_capstyle="round", zorder=5)
        (grip,) = axes.plot([], [], "o", color="white", markeredgecolor=INK, markersize=6, zorder=7)
        (trail,) = axes.plot([], [], color=SKY, linewidth=1.2, zorder=2)
        (cable,) = axes.plot([], [], color=BLUE, linewidth=2.6, solid_capstyle="round", zorder=6)
        (tip,) = axes.plot([], [], "o", color=VERMILLION, markersize=6, zorder=8)
        (cross,) = axes.plot(
            [], [], "+", color=VERMILLION, markersize=15, markeredgewidth=2.4, zorder=4
        )
        label = axes.text(-half_width + 0.04, workspace.table_depth - 0.05, "", va="top", zorder=9)
        for cast in casts:
            shapes = frames_of(cast)
            cross.set_data(*[[value / 1000.0] for value in cast["target_mm"]])
            for frame, nodes in enumerate(shapes):
                arm.set_data([0.0, nodes[0, 0]], [0.0, nodes[0, 1]])
                grip.set_data(*[[value] for value in nodes[0]])
                cable.set_data(*nodes.T)
                tip.set_data(*[[value] for value in nodes[-1]])
                since = max(0, frame - round(TRAIL_SECONDS * FRAMES_PER_SECOND))
                trail.set_data(*shapes[since : frame + 1, -1].T)
                is_last = frame == len(shapes) - 1
                label.set_text(
                    f"{cast['error']} % of the cable's length from the target" if is_last else ""
                )
                buffer = io.BytesIO()
                figure.savefig(buffer, format="png", dpi=DPI)
                image = Image.open(buffer).convert("RGB")
                rest = round(REST_SECONDS * FRAMES_PER_SECOND) if is_last else 1
                images += [image] * rest
    return images


def gif_bytes(images: list) -> bytes:
    """The images as one GIF with one palette; a GIF stores only what changes between frames."""
    from PIL import Image

    palette = images[-1].quantize(COLORS, method=Image.Quantize.MEDIANCUT)
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    buffer = io.BytesIO()
    frames[0].save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=frames[1:],
        duration=1000 // FRAMES_PER_SECOND,
        loop=0,
        optimize=True,
        disposal=1,
    )
    return buffer.getvalue()


def main() -> None:
    """Read, draw and write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("report", type=pathlib.Path, help="report.html of an evaluation")
    parser.add_argument("out", type=pathlib.Path, help="the GIF to write")
    parser.add_argument("--count", type=int, default=4, help="how many casts")
    arguments = parser.parse_args()
    casts = choose_casts(read_casts(arguments.report), arguments.count)
    content = gif_bytes(draw(casts, Workspace()))
    write_bytes(arguments.out, content)
    print(f"{arguments.out}: {len(casts)} casts, {len(content) / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
