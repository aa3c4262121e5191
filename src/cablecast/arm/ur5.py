"""Kinematics of a UR5, vectorised over many poses; fastest where its gripper points straight down.

The arm stands at the origin of the base frame (docs/conventions.md) on a socket of `base_height`
and is turned so that, seen from above, it points along y when its first joint is at zero. The
inverse is one closed-form branch (elbow up, arm stretched outwards), so that joint angles follow a
continuous path without jumps; its first two time derivatives are exact.
"""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.limits import JointLimits
from cablecast.errors import IKError, InputError

Array = NDArray[np.float64]

# Denavit-Hartenberg lengths of the UR5 [m], as published by its maker.
D1, A2, A3, D4, D5, D6 = 0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823
UPPER_ARM, FOREARM = -A2, -A3

_DH_A = (0.0, A2, A3, 0.0, 0.0, 0.0)
_DH_D = (D1, 0.0, 0.0, D4, D5, D6)
_DH_ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
# The base frame of the DH convention, whose arm points along -x, in our frame, where it points
# along y.
_R_WORLD_BASE = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointMotion:
    """Joint angles with their time derivatives; NaN where the arm does not reach.

    Attributes:
        q: Angles [rad], shape [..., 6].
        qd: Rates [rad/s], same shape.
        qdd: Accelerations [rad/s²], same shape.
        radius: Distance of the flange from the base axis, or of the first wrist joint where the
            motion tilts the gripper [m], shape [...].
        radius_min: Smallest such distance that the arm reaches at this height [m], shape [...].
        radius_max: Largest [m], shape [...].
        lead: Angle from the arm's plane to the flange, which the shoulder's offset makes, with its
            rate and acceleration [rad] and [s], shape [..., 3]; NaN where the motion tilts the
            gripper, for then it does not tell the mirrored motion.
    """

    q: Array
    qd: Array
    qdd: Array
    radius: Array
    radius_min: Array
    radius_max: Array
    lead: Array

    def mirrored(self) -> "JointMotion":
        """The motion of the joints for the poses mirrored about the workspace axis.

        The arm is not symmetric: the base and the last wrist joint turn the other way but for the
        lead, and the other joints do the same.
        """
        turned = []
        for order, values in enumerate((self.q, self.qd, self.qdd)):
            values = values.copy(order="K")
            for joint in (0, 5):
                values[..., joint] = -values[..., joint] - 2.0 * self.lead[..., order]
            turned.append(values)
        return dataclasses.replace(self, q=turned[0], qd=turned[1], qdd=turned[2])


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArmUR5:
    """A UR5 over the table with a gripper that points down and holds the cable sideways.

    The defaults make sense of the paper's r_max = 0.94 m. With the tool down, the flange of a
    stretched UR5 is 0.918 m from the base axis, if the first wrist joint is level with the
    shoulder: base_height + D1 = grip_height + gripper_length + D6, which gives the socket's 0.183 m
    with a gripper of 0.17 m (a common two-finger gripper with its fingertips). The cable leaves the
    fingers 0.022 m in front of the flange's axis, the width of a fingertip, and so the grip reaches
    0.940 m. At this height all radii from 0.2 to 0.94 m are within reach.

    Attributes:
        base_height: Height of the robot's base above the table's surface [m].
        gripper_length: From the flange down to the gripped cable's axis [m].
        grip_offset: From the flange's axis to where the cable leaves the fingers, along the cable
            [m].
        limits: Limits of the joints.
    """

    base_height: float = 0.183
    gripper_length: float = 0.17
    grip_offset: float = 0.022
    limits: JointLimits = dataclasses.field(default_factory=JointLimits)

    def __post_init__(self):
        for name, low, high in (
            ("base_height", -1.0, 2.0),
            ("gripper_length", 0.0, 1.0),
            ("grip_offset", 0.0, 0.5),
        ):
            value = getattr(self, name)
            if not isinstance(value, (int, float)) or not low <= value <= high:
                raise InputError(f"{name} = {value} m is outside [{low:g}, {high:g}]")

    def forward(self, q: ArrayLike) -> Array:
        """Pose of the flange in the base frame.

        Args:
            q: Joint angles [rad], shape [..., 6].

        Returns:
            T_base_flange, shape [..., 4, 4]; z of the flange points out of it.
        """
        return self.frames(q)[-1]

    def frames(self, q: ArrayLike) -> list[Array]:
        """Poses of the frames of the DH convention in the base frame.

        Args:
            q: Joint angles [rad], shape [..., 6].

        Returns:
            Seven poses, each of shape [..., 4, 4]: joint k turns about z of frame k, and the last
            frame is the flange.
        """
        q = np.asarray(q, dtype=float)
        T = np.zeros((*q.shape[:-1], 4, 4))
        T[..., :3, :3] = _R_WORLD_BASE
        T[..., 2, 3] = self.base_height
        T[..., 3, 3] = 1.0
        frames = [T]
        for joint, (a, d, alpha) in enumerate(zip(_DH_A, _DH_D, _DH_ALPHA, strict=True)):
            c, s = np.cos(q[..., joint]), np.sin(q[..., joint])
            ca, sa = np.cos(alpha), np.sin(alpha)
            step = np.zeros_like(T)
            step[..., 0, 0], step[..., 0, 1] = c, -s * ca
            step[..., 0, 2], step[..., 0, 3] = s * sa, a * c
            step[..., 1, 0], step[..., 1, 1] = s, c * ca
            step[..., 1, 2], step[..., 1, 3] = -c * sa, a * s
            step[..., 2, 1], step[..., 2, 2], step[..., 2, 3] = sa, ca, d
            step[..., 3, 3] = 1.0
            T = T @ step
            frames.append(T)
        return frames

    def grip_pose(self, q: ArrayLike) -> Array:
        """Pose of the gripped cable end.

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

    def inverse(self, poses: ArrayLike) -> Array:
        """Joint angles that bring the gripped end to some poses.

        Args:
            poses: x, y, z [m], yaw, pitch [rad], shape [..., 5].

        Returns:
            Joint angles [rad], shape [..., 6]; the same branch everywhere.

        Raises:
            IKError: A pose is out of reach.
        """
        poses = np.asarray(poses, dtype=float)
        still = np.zeros_like(poses)
        motion = self.inverse_motion(poses, still, still)
        bad = ~np.all(np.isfinite(motion.q), axis=-1)
        if np.any(bad):
            radius, low, high = (
                float(values[bad][0])
                for values in (motion.radius, motion.radius_min, motion.radius_max)
            )
            part = "first wrist joint" if np.any(_tilted(poses)) else "flange"
            raise IKError(
                f"the arm does not reach the grip at x, y, z = "
                f"{poses[bad][0][:3].round(4).tolist()} m: its {part} would be {radius:.4f} m from "
                f"the base axis, outside [{low:.4f}, {high:.4f}]"
            )
        return motion.q

    def inverse_motion(
        self, poses: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike
    ) -> JointMotion:
        """Joint angles along moving poses, with exact rates and accelerations.

        The closed form: the base turns the arm's plane, which holds the flange at the lateral
        offset D4; in that plane upper arm and forearm are a two-link arm that carries the first
        wrist joint; the wrist joints keep the tool down and turn the cable to its yaw.

        Args:
            poses: x, y, z [m], yaw, pitch [rad], shape [..., 5]. Where any is tilted, all are
                solved by the slower general form of arm/tilted.py.
            velocities: Their first derivatives, same shape.
            accelerations: Their second derivatives, same shape.

        Returns:
            The motion of the joints; NaN where a pose is out of reach.
        """
        p, v, a = (np.asarray(values, dtype=float) for values in (poses, velocities, accelerations))
        if np.any(_tilted(p)):
            from cablecast.arm.tilted import tilted_motion

            return tilted_motion(self, p, v, a)
        x, dx, ddx, y, dy, ddy = self._flange(p, v, a)
        with np.errstate(invalid="ignore", divide="ignore"):
            # Polar coordinates of the flange: azimuth (positive to the right) and radius.
            rho2 = x * x + y * y
            rho = np.sqrt(rho2)
            drho = (x * dx + y * dy) / rho
            ddrho = (dx * dx + dy * dy + x * ddx + y * ddy - drho * drho) / rho
            azimuth = np.arctan2(x, y)
            dazimuth = (y * dx - x * dy) / rho2
            ddazimuth = (y * ddx - x * ddy - 2.0 * rho * drho * dazimuth) / rho2
            # Distance within the arm's plane, and the angle by which the plane leads the flange.
            e = np.sqrt(rho2 - D4 * D4)
            de = rho * drho / e
            dde = (drho * drho + rho * ddrho - de * de) / e
            lead = np.arctan2(D4, e)
            dlead = -D4 * de / rho2
            ddlead = -D4 * (dde - 2.0 * de * drho / rho) / rho2
            q1, dq1, ddq1 = -azimuth - lead, -dazimuth - dlead, -ddazimuth - ddlead
            # First wrist joint as seen from the shoulder: out and up.
            height = p[..., 2] + (self.gripper_length + D6 - self.base_height - D1)
            upper, fore, rates, radius_min, radius_max = two_link(
                (e - D5, height), (de, v[..., 2]), (dde, a[..., 2])
            )
            (dupper, dfore), (ddupper, ddfore) = rates
            wrist_2 = np.full_like(q1, -np.pi / 2)
            zero = np.zeros_like(q1)
            q = [q1, -upper, upper - fore, fore - np.pi / 2, wrist_2, p[..., 3] + q1]
            qd = [dq1, -dupper, dupper - dfore, dfore, zero, v[..., 3] + dq1]
            qdd = [ddq1, -ddupper, ddupper - ddfore, ddfore, zero, a[..., 3] + ddq1]
        # Each joint's values lie together in memory: that is how they are computed and looked at.
        motion = [np.moveaxis(np.stack(columns), 0, -1) for columns in (q, qd, qdd)]
        lost = np.isnan(upper) | np.isnan(e)
        if np.any(lost):
            for values in motion:
                values[lost] = np.nan
        return JointMotion(
            q=motion[0],
            qd=motion[1],
            qdd=motion[2],
            radius=rho,
            radius_min=radius_min,
            radius_max=radius_max,
            lead=np.moveaxis(np.stack([lead, dlead, ddlead]), 0, -1),
        )

    def _flange(self, p: Array, v: Array, a: Array) -> tuple[Array, ...]:
        """x and y of the flange with two derivatives: the cable leaves in front of its axis."""
        if self.grip_offset == 0.0:
            return tuple(values[..., i] for i in (0, 1) for values in (p, v, a))
        o, yaw, dyaw, ddyaw = self.grip_offset, p[..., 3], v[..., 3], a[..., 3]
        s, c = o * np.sin(yaw), o * np.cos(yaw)
        return (
            p[..., 0] - s,
            v[..., 0] - c * dyaw,
            a[..., 0] - c * ddyaw + s * dyaw**2,
            p[..., 1] - c,
            v[..., 1] + s * dyaw,
            a[..., 1] + s * ddyaw + c * dyaw**2,
        )


def _tilted(poses: Array) -> NDArray[np.bool_]:
    """Which poses are tilted by more than rounding."""
    return np.abs(poses[..., 4]) > 1e-9


def two_link(
    place: tuple[Array, Array], rate: tuple[Array, Array], acceleration: tuple[Array, Array]
) -> tuple[Array, Array, tuple[tuple[Array, Array], tuple[Array, Array]], Array, Array]:
    """Elevations of upper arm and forearm that put the first wrist joint at a place, elbow up.

    Args:
        place: Distance out and height up from the shoulder [m].
        rate: Their rates [m/s].
        acceleration: Their accelerations [m/s²].

    Returns:
        Elevation of the upper arm and of the forearm [rad], their rates and accelerations, and the
        radii of the flange between which the arm reaches this height [m].
    """
    out, up = place
    span2 = out * out + up * up
    cos_elbow = (span2 - UPPER_ARM**2 - FOREARM**2) / (2.0 * UPPER_ARM * FOREARM)
    # NaN beyond the reach, on purpose: it marks the pose.
    sin_elbow = np.sqrt(1.0 - cos_elbow * cos_elbow)
    elbow = np.arctan2(sin_elbow, cos_elbow)
    upper = np.arctan2(up, out) + np.arctan2(FOREARM * sin_elbow, UPPER_ARM + FOREARM * cos_elbow)
    fore = upper - elbow
    cu, su, cf, sf = np.cos(upper), np.sin(upper), np.cos(fore), np.sin(fore)
    # Differentiate out + i up = UPPER_ARM exp(i upper) + FOREARM exp(i fore), and project on the
    # direction of one link to be rid of the other.
    dout, dup = rate
    dupper = -(dout * cf + dup * sf) / (UPPER_ARM * sin_elbow)
    dfore = (dout * cu + dup * su) / (FOREARM * sin_elbow)
    pull_u, pull_f = UPPER_ARM * dupper * dupper, FOREARM * dfore * dfore
    ddout = acceleration[0] + pull_u * cu + pull_f * cf
    ddup = acceleration[1] + pull_u * su + pull_f * sf
    ddupper = -(ddout * cf + ddup * sf) / (UPPER_ARM * sin_elbow)
    ddfore = (ddout * cu + ddup * su) / (FOREARM * sin_elbow)

    def flange_radius(span: float) -> Array:
        reach = np.sqrt(np.maximum(span * span - up * up, 0.0)) + D5
        return np.sqrt(reach * reach + D4 * D4)

    bounds = flange_radius(UPPER_ARM - FOREARM), flange_radius(UPPER_ARM + FOREARM)
    return upper, fore, ((dupper, dfore), (ddupper, ddfore)), *bounds
