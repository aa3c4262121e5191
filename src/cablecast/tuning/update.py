"""Update of fitted parameters by a few more casts, without those that they were fitted to.

What the earlier casts taught stands as a Gaussian, the posterior of the fit. One damped
Gauss-Newton step leads from there towards the new tracks, as in an iterated Kalman filter: its cost
depends on the new casts only, however many came before.
"""

import dataclasses

import numpy as np

from cablecast.cable import Cable, CableParams
from cablecast.engines.base import Engine
from cablecast.tuning.least_squares import Curvature, TrackFit
from cablecast.tuning.objective import TrackObjective
from cablecast.tuning.posterior import ParamPosterior
from cablecast.tuning.prior import CorrelatedBelief
from cablecast.tuning.tracks import MeasuredTracks

WIDENING = 2.0
"""Factor of the posterior's deviations. New casts that lie close together ask for the parameters
that are right for casts like them; the model's own error differs from place to place."""


class ParamUpdate:
    """Single-step updates of one simulator's parameters towards new casts.

    Every update starts from the same parameters, so the gradient of a cast is simulated once and
    reused by later updates.

    Args:
        engine: Simulator.
        cable: Cable that is cast, with its material.
        posterior: Uncertainty that earlier casts left. Its covariance counts, not its mean.
        params: Parameters that follow the earlier casts; one set.
    """

    def __init__(
        self, engine: Engine, cable: Cable, posterior: ParamPosterior, params: CableParams
    ):
        self.engine = engine
        self.cable = cable
        self.params = params
        self._space, self._misfit = posterior.space, posterior.misfit
        self._point = posterior.space.to_unit(params)
        precision = np.linalg.inv(WIDENING**2 * posterior.covariance)
        self._belief = CorrelatedBelief(
            mean=self._point, precision=np.asarray(precision, dtype=float)
        )
        self._known: dict[bytes, Curvature] = {}

    def params_after(self, tracks: MeasuredTracks) -> CableParams:
        """Return the parameters after one step; those at its start where no step is better.

        Args:
            tracks: New casts, of which some sample can be compared with a simulation.

        Raises:
            InputError: No sample of any track can be compared.
        """
        seen = np.flatnonzero(tracks.compared.any(axis=1))
        curves = [self._curvature(tracks.alone(int(row))) for row in seen]
        # The prior has no slope at its mean.
        precision = self._belief.precision
        joined = Curvature(
            loss=float(np.mean([curve.loss for curve in curves])),
            gradient=np.sum([curve.gradient for curve in curves], axis=0),
            hessian=precision + np.sum([curve.hessian - precision for curve in curves], axis=0),
        )
        state = self._fit(tracks).first_step(self._point[None], self._misfit, [joined])
        values = self._space.to_params(state.points[0]).to_array()
        named = zip(self.params.names(), map(float, values), strict=True)
        return dataclasses.replace(self.params, **dict(named))

    def _fit(self, tracks: MeasuredTracks) -> TrackFit:
        return TrackFit(TrackObjective(self.engine, self.cable, tracks), self._space, self._belief)

    def _curvature(self, track: MeasuredTracks) -> Curvature:
        """Return the quadratic model of one cast's cost at the start parameters."""
        measured = (track.actions, track.times, track.endpoint_xy)
        key = b"".join(values.tobytes() for values in measured)
        if key not in self._known:
            (self._known[key],) = self._fit(track).curvatures(self._point[None], self._misfit)
        return self._known[key]
