"""Make a video of a trial on the virtual rig, for trying `cablecast track` without a camera.

    python tools/film.py film --action -40 35 0.65 60

Beside the video lie the tags' layout, pictures of a calibration board, and the truth (truth.csv),
which no camera tells.
"""

import argparse
import dataclasses
import pathlib
import sys

import numpy as np

from cablecast.errors import CablecastError
from cablecast.files import write_bytes, write_text
from cablecast.motion.action import Action
from cablecast.motion.trajectory import plan_trajectory
from cablecast.rigs.virtual import RigVirtual, VirtualConfig
from cablecast.rigs.virtual.camera import Film, VirtualCamera, board_pictures
from cablecast.rigs.virtual.drawing import FilmedTrial
from cablecast.rigs.virtual.sensing import RECORD_DT
from cablecast.setup import Setup, load_setup
from cablecast.vision.tags import load_cv2
from cablecast.vision.video import write_video


def film_trial(
    setup: Setup, action: Action, seed: int = 0, config: VirtualConfig | None = None
) -> tuple[FilmedTrial, Film]:
    """Play a cast on the virtual rig and film it.

    Args:
        setup: Cable, workspace, arm and motion settings.
        action: Casting motion.
        seed: Seed of what the rig and the camera draw by chance.
        config: Settings of the laboratory.
    """
    trajectory = plan_trajectory(action, setup)
    config = dataclasses.replace(config or VirtualConfig(), sample_dt=RECORD_DT, sensing="exact")
    with RigVirtual(setup, seed, config) as rig:
        rig.reset()
        track = rig.execute(trajectory)
    if track.nodes is None:
        raise RuntimeError("the virtual rig records nodes")
    trial = FilmedTrial(
        cable=setup.cable,
        times=track.times,
        nodes=track.nodes,
        joint_path=track.joint_path or trajectory.joint_path,
        arm=setup.arm,
    )
    return trial, VirtualCamera(workspace=setup.workspace).film(trial, seed)


def write_film(trial: FilmedTrial, film: Film, seed: int, out: pathlib.Path) -> pathlib.Path:
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


def main(arguments: list[str] | None = None) -> None:
    """Film a cast on the virtual rig."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=pathlib.Path, help="folder to write to")
    parser.add_argument("--cable", help="preset or YAML file; that of --setup, or cable_1")
    parser.add_argument("--setup", type=pathlib.Path, help="lab file; the paper's where missing")
    parser.add_argument("--seed", type=int, default=0, help="seed of all that is left to chance")
    parser.add_argument(
        "--action",
        type=float,
        nargs=4,
        default=(-40.0, 35.0, 0.65, 60.0),
        metavar=("THETA1", "THETA2", "R2", "PSI"),
        help="casting motion, in degrees and metres",
    )
    args = parser.parse_args(arguments)
    theta1, theta2, r2, psi = args.action
    try:
        setup = Setup() if args.setup is None else load_setup(args.setup)
        if args.cable is not None:
            setup = dataclasses.replace(setup, cable=args.cable)
        action = Action(np.radians(theta1), np.radians(theta2), r2, np.radians(psi))
        trial, film = film_trial(setup, action, args.seed)
        video = write_film(trial, film, args.seed, args.out)
    except CablecastError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    print(f"{film.frame_count} frames are in {video}; track them with")
    words = [f"cablecast track {video} --tags {args.out / 'tags.yaml'}"]
    words += [f"--board {args.out / 'board'} --start {-film.start:.4f}"]
    words += [f"--{name} {getattr(args, name)}" for name in ("setup", "cable") if vars(args)[name]]
    print("  " + " ".join(words))


if __name__ == "__main__":
    main()
