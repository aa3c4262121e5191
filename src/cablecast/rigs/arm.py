"""RigArm: a real arm with a cable in its gripper, and the camera over its table."""

import contextlib
import dataclasses
import sys
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.settings import CameraSight
from cablecast.cast import ControllerLog, EndpointTrack, TrialStatus
from cablecast.errors import CablecastError, JointLimitError, RigError, StoppedError
from cablecast.motion.polar import plan_reset, reset_pose
from cablecast.motion.trajectory import JointPath, Trajectory
from cablecast.rigs.base import RigLifecycle
from cablecast.rigs.driver import CastAbortedError, MotionRecord, RigPhase, make_driver
from cablecast.rigs.path import JointCurve, check_path, straight_move
from cablecast.setup import Setup
from cablecast.vision.trials import CameraOfTrials, TrialCamera, TrialTiming

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

TURN_SPEED = 0.8
"""Largest speed of a joint that turns the jaws into the camera's sight [rad/s]."""

_STILL_TIME = 0.3
_HANG_STILL_TIME = 1.0
_JOINT_TAIL = 0.4
# Angle by which set points are away from the end of a cast while the cable comes to rest [rad].
_MOVED = 5e-3
WARNING_TIME, QUIET_MAX = 5.0, 30.0
"""Time between the warning that the arm is about to move and its motion, and the longest rest after
which it moves without one [s]."""
REPORT_GAP_MAX = 0.1
"""Longest time of a cast without a report [s]. Between two reports so far apart a joint that speeds
up at 20 rad/s² is 25 mrad from the straight line that stands for its way."""


class RigArm(RigLifecycle):
    """A real arm behind the Rig contract: the order of a cast, whatever drives the arm.

    Nothing is connected before the first reset; what can be checked without the arm, is checked
    when the rig is made. A motion is checked before it is played, and the arm is stopped whenever
    one does not end well.

    Args:
        setup: Lab file with a robot section, and an arm that was measured.
        camera: Camera over the table; that of the lab file if None.
        driver: Name of the driver that the robot must be of; any if None.

    Raises:
        InputError: The set-up has no robot, or one that may not be driven; see `make_driver`.
        CameraError: The lab file has no camera, or it cannot be opened.
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, setup: Setup, camera: TrialCamera | None = None, driver: str | None = None):
        super().__init__()
        # A lab file that is refused leaves the camera alone.
        self.driver = make_driver(setup, driver)
        robot = setup.robot
        if robot is None:
            raise RigError("the driver came without a robot section")
        self.robot = robot
        self.setup = setup
        self.camera = camera = camera or self._open_camera()
        self._rehearsed = REHEARSAL_COUNT if robot.seen_safe else 0
        self._has_seen_reset = robot.seen_safe
        self._moved_at, self._aborted = -np.inf, ""
        self.last_timing: TrialTiming | None = None
        settings = setup.to_settings()
        self.description: dict[str, Any] = {
            "rig": robot.driver,
            **self.driver.description,
            "cable": setup.cable.name,
            # How well it is calibrated today is no setting of a collection that goes on tomorrow.
            "camera": camera.description.get("camera", "unknown"),
            "workspace": settings["workspace"],
            "arm": settings["arm"],
        }

    def _open_camera(self) -> TrialCamera:
        return CameraOfTrials(self.setup)

    def reset(self) -> None:
        """Bring the cable to its start as the paper does, and look whether it lies straight.

        Raises:
            RigError: The arm may not move.
            StoppedError: The cable does not lie straight after three resets.
        """
        self._begin_reset()
        seen = "nowhere"
        for _ in range(RESET_COUNT):
            self._reset_once()
            place = self.camera.locate(self.driver.latest().time)
            if place is not None and self._lies_straight(place):
                super().reset()
                return
            seen = "nowhere" if place is None else f"at x, y = {np.round(place, 3).tolist()} m"
        raise StoppedError(
            f"the cable does not lie straight after {RESET_COUNT} resets: its end is seen {seen}. "
            "Look whether it slipped in the gripper, is twisted, or its marker is hidden"
        )

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        """Play one motion, wait until the cable lies still, and return what was seen."""
        self._use_reset()
        curve = curve_of(trajectory)
        self._check(curve, "this cast")
        if self._rehearsed < REHEARSAL_COUNT:
            self.driver.ready()
            self._play("cablecast_rehearsal", curve.slowed(REHEARSAL_SLOWNESS), RigPhase.CAST)
            self._rehearsed += 1
            self.reset()
            self._use_reset()
        self.driver.ready()
        self.camera.start()
        try:
            record = self._play("cablecast_cast", curve, RigPhase.CAST)
            check_reports(record, curve)
            timing, log = self._settle(record, curve, self._after(curve))
            self.driver.set_phase(RigPhase.READOUT)
        except CastAbortedError as aborted:
            self._aborted = str(aborted)
            self.camera.cancel()
            with contextlib.suppress(RigError):
                self.driver.set_phase(RigPhase.IDLE)
            return EndpointTrack.unseen(TrialStatus.ABORTED, str(aborted))
        except BaseException:
            self.camera.cancel()
            raise
        track = dataclasses.replace(
            self.camera.stop(timing), joint_path=timing.joint_path, controller_log=log
        )
        self.last_timing = timing
        lost = track.status is TrialStatus.OK and self._has_lost_cable()
        self.driver.set_phase(RigPhase.IDLE)
        if lost:
            return EndpointTrack.unseen(
                TrialStatus.ABORTED,
                "the camera sees no cable in the jaws: it slipped out in this cast. Grip it as "
                "before",
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
        """Stop the arm, and release controller and camera."""
        if self._closed:
            return
        super().close()
        with contextlib.closing(self.camera), contextlib.closing(self.driver):
            self.driver.stop()
            with contextlib.suppress(RigError):
                self.driver.set_phase(RigPhase.IDLE)

    def _begin_reset(self) -> None:
        """Warn a person near the arm that it is about to move, after a rest or an aborted cast."""
        self._check_open()
        self._is_reset = False
        aborted, self._aborted = self._aborted, ""
        if time.monotonic() < self._moved_at + QUIET_MAX and not aborted:
            return
        why = f"The motion is aborted, and made again: {aborted}. " if aborted else ""
        warning = f"{why}The arm moves in {WARNING_TIME:g} s: Ctrl-C stops it"
        print(warning, file=sys.stderr, flush=True)
        if not self.driver.description.get("is_twin"):
            time.sleep(WARNING_TIME)

    def _reset_once(self) -> None:
        self.driver.ready()
        self.camera.check(self.driver.latest().time)
        reset = self._approach()
        if not self._has_seen_reset:
            self._play("cablecast_rehearsal", reset.slowed(REHEARSAL_SLOWNESS), RigPhase.RESET)
            self._has_seen_reset = True
            reset = self._approach()
        self._play("cablecast_reset", reset, RigPhase.RESET)
        self._wait(_HANG_STILL_TIME)
        self.driver.set_phase(RigPhase.IDLE)

    def _approach(self) -> JointCurve:
        """Go to the start of a reset, and return that reset."""
        way, reset = reset_motions(self._at_rest(), self.setup)
        self._play("cablecast_approach", way, RigPhase.RESET)
        return reset

    def _play(self, name: str, curve: JointCurve, phase: RigPhase) -> MotionRecord:
        try:
            return self.driver.play(name, curve, phase)
        except BaseException as error:
            self.driver.stop()
            if isinstance(error, CastAbortedError):
                self._aborted = str(error)
            raise
        finally:
            self._moved_at = time.monotonic()

    def _check(self, curve: JointCurve, what: str) -> None:
        """Refuse a motion that must not be played; see `check_path`."""
        check_path(curve, self.setup, what)

    def _after(self, curve: JointCurve) -> float:
        """Return the time from the end of a motion to that of its trial [s]."""
        del curve
        return self.robot.settle_time

    def _settle(
        self, record: MotionRecord, curve: JointCurve, after: float
    ) -> tuple[TrialTiming, ControllerLog]:
        """Wait for some time after a cast [s], and return when all of it took place."""
        driver = self.driver
        driver.set_phase(RigPhase.SETTLE)
        end = record.start_time + curve.duration + after
        tail = record.start_time + curve.duration + _JOINT_TAIL
        self._wait(end - driver.latest().time)
        driver.check_standing()
        reports = driver.since(record.start_time)
        for report in reports:
            moved = float(np.abs(report.target_q - curve.q[-1]).max()) > _MOVED
            if report.time > tail and (report.is_playing or moved):
                raise StoppedError(
                    "the arm was moved, or another program ran, while the cable came to rest: let "
                    "nobody move it. The same command resumes"
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

    def _at_rest(self) -> NDArray[np.float64]:
        """Return the joint angles of the standing arm, without the noise of one report."""
        self._wait(_STILL_TIME)
        since = self.driver.latest().time - _STILL_TIME / 2
        return np.mean([r.q for r in self.driver.since(since)], axis=0)

    def _has_lost_cable(self) -> bool:
        """Return whether the camera sees that the jaws are empty; turn them to where it sees them.

        A camera need not know: the protocol does not ask for it.
        """
        camera: Any = self.camera
        q = self._at_rest()
        seen = camera.into_sight(q) if hasattr(camera, "into_sight") else None
        if seen is None:
            return False
        if seen is not q:
            way = straight_move(q, seen, TURN_SPEED)
            try:
                check_path(way, self.setup, "the turn of the jaws")
                self._play("cablecast_look", way, RigPhase.READOUT)
            except (JointLimitError, CastAbortedError):
                # The cast was made, and is kept: nothing is made again.
                self._aborted = ""
                return False
            q = self._at_rest()
        return camera.holds_cable(q, self.driver.latest().time) is False

    def _wait(self, duration: float) -> None:
        """Wait by the controller's clock."""
        end = self.driver.latest().time + duration
        while self.driver.latest().time < end:
            time.sleep(0.005)

    def _lies_straight(self, place: NDArray[np.float64]) -> bool:
        length = self.setup.cable.length
        ahead = place[1] - self.setup.workspace.reset_y
        return bool(abs(place[0]) < STRAIGHT_ASIDE * length and ahead > STRAIGHT_AHEAD * length)


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
        q: Joint angles of the standing arm [rad], shape [joint].
        setup: Set-up with a robot section.

    Raises:
        RigError: The arm stands so that only a person can bring it back.
        JointLimitError: A motion leaves limits or box, or comes too close to anything.
    """
    slow = setup.with_motion(control_dt=RESET_DT)
    try:
        pose = setup.arm.standing_pose(q)
        if abs(pose[4]) < 1e-3:
            pose[4] = 0.0
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
    way = straight_move(q, reset.q[0], APPROACH_SPEED)
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
