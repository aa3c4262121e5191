"""`python -m cablecast.rigs.virtual.camera_film DIR`: a video of a trial on the virtual rig.

For trying `cablecast track` without a camera. Beside the video lie the tags' layout, pictures of a
calibration board, and the truth (truth.csv), which no camera tells.
"""

import argparse
import pathlib
import sys

import numpy as np

from cablecast.cable import load_cable
from cablecast.files import write_bytes, write_text
from cablecast.motion.action import Action, MotionConfig
from cablecast.motion.trajectory import plan_trajectory
from cablecast.tracking.opencv import load_cv2
from cablecast.tracking.video import write_video
from cablecast.rigs.virtual.camera import Film, VirtualCamera
from cablecast.rigs.virtual.camera_calibrate import board_pictures
from cablecast.rigs.virtual.camera_drawing import FilmedTrial
from cablecast.rigs.virtual.config import VirtualConfig
from cablecast.rigs.virtual.sensing import RECORD_DT
from cablecast.workspace import Workspace


def film_trial(
    cable_name: str, action: Action, seed: int = 0, config: VirtualConfig | None = None
) -> tuple[FilmedTrial, Film]:
    """Play a cast on the virtual rig and film it.

    Args:
        cable_name: A preset or a YAML file.
        action: Which cast.
        seed: Chooses what the rig and the camera draw by chance.
        config: Settings of the laboratory.
    """
    import dataclasses

    from cablecast.rigs.virtual.rig import RigVirtual

    cable, workspace = load_cable(cable_name), Workspace()
    trajectory = plan_trajectory(action, MotionConfig(), workspace)
    config = dataclasses.replace(config or VirtualConfig(), sample_dt=RECORD_DT, sensing="exact")
    rig = RigVirtual(cable, workspace, seed, config)
    rig.reset()
    track = rig.execute(trajectory)
    rig.close()
    if track.nodes is None:
        raise RuntimeError("the virtual rig records nodes")
    trial = FilmedTrial(
        cable=cable,
        times=track.times,
        nodes=track.nodes,
        joint_path=track.joint_path or trajectory.joint_path,
    )
    return trial, VirtualCamera(workspace=workspace).film(trial, seed)


def main() -> None:
    """Film a cast on the virtual rig."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=pathlib.Path, help="folder to write to")
    parser.add_argument("--cable", default="cable_1", help="a preset or a YAML file")
    parser.add_argument("--seed", type=int, default=0, help="chooses all that is left to chance")
    parser.add_argument(
        "--action",
        type=float,
        nargs=4,
        default=(-40.0, 35.0, 0.65, 60.0),
        metavar=("THETA1", "THETA2", "R2", "PSI"),
        help="which cast, in degrees and metres",
    )
    args = parser.parse_args()
    cv2 = load_cv2()
    theta1, theta2, r2, psi = args.action
    action = Action(np.radians(theta1), np.radians(theta2), r2, np.radians(psi))
    trial, film = film_trial(args.cable, action, args.seed)
    camera = film.camera
    camera.layout.save(args.out / "tags.yaml")

    def png(picture) -> bytes:
        return cv2.imencode(".png", picture)[1].tobytes()

    for index, picture in enumerate(board_pictures(camera, args.seed)):
        write_bytes(args.out / "board" / f"{index:02}.png", png(picture))

    def frames():
        # The picture is taken where the endpoint is fastest.
        starts = np.array([film.time(index) for index in range(film.frame_count)])
        path = trial.shape_at(starts)[:, -1]
        fastest = int(np.argmax(np.linalg.norm(np.diff(path, axis=0), axis=1)))
        for index in range(film.frame_count):
            if index == fastest:
                write_bytes(args.out / "fastest.png", png(film.frame(index)))
            print(f"\rframe {index + 1} of {film.frame_count}", end="", file=sys.stderr)
            yield film.frame(index)

    video = args.out / "trial.mp4"
    count = write_video(video, frames(), camera.config.frame_rate)
    print(file=sys.stderr)
    times = np.array([film.time(index) for index in range(count)])
    points = trial.shape_at(times)[:, -1]
    rows = ["time_s,x_m,y_m,z_m"]
    rows += [f"{t:.5f},{x:.5f},{y:.5f},{z:.5f}" for t, (x, y, z) in zip(times, points, strict=True)]
    write_text(args.out / "truth.csv", "\n".join(rows) + "\n")
    print(f"{count} frames are in {video}; track them with")
    print(
        f"  cablecast track {video} --tags {args.out / 'tags.yaml'} "
        f"--board {args.out / 'board'} --cable {args.cable} --start {-film.start:.4f}"
    )


if __name__ == "__main__":
    main()
