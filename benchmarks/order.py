"""Of which order EngineWarp is in time, by what resists the cable.

The distance of whole tracks from those at a far smaller step, over the first 0.8 s of random casts,
before a whip magnifies what is there. The method is of second order; each start and stop of a node
falls between two steps and leaves a small error of the first.
"""

import dataclasses
import pathlib

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Table, random_actions, write_json
from benchmarks.validation.scenes import LOCKED
from cablecast.cable import Cable, CableParams, load_cable
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.action import MotionConfig
from cablecast.motion.cast import cast_grip_paths
from cablecast.motion.grip_path import GripPath
from cablecast.workspace import Workspace

STEPS = (1e-3, 5e-4, 2.5e-4, 1.25e-4)
FINE_DT = 3.125e-5
DURATION = 0.8

RESISTANCES = {
    "sliding friction": {"rolling_friction": LOCKED, "spinning_friction": 0.0},
    "... and rolls, without rolling friction": {"rolling_friction": 0.0, "spinning_friction": 0.0},
    "... with rolling friction": {"spinning_friction": 0.0},
    "... and with spinning friction": {},
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Order of EngineWarp in time.

    Attributes:
        cable: Which preset; the frictions that a row does not name are the preset's.
        count: How many random feasible actions, at v_max 1.5 m/s with psi.
        seed: Of the actions.
        segment_count: Segments of the cable.
        json: Also write the figures to this file.
    """

    cable: str = "cable_1"
    count: int = 24
    seed: int = 0
    segment_count: int = 30
    json: pathlib.Path | None = None


def tracks(
    cable: Cable, params: CableParams, paths: GripPath, segment_count: int, dt: float
) -> NDArray[np.float64]:
    """Endpoints every 100 ms from 0.2 s on [m], shape [action, step, 2]."""
    engine = EngineWarp(segment_count=segment_count, dt=dt, precision="double", rest_speed=0.0)
    return engine.rollout(cable, params, paths, duration=DURATION).endpoint_xy[:, 2:]


def main(args: Args) -> None:
    """Print, for each resistance, the error of each step and the slopes between them."""
    cable = load_cable(args.cable)
    actions = random_actions(args.count, args.seed)
    paths = cast_grip_paths(actions, MotionConfig(), Workspace())
    table = Table(
        f"Median distance of tracks from those at {FINE_DT * 1e3:g} ms, in % of cable length, and "
        f"the order that halving the step shows: {args.cable}, {args.count} actions, "
        f"{args.segment_count} segments, first {DURATION} s",
        (
            "resisted by",
            *(f"{dt * 1e3:g} ms" for dt in STEPS),
            *(f"order {i}" for i in range(1, len(STEPS))),
        ),
        [],
    )
    for label, changes in RESISTANCES.items():
        params = dataclasses.replace(cable.params, **changes)
        fine = tracks(cable, params, paths, args.segment_count, FINE_DT)
        errors = []
        for dt in STEPS:
            apart = tracks(cable, params, paths, args.segment_count, dt) - fine
            errors.append(100.0 * float(np.median(np.linalg.norm(apart, axis=-1))) / cable.length)
        orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
        table.rows.append((label, *errors, *(float(order) for order in orders)))
    print(table)
    write_json(args.json, [table])
