"""The paper's reset (section V-A): lift, hang for three seconds, swing forward, drag back slowly.

It brings the cable from wherever a cast left it to the initial state of every cast: straight in
front of the robot, at rest, without torsion.
"""

import numpy as np
from numpy.typing import ArrayLike

from cablecast.motion.grip_path import GripPath
from cablecast.motion.plane_path import PlanePath
from cablecast.motion.polar_cast import (
    PolarCastConfig,
    lift,
    pull_back,
    reset_pose,
    swing_out,
)
from cablecast.motion.polar_reach import PolarReach
from cablecast.motion.trajectory import Trajectory, follow
from cablecast.setup import Setup


def reset_path(start: ArrayLike, setup: Setup, config: PolarCastConfig | None = None) -> GripPath:
    """Return the gripper path of one reset.

    Args:
        start: Start pose of the gripper: x, y, z [m], yaw, pitch [rad], shape [5].
        setup: Set-up with the cable and the reset pose, at which the path ends.
        config: Settings of the lift, the swing and the pull.
    """
    config, cable = config or PolarCastConfig.of(setup.workspace), setup.cable
    path = PlanePath(np.asarray(start, dtype=float))
    lift(path, cable, config).hold(config.hang_time)
    radius = PolarReach.of(setup, config).landing_radius(0.0) - cable.length
    # A cable that is long for the table is laid no nearer than the reset pose.
    swing_out(path, max(radius, setup.workspace.reset_y), setup.workspace, config)
    return pull_back(path, float(reset_pose(setup.workspace)[1]), config).grip_path()


def plan_reset(start: ArrayLike, setup: Setup, config: PolarCastConfig | None = None) -> Trajectory:
    """Plan one reset down to joint set points; see `reset_path`.

    Raises:
        JointLimitError: The arm cannot follow; the message names each limit with its value.
    """
    return follow(reset_path(start, setup, config), setup, "this reset")
