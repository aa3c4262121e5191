"""The gripper's path as the arm really moved it, from the joints that the arm reported.

A servo lags behind its set points and rounds their corners, so the cable feels another path than
the commanded one. A simulation that is to be compared with a trial must play the measured path.
"""

import math

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.ur import ArmUR
from cablecast.errors import InputError
from cablecast.motion.grip_path import DEGREE, GripPath
from cablecast.motion.joint_path import JointPath

KNOT_DT = 0.06
"""Longest distance between knots [s]: the servo of an arm leaves little that is quicker."""

# What a fit may leave beyond the noise of the encoders, for x, y, z [m], yaw and pitch [rad]: the
# free end, one cable length away, moves by about as much.
_FIT_TOLERANCE = np.array([3e-5, 3e-5, 3e-5, 5e-5, 5e-5])
# How far from its last pose the grip counts as at rest [m and rad].
_REST_TOLERANCE = 1e-4
# The hold after the motion that the fit looks at [s], so that it learns that it ends at rest.
_REST_TIME = 0.1
# A piece with fewer samples would follow their noise.
_PIECE_SAMPLES_MIN = 4
# Fewer samples do not tell a motion from its noise.
_SAMPLES_MIN = 16


def grip_path_from_joints(
    joint_path: JointPath, arm: ArmUR, *, knot_dt: float = KNOT_DT
) -> GripPath:
    """The smooth path of the gripper that fits measured joints, in few pieces.

    A spline of degree five, begun at rest and ended at rest, with as few knots as leave nothing
    but the noise of the encoders. Samples before time 0 are left out; after the last knot the grip
    keeps still.

    Args:
        joint_path: Joints with the times at which the arm reported them, at any rate; its rates
            are not used.
        arm: Robot arm that reported the joints.
        knot_dt: Longest distance between knots [s]; it is shortened where that is too coarse.

    Raises:
        InputError: Too few samples, times that do not rise, or values that are not finite.
    """
    times, poses = _measured_poses(joint_path, arm)
    noise = _noise(times, poses)
    final = np.median(poses[-_PIECE_SAMPLES_MIN:], axis=0)
    at_rest = np.all(np.abs(poses - final) <= np.maximum(_REST_TOLERANCE, 5 * noise), axis=1)
    moving = np.flatnonzero(~at_rest)
    last = int(moving[-1]) if len(moving) else 0
    end = int(np.searchsorted(times, times[last] + _REST_TIME, side="right"))
    used = slice(0, max(end, _SAMPLES_MIN))
    # Not where the report stops while the arm moves.
    rests = times[used][-1] - times[last] > _REST_TIME / 2
    times, poses = times[used], poses[used]
    span = times[-1] - times[0]
    tolerance = np.hypot(_FIT_TOLERANCE, noise)
    piece_max = max(len(times) // _PIECE_SAMPLES_MIN, 1)
    piece_count = min(max(int(np.ceil(span / knot_dt)), 2), piece_max)
    while True:
        path, residual = _fit(times, poses, piece_count, rests)
        if piece_count == piece_max or np.all(np.sqrt(np.mean(residual**2, axis=0)) <= tolerance):
            return path
        piece_count = min(piece_count + piece_count // 4 + 1, piece_max)


def _measured_poses(
    joint_path: JointPath, arm: ArmUR
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    times, q = joint_path.times, joint_path.q
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(q))):
        raise InputError("measured joints must be finite")
    if np.any(np.diff(times) <= 0):
        at = int(np.argmax(np.diff(times) <= 0)) + 1
        raise InputError(
            f"measured joints must have rising times, but time {at} is {times[at]:.6g} s after "
            f"{times[at - 1]:.6g} s"
        )
    used = times >= 0.0
    times, q = times[used], q[used]
    if len(times) < _SAMPLES_MIN:
        raise InputError(
            f"{len(times)} samples of measured joints are too few for a path: {_SAMPLES_MIN}"
        )
    poses = arm.grip_pose(q)
    poses[:, 3] = np.unwrap(poses[:, 3])
    return times, poses


def _noise(times: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviation of what differs from sample to sample, per channel, shape [5].

    Of four samples that follow one another the combination is taken to which no parabola
    contributes: next to nothing is left of a motion, and all of the noise.
    """
    groups = np.arange(4) + np.arange(len(times) - 3)[:, None]
    apart = times[groups][:, :, None] - times[groups][:, None, :]
    weights = 1.0 / np.prod(np.where(np.eye(4, dtype=bool), 1.0, apart), axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    left = np.einsum("ij,ijc->ic", weights, poses[groups])
    # The median absolute deviation, so that the few samples at the peaks of the jerk do not count.
    return 1.4826 * np.median(np.abs(left), axis=0)


def _fit(
    times: NDArray[np.float64], poses: NDArray[np.float64], piece_count: int, rests: bool
) -> tuple[GripPath, NDArray[np.float64]]:
    """The least-squares spline on equal pieces, and what it leaves of each sample."""
    from scipy.interpolate import BSpline

    breaks = np.linspace(times[0], times[-1], piece_count + 1)
    knots = np.concatenate([[breaks[0]] * DEGREE, breaks, [breaks[-1]] * DEGREE])
    design = BSpline.design_matrix(times, knots, DEGREE).toarray()
    # At an end where the first three control points are one, velocity and acceleration are zero.
    groups = np.arange(design.shape[1])
    groups[:3] = 0
    if rests:
        groups[-3:] = groups[-3]
    _, groups = np.unique(groups, return_inverse=True)
    tied = np.zeros((design.shape[0], groups.max() + 1))
    np.add.at(tied.T, groups, design.T)
    control, *_ = np.linalg.lstsq(tied, poses, rcond=None)
    residual = poses - tied @ control
    spline = BSpline(knots, control[groups], DEGREE)
    # Taylor coefficients of each piece at its beginning.
    coefficients = np.stack(
        [spline(breaks[:-1], nu=power) / math.factorial(power) for power in range(DEGREE + 1)],
        axis=-1,
    )
    path = GripPath(knots=breaks[None], coefficients=coefficients[None])
    return path, residual
