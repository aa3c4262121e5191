"""Robustness of EngineWarp: parameters over the whole allowed range, and the fastest casts."""

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Table, random_casts
from cablecast.cable import PAPER_PARAMS, PARAMS, Cable
from cablecast.engines.warp_ import EngineWarp
from cablecast.setup import Setup

BATCH = 2_000
CAST_COUNT = 500
V_MAX = 1.8
"""Speed of the paper's fastest casts [m/s]."""
LENGTH_ERROR_MAX = 0.01
"""Relative error above which a cable has visibly not kept its length [-]."""


def draw_params(count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return random parameters of cables, shape [count, 10].

    They are drawn by their logarithm, over five decades at most, so that light and soft cables come
    as often as others.

    Args:
        count: Number of cables.
        rng: Source of the draws.
    """
    low, high = np.array([PARAMS[name].bounds for name in PAPER_PARAMS]).T
    floor = np.maximum(low, high * 1e-5)
    values = floor * (high / floor) ** rng.uniform(size=(count, len(low)))
    return np.clip(values, low, high)


def robust(cable: Cable, duration: float, count: int, seed: int) -> Table:
    """Count worlds that fail with random parameters and the fastest casts.

    Listed beside the worlds that become non-finite are those that move differently with other
    neighbours in their batch.

    Args:
        cable: Geometry.
        duration: Duration of a rollout [s].
        count: Number of worlds.
        seed: Seed of the draws.
    """
    rng = np.random.default_rng(seed)
    values = draw_params(count, rng)
    paths = random_casts(CAST_COUNT, seed, Setup().with_motion(v_max=V_MAX))
    paths = paths[np.arange(count) % len(paths)]
    engine = EngineWarp()
    broken, unmarked, stretched, spoilt = 0, 0, 0, 0
    for start in range(0, count, BATCH):
        batch = np.arange(start, min(start + BATCH, count))

        def play(rows, **options):
            drawn = dict(zip(PAPER_PARAMS, values[rows].T, strict=True))
            return engine.rollout(
                cable.with_params(**drawn), paths[rows], duration=duration, **options
            )

        rollout = play(batch, record_nodes=True)
        assert rollout.nodes is not None
        whole = np.isfinite(rollout.nodes).all(axis=(1, 2, 3))
        broken += int((~rollout.finite).sum())
        unmarked += int((rollout.finite & ~whole).sum())
        edges = np.linalg.norm(np.diff(rollout.nodes, axis=2), axis=3)
        error = np.abs(edges * engine.segment_count / cable.length - 1.0).max(axis=(1, 2))
        stretched += int((error[whole] > LENGTH_ERROR_MAX).sum())
        # Every world again, among others than before.
        order = rng.permutation(len(batch))
        again = play(batch[order]).endpoint_xyz
        same = (again == rollout.endpoint_xyz[order]) | (
            np.isnan(again) & np.isnan(rollout.endpoint_xyz[order])
        )
        spoilt += int((~same.all(axis=(1, 2))).sum())
    table = Table(
        f"EngineWarp at its defaults, parameters over the whole allowed range, v_max {V_MAX:g} m/s",
        (
            "worlds",
            "non-finite",
            "[%]",
            "of these not marked",
            "other than among other worlds",
            f"a length off by {100 * LENGTH_ERROR_MAX:g} %",
        ),
        [],
    )
    table.rows.append((count, broken, 100.0 * broken / count, unmarked, spoilt, stretched))
    return table
