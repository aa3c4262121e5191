"""Measured gripper path, fitted to the joint angles that the arm reported, or to tracked poses.

A servo lags behind its set points and rounds their corners, so the gripper does not follow the
commanded path. A simulation that is compared with a trial must play the measured path.
"""

import math

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import Arm
from cablecast.errors import InputError
from cablecast.motion.grip_path import DEGREE, GripPath
from cablecast.motion.trajectory import JointPath

# Longest distance between knots [s], shortened where the fit is too coarse; the arm's servo filters
# out most of what is faster.
_KNOT_DT = 0.06
# Largest fit residual beyond the encoder noise, for x, y, z [m], yaw and pitch [rad]. The free end,
# one cable length away, moves by about as much.
_FIT_TOLERANCE = np.array([3e-5, 3e-5, 3e-5, 5e-5, 5e-5])
# Distance from the last pose within which the grip counts as at rest [m and rad].
_REST_TOLERANCE = 1e-4
# Hold after the motion that the fit includes [s], so that the path ends at rest.
_REST_TIME = 0.1
# A piece with fewer samples would follow their noise.
_PIECE_SAMPLES_MIN = 4
SAMPLES_MIN = 16
"""Fewest samples of a measured motion: fewer cannot separate it from its noise."""


def grip_path_from_joints(joint_path: JointPath, arm: Arm) -> GripPath:
    """Fit a smooth gripper path of few pieces to measured joints.

    The path is a spline of degree five, at rest at both ends. It has as few knots as possible for
    the residual to be encoder noise. Samples before time 0 are ignored. After the last knot the
    grip keeps still.

    Args:
        joint_path: Joint angles and the times at which the arm reported them, not necessarily
            evenly spaced; joint rates are not used.
        arm: Robot arm that reported the joints.

    Raises:
        InputError: Too few samples, times that do not ascend, or values that are not finite.
    """
    return _fit_path(joint_path.times, arm.grip_pose(joint_path.q), "joints")


def grip_path_from_poses(times: NDArray[np.float64], poses: NDArray[np.float64]) -> GripPath:
    """Fit a path as `grip_path_from_joints` to poses that a camera tracked, of a grip without arm.

    Poses are x, y, z [m], yaw and pitch [rad], shape [sample, 5], at times [s], shape [sample].
    """
    return _fit_path(times, poses, "grip poses")


def _fit_path(times: NDArray[np.float64], poses: NDArray[np.float64], what: str) -> GripPath:
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(poses))):
        raise InputError(f"measured {what} must be finite")
    if np.any(np.diff(times) <= 0):
        at = int(np.argmax(np.diff(times) <= 0)) + 1
        raise InputError(
            f"measured {what} must have ascending times, but time {at} is {times[at]:.6g} s after "
            f"{times[at - 1]:.6g} s"
        )
    used = times >= 0.0
    times, poses = times[used], poses[used]
    if len(times) < SAMPLES_MIN:
        raise InputError(
            f"{len(times)} samples of measured {what} are too few: a path needs {SAMPLES_MIN}"
        )
    poses[:, 3] = np.unwrap(poses[:, 3])
    noise = _noise(times, poses)
    final = np.median(poses[-_PIECE_SAMPLES_MIN:], axis=0)
    at_rest = np.all(np.abs(poses - final) <= np.maximum(_REST_TOLERANCE, 5 * noise), axis=1)
    moving = np.flatnonzero(~at_rest)
    last = int(moving[-1]) if len(moving) else 0
    end = int(np.searchsorted(times, times[last] + _REST_TIME, side="right"))
    used = slice(0, max(end, SAMPLES_MIN))
    # False where the samples stop while the arm still moves.
    rests = times[used][-1] - times[last] > _REST_TIME / 2
    times, poses = times[used], poses[used]
    span = times[-1] - times[0]
    tolerance = np.hypot(_FIT_TOLERANCE, noise)
    piece_max = max(len(times) // _PIECE_SAMPLES_MIN, 1)
    piece_count = min(max(int(np.ceil(span / _KNOT_DT)), 2), piece_max)
    while True:
        path, residual = _fit(times, poses, piece_count, rests)
        if piece_count == piece_max or np.all(np.sqrt(np.mean(residual**2, axis=0)) <= tolerance):
            return path
        piece_count = min(piece_count + piece_count // 4 + 1, piece_max)


def _noise(times: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard deviation of the sample noise per channel, shape [5].

    Each four consecutive samples are combined with weights that cancel any parabola. Almost
    nothing of the motion remains, but all of the noise.
    """
    groups = np.arange(4) + np.arange(len(times) - 3)[:, None]
    apart = times[groups][:, :, None] - times[groups][:, None, :]
    weights = 1.0 / np.prod(np.where(np.eye(4, dtype=bool), 1.0, apart), axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    left = np.einsum("ij,ijc->ic", weights, poses[groups])
    # The median absolute deviation ignores the few samples at jerk peaks.
    return 1.4826 * np.median(np.abs(left), axis=0)


def _fit(
    times: NDArray[np.float64], poses: NDArray[np.float64], piece_count: int, rests: bool
) -> tuple[GripPath, NDArray[np.float64]]:
    """Fit a least-squares spline of equal pieces; return it with the residual of each sample."""
    from scipy.interpolate import BSpline

    breaks = np.linspace(times[0], times[-1], piece_count + 1)
    knots = np.concatenate([[breaks[0]] * DEGREE, breaks, [breaks[-1]] * DEGREE])
    design = BSpline.design_matrix(times, knots, DEGREE).toarray()
    # Velocity and acceleration are zero at an end where three control points coincide.
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
    # Taylor coefficients at the start of each piece.
    coefficients = np.stack(
        [spline(breaks[:-1], nu=power) / math.factorial(power) for power in range(DEGREE + 1)],
        axis=-1,
    )
    path = GripPath(knots=breaks[None], coefficients=coefficients[None])
    return path, residual
