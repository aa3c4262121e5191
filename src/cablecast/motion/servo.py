"""Servo model: motion of the joints, and so of the gripper, that follows commanded set points.

A cast lasts a second or two and turns within tenths of a second, so a lag of a few hundredths of a
second changes the gripper's path by centimetres. That is more than the error of the cable model. A
simulator must therefore play the path that the arm takes, not the commanded path.

Each joint follows its set points with a dead time and as a damped oscillator. Where its motor is
strong enough, the oscillator is a digital filter, exact for set points that are joined by straight
lines. A motor with limits is followed step by step.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import Arm
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath
from cablecast.motion.motor import follow

# Longest step of a motor with limits [s].
_LIMIT_STEP = 0.002
# Finite acceleration [rad/s²] and speed [rad/s] that are no limits.
_NO_LIMIT = 1e9
# Time step of `apply` [s]. Coarse, so that 36,000 paths convert quickly; the result stays within
# 0.1 mm of the exact response.
_STEP = 0.016
# Time steps between the knots of the resulting path, and the time between them [s].
_KNOT_STEPS = 2
_KNOT_DT = _KNOT_STEPS * _STEP
# Knots beyond the normal end of a path, in which a joint with a weak motor may still arrive: 1 s.
_CATCH_UP_KNOTS = 31
# Angle from its last set point at which such a joint is still on its way [rad].
_AWAY = 1e-4
# Remaining share of a step input at the end of the resulting path [-].
_SETTLED = 1e-4
# Longest settling time of a resulting path [s].
_SETTLE_MAX = 2.0
# Values that None stands for in a file.
_UNKNOWN = {"acceleration_max": np.inf, "speed_max": np.inf, "residual": np.nan}
# Paths per chunk: its arrays stay in the cache, four times as fast as with a thousand.
_CHUNK = 50


def joint_response(
    q: NDArray[np.float64],
    dt: float,
    *,
    delay: float,
    frequency: float,
    damping: float,
    acceleration_max: float = math.inf,
    speed_max: float = math.inf,
) -> NDArray[np.float64]:
    """Return the angle of one joint that follows evenly spaced set points.

    The controller is assumed to interpolate smoothly between the set points.

    Args:
        q: Set points, which start at rest [rad], shape [..., tick].
        dt: Interval between set points [s].
        delay: Dead time [s].
        frequency: Undamped angular frequency [rad/s].
        damping: Damping ratio [-].
        acceleration_max: Acceleration that the motor can give at rest, and in braking [rad/s²].
        speed_max: Speed at which it can give none; in between the line from one to the other
            [rad/s].

    Returns:
        Joint angles at the same times [rad], shape [..., tick].
    """
    start = q[..., :1]
    if math.isfinite(acceleration_max) or math.isfinite(speed_max):
        motor = acceleration_max, speed_max
        return start + _limited(q - start, dt, delay, frequency, damping, *motor)
    delayed = _delayed(q - start, delay / dt)
    # The filter is exact for set points joined by straight lines. A smooth curve differs from its
    # chords, on average by a twelfth of the second difference.
    delayed[..., 1:-1] -= np.diff(delayed, 2, axis=-1) / 12.0
    return _filtered(delayed, *_oscillator_filter(frequency, damping, dt)) + start


def _limited(
    q: NDArray[np.float64],
    dt: float,
    delay: float,
    frequency: float,
    damping: float,
    acceleration_max: float,
    speed_max: float,
) -> NDArray[np.float64]:
    """Return the angle of a joint whose motor has limits; see `joint_response`."""
    parts = math.ceil(dt / _LIMIT_STEP - 1e-9)
    step = dt / parts
    fine = np.empty((parts * (q.shape[-1] - 1) + 1, *q.shape[:-1]))
    for part in range(parts):
        # Set points that many steps before each tick.
        early = np.moveaxis(_delayed(q, delay / dt + part / parts), -1, 0)
        fine[parts - part :: parts] = early[1:]
    fine[0] = 0.0
    lag = 2.0 * damping / frequency
    slow, fast, decay = _decays(frequency, damping, step)
    sine, cosine = float(decay.real), float((slow + fast).real) / 2.0
    brake = damping * frequency * sine
    # At full power the speed nears its limit exponentially; against the speed it is not weaker.
    speed_max = min(speed_max, _NO_LIMIT)
    gain = min(acceleration_max, _NO_LIMIT) * step
    kept, gained = math.exp(-gain / speed_max), -speed_max * math.expm1(-gain / speed_max)
    oscillator = (lag, cosine + brake, sine, frequency**2 * sine, cosine - brake)
    moved = follow(fine.reshape(len(fine), -1), step, *oscillator, gain, kept, gained)
    return np.moveaxis(moved[::parts].reshape(-1, *q.shape[:-1]), 0, -1)


def _oscillator_filter(
    frequency: float, damping: float, dt: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the filter (numerator, denominator) that equals the oscillator for lines as input.

    SciPy's `cont2discrete(..., method="foh")` gives the same coefficients, but its matrix
    exponential costs more than filtering a hundred motions.
    """
    lag = 2.0 * damping / frequency
    slow, fast, sine = _decays(frequency, damping, dt)
    ramp = dt - lag + lag * (slow + fast) / 2.0 + (2.0 * damping**2 - 1.0) * sine
    a1, a2 = -float((slow + fast).real), float((slow * fast).real)
    # Three conditions fix the numerator: the response to a ramp after one interval, unit gain, and
    # the steady-state lag behind a ramp.
    gain = 1.0 + a1 + a2
    b0 = float(ramp.real) / dt
    b2 = gain * lag / dt + a1 + 2.0 * a2 - gain + b0
    return np.array([b0, gain - b0 - b2, b2]), np.array([1.0, a1, a2])


def _decays(frequency: float, damping: float, dt: float) -> tuple[complex, complex, complex]:
    """Return by what factor the slow and the fast part of a free oscillator decay in one interval.

    The third number is their difference over that of their rates [s], which is the angle that a
    speed of 1 rad/s leads to.
    """
    # The poles are -damping * frequency +- split; split is imaginary where the joint oscillates.
    split = frequency * np.sqrt(complex(damping**2 - 1.0))
    slow = np.exp((split - damping * frequency) * dt)
    gap = -2.0 * split * dt
    # Written with expm1 and the slow pole: exact at critical damping, no overflow beyond it.
    return slow, slow * np.exp(gap), slow * dt * (np.expm1(gap) / gap if gap else 1.0)


def _filtered(
    values: NDArray[np.float64], numerator: NDArray[np.float64], denominator: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Apply a digital filter of second order along the last axis, from rest.

    Coefficients have shape [3], lowest delay first; the first of the denominator is 1.
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
    """Delay a signal, which starts at rest at 0, by cubic interpolation between its samples."""
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class ServoModel:
    """Second-order servo with a dead time, one per joint.

    The joint angle q follows its set point q_set as

        qdd = frequency^2 (q_set(t - delay) - q) - 2 damping frequency qd.

    as far as its motor can: its acceleration is at most acceleration_max at rest and in braking,
    nothing at speed_max, and in between on the line from one to the other.

    Attributes:
        delay: Dead time before a set point has any effect [s], shape [joint].
        frequency: Undamped angular frequency of the response [rad/s], shape [joint].
        damping: Damping ratio of the response [-], shape [joint].
        acceleration_max: Acceleration that the motor can give at rest [rad/s²], shape [joint];
            infinite where the motor is never too weak.
        speed_max: Speed at which it can give none [rad/s], shape [joint]; infinite likewise.
        residual: RMS difference between measured and modelled joint angles [rad], shape [joint];
            NaN if unknown.
    """

    delay: NDArray[np.float64]
    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    # One number stands for all joints.
    acceleration_max: NDArray[np.float64] = dataclasses.field(
        default_factory=lambda: np.array(np.inf)
    )
    speed_max: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.array(np.inf))
    residual: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.array(np.nan))

    def __post_init__(self):
        for name in _UNKNOWN:
            if np.ndim(value := getattr(self, name)) == 0:
                object.__setattr__(self, name, np.full(np.shape(self.delay), value))
        for name, unit, low, high in (
            ("delay", "s", 0.0, 0.5),
            ("frequency", "rad/s", 5.0, 5000.0),
            ("damping", "-", 0.2, 5.0),
            ("acceleration_max", "rad/s²", 0.1, np.inf),
            ("speed_max", "rad/s", 0.01, np.inf),
        ):
            values = np.asarray(getattr(self, name), dtype=float)
            object.__setattr__(self, name, values)
            if values.ndim != 1 or values.shape != np.shape(self.delay):
                raise InputError(
                    f"servo {name} has shape {values.shape}: one number per joint is needed"
                )
            if not np.all((values >= low) & (values <= high)):
                bad = values[~((values >= low) & (values <= high))][0]
                raise InputError(f"servo {name} = {bad:g} {unit} is outside [{low:g}, {high:g}]")

    @property
    def lag(self) -> NDArray[np.float64]:
        """Lag behind a steady motion, delay + 2 damping / frequency [s], shape [joint]."""
        return self.delay + 2.0 * self.damping / self.frequency

    @property
    def settle_time(self) -> float:
        """Time from the last set point until the slowest joint is at rest [s]."""
        # An overdamped response decays with the slower of its two poles.
        root = np.sqrt(np.maximum(self.damping**2 - 1.0, 0.0))
        decay = self.frequency * (self.damping - root)
        return float(min(np.max(self.delay + np.log(1.0 / _SETTLED) / decay), _SETTLE_MAX))

    def respond(self, q: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
        """Return the angles that follow set points every dt [s], both [rad], [..., tick, joint]."""
        result = np.empty_like(q)
        names = ("delay", "frequency", "damping", "acceleration_max", "speed_max")
        for joint in range(len(self.delay)):
            values = {name: getattr(self, name)[joint] for name in names}
            result[..., joint] = joint_response(q[..., joint], dt, **values)
        return result

    def apply(self, grip_path: GripPath, arm: Arm) -> GripPath:
        """Return the paths that the gripper takes along commanded paths.

        Args:
            grip_path: Commanded paths, which start from rest and at the same time.
            arm: Robot arm.

        Returns:
            One path per commanded path, which ends when the arm has settled.

        Raises:
            IKError: A path leaves the reach of the arm.
            InputError: The paths start at different times, or the arm has another number of joints.
        """
        if len(self.delay) != arm.joint_count:
            raise InputError(
                f"the servo model has {len(self.delay)} joints, the arm {arm.model} has "
                f"{arm.joint_count}"
            )
        chunks = [
            self._apply(grip_path[start : start + _CHUNK], arm)
            for start in range(0, len(grip_path), _CHUNK)
        ]
        return GripPath.stack(chunks) if len(chunks) > 1 else chunks[0]

    def _apply(self, grip_path: GripPath, arm: Arm) -> GripPath:
        from scipy.interpolate import CubicSpline

        start = grip_path.knots[:, 0]
        if np.ptp(start) > 0.0:
            raise InputError(
                f"the paths of a batch must start at the same time: these start between "
                f"{np.min(start):g} and {np.max(start):g} s"
            )
        ends = grip_path.duration - start + self.settle_time
        # A clamped spline needs at least three pieces.
        end_knot = np.maximum(np.ceil(ends / _KNOT_DT - 1e-9).astype(int), 3)
        weak = np.isfinite(self.acceleration_max) | np.isfinite(self.speed_max)
        knot_count = int(end_knot.max()) + 1 + (_CATCH_UP_KNOTS if weak.any() else 0)
        times = start[0] + np.arange((knot_count - 1) * _KNOT_STEPS + 1) * _STEP
        q = arm.inverse(grip_path.evaluate(times))
        moved = self.respond(q, _STEP)[:, ::_KNOT_STEPS]
        if weak.any():
            away = np.abs(moved - q[:, -1:])[..., weak].max(axis=-1) > _AWAY
            arrival = np.max(away * np.arange(1, knot_count + 1), axis=1)
            end_knot = np.maximum(end_knot, np.minimum(arrival, knot_count - 1))
            knot_count = int(end_knot.max()) + 1
        poses = arm.grip_pose(moved[:, :knot_count])
        poses[..., 3] = np.unwrap(poses[..., 3], axis=1)
        knots = times[: (knot_count - 1) * _KNOT_STEPS + 1 : _KNOT_STEPS]
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
        """Return the model that `to_dict` described."""
        try:
            arrays = {
                name: np.array([_UNKNOWN.get(name) if v is None else v for v in column], float)
                for name, column in values.items()
            }
            return cls(**arrays)
        except (TypeError, ValueError, AttributeError) as error:
            raise InputError(f"this is not a servo model: {error}") from None
