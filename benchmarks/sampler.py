"""The Gaussian posterior of a fit beside draws of a sampler that assumes no shape.

Sequential Monte Carlo: particles from what is believed of the cable are led to the posterior
through powers of the likelihood. At each power they are resampled by their weights and moved by
Metropolis-Hastings steps that leave the Gaussian of all particles as it is. All particles times all
casts are one batch of the engine. The density is that of the fit (`tuning/least_squares.py`), at
its coarse resolution and with the misfit that it ended with.
"""

import dataclasses
import pathlib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.common import Table
from benchmarks.places import Place, PlaceArgs
from cablecast.cable import CableParams
from cablecast.cli.progress import console_progress
from cablecast.engines import make_engine
from cablecast.motion.action import mirror_to_right
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.tuning.fit import TRACK_WEIGHT
from cablecast.tuning.space import ParamPosterior, SearchSpace
from cablecast.tuning.tracks import MeasuredTracks, TrackObjective

COLUMNS = ("parameter", "believed", "Gaussian", "sampler", "shift of the mean")
SPREAD_COLUMNS = ("cable", "casts", "Gaussian", "with its product", "sampler", "rank correlation")
ENGINE, ACTION_SEED = (30, 1e-3), 7
"""Segments and step [s] of the cable whose landings are compared, and the seed of its casts."""

EFFECTIVE = 0.5
"""Share of the particles that stay effective from one power to the next."""


WIDER = 1.3
"""Variance of the steps over that of the particles, so that tails are reached."""
ACCEPTED = 0.3
"""Share of the steps that is taken; longer steps are tried where more are, shorter ones else."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Posterior of a fit beside draws of a sampler."""

    cables: tuple[str, ...] = ("cable_1", "cable_2")
    """Cables."""
    labs: tuple[int, ...] = (0,)
    """Seeds of the laboratories."""
    count: int = 5
    """Casts to fit."""
    particles: int = 200
    """Particles of the sampler."""
    moves: int = 8
    """Metropolis-Hastings steps of each at each power."""
    actions: int = 60
    """Random casts whose landings the draws are compared by."""
    rig: str = "virtual"
    """Rig: virtual, strange, scattering, even, patchy, engine or example."""
    out: pathlib.Path = pathlib.Path("runs/benchmarks/casts")
    """Folder of casts and fits, which it shares with `benchmarks casts`."""


def sample(
    log_likelihood: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    mean: NDArray[np.float64],
    deviation: NDArray[np.float64],
    *,
    count: int,
    moves: int,
    seed: int = 0,
    report: ProgressCallback = ignore,
) -> NDArray[np.float64]:
    """Draw from a Gaussian prior in the unit cube times a likelihood, by sequential Monte Carlo.

    Args:
        log_likelihood: Logarithm of the likelihood of points, shape [point, n] to [point].
        mean: Mean of the prior before the cube cuts it off, shape [n].
        deviation: Its standard deviations, shape [n].
        count: Number of particles.
        moves: Metropolis-Hastings steps at each power.
        seed: Seed of the draws.
        report: Told the power that was reached.

    Returns:
        Points, shape [count, n].
    """
    rng = np.random.default_rng(seed)

    def log_prior(points: NDArray[np.float64]) -> NDArray[np.float64]:
        inside = np.all((points >= 0.0) & (points <= 1.0), axis=1)
        exponent = -0.5 * np.sum(((points - mean) / deviation) ** 2, axis=1)
        return np.where(inside, exponent, -np.inf)

    points = np.empty((0, len(mean)))
    while len(points) < count:
        drawn = mean + deviation * rng.normal(size=(count, len(mean)))
        points = np.concatenate([points, drawn[np.isfinite(log_prior(drawn))]])
    points = points[:count]
    known = log_likelihood(points)
    power, pace = 0.0, 0.5
    while power < 1.0:
        power, before = _next_power(known, power), power
        weights = np.exp((power - before) * (known - known.max()))
        # Systematic resampling: each particle is kept as often as it weighs, up to one.
        places = (rng.uniform() + np.arange(count)) / count
        kept = np.searchsorted(np.cumsum(weights) / weights.sum(), places)
        points, known = points[kept], known[kept]
        middle = points.mean(axis=0)
        factor = np.linalg.cholesky(WIDER * np.cov(points.T) + 1e-10 * np.eye(len(mean)))
        for _ in range(moves):
            # Steps that leave the Gaussian of the particles as it is may be long: where the
            # posterior is one, all are taken.
            z = np.linalg.solve(factor, (points - middle).T).T
            z_tried = np.sqrt(1.0 - pace**2) * z + pace * rng.normal(size=points.shape)
            tried = middle + z_tried @ factor.T
            inside = np.isfinite(log_prior(tried))
            likelihood = np.full(count, -np.inf)
            likelihood[inside] = log_likelihood(tried[inside])
            gain = power * (likelihood - known) + log_prior(tried) - log_prior(points)
            gain += 0.5 * (np.sum(z_tried**2, axis=1) - np.sum(z**2, axis=1))
            taken = np.log(rng.uniform(size=count)) < gain
            points[taken], known[taken] = tried[taken], likelihood[taken]
            pace = min(pace * float(np.exp(taken.mean() - ACCEPTED)), 1.0)
        report(Progress(task=f"Sampling: power {power:.3f} of the likelihood"))
    return points


def _next_power(known: NDArray[np.float64], power: float) -> float:
    """Return the power at which the particles are half as effective, by bisection."""

    def effective(candidate: float) -> float:
        weights = np.exp((candidate - power) * (known - known.max()))
        return float(weights.sum() ** 2 / np.sum(weights**2)) / len(known)

    low, high = power, 1.0
    if effective(1.0) >= EFFECTIVE:
        return 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective(middle) >= EFFECTIVE else (low, middle)
    return high


def track_likelihood(
    objective: TrackObjective, space: SearchSpace, misfit: float
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return the logarithm of the likelihood of the tracks at points of a search space."""

    def log_likelihood(points: NDArray[np.float64]) -> NDArray[np.float64]:
        loss = objective.distances(space.to_params(points)).loss / objective.cable.length
        return -TRACK_WEIGHT * len(objective) * loss / misfit

    return log_likelihood


def spreads(tuned: cc.Tuned, draws: CableParams, count: int) -> NDArray[np.float64]:
    """Return how far landings are apart over cables [% of length], shape [action].

    Some cables throw a sensitive cast far away: medians tell what is usual, variances do not.

    Args:
        tuned: Fit that the cables are near.
        draws: One value per cable.
        count: Number of random actions.

    Returns:
        Median distance from the median landing; NaN where no cable lands.
    """
    actions, _ = mirror_to_right(feasible_uniform(count, tuned.setup, seed=ACTION_SEED))
    values = draws.to_array()
    rows = np.repeat(np.arange(count), len(values))
    params = CableParams.from_array(np.tile(values, (count, 1)))
    rollout = tuned.dynamics.with_params(params).rollout(
        make_engine("warp", *ENGINE), tuned.setup, cast_grip_paths(actions, tuned.setup)[rows]
    )
    landings = rollout.endpoint_xy[:, -1].reshape(count, len(values), 2)
    apart = np.linalg.norm(landings - np.nanmedian(landings, axis=1)[:, None], axis=2)
    return 100.0 * np.nanmedian(apart, axis=1) / tuned.setup.cable.length


def along_product(known: ParamPosterior, count: int) -> CableParams:
    """Return draws of the Gaussian whose frictions keep the product that it states.

    Casts tell the product of the two frictions alone. A Gaussian follows it along a straight line,
    and far from the best point the product of a draw is another one.

    Args:
        known: Posterior of a fit.
        count: Number of draws.
    """
    values, best = known.draw(count).to_array(), known.params.to_array()
    names = CableParams.names()
    first, second = (names.index(name) for name in ("lateral_friction", "worksurface_friction"))
    product = best[second] * values[:, first] + best[first] * (values[:, second] - best[second])
    values[:, second] = np.clip(product / values[:, first], 0.02, 2.0)
    return CableParams.from_array(values)


def main(args: Args) -> int:
    """Run the benchmark and print its tables."""
    from scipy.stats import spearmanr

    shared = PlaceArgs(counts=(args.count,), out=args.out)
    rows: list[tuple] = []
    with console_progress() as progress:
        for cable in args.cables:
            for lab in args.labs:
                place = Place(shared, args.rig, lab, cable, progress)
                tuned, casts = place.tuned(args.count, paper=False), place.casts(args.count)
                if tuned.posterior is None or casts is None:
                    continue
                known = tuned.posterior
                tracks = MeasuredTracks.from_dataset(casts)
                objective = TrackObjective(make_engine("warp", 30, 1e-3), casts.cable, tracks)
                points = sample(
                    track_likelihood(objective, known.space, known.misfit),
                    known.prior.mean,
                    known.prior.deviation,
                    count=args.particles,
                    moves=args.moves,
                    report=progress,
                )
                print_parameters(f"{cable}, laboratory {lab}", known, points)
                some = known.space.to_params(points[:: max(1, len(points) // 40)])
                gauss = spreads(tuned, known.draw(40), args.actions)
                curved = spreads(tuned, along_product(known, 40), args.actions)
                drawn = spreads(tuned, some, args.actions)
                correlation = float(spearmanr(gauss, drawn)[0])  # pyright: ignore[reportArgumentType]
                rows.append(
                    (
                        f"{cable}, laboratory {lab}",
                        args.count,
                        f"{np.median(gauss):.1f}",
                        f"{np.median(curved):.1f}",
                        f"{np.median(drawn):.1f}",
                        f"{correlation:.2f}",
                    )
                )
    title = (
        "Spread of landings over draws of the posterior, median over casts, in % of cable length"
    )
    print(Table(title=title, columns=SPREAD_COLUMNS, rows=rows))
    return 0


def print_parameters(where: str, known: ParamPosterior, points: NDArray[np.float64]) -> None:
    """Print the deviations of each parameter, in shares of its search range."""
    rows = []
    for row, name in enumerate(known.space.names):
        gauss = float(known.deviation[row])
        shift = (float(points[:, row].mean()) - float(known.mean[row])) / gauss
        deviations = (known.prior.deviation[row], gauss, points[:, row].std())
        rows.append((name, *(f"{value:.3f}" for value in deviations), f"{shift:+.1f}"))
    title = f"{where}: deviations in shares of the search range; shift in Gaussian deviations"
    print(Table(title=title, columns=COLUMNS, rows=rows))
