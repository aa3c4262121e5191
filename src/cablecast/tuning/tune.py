"""Tuning results of the paper, for comparison with ours.

Tuning: fits the ten parameters of a cable to measured tracks (paper, section V-D).

params.json: result of tuning, with a checksum, which other commands read.

Fit of a cable by least squares: starts, resolutions, bounds that are widened, and the result.
"""

import dataclasses
import functools
import pathlib
import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import PAPER_PARAMS, Cable, CableParams
from cablecast.conventions import finite_or_none
from cablecast.engines.base import Engine
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import (
    DamagedFileError,
    InputError,
    check_count,
    check_name,
    check_ranges,
    check_seed,
)
from cablecast.files import CHECKSUM_KEY, read_json, read_sealed, seal, write_json
from cablecast.motion.servo import ServoModel
from cablecast.runs.folder import Parts
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.tuning.ensemble import Ensemble, fit_ensemble
from cablecast.tuning.fit import MISFIT_START, FitConfig, FitState, TrackFit, run_fit
from cablecast.tuning.search import POPULATION_MAX, POPULATION_MIN, Checkpoint, SearchDE
from cablecast.tuning.space import (
    BOUND_DISTANCE,
    ParamPosterior,
    ParamPrior,
    SearchSpace,
    bounds,
)
from cablecast.tuning.tracks import MeasuredTracks, TrackDistances, TrackObjective


@dataclasses.dataclass(frozen=True, kw_only=True)
class PublishedTuning:
    """Column of the paper's tuning table; values in % of cable length.

    Attributes:
        default_final_pct: Median final distance with PyBullet's default parameters.
        default_mean_pct: Equation 4 with PyBullet's default parameters.
        tuned_final_pct: Median final distance after Differential Evolution.
        tuned_mean_pct: Equation 4 after Differential Evolution.
    """

    default_final_pct: float
    default_mean_pct: float
    tuned_final_pct: float
    tuned_mean_pct: float


# Source: arXiv 2405.09581, table I: 20 validation trajectories of a real UR5 per cable.
_PUBLISHED = {
    "cable_1": PublishedTuning(
        default_final_pct=35.0, default_mean_pct=38.2, tuned_final_pct=14.7, tuned_mean_pct=28.4
    ),
    "cable_2": PublishedTuning(
        default_final_pct=25.8, default_mean_pct=29.4, tuned_final_pct=12.2, tuned_mean_pct=23.4
    ),
    "cable_3": PublishedTuning(
        default_final_pct=24.5, default_mean_pct=24.5, tuned_final_pct=14.5, tuned_mean_pct=18.7
    ),
}

PUBLISHED_SIMULATION_COUNT = 30_000
"""Approximate number of simulations of the paper's search per cable."""


def published_tuning(cable_name: str) -> PublishedTuning | None:
    """Return the paper's values for a cable; None for a cable that is not in the paper."""
    return _PUBLISHED.get(cable_name)


COARSE, FINE, ENSEMBLE = "coarse", "fine", "other physics"

GENERATION_MAX = 20_000
CANDIDATE_MAX = 100_000
"""Largest number of candidates of a search, whose checkpoint then has 25 MB."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TuneConfig:
    """Settings of the search.

    Most generations are simulated coarsely, which is two to three times cheaper. The best members
    then continue at the resolution at which the parameters will be used, because a coarse cable
    fits the same tracks with slightly different parameters. The coarser it is, the more its best
    parameters differ from those at full resolution.

    Attributes:
        population_size: Number of candidates of a coarse generation. The paper's was 10, one for
            each parameter.
        coarse_generations: Number of generations at the coarse resolution.
        fine_population_size: Number of candidates of a fine generation.
        fine_generations: Number of generations at the fine resolution.
        coarse_segment_count: Number of segments of the coarse cable.
        coarse_dt: Step of the coarse simulation [s].
        seed: Seed of the search.
    """

    population_size: int = 48
    coarse_generations: int = 60
    fine_population_size: int = 24
    fine_generations: int = 25
    coarse_segment_count: int = 30
    coarse_dt: float = 1e-3
    seed: int = 0

    def __post_init__(self):
        for name, low, high in (
            ("population_size", POPULATION_MIN, POPULATION_MAX),
            ("coarse_generations", 0, GENERATION_MAX),
            ("fine_population_size", POPULATION_MIN, POPULATION_MAX),
            ("fine_generations", 1, GENERATION_MAX),
            ("coarse_segment_count", 2, 1000),
        ):
            check_count(name, getattr(self, name), low, high)
        check_ranges(self, {"coarse_dt": (1e-7, 1e-2, "s")})
        check_seed(self.seed)
        if self.fine_population_size > self.population_size:
            raise InputError(
                f"fine_population_size = {self.fine_population_size} must be at most "
                f"population_size = {self.population_size}"
            )
        if self.candidate_count > CANDIDATE_MAX:
            raise InputError(
                f"population sizes and generations make {self.candidate_count} candidates: they "
                f"must be at most {CANDIDATE_MAX}"
            )

    @property
    def candidate_count(self) -> int:
        """Number of candidates that the search simulates."""
        coarse = self.coarse_generations * self.population_size
        return coarse + self.fine_population_size * (1 + self.fine_generations)


@dataclasses.dataclass(frozen=True, kw_only=True)
class TuneResult:
    """Result of tuning.

    Attributes:
        params: Parameters with the least loss.
        population: Final population, one value per member.
        population_losses: Their losses [m], shape [member].
        space: Ranges of the search.
        training: Distances of (default, tuned) parameters on the training tracks.
        validation: Distances of (default, tuned) parameters on tracks that the search never saw.
        training_status: Trial statuses of the training tracks, shape [trial].
        validation_status: Trial statuses of the validation tracks, shape [trial].
        simulation_count: Number of rollouts of the search, coarse and fine.
        coarse_simulation_count: Number of those at the coarse resolution.
        seconds: Duration of the search, summed over interrupted runs [s].
        history: Stage, best loss [m] and spread of the population's losses [m] of each generation.
        posterior: What is known of the parameters; None for a search, which does not tell.
        ensemble: Simulators with other physics that follow the same tracks; None for a search.
    """

    params: CableParams
    population: CableParams
    population_losses: NDArray[np.float64]
    space: SearchSpace
    training: TrackDistances
    validation: TrackDistances
    training_status: NDArray[np.str_]
    validation_status: NDArray[np.str_]
    simulation_count: int
    coarse_simulation_count: int
    seconds: float
    history: list[tuple[str, float, float]]
    posterior: ParamPosterior | None = None
    ensemble: Ensemble | None = None


def split_tracks(
    tracks: MeasuredTracks, validation_count: int | None = None
) -> tuple[MeasuredTracks, MeasuredTracks]:
    """Split tracks into training and validation tracks; the last ones are for validation.

    The actions of D_tune are in random order, so the last ones are a random sample.

    Args:
        tracks: All tracks.
        validation_count: Number of validation tracks; a quarter if None, the paper's 20 of 80.

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
    cable: Cable,
    training: MeasuredTracks,
    validation: MeasuredTracks,
    coarse_engine: Engine,
    engine: Engine,
    config: TuneConfig | None = None,
    *,
    checkpoint: Parts | None = None,
    progress: ProgressCallback = ignore,
) -> TuneResult:
    """Find the parameters whose simulated tracks are nearest to the measured ones.

    Args:
        cable: Cable that was cast; its parameters are the first candidate, and the default for
            comparison with the result.
        training: Tracks for the loss.
        validation: Tracks for validating the result.
        coarse_engine: Simulator of the coarse stage.
        engine: Simulator of the fine stage, at the resolution at which the result will be used.
        config: Settings of the search.
        checkpoint: Folder of the evaluated generations, from which the search resumes.
        progress: Called after every generation.

    Raises:
        InputError: No sample of the training or the validation tracks can be compared, or the
            checkpoint is damaged or belongs to another search.
    """
    config = config or TuneConfig()
    space = SearchSpace.for_cable(cable)
    search = SearchDE(space.to_unit(cable.params), config.population_size, config.seed)
    run = _Run(config, space, cable, Checkpoint(checkpoint), progress)
    coarse = TrackObjective(coarse_engine, cable, training)
    fine = TrackObjective(engine, cable, training)
    # Created here so that unusable validation tracks are refused before the search, not after it.
    unseen = TrackObjective(engine, cable, validation)
    run.cost_ratio = (engine.segment_count / engine.dt) / (
        coarse_engine.segment_count / coarse_engine.dt
    )
    for _ in range(config.coarse_generations):
        candidates = search.ask()
        search.tell(candidates, run.losses(COARSE, coarse, candidates))
        run.report(search.losses)
    coarse_count = run.simulation_count
    search.shrink(config.fine_population_size)
    search.restart(run.losses(FINE, fine, search.population))
    run.report(search.losses)
    for _ in range(config.fine_generations):
        candidates = search.ask()
        search.tell(candidates, run.losses(FINE, fine, candidates))
        run.report(search.losses)

    params = space.to_params(search.population[np.argmin(search.losses)])
    both = CableParams.stack([cable.params, params])
    return TuneResult(
        params=params,
        population=space.to_params(search.population),
        population_losses=search.losses,
        space=space,
        training=fine.distances(both),
        validation=unseen.distances(both),
        training_status=training.status,
        validation_status=validation.status,
        simulation_count=run.simulation_count,
        coarse_simulation_count=coarse_count,
        seconds=run.checkpoint.seconds,
        history=run.history,
    )


def _note(stage: str, best: float, spread: float, cable_length: float) -> str:
    """Return the state of a search or fit in words."""
    best_pct, spread_pct = 100 * best / cable_length, 100 * spread / cable_length
    return f"{stage}, best {best_pct:.2f} %, spread {spread_pct:.2f} %"


class _Run:
    """Count, time and store the simulations of a search."""

    def __init__(
        self,
        config: TuneConfig,
        space: SearchSpace,
        cable: Cable,
        checkpoint: Checkpoint,
        progress: ProgressCallback,
    ):
        self.config = config
        self.space = space
        self.cable = cable
        self.checkpoint = checkpoint
        self.progress = progress
        self.simulation_count = 0
        self.history: list[tuple[str, float, float]] = []
        self.cost_ratio = 1.0
        self._stage = COARSE
        self._seconds = {COARSE: 0.0, FINE: 0.0}
        self._worlds = {COARSE: 0, FINE: 0}
        self._live = False

    def losses(
        self, stage: str, objective: TrackObjective, candidates: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the losses of a generation, from the checkpoint or simulated in one batch."""
        self._stage = stage
        worlds = len(candidates) * len(objective)
        self.simulation_count += worlds
        stored = self.checkpoint.answer(stage, candidates)
        self._live = stored is None
        if stored is None:
            start = time.monotonic()
            stored = objective.distances(self.space.to_params(candidates)).loss
            seconds = time.monotonic() - start
            self.checkpoint.store(stage, candidates, stored, seconds)
            self._seconds[stage] += seconds
            self._worlds[stage] += len(candidates)
        return stored

    def report(self, losses: NDArray[np.float64]) -> None:
        """Record a generation, and report it unless it came from the checkpoint."""
        self.history.append((self._stage, float(losses.min()), float(losses.std())))
        if not self._live:
            return
        config, done = self.config, len(self.history)
        total = config.coarse_generations + 1 + config.fine_generations
        coarse_left = max(config.coarse_generations - done, 0) * config.population_size
        fine_left = (total - max(done, config.coarse_generations)) * config.fine_population_size
        self.progress(
            Progress(
                task=f"Tuning {self.cable.name}",
                done=done,
                total=total,
                unit="steps",
                note=_note(*self.history[-1], self.cable.length),
                seconds_left=coarse_left * self._rate(COARSE) + fine_left * self._rate(FINE),
            )
        )

    def _rate(self, stage: str) -> float:
        """Return the expected time per candidate [s], initially scaled from the other stage."""
        if self._worlds[stage]:
            return self._seconds[stage] / self._worlds[stage]
        other = FINE if stage == COARSE else COARSE
        ratio = self.cost_ratio if stage == FINE else 1.0 / self.cost_ratio
        return ratio * self._seconds[other] / self._worlds[other] if self._worlds[other] else 0.0


PARAMS_FILE = "params.json"

_Part = TypeVar("_Part")

# A simulation depends only on the ratios of masses and stiffnesses, and on the product of the
# frictions. If the parameters spread widely but these do not, the fit is good and the spread has no
# effect.
_DERIVED = {
    "friction": lambda p: p.friction,
    "bend_stiffness_per_mass": lambda p: p.bend_stiffness / p.mass,
    "twist_stiffness_per_mass": lambda p: p.twist_stiffness / p.mass,
    "endpoint_mass_per_mass": lambda p: p.endpoint_mass / p.mass,
}


def params_file(
    result: TuneResult, cable_length: float, servo: ServoModel | None
) -> dict[str, Any]:
    """Return the content of params.json as plain values; see `write_params`.

    Args:
        result: Result of tuning.
        cable_length: Cable length r_c [m].
        servo: Servo of the arm, if it was identified.
    """
    rows = {}
    for name, distances, status in (
        ("training", result.training, result.training_status),
        ("validation", result.validation, result.validation_status),
    ):
        rows[name] = {"trials": status_counts(status)} | {
            row: distance_summary(distances, index, cable_length)
            for index, row in enumerate(("default", "tuned"))
        }
    return {
        "params": result.params.to_dict(),
        "derived": {name: float(value(result.params)) for name, value in _DERIVED.items()},
        "spread": _spread(result.population),
        "servo": None if servo is None else servo.to_dict(),
        "ensemble": None if result.ensemble is None else result.ensemble.to_dict(),
        "posterior": None if result.posterior is None else result.posterior.to_dict(),
        "open": [] if result.posterior is None else result.posterior.sentences(),
        "search_range": result.space.to_dict(),
        **rows,
        "simulation_count": result.simulation_count,
        "coarse_simulation_count": result.coarse_simulation_count,
        "seconds": round(result.seconds, 1),
    }


def distance_summary(
    distances: TrackDistances, candidate: int, cable_length: float
) -> dict[str, Any]:
    """Return distances of one candidate in % of cable length, as in the paper's tuning table.

    Args:
        distances: Distances between simulated and measured tracks.
        candidate: Row of the candidate.
        cable_length: Cable length r_c [m].
    """
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


def status_counts(status: NDArray[np.str_]) -> dict[str, int]:
    """Return the number of trials by status."""
    codes, counts = np.unique(status, return_counts=True)
    return {str(code): int(count) for code, count in zip(codes, counts, strict=True)}


def _reduced(
    reduce: Callable[[NDArray[np.float64]], Any], values: NDArray[np.float64]
) -> float | None:
    """Return a statistic of the finite values; None if there are none."""
    known = values[np.isfinite(values)]
    return finite_or_none(reduce(known)) if len(known) else None


def _spread(population: CableParams) -> dict[str, list[float]]:
    """Return minimum, median and maximum of the ten in the final population, by name."""
    values = {name: getattr(population, name) for name in PAPER_PARAMS}
    values |= {name: value(population) for name, value in _DERIVED.items()}
    return {
        name: [float(np.quantile(column, q)) for q in (0.0, 0.5, 1.0)]
        for name, column in values.items()
    }


def write_params(path: pathlib.Path, values: Mapping[str, Any]) -> None:
    """Write params.json with a checksum over its content.

    Args:
        path: File, or its folder.
        values: Content, see `params_file`; also `cable`, the name of the tuned cable.
    """
    file = path / PARAMS_FILE if path.is_dir() else path
    sealed = seal(dict(values))
    # On the first line, so that a person may delete it without breaking the commas.
    write_json(file, {CHECKSUM_KEY: sealed.pop(CHECKSUM_KEY), **sealed})


@dataclasses.dataclass(frozen=True, kw_only=True)
class ParamsFile:
    """Content of params.json: what `cablecast tune` found, or a person wrote.

    The methods raise InputError where an entry is damaged.

    Attributes:
        file: File that it was read from.
        values: Entries. Without a checksum, only the key `params` is required, a mapping of the
            ten parameters.
    """

    file: pathlib.Path
    values: Mapping[str, Any]

    @classmethod
    def read(cls, path: str | pathlib.Path) -> "ParamsFile":
        """Read params.json; a checksum, if present, is verified.

        Args:
            path: The file, or its folder.

        Raises:
            InputError: There is no such file, it does not hold parameters, or it was changed since
                it was written.
            UnreadableFileError: The system refuses to read it.
        """
        file = pathlib.Path(path)
        file = file / PARAMS_FILE if file.is_dir() else file
        try:
            values = read_json(file)
        except FileNotFoundError:
            raise InputError(
                f"there are no tuned parameters at {file}: make them with `cablecast tune`"
            ) from None
        except InputError as error:
            raise _refusal(file, error) from None
        if CHECKSUM_KEY in values:
            try:
                values = read_sealed(file)
            except (DamagedFileError, RecursionError):
                raise InputError(
                    f"{file} was changed since it was written: delete its {CHECKSUM_KEY} line to "
                    "use it anyway"
                ) from None
        if "params" not in values:
            raise InputError(f"{file} does not hold tuned parameters: it lacks the key params")
        return cls(file=file, values=values)

    def params(self, cable: Cable | None = None) -> CableParams:
        """Return the parameters.

        Args:
            cable: Cable that they must belong to; not checked if None.
        """
        stored = self.values.get("cable")
        try:
            if stored is not None:
                check_name(stored, "cable")
            params = CableParams.from_dict(self.values["params"])
        except (InputError, OverflowError) as error:
            raise _refusal(self.file, error) from None
        if cable is not None and stored not in (None, cable.name):
            raise InputError(f"{self.file} holds parameters of {stored}, not of {cable.name}")
        return params

    def dynamics(self, cable: Cable | None = None) -> Dynamics:
        """Return parameters and servo; a person may have written parameters alone.

        Args:
            cable: Cable that they must belong to; not checked if None.
        """
        return Dynamics(
            params=self.params(cable),
            servo=self._part("servo", ServoModel.from_dict),
        )

    def ensemble(self) -> Ensemble | None:
        """Return the simulators with other physics; None for the result of a search."""
        return self._part("ensemble", Ensemble.from_dict)

    def posterior(self) -> ParamPosterior | None:
        """Return what the fit knows of the parameters; None for the result of a search."""
        return self._part(
            "posterior",
            lambda stored: ParamPosterior.from_dict(
                stored, self.values["search_range"], self.params()
            ),
        )

    def casts_fingerprint(self) -> str:
        """Return the fingerprint of the casts; empty for parameters that a person wrote."""
        return self._part("dataset_fingerprint", str) or ""

    def _part(self, name: str, make: Callable[[Any], _Part]) -> _Part | None:
        """Return what a function makes of an entry; None where there is none."""
        stored = self.values.get(name)
        if stored is None:
            return None
        try:
            return make(stored)
        except (InputError, KeyError, AttributeError, OverflowError) as error:
            raise _refusal(self.file, error) from None


def read_params(path: str | pathlib.Path, cable: Cable | None = None) -> CableParams:
    """Read the parameters that `cablecast tune` found, or that a person wrote.

    Args:
        path: params.json, or its folder.
        cable: Cable that the parameters must belong to; not checked if None.

    Raises:
        InputError: There is no such file, it does not hold the ten parameters, it belongs to
            another cable, or it was changed since it was written.
        UnreadableFileError: The system refuses to read it.
    """
    return ParamsFile.read(path).params(cable)


def read_dynamics(path: str | pathlib.Path, cable: Cable | None = None) -> Dynamics:
    """Read the dynamics that `cablecast tune` found: a person may have written parameters alone.

    Args:
        path: params.json, or its folder.
        cable: Cable that the parameters must belong to; not checked if None.

    Raises:
        InputError: There is no such file, it is damaged, or belongs to another cable.
        UnreadableFileError: The system refuses to read it.
    """
    return ParamsFile.read(path).dynamics(cable)


def _refusal(file: pathlib.Path, error: Exception) -> InputError:
    """Return a one-line error that names the file."""
    reason = " ".join(str(error).split())[:300].removeprefix(f"{file} is damaged: ")
    return InputError(f"{file} does not hold tuned parameters: {reason}")


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
    progress: ProgressCallback = ignore,
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
    report = _Report(cable, progress, began)
    # A rod that has none of what a material adds, as a simulated one may, is followed worse with
    # it: what is usual of a real cable is wrong for it, and parameters make up for that.
    spaces = [SearchSpace.for_cable(cable, names) for names in (config.materials, ())]
    if spaces[0].names == spaces[1].names:
        del spaces[0]
    report.extend(len(spaces) * (config.coarse_iterations + config.fine_iterations))
    fits = [_fit_in(space, coarse, fine, config, report) for space in spaces]
    likeliest = min(fits, key=lambda fit: fit.neg_log_posterior)
    state, posterior = likeliest.state, likeliest.posterior
    best = state.best(len(state.points))
    params = posterior.params
    steps = functools.partial(report.step, ENSEMBLE, extra=config.ensemble_iterations)
    fit = TrackFit(coarse, posterior.space, posterior.prior)
    ensemble = fit_ensemble(fit, engine, params, state.misfit, config.ensemble_iterations, steps)

    def distances(tracks: MeasuredTracks) -> TrackDistances:
        objective = TrackObjective(engine, cable, tracks)
        # Not one batch: worlds with and without material run in kernels of their own.
        return objective.distances(cable.params).beside(objective.distances(params))

    on_training = distances(training)
    return TuneResult(
        params=params,
        ensemble=ensemble,
        population=likeliest.space.to_params(best.points),
        population_losses=best.losses * cable.length,
        space=posterior.space,
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
    coarse: TrackObjective,
    fine: TrackObjective,
    config: FitConfig,
    report: "_Report",
) -> _Fit:
    """Fit the parameters of a space, wider than given where the casts push against a bound.

    Args:
        space: Ranges of the ten parameters, and of material parameters to find.
        coarse: Objective of the first steps.
        fine: Objective of the last steps.
        config: Settings of the fit.
        report: Records every step.
    """
    cable = fine.cable
    prior = ParamPrior.for_cable(cable, space)
    fit = TrackFit(coarse, space, prior)
    state = fit.start(prior.draw(config.start_count, config.seed), MISFIT_START)
    state = run_fit(fit, state, config.coarse_iterations, report.step(COARSE, fit))
    points = state.best(config.fine_start_count).points
    for attempt in range(WIDEN_MAX + 1):
        fit = TrackFit(fine, space, ParamPrior.for_cable(cable, space))
        state = fit.start(points, state.misfit)
        state = run_fit(fit, state, config.fine_iterations, report.step(FINE, fit))
        posterior = _posterior(fit, state)
        wider = None if attempt == WIDEN_MAX else _widened(posterior, space, cable)
        if wider is None:
            break
        points = state.best(config.fine_start_count).points.copy()
        ten = len(PAPER_PARAMS)
        points[:, :ten] = wider.to_unit(space.to_params(points))[:, :ten]
        space = wider
        report.extend(config.fine_iterations)
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


class _Report:
    """Counts the simulations of a fit, and reports its steps."""

    def __init__(
        self,
        cable: Cable,
        progress: ProgressCallback,
        began: float,
    ):
        self.total = 0
        self.cable = cable
        self.progress = progress
        self.began = began
        self.count = self.fine_count = 0
        self.history: list[tuple[str, float, float]] = []

    def extend(self, steps: int) -> None:
        """Announce more steps: a range was widened."""
        self.total += steps

    def step(self, stage: str, fit: TrackFit, extra: int = 0) -> Callable[[FitState], None]:
        """Return the callback of a fit that starts now, with steps that were not announced."""
        before, fine_before = self.count, self.fine_count
        self.extend(extra)

        def after(state: FitState) -> None:
            self.count = before + fit.simulation_count
            if stage == FINE:
                self.fine_count = fine_before + fit.simulation_count
            best, spread = float(state.best().losses[0]), float(state.losses.std())
            length = self.cable.length
            self.history.append((stage, best * length, spread * length))
            done = len(self.history)
            pace = (time.monotonic() - self.began) / done
            self.progress(
                Progress(
                    task=f"Tuning {self.cable.name}",
                    done=done,
                    total=self.total,
                    unit="steps",
                    note=_note(*self.history[-1], self.cable.length),
                    seconds_left=pace * (self.total - done),
                )
            )

        return after
