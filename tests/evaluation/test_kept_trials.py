import dataclasses

import numpy as np
import pytest

from cablecast.cable import load_cable
from cablecast.errors import InputError, RigError
from cablecast.evaluation.evaluate import evaluate_policy
from cablecast.evaluation.kept_trials import KeptTrials
from cablecast.motion.action import MotionConfig
from cablecast.motion.joint_path import JointPath
from cablecast.track import EndpointTrack, TrialStatus
from cablecast.workspace import Workspace

TARGETS = np.array([[0.4, 0.9], [-0.4, 0.9], [0.0, 0.8]])
CABLE = load_cable("cable_1")


class ChanceRig:
    """Lands where its seed and the number of the trial say; breaks down after some trials."""

    def __init__(self, fails_at=None):
        self.description = {"rig": "chance"}
        self.index = 0
        self.made = []
        self.fails_at = fails_at

    def seek(self, index):
        self.index = index

    def reset(self):
        pass

    def execute(self, trajectory):
        if self.index == self.fails_at:
            raise RigError("the protective stop was hit")
        rng = np.random.default_rng([3, self.index])
        self.made.append(self.index)
        self.index += 1
        return EndpointTrack(
            times=np.array([0.0, 0.1]),
            endpoint_xy=rng.uniform(0.2, 0.4, size=(2, 2)),
            status=TrialStatus.OK,
        )

    def close(self):
        pass


class ManyRig(ChanceRig):
    """The same, many at once."""

    def execute_many(self, trajectories, progress=None):
        return [self.execute(trajectory) for trajectory in trajectories]


def evaluate(policy, rig, folder=None, **options):
    kept = None if folder is None else KeptTrials(folder)
    return evaluate_policy(
        policy, rig, TARGETS, CABLE, MotionConfig(), Workspace(), repeats=2, kept=kept, **options
    )


@pytest.mark.parametrize("kind", [ChanceRig, ManyRig])
def test_an_evaluation_that_broke_off_goes_on_to_the_result_of_one_that_did_not(
    policy, tmp_path, kind
):
    whole = evaluate(policy, ChanceRig())
    broken = ChanceRig(fails_at=4)
    with pytest.raises(RigError, match="protective stop"):
        evaluate(policy, broken, tmp_path)
    rig = kind()
    resumed = evaluate(policy, rig, tmp_path)
    assert rig.made == [4, 5]
    np.testing.assert_array_equal(resumed.landed_xy, whole.landed_xy)


def test_only_a_missing_cast_is_made_again(policy, tmp_path):
    whole = evaluate(policy, ChanceRig(), tmp_path)
    (tmp_path / "00001.npz").unlink()
    (tmp_path / "00003.npz").unlink()
    rig = ManyRig()
    seen = []
    again = evaluate(policy, rig, tmp_path, progress=lambda done, total: seen.append(done))
    assert rig.made == [1, 3]
    assert seen[:2] == [0, 4]
    np.testing.assert_array_equal(again.landed_xy, whole.landed_xy)


def test_everything_that_a_rig_saw_is_kept(tmp_path):
    rng = np.random.default_rng(0)
    joints = JointPath(times=np.arange(4.0), q=rng.normal(size=(4, 6)), qd=rng.normal(size=(4, 6)))
    track = EndpointTrack(
        times=np.array([0.0, 0.1]),
        endpoint_xy=np.array([[0.1, 0.2], [np.nan, np.nan]]),
        status=TrialStatus.OCCLUDED,
        nodes=rng.normal(size=(2, 5, 3)),
        joint_path=joints,
    )
    kept = KeptTrials(tmp_path)
    kept.save(7, track)
    loaded = kept.load(7)
    assert loaded.status is TrialStatus.OCCLUDED
    for name in ("times", "endpoint_xy", "nodes"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(track, name))
    for field in dataclasses.fields(JointPath):
        np.testing.assert_array_equal(
            getattr(loaded.joint_path, field.name), getattr(joints, field.name)
        )


def test_a_damaged_file_is_named(tmp_path):
    kept = KeptTrials(tmp_path)
    track = EndpointTrack(
        times=np.array([0.0]), endpoint_xy=np.zeros((1, 2)), status=TrialStatus.OK
    )
    kept.save(0, track)
    file = tmp_path / "00000.npz"
    file.write_bytes(file.read_bytes()[:-30])
    with pytest.raises(InputError, match=r"00000\.npz is damaged"):
        kept.load(0)
