"""Inverse kinematics of a UR arm whose gripper points straight down, in closed form.

One branch (elbow up, arm stretched outwards), so that joint angles follow a continuous path without
jumps; its first two time derivatives are exact.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.geometry import ArmGeometry, Links

Array = NDArray[np.float64]


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
        base_yaw: Turn of the arm's base about the vertical, positive to the right [rad].
    """

    q: Array
    qd: Array
    qdd: Array
    radius: Array
    radius_min: Array
    radius_max: Array
    lead: Array
    base_yaw: float = 0.0

    def mirrored(self) -> "JointMotion":
        """Return the motion of the joints for the poses mirrored about the workspace axis.

        The arm is not symmetric: the base and the last wrist joint turn the other way but for the
        lead, and the other joints do the same.
        """
        turned = []
        for order, values in enumerate((self.q, self.qd, self.qdd)):
            values = values.copy(order="K")
            for joint in (0, 5):
                values[..., joint] = -values[..., joint] - 2.0 * self.lead[..., order]
            if order == 0:
                values[..., 0] += 2.0 * self.base_yaw
            turned.append(values)
        return dataclasses.replace(self, q=turned[0], qd=turned[1], qdd=turned[2])


def level_motion(arm: ArmGeometry, p: Array, v: Array, a: Array) -> JointMotion:
    """Return joint angles along moving poses of pitch 0, with exact rates and accelerations.

    The base turns the arm's plane, which holds the flange at the lateral offset d4; in that plane
    upper arm and forearm are a two-link arm that carries the first wrist joint; the wrist joints
    keep the tool down and turn the cable to its yaw.

    Args:
        arm: Geometry of the arm.
        p: x, y, z [m], yaw, pitch [rad], shape [..., 5].
        v: First derivatives, same shape.
        a: Second derivatives, same shape.

    Returns:
        Motion of the joints; NaN where a pose is out of reach.
    """
    links = arm.links
    x, dx, ddx, y, dy, ddy = _flange(arm.grip_offset, p, v, a)
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
        e = np.sqrt(rho2 - links.d4 * links.d4)
        de = rho * drho / e
        dde = (drho * drho + rho * ddrho - de * de) / e
        lead = np.arctan2(links.d4, e)
        dlead = -links.d4 * de / rho2
        ddlead = -links.d4 * (dde - 2.0 * de * drho / rho) / rho2
        q1, dq1, ddq1 = -azimuth - lead, -dazimuth - dlead, -ddazimuth - ddlead
        # First wrist joint as seen from the shoulder: out and up.
        height = p[..., 2] + (arm.gripper_length + links.d6 - arm.base_height - links.d1)
        upper, fore, rates, radius_min, radius_max = two_link(
            links, (e - links.d5, height), (de, v[..., 2]), (dde, a[..., 2])
        )
        (dupper, dfore), (ddupper, ddfore) = rates
        wrist_2 = np.full_like(q1, -np.pi / 2)
        zero = np.zeros_like(q1)
        q = [q1 + arm.base_yaw, -upper, upper - fore, fore - np.pi / 2, wrist_2, p[..., 3] + q1]
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
        base_yaw=arm.base_yaw,
    )


def _flange(o: float, p: Array, v: Array, a: Array) -> tuple[Array, ...]:
    """Return x and y of the flange with two derivatives, o [m] behind the grip."""
    if o == 0.0:
        return tuple(values[..., i] for i in (0, 1) for values in (p, v, a))
    yaw, dyaw, ddyaw = p[..., 3], v[..., 3], a[..., 3]
    s, c = o * np.sin(yaw), o * np.cos(yaw)
    return (
        p[..., 0] - s,
        v[..., 0] - c * dyaw,
        a[..., 0] - c * ddyaw + s * dyaw**2,
        p[..., 1] - c,
        v[..., 1] + s * dyaw,
        a[..., 1] + s * ddyaw + c * dyaw**2,
    )


def two_link(
    links: Links,
    place: tuple[Array, Array],
    rate: tuple[Array, Array],
    acceleration: tuple[Array, Array],
) -> tuple[Array, Array, tuple[tuple[Array, Array], tuple[Array, Array]], Array, Array]:
    """Return the elevations of both links that put the first wrist joint at a place, elbow up.

    Args:
        links: Lengths of the arm.
        place: Distance out and height up from the shoulder [m].
        rate: Their rates [m/s].
        acceleration: Their accelerations [m/s²].

    Returns:
        Elevation of the upper arm and of the forearm [rad], their rates and accelerations, and the
        radii of the flange between which the arm reaches this height [m].
    """
    upper_arm, forearm = links.upper_arm, links.forearm
    out, up = place
    span2 = out * out + up * up
    cos_elbow = (span2 - upper_arm**2 - forearm**2) / (2.0 * upper_arm * forearm)
    # NaN beyond the reach, on purpose: it marks the pose.
    sin_elbow = np.sqrt(1.0 - cos_elbow * cos_elbow)
    elbow = np.arctan2(sin_elbow, cos_elbow)
    upper = np.arctan2(up, out) + np.arctan2(forearm * sin_elbow, upper_arm + forearm * cos_elbow)
    fore = upper - elbow
    cu, su, cf, sf = np.cos(upper), np.sin(upper), np.cos(fore), np.sin(fore)
    # Differentiate out + i up = upper_arm exp(i upper) + forearm exp(i fore), and project on the
    # direction of one link to be rid of the other.
    dout, dup = rate
    dupper = -(dout * cf + dup * sf) / (upper_arm * sin_elbow)
    dfore = (dout * cu + dup * su) / (forearm * sin_elbow)
    pull_u, pull_f = upper_arm * dupper * dupper, forearm * dfore * dfore
    ddout = acceleration[0] + pull_u * cu + pull_f * cf
    ddup = acceleration[1] + pull_u * su + pull_f * sf
    ddupper = -(ddout * cf + ddup * sf) / (upper_arm * sin_elbow)
    ddfore = (ddout * cu + ddup * su) / (forearm * sin_elbow)

    def flange_radius(span: float) -> Array:
        reach = np.sqrt(np.maximum(span * span - up * up, 0.0)) + links.d5
        return np.sqrt(reach * reach + links.d4**2)

    bounds = flange_radius(upper_arm - forearm), flange_radius(upper_arm + forearm)
    return upper, fore, ((dupper, dfore), (ddupper, ddfore)), *bounds
