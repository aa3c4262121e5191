"""Make films of a hand that swings a cable over the table, to fit the cable from them.

    python tools/film_by_hand.py films --count 4

There is no arm: a blue marker shows where the hand holds the cable, a green one its free end. The
cable is simulated with other parameters than those of its file, and drawn without blur on the
table of the virtual camera. Beside the films lie the layout of the tags (tags.yaml) and the
parameters that a fit should come near to (truth.json), of which no camera tells.
"""

import argparse
import dataclasses
import json
import pathlib
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, CableParams
from cablecast.engines.warp_ import EngineWarp
from cablecast.files import write_text
from cablecast.motion.grip_path import GripPath
from cablecast.rigs.virtual.camera import VirtualCamera
from cablecast.setup import Setup
from cablecast.vision.tags import load_cv2
from cablecast.vision.tracker import MarkerConfig
from cablecast.vision.video import Image, write_video
from cablecast.workspace import Workspace

GREEN, BLUE, CABLE = (62, 178, 58), (188, 62, 58), (58, 84, 176)
# The hand waits, moves from point to point, and waits until the cable rests [s].
_WAIT, _MOVE, _REST = 0.3, 0.45, 1.2
_FRACTION_BITS = 4


def true_params(cable: Cable) -> CableParams:
    """Return the parameters of the cable in the films: stiffer and smoother than its file says."""
    return dataclasses.replace(
        cable.params,
        bend_stiffness=3.0 * np.asarray(cable.params.bend_stiffness),
        lateral_friction=0.6 * np.asarray(cable.params.lateral_friction),
    )


def hand_motion(workspace: Workspace, rng: np.random.Generator) -> GripPath:
    """Return a swing of the hand: to one side, to the other, and half back, without a turn."""
    side = rng.choice([-1.0, 1.0])
    reach = rng.uniform([0.2, 0.2, 0.0], [0.35, 0.4, 0.15])
    x = side * np.array([0.0, -reach[0], reach[1], reach[2]])
    y = workspace.reset_y + np.array([0.0, *rng.uniform(-0.1, 0.1, size=3)])
    knots = np.concatenate([[0.0], _WAIT + _MOVE * np.arange(4)])
    poses = np.zeros((1, 5, 5))
    poses[0, :, 0], poses[0, :, 1] = np.r_[x[0], x], np.r_[y[0], y]
    poses[0, :, 2] = workspace.grip_height
    still = np.zeros_like(poses)
    return GripPath.from_hermite(knots[None], poses, still, still)


def film_hand(setup: Setup, path: GripPath, camera: VirtualCamera, rate: float) -> Iterator[Image]:
    """Yield the frames of one swing.

    Args:
        setup: Gives the cable.
        path: Motion of the hand.
        camera: Camera over the table.
        rate: Frames per second [1/s].
    """
    duration = float(path.duration[0]) + _REST
    rollout = EngineWarp().rollout(
        setup.cable.with_params(true_params(setup.cable)),
        path,
        duration=duration,
        sample_dt=0.005,
        record_nodes=True,
    )
    if rollout.nodes is None:
        raise RuntimeError("the engine records nodes")
    nodes, background = rollout.nodes[0], camera.empty_frame()
    for time in np.arange(0.0, duration, 1.0 / rate):
        index = np.searchsorted(rollout.times, time, side="right") - 1
        after = min(index + 1, len(nodes) - 1)
        share = (time - rollout.times[index]) / 0.005
        yield draw(background, nodes[index] + share * (nodes[after] - nodes[index]), setup, camera)


def draw(
    background: Image, nodes: NDArray[np.float64], setup: Setup, camera: VirtualCamera
) -> Image:
    """Return a frame with the cable and both markers.

    Args:
        background: Picture of the table.
        nodes: Cable from the hand to the free end [m], shape [node, 3].
        setup: Gives the cable.
        camera: Camera over the table.
    """
    cv2 = load_cv2()
    image, view, marker = background.copy(), camera.view, MarkerConfig()

    def line(points: NDArray[np.float64], color: tuple[int, int, int], width: float) -> None:
        pixels = np.round(view.to_image(points) * 2**_FRACTION_BITS).astype(np.int32)
        centre = points.mean(axis=0)
        thickness = max(1, round(width * view.pixels_per_metre(centre[:2], centre[2])))
        cv2.polylines(image, [pixels], False, color, thickness, cv2.LINE_AA, _FRACTION_BITS)

    line(nodes, CABLE, setup.cable.diameter)
    for end, before, color in ((nodes[-1], nodes[-2], GREEN), (nodes[0], nodes[1], BLUE)):
        along = (end - before) / np.linalg.norm(end - before)
        half = (marker.length - marker.width) / 2 * along
        line(np.stack([end - half, end + half]), color, marker.width)
    return image


def main(arguments: list[str] | None = None) -> None:
    """Make the films."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=pathlib.Path, help="folder to write to")
    parser.add_argument("--count", type=int, default=4, help="number of films")
    parser.add_argument("--cable", default="cable_1", help="preset or YAML file")
    parser.add_argument("--rate", type=float, default=60.0, help="frames per second")
    parser.add_argument("--seed", type=int, default=0, help="seed of the motions")
    args = parser.parse_args(arguments)
    setup = Setup(cable=args.cable)
    camera, rng = VirtualCamera(workspace=setup.workspace), np.random.default_rng(args.seed)
    camera.layout.save(args.out / "tags.yaml")
    for number in range(args.count):
        path = hand_motion(setup.workspace, rng)
        count = write_video(
            args.out / f"{number:06d}.mp4", film_hand(setup, path, camera, args.rate), args.rate
        )
        print(f"film {number + 1} of {args.count}: {count} frames")
    truth = true_params(setup.cable).to_dict()
    write_text(args.out / "truth.json", json.dumps(truth, indent=2) + "\n")


if __name__ == "__main__":
    main()
