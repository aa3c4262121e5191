"""Fit of a cable by least squares: starts, resolutions, bounds that are widened, and the result."""

import dataclasses
import functools
import time
from collections.abc import Callable

import numpy as np

from cablecast.cable import PARAM_BOUNDS, Cable, CableParams
from cablecast.engines.base import Engine
from cablecast.material import Material
from cablecast.tuning.ensemble import fit_ensemble
from cablecast.tuning.least_squares import (
    MISFIT_START,
    FitConfig,
    FitState,
    TrackFit,
    run_fit,
)
from cablecast.tuning.material_space import MaterialSpace
from cablecast.tuning.objective import TrackDistances, TrackObjective
from cablecast.tuning.posterior import BOUND_DISTANCE, ParamPosterior
from cablecast.tuning.prior import ParamPrior
from cablecast.tuning.search_space import SearchSpace
from cablecast.tuning.tracks import MeasuredTracks
from cablecast.tuning.tune import COARSE, ENSEMBLE, FINE, TuneProgress, TuneResult

WIDEN_MAX = 2
"""Times that ranges are widened at most."""

# A parameter must be this much better known than before for its bound to be in the way.
_KNOWN = 0.7


def fit_params(
    cable: Cable,
    training: MeasuredTracks,
    validation: MeasuredTracks | None,
    coarse_engine: Engine,
    engine: Engine,
    config: FitConfig | None = None,
    *,
    progress: Callable[[TuneProgress], None] | None = None,
) -> TuneResult:
    """Find the parameters by Levenberg-Marquardt with a prior, and how surely they are known.

    Args:
        cable: Cable that was cast, with what is believed of it.
        training: Tracks to fit.
        validation: Tracks to measure the result with; the training tracks where None.
        coarse_engine: Simulator of the first steps.
        engine: Simulator of the last steps, at the resolution at which the result will be used.
        config: Settings of the fit.
        progress: Called after every step.

    Raises:
        InputError: No sample of the tracks can be compared.
    """
    config = config or FitConfig()
    began = time.monotonic()
    fine = TrackObjective(engine, cable, training)
    coarse = TrackObjective(coarse_engine, cable, training)
    report = _Report(cable.length, progress, began)
    found, none = (MaterialSpace(cable, names) for names in (config.materials, ()))
    # A rod that has none of what a material adds, as a simulated one may, is followed worse with
    # it: what is usual of a real cable is wrong for it, and parameters make up for that.
    tried = [found, none] if len(found) else [none]
    report.extend(len(tried) * (config.coarse_iterations + config.fine_iterations))
    fits = [_fit_with(materials, coarse, fine, config, report) for materials in tried]
    likeliest = min(fits, key=lambda one: one.unlikelihood)
    state, posterior, material = likeliest.state, likeliest.posterior, likeliest.material
    space, fitted = posterior.space, cable.with_material(material)
    best = state.best(len(state.points))
    params = posterior.params
    steps = functools.partial(report.step, ENSEMBLE, extra=config.ensemble_iterations)
    fit = TrackFit(TrackObjective(coarse_engine, fitted, training), space, posterior.prior)
    ensemble = fit_ensemble(fit, engine, params, state.misfit, config.ensemble_iterations, steps)

    def distances(tracks: MeasuredTracks) -> TrackDistances:
        believed = TrackObjective(engine, cable, tracks).distances(cable.params)
        return believed.beside(TrackObjective(engine, fitted, tracks).distances(params))

    on_training = distances(training)
    return TuneResult(
        params=params,
        material=material,
        ensemble=ensemble,
        population=space.to_params(best.points[:, : space.dimension]),
        population_losses=best.losses * cable.length,
        space=space,
        training=on_training,
        validation=on_training if validation is None else distances(validation),
        training_status=training.status,
        validation_status=(training if validation is None else validation).status,
        simulation_count=report.count,
        coarse_simulation_count=report.count - report.fine_count,
        seconds=time.monotonic() - began,
        history=report.history,
        posterior=posterior,
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Fit:
    """Result of the fit with some values of the material.

    Attributes:
        unlikelihood: Negative log posterior density of its best point.
        state: Points of parameters and material.
        material: Material of the best point; None for the ten parameters alone.
        posterior: Uncertainty of the parameters, the material given.
    """

    unlikelihood: float
    state: FitState
    material: Material | None
    posterior: ParamPosterior


def _fit_with(
    materials: MaterialSpace,
    coarse: TrackObjective,
    fine: TrackObjective,
    config: FitConfig,
    report: "_Report",
) -> _Fit:
    """Fit the ten parameters and some values of the material.

    Args:
        materials: Values of the material, possibly none.
        coarse: Objective of the first steps.
        fine: Objective of the last steps.
        config: Settings of the fit.
        report: Told of every step.
    """
    cable = fine.cable
    space = SearchSpace.for_cable(cable)
    prior = ParamPrior.for_cable(cable, space)
    ten = space.dimension
    joined = materials.joined(prior)
    fit = TrackFit(coarse, space, joined, materials)
    state = fit.start(joined.draw(config.start_count, config.seed), MISFIT_START)
    state = run_fit(fit, state, config.coarse_iterations, report.step(COARSE, fit))
    points = state.best(config.fine_start_count).points
    for attempt in range(WIDEN_MAX + 1):
        fit = TrackFit(fine, space, materials.joined(prior), materials)
        state = fit.start(points, state.misfit)
        state = run_fit(fit, state, config.fine_iterations, report.step(FINE, fit))
        material = materials.to_material(state.best().points[0, ten:])
        fitted = cable.with_material(material)
        known = TrackFit(TrackObjective(fine.engine, fitted, fine.tracks), space, prior)
        posterior = _posterior(known, prior, state)
        wider = None if attempt == WIDEN_MAX else _widened(posterior, cable)
        if wider is None:
            break
        points = state.best(config.fine_start_count).points.copy()
        points[:, :ten] = wider.to_unit(space.to_params(points[:, :ten]))
        space, prior = wider, ParamPrior.for_cable(cable, wider)
        report.extend(config.fine_iterations)
    return _Fit(
        unlikelihood=fit.unlikelihood(state),
        state=state,
        material=material if len(materials) else None,
        posterior=posterior,
    )


def _posterior(fit: TrackFit, prior: ParamPrior, state: FitState) -> ParamPosterior:
    """Return the Gaussian whose curvature is that of F at the best point, its material given.

    Args:
        fit: Fit with the material of the best point.
        prior: Prior of the ten parameters.
        state: Points of the fit of parameters and material.
    """
    best = state.best()
    point = best.points[:, : fit.space.dimension]
    curve = fit.curvatures(point, best.misfit, expected=True)[0]
    covariance = np.linalg.inv(curve.hessian)
    return ParamPosterior(
        space=fit.space,
        prior=prior,
        mean=point[0],
        covariance=(covariance + covariance.T) / 2,
        misfit=best.misfit,
        distance=float(best.losses[0]),
        track_count=fit.track_count,
    )


def _widened(posterior: ParamPosterior, cable: Cable) -> SearchSpace | None:
    """Return a space that is wider where the casts push a parameter against its bound.

    Returns:
        The wider space; None if no bound is in the way, or none can be moved.
    """
    space = posterior.space
    known = posterior.deviation < _KNOWN * posterior.prior.deviation
    low, high = space.low.copy(), space.high.copy()
    for row, name in enumerate(CableParams.names()):
        least, most = PARAM_BOUNDS[name]
        if name in ("spinning_friction", "rolling_friction"):
            # Beyond the cable's radius the contact would lie outside the cable.
            most = min(most, cable.radius)
        ratio = np.sqrt(high[row] / low[row]) if space.logarithmic[row] else 0.0
        width = 0.5 * (high[row] - low[row])
        if known[row] and posterior.mean[row] < BOUND_DISTANCE:
            low[row] = low[row] / ratio if ratio else low[row] - width
            low[row] = max(low[row], least, 1e-9 if ratio else 0.0)
        if known[row] and posterior.mean[row] > 1.0 - BOUND_DISTANCE:
            high[row] = min(high[row] * ratio if ratio else high[row] + width, most)
    if np.array_equal(low, space.low) and np.array_equal(high, space.high):
        return None
    return dataclasses.replace(space, low=low, high=high)


class _Report:
    """Counts the simulations of a fit, and reports its steps."""

    def __init__(
        self,
        cable_length: float,
        progress: Callable[[TuneProgress], None] | None,
        began: float,
    ):
        self.total = 0
        self.cable_length = cable_length
        self.progress = progress
        self.began = began
        self.count = self.fine_count = 0
        self.history: list[tuple[str, float, float]] = []

    def extend(self, steps: int) -> None:
        """Announce more steps: a range was widened."""
        self.total += steps

    def step(self, stage: str, fit: TrackFit, extra: int = 0) -> Callable[[FitState], None]:
        """Return the callback of a fit that begins now, with steps that were not announced."""
        before, fine_before = self.count, self.fine_count
        self.extend(extra)

        def after(state: FitState) -> None:
            self.count = before + fit.simulation_count
            if stage == FINE:
                self.fine_count = fine_before + fit.simulation_count
            best, spread = float(state.best().losses[0]), float(state.losses.std())
            self.history.append((stage, best * self.cable_length, spread * self.cable_length))
            if self.progress is None:
                return
            done = len(self.history)
            pace = (time.monotonic() - self.began) / done
            self.progress(
                TuneProgress(
                    stage=stage,
                    generation=done,
                    generation_count=self.total,
                    best_pct=100.0 * best,
                    spread_pct=100.0 * spread,
                    simulation_count=self.count,
                    seconds_left=pace * (self.total - done),
                )
            )

        return after
