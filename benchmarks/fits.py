"""Fits of the simulator: what a material is worth, and the posterior against a sampler.

material: casts of each cable in each copy of a laboratory are collected, as `cablecast aim` makes
them, and random ones. The first are fitted with the ten parameters alone, and with the values of
the material, too, where they are likelier with these; the random ones show how far the simulated
endpoint then is from the measured one.

sampler: the Gaussian posterior of a fit against draws of a sampler that assumes no shape.
Sequential Monte Carlo: particles from what is believed of the cable are led to the posterior
through powers of the likelihood. At each power they are resampled by their weights and moved by
Metropolis-Hastings steps that leave the Gaussian of all particles as it is. All particles times all
casts are one batch of the engine. The density is that of the fit, at its coarse resolution and with
the misfit that it ended with.
"""

import dataclasses
import pathlib
import sys
import tempfile
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.places import ModelArgs, Place, open_rig
from benchmarks.result import Table
from cablecast.cable import ROD_ARM, CableParams
from cablecast.cli.progress import console_progress
from cablecast.data.dataset import Dataset
from cablecast.data.store import CastStore
from cablecast.engines import make_engine
from cablecast.motion.action import mirror_to_right
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.pipeline.collect import AnySampling, collect
from cablecast.pipeline.tune import tune
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.runs.workers import LOCAL
from cablecast.setup import Setup
from cablecast.tuning.fit import TRACK_WEIGHT, FitConfig
from cablecast.tuning.space import ParamPosterior, SearchSpace
from cablecast.tuning.tracks import MeasuredTracks, TrackObjective

MATERIAL_COLUMNS = (
    "cable",
    "laboratory",
    "fit",
    "damping time [ms]",
    "curl [rad]",
    "attachment [mm]",
    "yield [1/m]",
    "on the way, mean [%]",
    "at rest, median [%]",
    "q1",
    "q3",
)
NO_MATERIAL: dict[str, Any] = {"materials": ()}


@dataclasses.dataclass(frozen=True, kw_only=True)
class MaterialArgs:
    """Fits with and without a material.

    Attributes:
        rig: Rig: virtual, strange, even, patchy, engine or example.
        cables: Names of the cables.
        labs: Seeds of the laboratories.
        fitted: Casts to fit.
        sampling: Sampling of the casts to fit: spread, uniform or grid.
        others: Random casts to measure the fit with.
        seed: Seed of the casts.
        workers: Who simulates for the fits: local, ray, or ray:ADDRESS.
        out: Folder that keeps the casts and lets a stopped run resume.
    """

    rig: str = "virtual"
    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    labs: tuple[int, ...] = (0, 1, 2)
    fitted: int = 5
    sampling: AnySampling = "spread"
    others: int = 60
    seed: int = 0
    workers: str = LOCAL
    out: pathlib.Path | None = None


def material(args: MaterialArgs) -> Iterator[Table]:
    table = Table("Simulated against measured endpoint, in % of cable length", MATERIAL_COLUMNS, [])
    with tempfile.TemporaryDirectory() as temporary:
        out = args.out or pathlib.Path(temporary)
        for cable in args.cables:
            for lab in args.labs:
                casts = collected(cable, lab, args, out)
                for settings in (NO_MATERIAL, {}):
                    table.rows.append(fitted(casts, lab, settings, args))
                    print(*table.rows[-1], file=sys.stderr, flush=True)
    yield table


def collected(cable: str, lab: int, args: MaterialArgs, out: pathlib.Path) -> Dataset:
    """Return the casts to fit, and then the others."""
    setup = Setup(cable=cable)
    rig = open_rig(args.rig, lab, setup)
    every = CastStore(setup)
    with rig, console_progress() as progress:
        parts: tuple[tuple[str, int, AnySampling], ...] = (
            ("tune", args.fitted, args.sampling),
            ("real", args.others, "uniform"),
        )
        for purpose, count, sampling in parts:
            made = collect(
                rig,
                count=count,
                seed=args.seed,
                purpose=purpose,
                sampling=sampling,
                out=out / f"{args.rig}-{cable}-{lab}-{sampling}-{count}",
                progress=progress,
            )
            every.add_dataset(made)
    return every.dataset()


def fitted(casts: Dataset, lab: int, settings: dict[str, Any], args: MaterialArgs) -> tuple:
    with console_progress() as progress:
        tuned = tune(
            casts,
            config=FitConfig(seed=args.seed, **settings),
            validation_count=args.others,
            workers=args.workers,
            progress=progress,
        )
    row = tuned.metrics["validation"]["tuned"]
    params = tuned.params
    damping_time, curvature, arm = (
        float(np.asarray(value))
        for value in (params.damping_time, params.rest_curvature, params.attachment_arm)
    )
    names = ("mean", "final_median", "final_first_quartile", "final_third_quartile")
    return (
        casts.cable.name,
        lab,
        "ten parameters" if settings else "as the casts ask",
        1e3 * damping_time,
        round(curvature * casts.cable.length, 2),
        round(1e3 * arm / ROD_ARM, 1),
        round(float(np.asarray(params.yield_curvature))),
        *(row[f"{name}_pct"] for name in names),
    )


PARAMETER_COLUMNS = ("parameter", "believed", "Gaussian", "sampler", "shift of the mean")
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
class SamplerArgs:
    """Posterior of a fit against draws of a sampler."""

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
    """Rig: virtual, strange, even, patchy, engine or example."""
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
        report: Called with the power that was reached.

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
    likelihoods = log_likelihood(points)
    power, pace = 0.0, 0.5
    while power < 1.0:
        power, before = _next_power(likelihoods, power), power
        weights = np.exp((power - before) * (likelihoods - likelihoods.max()))
        # Systematic resampling: each particle is kept as often as it weighs, up to one.
        places = (rng.uniform() + np.arange(count)) / count
        kept = np.searchsorted(np.cumsum(weights) / weights.sum(), places)
        points, likelihoods = points[kept], likelihoods[kept]
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
            gain = power * (likelihood - likelihoods) + log_prior(tried) - log_prior(points)
            gain += 0.5 * (np.sum(z_tried**2, axis=1) - np.sum(z**2, axis=1))
            taken = np.log(rng.uniform(size=count)) < gain
            points[taken], likelihoods[taken] = tried[taken], likelihood[taken]
            pace = min(pace * float(np.exp(taken.mean() - ACCEPTED)), 1.0)
        report(Progress(task=f"Sampling: power {power:.3f} of the likelihood"))
    return points


def _next_power(likelihoods: NDArray[np.float64], power: float) -> float:
    """Return the power at which the particles are half as effective, by bisection."""

    def effective(candidate: float) -> float:
        weights = np.exp((candidate - power) * (likelihoods - likelihoods.max()))
        return float(weights.sum() ** 2 / np.sum(weights**2)) / len(likelihoods)

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

    Some cables throw a sensitive cast far away: medians show what is usual, variances do not.

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


def along_product(posterior: ParamPosterior, count: int) -> CableParams:
    """Return draws of the Gaussian whose frictions keep the product that it states.

    Casts determine only the product of the two frictions. A Gaussian follows it along a straight
    line, and far from the best point the product of a draw is another one.

    Args:
        posterior: Posterior of a fit.
        count: Number of draws.
    """
    values, best = posterior.draw(count).to_array(), posterior.params.to_array()
    names = CableParams.names()
    first, second = (names.index(name) for name in ("lateral_friction", "worksurface_friction"))
    product = best[second] * values[:, first] + best[first] * (values[:, second] - best[second])
    values[:, second] = np.clip(product / values[:, first], 0.02, 2.0)
    return CableParams.from_array(values)


def sampler(args: SamplerArgs) -> Iterator[Table]:
    """Yield the deviations of each fit, and the spread of landings over its draws."""
    from scipy.stats import spearmanr

    models = ModelArgs(out=args.out)
    rows: list[tuple] = []
    with console_progress() as progress:
        for cable in args.cables:
            for lab in args.labs:
                place = Place(models, args.rig, lab, cable, args.count, progress)
                tuned, casts = place.tuned(args.count), place.casts(args.count)
                if casts is None or tuned is None or tuned.posterior is None:
                    continue
                posterior = tuned.posterior
                tracks = MeasuredTracks.from_dataset(casts)
                objective = TrackObjective(make_engine("warp", 30, 1e-3), casts.cable, tracks)
                points = sample(
                    track_likelihood(objective, posterior.space, posterior.misfit),
                    posterior.prior.mean,
                    posterior.prior.deviation,
                    count=args.particles,
                    moves=args.moves,
                    report=progress,
                )
                yield deviations(f"{cable}, laboratory {lab}", posterior, points)
                sampled = posterior.space.to_params(points[:: max(1, len(points) // 40)])
                gauss = spreads(tuned, posterior.draw(40), args.actions)
                curved = spreads(tuned, along_product(posterior, 40), args.actions)
                drawn = spreads(tuned, sampled, args.actions)
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
    yield Table(title=title, columns=SPREAD_COLUMNS, rows=rows)


def deviations(where: str, posterior: ParamPosterior, points: NDArray[np.float64]) -> Table:
    """Return the deviations of each parameter, in shares of its search range."""
    rows = []
    for row, name in enumerate(posterior.space.names):
        gauss = float(posterior.deviation[row])
        shift = (float(points[:, row].mean()) - float(posterior.mean[row])) / gauss
        spread = (posterior.prior.deviation[row], gauss, points[:, row].std())
        rows.append((name, *(f"{value:.3f}" for value in spread), f"{shift:+.1f}"))
    title = f"{where}: deviations in shares of the search range; shift in Gaussian deviations"
    return Table(title=title, columns=PARAMETER_COLUMNS, rows=rows)
