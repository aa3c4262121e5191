"""Identifying how an arm follows its set points, from the joints that it reports."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.limits import JOINT_COUNT
from cablecast.datasets.reader import Dataset
from cablecast.datasets.trials import commanded_joints, measured_joints
from cablecast.errors import DatasetError
from cablecast.motion.joint_path import JointPath
from cablecast.motion.servo import ServoModel

TICK = 1 / 125
"""Interval at which set points and the model are laid out [s]: a UR5's control cycle."""

_STILL = 1e-3
"""A joint whose set points never differ by more than this [rad] tells nothing of its servo."""
_START = (0.01, 50.0, 1.0)
_BOUNDS = ((0.0, 10.0, 0.3), (0.2, 2000.0, 3.0))
# Not measured beyond this after the last set point [s]: rest only dilutes the fit.
_AFTER = 0.4


@dataclasses.dataclass(frozen=True, kw_only=True)
class ServoFit:
    """A servo model and how well it explains where the gripper went.

    Attributes:
        model: The model.
        commanded_rms: Distance of the gripper from where it was commanded, rms over the motion [m].
        model_rms: Its distance from where the model says it was [m].
        trial_count: Trials that it was identified from.
    """

    model: ServoModel
    commanded_rms: float
    model_rms: float
    trial_count: int


def identify_servo(dataset: Dataset, count: int | None = None) -> ServoFit:
    """Fit delay, frequency and damping of every joint to measured joints, by least squares.

    A joint that hardly moved takes the median of the others.

    Args:
        dataset: Trials with commanded and measured joints.
        count: Use only this many trials from the beginning.

    Raises:
        DatasetError: No trial has both.
    """
    pairs: list[tuple[JointPath, JointPath]] = []
    for row in range(len(dataset) if count is None else min(count, len(dataset))):
        commanded, measured = commanded_joints(dataset, row), measured_joints(dataset, row)
        if commanded is not None and measured is not None:
            pairs.append((commanded, measured))
    if not pairs:
        name = str(dataset.path or "the dataset")
        raise DatasetError(f"{name} holds no trial with commanded and measured joints")
    q, times, measured = _common_grid(pairs)
    fits = [_fit_joint(q, times, measured, joint) for joint in range(JOINT_COUNT)]
    known = [fit for fit in fits if fit is not None]
    if not known:
        raise DatasetError("no joint moves in any trial: its servo cannot be identified")
    usual = np.median(known, axis=0)
    values = np.array([usual if fit is None else fit for fit in fits])
    model = ServoModel(delay=values[:, 0], frequency=values[:, 1], damping=values[:, 2])
    left = _at(model.respond(q, TICK), times) - measured
    model = dataclasses.replace(model, residual=np.sqrt(np.nanmean(left**2, axis=(0, 1))))
    seen = np.isfinite(measured).all(axis=2)
    arm = dataset.setup.arm
    truth = arm.grip_pose(measured[seen])[:, :3]
    commanded_rms, model_rms = (
        float(np.sqrt(np.mean(np.sum((arm.grip_pose(path[seen])[:, :3] - truth) ** 2, axis=1))))
        for path in (_at(q, times), _at(model.respond(q, TICK), times))
    )
    return ServoFit(
        model=model, commanded_rms=commanded_rms, model_rms=model_rms, trial_count=len(pairs)
    )


def _common_grid(
    pairs: list[tuple[JointPath, JointPath]],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """All trials on common ticks, the last set point held.

    Returns:
        Set points [rad], shape [trial, tick, 6]; times of the measurements [s], shape [trial,
        sample]; and what was measured [rad], shape [trial, sample, 6], NaN where nothing was.
    """
    ends = [float(commanded.times[-1]) + _AFTER for commanded, _ in pairs]
    ticks = np.arange(int(np.ceil(max(ends) / TICK)) + 1) * TICK
    q = np.stack(
        [
            np.stack(
                [np.interp(ticks, commanded.times, column) for column in commanded.q.T], axis=-1
            )
            for commanded, _ in pairs
        ]
    )
    used = [
        (measured.times >= 0.0) & (measured.times <= min(end, measured.times[-1]))
        for (_, measured), end in zip(pairs, ends, strict=True)
    ]
    sample_max = max(int(mask.sum()) for mask in used)
    times = np.zeros((len(pairs), sample_max))
    values = np.full((len(pairs), sample_max, JOINT_COUNT), np.nan)
    for row, ((_, measured), mask) in enumerate(zip(pairs, used, strict=True)):
        length = int(mask.sum())
        times[row, :length] = measured.times[mask]
        values[row, :length] = measured.q[mask]
    return q, times, values


def _at(values: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values on the ticks, linearly at some times; shapes [trial, tick, ...], [trial, sample]."""
    place = np.clip(times / TICK, 0.0, values.shape[1] - 1.0)
    before = np.minimum(place.astype(int), values.shape[1] - 2)
    share = place - before
    trial = np.arange(len(values))[:, None]
    share = share.reshape(share.shape + (1,) * (values.ndim - 2))
    return (1.0 - share) * values[trial, before] + share * values[trial, before + 1]


def _fit_joint(
    q: NDArray[np.float64],
    times: NDArray[np.float64],
    measured: NDArray[np.float64],
    joint: int,
) -> NDArray[np.float64] | None:
    from scipy.optimize import least_squares

    if np.max(np.ptp(q[..., joint], axis=1)) < _STILL:
        return None
    seen = np.isfinite(measured[..., joint])
    # The other columns only keep the shape: each joint is filtered by its own model alone.
    only = np.repeat(q[..., joint, None], JOINT_COUNT, axis=-1)
    # An offset of the encoder at rest must not be taken for a lag.
    offset = np.nanmedian(measured[:, :3, joint] - q[:, :1, joint])

    def left(values: NDArray[np.float64]) -> NDArray[np.float64]:
        delay, frequency, damping = (np.full(JOINT_COUNT, value) for value in values)
        model = ServoModel(delay=delay, frequency=frequency, damping=damping)
        moved = _at(model.respond(only, TICK)[..., 0], times)
        return (moved + offset - measured[..., joint])[seen]

    fit = least_squares(
        left, _START, bounds=_BOUNDS, x_scale=(0.01, 30.0, 0.3), method="trf", ftol=1e-10
    )
    return fit.x
