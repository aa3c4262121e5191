"""plan_motion: the motion for one target; and the file of a motion for a robot."""

import os
import pathlib

from numpy.typing import ArrayLike

from cablecast.errors import InputError, check_argument_types
from cablecast.files import remove_leftovers, write_text
from cablecast.learning.policy import ForwardSearchPolicy, Plan, PlanMethod, Policy
from cablecast.motion.trajectory import JointPath
from cablecast.runs.folder import settings_differences
from cablecast.setup import Setup


@check_argument_types
def plan_motion(
    policy: Policy,
    *,
    target_xy: ArrayLike | None = None,
    r: float | None = None,
    theta_deg: float | None = None,
    method: PlanMethod = "refined",
) -> Plan:
    """Plan the motion that lands the cable's free end on a target.

    Args:
        policy: Policy that `train` returned, or any other.
        target_xy: Target [m], shape [2]; or else r and theta_deg.
        r: Distance from the robot's base [m].
        theta_deg: Angle from straight ahead, positive to the robot's right [deg].
        method: "refined", or "paper" for the paper's equation 1 alone.

    Raises:
        TargetError: The target is not finite, out of reach, or off the table.
    """
    if isinstance(policy, ForwardSearchPolicy):
        policy = policy.by(method)
    plan = policy.plan(target_xy, r=r, theta_deg=theta_deg)
    if len(plan) != 1:
        raise InputError(f"plan_motion takes one target, not {len(plan)}: use policy.plan")
    return plan


def save_motion(
    plan: Plan, path: str | os.PathLike[str], setup: Setup, *, force: bool = False
) -> None:
    """Write the motion for one target as CSV for a robot: t [s], q1 ... [rad], qd1 ... [rad/s].

    The header states the arm's geometry that the joint angles hold for. A person must have measured
    the arm of the set-up, and its geometry must be that of the plan: with another gripper the same
    angles drive into the table. Only `force` overwrites a file.

    Raises:
        InputError: The arm was not measured or is another one, the file exists, or the motion has
            no joint path.
    """
    check_measured(setup)
    mine, theirs = plan.setup.to_settings()["arm"], setup.to_settings()["arm"]
    if differences := settings_differences(mine, theirs):
        raise InputError(
            f"the motion was planned for another arm: {'; '.join(differences)}. Simulate and "
            "train with the lab file of this arm"
        )
    path = pathlib.Path(path)
    check_writable(path, force)
    joint_path = plan.trajectories[0].joint_path
    if joint_path is None:
        raise InputError("the planned motion has no joint path")
    remove_leftovers(path)
    write_text(path, motion_csv(joint_path, plan.setup))


def check_measured(setup: Setup) -> None:
    """Refuse a set-up whose arm nobody has measured; the error says what to measure."""
    arm = setup.arm
    if not arm.measured:
        raise InputError(
            "a motion for a robot needs a lab file whose arm was measured: state arm.model "
            f"({arm.model}), base_height ({arm.base_height:g} m above the table), base_yaw_deg "
            f"({arm.base_yaw_deg:g}), gripper_length ({arm.gripper_length:g} m from flange to "
            f"cable), grip_offset ({arm.grip_offset:g} m) and measured: true, and give it with "
            "--setup"
        )


def check_writable(path: pathlib.Path, force: bool) -> None:
    """Refuse to overwrite anything but a regular file, and that only if it is forced."""
    if not (path.exists() or path.is_symlink()):
        return
    if not path.is_file() or path.is_symlink():
        raise InputError(f"{path} is no regular file: give another path")
    if not force:
        raise InputError(f"{path} exists: give --force to overwrite it")


def motion_csv(path: JointPath, setup: Setup) -> str:
    """Return a joint path as CSV, with the arm that it holds for in comment lines."""
    arm = setup.arm
    lines = [
        f"# arm: {arm.model}, base {arm.base_height:g} m above the table, turned by "
        f"{arm.base_yaw_deg:g} deg",
        f"# gripper: {arm.gripper_length:g} m from flange to cable, cable leaves "
        f"{arm.grip_offset:g} m in front of the flange axis",
        f"# grip: {setup.workspace.grip_height:g} m above the table; cable: {setup.cable.name}",
    ]
    joints = range(1, path.q.shape[1] + 1)
    lines.append(",".join(["t", *(f"q{k}" for k in joints), *(f"qd{k}" for k in joints)]))
    for t, q, qd in zip(path.times, path.q, path.qd, strict=True):
        lines.append(",".join([f"{t:.6f}", *(f"{value:.9f}" for value in (*q, *qd))]))
    return "\n".join(lines) + "\n"
