"""JointPath: set points for the robot's controller, one per control cycle."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.limits import JOINT_COUNT
from cablecast.errors import IKError, InputError
from cablecast.motion.grip_path import GripPath
from cablecast.setup import Setup


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointPath:
    """Set points of the six joints at the robot's control cycle.

    Attributes:
        times: Times since the start of the motion, every control_dt up to the first tick at or
            after its end [s], shape [tick].
        q: Joint angles [rad], shape [tick, 6].
        qd: Joint rates, the exact derivative of the angles; zero at the end [rad/s], shape
            [tick, 6].
    """

    times: NDArray[np.float64]
    q: NDArray[np.float64]
    qd: NDArray[np.float64]

    def __post_init__(self):
        shape = (len(self.times), JOINT_COUNT)
        if self.q.shape != shape or self.qd.shape != shape:
            raise InputError(
                f"a joint path has shapes q {self.q.shape}, qd {self.qd.shape}: its {shape[0]} "
                f"ticks require {shape}"
            )

    @property
    def peak_speed(self) -> NDArray[np.float64]:
        """Largest speed of each joint [rad/s], shape [6]."""
        return np.max(np.abs(self.qd), axis=0)


def joints_at(path: JointPath, times: ArrayLike) -> NDArray[np.float64]:
    """Return joint angles at some times, held before the first and after the last tick.

    Args:
        path: Joints as they moved.
        times: Times [s], shape [time].

    Returns:
        Angles [rad], shape [time, 6].
    """
    times = np.asarray(times, dtype=float)
    return np.stack([np.interp(times, path.times, q) for q in path.q.T], axis=-1)


def joint_path(grip_path: GripPath, setup: Setup) -> JointPath:
    """Return joint angles and rates that make the gripper follow a path.

    Args:
        grip_path: Path of one row.
        setup: Set-up with the arm, its reach and the control cycle.

    Raises:
        InputError: More than one row.
        IKError: The path leaves the reach of the arm.
    """
    if len(grip_path) != 1:
        raise InputError(f"a joint path is made from one grip path, not from {len(grip_path)}")
    arm, r_max, control_dt = setup.arm, setup.workspace.r_max, setup.motion.control_dt
    start = float(grip_path.knots[0, 0])
    # Rounding must neither drop nor double the last tick.
    tick_count = int(np.ceil((grip_path.duration[0] - start) / control_dt - 1e-9)) + 1
    times = np.arange(tick_count, dtype=np.float64) * control_dt
    poses, velocities = (grip_path.evaluate(start + times, order)[0] for order in (0, 1))
    velocities[-1] = 0.0
    radius = np.hypot(poses[:, 0], poses[:, 1])
    if np.max(radius) > r_max:
        raise IKError(f"the grip would be {np.max(radius):.4f} m from the base: r_max is {r_max} m")
    motion = arm.inverse_motion(poses, velocities, np.zeros_like(poses))
    if not np.all(np.isfinite(motion.q)):
        # Raises, and names the pose that is out of reach.
        arm.inverse(poses)
    return JointPath(times=times, q=motion.q, qd=motion.qd)
