"""The paper's reset (section V-A): lift, hang for three seconds, swing forward, drag back slowly.

It brings the cable from wherever a cast left it to the state that every cast starts from: straight
in front of the robot, at rest, without torsion.
"""

import numpy as np
from numpy.typing import ArrayLike

from cablecast.arm.ur5 import ArmUR5
from cablecast.cable import Cable
from cablecast.motion.action import MotionConfig
from cablecast.motion.grip_path import GripPath
from cablecast.motion.plane_path import PlanePath
from cablecast.motion.polar_cast import (
    PolarCastConfig,
    PolarReach,
    follow,
    lift,
    pull_back,
    reset_pose,
    swing_out,
)
from cablecast.motion.trajectory import Trajectory
from cablecast.workspace import Workspace


def reset_path(
    start: ArrayLike, cable: Cable, workspace: Workspace, config: PolarCastConfig | None = None
) -> GripPath:
    """Path of the gripper through one reset.

    Args:
        start: Where the gripper is: x, y, z [m], yaw, pitch [rad], shape [5].
        cable: Gives the lengths.
        workspace: Gives the reset pose, at which the path ends.
        config: Settings of the lift, the swing and the pull.
    """
    config = config or PolarCastConfig()
    path = PlanePath(np.asarray(start, dtype=float))
    lift(path, cable, config).hold(config.hang_time)
    radius = PolarReach.of(cable, workspace, config).landing_radius(0.0) - cable.length
    # A cable that is long for the table is laid no nearer than the reset itself.
    swing_out(path, max(radius, workspace.reset_y), workspace, config)
    return pull_back(path, float(reset_pose(workspace)[1]), config).grip_path()


def plan_reset(
    start: ArrayLike,
    cable: Cable,
    workspace: Workspace,
    config: PolarCastConfig | None = None,
    motion: MotionConfig | None = None,
    arm: ArmUR5 | None = None,
) -> Trajectory:
    """Like `reset_path`, down to joint set points.

    Raises:
        JointLimitError: The arm cannot follow; the message names each limit with its value.
    """
    grip_path = reset_path(start, cable, workspace, config)
    return follow(grip_path, workspace, motion, arm, "reset")
