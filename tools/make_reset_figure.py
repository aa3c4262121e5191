"""Draw the reset from the side, as the fast engine simulates it.

    python tools/make_reset_figure.py docs/images/reset.png

A cast lays the cable aside, and the reset brings it back. The side view shows height over distance
from the base; the view from above shows the cable before and after.
"""

import argparse
import dataclasses
import pathlib

import numpy as np

from cablecast.engines.warp_ import EngineWarp
from cablecast.files import write_bytes
from cablecast.motion.action import Action
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.grip_path import GripPath
from cablecast.motion.polar import reset_path
from cablecast.report.style import (
    BLUE,
    INK,
    MUTED,
    SKY,
    VERMILLION,
    compact_png,
    new_figure,
    styled,
)
from cablecast.setup import Setup

ACTION = Action(theta1=np.radians(-50), theta2=np.radians(35), r2=0.70, psi=np.radians(60))
SAMPLE_DT = 0.02
HANGING = 1e-9
"""Speed below which a gripper stands still [m/s]."""


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
    return [
        ("lift", 0.0, hang[0]),
        ("swing", hang[-1], low[0]),
    ]


def main() -> None:
    """Simulate, draw and write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=pathlib.Path, help="the PNG to write")
    out = parser.parse_args().out
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
    content = compact_png(figure, 130)
    write_bytes(out, content)
    print(f"{out}: {len(content) / 1024:.0f} KB, the reset takes {path.duration[0]:.1f} s")


if __name__ == "__main__":
    main()
