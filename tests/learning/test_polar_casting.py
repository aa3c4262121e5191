"""The polar casting policy: one whole motion per target, planned by geometry alone."""

import dataclasses
import json
import pathlib

import numpy as np
import pytest

from cablecast.arm.ur import ArmUR
from cablecast.cable import load_cable
from cablecast.cast import TrialStatus
from cablecast.engines.warp_ import EngineWarp
from cablecast.evaluation.evaluate import evaluate_policy, trial_rows
from cablecast.learning.policy import PolarCastingPolicy
from cablecast.motion.polar import PolarCast, PolarCastConfig
from cablecast.rigs.engine import RigEngine
from cablecast.setup import Setup
from cablecast.workspace import Workspace, load_targets

ROOT = pathlib.Path(__file__).parents[2]
# Cable 2 has hardly an attachment, which the engine does not know.
SETUP = Setup(cable="cable_2")
CABLE = SETUP.cable
POLICY = PolarCastingPolicy(setup=SETUP)

ASTRAY_PCT = 12.0
"""How far a simulated endpoint may lie from where the policy puts it [% of cable length]; see
tests/motion/test_polar_cast.py."""


def test_a_target_within_reach_is_planned_exactly():
    plan = POLICY.plan([[0.2, 1.2]])
    np.testing.assert_allclose(plan.predicted_xy, [[0.2, 1.2]], atol=1e-12)
    assert plan.inside_coverage.tolist() == [True]
    assert np.isnan(plan.actions).all()
    assert len(plan) == len(plan.trajectories) == 1


@pytest.mark.parametrize("length", [0.6, 0.7, 0.85])
def test_the_arm_can_swing_cables_of_one_s_own(length):
    example = load_cable(ROOT / "examples" / "my_cable.yaml")
    setup = Setup(cable=dataclasses.replace(example, length=length))
    targets = load_targets()[::8]
    assert len(PolarCastingPolicy(setup=setup).plan(targets).trajectories) == len(targets)


def test_a_target_beyond_reach_gets_the_nearest_motion():
    targets = load_targets()
    plan = POLICY.plan(targets)
    outside = ~plan.inside_coverage
    assert outside.sum() > 20, "most of the paper's targets lie nearer than polar casting reaches"
    ends = np.array([t.grip_path.evaluate(t.grip_path.duration)[0, 0] for t in plan.trajectories])
    endpoint = ends[:, :2] + CABLE.length * np.stack([np.sin(ends[:, 3]), np.cos(ends[:, 3])], 1)
    np.testing.assert_allclose(endpoint, plan.predicted_xy, atol=1e-6)
    np.testing.assert_allclose(plan.predicted_xy, POLICY.reach.nearest(targets), atol=1e-12)


def test_motions_for_mirrored_targets_are_mirrored():
    plan = POLICY.plan([[0.4, 1.1], [-0.4, 1.1]])
    right, left = (t.grip_path for t in plan.trajectories)
    np.testing.assert_allclose(right.mirrored().coefficients, left.coefficients, atol=1e-12)


def test_a_polar_cast_back_along_its_azimuth_describes_the_motion():
    cast = PolarCast.back_to([0.0, 1.3], POLICY.reach)
    assert POLICY.plan([0.0, 1.3]).trajectories[0].action == cast


def test_a_run_keeps_the_settings_of_its_motions():
    info = json.loads(json.dumps(POLICY.info, allow_nan=False))
    assert info["settle_time"] == PolarCastConfig().settle_time


def test_an_evaluation_plays_it_and_leaves_the_cells_of_the_action_empty(tmp_path):
    rig = RigEngine(EngineWarp(segment_count=30, dt=1e-3), SETUP)
    targets = [[0.3, 1.15], [0.6, 1.043], [0.0, 0.8]]
    evaluation = evaluate_policy(tmp_path / "casts", POLICY, rig, targets)
    assert all(trial.status is TrialStatus.OK for trial in evaluation.casts)
    assert np.max(evaluation.prediction_errors_pct) < ASTRAY_PCT
    # The third target is nearer than the cable can be pulled.
    short = (SETUP.workspace.support_depth + CABLE.length - 0.8) / CABLE.length * 100
    assert evaluation.planned_errors_pct[2] == pytest.approx(short, abs=1e-3)
    row = trial_rows(evaluation)[0]
    assert (row["theta1_deg"], row["psi_deg"]) == ("", "")
    assert row["duration_s"] == pytest.approx(evaluation.motions[0].duration, abs=1e-4)


def test_a_longer_arm_casts_at_the_radii_of_its_reach():
    setup = Setup(arm=ArmUR(model="ur10e"), workspace=Workspace(r_max=1.3))
    assert PolarCastingPolicy(setup=setup).info["cast_radius"] == pytest.approx(0.88 * 1.3 / 0.94)
