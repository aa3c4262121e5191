"""Beliefs about a fitted simulator before it is tried: how far off its landings may be."""

import dataclasses

import numpy as np

from cablecast.cable import CableParams
from cablecast.engines.base import SETTLE_TIME
from cablecast.models.few_casts import ResidualScales
from cablecast.motion.cast import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.pipeline.simulate import make_engine
from cablecast.pipeline.tuned import Tuned

# Casts and posterior draws that tell how far off first casts may be, and the coarse cable for it.
_SPREAD_ACTIONS, _SPREAD_DRAWS, _SPREAD_SEED = 40, 24, 7
_SPREAD_ENGINE = (30, 1e-3)
# Median distance from the middle of a round normal distribution, over the deviation of each axis.
_MEDIAN_RADIUS = np.sqrt(2.0 * np.log(2.0))


def believed_scales(tuned: Tuned) -> ResidualScales:
    """Return how far landings are expected to be from those of a fitted simulator.

    Some casts are simulated with draws of the posterior. Their spread, which is wide after two
    casts and narrow after twenty, adds to the error that the model keeps however well it is fitted.

    Args:
        tuned: Result of `tune`.
    """
    usual = ResidualScales()
    if tuned.posterior is None:
        return usual
    setup = tuned.setup
    actions = feasible_uniform(_SPREAD_ACTIONS, setup, seed=_SPREAD_SEED)
    draws = tuned.posterior.draw(_SPREAD_DRAWS, _SPREAD_SEED).to_array()
    paths = cast_grip_paths(actions, setup)
    if tuned.servo is not None:
        paths = tuned.servo.apply(paths, setup.arm)
    rows = np.repeat(np.arange(_SPREAD_ACTIONS), _SPREAD_DRAWS)
    rollout = make_engine(*_SPREAD_ENGINE).rollout(
        setup.cable,
        CableParams.from_array(np.tile(draws, (_SPREAD_ACTIONS, 1))),
        paths[rows],
        duration=float(paths.duration.max()) + SETTLE_TIME,
    )
    landings = rollout.endpoint_xy[:, -1].reshape(_SPREAD_ACTIONS, _SPREAD_DRAWS, 2)
    # Some draws throw a sensitive cast far away: medians tell what is usual, variances do not.
    middle = np.nanmedian(landings, axis=1, keepdims=True)
    distance = np.nanmedian(np.linalg.norm(landings - middle, axis=2), axis=1)
    spread = float(np.nanmedian(distance)) / _MEDIAN_RADIUS / setup.cable.length
    amplitude = float(np.hypot(usual.amplitude, spread))
    return dataclasses.replace(usual, amplitude=amplitude)
