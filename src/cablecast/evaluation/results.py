"""Files of an evaluation: metrics.json for machines, trials.csv for spreadsheets."""

import csv
import io
import math
import pathlib

import numpy as np

from cablecast.conventions import xy_to_polar
from cablecast.evaluation.evaluate import Evaluation
from cablecast.evaluation.metrics import summarise_errors
from cablecast.files import write_text

TRIAL_COLUMNS: tuple[str, ...] = (
    "target",
    "repeat",
    "target_x_m",
    "target_y_m",
    "target_r_m",
    "target_theta_deg",
    "inside_coverage",
    "theta1_deg",
    "theta2_deg",
    "r2_m",
    "psi_deg",
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
        "trial_count": len(evaluation.trials),
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
    for trial, error_pct, prediction_error_pct in zip(
        evaluation.trials,
        evaluation.errors_pct,
        evaluation.prediction_errors_pct,
        strict=True,
    ):
        r, theta = xy_to_polar(trial.target_xy)
        # A motion without an action has empty cells.
        action = np.full(4, np.nan) if trial.action is None else trial.action.to_array()
        theta1, theta2, r2, psi = action
        values = (
            trial.target_index,
            trial.repeat,
            *_rounded(trial.target_xy),
            *_rounded((r, math.degrees(theta))),
            str(trial.inside_coverage).lower(),
            *_rounded((math.degrees(theta1), math.degrees(theta2), r2, math.degrees(psi))),
            *_rounded(trial.trajectory.grip_path.duration),
            *_rounded(trial.predicted_xy),
            *_rounded(trial.landed_xy),
            *_rounded((error_pct, prediction_error_pct)),
            trial.status.code,
        )
        rows.append(dict(zip(TRIAL_COLUMNS, values, strict=True)))
    return rows


def _rounded(values) -> list[float | str]:
    """Round to four decimals (0.1 mm); an unknown value becomes an empty cell."""
    return [round(float(value), 4) if math.isfinite(value) else "" for value in values]


def save_trials(evaluation: Evaluation, path: pathlib.Path) -> None:
    """Write one line per trial as CSV."""
    text = io.StringIO()
    writer = csv.DictWriter(text, TRIAL_COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(trial_rows(evaluation))
    write_text(path, text.getvalue())
