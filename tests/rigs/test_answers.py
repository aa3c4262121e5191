"""Answers that no real trial can give are refused by name, and those of real trials are not."""

import dataclasses
import itertools

import numpy as np
import pytest

from cablecast.cast import ControllerLog, EndpointTrack, TrialStatus
from cablecast.errors import InputError, RigError
from cablecast.motion.grip_path import GripPath
from cablecast.motion.measured import SAMPLES_MIN, grip_path_from_joints
from cablecast.motion.trajectory import JointPath, Trajectory
from cablecast.rigs.checked import (
    DESCRIPTION_SIZE_MAX,
    END_TIME_MAX,
    SAMPLE_COUNT_MAX,
    check_description,
    check_picture,
    check_track,
)
from cablecast.setup import Setup
from cablecast.workspace import Workspace

LAG = 0.06
"""Time by which the joints of a good answer trail their set points, as those of an arm do [s]."""


@pytest.fixture(scope="module")
def good(cast):
    """Return the answer of a sound rig: the endpoint glides to its place, the joints follow."""
    times = 0.1 * np.arange(40)
    share = np.clip(times / cast.duration, 0.0, 1.0)[:, None]
    xy = np.array([0.0, 1.2]) + share * np.array([0.4, -0.5])
    command = cast.joint_path
    joints = JointPath(times=command.times + LAG, q=command.q, qd=command.qd)
    return EndpointTrack(times=times, endpoint_xy=xy, status=TrialStatus.OK, joint_path=joints)


def changed(track, **arrays):
    """Return the same answer with other times, places or status."""
    return dataclasses.replace(track, **arrays)


def with_joints(track, **arrays):
    """Return the same answer with another report of its joints."""
    return dataclasses.replace(track, joint_path=dataclasses.replace(track.joint_path, **arrays))


def some_joints(track, chosen):
    """Return the same answer with some of the reports of its joints."""
    joints = track.joint_path
    return with_joints(track, times=joints.times[chosen], q=joints.q[chosen], qd=joints.qd[chosen])


def put(values, index, value):
    """Return a copy of an array with another value at one place."""
    values = values.copy()
    values[index] = value
    return values


def many(count):
    """Return a track of many samples in the time of one."""
    times = np.linspace(0.0, 3.0, count)
    return EndpointTrack(
        times=times, endpoint_xy=np.tile([0.0, 1.2], (count, 1)), status=TrialStatus.OK
    )


ATTACKS = {
    "no track": (lambda t: None, "execute returned NoneType"),
    "a tuple": (lambda t: (t.times, t.endpoint_xy), "execute returned tuple"),
    "a status as text": (lambda t: changed(t, status="ok"), "status 'ok'"),
    "millimetres": (lambda t: changed(t, endpoint_xy=1e3 * t.endpoint_xy), "like millimetres"),
    "centimetres": (lambda t: changed(t, endpoint_xy=1e2 * t.endpoint_xy), "like centimetres"),
    "one wild place": (
        lambda t: changed(t, endpoint_xy=put(t.endpoint_xy, 7, [2.0, 2.5])),
        "3.2",
    ),
    "an infinite place": (
        lambda t: changed(t, endpoint_xy=put(t.endpoint_xy, 7, np.inf)),
        "infinite endpoint",
    ),
    "a jump": (
        lambda t: changed(t, times=t.times / 50, endpoint_xy=put(t.endpoint_xy, 7, [-1.0, 0.5])),
        "faster than 60 m/s",
    ),
    "milliseconds": (lambda t: changed(t, times=1e3 * t.times), "like milliseconds"),
    "a clock": (lambda t: changed(t, times=1.7e9 + t.times), "seconds since the motion began"),
    "times before the motion": (lambda t: changed(t, times=t.times - 1.0), "begins at -1 s"),
    "times that fall": (lambda t: changed(t, times=t.times[::-1]), "3.8 s follows 3.9 s"),
    "a repeated time": (lambda t: changed(t, times=put(t.times, 5, 0.4)), "0.4 s follows 0.4 s"),
    "a time that is none": (lambda t: changed(t, times=put(t.times, 5, np.nan)), "not finite"),
    "a huge track": (lambda t: many(SAMPLE_COUNT_MAX + 1), "at most 100000"),
    "no landing": (
        lambda t: changed(t, endpoint_xy=put(t.endpoint_xy, -1, np.nan)),
        "OK without a final endpoint",
    ),
    "a landing beside the table": (
        lambda t: changed(t, endpoint_xy=t.endpoint_xy * [1.0, 0.0] - [0.0, 0.3]),
        "status OK, but ends at (0.400, -0.300) m, off the table",
    ),
    "an occluded end in sight": (
        lambda t: changed(t, status=TrialStatus.OCCLUDED),
        "status OCCLUDED, but ends at (0.400, 0.700) m",
    ),
    "degrees": (
        lambda t: with_joints(t, q=np.degrees(t.joint_path.q)),
        "12.57 rad; it looks like degrees",
    ),
    "joints that are none": (
        lambda t: with_joints(t, q=put(t.joint_path.q, (9, 2), np.nan)),
        "joint angle that is not finite",
    ),
    "another joint": (
        lambda t: with_joints(t, q=t.joint_path.q[:, ::-1]),
        "from where it was commanded: at most 0.5 rad",
    ),
    "joints that stand still": (
        lambda t: with_joints(t, q=np.repeat(t.joint_path.q[:1], len(t.joint_path.q), axis=0)),
        "from where it was commanded: at most 0.5 rad",
    ),
    "joints in milliseconds": (
        lambda t: with_joints(t, times=1e3 * t.joint_path.times),
        "report of its joints ends at",
    ),
    "joints backwards in time": (
        lambda t: with_joints(t, times=t.joint_path.times[::-1]),
        "report of its joints do not rise",
    ),
    "a track cut short": (
        lambda t: changed(t, times=t.times[:9], endpoint_xy=t.endpoint_xy[:9]),
        "ends at 0.8 s, before its motion does at",
    ),
    "joints too seldom reported": (
        lambda t: some_joints(t, slice(None, None, 20)),
        "times since the motion began: at least 16",
    ),
    "joints of the first half": (
        lambda t: some_joints(t, slice(len(t.joint_path.times) // 2)),
        "last 0.3 s at most; None stands for no report",
    ),
    "joints of no kind": (lambda t: changed(t, joint_path=t.joint_path.q), "must be a JointPath"),
    "joints that are empty": (
        lambda t: with_joints(t, times=np.empty(0), q=np.empty((0, 6)), qd=np.empty((0, 6))),
        "None stands for no report",
    ),
}


@pytest.mark.parametrize("name", ATTACKS)
def test_an_impossible_answer_is_refused_in_one_line(name, good, cast, setup):
    attack, words = ATTACKS[name]
    with pytest.raises(RigError) as caught:
        check_track(attack(good), cast, setup)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


PLAIN = {
    "all of it": lambda t: t,
    "no joints": lambda t: changed(t, joint_path=None),
    "one sample at the end": lambda t: changed(t, times=t.times[-1:], endpoint_xy=[[0.4, 0.7]]),
    "gaps": lambda t: changed(t, endpoint_xy=put(t.endpoint_xy, slice(3, 12), np.nan)),
    "never seen": lambda t: changed(
        t, endpoint_xy=np.full_like(t.endpoint_xy, np.nan), status=TrialStatus.OCCLUDED
    ),
    "a long rest": lambda t: changed(t, times=put(t.times, -1, END_TIME_MAX)),
    "a start that was not seen": lambda t: changed(
        t, endpoint_xy=put(t.endpoint_xy, slice(0, 5), np.nan)
    ),
    "a track that begins late": lambda t: changed(
        t, times=t.times[5:], endpoint_xy=t.endpoint_xy[5:]
    ),
    "a crooked reset": lambda t: changed(t, endpoint_xy=put(t.endpoint_xy, 0, [0.15, 1.15])),
    "off the table": lambda t: changed(
        t, endpoint_xy=t.endpoint_xy * [4.0, 1.0], status=TrialStatus.OFF_TABLE
    ),
    "a broken simulation": lambda t: changed(
        t, endpoint_xy=1e30 * t.endpoint_xy, status=TrialStatus.NON_FINITE
    ),
    "stopped": lambda t: changed(
        t, endpoint_xy=put(t.endpoint_xy, -1, np.nan), status=TrialStatus.ABORTED
    ),
    "joints reported before the motion": lambda t: with_joints(t, times=t.joint_path.times - 0.05),
    "joints seldom reported": lambda t: some_joints(t, slice(None, None, 7)),
    "a stop half-way": lambda t: changed(
        some_joints(t, slice(9)),
        times=t.times[:9],
        endpoint_xy=t.endpoint_xy[:9],
        status=TrialStatus.ABORTED,
    ),
}


@pytest.mark.parametrize("name", PLAIN)
def test_what_a_real_trial_can_give_is_taken(name, good, cast, setup):
    answer = PLAIN[name](good)
    assert check_track(answer, cast, setup) is answer


def test_the_fewest_reports_that_are_taken_are_enough_for_a_fit(good, cast, setup):
    count = len(good.joint_path.times)
    chosen = np.linspace(0, count - 1, SAMPLES_MIN).astype(int)
    few = some_joints(good, chosen)
    assert check_track(few, cast, setup) is few
    assert np.isfinite(grip_path_from_joints(few.joint_path, setup.arm).duration).all()


def test_joints_may_trail_their_set_points_by_as_much_as_a_slow_servo_does(good, cast, setup):
    command = cast.joint_path
    late = with_joints(good, times=command.times + 0.25)
    assert check_track(late, cast, setup) is late
    with pytest.raises(RigError, match="from where it was commanded"):
        check_track(with_joints(good, times=command.times + 1.0), cast, setup)


def test_a_motion_beyond_the_arm_widens_what_the_endpoint_may_reach(good, setup):
    pose = [0.0, 3.0, 0.02, 0.0, 0.0]
    there = Trajectory(action=None, grip_path=GripPath.hold(pose, 1.0), joint_path=None)
    far = changed(
        good,
        endpoint_xy=put(np.full_like(good.endpoint_xy, 2.0), 0, np.nan),
        joint_path=None,
        status=TrialStatus.OFF_TABLE,
    )
    assert check_track(far, there, setup) is far


def test_a_larger_table_takes_landings_that_a_smaller_one_does_not(good, cast):
    beside = changed(good, endpoint_xy=np.linspace([0.0, 1.2], [0.4, -0.3], len(good.times)))
    beside = changed(beside, endpoint_xy=put(beside.endpoint_xy, slice(-6, None), [0.4, -0.3]))
    for near_y, fits in ((-0.5, True), (0.0, False)):
        setup = Setup(workspace=Workspace(table_near_y=near_y, table_depth=2.0))
        if fits:
            assert check_track(beside, cast, setup) is beside
        else:
            with pytest.raises(RigError, match="off the table"):
                check_track(beside, cast, setup)


def nested(depth):
    """Return a dictionary in a dictionary in a dictionary."""
    value = {}
    for _ in range(depth):
        value = {"deeper": value}
    return value


def endless():
    value = {}
    value["itself"] = value
    return value


BAD_DESCRIPTIONS = {
    "no dictionary": ("a rig", "is a str: it must be a dictionary"),
    "a number that is none": ({"camera": {"gain": float("nan")}}, "['camera']['gain'] = nan"),
    "an infinite number": ({"poses": [0.0, float("inf")]}, "['poses'][1] = inf"),
    "an array": ({"home": np.zeros(6)}, "['home'] is a ndarray"),
    "an object": ({"socket": itertools.count()}, "['socket'] is a count"),
    "bytes": ({"serial": b"123"}, "['serial'] is a bytes"),
    "a number as key": ({"tags": {3: "left"}}, "has the key '3', which is no text"),
    "a huge number": ({"id": 10**5000}, "more than 63 bits"),
    "text that is none": ({"name": "\ud800"}, "cannot be written in UTF-8"),
    "far too much": ({"log": "x" * DESCRIPTION_SIZE_MAX}, "at most 100000"),
    "far too deep": (nested(50), "nested deeper than 20 levels"),
    "itself": (endless(), "nested deeper than 20 levels"),
}


@pytest.mark.parametrize("name", BAD_DESCRIPTIONS)
def test_a_description_that_no_file_can_hold_is_refused_in_one_line(name):
    description, words = BAD_DESCRIPTIONS[name]
    with pytest.raises(RigError) as caught:
        check_description(description)
    assert words in str(caught.value)
    assert len(str(caught.value)) < 300


def test_a_plain_description_is_copied_with_lists_for_tuples_and_numbers_for_numpys():
    pose = [0.0, 0.6]
    description = {"rig": "mine", "pose": pose, "size": (3, np.int64(4)), "on": True, "none": None}
    plain = check_description(description)
    assert plain == {"rig": "mine", "pose": [0.0, 0.6], "size": [3, 4], "on": True, "none": None}
    assert type(plain["size"][1]) is int
    pose[0] = 9.0
    assert plain["pose"] == [0.0, 0.6]


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        ("table.png", "is str"),
        (np.zeros((4, 4), dtype=np.uint8), "shape (4, 4)"),
        (np.zeros((4, 4, 3)), "float64"),
        (np.zeros((0, 4, 3), dtype=np.uint8), "shape (0, 4, 3)"),
    ],
)
def test_what_is_no_picture_of_a_camera_is_refused(picture, words):
    with pytest.raises(RigError) as caught:
        check_picture(picture)
    assert words in str(caught.value)
    # There may be none yet.
    assert check_picture(None) is None


def test_a_controllers_log_belongs_to_the_reported_joints(good, cast, setup):
    def log(count):
        ones = np.ones(count)
        return ControllerLog(
            times=np.arange(count) * 0.008,
            target_q=np.zeros((count, 6)),
            speed_scaling=ones,
            safety_bits=ones,
        )

    count = len(good.joint_path.times)
    logged = changed(good, controller_log=log(count))
    assert check_track(logged, cast, setup) is logged
    with pytest.raises(RigError, match=f"{count - 1} reports of a controller"):
        check_track(changed(good, controller_log=log(count - 1)), cast, setup)
    with pytest.raises(InputError, match="speed_scaling of a controller's log"):
        dataclasses.replace(log(count), speed_scaling=np.ones(count + 1))
