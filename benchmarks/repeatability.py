"""How far repeated landings scatter on the virtual rig, beside the paper's figures.

Random feasible actions are each played several times. Trials that leave the table are left out of
the standard deviations, as in the paper (section V-E), and counted.
"""

import dataclasses
import pathlib
import time

import numpy as np

from benchmarks.common import Table, random_actions, write_json
from cablecast.cable import load_cable
from cablecast.motion.action import MotionConfig
from cablecast.motion.cast import cast_grip_paths
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
COLUMNS = (
    "v_max [m/s]",
    "psi",
    "std mean [%]",
    "std median [%]",
    "paper's mean [%]",
    "off table",
    "paper's off table",
    "seconds",
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Scatter of repeated casts on the virtual rig.

    Attributes:
        cable: Which preset.
        actions: How many random feasible actions.
        repeats: How often each is played.
        seed: Of the actions and of the rig.
        json: Also write the figures to this file.
    """

    cable: str = "cable_1"
    actions: int = 24
    repeats: int = 4
    seed: int = 5
    json: pathlib.Path | None = None


def main(args: Args) -> None:
    cable, workspace = load_cable(args.cable), Workspace()
    table = Table("Standard deviation of repeated landings, in % of cable length", COLUMNS, [])
    for v_max, with_psi, published_pct, published_off in PUBLISHED:
        config = MotionConfig(v_max=v_max)
        actions = random_actions(args.actions, args.seed, config, with_psi=with_psi)
        paths = cast_grip_paths(actions, config, workspace)
        trajectories = [
            Trajectory(action=None, grip_path=paths[index], joint_path=None)
            for index in range(len(actions))
            for _ in range(args.repeats)
        ]
        begin = time.perf_counter()
        rig = RigVirtual(cable, workspace, args.seed, VirtualConfig())
        tracks = rig.execute_many(trajectories)
        seconds = time.perf_counter() - begin
        landings = np.array([track.final_xy for track in tracks]).reshape(-1, args.repeats, 2)
        off = np.mean([track.status is TrialStatus.OFF_TABLE for track in tracks])
        seen = np.isfinite(landings[..., 0])
        often = seen.sum(axis=1) >= 2
        spread = landings[often] - np.nanmean(landings[often], axis=1, keepdims=True)
        std = np.sqrt(np.nansum(spread**2, axis=(1, 2)) / seen[often].sum(axis=1))
        std_pct = 100 * std / cable.length
        table.rows.append(
            (
                v_max,
                "yes" if with_psi else "no",
                float(std_pct.mean()),
                float(np.median(std_pct)),
                published_pct,
                float(off),
                "-" if published_off is None else published_off,
                seconds,
            )
        )
    print(table)
    write_json(args.json, [table])
