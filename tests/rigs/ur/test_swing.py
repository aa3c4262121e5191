"""Swings with the real arm's code on a twin: what is refused before one, watched in it, and hit.

The cable is EngineWarp's, held by the joints that the twin reported.
"""

import dataclasses

import numpy as np
import pytest
from tests.rigs.ur.conftest import UR10E, is_idle, wait_until

from cablecast.aiming.config import AimConfig
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.engines.base import CableState
from cablecast.engines.swing import SAMPLE_DT, swing_model
from cablecast.errors import CameraError, InputError, JointLimitError, RigError
from cablecast.motion.joint_move import JointMoves, grip_path_of_joints
from cablecast.motion.trajectory import JointPath, joints_at, plan_trajectory
from cablecast.pipeline.aim import aim
from cablecast.pipeline.strike import prepare_strike
from cablecast.rigs.arm import curve_of
from cablecast.rigs.arm_swing import RigSwingArm
from cablecast.rigs.checked import CheckedRig
from cablecast.rigs.make import make_rig
from cablecast.rigs.path import JointCurve
from cablecast.rigs.swings import check_swing, move_envelope
from cablecast.runs.progress import ignore
from cablecast.setup import StrikeConfig

# Where arm, stick and cable swing: the robot stands on a post, and nobody is near.
LAB = {
    "strike": {"clear_low": [-1.2, -1.5, -1.1], "clear_high": [1.2, 2.2, 2.6], "watch_time": 1.8},
    "robot": {"box_low": [-0.8, -0.6, -0.6], "box_high": [0.8, 1.4, 1.9]},
}
LAB_10E = {
    **LAB,
    "arm": UR10E["arm"],
    "motion": {"control_dt": 0.002},
    "strike": {**LAB["strike"], "clear_high": [1.4, 2.8, 3.2], "speed": [0.8, 1.8]},
    "robot": {"box_low": [-1.0, -1.0, -0.8], "box_high": [1.0, 2.0, 2.6]},
}
UNIT = np.array([0.6, 0.6, 0.5])
# The twin's servos lag by a few hundredths of a second.
LAG_MAX = 0.3
# The camera of these tests sees exactly, and the cable is the engine's own, with other segments.
HIT_PCT = 5.0


class EngineCamera:
    """Sees the tip of a cable that an engine swings by the joints that were reported."""

    def __init__(self, setup, coarse=16):
        self.setup, self.model = setup, swing_model(setup, coarse)
        self.description = {"camera": "an engine"}
        self.cancelled = 0

    def check(self, after=None):
        pass

    start = close = check

    def cancel(self):
        self.cancelled += 1

    def locate(self, after=None):
        return np.array([0.0, 0.3, -0.9])

    def stop(self, timing):
        model = self.model
        times = SAMPLE_DT * np.arange(int((timing.end_time - timing.start_time) / SAMPLE_DT))
        q = joints_at(timing.joint_path, times)[None]
        path = grip_path_of_joints(times, q, model.moves.arm, model.moves.stick)
        count = model.engine.segment_count
        state = CableState.hanging(self.setup.cable, path, count, model.engine.gravity)
        tip = model.engine.rollout(
            self.setup.cable, path, state, float(times[-1]), SAMPLE_DT
        ).endpoint_xyz[0]
        tip = np.asarray(tip, dtype=float)
        return EndpointTrack(
            times=SAMPLE_DT * np.arange(len(tip), dtype=float),
            endpoint_xy=tip[:, :2],
            endpoint_z=tip[:, 2],
            status=TrialStatus.OK,
            joint_path=timing.joint_path,
        )


@pytest.fixture(scope="module")
def twin(make_twin):
    return make_twin(lab=LAB, has_cable=False, rate=4.0)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Let the arm go back to its start quickly, and a busy computer miss reports."""
    monkeypatch.setattr("cablecast.rigs.arm_swing.APPROACH_SPEED", 1.5)
    monkeypatch.setattr("cablecast.rigs.arm.REPORT_GAP_MAX", 60.0)


@pytest.fixture
def rig(twin):
    process, setup = twin
    process.admin.clear()
    with RigSwingArm(setup, EngineCamera(setup)) as rig:
        yield rig


def changed(setup, **values):
    return dataclasses.replace(setup, strike=dataclasses.replace(setup.strike, **values))


def swing_of(setup, unit=UNIT):
    return plan_trajectory(JointMoves.of(setup).move(unit), setup)


def test_a_swing_that_keeps_to_every_bound_is_let_through(twin):
    setup = twin[1]
    check_swing(curve_of(swing_of(setup)), setup, "this swing")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"clear_high": (1.2, 1.2, 2.6)}, r"cable could come to y = 1\.\d+ m, .* ends at 1\.20 m"),
        ({"clear_low": (-1.2, -1.5, -0.9)}, r"cable could come to z = -1\.\d+ m, .* at -0\.90 m"),
        ({"floor": -0.2}, "the gripper is .* m from the floor"),
    ],
)
def test_a_swing_that_leaves_what_is_clear_is_refused(twin, values, words):
    setup = changed(twin[1], **values)
    with pytest.raises(JointLimitError, match=words):
        check_swing(curve_of(swing_of(setup)), setup, "this swing")


def test_a_swing_is_refused_where_nobody_said_what_is_clear(twin):
    setup = changed(twin[1], clear_low=None, clear_high=None)
    with pytest.raises(InputError, match="set clear_low and clear_high in the strike section"):
        check_swing(curve_of(swing_of(setup)), setup, "this swing")


def test_a_joint_that_would_be_too_fast_and_an_arm_that_would_meet_its_stick_are_refused(twin):
    setup = twin[1]
    start = np.array(JointMoves.of(setup).start)
    fast = start + np.array([0.0, 0.0, -1.5, 0.0, 0.0, 0.0])
    times = np.array([0.0, 0.4])
    curve = JointCurve(times, np.stack([start, fast]), np.zeros((2, 6)))
    with pytest.raises(JointLimitError, match=r"elbow turning at -5\.6"):
        check_swing(curve, setup, "this swing")
    folded = start + np.radians([0.0, 0.0, 0.0, 100.0, 0.0, 0.0])
    curve = JointCurve(np.array([0.0, 4.0]), np.stack([start, folded]), np.zeros((2, 6)))
    with pytest.raises(JointLimitError, match=r"the gripper is .* m from the"):
        check_swing(curve, setup, "this swing")


def test_the_cable_stays_in_the_stated_box(twin):
    setup = twin[1]
    low, high = move_envelope(setup, UNIT)
    model = swing_model(setup, 12)
    tips = model.play(model.motion(UNIT), setup.cable).tip[0]
    assert np.all(tips > low)
    assert np.all(tips < high)


@pytest.mark.parametrize("generation", ["cb3", "e-series"])
def test_the_twin_plays_a_swing_at_125_and_at_500_hz(twin, make_twin, generation):
    process, setup = twin
    if generation == "e-series":
        process, setup = make_twin({}, "ur10e", lab=LAB_10E, has_cable=False, rate=3.0)
    trajectory = swing_of(setup)
    with CheckedRig(RigSwingArm(setup, EngineCamera(setup)), setup, time_limit=600.0) as rig:
        rig.reset()
        track = rig.execute(trajectory)
    assert track.status is TrialStatus.OK
    assert track.endpoint_z is not None
    reported = track.joint_path
    assert isinstance(reported, JointPath)
    end = trajectory.joint_path.q[-1]
    np.testing.assert_allclose(reported.q[-1], end, atol=0.02)
    assert np.abs(reported.q - joints_at(trajectory.joint_path, reported.times)).max() < LAG_MAX
    assert not [e for e in process.admin.events() if e["what"] == "protective stop"]
    if generation == "e-series":
        process.close()


def has_heard_of(rig, when):
    """Tell whether the rig has read a report newer than that, or has to connect anew anyway.

    A busy computer may read one of before after the twin was cleared.
    """
    try:
        return rig.driver.latest().time > when
    except RigError:
        return True


def clear(process, rig):
    """Do what a person does after a fault, once the arm rests."""
    process.admin.clear()
    cleared = process.admin.state()["time"]
    wait_until(lambda: is_idle(process) and has_heard_of(rig, cleared))


@pytest.mark.slow
def test_a_fault_in_a_swing_stops_the_arm_and_is_no_data_and_the_same_rig_goes_on(twin, rig):
    process, setup = twin
    swing = swing_of(setup)
    rig.reset()
    process.admin.fault("speed_slider", "cast", 0.3)
    track = rig.execute(swing)
    assert track.status is TrialStatus.ABORTED
    assert "the speed fell to 50 %" in track.note
    clear(process, rig)
    for fault, words in (
        ("protective_stop", "protective stop"),
        ("program_stopped", "somebody stopped or paused"),
        ("controller_dies", "controller"),
    ):
        rig.reset()
        process.admin.fault(fault, "cast", 0.3)
        with pytest.raises(RigError, match=words):
            rig.execute(swing)
        assert rig.camera.cancelled
        rig.camera.cancelled = 0
        clear(process, rig)
    rig.reset()
    assert rig.execute(swing).status is TrialStatus.OK
    # On the long way back to the start as well.
    process.admin.fault("protective_stop", "reset", 0.3)
    with pytest.raises(RigError, match="protective stop"):
        rig.reset()
    clear(process, rig)
    rig.reset()


def test_a_cable_that_never_hangs_still_is_not_swung(rig, monkeypatch):
    monkeypatch.setattr("cablecast.rigs.arm_swing.HANG_TIME_MAX", 2.0)
    ways = iter(np.random.default_rng(0).normal(size=(100, 3)))
    monkeypatch.setattr(rig.camera, "locate", lambda after=None: next(ways))
    with pytest.raises(RigError, match="still sways after 2 s at the start"):
        rig.reset()
    monkeypatch.setattr(rig.camera, "locate", lambda after=None: None)
    with pytest.raises(RigError, match="is not seen after 2 s"):
        rig.reset()


@pytest.mark.slow
def test_a_real_arm_strikes_a_target_on_the_twin(twin, rig):
    setup = twin[1]
    checked = CheckedRig(rig, setup, time_limit=600.0)
    config = AimConfig(within_pct=HIT_PCT, tries=4)
    session = prepare_strike(checked, config, move_count=64, cable_count=3, progress=ignore)
    result = aim(session, checked, [1.2, 0.9], progress=ignore)
    assert result.hit.all()


def test_a_camera_that_sees_no_swing_is_refused_before_the_robot_is_called(twin):
    with pytest.raises(CameraError, match="tags on a wall behind it"):
        make_rig("ur", twin[1])


def test_a_set_up_without_a_strike_section_is_refused(twin):
    setup = dataclasses.replace(twin[1], strike=None)
    with pytest.raises(InputError, match="no strike section"):
        RigSwingArm(setup, EngineCamera(twin[1]))
    assert twin[1].strike != StrikeConfig()
