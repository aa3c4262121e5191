"""A second driver is three files (tests/rigs/puppet) and one line in `DRIVERS`.

All else is `RigArm`. The cable is simulated by an engine along the joints that the arm reported.
"""

import dataclasses
import functools
import time

import numpy as np
import pytest
from tests.rigs.puppet.driver import DriverPuppet
from tests.robot import ROBOT

from cablecast.arm.robot import DRIVERS, Obstacle
from cablecast.arm.ur import ArmUR
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.cli.main import main
from cablecast.data.record import collect_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import CameraError, InputError, JointLimitError, RigError
from cablecast.motion.grip_path import GripPath
from cablecast.motion.trajectory import JointPath, Trajectory
from cablecast.rigs.arm import RigArm, reset_motions
from cablecast.rigs.checked import CheckedRig
from cablecast.rigs.driver import CastAbortedError, RigPhase
from cablecast.rigs.engine import RigEngine
from cablecast.rigs.make import make_rig
from cablecast.setup import Setup, load_setup, save_setup

NAME = "puppet"
LINE = ("tests.rigs.puppet.config:RobotPuppet", "tests.rigs.puppet.driver:DriverPuppet")
SECTION = {"driver": NAME, "string_length": 0.7, "seen_safe": True, "settle_time": 1.0}
SECTION |= {"box_low": list(ROBOT.box_low), "box_high": list(ROBOT.box_high)}
CAST = ["cablecast_approach", "cablecast_reset", "cablecast_cast"]


class EngineCamera:
    """Sees the cable of an engine, moved as the arm reported."""

    def __init__(self, setup: Setup):
        self.setup = setup
        self.rig = RigEngine(EngineWarp(segment_count=10, dt=2e-3), setup)
        self.description = {"camera": "engine", "tags_used": 0, "calibration_rms_mm": 0.0}
        self.start_fault = self.stop_fault = None
        self.is_filming = self.is_closed = False

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()

    def check(self, after=None):
        pass

    def start(self):
        if self.start_fault:
            raise self.start_fault
        self.is_filming = True

    def stop(self, timing) -> EndpointTrack:
        self.is_filming = False
        if self.stop_fault:
            raise self.stop_fault
        path = timing.joint_path
        poses = self.setup.arm.grip_pose(path.q)
        motion = Trajectory(
            action=None, grip_path=GripPath.fit(path.times - path.times[0], poses), joint_path=path
        )
        self.rig.reset()
        return dataclasses.replace(self.rig.execute(motion), joint_path=path, nodes=None)

    def cancel(self):
        self.is_filming = False

    def locate(self, after=None):
        return np.array([0.0, self.setup.workspace.reset_y + self.setup.cable.length])

    def close(self):
        self.is_closed = True


@pytest.fixture
def lab(monkeypatch) -> Setup:
    """Return a lab with a puppet, whose driver is known for a test."""
    monkeypatch.setitem(DRIVERS, NAME, LINE)
    for module in ("rigs.arm", "pipeline.dry_run"):
        monkeypatch.setattr(f"cablecast.{module}.CameraOfTrials", EngineCamera)
    monkeypatch.setattr(DriverPuppet, "made", [])
    monkeypatch.setattr("cablecast.rigs.arm.WARNING_TIME", 0.0)
    monkeypatch.setattr(
        "cablecast.rigs.arm.reset_motions", lambda q, setup: planned_reset(tuple(q), setup)
    )
    return Setup.from_dict({"arm": {"measured": True}, "robot": SECTION})


@pytest.fixture
def rig(lab):
    with make_rig(NAME, lab) as rig:
        yield rig


@functools.cache
def planned_reset(q, setup):
    """Plan the same reset once for all tests."""
    return reset_motions(np.array(q), setup)


def fails_in_a_cast(monkeypatch, error):
    def fault(name, at):
        if name == "cablecast_cast" and at > 0.3:
            raise error

    monkeypatch.setattr(DriverPuppet, "fault", staticmethod(fault))


def test_a_rig_of_the_driver_is_made_by_its_name_and_collects_casts(lab, tmp_path):
    actions = np.array([[-0.7, 0.6, 0.65, 1.0], [-0.3, 0.2, 0.6, 0.2]])
    with make_rig(NAME, lab) as rig:
        assert isinstance(rig.rig, RigArm)
        assert rig.description["rig"] == NAME
        assert rig.description["string_length"] == 0.7
        casts = collect_dataset(tmp_path, rig, lab, purpose="tune", actions=actions)
    assert casts.info["status_counts"] == {"ok": 2}
    joints = casts.measured_joints(0)
    # An arm without lag is where the path has it, but for the clock's steps.
    assert np.diff(joints.times).max() == pytest.approx(0.008)
    (driver,) = DriverPuppet.made
    assert driver.played == 2 * CAST
    assert not driver.is_open
    assert rig.rig.camera.is_closed


def test_its_section_of_a_lab_file_is_read_by_its_own_class_and_written_back(lab, tmp_path):
    save_setup(lab, tmp_path / "lab.yaml")
    assert load_setup(tmp_path / "lab.yaml") == lab
    with pytest.raises(InputError, match="string_length = 9 m is outside"):
        Setup.from_dict({"robot": SECTION | {"string_length": 9}})
    with pytest.raises(InputError, match="'gain'"):
        Setup.from_dict({"robot": SECTION | {"gain": 500}})
    with pytest.raises(InputError, match="unknown robot driver 'winch': one of ur, puppet"):
        Setup.from_dict({"robot": SECTION | {"driver": "winch"}})


def test_a_driver_and_the_lab_file_of_another_are_refused_before_the_camera_opens(lab, monkeypatch):
    def opened(setup):
        raise AssertionError

    monkeypatch.setattr("cablecast.rigs.arm.CameraOfTrials", opened)
    with pytest.raises(InputError, match=r"--rig ur needs another lab file: .* is puppet"):
        make_rig("ur", lab)
    with pytest.raises(InputError, match=r"--rig puppet needs another lab file: .* is ur"):
        make_rig(NAME, Setup(arm=ArmUR(measured=True), robot=ROBOT))
    with pytest.raises(InputError, match="no robot section: --rig puppet needs one"):
        make_rig(NAME, dataclasses.replace(lab, robot=None))
    with pytest.raises(InputError, match="is not measured"):
        make_rig(NAME, dataclasses.replace(lab, arm=ArmUR()))


@pytest.mark.parametrize(
    ("obstacles", "status"),
    [((), 0), ((Obstacle(start=(0.0, 0.4, 0.0), end=(0.0, 0.4, 1.5), radius=0.05),), 2)],
    ids=["free", "blocked"],
)
def test_a_dry_run_checks_every_path_and_asks_the_driver_but_plays_nothing(
    lab, tmp_path, capsys, obstacles, status
):
    robot = dataclasses.replace(lab.robot, obstacles=obstacles)
    save_setup(dataclasses.replace(lab, robot=robot), tmp_path / "lab.yaml")
    words = ["collect", "--rig", NAME, "--setup", str(tmp_path / "lab.yaml"), "--no-psi"]
    words += ["--count", "2", "--dry-run", "--out", str(tmp_path / "out")]
    assert main(words) == status
    lines = capsys.readouterr().out.splitlines()
    (driver,) = DriverPuppet.made
    assert driver.played == []
    assert not driver.is_open
    # The reset and two casts; then the controller, the first reset and the camera, or neither.
    marks = ["ok  "] * 6 if status == 0 else ["NOT "] * 4
    assert [line[:4] for line in lines[:-1]] == marks
    assert ("puppet ready" if status == 0 else "from obstacle 1") in "".join(lines)
    assert not (tmp_path / "out").exists()


def test_a_motion_beyond_a_joint_limit_is_refused_before_it_is_played(rig, cast):
    path = cast.joint_path
    q = path.q.copy()
    q[:, 5] += 7.0 * np.linspace(0.0, 1.0, len(q)) ** 2
    wound = dataclasses.replace(cast, joint_path=JointPath(times=path.times, q=q, qd=path.qd))
    rig.reset()
    with pytest.raises(JointLimitError, match=r"wrist_3 at .* rad is beyond 6\.233 rad"):
        rig.execute(wound)
    assert DriverPuppet.made[0].played == CAST[:2]


def test_a_person_is_warned_before_the_arm_moves_after_a_rest_or_an_aborted_cast(
    rig, cast, monkeypatch, capsys
):
    def warned():
        return capsys.readouterr().err

    rig.reset()
    assert warned() == "The arm moves in 0 s: Ctrl-C stops it\n"
    assert rig.execute(cast).status is TrialStatus.OK
    rig.reset()
    assert warned() == ""
    fails_in_a_cast(monkeypatch, CastAbortedError("the speed fell to 40 %"))
    assert rig.execute(cast).status is TrialStatus.ABORTED
    rig.reset()
    assert "made again: the speed fell to 40 %. The arm moves in 0 s" in warned()
    monkeypatch.setattr("cablecast.rigs.arm.QUIET_MAX", 0.0)
    rig.reset()
    assert warned() == "The arm moves in 0 s: Ctrl-C stops it\n"


def test_the_first_casts_of_an_unseen_lab_are_rehearsed_slowly(lab, cast, monkeypatch):
    lasted = {}
    monkeypatch.setattr(DriverPuppet, "fault", staticmethod(lasted.__setitem__))
    lab = dataclasses.replace(lab, robot=dataclasses.replace(lab.robot, seen_safe=False))
    with make_rig(NAME, lab) as rig:
        rig.reset()
        assert rig.execute(cast).status is TrialStatus.OK
    rehearsed = [CAST[0], "cablecast_rehearsal", *CAST[:2], "cablecast_rehearsal"]
    assert DriverPuppet.made[0].played == [*rehearsed, *CAST]
    assert lasted["cablecast_rehearsal"] == pytest.approx(4 * lasted["cablecast_cast"])


@pytest.mark.parametrize(
    ("error", "kind", "words"),
    [
        (OSError("cut\nstring"), RigError, "execute failed: OSError: cut string"),
        (RigError("the arm is silent"), RigError, "the arm is silent"),
        (KeyboardInterrupt(), KeyboardInterrupt, None),
    ],
    ids=["foreign", "rig", "interrupt"],
)
def test_an_arm_whose_driver_raises_in_a_motion_is_stopped(
    rig, cast, monkeypatch, error, kind, words
):
    fails_in_a_cast(monkeypatch, error)
    rig.reset()
    with pytest.raises(kind, match=words):
        rig.execute(cast)
    (driver,) = DriverPuppet.made
    assert driver.played == CAST
    assert not driver.is_moving
    assert not rig.rig.camera.is_filming


def test_a_motion_that_was_not_carried_out_is_stopped_and_no_data(rig, cast, monkeypatch):
    fails_in_a_cast(monkeypatch, CastAbortedError("a string lags"))
    rig.reset()
    track = rig.execute(cast)
    assert (track.status, track.note) == (TrialStatus.ABORTED, "a string lags")
    assert DriverPuppet.made[0].phase is RigPhase.IDLE
    assert not DriverPuppet.made[0].is_moving
    assert not rig.rig.camera.is_filming


def test_an_arm_that_takes_longer_than_the_time_limit_is_stopped(lab, cast, monkeypatch):
    # A reset of the puppet takes far less; a motion that hangs is interrupted.
    camera = EngineCamera(lab)
    with CheckedRig(RigArm(lab, camera), lab, time_limit=20.0) as rig:
        rig.reset()
        rig.time_limit = 0.2
        monkeypatch.setattr(DriverPuppet, "fault", staticmethod(lambda name, at: time.sleep(60.0)))
        with pytest.raises(RigError, match=r"longer than its time limit of 0\.2 s"):
            rig.execute(cast)
        assert not DriverPuppet.made[0].is_moving
        assert not camera.is_filming


def test_a_camera_that_fails_before_the_cast_keeps_the_arm_from_moving(rig, cast):
    rig.reset()
    rig.rig.camera.start_fault = CameraError("the camera is unplugged")
    with pytest.raises(CameraError, match="unplugged"):
        rig.execute(cast)
    assert DriverPuppet.made[0].played == CAST[:2]


def test_a_camera_that_fails_after_the_cast_gives_no_track_and_the_arm_stands(rig, cast):
    rig.reset()
    rig.rig.camera.stop_fault = CameraError("the camera is unplugged")
    with pytest.raises(CameraError, match="unplugged"):
        rig.execute(cast)
    assert not DriverPuppet.made[0].is_moving
    assert not rig.rig.camera.is_filming


def test_a_cast_has_the_joints_that_the_arm_reported_whatever_its_camera_returns(rig, cast):
    track = EndpointTrack.unseen(TrialStatus.OCCLUDED)
    rig.rig.camera.stop = lambda timing: track
    rig.reset()
    seen = rig.execute(cast)
    assert seen.status is TrialStatus.OCCLUDED
    assert len(seen.joint_path.times) == len(seen.controller_log.times)


def test_an_arm_that_is_not_ready_is_not_moved(rig):
    (driver,) = DriverPuppet.made
    driver.is_blocked = True
    with pytest.raises(RigError, match="strings are tangled"):
        rig.reset()
    assert driver.played == []
