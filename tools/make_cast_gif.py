"""Draw casts as a moving picture, from the report of an evaluation.

    python tools/make_cast_gif.py runs/cable_1/evaluate-virtual/report.html docs/images/casts.gif

The report holds the table, and the shapes of the cable every 0.1 s; the frames between are
interpolated. The arm is drawn as it is seen from above: a straight line from base to gripper.
"""

import argparse
import io
import json
import pathlib
import re

import numpy as np

from cablecast.files import JSON_SIZE_MAX, read_text, write_bytes
from cablecast.report.style import (
    BLUE,
    INK,
    MUTED,
    SKY,
    VERMILLION,
    draw_workspace,
    new_figure,
    styled,
    workspace_view,
)
from cablecast.workspace import Workspace

FRAMES_PER_SECOND = 20
REST_SECONDS = 0.7  # Time that the landed cable is shown before the next cast.
TRAIL_SECONDS = 0.5  # Length of the trail behind the free end, in time.
WIDTH = 6.4  # [inch]
DPI = 100
COLORS = 48


def read_casts(report: pathlib.Path) -> tuple[list[dict], Workspace]:
    """Return the casts that a report's player shows (target, times, shapes), and its table."""
    page = read_text(report, JSON_SIZE_MAX)
    pattern = r'<script type="application/json" id="casts">(.*?)</script>'
    found = re.search(pattern, page, re.DOTALL)
    if found is None:
        raise SystemExit(f"{report} holds no casts: its rig does not see the shape of the cable")
    player = json.loads(found.group(1))
    return player["casts"], Workspace.from_dict(player["workspace"])


def choose_casts(casts: list[dict], count: int) -> list[dict]:
    """Choose the casts that landed nearest, none on neighbouring targets, from left to right.

    Args:
        casts: All casts.
        count: Largest number of casts.
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
    """Return the shapes of the cable at the frames of the picture [m], shape [frame, node, 2]."""
    from scipy.interpolate import PchipInterpolator

    times = np.array(cast["times"])
    nodes = np.array(cast["nodes_mm"]).reshape(len(times), -1, 2) / 1000.0
    at = np.arange(0.0, times[-1], 1 / FRAMES_PER_SECOND)
    # Piecewise cubic without overshoot: a cable at rest stays at rest between two samples.
    return PchipInterpolator(times, nodes, axis=0)(at)


def draw(casts: list[dict], workspace: Workspace) -> list:
    """Return all frames as images."""
    from PIL import Image

    view = workspace_view(workspace)
    figure = new_figure(WIDTH, view.height(WIDTH))
    images = []
    with styled():
        axes = figure.add_subplot()
        draw_workspace(axes, workspace, view, ticks=False)
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
        corner = (-workspace.half_width + 0.04, workspace.y_max - 0.05)
        label = axes.text(*corner, "", va="top", zorder=9)
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
    """Return the images as one GIF with one palette; it stores only changes between frames."""
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
    parser.add_argument("--count", type=int, default=4, help="number of casts")
    arguments = parser.parse_args()
    casts, workspace = read_casts(arguments.report)
    casts = choose_casts(casts, arguments.count)
    if not casts:
        raise SystemExit(f"{arguments.report} holds no cast that landed")
    content = gif_bytes(draw(casts, workspace))
    write_bytes(arguments.out, content)
    print(f"{arguments.out}: {len(casts)} casts, {len(content) / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
