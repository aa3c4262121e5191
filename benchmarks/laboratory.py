"""Difficulty of the virtual rig and of the real one.

Three tables: the scatter of repeated casts and the share that leaves the table (paper, section
VI-B, cable 1); the shape of that scatter where a UR5 cast real cables, 240 landings that were read
from a figure of the paper's sibling (arXiv 2111.04814: 3 cables, 16 targets, 5 casts at each); and
the error of an engine with the believed parameters of each cable (table I, the rows with
default parameters).
"""

import dataclasses
import pathlib
import tempfile
from collections.abc import Iterator

import numpy as np
from scipy import stats

from benchmarks.result import Table
from cablecast.cli.progress import console_progress
from cablecast.conventions import xy_to_polar
from cablecast.data.record import collect_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.evaluation.coverage import PUBLISHED_CANDIDATES, Candidate
from cablecast.evaluation.published import published_tuning
from cablecast.evaluation.repeatability import (
    ActionScatter,
    Repeatability,
    measure_repeatability,
    repeat_actions,
)
from cablecast.files import read_csv
from cablecast.motion.action import ACTION_SIZE
from cablecast.rigs.make import make_rig
from cablecast.setup import Setup
from cablecast.tuning.tracks import MeasuredTracks, TrackObjective
from cablecast.tuning.tune import distance_summary

FACTOR_MAX = 1.5
"""Largest ratio between our scatter and the published one, either way."""
UNTUNED_RANGE_PCT = (24.0, 35.0)
"""Range of the median final distance of the paper's untuned simulator."""

REAL_LANDINGS = pathlib.Path(__file__).parent / "data" / "real_landings.csv"
REAL_CABLE_LENGTHS = {"1": 0.63, "2": 0.65, "3": 0.65}
"""Lengths of the cables that were cast for that figure [m]."""

LANDING_COLUMNS = ("cable", "target_x_m", "target_y_m", "landing_x_m", "landing_y_m")

REAL_COLUMNS = (
    "real cable",
    "targets",
    "casts",
    "scatter [%]",
    "median",
    "SD of distance [%]",
    "along arc [%]",
    "growth with distance",
    "growth with width",
)
SCATTER_COLUMNS = (
    "v_max [m/s]",
    "psi",
    "actions",
    "casts",
    "scatter [%]",
    "standard error",
    "median",
    "SD of distance [%]",
    "paper's",
    "within x 1.5",
    "off table [%]",
    "paper's ",
    "along arc [%]",
    "growth with distance",
    "growth with width",
)
UNTUNED_COLUMNS = (
    "cable",
    "casts",
    "median final distance [%]",
    "paper's",
    "mean distance, eq. 4 [%]",
    "paper's ",
    "within 24 to 35 %",
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """The virtual rig and the paper's figures.

    Attributes:
        action_count: Number of actions of each grid to repeat, drawn at random; 0 for all.
        repeats: Number of casts of each action.
        untuned_count: Casts of each cable to compare with the untuned engine; 0 leaves that out.
        cables: Names of the cables to compare with the untuned engine.
        seed: Seed of the actions and of the rig.
        rig: Name of the rig: virtual:2 for laboratory 2.
        out: Folder that keeps the casts and lets a stopped run resume. They are not made again when
            the laboratory changes: give a new folder then.
    """

    action_count: int = 0
    repeats: int = 5
    untuned_count: int = 80
    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    seed: int = 0
    rig: str = "virtual"
    out: pathlib.Path | None = None


def main(args: Args) -> Iterator[Table]:
    with tempfile.TemporaryDirectory() as temporary:
        out = args.out or pathlib.Path(temporary)
        yield Table(
            "Scatter of equal casts of cable 1 on the virtual rig, in % of cable length",
            SCATTER_COLUMNS,
            [scatter_row(published, args, out) for published in PUBLISHED_CANDIDATES],
        )
        yield Table(
            "Shape of the scatter of real casts (arXiv 2111.04814), by the same measures",
            REAL_COLUMNS,
            [real_row(cable) for cable in REAL_CABLE_LENGTHS],
        )
        if args.untuned_count:
            yield Table(
                "Untuned engine against the virtual rig, in % of cable length",
                UNTUNED_COLUMNS,
                [untuned_row(name, args, out) for name in args.cables],
            )


def scatter_row(published: Candidate, args: Args, out: pathlib.Path) -> tuple:
    setup = Setup().with_motion(v_max=published.v_max)
    actions = repeat_actions(
        setup,
        with_psi=published.with_psi,
        action_count=args.action_count or None,
        seed=args.seed,
    )
    name = f"{published.v_max:g}{'-psi' if published.with_psi else ''}"
    with make_rig(args.rig, setup, args.seed) as rig, console_progress() as progress:
        result = measure_repeatability(
            out / f"repeat-{name}",
            rig,
            setup,
            actions=actions,
            repeats=args.repeats,
            progress=progress,
        )
    # The paper's numbers are read as its words say; see `Repeatability.distance_sd_pct`.
    ratio = result.distance_sd_pct / published.scatter_pct
    growth = growth_of_scatter(result)
    return (
        published.v_max,
        "yes" if published.with_psi else "no",
        len(actions),
        result.cast_count,
        result.scatter_pct,
        result.scatter_standard_error_pct,
        median_scatter(result),
        result.distance_sd_pct,
        published.scatter_pct,
        "yes" if 1 / FACTOR_MAX <= ratio <= FACTOR_MAX else "no",
        100 * result.off_table_share,
        "-" if published.off_table_share is None else 100 * published.off_table_share,
        100 * result.along_arc_share,
        growth["distance"],
        growth["width"],
    )


def growth_of_scatter(result: Repeatability) -> dict[str, float]:
    """Return rank correlations of the scatter with the landing; NaN below three actions.

    `distance` is the correlation with the distance from the base, `width` that with the angle
    from the workspace axis.
    """
    finite = np.isfinite(result.scatters_pct)
    if finite.sum() < 3:
        return {"distance": np.nan, "width": np.nan}
    polar = xy_to_polar([a.mean_xy for a in result.actions])[finite]
    scatter = result.scatters_pct[finite]
    places = {"distance": polar[:, 0], "width": np.abs(polar[:, 1])}
    return {
        name: float(stats.spearmanr(values, scatter)[0])  # pyright: ignore[reportArgumentType]
        if np.ptp(values) > 0 and np.ptp(scatter) > 0
        else np.nan
        for name, values in places.items()
    }


def median_scatter(result: Repeatability) -> float:
    """Return the median scatter over the actions [% of cable length], NaN if all are."""
    finite = result.scatters_pct[np.isfinite(result.scatters_pct)]
    return float(np.median(finite)) if len(finite) else float("nan")


def real_row(real_cable: str) -> tuple:
    landings: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for row in read_csv(REAL_LANDINGS, LANDING_COLUMNS):
        if row["cable"] == real_cable:
            target = row["target_x_m"], row["target_y_m"]
            landed = float(row["landing_x_m"]), float(row["landing_y_m"])
            landings.setdefault(target, []).append(landed)
    cable = dataclasses.replace(Setup().cable, length=REAL_CABLE_LENGTHS[real_cable])
    # The landings are known, the actions are not.
    unknown = np.full(ACTION_SIZE, np.nan)
    result = Repeatability(
        setup=Setup(cable=cable),
        actions=tuple(
            ActionScatter(action=unknown, landed_xy=np.array(xy), statuses=("ok",) * len(xy))
            for xy in landings.values()
        ),
    )
    growth = growth_of_scatter(result)
    return (
        real_cable,
        len(result.actions),
        result.cast_count,
        result.scatter_pct,
        median_scatter(result),
        result.distance_sd_pct,
        100 * result.along_arc_share,
        growth["distance"],
        growth["width"],
    )


def untuned_row(cable_name: str, args: Args, out: pathlib.Path) -> tuple:
    setup = Setup(cable=cable_name)
    cable = setup.cable
    published = published_tuning(cable.name)
    with make_rig(args.rig, setup, args.seed) as rig, console_progress() as progress:
        dataset = collect_dataset(
            out / f"untuned-{cable.name}",
            rig,
            setup,
            purpose="tune",
            count=args.untuned_count,
            seed=args.seed,
            progress=progress,
        )
    # As in the paper, the simulator is given the motion as it was commanded.
    tracks = MeasuredTracks.from_dataset(dataset, path_source="commanded")
    distances = TrackObjective(EngineWarp(), cable, tracks).distances(cable.params)
    summary = distance_summary(distances, 0, cable.length)
    final = summary["final_median_pct"]
    landed = final is not None and np.isfinite(final)
    low, high = UNTUNED_RANGE_PCT
    return (
        cable.name,
        len(dataset),
        final if landed else "-",
        "-" if published is None else published.default_final_pct,
        summary["mean_pct"],
        "-" if published is None else published.default_mean_pct,
        "yes" if landed and low <= final <= high else "no",
    )
