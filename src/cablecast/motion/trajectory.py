"""Trajectory: one planned motion, in the form that every rig executes."""

import dataclasses

import numpy as np

from cablecast.arm.limits import JOINT_NAMES
from cablecast.errors import InputError, JointLimitError
from cablecast.motion.action import Action
from cablecast.motion.cast import cast_grip_paths
from cablecast.motion.feasibility import JOINT_LIMIT_KINDS, check_grip_paths
from cablecast.motion.grip_path import GripPath
from cablecast.motion.joint_path import JointPath, joint_path
from cablecast.setup import Setup


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trajectory:
    """One planned motion for a rig to execute.

    Attributes:
        action: Action that it was planned from; None for a motion that is not a cast.
        grip_path: Path of the gripper, one row.
        joint_path: Set points of the joints; None for a rig without joints.
    """

    action: Action | None
    grip_path: GripPath
    joint_path: JointPath | None

    def __post_init__(self):
        if len(self.grip_path) != 1:
            raise InputError(f"a trajectory has one grip path, not {len(self.grip_path)}")

    @property
    def duration(self) -> float:
        """End time of the motion [s]."""
        return float(self.grip_path.duration[0])


def plan_trajectory(action: Action, setup: Setup) -> Trajectory:
    """Plan the motion of an action down to joint set points.

    Args:
        action: Casting motion.
        setup: Set-up with the arm, the reset position and the system parameters.

    Raises:
        JointLimitError: The motion violates limits; the message names each with its value.
    """
    return follow(cast_grip_paths(action.to_array()[None], setup), setup, str(action), action)


def follow(
    grip_path: GripPath, setup: Setup, what: str, action: Action | None = None
) -> Trajectory:
    """Add the joint set points that follow a grip path.

    Args:
        grip_path: Path of one row.
        setup: Set-up with the arm and the control cycle.
        what: Name of the motion in the error.
        action: Action that the path was planned from, if any.

    Raises:
        JointLimitError: The arm cannot follow; the message names each limit with its value.
    """
    feasibility = check_grip_paths(grip_path, setup)
    if not feasibility.mask[0]:
        raise JointLimitError(f"the arm cannot follow {what}: {feasibility.describe(0)}")
    path = joint_path(grip_path, setup)
    _check_set_points(path, setup, what)
    return Trajectory(action=action, grip_path=grip_path, joint_path=path)


def _check_set_points(path: JointPath, setup: Setup, what: str) -> None:
    """Raise JointLimitError where set points ask for more than a limit.

    `check_grip_paths` looks at samples of the path. On a slow sweep close to the base they lie far
    apart, and a joint may peak between them. The set points are what the arm gets.
    """
    steps = np.diff(path.times)[:, None]
    asked = (path.q, np.diff(path.q, axis=0) / steps, np.diff(path.qd, axis=0) / steps)
    bounds = setup.arm.limits.to_array()
    for kind, values, bound in zip(JOINT_LIMIT_KINDS, asked, bounds, strict=True):
        peaks = np.max(np.abs(values), axis=0, initial=0.0)
        for joint in np.flatnonzero(peaks > bound):
            raise JointLimitError(
                f"the arm cannot follow {what}: its set points ask for {JOINT_NAMES[joint]} "
                f"{kind.name.lower()} {peaks[joint]:.4g} {kind.value}, above {bound[joint]:.4g} "
                f"{kind.value}"
            )
