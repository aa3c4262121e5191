"""Arms of other makers: how long their candidates take, and whether casts hit.

PyBullet ships the descriptions of a Panda, an iiwa and an xArm6. Each casts a cable on the virtual
rig: a few casts, a fit, simulated casts, a model, and then casts at two places amid the landings of
the simulated ones. The models are small, so that an arm takes minutes: the table says that the way
works for it, not how well. Each arm's work is kept in --out: the same command resumes.
"""

import dataclasses
import pathlib
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

import cablecast as cc
from benchmarks.result import Table, code_key
from cablecast.arm.description import arm_from_dict
from cablecast.motion.feasibility import feasible_uniform
from cablecast.pipeline.aim import SimulatorConfig
from cablecast.workspace import Workspace

ARMS: dict[str, tuple[dict[str, Any], dict[str, float], float]] = {
    "panda": (
        {
            "file": "franka_panda/panda.urdf",
            "tip": "panda_grasptarget",
            "cable_axis": "x",
            "gripper_length": 0.0,
        },
        {"r_max": 0.7, "reset_y": 0.5, "support_depth": 0.4},
        0.8,
    ),
    "iiwa": (
        {
            "file": "kuka_iiwa/model.urdf",
            "tip": "lbr_iiwa_link_7",
            "limits": {"velocity": [1.7, 1.7, 1.7, 2.2, 2.4, 3.1, 3.1]},
        },
        {"r_max": 0.75, "reset_y": 0.5, "support_depth": 0.4},
        0.8,
    ),
    "xarm6": (
        {"file": "xarm/xarm6_robot.urdf", "tip": "link6"},
        {"r_max": 0.65, "reset_y": 0.45, "support_depth": 0.35},
        0.8,
    ),
}
"""Description, table and speed [m/s] of each arm."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArmsArgs:
    """Arms of other makers."""

    arms: tuple[str, ...] = tuple(ARMS)
    """Arms."""
    candidates: int = 50_000
    """Motions that the arm can follow, drawn and checked on both sides."""
    simulated: int = 1500
    """Simulated casts that each model is trained on."""
    tries: int = 4
    """Casts at each place; with 0 candidates alone are timed."""
    rig: str = "virtual"
    """Rig."""
    out: pathlib.Path = pathlib.Path("runs/benchmarks/arms")
    """Folder of the casts and models, in which the same command resumes."""


def set_up(name: str) -> cc.Setup:
    """Return the set-up of an arm, which grips the first cable."""
    import pybullet_data

    description, table, speed = ARMS[name]
    arm = arm_from_dict(description, pybullet_data.getDataPath())
    setup = cc.Setup(cable="cable_1", arm=arm, workspace=Workspace(**table))
    return setup.with_motion(r0=table["reset_y"], v_max=speed)


def aimed(args: ArmsArgs, name: str, setup: cc.Setup) -> list[cc.Cast]:
    """Return the casts at two places amid the simulated landings."""
    config = cc.AimConfig(
        simulated_count=args.simulated,
        epochs=20,
        candidate_count=2 * args.simulated,
        tries=args.tries,
        refit=False,
    )
    simulators = SimulatorConfig(segment_count=20, dt=2e-3, spread_count=60)
    out = args.out / code_key(__name__) / name
    with cc.make_rig(args.rig, setup) as rig:
        session = cc.prepare_aim(rig, config, simulators=simulators, out=out)
        landed = session.model.policy.predicted_xy
        places = np.quantile(landed, (0.4, 0.6), axis=0)
        return [cast for casts in cc.aim(session, rig, places).casts for cast in casts]


def arms(args: ArmsArgs) -> Iterator[Table]:
    """Yield the seconds that candidates take, and the misses of each try."""
    times, misses = [], []
    for name in args.arms:
        setup = set_up(name)
        start = time.perf_counter(), time.process_time()
        feasible_uniform(args.candidates, setup)
        took = time.perf_counter() - start[0], time.process_time() - start[1]
        times.append((name, setup.arm.joint_count, args.candidates, *took))
        print(name, *took, flush=True)
        if args.tries:
            for cast in aimed(args, name, setup):
                x, y = cast.target_xy
                misses.append((name, x, y, cast.try_number, cast.miss_pct, cast.hit))
                print(misses[-1], flush=True)
    columns = ("arm", "joints", "candidates", "clock [s]", "processor [s]")
    yield Table(
        "Candidates that the arm can follow, its table of postures included", columns, times
    )
    columns = ("arm", "x [m]", "y [m]", "try", "miss [%]", "hit")
    yield Table("Casts at two places [% of cable length]", columns, misses)
