import dataclasses
import itertools

import numpy as np
import pytest
from tests.learning.synthetic_casts import CABLE, SETUP, linear_model

from cablecast.conventions import mirror_xy
from cablecast.errors import InputError
from cablecast.learning.policy import COVERAGE_PCT, TIE_PCT, ForwardSearchPolicy
from cablecast.motion.action import ActionRanges, grid_actions, mirror_actions
from cablecast.motion.feasibility import check_actions

# The model's weights are in single precision; its landings are of the order of 1 m.
SINGLE = 1e-6


def narrow_model(**changes):
    """Return the linear model on a table that the cable leaves beyond a wrist turn of 57 degrees.

    The swing of the cable keeps 1 m - wrist * 1 m/rad within the table.
    """
    axes = [np.linspace(*ends, 7) for ends in ((-1.4, -0.1), (0.1, 1.4), (0.35, 0.8), (0.0, 1.6))]
    features = np.array(list(itertools.product(*axes, [0.0])), dtype=np.float32)
    return linear_model(margin_features=features, margins=1.0 - features[:, 3], **changes)


@pytest.fixture(scope="module")
def policy():
    actions = grid_actions(ActionRanges(), (3, 60, 30, 5))
    return ForwardSearchPolicy.from_candidates(actions, narrow_model())


def some_targets(count, seed=0):
    return np.random.default_rng(seed).uniform([-0.8, 1.0], [0.8, 1.3], (count, 2))


def test_the_plan_lands_on_the_target_in_the_model_that_made_it(policy):
    targets = some_targets(200)
    plan = policy.plan(targets)
    # The grid of landings is finer than 3 cm, so no target lies farther from one.
    assert np.max(np.linalg.norm(plan.predicted_xy - targets, axis=1)) < 0.02
    # The model speaks of actions that end on the right; the others are mirror images.
    right = plan.actions[:, 1] > 0
    assert np.any(right)
    assert np.any(~right)
    np.testing.assert_allclose(
        narrow_model().predict(plan.actions[right]), plan.predicted_xy[right], atol=SINGLE
    )


def test_no_candidate_lands_nearer_than_the_plan_by_more_than_the_tie(policy):
    targets = np.abs(some_targets(100, seed=1))
    plan = policy.plan(targets)
    every = np.linalg.norm(targets[:, None] - policy.predicted_xy, axis=2)
    chosen = np.linalg.norm(plan.predicted_xy - targets, axis=1)
    assert np.all(chosen <= every.min(axis=1) + TIE_PCT / 100 * CABLE.length + 1e-12)


def test_mirrored_targets_get_mirrored_plans(policy):
    targets = some_targets(100, seed=2)
    plan, mirrored = policy.plan(targets), policy.plan(mirror_xy(targets))
    np.testing.assert_array_equal(mirrored.actions, mirror_actions(plan.actions))
    np.testing.assert_array_equal(mirrored.predicted_xy, mirror_xy(plan.predicted_xy))
    np.testing.assert_array_equal(mirrored.inside_coverage, plan.inside_coverage)


def test_a_candidate_that_lands_on_the_left_serves_as_its_mirror_image(policy):
    assert np.all(policy.predicted_xy[:, 0] >= 0)
    # theta2 = 5 deg lands at 0.9 * 0.087 - 0.2 = -0.12 m, so its mirror image serves 0.12 m.
    plan = policy.plan([0.12, 1.2])
    assert np.any(policy.actions[:, 1] < 0)
    assert plan.predicted_xy[0, 0] == pytest.approx(0.12, abs=0.01)


def test_among_equally_near_candidates_the_least_sensitive_is_taken():
    # Every action lands on the same spot to within the tie; only the sensitivity tells them apart.
    actions = grid_actions(ActionRanges(), (2, 1, 1, 4))
    policy = ForwardSearchPolicy.from_candidates(actions, narrow_model(slope=0.0))
    steady = len(policy.actions) - 2
    sensitivity = np.where(np.arange(len(policy.actions)) == steady, 0.001, 0.02)
    policy = dataclasses.replace(policy, sensitivity=sensitivity)
    plan = policy.plan(policy.predicted_xy[0])
    np.testing.assert_array_equal(plan.actions[0], policy.actions[steady])
    assert plan.sensitivity[0] == 0.001


def test_the_sensitivity_is_how_far_the_landing_moves_for_one_degree_and_one_centimetre(policy):
    # theta2 moves x by 0.9 m/rad, and, psi staying, the wrist turn back by as much as theta2.
    degree, wrist = np.radians(1.0), 0.05
    theta2 = np.hypot(0.9, wrist) * degree
    expected = np.sqrt(theta2**2 + (wrist * degree) ** 2 + 0.01**2)
    np.testing.assert_allclose(policy.sensitivity, expected, rtol=1e-3)


def test_candidates_that_leave_the_table_on_their_way_are_left_out(policy):
    wrist = np.degrees(np.abs(policy.actions[:, 3] - policy.actions[:, 1]))
    # The grid has wrist turns of 0, 22.5, 45, 67.5 and 90 degrees.
    assert set(np.round(wrist, 1)) == {0.0, 22.5, 45.0}
    assert np.all(policy.model.predict_margin(policy.actions) >= 0)
    cautious = ForwardSearchPolicy.from_candidates(
        grid_actions(ActionRanges(), (2, 9, 9, 5)),
        narrow_model(),
        table_margin=0.3,
    )
    assert np.all(cautious.model.predict_margin(cautious.actions) >= 0.3)


def test_a_table_that_every_candidate_leaves_is_refused():
    with pytest.raises(InputError, match=r"none of 16 candidates is predicted to keep 1.2 m"):
        ForwardSearchPolicy.from_candidates(
            grid_actions(ActionRanges(), (2, 2, 2, 2)),
            narrow_model(),
            table_margin=1.2,
        )


def test_coverage_ends_a_stated_distance_beyond_the_last_landing(policy):
    far = policy.predicted_xy[np.argmax(policy.predicted_xy[:, 0])]
    step = COVERAGE_PCT / 100 * CABLE.length
    targets = far + np.array([[0.0, 0.0], [0.9 * step, 0.0], [1.1 * step, 0.0]])
    np.testing.assert_array_equal(policy.inside_coverage(targets), [True, True, False])
    np.testing.assert_array_equal(policy.inside_coverage(mirror_xy(targets)), [True, True, False])
    np.testing.assert_array_equal(policy.plan(targets).inside_coverage, [True, True, False])


def test_candidates_are_feasible_and_the_same_for_the_same_seed():
    model = narrow_model()
    built = [ForwardSearchPolicy.build(model, 300, seed) for seed in (0, 0, 1)]
    np.testing.assert_array_equal(built[0].actions, built[1].actions)
    assert not np.array_equal(built[0].actions, built[2].actions)
    assert np.all(check_actions(built[0].actions, SETUP).mask)
    assert built[0].info["candidate_count"] == 300
    assert built[0].info["model_fingerprint"] == model.fingerprint


def test_the_set_up_of_a_policy_is_that_of_its_model(policy):
    slow = SETUP.with_motion(v_max=1.2)
    model = narrow_model(setup=slow)
    assert ForwardSearchPolicy.build(model, 50).plan([0.2, 1.1]).setup == slow
    assert policy.setup == SETUP


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"candidate_count": 0}, "count = 0"),
        ({"seed": -1}, "seed = -1"),
        ({"table_margin": float("nan")}, "table_margin = nan"),
    ],
    ids=str,
)
def test_settings_out_of_bounds_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        ForwardSearchPolicy.build(narrow_model(), **{"candidate_count": 50} | options)


def test_equation_1_takes_the_nearest_of_all_candidates_and_changes_nothing():
    model = narrow_model()
    policy = ForwardSearchPolicy.build(model, 300, table_margin=0.05)
    paper = policy.by("paper")
    assert len(paper.actions) == 300 > len(policy.actions)
    target = np.array([0.35, 1.1])
    for side in (1.0, -1.0):
        plan = paper.plan(target * [side, 1.0])
        away = np.linalg.norm(model.predict(paper.actions) - target, axis=1)
        # Several candidates of this model may be equally near.
        is_one = np.all(paper.actions == mirror_actions(plan.actions, side), axis=1)
        assert np.any(is_one & (away < away.min() + 1e-12))
        assert plan.miss_pct[0] == pytest.approx(100.0 * away.min() / paper.setup.cable.length)
    assert paper.by("paper") is paper
    assert policy.by("refined") is policy
    assert paper.info["name"] == "equation 1"


def test_an_unknown_method_and_candidates_that_nobody_drew_are_refused(policy):
    with pytest.raises(InputError, match="must be refined or paper"):
        policy.by("best")
    with pytest.raises(InputError, match="has drawn"):
        policy.by("paper")
