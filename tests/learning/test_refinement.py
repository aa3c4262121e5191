import numpy as np
from tests.learning.synthetic_casts import SETUP, plain_model

from cablecast.conventions import mirror_xy
from cablecast.learning.landing import DEVIATION, deviations
from cablecast.learning.policy import ForwardSearchPolicy, refine_actions
from cablecast.motion.action import ActionRanges, grid_actions, mirror_actions
from cablecast.motion.feasibility import check_actions

# Two Newton steps on a gently curved map leave a few micrometres of a step of some centimetres.
NEWTON_TOLERANCE = 1e-4


def curved_model(margin=0.2):
    """Lands near (theta2, 0.3 + r2 + wrist / 4), bent by the SiLU of its one hidden layer."""
    hidden = np.eye(5)[:, 1:4]
    out = [[1.0, 0.0], [0.0, 1.0], [0.0, 0.25]]
    return plain_model((hidden, np.full(3, 3.0)), (out, [-3.0, -3.45]), margins=np.array([margin]))


def some_actions():
    actions = grid_actions(ActionRanges(), (3, 4, 4, 3))
    feasibility = check_actions(actions, SETUP)
    # The rim of the feasible actions is tested apart.
    inner = np.all(feasibility.peaks <= 0.9 * feasibility.bounds, axis=(1, 2))
    return actions[inner & (actions[:, 2] < 0.7) & (actions[:, 3] > actions[:, 1])]


def refine(actions, targets, model=None):
    return refine_actions(
        actions, targets, deviations(actions), model=model or curved_model(), table_margin=0.0
    )


def test_a_refined_action_lands_on_its_target_in_the_model():
    actions, model = some_actions(), curved_model()
    targets = model.predict(actions) + [0.01, -0.012]
    refined, refined_xy = refine(actions, targets)
    np.testing.assert_allclose(refined_xy, targets, atol=NEWTON_TOLERANCE)
    np.testing.assert_allclose(model.predict(refined), refined_xy, atol=1e-6)
    assert np.all(check_actions(refined, SETUP).mask)


def test_an_action_moves_no_farther_than_it_must():
    actions, model = some_actions(), curved_model()
    refined, _ = refine(actions, model.predict(actions) + [0.0, 0.01])
    # theta1 does not matter to this model, and the target lies straight ahead of the landing.
    np.testing.assert_allclose(refined[:, 0], actions[:, 0], atol=1e-9)
    assert np.all(np.abs(refined - actions) <= 2 * 2 * DEVIATION + 1e-9)


def test_refining_is_mirror_symmetric():
    actions = some_actions()
    targets = curved_model().predict(actions) + [0.01, 0.005]
    refined, refined_xy = refine(actions, targets)
    mirrored, mirrored_xy = refine(mirror_actions(actions), mirror_xy(targets))
    np.testing.assert_array_equal(mirrored, mirror_actions(refined))
    np.testing.assert_array_equal(mirrored_xy, mirror_xy(refined_xy))


def test_an_action_that_the_arm_could_not_follow_stays_as_it_was():
    ranges = ActionRanges(r2=(0.8, 0.92))
    actions = grid_actions(ranges, (3, 3, 25, 1))
    actions = actions[check_actions(actions, SETUP).mask]
    targets = curved_model().predict(actions) + [0.0, 0.02]
    refined, refined_xy = refine(actions, targets)
    stayed = np.all(refined == actions, axis=1)
    assert np.any(stayed)
    assert np.all(check_actions(refined, SETUP).mask)
    np.testing.assert_allclose(refined_xy, curved_model().predict(refined), atol=1e-6)


def test_an_action_that_would_leave_the_table_stays_as_it_was():
    actions = some_actions()
    targets = curved_model().predict(actions) + [0.01, 0.0]
    refined, _ = refine(actions, targets, curved_model(margin=-0.1))
    np.testing.assert_array_equal(refined, actions)


def test_an_action_set_without_psi_stays_without():
    actions = grid_actions(ActionRanges(), (3, 4, 4))
    actions = actions[check_actions(actions, SETUP).mask]
    actions = actions[actions[:, 2] < 0.7]
    targets = curved_model().predict(actions) + [0.01, 0.01]
    refined, refined_xy = refine(actions, targets)
    np.testing.assert_allclose(refined[:, 3], refined[:, 1], atol=1e-12)
    np.testing.assert_allclose(refined_xy, targets, atol=NEWTON_TOLERANCE)


def test_a_policy_that_was_built_plans_onto_the_target_as_a_loaded_one_does(tmp_path):
    model = curved_model()
    few = ActionRanges(theta1=(-0.9, -0.8), theta2=(0.6, 0.8), r2=(0.5, 0.6), wrist=(0.2, 0.6))
    built = ForwardSearchPolicy.build(model, 300, ranges=few)
    built.save(tmp_path)
    low, high = [-0.9, 0.65, 0.53, 0.9], [-0.8, 0.75, 0.57, 1.1]
    inner = np.random.default_rng(0).uniform(low, high, (40, 4))
    targets = model.predict(inner)
    targets[::2] = mirror_xy(targets[::2])
    plan, again = built.plan(targets), ForwardSearchPolicy.load(tmp_path).plan(targets)
    np.testing.assert_array_equal(again.actions, plan.actions)
    np.testing.assert_array_equal(again.predicted_xy, plan.predicted_xy)
    folded = np.where(targets[:, :1] < 0, mirror_xy(targets), targets)
    to_nearest = np.linalg.norm(folded[:, None] - built.predicted_xy, axis=2).min(axis=1)
    missed = np.linalg.norm(plan.predicted_xy - targets, axis=1)
    assert np.max(missed) < NEWTON_TOLERANCE < np.median(to_nearest)
