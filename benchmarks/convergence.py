"""Error of EngineWarp's landings by segments and step, against a far finer resolution.

The defaults of the engine are chosen from these tables. A cast is a whip, and a whip is sensitive:
the last table moves the initial state by a hundredth of a millimetre and of a degree, which shows
how much of the remaining error any simulation must have.
"""

import dataclasses
import pathlib

import numpy as np

from benchmarks.common import Table, land, landing_error_pct, random_casts, write_json
from cablecast.cable import CABLE_NAMES, ROD_ARM, Cable, load_cable
from cablecast.engines.base import reset_state
from cablecast.engines.warp_.engine import DEFAULT_DT, DEFAULT_SEGMENT_COUNT

FINE_SEGMENT_COUNT = 160
FINE_DT = 1.25e-4
COLUMNS = ("cable", "segments", "step [ms]", "precision", "median [%]", "p90 [%]", "max [%]")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Convergence of the landing in space and time.

    Attributes:
        cables: Names of presets.
        count: Number of random feasible actions, at v_max 1.5 m/s with psi.
        seed: Seed of the actions.
        attachments: True for attachments that are rods of their length, in place of point masses.
        json: File that gets the figures, too.
    """

    cables: tuple[str, ...] = CABLE_NAMES
    count: int = 200
    seed: int = 0
    attachments: bool = False
    json: pathlib.Path | None = None


def perturbed_state(cable: Cable, paths, segment_count: int, seed: int):
    """Return the reset state turned by 0.01 degree and bowed by 0.01 mm, either way."""
    state = reset_state(cable, paths, segment_count)
    rng = np.random.default_rng(seed)
    start = state.positions[:, :1]
    sign = rng.choice([-1.0, 1.0], size=(2, len(paths), 1))
    along = np.linspace(0.0, 1.0, segment_count + 1)
    positions = state.positions.copy()
    lateral = sign[0] * np.radians(0.01) * np.linalg.norm(positions - start, axis=2)
    lateral += sign[1] * 1e-5 * np.sin(np.pi * along) * along
    positions[..., 0] += lateral
    return dataclasses.replace(state, positions=positions)


def summary(error) -> tuple[float, float, float]:
    return tuple(float(v) for v in np.percentile(error, [50, 90, 100]))


def main(args: Args) -> None:
    paths = random_casts(args.count, args.seed)
    whole = Table(
        f"Distance from {FINE_SEGMENT_COUNT} segments at {FINE_DT * 1e3} ms, in % of cable length, "
        f"over {args.count} actions",
        COLUMNS,
        [],
    )
    time = Table("Error of the step alone: distance from the same segments at 1/16 ms", COLUMNS, [])
    nature = Table(
        "Sensitivity of the cast itself: initial state turned by 0.01 deg and bowed by 0.01 mm",
        COLUMNS,
        [],
    )
    for name in args.cables:
        cable = load_cable(name)
        if args.attachments:
            cable = cable.with_params(attachment_arm=ROD_ARM * cable.attachment_length)
        fine = land(cable, paths, FINE_SEGMENT_COUNT, FINE_DT)

        def add(table, reference, segments, dt, precision="double", state=None, cable=cable):
            landing = land(cable, paths, segments, dt, state, precision=precision)
            error = landing_error_pct(landing, reference, cable)
            table.rows.append((cable.name, segments, dt * 1e3, precision, *summary(error)))

        for segments in (20, 30, 40, 50, 60, 80, 120):
            add(whole, fine, segments, FINE_DT)
        for dt in (5e-4, DEFAULT_DT, 6.25e-4):
            add(whole, fine, DEFAULT_SEGMENT_COUNT, dt)
        add(whole, fine, DEFAULT_SEGMENT_COUNT, DEFAULT_DT, "single")
        limit = land(cable, paths, DEFAULT_SEGMENT_COUNT, 6.25e-5)
        for dt in (1e-3, DEFAULT_DT, 5e-4, 2.5e-4, 1.25e-4):
            add(time, limit, DEFAULT_SEGMENT_COUNT, dt)
        state = perturbed_state(cable, paths, FINE_SEGMENT_COUNT, args.seed)
        add(nature, fine, FINE_SEGMENT_COUNT, FINE_DT, state=state)
    for table in (whole, time, nature):
        print(table)
    write_json(args.json, [whole, time, nature])
