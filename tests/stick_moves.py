"""Joint moves of a UR5 with a stick, for tests of swings in the air."""

import numpy as np

from cablecast.arm.ur import ArmUR
from cablecast.motion.joint_move import JointMoves, Stick

MOVES = JointMoves(
    arm=ArmUR(model="ur5"),
    stick=Stick(length=0.5),
    start=tuple(np.radians([0.0, -70.0, 150.0, -170.0, -90.0, 0.0]).tolist()),
    joints=(2, 3),
    low=(1.0, *np.radians([-60.0, 60.0])),
    high=(3.0, *np.radians([-180.0, -120.0])),
)
