"""Evaluation of a policy on a rig: casts at targets, their errors, and where these come from."""

import dataclasses
import math
import pathlib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.cast import Cast, TrialStatus
from cablecast.conventions import finite_or_none, xy_to_polar
from cablecast.data.record import TrialPlan, record_trials
from cablecast.data.store import dataset_cast
from cablecast.errors import InputError
from cablecast.files import write_csv
from cablecast.learning.policy import Policy
from cablecast.motion.casting import Action
from cablecast.motion.polar import PolarCast
from cablecast.motion.trajectory import Trajectory
from cablecast.rigs.base import Rig, run_trials
from cablecast.runs.progress import ProgressCallback, ignore
from cablecast.setup import Setup
from cablecast.task import LANDING


@dataclasses.dataclass(frozen=True, kw_only=True)
class ErrorSummary:
    """Five-number summary of errors in % of cable length, as in the paper, and their number.

    Values are NaN without errors, and infinite where a miss of unknown size determines them.
    """

    count: int
    median_pct: float
    first_quartile_pct: float
    third_quartile_pct: float
    min_pct: float
    max_pct: float

    def to_dict(self) -> dict:
        """Return plain values for a JSON file; NaN and infinity, which JSON lacks, become None."""
        values = dataclasses.asdict(self)
        count = values.pop("count")
        return {"count": count} | {name: finite_or_none(value) for name, value in values.items()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "ErrorSummary":
        """Return the summary that metrics.json holds; None becomes NaN."""
        numbers: dict[str, Any] = {
            name: math.nan if value is None else value for name, value in values.items()
        }
        return cls(**numbers)


def summarise_errors(errors_pct: ArrayLike) -> ErrorSummary:
    """Summarise errors [% of cable length] of any shape.

    Trials without a landing (NaN) are left out, as in the paper; infinite errors are misses of
    unknown size, and are counted.
    """
    errors = np.asarray(errors_pct, dtype=float)
    errors = np.sort(errors[~np.isnan(errors)])
    quantiles = np.full(5, np.nan)
    if len(errors):
        places = np.array([0.5, 0.25, 0.75, 0.0, 1.0]) * (len(errors) - 1)
        # Unlike np.quantile, it never gives NaN next to infinity.
        quantiles = np.interp(places, np.arange(len(errors)), errors)
    median, first_quartile, third_quartile, low, high = quantiles.tolist()
    return ErrorSummary(
        count=len(errors),
        median_pct=median,
        first_quartile_pct=first_quartile,
        third_quartile_pct=third_quartile,
        min_pct=low,
        max_pct=high,
    )


DRAW_COUNT = 2000
"""Bootstrap draws."""

SHARE = 0.9
"""Share of the draws that an interval holds."""


def median_interval(values: ArrayLike) -> tuple[float, float, float]:
    """Return the median of values in any unit, and the ends of its bootstrap interval."""
    known = np.asarray(values, dtype=float)
    low, high = _ends(np.median(known[_picks(len(known))], axis=1))
    return float(np.median(known)), low, high


def difference_interval(first: ArrayLike, second: ArrayLike) -> tuple[float, float, float]:
    """Return the first median less the second, and the ends of its bootstrap interval.

    The values are of two methods in the same cases, shape [case].
    """
    both = np.array([first, second], dtype=float)
    draws = np.median(both[:, _picks(both.shape[1])], axis=2)
    low, high = _ends(draws[0] - draws[1])
    return float(np.median(both[0]) - np.median(both[1])), low, high


def share_of_smaller_median(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return how often one method has the smaller median error, over bootstrap draws of targets.

    Misses at one target are correlated, so whole targets are drawn, with replacement. Errors are
    NaN without a landing, shape [target, cast]; a draw without a landing counts for neither.
    """
    picks = _picks(len(first))
    drawn = (errors[picks].reshape(len(picks), -1) for errors in (first, second))
    # Unlike np.nanmedian, it does not warn of a draw without a landing.
    medians = [np.ma.median(np.ma.masked_invalid(own), axis=1).filled(np.nan) for own in drawn]
    return float(np.mean(medians[0] < medians[1]))


def _picks(count: int) -> NDArray[np.int_]:
    """Return which cases each draw holds, shape [draw, case]; the same for equal counts."""
    return np.random.default_rng(0).integers(count, size=(DRAW_COUNT, count))


def _ends(draws: NDArray[np.float64]) -> tuple[float, float]:
    low, high = np.quantile(draws, (0.5 - 0.5 * SHARE, 0.5 + 0.5 * SHARE))
    return float(low), float(high)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evaluation:
    """All casts of one policy on one rig.

    Attributes:
        setup: Cable, workspace, arm and motion settings.
        rig: Description of the rig.
        target_xy: Targets [m], shape [target, 2].
        inside_coverage: Whether each target lies inside the simulated coverage, shape [target].
        casts: Casts, target by target.
        motions: Executed motion of each cast.
        target_index: Index of the target of each cast, shape [cast].
        predicted_xy: Predicted resting point of each cast [m], shape [cast, 2].
        fingerprint: Fingerprint of the casts.
        metrics: Metrics of the evaluation, as stored in metrics.json.
    """

    setup: Setup
    rig: dict[str, Any]
    target_xy: NDArray[np.float64]
    inside_coverage: NDArray[np.bool_]
    casts: tuple[Cast, ...]
    motions: tuple[Trajectory, ...]
    target_index: NDArray[np.int_]
    predicted_xy: NDArray[np.float64]
    fingerprint: str = ""
    metrics: dict[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def cable(self) -> Cable:
        """Cable that was cast."""
        return self.setup.cable

    @property
    def landed_xy(self) -> NDArray[np.float64]:
        """Resting point of each cast [m], NaN unless its status is OK, shape [cast, 2]."""
        return np.array([cast.final_xy for cast in self.casts]).reshape(-1, 2)

    @property
    def aimed_xy(self) -> NDArray[np.float64]:
        """Target of each cast [m], shape [cast, 2]."""
        return self.target_xy[self.target_index]

    @property
    def repeat(self) -> NDArray[np.int_]:
        """Number of earlier casts at the target of each cast, shape [cast]."""
        earlier = np.tril(self.target_index[:, None] == self.target_index, -1)
        return earlier.sum(axis=1)

    def rows(self, chosen: NDArray[np.int_]) -> "Evaluation":
        """Return the evaluation of some casts."""
        return dataclasses.replace(
            self,
            casts=tuple(self.casts[row] for row in chosen),
            motions=tuple(self.motions[row] for row in chosen),
            target_index=self.target_index[chosen],
            predicted_xy=self.predicted_xy[chosen],
        )

    @property
    def errors_pct(self) -> NDArray[np.float64]:
        """Distance from target to landing [% of cable length], NaN unless OK, shape [cast]."""
        return 100.0 * LANDING.miss(self.landed_xy, self.aimed_xy, self.setup)

    @property
    def planned_errors_pct(self) -> NDArray[np.float64]:
        """Distance from target to predicted endpoint [% of cable length], shape [cast]."""
        return 100.0 * LANDING.miss(self.predicted_xy, self.aimed_xy, self.setup)

    @property
    def prediction_errors_pct(self) -> NDArray[np.float64]:
        """Distance from predicted endpoint to landing [% of cable length], shape [cast]."""
        return 100.0 * LANDING.miss(self.landed_xy, self.predicted_xy, self.setup)

    @property
    def status_counts(self) -> dict[TrialStatus, int]:
        """Number of casts by status."""
        statuses = [cast.status for cast in self.casts]
        return {status: statuses.count(status) for status in TrialStatus}

    @property
    def summary(self) -> ErrorSummary:
        """Error summary as in the paper's tables (section VI): casts not OK are left out."""
        return summarise_errors(self.errors_pct)

    @property
    def summary_misses_counted(self) -> ErrorSummary:
        """Error summary that counts every cast not OK as a miss of unknown, large size."""
        return summarise_errors(np.nan_to_num(self.errors_pct, nan=np.inf))

    @property
    def summary_inside_coverage(self) -> ErrorSummary:
        """Error summary of the casts whose target lies inside the simulated coverage."""
        inside = self.inside_coverage[self.target_index]
        return summarise_errors(np.where(inside, self.errors_pct, np.nan))


def evaluate_policy(
    path: str | pathlib.Path,
    policy: Policy,
    rig: Rig,
    targets: ArrayLike,
    *,
    repeats: int = 1,
    progress: ProgressCallback = ignore,
) -> Evaluation:
    """Cast at targets [m], shape [target, 2], on a rig, and collect the results.

    Casts are stored as they are made. An interrupted evaluation resumes; see `record_trials`. The
    rig is not closed.

    Raises:
        TargetError: A target is not finite, out of reach, or off the table.
        RigError: A cast failed too often.
        DatasetError: The folder holds other casts.
    """
    setup = policy.setup
    plan = policy.plan(targets)
    target_xy = plan.target_xy
    motions = plan.trajectories
    inside = np.asarray(plan.inside_coverage, dtype=bool)
    trials = TrialPlan(
        setup=setup,
        kind="evaluate",
        count=len(target_xy),
        motion=lambda number: motions[number],
        repeats=repeats,
        keep_nodes=True,
    )
    settings = {
        "targets": target_xy.tolist(),
        "policy": policy.info,
        "durations": [round(motion.duration, 9) for motion in motions],
    }
    dataset = record_trials(path, rig, trials, settings, progress)
    target_index = np.arange(len(dataset)) // repeats
    return Evaluation(
        setup=setup,
        rig=dataset.settings.rig,
        target_xy=target_xy,
        inside_coverage=inside,
        casts=tuple(dataset_cast(dataset, row) for row in range(len(dataset))),
        motions=tuple(motions[index] for index in target_index),
        target_index=target_index,
        predicted_xy=plan.predicted_xy[target_index],
        fingerprint=dataset.fingerprint,
    )


TRIAL_COLUMNS: tuple[str, ...] = (
    "target",
    "repeat",
    "target_x_m",
    "target_y_m",
    "target_r_m",
    "target_theta_deg",
    "inside_coverage",
    "motion",
    "theta1_deg",
    "theta2_deg",
    "r2_m",
    "psi_deg",
    "pace",
    "polar_azimuth_deg",
    "polar_x_m",
    "polar_y_m",
    "polar_pace",
    "duration_s",
    "predicted_x_m",
    "predicted_y_m",
    "landed_x_m",
    "landed_y_m",
    "error_pct",
    "prediction_error_pct",
    "status",
)


def evaluation_metrics(evaluation: Evaluation) -> dict:
    """Return the metrics of an evaluation as plain values, errors in % of cable length."""
    return {
        "cable": evaluation.cable.name,
        "cable_length_m": evaluation.cable.length,
        "rig": evaluation.rig,
        "target_count": len(evaluation.target_xy),
        "targets_inside_coverage": int(np.sum(evaluation.inside_coverage)),
        "trial_count": len(evaluation.casts),
        "casts_fingerprint": evaluation.fingerprint,
        "status_counts": {
            status.code: count for status, count in evaluation.status_counts.items() if count
        },
        "errors_pct": evaluation.summary.to_dict(),
        "errors_inside_coverage_pct": evaluation.summary_inside_coverage.to_dict(),
        "errors_misses_counted_pct": evaluation.summary_misses_counted.to_dict(),
        "planned_errors_pct": summarise_errors(evaluation.planned_errors_pct).to_dict(),
        "prediction_errors_pct": summarise_errors(evaluation.prediction_errors_pct).to_dict(),
    }


def trial_rows(evaluation: Evaluation) -> list[dict[str, object]]:
    """Return one row per trial with the columns `TRIAL_COLUMNS`, in metres and degrees."""
    rows = []
    errors_pct, prediction_errors_pct = evaluation.errors_pct, evaluation.prediction_errors_pct
    aimed_xy, repeat = evaluation.aimed_xy, evaluation.repeat
    no_polar = np.full(len(PolarCast.parameters), np.nan)
    for row, cast in enumerate(evaluation.casts):
        r, theta = xy_to_polar(aimed_xy[row])
        # Parameters of other families are empty cells.
        theta1, theta2, r2, psi, pace = cast.sweep
        polar = cast.action.to_array() if isinstance(cast.action, PolarCast) else no_polar
        target = int(evaluation.target_index[row])
        values = (
            target,
            int(repeat[row]),
            *rounded_cells(aimed_xy[row]),
            *rounded_cells((r, math.degrees(theta))),
            str(bool(evaluation.inside_coverage[target])).lower(),
            "" if cast.action is None else cast.action.family,
            *rounded_cells((math.degrees(theta1), math.degrees(theta2), r2, math.degrees(psi))),
            *rounded_cells((pace, math.degrees(polar[0]), *polar[1:], cast.duration)),
            *rounded_cells(evaluation.predicted_xy[row]),
            *rounded_cells(cast.final_xy),
            *rounded_cells((errors_pct[row], prediction_errors_pct[row])),
            cast.status.code,
        )
        rows.append(dict(zip(TRIAL_COLUMNS, values, strict=True)))
    return rows


def rounded_cells(values: Iterable[float]) -> list[float | str]:
    """Round numbers to four decimals (0.1 mm) for a table; an unknown one is an empty cell."""
    # Zero is added so that none is -0.0.
    return [round(float(value), 4) + 0.0 if math.isfinite(value) else "" for value in values]


def save_trials(evaluation: Evaluation, path: pathlib.Path) -> None:
    """Write one line per trial as CSV."""
    write_csv(path, TRIAL_COLUMNS, [tuple(row.values()) for row in trial_rows(evaluation)])


@dataclasses.dataclass(frozen=True, kw_only=True)
class ErrorSplit:
    """Errors of the casts that landed, each as a sum of vectors on the table.

        landing - target = (landing - mean landing of the same cast)     repeatability of the rig
                         + (mean landing - engine's landing)             mismatch of the engine
                         + (engine's landing - model's prediction)       error of the model
                         + (model's prediction - target)                 plan, with coverage gaps

    A model that was fine-tuned on real casts differs from the engine on purpose: its error then
    counteracts the mismatch.

    Attributes:
        parts: Vectors by name, in % of cable length, each of shape [cast, 2].
        total: Landing minus target [% of cable length], shape [cast, 2].
        inside_coverage: Whether the target of each cast lies inside the coverage, shape [cast].
        repeats: Number of casts at each target.
    """

    parts: dict[str, NDArray[np.float64]]
    total: NDArray[np.float64]
    inside_coverage: NDArray[np.bool_]
    repeats: int

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for metrics.json.

        `share_pct` of a part is its share of the mean squared error: the mean of its dot product
        with the whole error. The shares add up to 100; that of a part opposed to the others is
        negative.
        """
        square = float(np.mean(np.sum(self.total**2, axis=1)))
        outside = ~self.inside_coverage
        outside_square = float(np.sum(self.total[outside] ** 2)) / len(self.total)
        parts = {}
        for name, vectors in self.parts.items():
            size = np.linalg.norm(vectors, axis=1)
            share = float(np.mean(np.sum(vectors * self.total, axis=1))) / max(square, 1e-12)
            parts[name] = {
                "median_pct": float(np.median(size)),
                "rms_pct": float(np.sqrt(np.mean(size**2))),
                "share_pct": 100.0 * share,
            }
        return {
            "cast_count": len(self.total),
            "repeats": self.repeats,
            "rms_pct": float(np.sqrt(square)),
            "parts": parts,
            "outside_coverage": {
                "cast_count": int(outside.sum()),
                "share_pct": 100.0 * outside_square / max(square, 1e-12),
            },
        }


def split_errors(evaluation: Evaluation, engine_rig: Rig) -> ErrorSplit | None:
    """Split the errors of casts that a model planned; None if none came to rest on the table.

    The rig is the engine that the model was trained on; it is not closed. With one cast per target,
    repeatability cannot be separated from mismatch and is zero.

    Raises:
        InputError: A cast was not planned by a model.
    """
    if not all(isinstance(motion.action, Action) for motion in evaluation.motions):
        raise InputError("only casts that a model planned can be split")
    targets, first = np.unique(evaluation.target_index, return_index=True)
    simulated = run_trials(engine_rig, [evaluation.motions[row] for row in first])
    # A simulated cast that leaves the table still has an end.
    ends = (LANDING.outcome(track.endpoint_xy) for track in simulated)
    engine_xy = dict(zip(targets.tolist(), ends, strict=True))

    landed = np.array(
        [
            cast.status is TrialStatus.OK and np.all(np.isfinite(engine_xy[target]))
            for cast, target in zip(evaluation.casts, evaluation.target_index.tolist(), strict=True)
        ],
        dtype=bool,
    )
    if not landed.any():
        return None
    index = evaluation.target_index[landed]
    xy = evaluation.landed_xy[landed]
    means = {target: xy[index == target].mean(axis=0) for target in set(index.tolist())}
    predicted, target_xy = evaluation.predicted_xy[landed], evaluation.aimed_xy[landed]

    def by_target(values: dict[int, NDArray[np.float64]]) -> NDArray[np.float64]:
        return np.array([values[target] for target in index.tolist()])

    scale = 100.0 / evaluation.cable.length
    parts = {
        "repeatability": xy - by_target(means),
        "mismatch": by_target(means) - by_target(engine_xy),
        "model": by_target(engine_xy) - predicted,
        "plan": predicted - target_xy,
    }
    return ErrorSplit(
        parts={name: scale * vectors for name, vectors in parts.items()},
        total=scale * (xy - target_xy),
        inside_coverage=evaluation.inside_coverage[index],
        repeats=1 + int(evaluation.repeat.max()),
    )
