"""Beliefs about a fitted simulator before it is tried: how far off its landings may be."""

import dataclasses

import numpy as np

from cablecast.aiming.ensemble import EnsembleLandings
from cablecast.aiming.residual import LocalSize, ResidualScales
from cablecast.engines import make_engine
from cablecast.motion.action import mirror_to_right
from cablecast.motion.feasibility import feasible_uniform
from cablecast.tuning.tuned import Tuned

# Casts that tell how far apart the simulators of an ensemble usually land.
_ACTION_COUNT, _SEED = 240, 7


@dataclasses.dataclass(frozen=True, kw_only=True)
class Beliefs:
    """Expected errors of a fitted simulator before it is tried.

    Attributes:
        scales: Scales of real landings about the simulated ones.
        size: By how much more casts to one place may miss than to another; None where the fit has
            no ensemble.
        ensemble: Simulators by which each single cast is judged; None where the fit has none.
    """

    scales: ResidualScales = dataclasses.field(default_factory=ResidualScales)
    size: LocalSize | None = None
    ensemble: EnsembleLandings | None = None


def make_beliefs(tuned: Tuned | None) -> Beliefs:
    """Return how far landings are expected to be from those of a fitted simulator.

    Args:
        tuned: Result of `tune`; None for a simulator of which nothing is known, whose landings are
            taken to be as far off as those of one that follows some casts as usual.
    """
    if tuned is None or tuned.ensemble is None:
        return Beliefs()
    fitted = tuned.ensemble
    ensemble = EnsembleLandings(
        tuned.setup,
        [dataclasses.replace(member, servo=tuned.dynamics.servo) for member in fitted.members],
        make_engine("warp", fitted.segment_count, fitted.dt),
        tuned.dynamics,
        make_engine("warp", fitted.fine_segment_count, fitted.fine_dt),
        tuned.posterior,
    )
    actions = feasible_uniform(_ACTION_COUNT, tuned.setup, seed=_SEED)
    said = ensemble.judge(*mirror_to_right(actions))
    known = np.isfinite(said.landing_xy).all(axis=1)
    size = LocalSize(landing_xy=said.landing_xy[known], values=said.sizes[known])
    # Casts that scatter cannot be followed more closely than they scatter.
    smaller = min(1.0, ensemble.factor)
    usual = ResidualScales()
    scales = dataclasses.replace(
        usual,
        amplitude=size.usual,
        noise=np.sqrt(smaller) * usual.noise,
        friction=smaller * usual.friction,
    )
    return Beliefs(scales=scales, size=size, ensemble=ensemble)
