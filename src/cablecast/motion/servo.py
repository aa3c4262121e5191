"""Servo model: actual motion of the joints, and so of the gripper, for commanded set points.

Each joint follows its set points with a dead time and as a damped oscillator. A cast lasts a second
or two and turns within tenths of a second, so a lag of a few hundredths of a second changes the
gripper's path by centimetres. That is more than the error of the cable model. A simulator must
therefore play the path that the arm takes, not the commanded path.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.limits import JOINT_COUNT
from cablecast.arm.ur import ArmUR
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath

_STEP = 0.016
"""Time step of `apply` [s]. Coarse, so that 36,000 paths convert quickly; the result stays within
0.1 mm of the exact response."""
_KNOT_STEPS = 2
"""Time steps between the knots of the resulting path."""
_SETTLED = 1e-4
"""Remaining share of a step input at the end of the resulting path [-]."""
_SETTLE_MAX = 2.0
"""Longest settling time of a resulting path [s]."""
# Paths per chunk: limits the intermediate arrays to about 100 MB.
_CHUNK = 1000


@dataclasses.dataclass(frozen=True, kw_only=True)
class ServoModel:
    """Second-order servo with a dead time, one per joint.

    The joint angle q follows its set point q_set as

        qdd = frequency^2 (q_set(t - delay) - q) - 2 damping frequency qd.

    Attributes:
        delay: Dead time before a set point has any effect [s], shape [6].
        frequency: Undamped angular frequency of the response [rad/s], shape [6].
        damping: Damping ratio of the response [-], shape [6].
        residual: RMS difference between measured and modelled joint angles [rad], shape [6]; NaN
            if unknown.
    """

    delay: NDArray[np.float64]
    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    residual: NDArray[np.float64] = dataclasses.field(
        default_factory=lambda: np.full(JOINT_COUNT, np.nan)
    )

    def __post_init__(self):
        for name, unit, low, high in (
            ("delay", "s", 0.0, 0.5),
            ("frequency", "rad/s", 5.0, 5000.0),
            ("damping", "-", 0.2, 5.0),
        ):
            values = np.asarray(getattr(self, name), dtype=float)
            object.__setattr__(self, name, values)
            if values.shape != (JOINT_COUNT,):
                raise InputError(f"servo {name} has shape {values.shape}, not ({JOINT_COUNT},)")
            if not np.all((values >= low) & (values <= high)):
                bad = values[~((values >= low) & (values <= high))][0]
                raise InputError(f"servo {name} = {bad:g} {unit} is outside [{low:g}, {high:g}]")

    @property
    def lag(self) -> NDArray[np.float64]:
        """Lag behind a steady motion, delay + 2 damping / frequency [s], shape [6]."""
        return self.delay + 2.0 * self.damping / self.frequency

    @property
    def settle_time(self) -> float:
        """Time from the last set point until the slowest joint is at rest [s]."""
        # An overdamped response decays with the slower of its two poles.
        root = np.sqrt(np.maximum(self.damping**2 - 1.0, 0.0))
        decay = self.frequency * (self.damping - root)
        return float(min(np.max(self.delay + np.log(1.0 / _SETTLED) / decay), _SETTLE_MAX))

    def respond(self, q: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
        """Return the joint angles that follow evenly spaced set points.

        Args:
            q: Set points, which start at rest [rad], shape [..., tick, 6].
            dt: Interval between set points [s].

        Returns:
            Joint angles at the same times [rad], shape [..., tick, 6].
        """
        result = np.empty_like(q)
        for joint in range(JOINT_COUNT):
            result[..., joint] = joint_response(
                q[..., joint],
                dt,
                delay=self.delay[joint],
                frequency=self.frequency[joint],
                damping=self.damping[joint],
            )
        return result

    def apply(self, grip_path: GripPath, arm: ArmUR) -> GripPath:
        """Return the paths that the gripper takes along commanded paths.

        Args:
            grip_path: Commanded paths, which start from rest and at the same time.
            arm: Robot arm.

        Returns:
            One path per commanded path, which ends when the arm has settled.

        Raises:
            IKError: A path leaves the reach of the arm.
            InputError: The paths start at different times.
        """
        chunks = [
            self._apply(grip_path[start : start + _CHUNK], arm)
            for start in range(0, len(grip_path), _CHUNK)
        ]
        return GripPath.stack(chunks) if len(chunks) > 1 else chunks[0]

    def _apply(self, grip_path: GripPath, arm: ArmUR) -> GripPath:
        from scipy.interpolate import CubicSpline

        start = grip_path.knots[:, 0]
        if np.ptp(start) > 0.0:
            raise InputError(
                f"the paths of a batch must start at the same time: these start between "
                f"{np.min(start):g} and {np.max(start):g} s"
            )
        ends = grip_path.duration + self.settle_time
        knot_dt = _KNOT_STEPS * _STEP
        # A clamped spline needs at least three pieces.
        end_knot = np.maximum(np.ceil((ends - start) / knot_dt - 1e-9).astype(int), 3)
        knot_count = int(end_knot.max()) + 1
        times = start[0] + np.arange((knot_count - 1) * _KNOT_STEPS + 1) * _STEP
        q = arm.inverse(grip_path.evaluate(times))
        poses = arm.grip_pose(self.respond(q, _STEP)[:, ::_KNOT_STEPS])
        poses[..., 3] = np.unwrap(poses[..., 3], axis=1)
        knots = times[::_KNOT_STEPS]
        spline = CubicSpline(knots, poses, axis=1, bc_type="clamped")
        # The spline's coefficients are [power, piece, world, channel], highest power first.
        coefficients = np.zeros((len(grip_path), knot_count - 1, poses.shape[2], 6))
        coefficients[..., :4] = np.transpose(spline.c[::-1], (2, 1, 3, 0))
        # Rows that end earlier hold their settled pose.
        row_knots = np.minimum(knots, knots[end_knot][:, None])
        over = np.arange(knot_count - 1) >= end_knot[:, None]
        coefficients[over] = 0.0
        last = poses[np.arange(len(poses)), end_knot]
        coefficients[..., 0] = np.where(over[..., None], last[:, None], coefficients[..., 0])
        return GripPath(knots=row_knots, coefficients=coefficients)

    def to_dict(self) -> dict[str, list[float | None]]:
        """Return plain values to store in a file."""
        return {
            field.name: [
                float(value) if np.isfinite(value) else None for value in getattr(self, field.name)
            ]
            for field in dataclasses.fields(self)
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "ServoModel":
        """Return the model that `to_dict` described.

        Args:
            values: One list of six numbers per attribute; None stands for NaN.

        Raises:
            InputError: A value is missing, unknown or out of bounds.
        """
        try:
            arrays = {
                name: np.array([np.nan if v is None else float(v) for v in column])
                for name, column in values.items()
            }
            return cls(**arrays)
        except (TypeError, ValueError, AttributeError) as error:
            raise InputError(f"this is not a servo model: {error}") from None


def joint_response(
    q: NDArray[np.float64], dt: float, *, delay: float, frequency: float, damping: float
) -> NDArray[np.float64]:
    """Return the angle of one joint that follows evenly spaced set points.

    The controller is assumed to interpolate smoothly between the set points.

    Args:
        q: Set points, which start at rest [rad], shape [..., tick].
        dt: Interval between set points [s].
        delay: Dead time [s].
        frequency: Undamped angular frequency [rad/s].
        damping: Damping ratio [-].

    Returns:
        Joint angles at the same times [rad], shape [..., tick].
    """
    start = q[..., :1]
    delayed = _delayed(q - start, delay / dt)
    # The filter is exact for set points joined by straight lines. A smooth curve differs from its
    # chords, on average by a twelfth of the second difference.
    delayed[..., 1:-1] -= np.diff(delayed, 2, axis=-1) / 12.0
    return _filtered(delayed, *_oscillator_filter(frequency, damping, dt)) + start


def _oscillator_filter(
    frequency: float, damping: float, dt: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the digital filter that equals the oscillator for piecewise linear input.

    SciPy's `cont2discrete(..., method="foh")` gives the same coefficients, but its matrix
    exponential costs more than filtering a hundred motions.

    Args:
        frequency: Undamped angular frequency [rad/s].
        damping: Damping ratio [-].
        dt: Interval between samples [s].

    Returns:
        Numerator and denominator, each of shape [3], lowest delay first.
    """
    lag = 2.0 * damping / frequency
    # The poles are -damping * frequency +- split; split is imaginary where the joint oscillates.
    split = frequency * np.sqrt(complex(damping**2 - 1.0))
    slow = np.exp((split - damping * frequency) * dt)
    gap = -2.0 * split * dt
    fast = slow * np.exp(gap)
    # Written with expm1 and the slow pole: exact at critical damping, no overflow beyond it.
    sine = slow * dt * (np.expm1(gap) / gap if gap else 1.0)
    ramp = dt - lag + lag * (slow + fast) / 2.0 + (2.0 * damping**2 - 1.0) * sine
    a1, a2 = -float((slow + fast).real), float((slow * fast).real)
    # Three conditions fix the numerator: the response to a ramp after one interval, unit gain, and
    # the steady-state lag behind a ramp.
    gain = 1.0 + a1 + a2
    b0 = float(ramp.real) / dt
    b2 = gain * lag / dt + a1 + 2.0 * a2 - gain + b0
    return np.array([b0, gain - b0 - b2, b2]), np.array([1.0, a1, a2])


def _filtered(
    values: NDArray[np.float64], numerator: NDArray[np.float64], denominator: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Apply a digital filter of second order along the last axis, from rest.

    Args:
        values: Signal, shape [..., tick].
        numerator: Coefficients of the signal, lowest delay first, shape [3].
        denominator: Coefficients of the result, the first one 1, shape [3].

    Returns:
        Filtered signal, shape [..., tick].
    """
    from scipy.linalg import get_lapack_funcs

    driven = numerator[0] * values
    driven[..., 1:] += numerator[1] * values[..., :-1]
    driven[..., 2:] += numerator[2] * values[..., :-2]
    # The recursion is a triangular system with three diagonals, one right-hand side per signal.
    # SciPy's lfilter would do as well, but its import takes longer than identifying a servo.
    count = values.shape[-1]
    diagonals = np.repeat(denominator[:, None], count, axis=1)
    (solve,) = get_lapack_funcs(("tbtrs",), (driven,))
    result, _ = solve(diagonals, driven.reshape(-1, count).T, uplo="L", diag="U", overwrite_b=1)
    return result.T.reshape(values.shape)


def _delayed(values: NDArray[np.float64], steps: float) -> NDArray[np.float64]:
    """Delay a signal by cubic interpolation between its samples.

    Args:
        values: Signal, which starts at rest at 0, shape [..., tick].
        steps: Delay in ticks, may be fractional.

    Returns:
        Delayed signal, shape [..., tick].
    """
    whole = int(np.floor(steps))
    share = steps - whole
    count = values.shape[-1]
    before = np.zeros((*values.shape[:-1], whole + 2))
    padded = np.concatenate([before, values, values[..., -1:]], axis=-1)
    result = np.zeros_like(values)
    # Lagrange weights of the samples one tick later, at the tick, and one and two ticks before.
    places = np.array([1.0, 0.0, -1.0, -2.0])
    for index, place in enumerate(places):
        others = np.delete(places, index)
        weight = np.prod((-share - others) / (place - others))
        first = 2 + int(place)
        result += weight * padded[..., first : first + count]
    return result
