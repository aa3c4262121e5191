"""Make films with the virtual camera, for trying `cablecast track` and `tune` without a camera.

    python tools/film.py trial film --action -40 35 0.65 60
    python tools/film.py hand films --count 4

A film of a trial shows a cast on the virtual rig. Next to it lie the tags' layout, pictures of a
calibration board, and the truth (truth.csv), which no camera tells.

In films by hand, somebody without an arm swings the cable over the table: a blue marker shows where
the hand holds it, or with --tag a tag, and then the hand turns, too; a green marker shows its free
end. The cable is simulated with other parameters than those of its file, and drawn without blur.
Next to the films lie the tags' layout, and the parameters that a fit should come near to
(truth.json).
"""

import argparse
import dataclasses
import json
import pathlib
import sys
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, CableParams
from cablecast.camera.tags import EndTag
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import CablecastError
from cablecast.files import write_bytes, write_text
from cablecast.motion.casting import Action
from cablecast.motion.grip_path import GripPath
from cablecast.motion.trajectory import plan_trajectory
from cablecast.rigs.virtual import RigVirtual, VirtualConfig
from cablecast.rigs.virtual.camera import TrialFilm, VirtualCamera, board_pictures
from cablecast.rigs.virtual.drawing import FilmedTrial
from cablecast.rigs.virtual.sensing import RECORD_DT
from cablecast.setup import Setup, load_setup
from cablecast.vision.tags import load_cv2, tag_picture
from cablecast.vision.tracker import MarkerConfig
from cablecast.vision.video import Image, write_video
from cablecast.workspace import Workspace

GREEN, BLUE, CABLE = (62, 178, 58), (188, 62, 58), (58, 84, 176)
# The hand waits, moves from point to point, and waits until the cable rests [s].
_WAIT, _MOVE, _REST = 0.3, 0.45, 1.2
_FRACTION_BITS = 4
TURN = 0.5
"""Angle by which a hand with a tag turns [rad]."""


def film_trial(setup: Setup, action: Action, seed: int) -> tuple[FilmedTrial, TrialFilm]:
    """Play a cast on the virtual rig and film it.

    Args:
        setup: Cable, workspace, arm and motion settings.
        action: Casting motion.
        seed: Seed of what the rig and the camera draw by chance.
    """
    config = VirtualConfig(sample_dt=RECORD_DT, sensing="exact")
    with RigVirtual(setup, seed, config) as rig:
        rig.reset()
        track = rig.execute(plan_trajectory(action, setup))
    trial = FilmedTrial.of(setup, track.times, track.nodes, track.joint_path)
    return trial, VirtualCamera(workspace=setup.workspace).film(trial, seed)


def write_film(trial: FilmedTrial, film: TrialFilm, seed: int, out: pathlib.Path) -> pathlib.Path:
    """Write a film, the tags' layout, pictures of a board, the fastest frame, and the truth.

    Args:
        trial: Motion that was filmed.
        film: Film of it.
        seed: Seed of the pictures of the board.
        out: Folder to write to.

    Returns:
        The video.
    """
    cv2 = load_cv2()
    camera = film.camera
    camera.layout.save(out / "tags.yaml")
    for index, picture in enumerate(board_pictures(camera, seed)):
        encoded = cv2.imencode(".png", picture)[1]
        write_bytes(out / "board" / f"{index:02}.png", encoded.tobytes())
    times = np.array([film.time(index) for index in range(film.frame_count)])
    points = trial.shape_at(times)[:, -1]
    fastest = int(np.argmax(np.linalg.norm(np.diff(points, axis=0), axis=1)))

    def frames():
        for index in range(film.frame_count):
            frame = film.frame(index)
            if index == fastest:
                write_bytes(out / "fastest.png", cv2.imencode(".png", frame)[1].tobytes())
            print(f"\rframe {index + 1} of {film.frame_count}", end="", file=sys.stderr)
            yield frame

    video = out / "trial.mp4"
    write_video(video, frames(), camera.config.frame_rate)
    print(file=sys.stderr)
    rows = ["time_s,x_m,y_m,z_m"]
    rows += [f"{t:.5f},{x:.5f},{y:.5f},{z:.5f}" for t, (x, y, z) in zip(times, points, strict=True)]
    write_text(out / "truth.csv", "\n".join(rows) + "\n")
    return video


def true_params(cable: Cable) -> CableParams:
    """Return the parameters of the cable in the films: stiffer and smoother than its file says."""
    return dataclasses.replace(
        cable.params,
        bend_stiffness=3.0 * np.asarray(cable.params.bend_stiffness),
        lateral_friction=0.6 * np.asarray(cable.params.lateral_friction),
    )


def hand_motion(workspace: Workspace, rng: np.random.Generator, turn: float = 0.0) -> GripPath:
    """Return a swing of the hand: to one side, to the other, and half back.

    Args:
        workspace: Gives the place of the reset.
        rng: Random numbers.
        turn: Angle by which the hand turns into each side [rad].
    """
    side = rng.choice([-1.0, 1.0])
    reach = rng.uniform([0.2, 0.2, 0.0], [0.35, 0.4, 0.15])
    x = side * np.array([0.0, -reach[0], reach[1], reach[2]])
    y = workspace.reset_y + np.array([0.0, *rng.uniform(-0.1, 0.1, size=3)])
    knots = np.concatenate([[0.0], _WAIT + _MOVE * np.arange(4)])
    poses = np.zeros((1, 5, 5))
    poses[0, :, 0], poses[0, :, 1] = np.r_[x[0], x], np.r_[y[0], y]
    poses[0, :, 2] = workspace.grip_height
    poses[0, 1:4, 3] = turn * np.sign(x[:3])
    still = np.zeros_like(poses)
    return GripPath.from_hermite(knots[None], poses, still, still)


def film_hand(
    setup: Setup, path: GripPath, camera: VirtualCamera, rate: float, tag: EndTag | None = None
) -> Iterator[Image]:
    """Yield the frames of one swing.

    Args:
        setup: Gives the cable.
        path: Motion of the hand.
        camera: Camera over the table.
        rate: Frames per second [1/s].
        tag: Tag on the hand; a marker where None.
    """
    duration = float(path.duration[0]) + _REST
    rollout = EngineWarp().rollout(
        setup.cable.with_params(true_params(setup.cable)),
        path,
        duration=duration,
        sample_dt=0.005,
        record_nodes=True,
    )
    nodes, background = rollout.nodes[0], camera.empty_frame()
    for time in np.arange(0.0, duration, 1.0 / rate):
        index = np.searchsorted(rollout.times, time, side="right") - 1
        after = min(index + 1, len(nodes) - 1)
        share = (time - rollout.times[index]) / 0.005
        shape = nodes[index] + share * (nodes[after] - nodes[index])
        image = draw(background, shape, setup, camera, marks_hand=tag is None)
        if tag is not None:
            stick(image, camera, tag, path.evaluate(np.array([time]))[0, 0])
        yield image


def stick(image: Image, camera: VirtualCamera, tag: EndTag, pose: NDArray[np.float64]) -> None:
    """Draw a tag with its white rim, over the hand.

    Args:
        image: Frame to draw into.
        camera: Camera over the table.
        tag: Tag, whose upper side is ahead.
        pose: Place of its centre [m], and its yaw [rad], shape [5].
    """
    cv2, cell, view = load_cv2(), 12, camera.view
    picture = tag_picture(tag.id, cell, tag.family)
    cells = len(picture) // cell
    # The black square lies within a rim of one cell.
    half = 0.5 * tag.size * cells / (cells - 2) * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
    c, s = np.cos(pose[3]), np.sin(pose[3])
    xy = half @ np.array([[c, -s], [s, c]]) + pose[:2]
    pixels = view.to_image(np.column_stack([xy, np.full(4, tag.height or pose[2])]))
    low = np.floor(pixels.min(axis=0)).astype(int) - 2
    size = np.ceil(pixels.max(axis=0)).astype(int) + 2 - low
    part = image[low[1] : low[1] + size[1], low[0] : low[0] + size[0]]
    # As many points as a pixel's light comes from.
    fine, side = 4, len(picture) - 0.5
    source = np.array([[-0.5, -0.5], [side, -0.5], [side, side], [-0.5, side]])
    target = (pixels - low + 0.5) * fine - 0.5
    H = cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32))
    shape = (part.shape[1] * fine, part.shape[0] * fine)
    cover, drawn = (
        cv2.resize(
            cv2.warpPerspective(one.astype(np.float32), H, shape),
            part.shape[1::-1],
            interpolation=cv2.INTER_AREA,
        )[..., None]
        for one in (np.ones_like(picture), picture)
    )
    part[:] = np.round(part * (1.0 - cover) + drawn)


def draw(
    background: Image,
    nodes: NDArray[np.float64],
    setup: Setup,
    camera: VirtualCamera,
    *,
    marks_hand: bool = True,
) -> Image:
    """Return a frame with the cable and its markers.

    Args:
        background: Picture of the table.
        nodes: Cable from the hand to the free end [m], shape [node, 3].
        setup: Gives the cable.
        camera: Camera over the table.
        marks_hand: Whether a marker shows the hand, too.
    """
    cv2 = load_cv2()
    image, view, marker = background.copy(), camera.view, MarkerConfig()

    def line(points: NDArray[np.float64], color: tuple[int, int, int], width: float) -> None:
        pixels = np.round(view.to_image(points) * 2**_FRACTION_BITS).astype(np.int32)
        centre = points.mean(axis=0)
        thickness = max(1, round(width * view.pixels_per_metre(centre[:2], centre[2])))
        cv2.polylines(image, [pixels], False, color, thickness, cv2.LINE_AA, _FRACTION_BITS)

    line(nodes, CABLE, setup.cable.diameter)
    hand = ((nodes[0], nodes[1], BLUE),) if marks_hand else ()
    for end, before, color in ((nodes[-1], nodes[-2], GREEN), *hand):
        along = (end - before) / np.linalg.norm(end - before)
        half = (marker.length - marker.width) / 2 * along
        line(np.stack([end - half, end + half]), color, marker.width)
    return image


def film_one_trial(args: argparse.Namespace) -> None:
    """Film a cast on the virtual rig."""
    theta1, theta2, r2, psi = args.action
    setup = Setup() if args.setup is None else load_setup(args.setup)
    if args.cable is not None:
        setup = dataclasses.replace(setup, cable=args.cable)
    action = Action(np.radians(theta1), np.radians(theta2), r2, np.radians(psi))
    trial, film = film_trial(setup, action, args.seed)
    video = write_film(trial, film, args.seed, args.out)
    print(f"{film.frame_count} frames are in {video}; track them with")
    words = [f"cablecast track {video} --tags {args.out / 'tags.yaml'}"]
    words += [f"--board {args.out / 'board'} --start {-film.start:.4f}"]
    words += [f"--{name} {getattr(args, name)}" for name in ("setup", "cable") if vars(args)[name]]
    print("  " + " ".join(words))


def film_by_hand(args: argparse.Namespace) -> None:
    """Film swings of a hand."""
    setup = Setup(cable=args.cable)
    camera, rng = VirtualCamera(workspace=setup.workspace), np.random.default_rng(args.seed)
    camera.layout.save(args.out / "tags.yaml")
    tag = None if args.tag is None else EndTag(id=args.tag)
    for number in range(args.count):
        path = hand_motion(setup.workspace, rng, TURN if tag else 0.0)
        frames = film_hand(setup, path, camera, args.rate, tag)
        count = write_video(args.out / f"{number:06d}.mp4", frames, args.rate)
        print(f"film {number + 1} of {args.count}: {count} frames")
    truth = true_params(setup.cable).to_dict()
    write_text(args.out / "truth.json", json.dumps(truth, indent=2) + "\n")


def main(arguments: list[str] | None = None) -> None:
    """Make films with the virtual camera."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    kinds = parser.add_subparsers(required=True)
    trial = kinds.add_parser("trial", help=film_one_trial.__doc__)
    trial.set_defaults(make=film_one_trial)
    trial.add_argument("--cable", help="preset or YAML file; that of --setup, or cable_1")
    trial.add_argument("--setup", type=pathlib.Path, help="lab file; the paper's if not given")
    trial.add_argument(
        "--action",
        type=float,
        nargs=4,
        default=(-40.0, 35.0, 0.65, 60.0),
        metavar=("THETA1", "THETA2", "R2", "PSI"),
        help="casting motion, in degrees and metres",
    )
    hand = kinds.add_parser("hand", help=film_by_hand.__doc__)
    hand.set_defaults(make=film_by_hand)
    hand.add_argument("--count", type=int, default=4, help="number of films")
    hand.add_argument("--cable", default="cable_1", help="preset or YAML file")
    hand.add_argument("--tag", type=int, help="number of a 4X4_50 tag of 3 cm on the hand")
    hand.add_argument("--rate", type=float, default=60.0, help="frames per second")
    for kind in (trial, hand):
        kind.add_argument("out", type=pathlib.Path, help="folder to write to")
        kind.add_argument("--seed", type=int, default=0, help="seed of all random numbers")
    args = parser.parse_args(arguments)
    try:
        args.make(args)
    except CablecastError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
