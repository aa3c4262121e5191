"""Accuracy of EngineWarp on casts, against far finer resolutions of its own.

convergence: errors of the landing by segments and step, which the defaults were chosen from.

order: order in time, by the friction that resists the cable. Measured by the distance of whole
tracks from those at a far smaller step, over the first 0.8 s of random casts, before the whip
magnifies it. The method is of second order; each start and stop of a node falls between two steps
and leaves a small error of the first.

sensitivity: errors and the cast's own sensitivity. Each action is played at a fine resolution
from initial states that differ by as much as a careful reset leaves; the movement of its landing
over that of the free end is the cast's gain. An error of the method is a small difference that
enters along the way and meets the same gain. If the largest errors are those of the casts with the
largest gains, errors and gains are correlated.
"""

import dataclasses
from collections.abc import Iterator

import numpy as np

from benchmarks.common import land, landing_error_pct, random_casts, track_errors
from benchmarks.result import Table
from benchmarks.validation.case import make_warp
from benchmarks.validation.scenes import LOCKED
from cablecast.cable import CABLE_NAMES, ROD_ARM, Cable, load_cable
from cablecast.engines.base import CableState, reset_state
from cablecast.engines.warp_.engine import DEFAULT_DT, DEFAULT_SEGMENT_COUNT
from cablecast.motion.grip_path import GripPath

FINE_SEGMENT_COUNT = 160
FINE_DT = 1.25e-4
CONVERGENCE_COLUMNS = (
    "cable",
    "segments",
    "step [ms]",
    "precision",
    "median [%]",
    "p90 [%]",
    "max [%]",
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ConvergenceArgs:
    """Convergence of the landing in space and time.

    Attributes:
        cables: Names of presets.
        count: Number of random feasible actions, at v_max 1.5 m/s with psi.
        seed: Seed of the actions.
        attachments: True for attachments that are rods of their length, in place of point masses.
    """

    cables: tuple[str, ...] = CABLE_NAMES
    count: int = 200
    seed: int = 0
    attachments: bool = False


def convergence(args: ConvergenceArgs) -> Iterator[Table]:
    paths = random_casts(args.count, args.seed)
    whole = Table(
        f"Distance from {FINE_SEGMENT_COUNT} segments at {FINE_DT * 1e3} ms, in % of cable length, "
        f"over {args.count} actions",
        CONVERGENCE_COLUMNS,
        [],
    )
    time = Table(
        "Error of the step alone: distance from the same segments at 1/16 ms",
        CONVERGENCE_COLUMNS,
        [],
    )
    for name in args.cables:
        cable = load_cable(name)
        if args.attachments:
            cable = cable.with_params(attachment_arm=ROD_ARM * cable.attachment_length)
        fine = land(cable, paths, FINE_SEGMENT_COUNT, FINE_DT)

        def add(table, reference, segments, dt, precision="double", cable=cable):
            landing = land(cable, paths, segments, dt, precision=precision)
            error = landing_error_pct(landing, reference, cable)
            of_error = np.percentile(error, [50, 90, 100])
            table.rows.append((cable.name, segments, dt * 1e3, precision, *of_error))

        for segments in (20, 30, 40, 50, 60, 80, 120):
            add(whole, fine, segments, FINE_DT)
        for dt in (5e-4, DEFAULT_DT, 6.25e-4):
            add(whole, fine, DEFAULT_SEGMENT_COUNT, dt)
        add(whole, fine, DEFAULT_SEGMENT_COUNT, DEFAULT_DT, "single")
        limit = land(cable, paths, DEFAULT_SEGMENT_COUNT, 6.25e-5)
        for dt in (1e-3, DEFAULT_DT, 5e-4, 2.5e-4, 1.25e-4):
            add(time, limit, DEFAULT_SEGMENT_COUNT, dt)
    yield whole
    yield time


ORDER_STEPS = (1e-3, 5e-4, 2.5e-4, 1.25e-4)
ORDER_FINE_DT = 3.125e-5
ORDER_DURATION = 0.8

RESISTANCES = {
    "sliding friction": {"rolling_friction": LOCKED, "spinning_friction": 0.0},
    "... and rolls, without rolling friction": {"rolling_friction": 0.0, "spinning_friction": 0.0},
    "... with rolling friction": {"spinning_friction": 0.0},
    "... and with spinning friction": {},
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class OrderArgs:
    """Order of EngineWarp in time.

    Attributes:
        cable: Name of a preset, which also gives the frictions that a row does not name.
        count: Number of random feasible actions, at v_max 1.5 m/s with psi.
        seed: Seed of the actions.
        segment_count: Number of segments.
    """

    cable: str = "cable_1"
    count: int = 24
    seed: int = 0
    segment_count: int = 30


def order(args: OrderArgs) -> Iterator[Table]:
    """Yield the error of each step and the orders between them, for each resistance."""
    cable = load_cable(args.cable)
    paths = random_casts(args.count, args.seed)
    rungs = [(args.segment_count, dt) for dt in ORDER_STEPS]
    table = Table(
        f"Median distance of tracks from those at {ORDER_FINE_DT * 1e3:g} ms, in % of cable "
        f"length, and the order that halving the step shows: {args.cable}, {args.count} actions, "
        f"{args.segment_count} segments, first {ORDER_DURATION} s",
        (
            "resisted by",
            *(f"{dt * 1e3:g} ms" for dt in ORDER_STEPS),
            *(f"order {i}" for i in range(1, len(ORDER_STEPS))),
        ),
        [],
    )
    for label, changes in RESISTANCES.items():
        params = dataclasses.replace(cable.params, **changes)

        def play(segment_count, dt, params=params):
            engine = make_warp(segment_count, dt)
            # From 0.2 s on: before that the endpoint has hardly moved.
            return engine.rollout(
                cable.with_params(params), paths, duration=ORDER_DURATION
            ).endpoint_xy[:, 2:]

        errors = track_errors(play, rungs, (args.segment_count, ORDER_FINE_DT))
        orders = np.log2(errors[:-1] / errors[1:])
        errors_pct = 100.0 * errors / cable.length
        table.rows.append((label, *errors_pct.tolist(), *orders.tolist()))
    yield table


COARSE = ((DEFAULT_SEGMENT_COUNT, DEFAULT_DT), (2 * DEFAULT_SEGMENT_COUNT, DEFAULT_DT / 2))
"""Segments and step [s] whose errors are measured: the default, and one twice as fine."""

TO_THE_END = {"rest_speed": 0.0}
"""Options of the engine: stopping early moves a landing by as much as a small perturbation does."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SensitivityArgs:
    """Sensitivity of casts, and the error of the method.

    Attributes:
        cables: Names of presets.
        count: Number of random feasible actions, at v_max 1.5 m/s with psi.
        seed: Seed of the actions.
        fine: Number of segments at which the sensitivity is measured.
    """

    cables: tuple[str, ...] = CABLE_NAMES
    count: int = 100
    seed: int = 0
    fine: int = FINE_SEGMENT_COUNT


@dataclasses.dataclass(frozen=True, kw_only=True)
class Perturbation:
    """A small change of the initial state.

    Attributes:
        turn: Turn of the whole cable about the grip [rad].
        bow: Height of a sine arch between grip and free end [m].
    """

    turn: float = 0.0
    bow: float = 0.0

    def __str__(self) -> str:
        if self.bow:
            return f"bow of {self.bow * 1e3:g} mm"
        return f"turn of {self.turn:g} rad"

    def size(self, cable: Cable) -> float:
        """Return the largest movement of a node [m]."""
        return self.turn * cable.length + self.bow

    def applied(self, state: CableState, cable: Cable, sign: float) -> CableState:
        """Return the state with every edge turned about the vertical, its length kept."""
        count = state.segment_count
        s = (np.arange(count) + 0.5) / count
        angle = sign * (self.turn + self.bow * np.pi / cable.length * np.cos(np.pi * s))
        edges = np.diff(state.positions, axis=1)
        turned = edges.copy()
        turned[..., 0] = np.cos(angle) * edges[..., 0] + np.sin(angle) * edges[..., 1]
        turned[..., 1] = np.cos(angle) * edges[..., 1] - np.sin(angle) * edges[..., 0]
        positions = state.positions.copy()
        positions[:, 1:] = positions[:, :1] + np.cumsum(turned, axis=1)
        return dataclasses.replace(state, positions=positions)


PERTURBATIONS = (
    Perturbation(turn=1e-4),
    Perturbation(turn=1e-3),
    Perturbation(bow=1e-4),
    Perturbation(bow=1e-3),
)


def study(cable: Cable, paths: GripPath, args: SensitivityArgs) -> tuple[list[tuple], list[tuple]]:
    """Return the rows of both tables for a cable."""
    from scipy.stats import spearmanr

    state = reset_state(cable, paths, args.fine)
    fine = land(cable, paths, args.fine, FINE_DT, **TO_THE_END)
    gains, rows = [], []
    for perturbation in PERTURBATIONS:
        distances = []
        for sign in (1.0, -1.0):
            start = perturbation.applied(state, cable, sign)
            landing = land(cable, paths, args.fine, FINE_DT, start, **TO_THE_END)
            distances.append(landing_error_pct(landing, fine, cable))
        # The larger of both directions: near a fold a cast may be insensitive to one of them.
        moved = np.maximum(*distances)
        gains.append(moved / (100.0 * perturbation.size(cable) / cable.length))
        percentiles = np.percentile([moved, gains[-1]], [50, 90], axis=1).T
        rows.append((cable.name, str(perturbation), *percentiles.ravel()))
    # The small turn and the small bow stay in the linear range; the larger of both is the gain.
    gain = np.maximum(*gains[::2])
    sensitive = gain >= np.percentile(gain, 75)
    errors = []
    for segment_count, dt in COARSE:
        landing = land(cable, paths, segment_count, dt, **TO_THE_END)
        error = landing_error_pct(landing, fine, cable)
        errors.append(
            (
                cable.name,
                segment_count,
                dt * 1e3,
                *np.percentile(error, [50, 90]),
                spearmanr(error, gain)[0],
                np.percentile(error[sensitive], 90),
                np.percentile(error[~sensitive], 90),
            )
        )
    return rows, errors


def sensitivity(args: SensitivityArgs) -> Iterator[Table]:
    paths = random_casts(args.count, args.seed)
    nature = Table(
        f"How far landings move with the initial state, {args.fine} segments at "
        f"{FINE_DT * 1e3:g} ms, {args.count} actions, in % of cable length",
        ("cable", "initial state", "median [%]", "p90 [%]", "gain, median", "gain, p90"),
        [],
    )
    method = Table(
        "Errors of a coarser engine, and whether they go with the gain",
        (
            "cable",
            "segments",
            "step [ms]",
            "error, median [%]",
            "error, p90 [%]",
            "rank correlation with gain",
            "p90, most sensitive quarter [%]",
            "p90, all others [%]",
        ),
        [],
    )
    for name in args.cables:
        rows, errors = study(load_cable(name), paths, args)
        nature.rows += rows
        method.rows += errors
    yield nature
    yield method
