"""What every rig must do, whatever it is made of."""

import json

import numpy as np
import pytest

from cablecast.cast import TrialStatus
from cablecast.errors import RigError
from cablecast.rigs.base import Rig, run_trials

# Rods may stretch by as much as a soft length constraint lets them; 1 % would be seen.
STRETCH_MAX = 0.01
# A cable at rest may creep a little until the trial ends; errors are counted in per cent of 0.6 m.
REST_MOVE = 0.004
# Engines in single precision may round otherwise in a batch, and a whip magnifies it.
BATCH_TOLERANCE = 1e-3
# A servo is some tens of milliseconds late; a reported joint that is another one is radians off.
SERVO_LAG_MAX = 0.15
JOINT_TOLERANCE = 0.01
# The grip path begins where the workspace says, and so must the cable's near end.
GRIP_TOLERANCE = 1e-6


@pytest.fixture(scope="module")
def track(rig_kind, cast):
    rig = rig_kind.make()
    rig.reset()
    track = rig.execute(cast)
    rig.close()
    return track


def test_it_answers_the_rig_protocol_and_describes_itself_in_plain_values(rig_kind):
    rig = rig_kind.make()
    assert isinstance(rig, Rig)
    assert rig.description["rig"]
    json.dumps(rig.description)


@pytest.mark.slow
def test_a_cast_ends_at_rest_on_the_table(rig_kind, track, cable, workspace):
    assert track.status is TrialStatus.OK
    assert np.all(np.isfinite(track.final_xy))
    assert workspace.on_table(track.final_xy)
    assert np.hypot(*track.final_xy) <= workspace.reach(cable.length)
    if rig_kind.name != "user":
        assert np.linalg.norm(track.endpoint_xy[-1] - track.endpoint_xy[-2]) < REST_MOVE


def test_samples_come_every_100_ms_from_the_start_to_after_the_motion(track, cast):
    np.testing.assert_allclose(track.times, 0.1 * np.arange(len(track.times)), atol=1e-9)
    assert track.times[-1] >= cast.duration


def test_the_cable_begins_straight_along_the_grip_keeps_its_length_and_ends_in_both_ends(
    track, cast, cable, workspace
):
    if track.nodes is None:
        pytest.skip("this rig sees only the endpoint")
    first = track.nodes[0]
    np.testing.assert_allclose(first[0, :2], [0.0, workspace.reset_y], atol=GRIP_TOLERANCE)
    assert np.linalg.norm(first[-1] - first[0]) > 0.98 * cable.length
    length = np.linalg.norm(np.diff(track.nodes, axis=1), axis=-1).sum(axis=1)
    np.testing.assert_allclose(length, cable.length, rtol=STRETCH_MAX)
    np.testing.assert_allclose(track.nodes[:, -1, :2], track.endpoint_xy)
    end = cast.grip_path.evaluate(cast.grip_path.duration[:, None])[0, 0]
    # A rig has an arm, and an arm misses its path by some millimetres.
    np.testing.assert_allclose(track.nodes[-1, 0], end[:3], atol=0.005)


def test_the_joints_that_a_rig_reports_follow_those_that_were_commanded(track, cast):
    if track.joint_path is None:
        pytest.skip("this rig reports no joints")
    commanded, actual = cast.joint_path, track.joint_path
    assert np.all(np.diff(actual.times) > 0)
    assert actual.times[-1] >= cast.duration
    for joint in range(6):
        at = np.interp(commanded.times, actual.times, actual.q[:, joint])
        lag = commanded.qd[:, joint] * SERVO_LAG_MAX
        assert np.all(np.abs(at - commanded.q[:, joint]) <= np.abs(lag).max() + JOINT_TOLERANCE)
    np.testing.assert_allclose(actual.q[-1], commanded.q[-1], atol=JOINT_TOLERANCE)


def test_a_motion_without_a_reset_is_refused_and_so_is_a_closed_rig(rig_kind, small_cast):
    # A real arm takes one driver at a time: the end of the block lets go of it.
    with rig_kind.make() as rig:
        assert run_trials(rig, []) == []
        with pytest.raises(RigError, match="reset"):
            rig.execute(small_cast)
        rig.reset()
        rig.execute(small_cast)
        with pytest.raises(RigError, match="reset"):
            rig.execute(small_cast)
        rig.reset()
    rig.close()
    with pytest.raises(RigError, match="closed"):
        rig.execute(small_cast)
    with pytest.raises(RigError, match="closed"):
        rig.reset()


def test_a_wild_motion_is_reported_as_off_the_table(rig_kind, wild):
    if rig_kind.name == "ur":
        pytest.skip("an arm is never asked for a motion that no arm can make: see ur/test_rig.py")
    rig = rig_kind.make()
    rig.reset()
    track = rig.execute(wild)
    assert track.status is TrialStatus.OFF_TABLE
    assert np.all(np.isnan(track.final_xy))


def test_trials_of_one_seed_are_equal_one_by_one_many_at_once_or_sought(rig_kind, cast, small_cast):
    if rig_kind.name == "ur":
        pytest.skip("no two trials of a real arm are equal")
    counts = []
    many = run_trials(rig_kind.make(), [small_cast, cast, small_cast], counts.append)
    assert counts[-1] == 3
    rig = rig_kind.make()
    for trajectory, expected in zip((small_cast, cast), many, strict=False):
        rig.reset()
        track = rig.execute(trajectory)
        assert track.status is expected.status
        np.testing.assert_array_equal(track.times, expected.times)
        np.testing.assert_allclose(track.endpoint_xy, expected.endpoint_xy, atol=BATCH_TOLERANCE)
    if getattr(rig, "seek", None) is None:
        return
    sought = rig_kind.make()
    sought.seek(2)
    sought.reset()
    np.testing.assert_array_equal(sought.execute(small_cast).endpoint_xy, many[2].endpoint_xy)
    # Another trial has another luck.
    assert tuple(many[2].final_xy) != tuple(many[0].final_xy)
