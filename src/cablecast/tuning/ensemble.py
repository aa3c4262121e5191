"""Fits with other physics that follow the same casts, and updates of fits by new casts.

A handful of casts is followed as well by a cable that is dragged by the air, curled, or rubs
differently along and across itself, once the ten parameters are fitted with each. Where these
simulators land a cast far apart, none of them can be trusted there. What the posterior of one
simulator says of its parameters does not tell that: it takes its physics for granted.

`ParamUpdate` updates fitted parameters by a few more casts, without those that they were fitted to:
these enter as a Gaussian, the posterior of the fit. One damped Gauss-Newton step leads from there
towards the new tracks, as in an iterated Kalman filter, so its cost depends on the new casts only.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from cablecast.cable import PARAMS, Cable, CableParams
from cablecast.engines.base import Engine
from cablecast.engines.dynamics import Dynamics
from cablecast.tuning.fit import Curvature, FitState, TrackFit
from cablecast.tuning.space import Gaussian, ParamPosterior
from cablecast.tuning.tracks import MeasuredTracks, TrackObjective

# Differences from the fitted material: air drags on a smooth cylinder with 1 to 1.2, ropes lose
# energy within some hundredths of a second, the other two are too small to be noticed by eye.
# A curl is given by how far it turns the whole cable [rad].
_DRAG, _DAMPING_TIME = 1.1, 0.02
_GRAINS = (0.8, 1.25)
_CURLS = (-0.2, 0.2)

MEMBER_COUNT = 2 + len(_GRAINS) + len(_CURLS)
"""Number of simulators."""


def other_materials(params: CableParams, length: float) -> tuple[CableParams, ...]:
    """Return `MEMBER_COUNT` parameters of a cable of a length [m], each with another material.

    The first are as they were.
    """

    def changed(**values: float) -> CableParams:
        inside = {k: float(np.clip(value, *PARAMS[k].bounds)) for k, value in values.items()}
        return dataclasses.replace(params, **inside)

    return (
        params,
        changed(
            drag_coefficient=float(params.drag_coefficient) + _DRAG,
            damping_time=max(float(params.damping_time), _DAMPING_TIME),
        ),
        *(changed(friction_ratio=float(params.friction_ratio) * factor) for factor in _GRAINS),
        *(changed(rest_curvature=float(params.rest_curvature) + curl / length) for curl in _CURLS),
    )


def fit_ensemble(
    fit: TrackFit,
    params: CableParams,
    misfit: float,
    run: Callable[[TrackFit, FitState], FitState],
) -> tuple[Dynamics, ...]:
    """Fit the parameters anew with each of some materials.

    Args:
        fit: Fit of the ten parameters at the resolution at which the ensemble will be simulated.
        params: Parameters that were found, from which each fit starts.
        misfit: Scale of the model's own error that was found [cable lengths].
        run: Takes the steps of one of these fits from a state.
    """
    start = fit.space.to_unit(params)[None]
    members = []
    for other in other_materials(params, fit.objective.cable.length):
        space = fit.space.of_paper(other)
        tried = TrackFit(fit.objective, space, fit.prior)
        state = run(tried, tried.start(start, misfit))
        members.append(Dynamics(params=space.to_params(state.best().points[0])))
    return tuple(members)


WIDENING = 2.0
"""Factor of the posterior's deviations. New casts that lie close together ask for the parameters
that are right for casts like them; the model's own error differs from place to place."""


class ParamUpdate:
    """Single-step updates of one simulator's parameters towards new casts.

    Every update starts from the same parameters, so the gradient of a cast is simulated once and
    reused by later updates.

    Args:
        engine: Simulator.
        cable: Cable that is cast.
        posterior: Uncertainty that earlier casts left. Its covariance counts, not its mean.
        params: Parameters that follow the earlier casts; one set. Their material stays.
    """

    def __init__(
        self, engine: Engine, cable: Cable, posterior: ParamPosterior, params: CableParams
    ):
        self.engine = engine
        self.cable = cable
        self._space, self._misfit = posterior.space.of_paper(params), posterior.misfit
        self._point = self._space.to_unit(params)
        precision = np.linalg.inv(WIDENING**2 * posterior.covariance)
        self._belief = Gaussian(mean=self._point, precision=np.asarray(precision, dtype=float))
        self._known: dict[bytes, Curvature] = {}

    def params_after(self, tracks: MeasuredTracks) -> CableParams:
        """Return the parameters after one step to new casts; as they were where none is better.

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
        fit = self._fit(tracks)
        state = fit.step(fit.start(self._point[None], self._misfit), [joined])
        return self._space.to_params(state.points[0])

    def _fit(self, tracks: MeasuredTracks) -> TrackFit:
        return TrackFit(TrackObjective(self.engine, self.cable, tracks), self._space, self._belief)

    def _curvature(self, track: MeasuredTracks) -> Curvature:
        """Return the quadratic model of one cast's cost at the start parameters."""
        measured = (track.actions, track.times, track.endpoint_xy)
        key = b"".join(values.tobytes() for values in measured)
        if key not in self._known:
            (self._known[key],) = self._fit(track).curvatures(self._point[None], self._misfit)
        return self._known[key]
