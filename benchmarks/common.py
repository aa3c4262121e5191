"""Shared parts of the benchmarks: random casts, landings, errors of a resolution, hits."""

import importlib.util
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from cablecast.cable import Cable
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.grip_path import GripPath
from cablecast.setup import Setup

REACHED_BY = {
    "calm": "calm casts",
    "edge": "calm casts, at their edge",
    "wild": "fast casts only",
}
"""Words of each outlook of `check`."""


def hit_share(hits: int, count: int) -> tuple[float | None, float | None, float | None]:
    """Return the share of targets that was hit [%] and its 90 % interval; None of no targets."""
    if not count:
        return None, None, None
    interval = binomtest(hits, count).proportion_ci(0.9, method="wilson")
    return 100.0 * hits / count, 100.0 * float(interval.low), 100.0 * float(interval.high)


def has(library: str) -> bool:
    """Return True if a library is installed."""
    return importlib.util.find_spec(library) is not None


def random_casts(count: int, seed: int, setup: Setup | None = None) -> GripPath:
    """Return uniformly drawn casts that the arm can follow, one row per cast.

    Args:
        count: Number of casts.
        seed: Seed of the draws.
        setup: Arm, reset position and system parameters; the paper's by default (v_max 1.5 m/s).
    """
    setup = setup or Setup()
    return cast_grip_paths(feasible_uniform(count, setup, seed=seed), setup)


def land(
    cable: Cable,
    paths: GripPath,
    segment_count: int,
    dt: float,
    state: CableState | None = None,
    **options: Any,
) -> NDArray[np.float64]:
    """Return the resting places of the endpoint with EngineWarp [m], shape [action, 2].

    Args:
        cable: Cable with its parameters.
        paths: Casts.
        segment_count: Number of segments.
        dt: Step [s].
        state: Initial state; the reset state where None.
        **options: Further options of EngineWarp; double precision unless they say otherwise.
    """
    engine = EngineWarp(segment_count=segment_count, dt=dt, **({"precision": "double"} | options))
    return engine.rollout(cable, paths, state).endpoint_xy[:, -1]


def track_errors(
    play: Callable[[int, float], NDArray[np.float64]],
    rungs: Sequence[tuple[int, float]],
    fine: tuple[int, float],
) -> NDArray[np.float64]:
    """Return the median distance of tracks from those at a fine resolution [m], shape [rung].

    Args:
        play: Returns tracks of the endpoint [m], shape [action, step, 2], for a number of segments
            and a step [s].
        rungs: Segments and step [s] of each resolution.
        fine: Segments and step [s] of the reference.
    """
    reference = play(*fine)
    distances = (np.linalg.norm(play(*rung) - reference, axis=-1) for rung in rungs)
    return np.array([np.median(distance) for distance in distances])


def landing_error_pct(
    landing_xy: NDArray[np.float64], reference_xy: NDArray[np.float64], cable: Cable
) -> NDArray[np.float64]:
    """Return the distance of landings from a reference [% of cable length], shape [action]."""
    return 100.0 * np.linalg.norm(landing_xy - reference_xy, axis=-1) / cable.length
