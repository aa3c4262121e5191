import math

import numpy as np
import pytest

from cablecast.cable import load_cable
from cablecast.errors import InputError, RigError, TargetError
from cablecast.evaluation.evaluate import evaluate_policy
from cablecast.motion.action import MotionConfig
from cablecast.track import TrialStatus
from cablecast.workspace import Workspace

CLOSE = 1e-9  # Double precision on values of order 1 to 100.
TARGETS = np.array([[0.4, 0.9], [-0.4, 0.9], [0.0, 0.8]])
CABLE = load_cable("cable_1")


def evaluate(policy, rig, targets=TARGETS, **options):
    return evaluate_policy(policy, rig, targets, CABLE, MotionConfig(), Workspace(), **options)


def test_errors_compare_landings_with_the_targets_that_were_asked_for(policy, make_rig_stub):
    landings = TARGETS + [[0.0, 0.062], [0.0, 0.0], [0.031, 0.0]]
    evaluation = evaluate(policy, make_rig_stub(landings))
    np.testing.assert_allclose(evaluation.errors_pct, [10.0, 0.0, 5.0], atol=CLOSE)
    np.testing.assert_allclose(evaluation.planned_errors_pct, 100 * 0.01 / 0.62, atol=CLOSE)
    assert evaluation.summary.median_pct == pytest.approx(5.0)


def test_casts_without_a_landing_are_counted_and_left_out_of_the_errors(policy, make_rig_stub):
    rig = make_rig_stub(TARGETS, [TrialStatus.OK, TrialStatus.OFF_TABLE, TrialStatus.OCCLUDED])
    evaluation = evaluate(policy, rig)
    assert evaluation.summary.count == 1
    assert evaluation.status_counts[TrialStatus.OFF_TABLE] == 1
    assert evaluation.status_counts[TrialStatus.OCCLUDED] == 1
    assert evaluation.summary_misses_counted.count == 3
    assert evaluation.summary_misses_counted.median_pct == math.inf


def test_the_coverage_row_holds_only_covered_targets(policy, make_rig_stub):
    evaluation = evaluate(policy, make_rig_stub(TARGETS + [[0.062, 0.0]] * 3))
    assert evaluation.inside_coverage.tolist() == [True, False, False]
    assert evaluation.summary_inside_coverage.count == 1


def test_every_cast_begins_with_a_reset(policy, make_rig_stub):
    rig = make_rig_stub(np.repeat(TARGETS, 2, axis=0))
    evaluation = evaluate(policy, rig, repeats=2)
    assert rig.calls == ["reset", "execute"] * 6
    assert [(trial.target_index, trial.repeat) for trial in evaluation.trials] == [
        (0, 0),
        (0, 1),
        (1, 0),
        (1, 1),
        (2, 0),
        (2, 1),
    ]


def test_progress_counts_up_to_all_casts(policy, make_rig_stub):
    seen = []
    evaluate(
        policy, make_rig_stub(TARGETS), progress=lambda done, total: seen.append((done, total))
    )
    assert seen == [(0, 3), (1, 3), (2, 3), (3, 3)]


def test_a_target_out_of_reach_is_refused_before_the_rig_moves(policy, make_rig_stub):
    rig = make_rig_stub(TARGETS)
    with pytest.raises(TargetError, match=r"at most 1\.560"):
        evaluate(policy, rig, targets=[[0.0, 1.0], [0.0, 1.6]])
    assert rig.calls == []


def test_less_than_one_repeat_is_refused(policy, make_rig_stub):
    with pytest.raises(InputError, match="repeats = 0"):
        evaluate(policy, make_rig_stub(TARGETS), repeats=0)


def test_a_rig_that_returns_no_track_is_named(policy, make_rig_stub):
    rig = make_rig_stub(TARGETS)
    rig.execute = lambda trajectory: (0.0, 1.0)
    with pytest.raises(RigError, match="tuple"):
        evaluate(policy, rig)


def test_a_rig_that_claims_ok_without_a_landing_is_refused(policy, make_rig_stub):
    with pytest.raises(RigError, match="finite"):
        evaluate(policy, make_rig_stub(np.full((3, 2), np.nan)))
