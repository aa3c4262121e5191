"""Calibration casts that teach most, beside random ones and those that `aim` begins with.

Before any cast, the actions are chosen one after another whose tracks tell most of the parameters:
those with the largest mean logarithm of the determinant of the Fisher information, over cables
drawn from what is believed. The prior's precision is part of it, so directions that no cast can
tell count for nothing. Only actions are allowed whose simulated free end stays on the table for all
of these cables. Fits to these casts, to random ones, and to casts whose landings are spread over
the table, which `aim` makes, are compared on other, random casts of the rig.
"""

import dataclasses
import pathlib
import tempfile

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.common import Table
from benchmarks.places import open_rig
from cablecast.cable import CableParams
from cablecast.cli.progress import console_progress
from cablecast.datasets.collect import collect_dataset
from cablecast.datasets.reader import Dataset
from cablecast.datasets.store import CastStore
from cablecast.evaluation.intervals import median_interval
from cablecast.motion.cast import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.pipeline.engine import make_engine
from cablecast.runs.progress import Progress, ProgressCallback
from cablecast.runs.workers import LOCAL
from cablecast.tuning.least_squares import MISFIT_START, TRACK_WEIGHT
from cablecast.tuning.objective import TrackObjective
from cablecast.tuning.prior import ParamPrior
from cablecast.tuning.search_space import SearchSpace
from cablecast.tuning.tracks import MeasuredTracks

COLUMNS = ("casts", "chosen", "fits", "other casts", "median", "q1", "q3", "better than random")

STEP = 0.3
"""Step of the finite differences over the believed deviation: a local slope of an erratic cast
promises more than the cast can tell."""
OFFSET_MAX = 0.25
"""Largest offset of a sample that counts [cable lengths], for the same reason."""
SAMPLE_DT = 0.1
EDGE = 0.05
"""Distance from the table's edges that every simulated sample must keep [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Fits to the casts that teach most, to random ones, and to spread ones."""

    rig: str = "strange"
    """Rig: virtual, strange, scattering, even, patchy, engine or example."""
    labs: tuple[int, ...] = (0, 1, 2)
    """Seeds of the laboratories."""
    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    """Cables."""
    counts: tuple[int, ...] = (2, 3, 5)
    """Casts to fit."""
    others: int = 40
    """Random casts to measure the fits with."""
    repeats: int = 2
    """Draws of the random casts."""
    candidates: int = 150
    """Actions to choose from."""
    draws: int = 6
    """Cables drawn from what is believed."""
    workers: str = LOCAL
    """Who simulates for the fits: local, ray, or ray:ADDRESS."""
    out: pathlib.Path | None = None
    """Folder that keeps casts and fits and lets a stopped run go on."""


def informative_actions(
    setup: cc.Setup, count: int, *, candidates: int, draws: int, seed: int = 0
) -> NDArray[np.float64]:
    """Choose the actions whose tracks tell most of a cable that is only believed.

    Args:
        setup: Cable with what is believed of it, workspace, arm and motion settings.
        count: Number of actions.
        candidates: Random actions to choose from.
        draws: Cables drawn from what is believed.
        seed: Seed of the candidates and of the draws.

    Returns:
        Actions, the most telling one first, shape [count, 4].
    """
    space = SearchSpace.for_cable(setup.cable)
    prior = ParamPrior.for_cable(setup.cable, space)
    actions = feasible_uniform(candidates, setup, seed=1000 + seed)
    points = prior.draw(draws, seed)
    step = np.where(points > 0.5, -1.0, 1.0) * STEP * prior.deviation
    shifted = points[:, None] + np.eye(space.dimension)[None] * step[:, None]
    cables = np.concatenate([points[:, None], np.clip(shifted, 0.0, 1.0)], axis=1)
    values = space.to_params(cables.reshape(-1, space.dimension)).to_array()
    rollout = make_engine(30, 1e-3).rollout(
        setup.cable,
        CableParams.from_array(np.tile(values, (candidates, 1))),
        cast_grip_paths(actions, setup)[np.repeat(np.arange(candidates), len(values))],
        sample_dt=SAMPLE_DT,
    )
    shape = (candidates, draws, space.dimension + 1, -1, 2)
    xy = rollout.endpoint_xy.reshape(shape)
    margin = setup.workspace.edge_distance(xy).min(axis=(1, 2, 3))
    offsets = (xy[:, :, 1:] - xy[:, :, :1]) / setup.cable.length
    offsets = offsets / np.sqrt(1.0 + np.sum(offsets**2, axis=-1, keepdims=True) / OFFSET_MAX**2)
    slopes = offsets / step[None, :, :, None, None]
    weight = TRACK_WEIGHT / (2.0 * MISFIT_START**2 * xy.shape[3])
    information = weight * np.einsum("adptc,adqtc->adpq", slopes, slopes)
    safe = np.isfinite(information).all(axis=(1, 2, 3)) & (margin > EDGE)
    known = np.broadcast_to(np.diag(prior.deviation**-2.0), information.shape[1:]).copy()
    chosen: list[int] = []
    for _ in range(count):
        gain = np.full(candidates, -np.inf)
        left = safe & ~np.isin(np.arange(candidates), chosen)
        gain[left] = np.linalg.slogdet(known + information[left])[1].mean(axis=1)
        chosen.append(int(np.argmax(gain)))
        known = known + information[chosen[-1]]
    return actions[chosen]


def main(args: Args) -> int:
    """Run the benchmark and print its table."""
    errors: dict[tuple[int, str], list[NDArray[np.float64]]] = {}
    with tempfile.TemporaryDirectory() as temporary, console_progress() as progress:
        out = args.out or pathlib.Path(temporary)
        for cable in args.cables:
            for lab in args.labs:
                place = out / f"{args.rig}-{lab}-{cable}"
                for key, values in compare(args, cable, lab, place, progress).items():
                    errors.setdefault(key, []).extend(values)
    rows = []
    for (count, kind), values in sorted(errors.items()):
        every = np.concatenate(values)
        median, low, high = median_interval(every)
        q1, q3 = np.quantile(every, (0.25, 0.75))
        pairs = [np.median(a) for a in values]
        random = [np.median(a) for a in errors[count, "random"]]
        per = len(random) // len(pairs)
        wins = [a < b for k, a in enumerate(pairs) for b in random[k * per : (k + 1) * per]]
        rows.append(
            (
                count,
                kind,
                len(values),
                len(every),
                f"{median:.1f} ({low:.1f} to {high:.1f})",
                f"{q1:.1f}",
                f"{q3:.1f}",
                f"{sum(wins)} of {len(wins)}" if kind != "random" else "",
            )
        )
    title = "Simulated against measured landing of other casts, in % of cable length"
    print(Table(title=title, columns=COLUMNS, rows=rows))
    return 0


def first(casts: Dataset, count: int) -> Dataset:
    """Return the first casts of a dataset."""
    every, chosen = CastStore(casts.setup), CastStore(casts.setup)
    every.add_dataset(casts)
    chosen.casts = every.casts[:count]
    return chosen.dataset()


def compare(
    args: Args, cable: str, lab: int, place: pathlib.Path, report: ProgressCallback
) -> dict[tuple[int, str], list[NDArray[np.float64]]]:
    """Return the errors of fits on other casts [% of cable length], by casts and choice."""
    setup = cc.Setup(cable=cable)
    rig = open_rig(args.rig, lab, setup)
    most = max(args.counts)

    def cast(name: str, actions: NDArray[np.float64]) -> Dataset:
        return collect_dataset(place / name, rig, setup, purpose="tune", actions=actions)

    others = cast("others", feasible_uniform(args.others, setup, seed=99))
    tracks = MeasuredTracks.from_dataset(others)
    telling = informative_actions(setup, most, candidates=args.candidates, draws=args.draws)
    sets = [("most telling", cast("telling", telling))]
    for repeat in range(args.repeats):
        actions = feasible_uniform(most, setup, seed=200 + repeat)
        sets.append(("random", cast(f"random-{repeat}", actions)))
    errors: dict[tuple[int, str], list[NDArray[np.float64]]] = {}
    for count in args.counts:
        spread = cc.collect(rig, count=count, sampling="spread", out=place / f"spread-{count}")
        for number, (kind, casts) in enumerate([*sets, ("spread", spread)]):
            report(Progress(task=f"{cable}, laboratory {lab}: fit to {count} {kind} casts"))
            tuned = cc.tune(
                first(casts, count),
                validation_count=0,
                workers=args.workers,
                out=place / f"fit-{count}-{number}",
            )
            fitted = setup.cable.with_material(tuned.dynamics.material)
            objective = TrackObjective(make_engine(), fitted, tracks)
            final = objective.distances(tuned.params).final[0] / setup.cable.length
            errors.setdefault((count, kind), []).append(100.0 * final[np.isfinite(final)])
    return errors
