"""RigUR: a UR arm with a cable in its gripper, and the camera over its table."""

import contextlib
import dataclasses
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.robot import RobotConfig
from cablecast.arm.ur import ArmUR
from cablecast.camera.settings import CameraSight
from cablecast.cast import ControllerLog, EndpointTrack, TrialStatus
from cablecast.errors import CablecastError, InputError, JointLimitError, RigError
from cablecast.motion.polar import plan_reset, reset_pose
from cablecast.motion.trajectory import JointPath, Trajectory
from cablecast.rigs.base import RigLifecycle
from cablecast.rigs.ur.link import Phase, UrLink, check_arm, check_ready, check_report
from cablecast.rigs.ur.player import CastAbortedError, MotionRecord, Player
from cablecast.rigs.ur.program import UNDER_WAY, JointCurve, check_path, joint_move
from cablecast.setup import Setup
from cablecast.vision.trials import TrialCamera, TrialTiming

RESET_DT = 0.008
"""Time between the set points to which the path of a reset is fitted [s]."""
APPROACH_SPEED = 0.3
"""Largest speed of a joint on the way to a start [rad/s]."""
BRANCH_MAX = 0.5
"""Largest turn of a joint that makes the gripper point down with the elbow up [rad]. Beyond it the
arm is folded otherwise, and only a person sees how it gets out of that."""
_LEVEL_TOLERANCE = 0.05
"""Largest turn of that kind which the way to the start makes in passing [rad]."""
_SAFE_HEIGHT = 0.25

RESET_COUNT = 3
"""Number of resets before a cable that does not lie straight is given up."""
REHEARSAL_SLOWNESS, REHEARSAL_COUNT = 4, 3
"""Times as long, and number, of rehearsed casts of a lab file that nobody has seen."""
STRAIGHT_ASIDE, STRAIGHT_AHEAD = 0.03, 0.95
"""Largest distance aside of an endpoint after a reset [share of the cable's length], and smallest
ahead [share]."""

_SILENCE_MAX = 2.0
"""Longest `silence_max` of a real arm [s]."""

TURN_SPEED = 0.8
"""Largest speed of a joint that turns the jaws into the camera's sight [rad/s]."""

_STILL_TIME = 0.3
_HANG_STILL_TIME = 1.0
_JOINT_TAIL = 0.4
# Angle by which set points are away from the end of a cast while the cable comes to rest [rad].
_MOVED = 5e-3
REPORT_GAP_MAX = 0.1
"""Longest time of a cast without a report [s]. Between two reports so far apart a joint that speeds
up at 20 rad/s² is 25 mrad from the straight line that stands for its way."""


class RigUR(RigLifecycle):
    """A UR arm behind the Rig contract.

    Nothing is connected before the first reset; what can be checked without the arm, is checked
    when the rig is made.

    Args:
        setup: Lab file with a robot section, and an arm that was measured.
        camera: Camera over the table.

    Raises:
        InputError: The set-up has no robot, or its arm was not measured.
    """

    def __init__(self, setup: Setup, camera: TrialCamera):
        super().__init__()
        self.robot = check_lab(setup)
        self.setup = setup
        self.camera = camera
        self._link: UrLink | None = None
        self._rehearsed = REHEARSAL_COUNT if self.robot.seen_safe else 0
        self.last_timing: TrialTiming | None = None
        settings = setup.to_settings()
        self.description: dict[str, Any] = {
            "rig": "ur",
            "is_twin": self.robot.is_loopback,
            "cable": setup.cable.name,
            "lookahead": self.robot.lookahead,
            "gain": self.robot.gain,
            "payload_mass": self.robot.payload_mass,
            # How well it is calibrated today is no setting of a collection that goes on tomorrow.
            "camera": camera.description.get("camera", "unknown"),
            "workspace": settings["workspace"],
            "arm": settings["arm"],
        }

    def reset(self) -> None:
        """Bring the cable to its start as the paper does, and look whether it lies straight.

        Raises:
            RigError: The arm may not move, or the cable does not lie straight after three resets.
        """
        self._check_open()
        self._is_reset = False
        seen = "nowhere"
        for _ in range(RESET_COUNT):
            self._reset_once()
            place = self.camera.locate(self._connected().latest().time)
            if place is not None and self._lies_straight(place):
                super().reset()
                return
            seen = "nowhere" if place is None else f"at x, y = {np.round(place, 3).tolist()} m"
        raise RigError(
            f"the cable does not lie straight after {RESET_COUNT} resets: its end is seen {seen}. "
            "Look whether it slipped in the gripper, is twisted, or its marker is hidden"
        )

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        """Play one motion, wait until the cable lies still, and return what was seen."""
        self._use_reset()
        curve = curve_of(trajectory)
        check_path(curve, self.setup, "this cast")
        if self._rehearsed < REHEARSAL_COUNT:
            check_ready(self._connected(), self.robot)
            self._play("cablecast_rehearsal", curve.slowed(REHEARSAL_SLOWNESS), Phase.CAST)
            self._rehearsed += 1
            self.reset()
            self._use_reset()
        # The reset may have connected anew.
        link = self._connected()
        check_ready(link, self.robot)
        self.camera.start()
        try:
            record = self._play("cablecast_cast", curve, Phase.CAST)
            check_reports(record, curve)
            timing, log = self._settle(link, record, curve)
            link.set_phase(Phase.READOUT)
        except CastAbortedError as aborted:
            self.camera.cancel()
            return _aborted(str(aborted))
        except BaseException:
            self.camera.cancel()
            raise
        track = dataclasses.replace(self.camera.stop(timing), controller_log=log)
        self.last_timing = timing
        lost = track.status is TrialStatus.OK and self._has_lost_cable(link)
        link.set_phase(Phase.IDLE)
        if lost:
            return _aborted(
                "the camera sees no cable in the jaws: it slipped out in this cast. Grip it as "
                "before"
            )
        return track

    def picture(self) -> NDArray[np.uint8] | None:
        """Return the latest picture of the camera, BGR; None where it keeps none."""
        # A camera need not keep its pictures: the protocol does not ask for it.
        return getattr(self.camera, "picture", lambda: None)()

    def sight(self) -> CameraSight | None:
        """Return what the camera cannot see; None where it does not say."""
        return getattr(self.camera, "sight", lambda: None)()

    def close(self) -> None:
        """Stop the arm, and let go of controller and camera."""
        if self._closed:
            return
        super().close()
        link, self._link = self._link, None
        with contextlib.closing(self.camera):
            if link is None:
                return
            with contextlib.closing(link):
                newest = link.reports[-1] if link.is_alive else None
                # A program that is not ours goes on.
                if newest is not None and newest.is_playing and newest.state in UNDER_WAY:
                    Player(link, self.robot).stop()
                with contextlib.suppress(RigError):
                    link.set_phase(Phase.IDLE)

    def _connected(self) -> UrLink:
        """Return the connection, made anew where it was lost."""
        if self._link is not None and not self._link.is_alive:
            lost, self._link = self._link, None
            lost.close()
        if self._link is None:
            link = UrLink(self.robot)
            try:
                check_arm(link.version, self.setup.arm.model)
            except BaseException:
                link.close()
                raise
            self._link = link
        return self._link

    def _reset_once(self) -> None:
        link = self._connected()
        check_ready(link, self.robot)
        self.camera.check(link.latest().time)
        way, reset = reset_motions(self._at_rest(link), self.setup)
        self._play("cablecast_approach", way, Phase.RESET)
        self._play("cablecast_reset", reset, Phase.RESET)
        self._wait(link, _HANG_STILL_TIME)
        link.set_phase(Phase.IDLE)

    def _play(self, name: str, curve: JointCurve, phase: Phase) -> MotionRecord:
        link = self._connected()
        link.set_phase(phase)
        return Player(link, self.robot).play(name, curve)

    def _settle(
        self, link: UrLink, record: MotionRecord, curve: JointCurve
    ) -> tuple[TrialTiming, ControllerLog]:
        """Wait until the cable has come to rest, and return when all of it took place."""
        link.set_phase(Phase.SETTLE)
        end = record.start_time + curve.duration + self.robot.settle_time
        tail = record.start_time + curve.duration + _JOINT_TAIL
        self._wait(link, end - link.latest().time)
        check_report(link.wait_for_report(), self.robot)
        reports = link.since(record.start_time)
        for report in reports:
            moved = float(np.abs(report.target_q - curve.q[-1]).max()) > _MOVED
            if report.time > tail and (report.is_playing or moved):
                raise CastAbortedError(
                    "the arm was moved, or another program ran, while the cable came to rest"
                )
        used = [r for r in reports if r.time <= tail]
        timing = TrialTiming(
            start_time=record.start_time,
            end_time=end,
            clock_pairs=np.array([[r.time, r.host_time] for r in reports]),
            joint_path=JointPath(
                times=np.array([r.time - record.start_time for r in used]),
                q=np.array([r.q for r in used]),
                qd=np.array([r.qd for r in used]),
            ),
        )
        log = ControllerLog(
            times=np.array([r.time for r in used]),
            target_q=np.array([r.target_q for r in used]),
            speed_scaling=np.array([r.speed_scaling for r in used]),
            safety_bits=np.array([float(r.safety_bits) for r in used]),
        )
        return timing, log

    def _at_rest(self, link: UrLink) -> NDArray[np.float64]:
        """Return the joint angles of the standing arm, without the noise of one report."""
        self._wait(link, _STILL_TIME)
        since = link.latest().time - _STILL_TIME / 2
        return np.mean([r.q for r in link.since(since)], axis=0)

    def _has_lost_cable(self, link: UrLink) -> bool:
        """Return whether the camera sees that the jaws are empty; turn them to where it sees them.

        A camera need not know: the protocol does not ask for it.
        """
        camera: Any = self.camera
        q = self._at_rest(link)
        seen = camera.into_sight(q) if hasattr(camera, "into_sight") else None
        if seen is None:
            return False
        if seen is not q:
            way = joint_move(q, seen, TURN_SPEED)
            try:
                check_path(way, self.setup, "the turn of the jaws")
                self._play("cablecast_look", way, Phase.READOUT)
            except (JointLimitError, CastAbortedError):
                # The cast was made, and is kept.
                return False
            q = self._at_rest(link)
        return camera.holds_cable(q, link.latest().time) is False

    def _wait(self, link: UrLink, duration: float) -> None:
        """Wait by the controller's clock."""
        end = link.latest().time + duration
        while link.latest().time < end:
            time.sleep(0.005)

    def _lies_straight(self, place: NDArray[np.float64]) -> bool:
        length = self.setup.cable.length
        ahead = place[1] - self.setup.workspace.reset_y
        return bool(abs(place[0]) < STRAIGHT_ASIDE * length and ahead > STRAIGHT_AHEAD * length)


def _aborted(why: str) -> EndpointTrack:
    """Return the track of a cast that must not become data."""
    return EndpointTrack(
        times=np.zeros(1),
        endpoint_xy=np.full((1, 2), np.nan),
        status=TrialStatus.ABORTED,
        note=why,
    )


def check_lab(setup: Setup) -> RobotConfig:
    """Return the robot of a lab file, if it may be driven.

    Raises:
        InputError: There is no robot, it is no UR, its arm was not measured, or nobody would notice
            in time that its controller is silent.
    """
    if not isinstance(setup.arm, ArmUR):
        raise InputError(
            f"--rig ur drives a UR arm, and the lab file describes a {setup.arm.model}"
        )
    if setup.robot is None:
        raise InputError("the lab file has no robot section: --rig ur needs one")
    if not setup.arm.measured:
        raise InputError(
            "the arm of the lab file is not measured: a motion for another geometry drives the "
            "fingers into the table. Measure its five values, and set measured: true"
        )
    if setup.robot.silence_max > _SILENCE_MAX and not setup.robot.is_loopback:
        raise InputError(
            f"robot silence_max = {setup.robot.silence_max:g} s is for a twin: a real arm would "
            f"move unwatched. Leave it out of the lab file, or set it to {_SILENCE_MAX:g} s at most"
        )
    return setup.robot


def curve_of(trajectory: Trajectory) -> JointCurve:
    """Return the path of a motion as it is sent.

    Raises:
        RigError: It has no joints.
    """
    if trajectory.joint_path is None:
        raise RigError("a real arm needs the joints of a motion, and this one has none")
    return JointCurve.fit(trajectory.joint_path)


def reset_motions(q: NDArray[np.float64], setup: Setup) -> tuple[JointCurve, JointCurve]:
    """Return the way to the start of the paper's reset, and that reset, both checked.

    Args:
        q: Joint angles of the standing arm [rad], shape [6].
        setup: Set-up with a robot section.

    Raises:
        RigError: The arm stands so that only a person can bring it back.
        JointLimitError: A motion leaves limits or box, or comes too close to anything.
    """
    slow = setup.with_motion(control_dt=RESET_DT)
    pose = setup.arm.grip_pose(q)
    if abs(pose[4]) < 1e-3:
        pose[4] = 0.0
    try:
        off = float(np.abs(setup.arm.inverse(pose) - q).max())
    except CablecastError:
        raise RigError(
            "the arm stands where its gripper cannot point down: bring it there by hand "
            "(freedrive), and start again"
        ) from None
    if off > BRANCH_MAX:
        raise RigError(
            f"the arm stands {off:.2f} rad from where its gripper would point down with its elbow "
            "up: bring it there by hand (freedrive), and start again"
        )
    reset = None
    if off <= _LEVEL_TOLERANCE:
        # It may have been stopped where no reset can begin.
        with contextlib.suppress(CablecastError):
            reset = curve_of(plan_reset(pose, slow))
    if reset is None:
        # From a place above the table one can.
        pose = np.array(reset_pose(setup.workspace), dtype=float)
        pose[2] += _SAFE_HEIGHT
        reset = curve_of(plan_reset(pose, slow))
    way = joint_move(q, reset.q[0], APPROACH_SPEED)
    check_path(way, setup, "the way to the start")
    check_path(reset, setup, "the reset")
    return way, reset


def check_reports(record: MotionRecord, curve: JointCurve) -> None:
    """Refuse a cast of which too little was reported: nobody knows how the arm moved there.

    Raises:
        CastAbortedError: No report came for longer than `REPORT_GAP_MAX`.
    """
    start, end = record.start_time, record.start_time + curve.duration
    times = np.clip([start, *(r.time for r in record.reports), end], start, end)
    gap = float(np.diff(times).max())
    if gap > REPORT_GAP_MAX:
        raise CastAbortedError(
            f"no report came for {gap:.2f} s of the cast, more than {REPORT_GAP_MAX:g} s: network "
            "or computer is busy"
        )


def make_ur_rig(setup: Setup) -> RigUR:
    """Return the arm and the camera of a lab file.

    Args:
        setup: Lab file with the sections robot and camera.

    Raises:
        InputError: A section is missing, or the arm was not measured.
        CameraError: The camera cannot be opened.
        MissingExtraError: OpenCV is not installed.
    """
    from cablecast.vision.trials import CameraOfTrials

    # A lab file that is refused leaves the camera alone.
    check_lab(setup)
    return RigUR(setup, CameraOfTrials(setup))
