"""A UR arm that holds a cable: link lengths, mounting, gripper, limits, kinematics both ways.

The arm stands at the origin of the base frame (docs/conventions.md), `base_height` above the table.

Inverse kinematics uses a single branch (elbow up, arm stretched outwards), so that joint angles do
not jump along a continuous path; the first two time derivatives are exact. A gripper that points
straight down has a closed form, which is fast. For one that tilts in the vertical plane of its
cable, the six joints are solved for a full pose on the same branch, so that a motion may start
untilted and tilt on the way.
"""

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.base import (
    Arm,
    Array,
    JointLimits,
    JointMotion,
    Links,
    directions,
    flange_motion,
    jacobian,
    polar_motion,
    rod_ends,
)
from cablecast.errors import InputError, UnknownNameError, check_keys

JOINT_NAMES = ("base", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3")


@dataclasses.dataclass(frozen=True)
class Lengths:
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
# (128, 149 and 190 mm), but a UR3 counts as thick as a UR5, which is on the safe side. That of a
# UR20 and UR30 is our guess. The lengths of ur7e, ur12e, ur16e and ur30 were read in a public table
# that cites it; of the two pairs of arm lengths that the ROS files state for the ur30,
# these are the link lengths. The limits of ur7e and ur12e are taken as those of ur5e and ur10e.
LINKS = {
    # d1, upper_arm, forearm, d4, d5, d6, upper_aside, forearm_aside, girth
    "ur3": Lengths(0.1519, 0.24365, 0.21325, 0.11235, 0.08535, 0.0819, 0.1198, 0.0275),
    "ur3e": Lengths(0.15185, 0.24355, 0.2132, 0.13105, 0.08535, 0.0921, 0.12, 0.027),
    "ur5": Lengths(0.089159, 0.425, 0.39225, 0.10915, 0.09465, 0.0823, 0.136, 0.016),
    "ur5e": Lengths(0.1625, 0.425, 0.3922, 0.1333, 0.0997, 0.0996, 0.138, 0.007),
    "ur10": Lengths(0.1273, 0.612, 0.5723, 0.163941, 0.1157, 0.0922, 0.220941, 0.049042, 1.28),
    "ur10e": Lengths(0.1807, 0.6127, 0.57155, 0.17415, 0.11985, 0.11655, 0.1762, 0.0393, 1.28),
    "ur7e": Lengths(0.1625, 0.425, 0.3922, 0.1333, 0.0997, 0.0996, 0.138, 0.007),
    "ur12e": Lengths(0.1807, 0.6127, 0.57155, 0.17415, 0.11985, 0.11655, 0.1762, 0.0393, 1.28),
    "ur16e": Lengths(0.1807, 0.4784, 0.36, 0.17415, 0.11985, 0.11655, 0.176, 0.04, 1.28),
    "ur20": Lengths(0.2363, 0.862, 0.7287, 0.201, 0.1593, 0.1543, 0.26, 0.043, 1.65),
    "ur30": Lengths(0.2363, 0.637, 0.5037, 0.201, 0.1593, 0.1543, 0.26, 0.043, 1.65),
}

_UNKNOWN = ("ur8long", "ur15", "ur18")
"""Models whose numbers we have not seen from the maker."""

ARM_MODELS = tuple(LINKS)

# Cosine and sine of the angle between each joint and the next, alpha of Denavit and Hartenberg.
_COS_ALPHA = np.array([0.0, 1.0, 1.0, 0.0, 0.0, 1.0])
_SIN_ALPHA = np.array([1.0, 0.0, 0.0, 1.0, -1.0, 0.0])

# A pose with less pitch counts as level [rad].
_LEVEL = 1e-9


_RADII = {
    "foot": (0.095, 0.095),
    "base": (0.075, 0.08),
    "shoulder": (0.062, 0.075),
    "upper arm": (0.056, 0.065),
    "elbow": (0.053, 0.06),
    "forearm": (0.043, 0.055),
    "wrist 1": (0.041, 0.05),
    "wrist 2": (0.041, 0.05),
    "wrist 3": (0.041, 0.05),
}
"""Radius of each link of a UR5, read off the maker's drawings, and rounded up, for distances to
keep [m]. The foot reaches from the table to the base, and is not the arm's own."""

_OTHERS: dict[str, dict[str, tuple[float, ...]]] = {
    "ur3": {"velocity": (np.pi,) * 3 + (2 * np.pi,) * 3},
    "ur10": {
        "velocity": (2 * np.pi / 3,) * 2 + (np.pi,) * 4,
        "acceleration": (14.0, 14.0, 20.0, 40.0, 40.0, 40.0),
    },
    "ur20": {
        "velocity": tuple(np.radians((120, 120, 150, 210, 210, 210)).tolist()),
        "acceleration": (10.0, 10.0, 14.0, 40.0, 40.0, 40.0),
    },
}
_OTHERS |= {"ur12": _OTHERS["ur10"], "ur16": _OTHERS["ur10"], "ur30": _OTHERS["ur20"]}
"""Limits of the arms of other sizes that differ from those of a UR5, for both series."""


def ur_limits(model: str = "ur5") -> JointLimits:
    """Return the limits of a model.

    Position and velocity limits are from the manufacturer's user manuals and data sheets (±360 deg;
    180 deg/s for all joints, but 360 deg/s for the wrists of a UR3; 120 deg/s for base and shoulder
    of a UR10, UR12e and UR16e; 120, 150 and 210 deg/s for base and shoulder, elbow and wrists of a
    UR20 and UR30), which state no acceleration limits. The three large joints get 20 rad/s²,
    but base and shoulder of a UR10 14 rad/s², those of a UR20 10 rad/s². Stretched out with a
    gripper of 1 kg, this takes at most 60 % of the torque that the maker states for the base joint
    (56, 150 and 330 N·m), with the masses of his table (tests/arm/test_limits.py). The wrist joints
    carry little and get 40 rad/s², the largest value that the controller accepts.
    """
    ur5 = {
        "position": (2 * np.pi,) * 6,
        "velocity": (np.pi,) * 6,
        "acceleration": (20.0, 20.0, 20.0, 40.0, 40.0, 40.0),
    }
    return JointLimits(**ur5 | _OTHERS.get(model.removesuffix("e"), {}))


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArmUR(Arm):
    """A UR arm at the table, with a gripper that points down and holds the cable sideways.

    The defaults reproduce the paper's r_max = 0.94 m. With the tool down, the flange of a stretched
    UR5 is 0.918 m from the base axis if the first wrist joint is level with the shoulder:
    base_height + d1 = grip_height + gripper_length + d6. That gives a base height of 0.183 m for a
    gripper of 0.17 m (a common two-finger gripper with its fingertips). The cable leaves the
    fingers 0.022 m in front of the flange axis, the width of a fingertip, so the grip reaches
    0.940 m. At this height all radii from 0.2 to 0.94 m are within reach.

    Attributes:
        model: Name of the arm, one of `ARM_MODELS`.
        base_yaw_deg: At 0 the arm points along y when its first joint is at zero.
        limits: Joint limits; those of `ur_limits` by default.
    """

    solves_exactly = True

    model: str = "ur5"
    base_height: float = 0.183

    def __post_init__(self):
        if not isinstance(self.model, str):
            raise InputError(f"arm model = {str(self.model)[:40]!r} is not text")
        if self.model in _UNKNOWN:
            raise UnknownNameError(
                f"the maker's numbers of the {self.model} are not known here: describe the arm by "
                "its URDF file, see docs/lab.md"
            )
        if self.model not in LINKS:
            plain = "".join(filter(str.isalnum, self.model)).lower()
            meant = f"write {plain}" if plain in LINKS else f"one of {', '.join(ARM_MODELS)}"
            raise UnknownNameError(
                f"unknown arm model {self.model[:40]!r}: {meant}; for an arm of another maker give "
                "`file:` with its URDF or MJCF, see docs/lab.md"
            )
        if self.limits == Arm.limits:
            object.__setattr__(self, "limits", ur_limits(self.model))
        super().__post_init__()

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "ArmUR":
        """Make an arm from plain values; missing keys take their defaults.

        Raises:
            InputError: A key is unknown, or a value out of bounds.
            UnknownNameError: There is no such model.
        """
        values = check_keys(values, {field.name for field in dataclasses.fields(cls)}, "arm")
        limits = values.pop("limits", {})
        arm = cls(**values)
        return dataclasses.replace(
            arm, limits=JointLimits.from_dict(limits, 6, dataclasses.asdict(arm.limits))
        )

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the six joints."""
        return JOINT_NAMES

    @property
    def lengths(self) -> Lengths:
        """Link lengths of the model."""
        return LINKS[self.model]

    @functools.cached_property
    def offsets_at_zero(self) -> tuple[Array, Array]:
        """Offsets of Denavit and Hartenberg as matrices; see `Arm.offsets_at_zero`."""
        first = np.eye(4)
        # In the DH convention, the arm points along -x of its base when its first joint is at zero.
        c, s = np.cos(self.base_yaw), np.sin(self.base_yaw)
        first[:3, :3] = [[-s, c, 0.0], [-c, -s, 0.0], [0.0, 0.0, 1.0]]
        first[2, 3] = self.base_height
        links = self.lengths
        offsets = np.tile(np.eye(4), (6, 1, 1))
        offsets[:, 0, 3] = (0.0, -links.upper_arm, -links.forearm, 0.0, 0.0, 0.0)
        offsets[:, 2, 3] = (links.d1, 0.0, 0.0, links.d4, links.d5, links.d6)
        offsets[:, 1, 1] = offsets[:, 2, 2] = _COS_ALPHA
        offsets[:, 1, 2], offsets[:, 2, 1] = -_SIN_ALPHA, _SIN_ALPHA
        return first, offsets

    def inverse_motion(
        self, poses: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike
    ) -> JointMotion:
        """Return joint angles along moving poses; see `Arm.inverse_motion`. Rates are exact.

        If any pose is tilted, all are solved by the slower general form.
        """
        p, v, a = (np.asarray(values, dtype=float) for values in (poses, velocities, accelerations))
        solve = tilted_motion if np.any(_tilted(p)) else _level_motion
        return solve(self, p, v, a)

    def _radius_of(self, poses: Array) -> str:
        return "first wrist joint" if np.any(_tilted(poses)) else "flange"

    def links(self, frames: list[Array]) -> Links:
        """Return the links at the poses that `frames` returned."""
        base, shoulder, elbow, wrist_1, wrist_2, wrist_3, flange = (T[..., :3, 3] for T in frames)
        across = frames[1][..., :3, 2]
        outer, inner = self.lengths.upper_aside * across, self.lengths.forearm_aside * across
        rods = [
            (base * [1.0, 1.0, 0.0], base),
            (base, shoulder),
            (shoulder, shoulder + outer),
            (shoulder + outer, elbow + outer),
            (elbow + outer, elbow + inner),
            (elbow + inner, wrist_1 + inner),
            (wrist_1 + inner, wrist_2),
            (wrist_2, wrist_3),
            (wrist_3, flange),
        ]
        drawn, safe = self.lengths.girth * np.array(list(_RADII.values())).T
        return Links(names=tuple(_RADII), ends=rod_ends(rods), drawn=drawn, safe=safe)

    def self_pairs(self, names: tuple[str, ...]) -> list[tuple[str, str]]:
        """Return which of the moving links and the gripper can meet when the arm folds."""
        return [
            (low, high)
            for low in ("base", "shoulder", "upper arm")
            for high in ("wrist 2", "wrist 3", "gripper")
            if (low, high) != ("upper arm", "wrist 3")
        ]


def _level_motion(arm: ArmUR, p: Array, v: Array, a: Array) -> JointMotion:
    """Return the motion of the joints along poses `p` of pitch 0, their rates and accelerations.

    The base joint turns the arm's plane; the flange has the lateral offset d4 from it. In that
    plane, upper arm and forearm are a two-link arm that carries the first wrist joint. The wrist
    joints keep the tool down and turn the cable to its yaw.
    """
    links = arm.lengths
    with np.errstate(invalid="ignore", divide="ignore"):
        polar = polar_motion(*flange_motion(arm.grip_offset, p, v, a))
        (rho, drho, ddrho), (azimuth, dazimuth, ddazimuth), rho2 = polar
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
        upper, fore, rates, radius_min, radius_max = _two_link(
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
    radii: Any = {"radius": rho, "radius_min": radius_min, "radius_max": radius_max}

    def mirrored() -> JointMotion:
        # The arm is not symmetric. The base and the last wrist joint change sign and are corrected
        # by the lead. The other joints move as before.
        turned = [values.copy(order="K") for values in motion]
        for values, order in zip(turned, (lead, dlead, ddlead), strict=True):
            for joint in (0, 5):
                values[..., joint] = -values[..., joint] - 2.0 * order
        turned[0][..., 0] += 2.0 * arm.base_yaw
        return JointMotion(q=turned[0], qd=turned[1], qdd=turned[2], **radii)

    return JointMotion(q=motion[0], qd=motion[1], qdd=motion[2], mirrored=mirrored, **radii)


def _two_link(
    links: Lengths,
    place: tuple[Array, Array],
    rate: tuple[Array, Array],
    acceleration: tuple[Array, Array],
) -> tuple[Array, Array, tuple[tuple[Array, Array], tuple[Array, Array]], Array, Array]:
    """Return the elbow-up elevations of both links for a place of the first wrist joint.

    The place is out and up from the shoulder [m]. Returned are the elevations of upper arm and
    forearm [rad], their rates and accelerations, and the smallest and largest radius of the flange
    within reach at this height [m].
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


def tilted_motion(arm: ArmUR, poses: Array, velocities: Array, accelerations: Array) -> JointMotion:
    """Return joint angles along moving poses of any pitch, with exact rates and accelerations.

    The radii are those of the first wrist joint.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        q, radius, radius_min, radius_max = _angles(arm, poses)
        reached = np.all(np.isfinite(q), axis=-1)
        qd, qdd = np.full_like(q, np.nan), np.full_like(q, np.nan)
        qd[reached], qdd[reached] = _rates(
            arm, q[reached], poses[reached], velocities[reached], accelerations[reached]
        )
    q[~reached] = np.nan
    return JointMotion(
        q=q,
        qd=qd,
        qdd=qdd,
        radius=radius,
        radius_min=radius_min,
        radius_max=radius_max,
    )


def _angles(arm: ArmUR, poses: Array) -> tuple[Array, Array, Array, Array]:
    """Return joint angles, and the radius of the first wrist joint with its bounds."""
    links = arm.lengths
    along, tool, _, right = directions(poses)
    flange = poses[..., :3] - arm.gripper_length * tool - arm.grip_offset * along
    # The centre behind the flange does not move with joints 5 and 6.
    centre = flange - links.d6 * tool
    rho = np.hypot(centre[..., 0], centre[..., 1])
    in_plane = np.sqrt(rho * rho - links.d4**2)
    q1 = -np.arctan2(centre[..., 0], centre[..., 1]) - np.arctan2(links.d4, in_plane)
    c1, s1 = np.cos(q1), np.sin(q1)
    zero = np.zeros_like(q1)
    # Arm plane: outward direction, and the common axis of joints 2, 3 and 4.
    outward = np.stack([-s1, c1, zero], axis=-1)
    axis = np.stack([-c1, -s1, zero], axis=-1)
    cos_q5 = np.clip(_dot(tool, axis), -1.0, 1.0)
    q5 = -np.arccos(cos_q5)
    sin_q5 = np.sin(q5)
    # x and y of the flange are the directions right and -along; see ArmUR.grip_pose.
    q6 = np.arctan2(_dot(along, axis) / sin_q5, _dot(right, axis) / sin_q5)
    # Within half a turn of the untilted gripper, so that the joint does not jump by a full turn.
    untilted = poses[..., 3] + q1
    q6 = untilted + (q6 - untilted + np.pi) % (2 * np.pi) - np.pi
    # The fifth axis, perpendicular to the plane's axis and to the tool, carries the offset d5.
    fifth = np.cross(axis, tool) / sin_q5[..., None]
    elevation = np.arctan2(fifth[..., 2], _dot(fifth, outward))
    wrist = centre - links.d5 * fifth
    out = _dot(wrist, outward)
    up = wrist[..., 2] - arm.base_height - links.d1
    still = np.zeros_like(out)
    upper, fore, *_ = _two_link(links, (out, up), (still, still), (still, still))
    q = np.stack(
        [q1 + arm.base_yaw, -upper, upper - fore, fore - np.pi / 2 - elevation, q5, q6], axis=-1
    )
    radius_min, radius_max = (
        np.sqrt(np.maximum(span**2 - up * up, 0.0) + links.d4**2)
        for span in (links.upper_arm - links.forearm, links.upper_arm + links.forearm)
    )
    # Nearer to the base's axis than that its wrist lies aside, no turn of the base is right.
    aside = rho < links.d4
    radius = np.where(aside, rho, np.hypot(wrist[..., 0], wrist[..., 1]))
    return q, radius, np.where(aside, links.d4, radius_min), radius_max


def _rates(
    arm: ArmUR, q: Array, poses: Array, velocities: Array, accelerations: Array
) -> tuple[Array, Array]:
    """Return joint rates and accelerations for motions of the gripped end, [pose, 6] each."""
    _, _, forward, right = directions(poses)
    up = np.array([0.0, 0.0, 1.0])
    dyaw, dpitch = velocities[:, 3, None], velocities[:, 4, None]
    ddyaw, ddpitch = accelerations[:, 3, None], accelerations[:, 4, None]
    # Yaw is positive to the right, against the z axis. `right` turns with the yaw.
    spin = -dyaw * up + dpitch * right
    spin_rate = -ddyaw * up + ddpitch * right - dpitch * dyaw * forward
    frames = arm.frames(q)
    rates = jacobian(frames, poses[:, :3])
    axes = np.swapaxes(rates[:, 3:], 1, 2)
    places = np.stack([T[:, :3, 3] for T in frames[:-1]], axis=1)
    arms = poses[:, None, :3] - places
    qd = np.linalg.solve(rates, np.concatenate([velocities[:, :3], spin], axis=1)[..., None])
    qd = qd[..., 0]
    # Acceleration of the gripped end at zero joint acceleration.
    turns = axes * qd[..., None]
    before = np.cumsum(turns, axis=1) - turns
    axes_rate = np.cross(before, axes)
    places_rate = np.stack(
        [
            np.sum(np.cross(turns[:, :joint], places[:, joint, None] - places[:, :joint]), axis=1)
            for joint in range(q.shape[1])
        ],
        axis=1,
    )
    linear = np.cross(axes_rate, arms) + np.cross(axes, velocities[:, None, :3] - places_rate)
    bias = np.concatenate(
        [np.sum(linear * qd[..., None], axis=1), np.sum(axes_rate * qd[..., None], axis=1)], axis=1
    )
    wanted = np.concatenate([accelerations[:, :3], spin_rate], axis=1) - bias
    qdd = np.linalg.solve(rates, wanted[..., None])[..., 0]
    return np.asarray(qd, dtype=float), np.asarray(qdd, dtype=float)


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...i,...i->...", a, b)


def _tilted(poses: Array) -> NDArray[np.bool_]:
    """Return which poses are tilted by more than rounding."""
    return np.abs(poses[..., 4]) > _LEVEL
