"""Identification of the arm's servo from the joint angles that it reports."""

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cablecast.data.dataset import Dataset
from cablecast.errors import DatasetError
from cablecast.motion.servo import ServoModel, joint_response
from cablecast.motion.trajectory import JointPath

TICK = 1 / 125
"""Interval between set points in the fit [s]: the control cycle of a UR5."""

_STILL = 1e-3
"""Range of set points [rad] below which the servo of a joint is not identified."""
_BOUNDS = ((0.0, 10.0, 0.3), (0.2, 2000.0, 3.0))
"""Bounds of delay [s], frequency [rad/s] and damping [-]."""
_NAMES = ("delay", "frequency", "damping", "acceleration_max", "speed_max")
_LIMITS = ((0.0, 10.0, 0.3, 1.0, 0.1), (0.2, 2000.0, 3.0, 1e4, 20.0))
"""Bounds of these and of the motor's acceleration [rad/s²] and speed [rad/s]."""
_WEAK, _STEADY = 3e-4, 0.2
"""RMS of what a servo without limits lacks, from which limits are looked for [rad]: a third of a
millimetre at the reach of the arm; and its least share of the squared residuals, noise included."""
_WEAK_SHARE = 0.25
"""Share of the sum of squares that limits leave at most, or else there are none [-]."""
_LAG_MAX = 0.5
"""Longest lag that the search for a starting value tries [s]."""
_START_COUNT = 10
"""Trials that the starting values come from: those in which the joint moves most."""
_ACCELERATIONS, _SPEEDS = (5.0, 10.0, 20.0, 50.0, 100.0, 300.0), (1.0, 1.3, 2.0, 4.0)
"""Limits of a motor that a search for them starts with: accelerations [rad/s²], and speeds over
the fastest reported one [-]."""
_FASTEST, _LIMIT_STARTS = 0.99, 2
"""Share of the reported speeds that count as slower than the fastest one, and number of the best
starts that are followed."""
_START_STEPS = 50
"""Largest number of steps to the starting values."""
_COST_CHANGE = 1e-10
"""Relative change of the sum of squares at which a search ends [-]. With N samples, noise hides
changes below 1 / N."""
# Measurements later than this after the last set point [s] only dilute the fit with rest.
_AFTER = 0.4


@dataclasses.dataclass(frozen=True, kw_only=True)
class ServoFit:
    """Servo model with the quality of its fit.

    Attributes:
        model: Fitted model.
        commanded_rms: RMS distance between the commanded and the measured gripper position [m].
        model_rms: RMS distance between the modelled and the measured gripper position [m].
        trial_count: Number of trials in the fit.
    """

    model: ServoModel
    commanded_rms: float
    model_rms: float
    trial_count: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Motions:
    """Set points of some trials, and the samples that the arm reported.

    Attributes:
        q: Set points every `TICK`, the last one held [rad], shape [trial, tick, joint].
        trial: Trial of each sample, shape [sample].
        times: Time of each sample since the motion began [s], shape [sample].
        measured: Reported joint angles [rad], shape [sample, joint].
    """

    q: NDArray[np.float64]
    trial: NDArray[np.int64]
    times: NDArray[np.float64]
    measured: NDArray[np.float64]

    @classmethod
    def collect(cls, pairs: list[tuple[JointPath, JointPath]]) -> "_Motions":
        """Lay out pairs of commanded and measured joints on common ticks."""
        ends = [float(commanded.times[-1]) + _AFTER for commanded, _ in pairs]
        ticks = np.arange(int(np.ceil(max(ends) / TICK)) + 1) * TICK
        joint_count = pairs[0][0].q.shape[1]
        q = np.empty((len(pairs), len(ticks), joint_count))
        trial, times, measured = [], [], []
        for row, ((commanded, reported), end) in enumerate(zip(pairs, ends, strict=True)):
            for joint in range(joint_count):
                q[row, :, joint] = np.interp(ticks, commanded.times, commanded.q[:, joint])
            used = (reported.times >= 0.0) & (reported.times <= end)
            used &= np.isfinite(reported.q).all(axis=1)
            trial.append(np.full(np.count_nonzero(used), row))
            times.append(reported.times[used])
            measured.append(reported.q[used])
        if not any(map(len, trial)):
            raise DatasetError(
                "no joints were reported during any motion: record them with the clock of the set "
                "points"
            )
        return cls(
            q=q,
            trial=np.concatenate(trial),
            times=np.concatenate(times),
            measured=np.concatenate(measured),
        )

    def subset(self, trials: NDArray[np.int64]) -> "_Motions":
        """Return some of the trials, named by their indices in ascending order."""
        kept = np.isin(self.trial, trials)
        return _Motions(
            q=self.q[trials],
            trial=np.searchsorted(trials, self.trial[kept]),
            times=self.times[kept],
            measured=self.measured[kept],
        )

    def weights(self, lag: float = 0.0) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the cubic interpolation from the ticks to the sample times, late by a lag [s].

        Indices into the flattened [trial, tick] axes and Lagrange weights have shape [4, sample].
        """
        tick_count = self.q.shape[1]
        place = np.clip((self.times - lag) / TICK, 0.0, tick_count - 1.0)
        first = np.clip(place.astype(int) - 1, 0, tick_count - 4)
        x = place - first
        weights = np.stack(
            [
                -(x - 1.0) * (x - 2.0) * (x - 3.0) / 6.0,
                x * (x - 2.0) * (x - 3.0) / 2.0,
                -x * (x - 1.0) * (x - 3.0) / 2.0,
                x * (x - 1.0) * (x - 2.0) / 6.0,
            ]
        )
        return self.trial * tick_count + first + np.arange(4)[:, None], weights

    def sample(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Interpolate values of shape [trial, tick, joint] at the samples, [sample, joint]."""
        indices, weights = self.weights()
        return np.einsum("ks,ksj->sj", weights, values.reshape(-1, values.shape[-1])[indices])


def can_identify_servo(dataset: Dataset) -> bool:
    """Return whether some trial has both commanded and measured joints."""
    return any(
        dataset.commanded_joints(row) is not None and dataset.measured_joints(row) is not None
        for row in range(len(dataset))
    )


def identify_servo(dataset: Dataset, count: int | None = None) -> ServoFit:
    """Fit delay, frequency and damping of every joint to its measured angles, by least squares.

    Where a joint is far from what these three can explain, and limits of its motor explain most of
    that, it has limits, too. The fit also estimates a constant encoder offset per joint, which it
    does not return. A joint that barely moved takes the median of the others, without limits.

    Args:
        dataset: Trials with commanded and measured joints.
        count: Number of trials to use, from the first one; all by default.

    Raises:
        DatasetError: No trial has commanded and measured joints, or no joint moves in any.
    """
    pairs: list[tuple[JointPath, JointPath]] = []
    for row in range(len(dataset) if count is None else min(count, len(dataset))):
        commanded, measured = dataset.commanded_joints(row), dataset.measured_joints(row)
        if commanded is not None and measured is not None:
            pairs.append((commanded, measured))
    if not pairs:
        name = str(dataset.path or "the dataset")
        raise DatasetError(f"{name} holds no trial with commanded and measured joints")
    motions = _Motions.collect(pairs)
    joints = range(motions.q.shape[-1])
    fits = [_fit_joint(motions, joint) for joint in joints]
    known = [fit for fit in fits if fit is not None]
    if not known:
        raise DatasetError("no joint moves in any trial: its servo cannot be identified")
    median = np.median(known, axis=0)
    limited = [
        np.array([*median, np.inf, np.inf])
        if fit is None
        else _fit_limits(motions, joint, fit, median)
        for joint, fit in enumerate(fits)
    ]
    model = ServoModel(**dict(zip(_NAMES, np.transpose(limited), strict=True)))
    modelled = motions.sample(model.respond(motions.q, TICK))
    residual = np.sqrt(np.mean((modelled - motions.measured) ** 2, axis=0))
    arm = dataset.setup.arm
    truth = arm.grip_pose(motions.measured)[:, :3]
    commanded_rms, model_rms = (
        float(np.sqrt(np.mean(np.sum((arm.grip_pose(q)[:, :3] - truth) ** 2, axis=1))))
        for q in (motions.sample(motions.q), modelled)
    )
    return ServoFit(
        model=dataclasses.replace(model, residual=residual),
        commanded_rms=commanded_rms,
        model_rms=model_rms,
        trial_count=len(pairs),
    )


def _fit_joint(motions: _Motions, joint: int) -> NDArray[np.float64] | None:
    """Fit delay [s], frequency [rad/s] and damping [-] of one joint; None where it barely moves."""
    from scipy.optimize import least_squares

    travel = np.ptp(motions.q[..., joint], axis=1)
    if np.max(travel) < _STILL:
        return None
    lively = motions.subset(np.sort(np.argsort(travel)[-_START_COUNT:]))
    return least_squares(
        _residuals(motions, joint),
        _start_values(lively, joint),
        bounds=_BOUNDS,
        x_scale="jac",
        method="dogbox",
        ftol=_COST_CHANGE,
    ).x


def _fit_limits(
    motions: _Motions, joint: int, values: NDArray[np.float64], median: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the values of one joint, with limits of its motor where the casts ask for them.

    Args:
        motions: Set points and reported angles.
        joint: Number of the joint.
        values: Delay [s], frequency [rad/s] and damping [-] that fit it best without limits.
        median: Median values of all joints, from which the search starts: without limits, a lag
            makes up for a weak motor.

    Returns:
        The values in the order of `_NAMES`; limits are infinite where there are none.
    """
    from scipy.optimize import least_squares

    residuals = _residuals(motions, joint)
    without = np.concatenate([values, [np.inf, np.inf]])
    left = residuals(without)
    # Noise differs from sample to sample, what a model lacks does not.
    steady = float(np.mean(left[1:] * left[:-1]))
    if steady < max(_WEAK**2, _STEADY * np.mean(left**2)):
        return without
    speeds = np.abs(np.diff(motions.measured[:, joint]) / np.diff(motions.times))
    fastest = np.quantile(speeds[np.diff(motions.trial) == 0], _FASTEST)
    grid = np.array([(*median, a, v * fastest) for a in _ACCELERATIONS for v in _SPEEDS])
    starts = grid[np.argsort([np.sum(residuals(start) ** 2) for start in grid])[:_LIMIT_STARTS]]
    low, high = np.log(np.maximum(_LIMITS, 1e-6))
    fits = [
        least_squares(
            lambda logs: residuals(np.exp(logs)),
            np.clip(np.log(np.maximum(start, 1e-6)), low, high),
            bounds=(low, high),
            ftol=_COST_CHANGE,
            max_nfev=_START_STEPS,
        )
        for start in starts
    ]
    best = min(fits, key=lambda fit: fit.cost)
    return np.exp(best.x) if 2.0 * best.cost < _WEAK_SHARE * np.sum(left**2) else without


def _residuals(
    motions: _Motions, joint: int
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return a function of a servo's values, in the order of `_NAMES`, with or without limits.

    It gives the residuals of one joint [rad], shape [sample]. Their mean is removed, so that a
    constant encoder offset is not mistaken for a lag.
    """
    q = np.ascontiguousarray(motions.q[..., joint])
    measured = motions.measured[:, joint]
    indices, weights = motions.weights()

    def residuals(values: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = joint_response(q, TICK, **dict(zip(_NAMES, values, strict=False)))
        left = np.einsum("ks,ks->s", weights, moved.ravel()[indices]) - measured
        return left - np.mean(left)

    return residuals


def _start_values(motions: _Motions, joint: int) -> NDArray[np.float64]:
    """Return delay [s], frequency [rad/s] and damping [-] close to their best values.

    The three can largely replace one another: the misfit is a narrow, curved valley, and a
    search in delay, frequency and damping takes hundreds of steps along it. To second order in
    time, the response depends only on delay + filter_lag and on spread = filter_lag^2 -
    2 / frequency^2, where filter_lag = 2 damping / frequency. In delay, filter_lag and spread the
    valley is straight, and a search takes about ten steps.
    """
    from scipy.optimize import least_squares

    low, high = np.array(_BOUNDS)
    residuals = _residuals(motions, joint)

    def native(values: NDArray[np.float64]) -> NDArray[np.float64]:
        delay, filter_lag, spread = values
        frequency = np.sqrt(2.0 / max(filter_lag**2 - spread, 2.0 / high[1] ** 2))
        return np.clip([delay, frequency, filter_lag * frequency / 2.0], low, high)

    # The pure delay that explains the motion best is close to the lag. Begin with a quarter of it
    # as delay and the rest as that of a critically damped oscillator.
    lag = _best_lag(motions, joint)
    filter_lag = 0.75 * lag
    filter_lag_max = 2.0 * high[2] / low[1]
    fit = least_squares(
        lambda values: residuals(native(values)),
        (lag - filter_lag, filter_lag, filter_lag**2 / 2.0),
        bounds=(
            (low[0], 2.0 * low[2] / high[1], -2.0 / low[1] ** 2),
            (high[0], filter_lag_max, filter_lag_max**2),
        ),
        x_scale="jac",
        method="dogbox",
        ftol=_COST_CHANGE,
        max_nfev=_START_STEPS,
    )
    return native(fit.x)


def _best_lag(motions: _Motions, joint: int) -> float:
    """Return the pure delay, in whole ticks, that explains the motion of a joint best [s]."""
    q, measured = motions.q[..., joint].ravel(), motions.measured[:, joint]
    lags = np.arange(1.0, _LAG_MAX / TICK) * TICK
    misfits = []
    for lag in lags:
        indices, weights = motions.weights(lag)
        misfits.append(np.std(np.einsum("ks,ks->s", weights, q[indices]) - measured))
    return float(lags[np.argmin(misfits)])
