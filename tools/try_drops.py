"""Let the cable slip out of the jaws in casts of the twin, and say what its camera then tells.

    python tools/try_drops.py --drops 20 --casts 40

Cable, arm and camera are those of the twin, without its sockets: the cable flies on at a random
time of some casts. After each cast the jaws are turned into the camera's sight, as `--rig ur` does,
and looked at. Casts off the table are not counted, since they are no landings.
"""

import argparse
import collections
import dataclasses
import pathlib

import numpy as np

from cablecast.data.record import sample_actions
from cablecast.motion.action import Action
from cablecast.motion.trajectory import JointPath, plan_trajectory
from cablecast.rigs.ur.program import joint_move
from cablecast.rigs.ur.rig import TURN_SPEED
from cablecast.rigs.virtual.camera import Film, VirtualCamera
from cablecast.rigs.virtual.config import CameraConfig, VirtualConfig
from cablecast.rigs.virtual.drawing import FilmedTrial
from cablecast.rigs.virtual.laboratory import LiveCable
from cablecast.setup import load_setup
from cablecast.vision.grip import is_held, turned_into_sight

ROOT = pathlib.Path(__file__).parents[1]
TICK, SETTLE_TIME, WIDTH = 0.008, 1.5, 960


def main() -> None:
    """Make casts, and print how many cables were held or not, and seen so or not."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--drops", type=int, default=20, help="casts in which the cable slips out")
    parser.add_argument("--casts", type=int, default=40, help="casts in which it does not")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    setup, rng = load_setup(ROOT / "examples" / "twin.yaml"), np.random.default_rng(args.seed)
    config = CameraConfig.over(setup.workspace).resized(WIDTH)
    camera = VirtualCamera.of(setup, dataclasses.replace(config, exposure=0.002), args.seed)
    lab = VirtualConfig(segment_count=20)
    steps = 1 + np.arange(round(TICK / lab.dt))
    seen: collections.Counter[tuple[bool, bool | None]] = collections.Counter()

    def picture(q: np.ndarray, cable: LiveCable, number: int) -> np.ndarray:
        path = JointPath(times=np.zeros(1), q=q[None], qd=0 * q[None])
        scene = FilmedTrial.of(setup, np.zeros(1), cable.nodes[None], path)
        return Film(camera, scene, number).frame(0)

    for action in sample_actions("uniform", 4 * (args.drops + args.casts), setup, args.seed):
        drops = sum(count for (dropped, _), count in seen.items() if dropped)
        casts = sum(seen.values()) - drops
        dropped = drops < args.drops
        if not dropped and casts >= args.casts:
            break
        motion = plan_trajectory(Action(*action), setup)
        path, number = motion.joint_path, int(rng.integers(1 << 30))
        if path is None:
            raise SystemExit("a motion of the twin has no joints")
        cable, home = LiveCable(setup, lab, number), motion.grip_path.evaluate(np.zeros(1))[0]
        for _ in range(60):
            cable.update(np.repeat(home, len(steps), axis=0), at_rest=True)
        before = picture(path.q[0], cable, number)
        drop_time = rng.uniform(0.05, motion.duration) if dropped else np.inf
        for time in np.arange(0.0, motion.duration + SETTLE_TIME, TICK):
            if time >= drop_time:
                cable.drop()
            times = np.minimum(time + lab.dt * steps, motion.duration)
            cable.update(motion.grip_path.evaluate(times)[0], at_rest=bool(time > motion.duration))
        if not setup.workspace.on_table(cable.nodes[-1, :2]) or cable.nodes[-1, 2] < 0.0:
            continue
        q = turned_into_sight(path.q[-1], setup.arm, camera.view)
        if q is None:
            seen[dropped, None] += 1
            continue
        turn = joint_move(path.q[-1], q, TURN_SPEED)
        for time in np.arange(0.0, turn.duration + 0.3, TICK):
            poses = setup.arm.grip_pose(
                turn.evaluate(np.minimum(time + lab.dt * steps, turn.duration))
            )
            cable.update(poses, at_rest=bool(time > turn.duration))
        images = before, picture(q, cable, number + 1)
        held = is_held(images, np.array([path.q[0], q]), setup.arm, camera.view)
        seen[dropped, held] += 1
        at = f"slips out at {drop_time / motion.duration:.0%}" if dropped else "stays"
        print(f"{at}: {held}", flush=True)
    words = {True: "a cable in the jaws", False: "none in the jaws", None: "nothing"}
    for (dropped, held), count in sorted(seen.items(), key=str):
        print(f"{'slipped out' if dropped else 'held'}, and the camera sees {words[held]}: {count}")


if __name__ == "__main__":
    main()
