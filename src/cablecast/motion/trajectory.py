"""Trajectories: one planned motion, as every rig executes it."""

import dataclasses

from cablecast.arm.ur5 import ArmUR5
from cablecast.errors import InputError, JointLimitError
from cablecast.motion.action import Action, MotionConfig
from cablecast.motion.cast import cast_grip_paths
from cablecast.motion.feasibility import check_grip_paths
from cablecast.motion.grip_path import GripPath
from cablecast.motion.joint_path import JointPath, joint_path
from cablecast.workspace import Workspace


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trajectory:
    """One motion, for a rig to execute.

    Attributes:
        action: What it was planned from; None for a motion that is no cast.
        grip_path: Path of the gripper, one row.
        joint_path: Set points of the joints; None for a rig that has no joints.
    """

    action: Action | None
    grip_path: GripPath
    joint_path: JointPath | None

    def __post_init__(self):
        if len(self.grip_path) != 1:
            raise InputError(f"a trajectory has one grip path, not {len(self.grip_path)}")

    @property
    def duration(self) -> float:
        """When the motion ends [s]."""
        return float(self.grip_path.duration[0])


def plan_trajectory(
    action: Action, config: MotionConfig, workspace: Workspace, arm: ArmUR5 | None = None
) -> Trajectory:
    """Plan the motion of an action down to joint set points.

    Args:
        action: What to do.
        config: System parameters.
        workspace: Gives the reset position.
        arm: The robot; a UR5 as the paper's by default.

    Raises:
        JointLimitError: The motion would break limits; the message names each with its value.
    """
    grip_path = cast_grip_paths(action.to_array()[None], config, workspace)
    feasibility = check_grip_paths(grip_path, workspace, arm)
    if not feasibility.mask[0]:
        raise JointLimitError(f"the arm cannot follow {action}: {feasibility.describe(0)}")
    return Trajectory(
        action=action,
        grip_path=grip_path,
        joint_path=joint_path(grip_path, workspace, config, arm),
    )
