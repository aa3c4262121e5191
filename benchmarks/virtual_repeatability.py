"""How far repeated landings scatter on the virtual rig, beside the paper's figures.

    python benchmarks/virtual_repeatability.py [--actions 24] [--repeats 4]

Random feasible actions are each played several times. Trials that leave the table are left out of
the standard deviations, as in the paper (section V-E), and counted.
"""

import argparse
import time

import numpy as np

from cablecast.cable import load_cable
from cablecast.motion.action import ActionRanges, MotionConfig
from cablecast.motion.cast import cast_grip_paths
from cablecast.motion.feasibility import check_actions
from cablecast.motion.trajectory import Trajectory
from cablecast.rigs.virtual import RigVirtual, VirtualConfig
from cablecast.track import TrialStatus
from cablecast.workspace import Workspace

# v_max [m/s], with psi, published standard deviation [% of cable length] and off-table fraction.
PUBLISHED = (
    (1.2, False, 1.27, None),
    (1.5, True, 1.93, 0.129),
    (1.8, False, 3.70, None),
    (1.8, True, 4.72, 0.30),
)


def random_actions(count, config, workspace, with_psi, seed):
    """Feasible actions, uniform over the ranges, shape [count, 4]."""
    ranges = ActionRanges()
    rng = np.random.default_rng(seed)
    bounds = (ranges.theta1, ranges.theta2, ranges.r2, ranges.wrist if with_psi else (0.0, 0.0))
    actions = np.stack([rng.uniform(*bound, size=20 * count) for bound in bounds], axis=1)
    actions[:, 3] += actions[:, 1]
    return actions[check_actions(actions, config, workspace).mask][:count]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cable", default="cable_1")
    parser.add_argument("--actions", type=int, default=24)
    parser.add_argument("--repeats", type=int, default=4)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--dt", type=float, default=VirtualConfig().dt)
    args = parser.parse_args()
    cable, workspace = load_cable(args.cable), Workspace()
    print("v_max  psi  std_pct mean (paper)  median   off-table (paper)   seconds")
    for v_max, with_psi, published_pct, published_off in PUBLISHED:
        config = MotionConfig(v_max=v_max)
        actions = random_actions(args.actions, config, workspace, with_psi, args.seed)
        paths = cast_grip_paths(actions, config, workspace)
        trajectories = [
            Trajectory(action=None, grip_path=paths[index], joint_path=None)
            for index in range(len(actions))
            for _ in range(args.repeats)
        ]
        begin = time.perf_counter()
        rig = RigVirtual(cable, workspace, args.seed, VirtualConfig(dt=args.dt))
        tracks = rig.execute_many(trajectories)
        seconds = time.perf_counter() - begin
        landings = np.array([track.final_xy for track in tracks]).reshape(-1, args.repeats, 2)
        off = np.mean([track.status is TrialStatus.OFF_TABLE for track in tracks])
        seen = np.isfinite(landings[..., 0])
        often = seen.sum(axis=1) >= 2
        spread = landings[often] - np.nanmean(landings[often], axis=1, keepdims=True)
        std = np.sqrt(np.nansum(spread**2, axis=(1, 2)) / seen[often].sum(axis=1))
        std_pct = 100 * std / cable.length
        off_text = "      " if published_off is None else f"({published_off:.3f})"
        print(
            f"{v_max:4.1f}  {'yes' if with_psi else ' no':>4} {std_pct.mean():9.2f} "
            f"({published_pct:.2f}) {np.median(std_pct):12.2f} {off:12.3f} {off_text} "
            f"{seconds:12.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
