import math

import numpy as np
import pytest

from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.errors import DatasetError, InputError, RigError, TargetError
from cablecast.evaluation.evaluate import evaluate_policy
from cablecast.rigs.checked import RETRY_STRIDE

CLOSE = 1e-9  # Double precision on values of order 1 to 100.
TARGETS = np.array([[0.4, 0.9], [-0.4, 0.9], [0.0, 0.8]])


class ChanceRig:
    """Lands where the number of the trial says; breaks down at one of them."""

    def __init__(self, fails_at=None, aborts=()):
        self.description = {"rig": "chance"}
        self.index = 0
        self.made = []
        self.fails_at = fails_at
        self.aborts = list(aborts)

    def seek(self, index, purpose=""):
        assert purpose == ""
        # Its luck is that of the cast, whatever the attempt.
        self.index = index % RETRY_STRIDE

    def reset(self):
        pass

    def execute(self, trajectory):
        if self.index == self.fails_at:
            raise RigError("the protective stop was hit")
        rng = np.random.default_rng([3, self.index])
        status = TrialStatus.OK
        if self.index in self.aborts:
            self.aborts.remove(self.index)
            status = TrialStatus.ABORTED
        self.made.append(self.index)
        self.index += 1
        return EndpointTrack(
            times=np.array([0.5, trajectory.duration + 1.0]),
            endpoint_xy=rng.uniform(0.2, 0.4, size=(2, 2)),
            status=status,
            nodes=rng.normal(size=(2, 5, 3)),
        )

    def close(self):
        pass


class ManyRig(ChanceRig):
    """The same, many at once."""

    def execute_many(self, trajectories, progress=None):
        return [self.execute(trajectory) for trajectory in trajectories]


@pytest.fixture
def evaluate(policy, tmp_path):
    def run(rig, targets=TARGETS, *, folder="casts", **options):
        return evaluate_policy(tmp_path / folder, policy, rig, targets, **options)

    return run


def test_errors_compare_landings_with_the_targets_that_were_asked_for(evaluate, make_rig_stub):
    landings = TARGETS + [[0.0, 0.062], [0.0, 0.0], [0.031, 0.0]]
    evaluation = evaluate(make_rig_stub(landings))
    np.testing.assert_allclose(evaluation.errors_pct, [10.0, 0.0, 5.0], atol=CLOSE)
    np.testing.assert_allclose(evaluation.planned_errors_pct, 100 * 0.01 / 0.62, atol=CLOSE)
    assert evaluation.summary.median_pct == pytest.approx(5.0)
    # The row of the coverage holds covered targets only.
    assert evaluation.inside_coverage.tolist() == [True, False, False]
    assert evaluation.summary_inside_coverage.count == 1


def test_casts_without_a_landing_are_counted_and_left_out_of_the_errors(evaluate, make_rig_stub):
    landings = [TARGETS[0], TARGETS[1], [np.nan, np.nan]]
    rig = make_rig_stub(landings, [TrialStatus.OK, TrialStatus.OFF_TABLE, TrialStatus.OCCLUDED])
    evaluation = evaluate(rig)
    assert evaluation.summary.count == 1
    assert evaluation.status_counts[TrialStatus.OFF_TABLE] == 1
    assert evaluation.status_counts[TrialStatus.OCCLUDED] == 1
    assert evaluation.summary_misses_counted.count == 3
    assert evaluation.summary_misses_counted.median_pct == math.inf


def test_every_cast_begins_with_a_reset_and_is_counted(evaluate, make_rig_stub):
    rig, seen = make_rig_stub(np.repeat(TARGETS, 2, axis=0)), []
    progress = lambda state: seen.append((state.done, state.total))  # noqa: E731
    evaluation = evaluate(rig, repeats=2, progress=progress)
    assert rig.calls == ["reset", "execute"] * 6
    assert evaluation.target_index.tolist() == [0, 0, 1, 1, 2, 2]
    assert list(evaluation.repeat) == [0, 1, 0, 1, 0, 1]
    assert seen == [(done, 6) for done in range(7)]


def test_what_cannot_be_evaluated_is_refused_before_the_rig_moves(evaluate, make_rig_stub):
    rig = make_rig_stub(TARGETS)
    with pytest.raises(TargetError, match=r"at most 1\.560"):
        evaluate(rig, targets=[[0.0, 1.0], [0.0, 1.6]])
    with pytest.raises(InputError, match="repeats = 0"):
        evaluate(rig, repeats=0)
    assert rig.calls == []


def test_a_rig_that_returns_no_track_or_claims_ok_without_a_landing_is_named(
    evaluate, make_rig_stub
):
    rig = make_rig_stub(TARGETS)
    rig.execute = lambda trajectory: (0.0, 1.0)
    with pytest.raises(RigError, match="returned tuple"):
        evaluate(rig)
    with pytest.raises(RigError, match="finite"):
        evaluate(make_rig_stub(np.full((9, 2), np.nan)), folder="other")


@pytest.mark.parametrize("kind", [ChanceRig, ManyRig])
def test_an_evaluation_that_broke_off_goes_on_to_the_result_of_one_that_did_not(evaluate, kind):
    whole = evaluate(ChanceRig(), folder="whole", repeats=2)
    with pytest.raises(RigError, match=r"trial 4 failed 3 times.*protective stop.*4 of 6 trials"):
        evaluate(ChanceRig(fails_at=4), repeats=2)
    rig = kind()
    resumed = evaluate(rig, repeats=2)
    assert rig.made == [4, 5]
    np.testing.assert_array_equal(resumed.landed_xy, whole.landed_xy)


def test_only_a_missing_cast_is_made_again(evaluate, tmp_path):
    whole = evaluate(ChanceRig(), repeats=2)
    for number in (1, 3):
        (tmp_path / f"casts/data/chunk-000/file-{number:03d}.parquet").unlink()
    rig = ManyRig()
    again = evaluate(rig, repeats=2)
    assert rig.made == [1, 3]
    np.testing.assert_array_equal(again.landed_xy, whole.landed_xy)


def test_an_aborted_cast_is_made_again_and_never_counted(evaluate):
    rig = ChanceRig(aborts=[1, 1])
    evaluation = evaluate(rig)
    assert rig.made == [0, 1, 1, 1, 2]
    assert evaluation.status_counts[TrialStatus.ABORTED] == 0
    with pytest.raises(RigError, match="reported it as aborted"):
        evaluate(ChanceRig(aborts=[0] * 3), folder="other")


def test_what_the_rig_saw_is_kept_with_the_nodes_of_the_cable(evaluate):
    first = evaluate(ChanceRig())
    again = evaluate(ChanceRig(fails_at=0))
    for made, read in zip(first.casts, again.casts, strict=True):
        assert made.track.nodes.shape == (2, 5, 3)
        np.testing.assert_array_equal(made.track.nodes, read.track.nodes)
        np.testing.assert_array_equal(made.track.endpoint_xy, read.track.endpoint_xy)


def test_casts_of_another_plan_or_rig_are_refused(evaluate, policy):
    evaluate(ChanceRig())
    with pytest.raises(DatasetError, match="targets is"):
        evaluate(ChanceRig(), targets=TARGETS + 0.01)
    rig = ChanceRig()
    rig.description = {"rig": "another"}
    with pytest.raises(DatasetError, match=r"rig\.rig is 'chance' there and 'another' here"):
        evaluate(rig)
    policy.info = {"name": "another"}
    with pytest.raises(DatasetError, match=r"policy\.name is 'stub' there and 'another' here"):
        evaluate(ChanceRig())
