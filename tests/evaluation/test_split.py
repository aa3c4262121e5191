import dataclasses
import json

import numpy as np
import pytest

from cablecast.cast import Cast, EndpointTrack, TrialStatus
from cablecast.errors import InputError
from cablecast.evaluation.evaluate import Evaluation, split_errors
from cablecast.motion.casting import Action
from cablecast.motion.trajectory import plan_trajectory
from cablecast.report.tables import SPLIT_PARTS
from cablecast.setup import Setup

SETUP = Setup()
CABLE = SETUP.cable
CLOSE = 1e-9  # Sums and differences of doubles of order 100.
TARGETS = np.array([[0.4, 0.9], [-0.4, 0.8], [0.1, 0.7]])
RIGHT = np.array([-0.6, 0.5, 0.55, 0.8])
"""An action for the right half of the table; its mirror image is for the left."""
LEFT = np.array([0.6, -0.5, 0.55, -0.8])
REPEATS = 4


def track(xy, status=TrialStatus.OK):
    return EndpointTrack(
        times=np.array([0.0, 0.1]), endpoint_xy=np.array([[0.0, 1.2], xy]), status=status
    )


@dataclasses.dataclass
class EnginePlaysTargets:
    """An engine in which the n-th motion ends at the n-th place."""

    places: np.ndarray
    description: dict = dataclasses.field(default_factory=dict)
    count: int = 0

    def reset(self):
        pass

    def execute(self, trajectory):
        self.count += 1
        # A simulated table has no edge: whatever the status, the landing counts.
        return track(self.places[self.count - 1], TrialStatus.OFF_TABLE)

    def close(self):
        pass


@pytest.fixture(scope="module")
def trajectories():
    return [plan_trajectory(Action.from_array(row), SETUP) for row in (RIGHT, LEFT, RIGHT)]


def evaluation_of(trajectories, landed, predicted, status=None, repeats=REPEATS):
    """Casts that landed at `landed`, shape [target, repeat, 2]."""
    index = np.repeat(np.arange(len(TARGETS)), repeats)
    motions = tuple(trajectories[target] for target in index)
    tracks = [
        track(landed[target, repeat], (status or {}).get(target, TrialStatus.OK))
        for target in range(len(TARGETS))
        for repeat in range(repeats)
    ]
    return Evaluation(
        setup=SETUP,
        rig={},
        target_xy=TARGETS,
        inside_coverage=np.array([True, True, False]),
        casts=tuple(Cast.of_motion(m, t, "evaluate") for m, t in zip(motions, tracks, strict=True)),
        motions=motions,
        target_index=index,
        predicted_xy=np.asarray(predicted)[index],
    )


def planted(trajectories, **errors):
    """Return the split of an evaluation in which each step of the way is off by what is given [m].

    Each is of shape [target, 2], the repeatability of shape [target, repeat, 2].
    """
    zero = np.zeros((len(TARGETS), 2))
    scatter = errors.get("repeatability", np.zeros((len(TARGETS), REPEATS, 2)))
    predicted = TARGETS + errors.get("plan", zero)
    engine = predicted + errors.get("model", zero)
    means = engine + errors.get("mismatch", zero)
    landed = means[:, None] + scatter
    evaluation = evaluation_of(trajectories, landed, predicted)
    split = split_errors(evaluation, EnginePlaysTargets(engine))
    assert split is not None
    return evaluation, split


def test_the_parts_add_up_to_the_way_from_target_to_landing(trajectories):
    rng = np.random.default_rng(5)
    shape = (len(TARGETS), 2)
    evaluation, split = planted(
        trajectories,
        repeatability=rng.normal(scale=0.03, size=(len(TARGETS), REPEATS, 2)),
        mismatch=rng.normal(scale=0.1, size=shape),
        model=rng.normal(scale=0.02, size=shape),
        plan=rng.normal(scale=0.05, size=shape),
    )
    assert tuple(split.parts) == tuple(SPLIT_PARTS)
    np.testing.assert_allclose(sum(split.parts.values()), split.total, atol=CLOSE)
    sizes = np.linalg.norm(split.total, axis=1)
    np.testing.assert_allclose(sizes, evaluation.errors_pct, atol=CLOSE)
    shares = [split.to_dict()["parts"][name]["share_pct"] for name in SPLIT_PARTS]
    assert sum(shares) == pytest.approx(100.0)


@pytest.mark.parametrize("name", ["mismatch", "model", "plan"])
def test_a_planted_error_is_found_in_its_part_and_in_no_other(trajectories, name):
    error = np.array([[0.062, 0.0], [0.0, -0.031], [0.031, 0.031]])
    _, split = planted(trajectories, **{name: error})
    _, without = planted(trajectories)
    for part in SPLIT_PARTS:
        found = split.parts[part] - without.parts[part]
        expected = (part == name) * np.repeat(error, REPEATS, axis=0) * 100 / CABLE.length
        np.testing.assert_allclose(found, expected, atol=CLOSE)


def test_scatter_about_the_mean_landing_is_repeatability_and_its_mean_is_mismatch(trajectories):
    scatter = np.zeros((len(TARGETS), REPEATS, 2))
    scatter[:, :, 0] = [0.01, 0.03, 0.05, 0.07]
    _, split = planted(trajectories, repeatability=scatter)
    _, without = planted(trajectories)
    moved = split.parts["mismatch"] - without.parts["mismatch"]
    np.testing.assert_allclose(moved, np.tile([4.0 / 0.62, 0.0], (len(moved), 1)), atol=CLOSE)
    left = split.parts["repeatability"][:REPEATS, 0]
    np.testing.assert_allclose(left, np.array([-3.0, -1.0, 1.0, 3.0]) / 0.62, atol=CLOSE)


def test_casts_that_did_not_land_are_left_out(trajectories):
    landed = np.repeat(TARGETS[:, None], REPEATS, axis=1) + 0.02
    evaluation = evaluation_of(trajectories, landed, TARGETS, {1: TrialStatus.OFF_TABLE})
    split = split_errors(evaluation, EnginePlaysTargets(TARGETS))
    assert split is not None
    assert split.to_dict()["cast_count"] == 2 * REPEATS
    nowhere = dict.fromkeys(range(3), TrialStatus.OCCLUDED)
    evaluation = evaluation_of(trajectories, landed, TARGETS, nowhere)
    assert split_errors(evaluation, EnginePlaysTargets(TARGETS)) is None


def test_the_share_outside_the_coverage_is_that_of_its_squared_errors(trajectories):
    offsets = np.array([[0.03, 0.0], [0.03, 0.0], [0.06, 0.0]])
    landed = np.repeat((TARGETS + offsets)[:, None], REPEATS, axis=1)
    evaluation = evaluation_of(trajectories, landed, TARGETS)
    split = split_errors(evaluation, EnginePlaysTargets(TARGETS))
    assert split is not None
    values = split.to_dict()
    assert values["outside_coverage"]["cast_count"] == REPEATS
    assert values["outside_coverage"]["share_pct"] == pytest.approx(100 * 4 / 6)
    json.dumps(values, allow_nan=False)


def test_one_cast_at_each_target_leaves_no_repeatability(trajectories):
    landed = (TARGETS + 0.05)[:, None]
    evaluation = evaluation_of(trajectories, landed, TARGETS, repeats=1)
    split = split_errors(evaluation, EnginePlaysTargets(TARGETS))
    assert split is not None
    assert split.repeats == 1
    np.testing.assert_allclose(split.parts["repeatability"], 0.0, atol=CLOSE)


def test_casts_that_no_model_planned_are_refused(trajectories):
    landed = np.repeat(TARGETS[:, None], REPEATS, axis=1)
    evaluation = evaluation_of(trajectories, landed, TARGETS)
    motion = dataclasses.replace(trajectories[0], action=None)
    evaluation = dataclasses.replace(evaluation, motions=(motion,) * len(evaluation.casts))
    with pytest.raises(InputError, match="a model planned"):
        split_errors(evaluation, EnginePlaysTargets(TARGETS))
