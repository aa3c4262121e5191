"""Beliefs about a fitted simulator before it is tried: how far off its landings may be."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import CableParams
from cablecast.dynamics import Dynamics
from cablecast.models.few_casts import ResidualScales
from cablecast.models.local_size import LocalSize
from cablecast.motion.action import mirror_actions
from cablecast.motion.cast import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.pipeline.simulate import make_engine
from cablecast.pipeline.tuned import Tuned
from cablecast.setup import Setup

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
    middle, distance = landing_spread(
        tuned.setup,
        tuned.posterior.draw(_SPREAD_DRAWS, _SPREAD_SEED),
        count=_SPREAD_ACTIONS,
        dynamics=tuned.dynamics,
    )
    spread = distance / _MEDIAN_RADIUS / tuned.setup.cable.length
    known = np.isfinite(spread)
    size = LocalSize(landing_xy=middle[known], values=spread[known])
    usual = ResidualScales()
    amplitude = float(np.hypot(usual.amplitude, size.usual))
    return Beliefs(scales=dataclasses.replace(usual, amplitude=amplitude), size=size)


def landing_spread(
    setup: Setup, draws: CableParams, *, count: int, dynamics: Dynamics
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where random casts land over several cables, and how far apart [m].

    Some cables throw a sensitive cast far away: medians tell what is usual, variances do not.

    Args:
        setup: Set-up to simulate.
        draws: One value per cable.
        count: Number of random casts.
        dynamics: Engine settings that a fit may choose; its cable parameters are not used.

    Returns:
        Medians of the landings, shape [cast, 2], and median distances from them, shape [cast]; NaN
        where no cable lands.
    """
    actions = feasible_uniform(count, setup, seed=_SPREAD_SEED)
    actions = np.where(actions[:, 1:2] < 0, mirror_actions(actions), actions)
    values = draws.to_array()
    rows = np.repeat(np.arange(count), len(values))
    rollout = dynamics.with_params(CableParams.from_array(np.tile(values, (count, 1)))).rollout(
        make_engine(*_SPREAD_ENGINE), setup, cast_grip_paths(actions, setup)[rows]
    )
    landings = rollout.endpoint_xy[:, -1].reshape(count, len(values), 2)
    middle = np.nanmedian(landings, axis=1)
    apart = np.linalg.norm(landings - middle[:, None], axis=2)
    return middle, np.nanmedian(apart, axis=1)
