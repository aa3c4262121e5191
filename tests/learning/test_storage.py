"""The policy on the disk: what is written is read back, and nothing else is believed."""

import dataclasses
import json

import numpy as np
import pytest
from tests.learning.synthetic_casts import SETUP, linear_model
from tests.robot import ROBOT

from cablecast.errors import CheckpointError, InputError
from cablecast.learning.policy import FORMAT, FORMAT_VERSION, ForwardSearchPolicy
from cablecast.motion.action import ActionRanges, grid_actions
from cablecast.setup import Setup

CORRUPTION_COUNT = 100
TARGETS = [[0.3, 1.1], [-0.2, 1.2], [0.0, 0.9]]


def some_policy(**options):
    actions = grid_actions(ActionRanges(), (2, 9, 9, 2))
    return ForwardSearchPolicy.from_candidates(actions, linear_model(**options))


@pytest.fixture(scope="module")
def policy():
    return some_policy()


@pytest.fixture
def file(policy, tmp_path):
    policy.save(tmp_path)
    return tmp_path / "policy.npz"


def rewrite(file, **changes):
    """Write the file again with other keys of its description; None removes one."""
    with np.load(file) as stored:
        arrays = dict(stored)
    meta = json.loads(str(arrays["meta"])) | changes
    meta = {key: value for key, value in meta.items() if value is not None}
    np.savez(file, **arrays | {"meta": np.array(json.dumps(meta))})


def refusal(folder):
    with pytest.raises(CheckpointError) as caught:
        ForwardSearchPolicy.load(folder)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_a_saved_policy_is_loaded_with_the_same_plans_and_the_same_set_up(tmp_path):
    setup = Setup(cable="cable_2").with_motion(v_max=1.2)
    policy = some_policy(setup=setup)
    policy.save(tmp_path)
    loaded = ForwardSearchPolicy.load(tmp_path)
    plan, again = policy.plan(TARGETS), loaded.plan(TARGETS)
    np.testing.assert_array_equal(again.actions, plan.actions)
    np.testing.assert_array_equal(again.predicted_xy, plan.predicted_xy)
    assert loaded.setup == setup
    assert loaded.info == policy.info
    assert not list(tmp_path.glob(".*"))


def test_the_set_up_is_stored_once_and_nothing_is_pickled(policy, file):
    with np.load(file, allow_pickle=False) as stored:
        assert set(stored) == {"meta", "actions", "predicted_xy", "sensitivity"}
        meta = json.loads(str(stored["meta"]))
    assert meta["setup"] == SETUP.to_settings()
    assert set(meta) == {"format", "format_version", "setup", "info"}


def test_a_policy_of_equation_1_does_not_take_the_place_of_the_one_it_was_made_of(policy, file):
    seeded = dataclasses.replace(policy, info=policy.info | {"seed": 0})
    with pytest.raises(InputError, match="sensitivity is not finite"):
        seeded.by("paper").save(file.parent)
    assert len(ForwardSearchPolicy.load(file.parent).actions) == len(policy.actions)


def test_a_policy_in_a_robots_box_is_saved_too(policy, tmp_path):
    there = policy.in_lab(dataclasses.replace(SETUP, robot=ROBOT))
    there.save(tmp_path)
    again = ForwardSearchPolicy.load(tmp_path)
    assert again.setup.robot is None
    assert again.info["kept_count"] == len(again.actions) == len(there.actions)


def test_a_missing_policy_is_named(file):
    file.unlink()
    assert f"there is no policy at {file}" in refusal(file.parent)


@pytest.mark.parametrize("kept", [0, 10, 500, 5000, -1])
def test_a_truncated_policy_is_named(file, kept):
    file.write_bytes(file.read_bytes()[:kept])
    assert f"{file} is damaged or not a policy" in refusal(file.parent)


def test_flipped_bytes_are_found_or_change_nothing(policy, file):
    rng = np.random.default_rng(0)
    content = file.read_bytes()
    expected = policy.plan(TARGETS)
    refused = 0
    for _ in range(CORRUPTION_COUNT):
        spoilt = bytearray(content)
        for place in rng.integers(len(content), size=rng.integers(1, 4)):
            spoilt[place] ^= int(rng.integers(1, 256))
        file.write_bytes(spoilt)
        try:
            plan = ForwardSearchPolicy.load(file.parent).plan(TARGETS)
        except CheckpointError:
            refused += 1
        else:
            # Times and attributes of the archive's members carry nothing.
            np.testing.assert_array_equal(plan.actions, expected.actions)
    assert refused > 0.8 * CORRUPTION_COUNT


def test_a_pickled_archive_is_refused(file):
    np.savez(file, meta=np.array([{"format": "cablecast.forward_search"}]))
    assert "not a policy" in refusal(file.parent)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"format": "other"}, f"holds other of version {FORMAT_VERSION}"),
        ({"format_version": 2}, f"of version 2: it must be {FORMAT} of version {FORMAT_VERSION}"),
        ({"format_version": [1, "\n"]}, "it must be"),
        ({"setup": {"cable": "cable_1", "motion": {"warp_factor": 9}}}, "warp_factor"),
        ({"setup": None}, "setup"),
        ({"setup": []}, "does not match this version"),
        ({"info": []}, "info must be a mapping"),
    ],
    ids=str,
)
def test_a_policy_of_another_kind_or_version_is_refused(file, changes, words):
    rewrite(file, **changes)
    text = refusal(file.parent)
    assert words in text
    assert "train again" in text


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("actions", lambda a: a[:, :3]),
        ("actions", lambda a: a[:0]),
        ("predicted_xy", lambda a: a[:-1]),
        ("predicted_xy", lambda a: a + np.nan),
        ("predicted_xy", lambda a: a.astype(np.float32)),
        ("sensitivity", lambda a: a[0]),
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(file, name, spoil):
    with np.load(file) as stored:
        arrays = dict(stored)
    np.savez(file, **arrays | {name: spoil(arrays[name])})
    assert "does not match this version" in refusal(file.parent)


@pytest.mark.parametrize(
    "other",
    [linear_model(endpoint_scale=2.0), linear_model(setup=Setup(cable="cable_2"))],
    ids=["arrays", "setup"],
)
def test_a_policy_beside_a_model_that_it_was_not_built_with_is_refused(file, other):
    other.save(file.parent)
    assert "built with another model" in refusal(file.parent)


def test_a_model_with_a_policy_built_from_other_info_is_the_same_model(policy, file):
    # The learning curve and the like may be described otherwise; what it predicts is what counts.
    info = policy.model.info | {"metrics": {"held_out_median_pct": 1.0}}
    dataclasses.replace(policy.model, info=info).save(file.parent)
    plan = ForwardSearchPolicy.load(file.parent).plan(TARGETS)
    np.testing.assert_array_equal(plan.actions, policy.plan(TARGETS).actions)
