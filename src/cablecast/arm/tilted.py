"""Inverse kinematics for a gripper that tilts in the vertical plane of its cable.

The closed form for a gripper that points straight down (arm/inverse.py) is fast and is used
wherever it applies. Here the six joints are solved for a full pose, on the same branch, so that a
motion may start untilted and tilt on the way. Rates and accelerations follow from the Jacobian and
its derivative, so they are exact as well.
"""

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.geometry import ArmGeometry
from cablecast.arm.inverse import JointMotion, two_link

Array = NDArray[np.float64]


def tilted_motion(
    arm: ArmGeometry, poses: Array, velocities: Array, accelerations: Array
) -> JointMotion:
    """Return joint angles along moving poses of any pitch, with exact rates and accelerations.

    Args:
        arm: Geometry of the arm.
        poses: x, y, z [m], yaw, pitch [rad], shape [..., 5].
        velocities: Their first derivatives, same shape.
        accelerations: Their second derivatives, same shape.

    Returns:
        Joint motion; NaN where a pose is out of reach. Its radii are those of the first wrist
        joint. Its lead is NaN: mirrored poses must be solved separately.
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
        lead=np.full((*radius.shape, 3), np.nan),
        base_yaw=arm.base_yaw,
    )


def _directions(poses: Array) -> tuple[Array, Array, Array, Array]:
    """Return the unit vectors along the cable, along the tool, forward and right, [..., 3] each."""
    yaw, pitch = poses[..., 3], poses[..., 4]
    zero = np.zeros_like(yaw)
    forward = np.stack([np.sin(yaw), np.cos(yaw), zero], axis=-1)
    right = np.stack([np.cos(yaw), -np.sin(yaw), zero], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    cos_pitch, sin_pitch = np.cos(pitch)[..., None], np.sin(pitch)[..., None]
    along = cos_pitch * forward + sin_pitch * up
    tool = sin_pitch * forward - cos_pitch * up
    return along, tool, forward, right


def _angles(arm: ArmGeometry, poses: Array) -> tuple[Array, Array, Array, Array]:
    """Return joint angles, and the radius of the first wrist joint with its bounds."""
    links = arm.links
    along, tool, _, right = _directions(poses)
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
    # x and y of the flange are the directions right and -along; see ArmGeometry.grip_pose.
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
    upper, fore, *_ = two_link(links, (out, up), (still, still), (still, still))
    q = np.stack(
        [q1 + arm.base_yaw, -upper, upper - fore, fore - np.pi / 2 - elevation, q5, q6], axis=-1
    )
    radius_min, radius_max = (
        np.sqrt(np.maximum(span**2 - up * up, 0.0) + links.d4**2)
        for span in (links.upper_arm - links.forearm, links.upper_arm + links.forearm)
    )
    return q, np.hypot(wrist[..., 0], wrist[..., 1]), radius_min, radius_max


def _rates(
    arm: ArmGeometry, q: Array, poses: Array, velocities: Array, accelerations: Array
) -> tuple[Array, Array]:
    """Return joint rates and accelerations for motions of the gripped end, [pose, 6] each."""
    _, _, forward, right = _directions(poses)
    up = np.array([0.0, 0.0, 1.0])
    dyaw, dpitch = velocities[:, 3, None], velocities[:, 4, None]
    ddyaw, ddpitch = accelerations[:, 3, None], accelerations[:, 4, None]
    # Yaw is positive to the right, against the z axis. `right` turns with the yaw.
    spin = -dyaw * up + dpitch * right
    spin_rate = -ddyaw * up + ddpitch * right - dpitch * dyaw * forward
    frames = arm.frames(q)
    axes = np.stack([T[:, :3, 2] for T in frames[:-1]], axis=1)
    places = np.stack([T[:, :3, 3] for T in frames[:-1]], axis=1)
    arms = poses[:, None, :3] - places
    jacobian = np.concatenate([np.cross(axes, arms), axes], axis=2).transpose(0, 2, 1)
    qd = np.linalg.solve(jacobian, np.concatenate([velocities[:, :3], spin], axis=1)[..., None])
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
    qdd = np.linalg.solve(jacobian, wanted[..., None])[..., 0]
    return np.asarray(qd, dtype=float), np.asarray(qdd, dtype=float)


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...i,...i->...", a, b)
