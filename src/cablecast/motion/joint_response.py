"""Response of one joint to its set points: a dead time, a damped oscillator, and a motor.

Where the motor is strong enough, the oscillator is a digital filter, exact for set points that are
joined by straight lines. A motor with limits is followed step by step.
"""

import math

import numpy as np
from numpy.typing import NDArray

# Longest step in which a motor's limits are looked at [s].
_LIMIT_STEP = 0.002
# Acceleration [rad/s²] and speed [rad/s] that are no limits, and numbers that can be reckoned with.
_NO_LIMIT = 1e9


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
        return start + _limited(
            q - start,
            dt,
            delay=delay,
            frequency=frequency,
            damping=damping,
            acceleration_max=acceleration_max,
            speed_max=speed_max,
        )
    delayed = _delayed(q - start, delay / dt)
    # The filter is exact for set points joined by straight lines. A smooth curve differs from its
    # chords, on average by a twelfth of the second difference.
    delayed[..., 1:-1] -= np.diff(delayed, 2, axis=-1) / 12.0
    return _filtered(delayed, *_oscillator_filter(frequency, damping, dt)) + start


def _limited(
    q: NDArray[np.float64],
    dt: float,
    *,
    delay: float,
    frequency: float,
    damping: float,
    acceleration_max: float,
    speed_max: float,
) -> NDArray[np.float64]:
    """Return the angle of a joint whose motor has limits.

    Args:
        q: Set points, which start at rest at 0 [rad], shape [..., tick].
        dt: Interval between set points [s].
        delay: Dead time [s].
        frequency: Undamped angular frequency [rad/s].
        damping: Damping ratio [-].
        acceleration_max: Acceleration that the motor can give at rest, and in braking [rad/s²].
        speed_max: Speed at which it can give none [rad/s].
    """
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
    result = np.zeros_like(fine)
    angle, speed = np.zeros(q.shape[:-1]), np.zeros(q.shape[:-1])
    for tick, rate in enumerate(np.diff(fine, axis=0) / step):
        # Exact for a set point that moves at this rate, about the motion that trails it steadily.
        off, slip = angle - fine[tick] + lag * rate, speed - rate
        free_angle = fine[tick + 1] - lag * rate + (cosine + brake) * off + sine * slip
        free_speed = rate - frequency**2 * sine * off + (cosine - brake) * slip
        up = np.minimum(speed + gain, kept * np.maximum(speed, 0.0) + gained)
        down = np.maximum(speed - gain, kept * np.minimum(speed, 0.0) - gained)
        reached = np.clip(free_speed, down, up)
        angle = np.where(reached == free_speed, free_angle, angle + 0.5 * step * (speed + reached))
        speed = reached
        result[tick + 1] = angle
    return np.moveaxis(result[::parts], 0, -1)


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
    """Return by how much a free oscillator decays in one interval.

    Returns:
        Factors of its slow and of its fast part, and their difference over that of their rates
        [s], which is the angle that a speed of 1 rad/s leads to.
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
