"""Beliefs about a fitted simulator before it is tried: how far off its landings may be."""

import dataclasses

import numpy as np

from cablecast.cable import CableParams
from cablecast.models.few_casts import ResidualScales
from cablecast.models.local_size import LocalSize
from cablecast.motion.action import mirror_actions
from cablecast.motion.cast import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.pipeline.simulate import make_engine
from cablecast.pipeline.tuned import Tuned

# Casts and posterior draws that tell how far off first casts may be, and the coarse cable for it.
_SPREAD_ACTIONS, _SPREAD_DRAWS, _SPREAD_SEED = 240, 12, 7
_SPREAD_ENGINE = (30, 1e-3)
# Median distance from the middle of a round normal distribution, over the deviation of each axis.
_MEDIAN_RADIUS = np.sqrt(2.0 * np.log(2.0))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Beliefs:
    """Expected errors of a fitted simulator before it is tried.

    Attributes:
        scales: Scales of real landings about the simulated ones.
        size: By how much more casts to one place may miss than to another; None where the fit has
            no posterior.
    """

    scales: ResidualScales = dataclasses.field(default_factory=ResidualScales)
    size: LocalSize | None = None


def make_beliefs(tuned: Tuned | None) -> Beliefs:
    """Return how far landings are expected to be from those of a fitted simulator.

    Some casts are simulated with draws of the posterior. Their spread, which is wide after two
    casts and narrow after twenty, adds to the error that the model keeps however well it is fitted.

    Args:
        tuned: Result of `tune`; None for a simulator that was not fitted.
    """
    if tuned is None or tuned.posterior is None:
        return Beliefs()
    setup = tuned.setup
    actions = feasible_uniform(_SPREAD_ACTIONS, setup, seed=_SPREAD_SEED)
    actions = np.where(actions[:, 1:2] < 0, mirror_actions(actions), actions)
    draws = tuned.posterior.draw(_SPREAD_DRAWS, _SPREAD_SEED).to_array()
    drawn = CableParams.from_array(np.tile(draws, (_SPREAD_ACTIONS, 1)))
    rows = np.repeat(np.arange(_SPREAD_ACTIONS), _SPREAD_DRAWS)
    rollout = tuned.dynamics.with_params(drawn).rollout(
        make_engine(*_SPREAD_ENGINE), setup, cast_grip_paths(actions, setup)[rows]
    )
    landings = rollout.endpoint_xy[:, -1].reshape(_SPREAD_ACTIONS, _SPREAD_DRAWS, 2)
    # Some draws throw a sensitive cast far away: medians tell what is usual, variances do not.
    middle = np.nanmedian(landings, axis=1, keepdims=True)
    distance = np.nanmedian(np.linalg.norm(landings - middle, axis=2), axis=1)
    spread = distance / _MEDIAN_RADIUS / setup.cable.length
    known = np.isfinite(spread)
    size = LocalSize(landing_xy=middle[known, 0], values=spread[known])
    usual = ResidualScales()
    amplitude = float(np.hypot(usual.amplitude, size.usual))
    return Beliefs(scales=dataclasses.replace(usual, amplitude=amplitude), size=size)
