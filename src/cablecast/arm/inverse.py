"""Closed-form inverse kinematics of a UR arm whose gripper points straight down.

A single branch is used (elbow up, arm stretched outwards), so that joint angles do not jump along a
continuous path. The first two time derivatives are exact.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.geometry import ArmGeometry, Links

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointMotion:
    """Joint angles with their time derivatives; NaN where a pose is out of reach.

    Attributes:
        q: Angles [rad], shape [..., 6].
        qd: Rates [rad/s], same shape.
        qdd: Accelerations [rad/s²], same shape.
        radius: Distance from the base axis of the flange or, if the motion tilts the gripper, of
            the first wrist joint [m], shape [...].
        radius_min: Smallest radius that the arm reaches at this height [m], shape [...].
        radius_max: Largest radius that the arm reaches at this height [m], shape [...].
        lead: Angle from the arm's plane to the flange due to the shoulder offset, with its rate and
            acceleration [rad] and [s], shape [..., 3]; NaN if the motion tilts the gripper, since
            it then does not determine the mirrored motion.
        base_yaw: Rotation of the base about the vertical, positive to the right [rad].
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
        """Return the joint motion for the poses mirrored about the workspace axis.

        The arm is not symmetric. The base and the last wrist joint change sign and are corrected by
        the lead. The other joints move as before.
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

    The base joint turns the arm's plane; the flange has the lateral offset d4 from it. In that
    plane, upper arm and forearm are a two-link arm that carries the first wrist joint. The wrist
    joints keep the tool down and turn the cable to its yaw.

    Args:
        arm: Geometry of the arm.
        p: x, y, z [m], yaw, pitch [rad], shape [..., 5].
        v: First derivatives, same shape.
        a: Second derivatives, same shape.

    Returns:
        Joint motion; NaN where a pose is out of reach.
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
    # Keep each joint's values contiguous in memory: they are computed and read joint by joint.
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
    """Return x and y of the flange, `o` [m] behind the grip, with two derivatives."""
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
    """Return the elbow-up elevations of both links for a place of the first wrist joint.

    Args:
        links: Link lengths of the arm.
        place: Distance out and height up from the shoulder [m].
        rate: First derivatives of the place [m/s].
        acceleration: Second derivatives of the place [m/s²].

    Returns:
        Elevation of the upper arm and of the forearm [rad], their rates and accelerations, and the
        smallest and largest radius of the flange within reach at this height [m].
    """
    upper_arm, forearm = links.upper_arm, links.forearm
    out, up = place
    span2 = out * out + up * up
    cos_elbow = (span2 - upper_arm**2 - forearm**2) / (2.0 * upper_arm * forearm)
    # Intentionally NaN beyond the reach: it marks the pose.
    sin_elbow = np.sqrt(1.0 - cos_elbow * cos_elbow)
    elbow = np.arctan2(sin_elbow, cos_elbow)
    upper = np.arctan2(up, out) + np.arctan2(forearm * sin_elbow, upper_arm + forearm * cos_elbow)
    fore = upper - elbow
    cu, su, cf, sf = np.cos(upper), np.sin(upper), np.cos(fore), np.sin(fore)
    # Differentiate out + i up = upper_arm exp(i upper) + forearm exp(i fore), and project onto each
    # link, which eliminates the rate of that link.
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
