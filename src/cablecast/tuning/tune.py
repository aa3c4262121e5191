"""Tuning: fits the ten parameters of a cable to measured tracks (paper, section V-D)."""

import dataclasses
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, CableParams
from cablecast.checks import check_count, check_ranges, check_seed
from cablecast.engines.base import Engine
from cablecast.errors import InputError
from cablecast.material import Material
from cablecast.runs.parts import Parts
from cablecast.tuning.checkpoint import Checkpoint
from cablecast.tuning.ensemble import Ensemble
from cablecast.tuning.objective import TrackDistances, TrackObjective
from cablecast.tuning.posterior import ParamPosterior
from cablecast.tuning.search import METHODS, POPULATION_MAX, POPULATION_MIN, make_search
from cablecast.tuning.search_space import SearchSpace
from cablecast.tuning.tracks import MeasuredTracks

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
        method: "de" (Differential Evolution, as in the paper) or "cmaes".
        population_size: Number of candidates of a coarse generation. The paper's was 10, one for
            each parameter.
        coarse_generations: Number of generations at the coarse resolution.
        fine_population_size: Number of candidates of a fine generation.
        fine_generations: Number of generations at the fine resolution.
        coarse_segment_count: Number of segments of the coarse cable.
        coarse_dt: Step of the coarse simulation [s].
        seed: Seed of the search.
    """

    method: str = "de"
    population_size: int = 48
    coarse_generations: int = 60
    fine_population_size: int = 24
    fine_generations: int = 25
    coarse_segment_count: int = 30
    coarse_dt: float = 1e-3
    seed: int = 0

    def __post_init__(self):
        if self.method not in METHODS:
            raise InputError(f"unknown search method {self.method!r}: one of {', '.join(METHODS)}")
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
        return coarse + self.fine_population_size + self.fine_generations * self.fine_size

    @property
    def fine_size(self) -> int:
        """Number of candidates of a fine generation; only Differential Evolution can shrink."""
        return self.fine_population_size if self.method == "de" else self.population_size


@dataclasses.dataclass(frozen=True, kw_only=True)
class TuneProgress:
    """State of a search after a generation.

    Attributes:
        stage: "coarse" or "fine".
        generation: Number of generations done, of both stages.
        generation_count: Number of generations of both stages.
        best_pct: Loss of the best candidate so far in this stage [% of cable length].
        spread_pct: Standard deviation of the losses of the population [% of cable length].
        simulation_count: Number of rollouts so far.
        seconds_left: Expected time left [s].
    """

    stage: str
    generation: int
    generation_count: int
    best_pct: float
    spread_pct: float
    simulation_count: int
    seconds_left: float


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
        material: Material that was fitted; None for that of the cable.
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
    material: Material | None = None
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
    progress: Callable[[TuneProgress], None] | None = None,
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
    search = make_search(
        config.method, space.to_unit(cable.params), config.population_size, config.seed
    )
    run = _Run(config, space, cable.length, Checkpoint(checkpoint), progress)
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
    if len(search.population):
        search.restart(run.losses(FINE, fine, search.population))
        run.report(search.losses)
    for _ in range(config.fine_generations):
        candidates = search.ask()
        search.tell(candidates, run.losses(FINE, fine, candidates))
        run.report(search.losses)

    params = space.to_params(search.population[np.argmin(search.losses)])
    both = CableParams.from_array(np.stack([cable.params.to_array(), params.to_array()]))
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


class _Run:
    """Count, time and store the simulations of a search."""

    def __init__(
        self,
        config: TuneConfig,
        space: SearchSpace,
        cable_length: float,
        checkpoint: Checkpoint,
        progress: Callable[[TuneProgress], None] | None,
    ):
        self.config = config
        self.space = space
        self.cable_length = cable_length
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
        if self.progress is None or not self._live:
            return
        config, done = self.config, len(self.history)
        total = config.coarse_generations + 1 + config.fine_generations
        coarse_left = max(config.coarse_generations - done, 0) * config.population_size
        fine_left = (total - max(done, config.coarse_generations)) * config.fine_size
        self.progress(
            TuneProgress(
                stage=self._stage,
                generation=done,
                generation_count=total,
                best_pct=100 * float(losses.min()) / self.cable_length,
                spread_pct=100 * float(losses.std()) / self.cable_length,
                simulation_count=self.simulation_count,
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
