"""Tell the error that a coarse EngineWarp makes from the cast's own sensitivity.

A cast is a whip: it magnifies any difference at its start. Each action is played at a fine
resolution from initial states that differ by as much as a careful reset leaves; the movement of its
landing over that of the free end is the cast's gain. An error of the method is a small difference
that enters along the way and meets the same gain. If the errors of the worst tenth are large
because their gain is, then errors and gains go together, and errors divided by gains spread less
than errors do.
"""

import dataclasses
import pathlib

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Table, land, landing_error_pct, random_casts, write_json
from benchmarks.convergence import FINE_DT, FINE_SEGMENT_COUNT
from cablecast.cable import CABLE_NAMES, Cable, load_cable
from cablecast.engines.base import CableState, reset_state
from cablecast.engines.warp_.engine import DEFAULT_DT, DEFAULT_SEGMENT_COUNT
from cablecast.motion.grip_path import GripPath

COARSE = ((DEFAULT_SEGMENT_COUNT, DEFAULT_DT), (2 * DEFAULT_SEGMENT_COUNT, DEFAULT_DT / 2))
"""Segments and step [s] whose errors are measured: the default, and one twice as fine."""

TO_THE_END = {"rest_speed": 0.0}
"""Options of the engine: stopping early moves a landing by as much as a small perturbation does."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Sensitivity of casts, beside the error of the method.

    Attributes:
        cables: Names of presets.
        count: Number of random feasible actions, at v_max 1.5 m/s with psi.
        seed: Seed of the actions.
        fine: Number of segments at which the sensitivity is measured.
        json: File that gets the figures, too.
    """

    cables: tuple[str, ...] = CABLE_NAMES
    count: int = 100
    seed: int = 0
    fine: int = FINE_SEGMENT_COUNT
    json: pathlib.Path | None = None


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


def rank_correlation(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return Spearman's rank correlation [-]."""
    from scipy.stats import rankdata

    return float(np.corrcoef(rankdata(a), rankdata(b))[0, 1])


def spread(values: NDArray[np.float64]) -> float:
    """Return the 90th percentile over the median [-]."""
    return float(np.percentile(values, 90) / np.median(values))


def study(cable: Cable, paths: GripPath, args: Args) -> tuple[list[tuple], list[tuple]]:
    """Return the rows of both tables for a cable."""
    state = reset_state(cable, paths, args.fine)
    fine = land(cable, paths, args.fine, FINE_DT, **TO_THE_END)
    moved, rows = {}, []
    for perturbation in PERTURBATIONS:
        distances = []
        for sign in (1.0, -1.0):
            start = perturbation.applied(state, cable, sign)
            landing = land(cable, paths, args.fine, FINE_DT, start, **TO_THE_END)
            distances.append(landing_error_pct(landing, fine, cable))
        # The larger of both directions: near a fold a cast may be insensitive to one of them.
        moved[perturbation] = np.maximum(*distances)
        gain = moved[perturbation] / (100.0 * perturbation.size(cable) / cable.length)
        rows.append(
            (
                cable.name,
                str(perturbation),
                *(float(v) for v in np.percentile(moved[perturbation], [50, 90])),
                *(float(v) for v in np.percentile(gain, [50, 90])),
            )
        )
    # The small turn and the small bow stay in the linear range; the larger of both is the gain.
    gain = np.maximum(
        *(moved[p] / (100.0 * p.size(cable) / cable.length) for p in PERTURBATIONS[::2])
    )
    sensitive = gain >= np.percentile(gain, 75)
    largest = np.maximum(moved[PERTURBATIONS[1]], moved[PERTURBATIONS[3]])
    errors = []
    for segment_count, dt in COARSE:
        landing = land(cable, paths, segment_count, dt, **TO_THE_END)
        error = landing_error_pct(landing, fine, cable)
        errors.append(
            (
                cable.name,
                segment_count,
                dt * 1e3,
                *(float(v) for v in np.percentile(error, [50, 90])),
                rank_correlation(error, gain),
                spread(error),
                spread(error / gain),
                float(np.percentile(error[sensitive], 90)),
                float(np.percentile(error[~sensitive], 90)),
                float(100.0 * np.mean(error <= largest)),
            )
        )
    return rows, errors


def main(args: Args) -> None:
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
            "p90 / median of error",
            "of error / gain",
            "p90, most sensitive quarter [%]",
            "p90, all others [%]",
            "below what 1 mm or 1 mrad moves [% of casts]",
        ),
        [],
    )
    for name in args.cables:
        rows, errors = study(load_cable(name), paths, args)
        nature.rows += rows
        method.rows += errors
    for table in (nature, method):
        print(table, flush=True)
    write_json(args.json, [nature, method])
