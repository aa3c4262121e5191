"""Update of fitted parameters by a few more casts, without those that they were fitted to.

What the earlier casts taught stands as a Gaussian, the posterior of the fit. One damped
Gauss-Newton step leads from there towards the new tracks, as in an iterated Kalman filter: its cost
depends on the new casts only, however many came before.
"""

import dataclasses

import numpy as np

from cablecast.cable import CableParams
from cablecast.tuning.least_squares import TrackFit
from cablecast.tuning.objective import TrackObjective
from cablecast.tuning.posterior import ParamPosterior
from cablecast.tuning.prior import CorrelatedBelief

WIDENING = 2.0
"""Factor of the posterior's deviations. New casts that lie close together ask for the parameters
that are right for casts like them; the model's own error differs from place to place."""


def updated_params(
    objective: TrackObjective, posterior: ParamPosterior, params: CableParams
) -> CableParams:
    """Move parameters towards a few new casts.

    Args:
        objective: Simulator and the tracks of the new casts.
        posterior: Uncertainty that earlier casts left. Its covariance counts, not its mean.
        params: Parameters that follow the earlier casts; one set.

    Returns:
        The parameters after one step; those that were given where no step is better.
    """
    point = posterior.space.to_unit(params)
    precision = np.linalg.inv(WIDENING**2 * posterior.covariance)
    belief = CorrelatedBelief(mean=point, precision=np.asarray(precision, dtype=float))
    fit = TrackFit(objective, posterior.space, belief)
    state = fit.first_step(point[None], posterior.misfit)
    values = posterior.space.to_params(state.points[0]).to_array()
    return dataclasses.replace(params, **dict(zip(params.names(), map(float, values), strict=True)))
