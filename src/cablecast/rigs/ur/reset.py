"""Motions of a reset: from where the arm stands to the begin of the paper's reset, and that."""

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import CablecastError, RigError
from cablecast.motion.polar_cast import reset_pose
from cablecast.motion.reset import plan_reset
from cablecast.rigs.ur.path import SetPoints, check_path, joint_move
from cablecast.setup import Setup

RESET_DT = 0.008
"""Time between set points of a reset [s]: at 0.002 s its program would have 700 kB."""
APPROACH_SPEED = 0.3
"""Largest speed of a joint on the way to a start [rad/s]."""
BRANCH_MAX = 0.5
"""Largest turn of a joint that makes the gripper point down with the elbow up [rad]. Beyond it the
arm is folded otherwise, and only a person sees how it gets out of that."""
_LEVEL_TOLERANCE = 0.05
"""Largest turn of that kind which the way to the start makes in passing [rad]."""
_SAFE_HEIGHT = 0.25


def reset_motions(q: NDArray[np.float64], setup: Setup) -> tuple[SetPoints, SetPoints]:
    """Return the way to the begin of a reset, and the reset, both checked.

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
        off = np.inf
    if off > BRANCH_MAX:
        raise RigError(
            f"the arm stands {off:.2f} rad from where its gripper would point down with its elbow "
            "up: bring it there by hand (freedrive), and start again"
        )
    path = None
    if off <= _LEVEL_TOLERANCE:
        try:
            path = plan_reset(pose, slow).joint_path
        except CablecastError:
            # Stopped where no reset can begin.
            path = None
    if path is None:
        # From a place above the table one can.
        pose = np.array(reset_pose(setup.workspace), dtype=float)
        pose[2] += _SAFE_HEIGHT
        path = plan_reset(pose, slow).joint_path
    if path is None:
        raise RigError("the reset has no joints")
    reset = SetPoints(path.q, RESET_DT)
    way = joint_move(q, reset.q[0], APPROACH_SPEED, RESET_DT)
    check_path(way, setup, "the way to the start")
    check_path(reset, setup, "the reset")
    return way, reset
