"""Dry run of a collection on a real arm: everything is checked and shown, and nothing moves."""

import contextlib
from typing import NamedTuple

import numpy as np

from cablecast.data.record import Purpose
from cablecast.errors import CablecastError
from cablecast.motion.casting import Action
from cablecast.motion.feasibility import feasible_ranges
from cablecast.motion.polar import plan_reset, reset_pose
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.pipeline.collect import SAMPLINGS, AnySampling, choose_actions
from cablecast.rigs.arm import RESET_DT, reset_motions
from cablecast.rigs.driver import ArmDriver, make_driver
from cablecast.rigs.path import JointCurve, check_path
from cablecast.setup import Setup
from cablecast.vision.trials import CameraOfTrials


class Finding(NamedTuple):
    """Thing that was checked, why it would not go (None where all is well), and facts."""

    what: str
    problem: str | None = None
    detail: str = ""


def dry_run(
    setup: Setup,
    driver: str | None = None,
    *,
    purpose: Purpose = "tune",
    count: int | None = None,
    sampling: AnySampling | None = None,
    psi: bool = True,
    seed: int = 0,
) -> list[Finding]:
    """Check what a collection on the arm of a lab file would do, with the options of `collect`.

    `driver` names the driver that the robot must be of; any if None.

    The paths are checked first. Only if all of them pass, the controller is asked whether it is
    ready and where the arm stands, and the camera whether it sees; nothing moves.

    Raises:
        InputError: There is no robot, or one that may not be driven; see `make_driver`.
    """
    arm = make_driver(setup, driver)
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
    return [*findings, *_check_controller(setup, arm), _check_camera(setup)]


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


def _check_controller(setup: Setup, driver: ArmDriver) -> list[Finding]:
    """Check that the controller is ready, and the way back from where the arm stands."""
    try:
        with contextlib.closing(driver):
            words, q = driver.ready(), driver.latest().q
    except CablecastError as error:
        return [Finding("controller", str(error))]
    height = float(setup.arm.grip_pose(q)[2])
    found = Finding("controller", None, f"grip {height:.2f} m high, {words}")
    try:
        way, reset = reset_motions(q, setup)
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
