"""Casts with the real arm's code on a twin, through its sockets, end to end.

The camera is one that is told the truth (`TruthCamera`); the real tracker's tests are elsewhere.
"""

import dataclasses
import os
import signal
import threading

import numpy as np
import pytest
from benchmarks.truth import TruthCamera
from tests.rigs.conftest import RigQuick
from tests.rigs.ur.conftest import is_idle, make_fault, time_to_rest, wait_until

from cablecast.cast import TrialStatus
from cablecast.data.record import collect_dataset
from cablecast.errors import InputError, RigError, StoppedError
from cablecast.motion.casting import Action
from cablecast.motion.trajectory import plan_trajectory
from cablecast.rigs.arm import RigArm, check_reports, curve_of
from cablecast.rigs.checked import CheckedRig
from cablecast.rigs.driver import CastAbortedError, MotionRecord
from cablecast.rigs.path import JointCurve, straight_move
from cablecast.rigs.ur.driver import DriverUR
from cablecast.rigs.ur.link import Report

# As fast as this computer simulates: the clock waits for the client, and no camera is drawn.
RATE = 6.0
# The arm must rest this soon after whatever stops it, by the twin's clock [s].
REST_TIME_MAX = 0.5


@pytest.fixture(scope="module")
def stick(make_twin):
    """Run a twin whose arm holds a stick."""
    return make_twin({"settle_time": 0.5}, has_cable=False, rate=3.0)


def quick_rig(stick, **changes):
    process, setup = stick
    process.admin.clear()
    setup = dataclasses.replace(setup, robot=dataclasses.replace(setup.robot, **changes))
    return RigQuick(setup, TruthCamera(setup))


def programs(process):
    return [e["name"] for e in process.admin.events() if e["what"] == "program starts"]


class MovingLink:
    """A connection to an arm that a person's program moves after a cast."""

    is_alive = True

    def __init__(self, q):
        self.q, self.reports = q, []

    def set_phase(self, phase):
        pass

    def latest(self):
        time = 0.1 * len(self.reports)
        q = self.q + 0.1 * time
        values = {"q": q, "target_q": q, "qd": np.zeros(6), "is_playing": True}
        values |= {"speed_scaling": 1.0, "safety_bits": 1, "robot_mode": 7}
        values |= {"payload": 0.95, "payload_cog": None, "state": 3, "tick": 0, "number": 1}
        self.reports.append(Report(time=time, host_time=time, **values))
        return self.reports[-1]

    wait_for_report = latest

    def since(self, time):
        return [report for report in self.reports if report.time >= time]


def test_a_cast_after_which_the_arm_is_moved_is_no_data(stick):
    setup = stick[1]
    setup = dataclasses.replace(
        setup, robot=dataclasses.replace(setup.robot, payload_mass=0.95, settle_time=1.0)
    )
    rig, q = RigQuick(setup, TruthCamera(setup)), np.zeros(6)
    curve = straight_move(q, q + 0.01, 0.6)
    rig.driver._link = MovingLink(curve.q[-1])
    with pytest.raises(StoppedError, match="while the cable came to rest"):
        rig._settle(MotionRecord(0.0, []), curve, 1.0)


class HandCamera(TruthCamera):
    """Knows what lies in the jaws, once they are turned a little."""

    holds: bool | None = True

    def into_sight(self, q):
        return q + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.2])

    def holds_cable(self, q, after):
        return self.holds


def test_a_cast_after_which_the_jaws_are_empty_is_aborted(stick, small_cast, monkeypatch):
    # A computer that is busy with other tests misses reports.
    monkeypatch.setattr("cablecast.rigs.arm.REPORT_GAP_MAX", 60.0)
    process, setup = stick
    process.admin.clear()
    camera = HandCamera(setup)
    with RigQuick(setup, camera) as rig:
        for camera.holds, status in ((None, "ok"), (False, "aborted")):
            rig.reset()
            track = rig.execute(small_cast)
            assert track.status.name.lower() == status
            assert programs(process)[-1] == "cablecast_look"
    assert "no cable in the jaws: it slipped out in this cast" in track.note


def _last(events, what, name):
    return [e for e in events if e["what"] == what and e["name"] == name][-1]


@pytest.mark.parametrize("lost", [(0.0, 0.2), (0.5, 0.7), (1.0, 1.5)])
def test_a_cast_of_which_reports_were_lost_is_aborted(lost):
    points = JointCurve(np.array([0.0, 1.0]), np.zeros((2, 6)), np.zeros((2, 6)))
    still = np.zeros(6)
    times = 50.0 + np.arange(-20, 160) * 0.008

    def reports(times):
        rest = (still, still, still, 1.0, 1, True, 7, 0.0, None, 2, 1, 1)
        return [Report(t, t, *rest) for t in times]

    check_reports(MotionRecord(50.0, reports(times)), points)
    left = times[(times < 50.0 + lost[0]) | (times > 50.0 + lost[1])]
    if lost[0] < points.duration:
        with pytest.raises(CastAbortedError, match=r"no report came for 0\.[12]\d s of the cast"):
            check_reports(MotionRecord(50.0, reports(left)), points)
    else:
        # What is lost after the cast was over is no part of it.
        check_reports(MotionRecord(50.0, reports(left)), points)


def test_an_interrupt_stops_the_arm(stick, cast):
    with quick_rig(stick) as rig:
        rig.reset()

        start = stick[0].admin.state()["q"][0]

        def interrupt():
            wait_until(lambda: abs(stick[0].admin.state()["q"][0] - start) > 0.15)
            os.kill(os.getpid(), signal.SIGINT)

        thread = threading.Thread(target=interrupt)
        thread.start()
        with pytest.raises(KeyboardInterrupt):
            rig.execute(cast)
        thread.join()
        # On a busy computer the twin's clock is slower than that of this test.
        wait_until(lambda: is_idle(stick[0]))
        begin = _last(stick[0].admin.events(), "program ends", "cablecast_cast")["time"]
        truth = stick[0].admin.truth(begin - 2.0, begin)
        assert max(truth["joint_speed"]) > 0.5


# From docs/lab.md, with a box about the arm's reach.
UR3E = {
    "arm": {"base_height": 0.13},
    "workspace": {"r_max": 0.485, "reset_y": 0.31, "support_depth": 0.25},
    "motion": {"r0": 0.31, "v_max": 0.8, "jerk": 40.0, "control_dt": 0.002},
    "robot": {"box_low": [-0.5, 0.02, 0.0], "box_high": [0.5, 0.5, 0.8]},
}


def test_an_e_series_of_another_size_casts_at_500_hz_and_stops_as_soon(make_twin, tmp_path):
    robot = {"settle_time": 0.3}
    process, setup = make_twin(robot, "ur3e", lab=UR3E, has_cable=False, rate=3.0)
    actions = np.array([[-0.4, 0.3, 0.33, 0.5]])
    with quick_rig((process, setup)) as rig:
        casts = collect_dataset(tmp_path, rig, setup, purpose="tune", actions=actions, attempts=2)
        assert not [e for e in process.admin.events() if e["what"] == "protective stop"]
        process.admin.fault("protective_stop", "cast", 0.3)
        rig.reset()
        with pytest.raises(RigError, match="protective stop"):
            rig.execute(plan_trajectory(Action.from_array(actions[0]), setup))
        assert time_to_rest(process, "fault") < REST_TIME_MAX
    assert casts.info["status_counts"] == {"ok": 1}
    # A busy computer misses reports; the most common step is that of the controller.
    assert np.median(np.diff(casts.measured_joints(0).times)) == pytest.approx(0.002, abs=1e-6)
    process.close()


@pytest.fixture(scope="module")
def twin(make_twin):
    return make_twin(segment_count=16, rate=RATE)


@pytest.fixture
def rig(twin):
    process, setup = twin
    process.admin.clear()
    with CheckedRig(RigArm(setup, TruthCamera(setup)), setup, time_limit=600.0) as rig:
        yield rig


def test_a_reset_that_leaves_the_cable_aside_is_given_up_after_three(twin, rig, monkeypatch):
    monkeypatch.setattr("cablecast.rigs.arm.RESET_COUNT", 1)
    twin[0].admin.fault("crooked_reset")
    with pytest.raises(RigError, match="does not lie straight after 1 resets"):
        rig.reset()


def test_a_cable_that_slips_out_of_the_jaws_in_mid_cast_is_no_data(twin, wide_cast):
    process, setup = twin
    # A person grips it anew, and lays it straight, however the last test left it.
    make_fault(process, "cable_slips")
    process.admin.clear()
    with RigQuick(setup, TruthCamera(setup)) as rig:
        rig.reset()
        process.admin.fault("cable_drops", "cast", 0.25)
        track = rig.execute(wide_cast)
        process.admin.clear()
    assert track.status is TrialStatus.ABORTED
    assert "no cable in the jaws: it slipped out in this cast" in track.note


def test_a_real_arm_that_could_move_unwatched_is_refused(twin_setup):
    robot = dataclasses.replace(twin_setup.robot, address="192.0.2.1", silence_max=60.0)
    with pytest.raises(InputError, match=r"silence_max = 60 s is for a twin"):
        DriverUR(dataclasses.replace(twin_setup, robot=robot))


def test_a_motion_without_joints_is_refused(wild):
    with pytest.raises(RigError, match="needs the joints"):
        curve_of(wild)
