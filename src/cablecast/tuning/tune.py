"""Tuning: finds a cable's parameters from measured tracks (paper, section V-D).

`fit_params` is a least-squares fit with a prior (fit.py): starts, resolutions, bounds that are
widened, and an ensemble. `tune_params` is the paper's Differential Evolution.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import PAPER_PARAMS, Cable, CableParams
from cablecast.conventions import finite_or_none
from cablecast.engines.base import Engine
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import InputError, check_count, check_seed
from cablecast.runs.folder import Parts
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.setup import Setup
from cablecast.tuning.ensemble import MEMBER_COUNT, fit_ensemble
from cablecast.tuning.fit import MISFIT_START, FitConfig, FitState, TrackFit
from cablecast.tuning.search import POPULATION_MAX, POPULATION_MIN, SearchDE, StoredSteps
from cablecast.tuning.space import (
    BOUND_DISTANCE,
    ParamPosterior,
    ParamPrior,
    SearchSpace,
    bounds,
)
from cablecast.tuning.tracks import MeasuredTracks, TrackDistances, TrackObjective
from cablecast.tuning.tuned import Tuned

ROUGH, COARSE, FINE, ENSEMBLE = "rough", "coarse", "fine", "other physics"

GENERATION_MAX = 20_000
CANDIDATE_MAX = 100_000
"""Largest number of candidates of a search, whose checkpoint then has 25 MB."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TuneConfig:
    """Settings of the paper's search, at the resolution at which the result is used.

    Attributes:
        population_size: Number of candidates of a generation; the paper's 10, one for each
            parameter.
        generations: Largest number of generations after the first; a search that has converged
            ends earlier. The paper does not state its number.
        seed: Seed of the search.
    """

    population_size: int = 10
    generations: int = 200
    seed: int = 0

    def __post_init__(self):
        check_count("population_size", self.population_size, POPULATION_MIN, POPULATION_MAX)
        check_count("generations", self.generations, 1, GENERATION_MAX)
        check_seed(self.seed)
        if self.candidate_count > CANDIDATE_MAX:
            raise InputError(
                f"population size and generations make {self.candidate_count} candidates: they "
                f"must be at most {CANDIDATE_MAX}"
            )

    @property
    def candidate_count(self) -> int:
        """Largest number of candidates that the search simulates."""
        return self.population_size * (1 + self.generations)


def split_tracks(
    tracks: MeasuredTracks, validation_count: int | None = None
) -> tuple[MeasuredTracks, MeasuredTracks]:
    """Split tracks into training and validation tracks; the last ones are for validation.

    The actions of D_tune are in random order, so the last ones are a random sample: a quarter where
    no number is given, the paper's 20 of 80.

    Raises:
        InputError: One side would be empty.
    """
    count = len(tracks)
    held = max(1, round(count / 4))
    if validation_count is not None:
        held = check_count("validation_count", validation_count)
    if held >= count:
        raise InputError(
            f"validation_count = {held} must be less than the number of trials, {count}"
        )
    return tracks[: count - held], tracks[count - held :]


def tune_params(
    setup: Setup,
    training: MeasuredTracks,
    validation: MeasuredTracks,
    engine: Engine,
    config: TuneConfig | None = None,
    *,
    checkpoint: Parts | None = None,
    progress: ProgressCallback = ignore,
) -> Tuned:
    """Find the parameters whose simulated tracks are nearest to the measured ones.

    Args:
        setup: Set-up of the casts. The parameters of its cable are the first candidate, and the
            default for comparison with the result.
        training: Tracks for the loss.
        validation: Tracks for validating the result.
        engine: Simulator, at the resolution at which the result will be used.
        config: Settings of the search.
        checkpoint: Folder of the evaluated generations, from which the search resumes.
        progress: Called after every generation.

    Raises:
        InputError: No sample of the training or the validation tracks can be compared, or the
            checkpoint is damaged or belongs to another search.
    """
    config, cable = config or TuneConfig(), setup.cable
    space = SearchSpace.for_cable(cable)
    search = SearchDE(space.to_unit(cable.params), config.population_size, config.seed)
    stored = StoredSteps(checkpoint)
    log = _Log(cable, progress, 1 + config.generations, stored)
    objective = TrackObjective(engine, cable, training)
    # Created here so that unusable validation tracks are refused before the search, not after it.
    unseen = TrackObjective(engine, cable, validation)

    def losses(candidates: NDArray[np.float64]) -> NDArray[np.float64]:
        return objective.distances(space.to_params(candidates)).loss

    for generation in range(1 + config.generations):
        if generation and search.converged:
            break
        candidates = search.ask()
        found, is_new = stored.losses(FINE, candidates, losses)
        log.counts[FINE] += len(candidates) * len(training)
        search.tell(candidates, found)
        best, spread = float(search.losses.min()), float(search.losses.std())
        log.add(FINE, best, spread, report=is_new)

    params = space.to_params(search.population[np.argmin(search.losses)])
    both = CableParams.stack([cable.params, params])
    metrics = {
        **_values(params, space.to_params(search.population)),
        "open": [],
        "search_range": space.to_dict(),
        "training": _distances(objective.distances(both), training, cable),
        "validation": _distances(unseen.distances(both), validation, cable),
        **log.metrics(),
    }
    return Tuned(setup=setup, dynamics=Dynamics(params=params), metrics=metrics)


# Part of the steps of a fit, and the share of its starting points that go on from there.
_GO_ON = ((1 / 2, 1 / 2), (3 / 4, 1 / 3))

# Time of a step for each of its points, as measured, with a material and without one, over that of
# a rough one without. A batch of one point, as an ensemble has, is slow.
_EFFORTS = {ROUGH: (3, 1), COARSE: (6, 2), FINE: (18, 6), ENSEMBLE: (12, 4)}


def _point_counts(count: int, iterations: int) -> list[int]:
    """Return the number of points of each step of a fit, and that which these leave."""
    points = [count]
    for done in range(1, iterations + 1):
        left = [share for part, share in _GO_ON if done == math.ceil(part * iterations)]
        points.append(math.ceil(left[-1] * count) if left else points[-1])
    return points


def _effort(stage: str, space: SearchSpace) -> int:
    has_material = space.dimension > len(PAPER_PARAMS)
    return _EFFORTS[stage][0 if has_material else 1]


class _Log:
    """History of a search or a fit, whose steps it reports, and its simulations by stage."""

    def __init__(self, cable: Cable, progress: ProgressCallback, total: int, stored: StoredSteps):
        self.cable, self.progress, self.total = cable, progress, total
        self.stored = stored
        self.counts: dict[str, int] = dict.fromkeys(_EFFORTS, 0)
        self.history: list[tuple[str, float, float]] = []
        self.skipped = 0
        # Effort of the steps taken, and of all that are planned; none is planned for a search.
        self.effort, self.planned = 0, 0
        self.begin("")

    def plan(self, stage: str, space: SearchSpace, count: int, iterations: int) -> int:
        """Count the effort of a fit from some points, and return how many of these are left."""
        *steps, left = _point_counts(count, iterations)
        self.planned += _effort(stage, space) * sum(steps)
        return left

    def begin(self, name: str) -> None:
        """Begin a search or a fit with a name, whose losses are not compared with earlier ones."""
        self.name, self._begun = name, len(self.history)

    def add(self, stage: str, best: float, spread: float, *, report: bool = True) -> None:
        """Record a step: the best loss [m], and the standard deviation of the losses [m]."""
        self.history.append((stage, best, spread))
        if not report:
            return
        # The simulator of one stage follows the casts less closely than that of another may.
        least = min(loss for one, loss, _ in self.history[self._begun :] if one == stage)
        share = 100 * least / self.cable.length
        self.progress(
            Progress(
                task=f"Tuning {self.cable.name}",
                done=len(self.history) + self.skipped,
                total=self.total,
                unit="steps",
                note=f"{self.name}{stage}: {share:.1f} % off",
                seconds_left=self._seconds_left,
            )
        )

    @property
    def _seconds_left(self) -> float | None:
        """Expected time of the steps to come [s]; None where they are not planned."""
        if not (self.planned and self.effort):
            return None
        return self.stored.seconds / self.effort * max(self.planned - self.effort, 0.0)

    def run_fit(self, stage: str, fit: TrackFit, state: FitState, iterations: int) -> FitState:
        """Take some steps of a fit from several points, of which fewer and fewer go on.

        After half of the steps the better half of the points goes on, after three quarters of them
        the best third. The misfit is renewed once after the first half of the steps.
        """
        length, effort = self.cable.length, _effort(stage, fit.space)
        _, *left = _point_counts(len(state.points), iterations)
        for done, count in enumerate(left):
            self.effort += effort * len(state.points)
            state, is_new = self._step(stage, fit, state)
            if done == iterations // 2:
                state = fit.rescaled(state)
            if count < len(state.points):
                state = state.best(count)
            best, spread = float(state.best().losses[0]), float(state.losses.std())
            self.add(stage, best * length, spread * length, report=is_new)
        self.counts[stage] += fit.simulation_count
        return state

    def _step(self, stage: str, fit: TrackFit, state: FitState) -> tuple[FitState, bool]:
        """Return the state after the next step, and whether it was taken now."""
        before = fit.simulation_count

        def make() -> dict[str, Any]:
            after = fit.step(state).to_dict()
            return {"state": after, "simulations": fit.simulation_count - before}

        def read(values: dict[str, Any]) -> FitState:
            fit.simulation_count = before + int(values["simulations"])
            return FitState.from_dict(values["state"])

        start = {"points": state.points.tolist(), "misfit": float(state.misfit)}
        return self.stored.step(stage, start, make, read)

    def metrics(self) -> dict[str, Any]:
        """Return what the search cost: simulations, their share at the coarse resolution, time."""
        count = sum(self.counts.values())
        return {
            "simulation_count": count,
            "coarse_simulation_count": count - self.counts[FINE],
            "seconds": round(self.stored.seconds, 1),
            "history": [
                {
                    "stage": stage,
                    "best_pct": 100 * best / self.cable.length,
                    "spread_pct": 100 * spread / self.cable.length,
                }
                for stage, best, spread in self.history
            ],
        }


WIDEN_MAX = 2
"""Times that ranges are widened at most."""

# A parameter must be this much better known than before for its bound to be in the way.
_KNOWN = 0.7


def fit_params(
    setup: Setup,
    training: MeasuredTracks,
    validation: MeasuredTracks | None,
    engines: tuple[Engine, Engine, Engine],
    config: FitConfig | None = None,
    *,
    checkpoint: Parts | None = None,
    progress: ProgressCallback = ignore,
) -> Tuned:
    """Find the parameters by Levenberg-Marquardt with a prior, and their uncertainty.

    Args:
        setup: Set-up of the casts, with what is believed of its cable.
        training: Tracks to fit.
        validation: Tracks to measure the result with; the training tracks if None.
        engines: Simulators of the first steps, of the next and of the last, these at the resolution
            at which the result will be used.
        config: Settings of the fit.
        checkpoint: Folder of the steps, from which the fit resumes.
        progress: Called after every step.

    Raises:
        InputError: No sample of the tracks can be compared, or the checkpoint is damaged or belongs
            to another fit.
    """
    config, cable = config or FitConfig(), setup.cable
    stored = StoredSteps(checkpoint)
    rough, coarse, fine = (TrackObjective(one, cable, training) for one in engines)
    # A rod that has none of what a material adds, as a simulated one may, is followed worse with
    # it: what is typical of a real cable is wrong for it, and parameters make up for that.
    spaces = [SearchSpace.for_cable(cable, names) for names in (config.materials, ())]
    if spaces[0].names == spaces[1].names:
        del spaces[0]
    # As if all ranges were widened as often as they may be: the end of a bar must not move away.
    steps = config.rough_iterations + config.coarse_iterations
    steps += (1 + WIDEN_MAX) * config.fine_iterations
    total = len(spaces) * steps + MEMBER_COUNT * config.ensemble_iterations
    log = _Log(cable, progress, total, stored)
    for space in spaces:
        left = log.plan(ROUGH, space, config.start_count, config.rough_iterations)
        kept = min(left, config.kept_start_count)
        left = log.plan(COARSE, space, kept, config.coarse_iterations)
        log.plan(FINE, space, left, config.fine_iterations)
    for _ in range(MEMBER_COUNT if config.ensemble_iterations else 0):
        log.plan(ENSEMBLE, spaces[-1], 1, config.ensemble_iterations)
    fits = []
    for number, space in enumerate(spaces, start=1):
        log.begin(f"fit {number} of {len(spaces)}, ")
        fits.append(_fit_in(space, rough, coarse, fine, config, log))
    log.begin("")
    likeliest = min(fits, key=lambda fit: fit.neg_log_posterior)
    state, posterior = likeliest.state, likeliest.posterior
    params = posterior.params
    members = ()
    if config.ensemble_iterations:
        members = fit_ensemble(
            TrackFit(coarse, posterior.space, posterior.prior),
            params,
            state.misfit,
            lambda fit, state: log.run_fit(ENSEMBLE, fit, state, config.ensemble_iterations),
        )

    def distances(tracks: MeasuredTracks) -> dict[str, Any]:
        objective = TrackObjective(fine.engine, cable, tracks)
        # Not one batch: worlds with and without material run in kernels of their own.
        both = objective.distances(cable.params).concat(objective.distances(params))
        return _distances(both, tracks, cable)

    on_training = distances(training)
    best = state.best(len(state.points))
    metrics = {
        **_values(params, likeliest.space.to_params(best.points)),
        "open": posterior.sentences(),
        "training": on_training,
        "validation": on_training if validation is None else distances(validation),
        **log.metrics(),
    }
    return Tuned(
        setup=setup,
        dynamics=Dynamics(params=params),
        members=members,
        resolution=(fine.engine.segment_count, fine.engine.dt),
        member_resolution=(coarse.engine.segment_count, coarse.engine.dt),
        posterior=posterior,
        metrics=metrics,
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Fit:
    """Result of the fit in one space.

    Attributes:
        neg_log_posterior: Negative log posterior density of its best point.
        space: Ranges of the parameters, widened where need be.
        state: Points of the fit.
        posterior: Uncertainty of the ten parameters, the material given.
    """

    neg_log_posterior: float
    space: SearchSpace
    state: FitState
    posterior: ParamPosterior


def _fit_in(
    space: SearchSpace,
    rough: TrackObjective,
    coarse: TrackObjective,
    fine: TrackObjective,
    config: FitConfig,
    log: _Log,
) -> _Fit:
    """Fit the parameters of a space, wider than given where the casts push against a bound.

    The first steps are those of the rough objective; the log records every step.
    """
    cable = fine.cable
    prior = ParamPrior.for_cable(cable, space)
    points, misfit = prior.draw(config.start_count, config.seed), MISFIT_START
    for stage, objective, iterations in (
        (ROUGH, rough, config.rough_iterations),
        (COARSE, coarse, config.coarse_iterations),
    ):
        fit = TrackFit(objective, space, prior)
        state = log.run_fit(stage, fit, fit.start(points, misfit), iterations)
        points, misfit = state.best(config.kept_start_count).points, state.misfit
    for attempt in range(WIDEN_MAX + 1):
        fit = TrackFit(fine, space, ParamPrior.for_cable(cable, space))
        state = log.run_fit(FINE, fit, fit.start(points, misfit), config.fine_iterations)
        posterior = _posterior(fit, state)
        wider = None if attempt == WIDEN_MAX else _widened(posterior, space, cable)
        if wider is None:
            log.skipped += (WIDEN_MAX - attempt) * config.fine_iterations
            break
        points, misfit = state.points.copy(), state.misfit
        log.plan(FINE, wider, len(points), config.fine_iterations)
        ten = len(PAPER_PARAMS)
        points[:, :ten] = wider.to_unit(space.to_params(points))[:, :ten]
        space = wider
    return _Fit(
        neg_log_posterior=fit.neg_log_posterior(state),
        space=space,
        state=state,
        posterior=posterior,
    )


def _posterior(fit: TrackFit, state: FitState) -> ParamPosterior:
    """Return the Gaussian whose curvature is that of F at the best point, its material given."""
    best = state.best()
    space = fit.space.of_paper(fit.space.to_params(best.points[0]))
    prior = ParamPrior.for_cable(fit.objective.cable, space)
    fit = TrackFit(fit.objective, space, prior)
    point = best.points[:, : space.dimension]
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


def _widened(posterior: ParamPosterior, space: SearchSpace, cable: Cable) -> SearchSpace | None:
    """Return a space that is wider where the casts push one of the ten against its bound.

    Returns:
        The wider space; None if no bound is in the way, or none can be moved.
    """
    known = posterior.deviation < _KNOWN * posterior.prior.deviation
    low, high = space.low.copy(), space.high.copy()
    for row, name in enumerate(PAPER_PARAMS):
        least, most = bounds(cable, name)
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


# A simulation depends only on the ratios of masses and stiffnesses, and on the product of the
# frictions. If the parameters spread widely but these do not, the fit is good and the spread has no
# effect.
_DERIVED = {
    "friction": lambda p: p.friction,
    "bend_stiffness_per_mass": lambda p: p.bend_stiffness / p.mass,
    "twist_stiffness_per_mass": lambda p: p.twist_stiffness / p.mass,
    "endpoint_mass_per_mass": lambda p: p.endpoint_mass / p.mass,
}


def _distances(both: TrackDistances, tracks: MeasuredTracks, cable: Cable) -> dict[str, Any]:
    """Return distances before and after, and the trials by status, as plain values."""
    codes, counts = np.unique(tracks.status, return_counts=True)
    return {
        "trials": {str(code): int(count) for code, count in zip(codes, counts, strict=True)},
        "default": distance_summary(both, 0, cable.length),
        "tuned": distance_summary(both, 1, cable.length),
    }


def distance_summary(
    distances: TrackDistances, candidate: int, cable_length: float
) -> dict[str, Any]:
    """Return distances of one candidate in % of cable length, as in the paper's tuning table."""
    mean = 100 * distances.mean[candidate] / cable_length
    final = 100 * distances.final[candidate] / cable_length
    return {
        "mean_pct": _reduced(np.mean, mean),
        "median_mean_pct": _reduced(np.median, mean),
        "final_median_pct": _reduced(np.median, final),
        "final_first_quartile_pct": _reduced(lambda v: np.quantile(v, 0.25), final),
        "final_third_quartile_pct": _reduced(lambda v: np.quantile(v, 0.75), final),
        "final_max_pct": _reduced(np.max, final),
        "track_count": int(np.isfinite(mean).sum()),
        "final_count": int(np.isfinite(final).sum()),
        "non_finite_count": int((~distances.finite[candidate]).sum()),
    }


def _reduced(
    reduce: Callable[[NDArray[np.float64]], Any], values: NDArray[np.float64]
) -> float | None:
    """Return a statistic of the finite values; None if there are none."""
    known = values[np.isfinite(values)]
    return finite_or_none(reduce(known)) if len(known) else None


def _values(params: CableParams, population: CableParams) -> dict[str, Any]:
    """Return the derived values, and minimum, median and maximum of all in the population."""
    values = {name: getattr(population, name) for name in PAPER_PARAMS}
    values |= {name: value(population) for name, value in _DERIVED.items()}
    return {
        "derived": {name: float(value(params)) for name, value in _DERIVED.items()},
        "spread": {
            name: [float(np.quantile(column, q)) for q in (0.0, 0.5, 1.0)]
            for name, column in values.items()
        },
    }
