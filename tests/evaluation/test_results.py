import csv
import json

import numpy as np
import pytest

from cablecast.cast import TrialStatus
from cablecast.evaluation.evaluate import (
    TRIAL_COLUMNS,
    evaluate_policy,
    evaluation_metrics,
    save_trials,
)

TARGETS = np.array([[0.4, 0.9], [-0.4, 0.9]])
TENTH_OF_A_MILLIMETRE = 1e-4  # What the CSV rounds to.


@pytest.fixture
def evaluation(policy, make_rig_stub, tmp_path):
    rig = make_rig_stub(
        TARGETS + [[0.0, 0.062], [0.0, 0.0]], [TrialStatus.OK, TrialStatus.OFF_TABLE]
    )
    return evaluate_policy(tmp_path / "casts", policy, rig, TARGETS)


def test_metrics_hold_every_count_and_are_strict_json(evaluation):
    metrics = json.loads(json.dumps(evaluation_metrics(evaluation), allow_nan=False))
    assert metrics["status_counts"] == {"ok": 1, "off_table": 1}
    assert metrics["trial_count"] == metrics["target_count"] == 2
    assert metrics["targets_inside_coverage"] == 1
    assert metrics["errors_pct"]["median_pct"] == pytest.approx(10.0)
    assert metrics["errors_misses_counted_pct"]["max_pct"] is None


def test_the_table_of_trials_has_one_row_per_cast(evaluation, tmp_path):
    save_trials(evaluation, tmp_path / "trials.csv")
    with open(tmp_path / "trials.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == TRIAL_COLUMNS
    assert [row["status"] for row in rows] == ["ok", "off_table"]
    assert float(rows[0]["landed_y_m"]) == pytest.approx(0.962, abs=TENTH_OF_A_MILLIMETRE)
    assert [row["motion"] for row in rows] == ["sweep", "sweep"]
    assert rows[0]["polar_azimuth_deg"] == ""
    assert float(rows[0]["theta1_deg"]) == pytest.approx(np.degrees(-0.6), abs=1e-3)
    assert float(rows[0]["target_theta_deg"]) > 0 > float(rows[1]["target_theta_deg"])
    # An unknown landing is an empty cell.
    assert rows[1]["landed_x_m"] == rows[1]["error_pct"] == ""
    assert rows[1]["predicted_x_m"] != ""
