"""Draws: a cable that lies on the table is pulled slowly until its free end is at a place.

A draw starts where the last motion ended, without a reset. The gripper goes to where the cable is
straight, with its free end still where it was seen, and in line with the place it is drawn to. Then
it pulls straight on, and the free end follows along the line. Nothing of this depends on friction,
stiffness or mass, as long as it is slow: the length of the straight cable alone tells where the
free end stops.
"""

import dataclasses
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from cablecast.conventions import Array, xy_to_polar
from cablecast.errors import InputError, check_number
from cablecast.motion.grip_path import GripPath
from cablecast.motion.polar import check_finite
from cablecast.motion.trajectory import JointPath, follow
from cablecast.setup import Setup

SPEED = 0.12
"""Mean speed of the gripper [m/s], that of the pull of a polar cast."""

TURN_SPEED = 0.8
"""Mean speed at which the gripper turns [rad/s]."""

TIME_MIN = 0.5
"""Shortest duration of either of the two moves [s]."""

TURN_MAX = np.radians(100.0)
"""Largest turn of the gripper [rad]: beyond it, the gripper would come back over the cable."""


@dataclasses.dataclass(frozen=True)
class Draw:
    """One draw, from where the gripper stands and the free end lies.

    Attributes:
        grip_x, grip_y: Where the gripper is at the start [m].
        grip_yaw: Its heading there, from straight ahead, positive to the robot's right [rad].
        tip_x, tip_y: Where the free end lies at the start [m].
        to_x, to_y: Where it is drawn to [m].
        length: Distance from the gripper to the free end of the straight cable [m].
    """

    grip_x: float
    grip_y: float
    grip_yaw: float
    tip_x: float
    tip_y: float
    to_x: float
    to_y: float
    length: float

    family: ClassVar[str] = "draw"
    parameters: ClassVar[tuple[str, ...]] = (
        "draw_grip_x",
        "draw_grip_y",
        "draw_grip_yaw",
        "draw_tip_x",
        "draw_tip_y",
        "draw_to_x",
        "draw_to_y",
        "draw_length",
    )

    def __post_init__(self):
        check_finite("draw", self.to_array(), len(self.parameters))
        check_number("length of a draw", self.length, 0.01, 10.0, "m")
        if self.way < 1e-4:
            raise InputError("a draw to where the free end lies already is none")

    def __str__(self) -> str:
        (near, near_deg), (far, far_deg) = (
            (r, np.degrees(theta)) for r, theta in map(xy_to_polar, (self.to_xy, self.tip_xy))
        )
        return (
            f"the draw from {far:.3f} m at {far_deg:z.1f} deg to {near:.3f} m at {near_deg:z.1f} "
            "deg"
        )

    @classmethod
    def of(cls, pose: ArrayLike, tip_xy: ArrayLike, to_xy: ArrayLike, length: float) -> "Draw":
        """Return the draw from a pose of the gripper: x, y, z [m], yaw, pitch [rad], shape [5]."""
        x, y, _, yaw, _ = check_finite("pose of the gripper", pose, 5).tolist()
        tip, to = (check_finite("place", xy, 2).tolist() for xy in (tip_xy, to_xy))
        return cls(x, y, yaw, *tip, *to, length)

    @property
    def tip_xy(self) -> Array:
        """Where the free end lies at the start [m], shape [2]."""
        return np.array([self.tip_x, self.tip_y])

    @property
    def to_xy(self) -> Array:
        """Where it is drawn to [m], shape [2]."""
        return np.array([self.to_x, self.to_y])

    @property
    def way(self) -> float:
        """Distance that the free end is drawn [m]."""
        return float(np.linalg.norm(self.to_xy - self.tip_xy))

    @property
    def grip_xy(self) -> Array:
        """Places of the gripper: at the start, with the cable straight, at the end [m], [3, 2]."""
        along = (self.to_xy - self.tip_xy) / self.way
        ends = np.stack([self.tip_xy, self.to_xy]) + self.length * along
        return np.concatenate([[[self.grip_x, self.grip_y]], ends])

    @property
    def turn(self) -> float:
        """Turn of the gripper from its heading at the start to that of the straight cable [rad]."""
        back = self.tip_xy - self.to_xy
        turn = float(np.arctan2(*back)) - self.grip_yaw
        return float((turn + np.pi) % (2.0 * np.pi) - np.pi)

    def to_array(self) -> Array:
        """Return the parameters, shape [8]."""
        return np.array(dataclasses.astuple(self), dtype=float)

    @classmethod
    def from_array(cls, values: ArrayLike) -> "Draw":
        """Make a draw from its parameters, shape [8]."""
        return cls(*check_finite("draw", values, len(cls.parameters)).tolist())

    def mirrored(self) -> "Draw":
        """Return the draw that ends mirrored about the workspace axis."""
        signs = [-1.0 if "_x" in name or "yaw" in name else 1.0 for name in self.parameters]
        return Draw.from_array(self.to_array() * signs)

    def grip_path(self, setup: Setup) -> GripPath:
        """Return the path of the gripper, one row.

        Raises:
            InputError: The gripper would come back over the cable.
        """
        if abs(self.turn) > TURN_MAX:
            raise InputError(
                f"{self} turns the gripper by {np.degrees(self.turn):.0f} deg, over the cable: at "
                f"most {np.degrees(TURN_MAX):.0f} deg"
            )
        places, yaw = self.grip_xy, self.grip_yaw + np.array([0.0, self.turn, self.turn])
        ways = np.linalg.norm(np.diff(places, axis=0), axis=1)
        times = np.maximum(np.maximum(ways / SPEED, np.abs(np.diff(yaw)) / TURN_SPEED), TIME_MIN)
        poses = np.zeros((1, 3, 5))
        poses[0, :, :2], poses[0, :, 3] = places, yaw
        poses[0, :, 2] = setup.workspace.grip_height
        still = np.zeros_like(poses)
        return GripPath.from_hermite(
            np.concatenate([[0.0], np.cumsum(times)])[None], poses, still, still
        )

    def set_points(self, grip_path: GripPath, setup: Setup) -> JointPath:
        """Return the set points of the joints that follow the path of the gripper."""
        return follow(grip_path, setup, str(self), casting=True)

