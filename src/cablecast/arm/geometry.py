"""Geometry of a UR arm that holds a cable: link lengths, mounting, gripper, forward kinematics.

The arm stands at the origin of the base frame (docs/conventions.md), `base_height` above the table.
"""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.checks import check_ranges
from cablecast.errors import InputError, UnknownNameError

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Links:
    """Lengths of an arm with the joint order of a UR [m], the first six by Denavit and Hartenberg.

    Attributes:
        d1: Height of the shoulder above the base.
        upper_arm: Length of the upper arm, -a2.
        forearm: Length of the forearm, -a3.
        d4: Lateral offset of the first wrist joint.
        d5: Offset between the first two wrist joints.
        d6: Distance from the last wrist joint to the flange.
        upper_aside: Distance along the shoulder's axis from the DH frames' plane to the upper arm.
        forearm_aside: The same distance to the forearm.
        girth: Thickness of the arm as a multiple of a UR5's [-].
    """

    d1: float
    upper_arm: float
    forearm: float
    d4: float
    d5: float
    d6: float
    upper_aside: float
    forearm_aside: float
    girth: float = 1.0


# Sources: Universal Robots, "DH parameters for calculations of kinematics and dynamics" (support
# article), for the DH lengths; factory calibrations of single arms differ by up to millimetres.
# Universal_Robots_ROS2_Description, physical_parameters.yaml of each model, for the distances aside
# (shoulder_offset and elbow_offset). The girth is the ratio of the footprints on the data sheets
# (128, 149 and 190 mm), but a UR3 counts as thick as a UR5, which is on the safe side.
LINKS = {
    "ur3": Links(
        d1=0.1519,
        upper_arm=0.24365,
        forearm=0.21325,
        d4=0.11235,
        d5=0.08535,
        d6=0.0819,
        upper_aside=0.1198,
        forearm_aside=0.0275,
    ),
    "ur3e": Links(
        d1=0.15185,
        upper_arm=0.24355,
        forearm=0.2132,
        d4=0.13105,
        d5=0.08535,
        d6=0.0921,
        upper_aside=0.12,
        forearm_aside=0.027,
    ),
    "ur5": Links(
        d1=0.089159,
        upper_arm=0.425,
        forearm=0.39225,
        d4=0.10915,
        d5=0.09465,
        d6=0.0823,
        upper_aside=0.136,
        forearm_aside=0.016,
    ),
    "ur5e": Links(
        d1=0.1625,
        upper_arm=0.425,
        forearm=0.3922,
        d4=0.1333,
        d5=0.0997,
        d6=0.0996,
        upper_aside=0.138,
        forearm_aside=0.007,
    ),
    "ur10": Links(
        d1=0.1273,
        upper_arm=0.612,
        forearm=0.5723,
        d4=0.163941,
        d5=0.1157,
        d6=0.0922,
        upper_aside=0.220941,
        forearm_aside=0.049042,
        girth=1.28,
    ),
    "ur10e": Links(
        d1=0.1807,
        upper_arm=0.6127,
        forearm=0.57155,
        d4=0.17415,
        d5=0.11985,
        d6=0.11655,
        upper_aside=0.1762,
        forearm_aside=0.0393,
        girth=1.28,
    ),
}

ARM_MODELS = tuple(LINKS)

_DH_ALPHA = np.array([np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0])
_COS_ALPHA, _SIN_ALPHA = np.cos(_DH_ALPHA), np.sin(_DH_ALPHA)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArmGeometry:
    """Lengths and mounting of an arm with a gripper that points down and holds the cable sideways.

    The defaults reproduce the paper's r_max = 0.94 m. With the tool down, the flange of a stretched
    UR5 is 0.918 m from the base axis if the first wrist joint is level with the shoulder:
    base_height + d1 = grip_height + gripper_length + d6. That gives a base height of 0.183 m for a
    gripper of 0.17 m (a common two-finger gripper with its fingertips). The cable leaves the
    fingers 0.022 m in front of the flange axis, the width of a fingertip, so the grip reaches
    0.940 m. At this height all radii from 0.2 to 0.94 m are within reach.

    Attributes:
        model: Name of the arm, one of `ARM_MODELS`.
        base_height: Height of the robot's base above the table's surface [m].
        base_yaw_deg: Rotation of the base about the vertical, positive to the right [deg]. At 0 the
            arm points along y when its first joint is at zero.
        gripper_length: Distance from the flange down to the axis of the gripped cable [m].
        grip_offset: Distance along the cable from the flange axis to the point where the cable
            leaves the fingers [m].
        measured: Whether the five values above were measured on the real robot. A motion for a
            robot is saved only if this is true.
    """

    model: str = "ur5"
    base_height: float = 0.183
    base_yaw_deg: float = 0.0
    gripper_length: float = 0.17
    grip_offset: float = 0.022
    measured: bool = False

    def __post_init__(self):
        if self.model not in LINKS:
            raise UnknownNameError(
                f"unknown arm model {str(self.model)[:40]!r}: one of {', '.join(ARM_MODELS)}"
            )
        check_ranges(
            self,
            {
                "base_height": (-1.0, 2.0, "m"),
                "base_yaw_deg": (-180.0, 180.0, "deg"),
                "gripper_length": (0.0, 1.0, "m"),
                "grip_offset": (0.0, 0.5, "m"),
            },
            "arm",
        )
        if not isinstance(self.measured, bool):
            raise InputError(f"arm measured = {self.measured!r} must be true or false")

    @property
    def links(self) -> Links:
        """Link lengths of the model."""
        return LINKS[self.model]

    @property
    def base_yaw(self) -> float:
        """Rotation of the base about the vertical, positive to the right [rad]."""
        return float(np.radians(self.base_yaw_deg))

    def forward(self, q: ArrayLike) -> Array:
        """Return the pose of the flange in the base frame.

        Args:
            q: Joint angles [rad], shape [..., 6].

        Returns:
            T_base_flange, shape [..., 4, 4]; z of the flange points out of it.
        """
        return self.frames(q)[-1]

    def frames(self, q: ArrayLike) -> list[Array]:
        """Return the poses of the DH frames in the base frame.

        Args:
            q: Joint angles [rad], shape [..., 6].

        Returns:
            Seven poses, each of shape [..., 4, 4]: joint k turns about z of frame k, and the last
            frame is the flange.
        """
        q = np.asarray(q, dtype=float)
        T = np.zeros((*q.shape[:-1], 4, 4))
        # In the DH convention, the arm points along -x of its base when its first joint is at zero.
        c, s = np.cos(self.base_yaw), np.sin(self.base_yaw)
        T[..., :3, :3] = [[-s, c, 0.0], [-c, -s, 0.0], [0.0, 0.0, 1.0]]
        T[..., 2, 3] = self.base_height
        T[..., 3, 3] = 1.0
        frames = [T]
        links = self.links
        a = np.array([0.0, -links.upper_arm, -links.forearm, 0.0, 0.0, 0.0])
        c, s = np.cos(q), np.sin(q)
        steps = np.zeros((*q.shape, 4, 4))
        steps[..., 0, 0], steps[..., 0, 1] = c, -s * _COS_ALPHA
        steps[..., 0, 2], steps[..., 0, 3] = s * _SIN_ALPHA, a * c
        steps[..., 1, 0], steps[..., 1, 1] = s, c * _COS_ALPHA
        steps[..., 1, 2], steps[..., 1, 3] = -c * _SIN_ALPHA, a * s
        steps[..., 2, 1], steps[..., 2, 2] = _SIN_ALPHA, _COS_ALPHA
        steps[..., 2, 3] = (links.d1, 0.0, 0.0, links.d4, links.d5, links.d6)
        steps[..., 3, 3] = 1.0
        for joint in range(q.shape[-1]):
            T = T @ steps[..., joint, :, :]
            frames.append(T)
        return frames

    def grip_pose(self, q: ArrayLike) -> Array:
        """Return the pose of the gripped cable end.

        Args:
            q: Joint angles [rad], shape [..., 6].

        Returns:
            x, y, z [m], yaw, pitch [rad] as in a GripPath, shape [..., 5].
        """
        T = self.forward(q)
        # The cable leaves the fingers along -y of the flange, whose z points down.
        along = -T[..., :3, 1]
        position = T[..., :3, 3] + self.gripper_length * T[..., :3, 2] + self.grip_offset * along
        yaw = np.arctan2(along[..., 0], along[..., 1])
        pitch = np.arcsin(np.clip(along[..., 2], -1.0, 1.0))
        return np.concatenate([position, yaw[..., None], pitch[..., None]], axis=-1)
