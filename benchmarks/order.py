"""Order of EngineWarp in time, by the friction that resists the cable.

Measured by the distance of whole tracks from those at a far smaller step, over the first 0.8 s of
random casts, before the whip magnifies it. The method is of second order; each start and stop of a
node falls between two steps and leaves a small error of the first.
"""

import dataclasses
import pathlib

import numpy as np

from benchmarks.common import Table, random_casts, track_errors, write_json
from benchmarks.validation.case import make_warp
from benchmarks.validation.scenes import LOCKED
from cablecast.cable import load_cable

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
        cable: Name of a preset, which also gives the frictions that a row does not name.
        count: Number of random feasible actions, at v_max 1.5 m/s with psi.
        seed: Seed of the actions.
        segment_count: Number of segments.
        json: File that gets the figures, too.
    """

    cable: str = "cable_1"
    count: int = 24
    seed: int = 0
    segment_count: int = 30
    json: pathlib.Path | None = None


def main(args: Args) -> None:
    """Print the error of each step and the orders between them, for each resistance."""
    cable = load_cable(args.cable)
    paths = random_casts(args.count, args.seed)
    rungs = [(args.segment_count, dt) for dt in STEPS]
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

        def play(segment_count, dt, params=params):
            engine = make_warp(segment_count, dt)
            # From 0.2 s on: before that the endpoint has hardly moved.
            return engine.rollout(cable.with_params(params), paths, duration=DURATION).endpoint_xy[
                :, 2:
            ]

        errors = track_errors(play, rungs, (args.segment_count, FINE_DT))
        orders = np.log2(errors[:-1] / errors[1:])
        errors_pct = 100.0 * errors / cable.length
        table.rows.append((label, *errors_pct.tolist(), *orders.tolist()))
    print(table)
    write_json(args.json, [table])
