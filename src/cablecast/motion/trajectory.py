"""Trajectory: one planned motion down to the set points of the joints, as every rig executes it."""

import dataclasses
import functools
from typing import ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.base import limit_violations
from cablecast.errors import IKError, InputError, JointLimitError
from cablecast.motion.grip_path import GripPath
from cablecast.motion.limits import check_grip_paths
from cablecast.setup import Setup


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointPath:
    """Set points of the joints at the robot's control cycle.

    Attributes:
        times: Times since the start of the motion, every control_dt up to the first tick at or
            after its end [s], shape [tick].
        q: Joint angles [rad], shape [tick, joint].
        qd: Joint rates, the exact derivative of the angles; zero at the end [rad/s], shape
            [tick, joint].
    """

    times: NDArray[np.float64]
    q: NDArray[np.float64]
    qd: NDArray[np.float64]

    def __post_init__(self):
        for name in ("times", "q", "qd"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=float))
        shape = (self.times.size, self.q.shape[-1] if self.q.ndim else 0)
        if self.q.shape != shape or self.qd.shape != shape:
            raise InputError(
                f"a joint path has shapes q {self.q.shape}, qd {self.qd.shape}: its {shape[0]} "
                f"ticks require {shape}"
            )

    @property
    def peak_speed(self) -> NDArray[np.float64]:
        """Largest speed of each joint [rad/s], shape [joint]."""
        return np.max(np.abs(self.qd), axis=0)


def joints_at(path: JointPath, times: ArrayLike) -> NDArray[np.float64]:
    """Return angles [rad], shape [time, joint], held before the first and after the last tick."""
    times = np.asarray(times, dtype=float)
    return np.stack([np.interp(times, path.times, q) for q in path.q.T], axis=-1)


def joint_path(grip_path: GripPath, setup: Setup) -> JointPath:
    """Return joint angles and rates that make the gripper follow a path of one row.

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


class Motion(Protocol):
    """What a cast is planned from: the parameters of one family of motions.

    `Action` is the sweep of the paper, `PolarCast` its baseline, `JointMove` a swing in the air.
    `MOTIONS` (`motion/families.py`) lists them all. Motions are immutable and hashable.

    Attributes:
        family: Name of the family in files.
        parameters: Names of the parameters, which are columns of datasets.
    """

    family: ClassVar[str]
    parameters: ClassVar[tuple[str, ...]]

    def to_array(self) -> NDArray[np.float64]:
        """Return the parameters, shape [parameter]."""
        ...

    @classmethod
    def from_array(cls, values: ArrayLike) -> Self:
        """Make a motion from its parameters.

        Raises:
            InputError: It is no motion of the family.
        """
        ...

    def mirrored(self) -> Self:
        """Return the motion that lands mirrored about the workspace axis."""
        ...

    def grip_path(self, setup: Setup) -> GripPath:
        """Return the path of the gripper, one row.

        Raises:
            InputError: There is none in this set-up.
        """
        ...

    def set_points(self, grip_path: GripPath, setup: Setup) -> JointPath:
        """Return the set points of the joints; `grip_path` is that of the motion in this set-up.

        Raises:
            JointLimitError: The motion violates limits; the message names each with its value.
        """
        ...


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trajectory:
    """One planned motion for a rig to execute.

    Attributes:
        action: What it was planned from; None for a motion that is not a cast.
        grip_path: Path of the gripper, one row.
        joint_path: Set points of the joints; None for a rig without joints.
    """

    action: Motion | None
    grip_path: GripPath
    joint_path: JointPath | None

    def __post_init__(self):
        if len(self.grip_path) != 1:
            raise InputError(f"a trajectory has one grip path, not {len(self.grip_path)}")

    @property
    def duration(self) -> float:
        """End time of the motion [s]."""
        return float(self.grip_path.duration[0])


def plan_trajectory(action: Motion, setup: Setup) -> Trajectory:
    """Plan a motion down to joint set points.

    Raises:
        InputError: There is no such motion in this set-up.
        JointLimitError: The motion violates limits; the message names each with its value.
    """
    return _planned(action, setup)


# A search plans each motion that it tries, and the chosen one is planned again to be played.
@functools.lru_cache(maxsize=16)
def _planned(action: Motion, setup: Setup) -> Trajectory:
    grip_path = action.grip_path(setup)
    path = action.set_points(grip_path, setup)
    return Trajectory(action=action, grip_path=grip_path, joint_path=path)


def follow(grip_path: GripPath, setup: Setup, what: str, *, casting: bool = False) -> JointPath:
    """Return the set points that follow a grip path of one row.

    Args:
        grip_path: Path of the gripper.
        setup: Set-up with the arm.
        what: Name of the motion in the error.
        casting: Whether the gripper must stay in front of the table's near edge.

    Raises:
        JointLimitError: The arm cannot follow; the message names each limit with its value.
    """
    feasibility = check_grip_paths(grip_path, setup, casting=casting)
    if not feasibility.mask[0]:
        raise JointLimitError(f"the arm cannot follow {what}: {feasibility.describe(0)}")
    return check_set_points(joint_path(grip_path, setup), setup, what)


def check_set_points(path: JointPath, setup: Setup, what: str) -> JointPath:
    """Return set points; raise JointLimitError if they ask for more than a limit.

    `check_grip_paths` looks at samples of the path. On a slow sweep close to the base they lie far
    apart, and a joint may peak between them. The set points are what the arm gets.
    """
    steps = np.diff(path.times)[:, None]
    arm = setup.arm
    asked = (
        path.q - arm.limits.middle,
        np.diff(path.q, axis=0) / steps,
        np.diff(path.qd, axis=0) / steps,
    )
    if peak := next(limit_violations(asked, arm.limits.to_array()), None):
        raise JointLimitError(
            f"the arm cannot follow {what}: its set points ask for {arm.joint_names[peak.joint]} "
            f"{peak.kind.name.lower()} {abs(peak.value):.4g} {peak.kind.value}, above "
            f"{peak.bound:.4g} {peak.kind.value}"
        )
    return path
