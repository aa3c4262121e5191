"""Dry run of a collection on a real arm: everything is checked and shown, and nothing moves."""

import contextlib
import time
from typing import NamedTuple

import numpy as np

from cablecast.arm.robot import RobotConfig
from cablecast.data.record import Purpose
from cablecast.errors import CablecastError
from cablecast.motion.action import Action
from cablecast.motion.feasibility import feasible_ranges
from cablecast.motion.polar import plan_reset, reset_pose
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.pipeline.collect import SAMPLINGS, AnySampling, choose_actions
from cablecast.rigs.ur.link import BY_HAND, UrLink, check_ready
from cablecast.rigs.ur.program import JointCurve, check_path
from cablecast.rigs.ur.rig import RESET_DT, check_lab, reset_motions
from cablecast.setup import Setup
from cablecast.vision.trials import CameraOfTrials

_SLOW_ANSWER = 1.0


class Finding(NamedTuple):
    """Thing that was checked, why it would not go (None where all is well), and facts."""

    what: str
    problem: str | None = None
    detail: str = ""


def dry_run(
    setup: Setup,
    *,
    purpose: Purpose = "tune",
    count: int | None = None,
    sampling: AnySampling | None = None,
    psi: bool = True,
    seed: int = 0,
) -> list[Finding]:
    """Check what a collection on the arm of a lab file would do, with the options of `collect`.

    The paths are checked first. Only if all of them pass, the controller is asked whether it is
    ready and where the arm stands, and the camera whether it sees; nothing moves.

    Raises:
        InputError: There is no robot, or its arm was not measured.
    """
    robot = check_lab(setup)
    slow = setup.with_motion(control_dt=RESET_DT)
    reset = plan_reset(reset_pose(setup.workspace), slow)
    findings = [_check_motion("reset", reset, slow)]
    actions = choose_actions(
        sampling or SAMPLINGS[purpose],
        purpose,
        count,
        setup,
        feasible_ranges(setup, psi),
        seed,
    )
    for number, values in enumerate(actions):
        action = Action.from_array(values)
        findings.append(_check_motion(f"cast {number}", plan_trajectory(action, setup), setup))
    if any(finding.problem for finding in findings):
        return [*findings, Finding("controller", "was not asked, because of the paths above")]
    return [*findings, *_check_controller(setup, robot), _check_camera(setup)]


def _check_motion(what: str, trajectory: Trajectory, setup: Setup) -> Finding:
    path = trajectory.joint_path
    if path is None:
        return Finding(what, "has no joints")
    grip = setup.arm.grip_pose(path.q)
    detail = (
        f"{trajectory.duration:.2f} s, joints up to {np.max(path.peak_speed):.2f} rad/s, grip from "
        f"x {grip[:, 0].min():.2f} to {grip[:, 0].max():.2f} m, y {grip[:, 1].min():.2f} to "
        f"{grip[:, 1].max():.2f} m, z {grip[:, 2].min():.2f} to {grip[:, 2].max():.2f} m"
    )
    try:
        check_path(JointCurve.fit(path), setup, what)
    except CablecastError as error:
        return Finding(what, str(error), detail)
    return Finding(what, None, detail)


def _check_controller(setup: Setup, robot: RobotConfig) -> list[Finding]:
    """Check that the controller is ready, and the way back from where the arm stands."""
    try:
        with contextlib.closing(UrLink(robot)) as link:
            start = time.monotonic()
            report = check_ready(link, robot)
            asked = time.monotonic() - start
    except CablecastError as error:
        return [Finding("controller", str(error))]
    height = float(setup.arm.grip_pose(report.q)[2])
    version = ".".join(map(str, link.version))
    payload = "not reported" if report.payload is None else f"{report.payload:.2f} kg"
    detail = f"{version} ready at {robot.address}, payload {payload}, grip {height:.2f} m high"
    if asked > _SLOW_ANSWER:
        detail += f"; its dashboard took {asked:.1f} s to answer, which delays every cast"
    if not link.has_dashboard:
        detail += f"; {BY_HAND}"
    found = Finding("controller", None, detail)
    try:
        way, reset = reset_motions(report.q, setup)
    except CablecastError as error:
        return [found, Finding("first reset", str(error))]
    detail = f"{way.duration:.1f} s from where the arm stands to its start, {reset.duration:.1f} s"
    return [found, Finding("first reset", None, detail)]


def _check_camera(setup: Setup) -> Finding:
    try:
        with CameraOfTrials(setup) as camera:
            camera.check()
            used, rms = camera.description["tags_used"], camera.description["calibration_rms_mm"]
            return Finding("camera", None, f"sees {used} tags, which fit to {rms:.1f} mm")
    except CablecastError as error:
        return Finding("camera", str(error))
