"""Casts with the real arm's code on a twin, through its sockets, end to end.

The camera is one that is told the truth (`TruthCamera`); the real tracker's tests are elsewhere.
"""

import numpy as np
import pytest

from cablecast.datasets.collect import collect_dataset
from cablecast.datasets.trials import measured_joints, trial_rig, trial_track
from cablecast.errors import InputError, RigError
from cablecast.motion.action import Action
from cablecast.motion.trajectory import plan_trajectory
from cablecast.rigs.checked import CheckedRig
from cablecast.rigs.ur.rig import RigUR
from cablecast.twin.truth import TruthCamera

# RigVirtual with the same segments, trial and cast lands there; the twin's servos are stepped with
# set points as they come, which moves a landing by millimetres.
LANDING_TOLERANCE = 0.02


@pytest.fixture(scope="module")
def twin(make_twin):
    return make_twin({"watchdog": 0.3, "silence_max": 10.0}, segment_count=16, rate=2.0)


@pytest.fixture
def rig(twin):
    process, setup = twin
    process.admin.clear()
    with CheckedRig(
        RigUR(setup, TruthCamera(setup, setup.robot.address)), setup, time_limit=600.0
    ) as rig:
        yield rig


def test_casts_are_collected_and_a_stop_in_between_is_resumed_by_the_same_command(
    twin, rig, tmp_path
):
    process, setup = twin

    def collect():
        actions = np.array([[-0.4, 0.3, 0.62, 0.5], [-0.7, 0.6, 0.65, 1.0]])
        return collect_dataset(
            tmp_path / "data", rig, setup, purpose="tune", actions=actions, attempts=1
        )

    process.admin.fault("protective_stop", "cast", 0.4)
    with pytest.raises(RigError, match="protective stop: look what the arm touched"):
        collect()
    # Nothing moves until the person has cleared it.
    with pytest.raises(RigError, match="protective stop"):
        collect()
    process.admin.clear()
    dataset = collect()
    assert dataset.info["status_counts"] == {"ok": 2}
    description = trial_rig(dataset, 0)
    assert description["camera"] == {"camera": "truth of the twin"}
    assert description["is_twin"] is True
    for row in range(2):
        track, joints = trial_track(dataset, row), measured_joints(dataset, row)
        np.testing.assert_allclose(track.times, 0.1 * np.arange(len(track.times)), atol=1e-9)
        assert setup.workspace.on_table(track.final_xy)
        assert np.abs(np.diff(joints.times) - 0.008).max() < 0.1
    tip = process.admin.state()["tip"]
    np.testing.assert_allclose(trial_track(dataset, 1).final_xy, tip[:2], atol=1e-3)


def test_a_reset_that_leaves_the_cable_aside_is_given_up_after_three(twin, rig, monkeypatch):
    monkeypatch.setattr("cablecast.rigs.ur.rig.RESET_COUNT", 1)
    twin[0].admin.fault("crooked_reset")
    with pytest.raises(RigError, match="does not lie straight after 1 resets"):
        rig.reset()


def test_a_rig_without_robot_or_with_an_arm_that_nobody_measured_is_refused(twin):
    import dataclasses

    setup = twin[1]
    camera = TruthCamera(setup, setup.robot.address)
    with pytest.raises(InputError, match="no robot section"):
        RigUR(dataclasses.replace(setup, robot=None), camera)
    arm = dataclasses.replace(setup.arm, measured=False)
    with pytest.raises(InputError, match="is not measured"):
        RigUR(dataclasses.replace(setup, arm=arm), camera)


def test_a_motion_without_joints_is_refused(twin, wild):
    setup = twin[1]
    rig = RigUR(setup, TruthCamera(setup, setup.robot.address))
    with pytest.raises(RigError, match="needs the joints"):
        rig.set_points(wild)
    points = rig.set_points(plan_trajectory(Action(-0.4, 0.3, 0.62), setup))
    assert points.dt == setup.motion.control_dt
