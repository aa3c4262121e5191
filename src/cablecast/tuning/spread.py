"""Spread actions: calibration casts whose landings are spread over the table.

Random actions land mostly in the middle of what the arm reaches, and a fit to a few of them says
little of casts that swing wide. So the believed cable is simulated, and the area in which it lands
is divided into as many parts as there are casts (Lloyd's algorithm); near the middle of each the
most typical action is taken, by turns to the right and to the left. Only actions are used whose
simulated free end stays on the table.
"""

import numpy as np
from numpy.typing import NDArray

from cablecast.conventions import stream
from cablecast.engines.base import Engine
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import InputError, check_seed
from cablecast.motion.action import ActionRanges, mirror_actions, mirror_to_right
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.setup import Setup

EDGE = 0.05
"""Distance that every simulated sample keeps from the table's edges [m]."""

# Actions to choose from.
_POOL_COUNT = 2000
_SAMPLE_DT = 0.05
# Landings in the same square of this width count once, so that a part is a part of the area [m].
_CELL = 0.05
_STARTS, _ROUNDS = 20, 50
# Actions that land nearest to the middle of a part.
_NEAR_COUNT = 15


def spread_actions(
    setup: Setup,
    count: int,
    engine: Engine,
    ranges: ActionRanges | None = None,
    seed: int = 0,
) -> NDArray[np.float64]:
    """Choose actions whose simulated landings are spread over the table, shape [count, 5].

    They go to the right and to the left by turns, and are from ranges that suit the set-up where
    none are given. The landings are those of the believed cable.

    Raises:
        InputError: Too few actions stay on the table, or the seed is out of bounds.
    """
    pool = feasible_uniform(max(_POOL_COUNT, 10 * count), setup, ranges, check_seed(seed))
    actions, _ = mirror_to_right(pool)
    paths = cast_grip_paths(actions, setup)
    believed = Dynamics.of(None, setup)
    xy = believed.rollout(engine, setup, paths, sample_dt=_SAMPLE_DT).endpoint_xy
    distance = setup.workspace.edge_distance(xy)
    # On a small table the free end may lie nearer to an edge after the reset: it may come as near.
    # Where it barely moves away from there, any cast counts that stays on the table.
    for edge in (min(EDGE, 0.9 * float(distance[:, 0].min())), 0.0):
        safe = np.isfinite(xy).all(axis=(1, 2)) & (distance.min(axis=1) > edge)
        landing_xy = xy[safe, -1]
        _, first = np.unique(np.round(landing_xy / _CELL), axis=0, return_index=True)
        if len(first) >= count:
            break
    else:
        raise InputError(
            f"simulated casts of the believed cable land at "
            f"{len(first)} places of the table, too few to spread {count} casts: `cablecast "
            "check` says what would reach more"
        )
    actions = actions[safe]
    scale = actions.std(axis=0) + 1e-9
    chosen: list[int] = []
    for middle in _middles(landing_xy[first], count, seed):
        distance = np.linalg.norm(landing_xy - middle, axis=1)
        # No cast twice, where parts lie near each other.
        distance[chosen] = np.inf
        near = np.argsort(distance)[: min(_NEAR_COUNT, len(distance) - len(chosen))]
        unusual = np.linalg.norm((actions[near] - np.median(actions[near], axis=0)) / scale, axis=1)
        chosen.append(near[np.argmin(unusual)])
    return mirror_actions(actions[chosen], np.where(np.arange(count) % 2 == 1, -1.0, 1.0))


def _middles(points: NDArray[np.float64], count: int, seed: int) -> NDArray[np.float64]:
    """Divide points [m], shape [point, 2], into `count` parts that lie close together.

    Return their middles from left to right [m], shape [part, 2].
    """
    from scipy.cluster.vq import kmeans2

    best, least = points[:count], np.inf
    for start in range(_STARTS):
        rng = stream(seed, "spread casts", start)
        first = points[rng.choice(len(points), count, replace=False)]
        middles, part = kmeans2(points, first, iter=_ROUNDS, minit="matrix", missing="warn")
        cost = float(np.sum((points - middles[part]) ** 2))
        if cost < least:
            best, least = middles, cost
    return best[np.argsort(best[:, 0])]
