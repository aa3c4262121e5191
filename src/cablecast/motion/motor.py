"""Kernel of a joint whose motor has limits.

Compiled, since a fit follows the same trials a thousand times, in thousands of steps each.
"""

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.runs.kernels import load, one_builder, start_warp

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportCallIssue=false, reportArgumentType=false
# pyright: reportOperatorIssue=false


def follow(points: NDArray[np.float64], step: float, *constants: float) -> NDArray[np.float64]:
    """Return the angles of a joint that follows set points from rest at 0, as far as it can.

    Args:
        points: Set points, joined by straight lines [rad], shape [tick, motion].
        step: Time from one tick to the next [s].
        *constants: Lag behind a steady motion [s]; the free oscillation of one step, as angle of an
            angle [-] and of a speed [s], and as speed lost by an angle [1/s] and kept of a speed
            [-]; the largest loss of speed in a step [rad/s]; and for the largest gain, how much of
            the speed is kept [-] and what is added to it [rad/s].

    Returns:
        Angles [rad], shape [tick, motion].
    """
    import warp as wp

    start_warp()
    kernel = _kernel()
    load(kernel)
    angles = np.zeros_like(points)
    arrays = [wp.array(values, device="cpu", copy=False) for values in (points, angles)]
    wp.launch(kernel, dim=points.shape[1], inputs=[*arrays, step, *constants], device="cpu")
    return angles


@functools.cache
def _kernel() -> Any:
    """Return the kernel: one thread for each motion."""
    import warp as wp

    real = wp.float64
    with one_builder:
        # Not fused: the same numbers on every processor.
        @wp.kernel(enable_backward=False, module="unique", module_options={"fuse_fp": False})
        def motor(
            points: wp.array2d(dtype=real),
            angles: wp.array2d(dtype=real),
            step: real,
            lag: real,
            angle_of_angle: real,
            angle_of_speed: real,
            speed_of_angle: real,
            speed_of_speed: real,
            gain: real,
            kept: real,
            gained: real,
        ):
            motion = wp.tid()
            angle, speed = real(0.0), real(0.0)
            for tick in range(points.shape[0] - 1):
                here, there = points[tick, motion], points[tick + 1, motion]
                rate = (there - here) / step
                # Exact for a set point that moves at this rate, about the motion that trails it
                # steadily.
                off, slip = angle - here + lag * rate, speed - rate
                free_angle = there - lag * rate + angle_of_angle * off + angle_of_speed * slip
                free_speed = rate - speed_of_angle * off + speed_of_speed * slip
                up = wp.min(speed + gain, kept * wp.max(speed, real(0.0)) + gained)
                down = wp.max(speed - gain, kept * wp.min(speed, real(0.0)) - gained)
                reached = wp.min(wp.max(free_speed, down), up)
                if reached == free_speed:
                    angle = free_angle
                else:
                    angle = angle + real(0.5) * step * (speed + reached)
                speed = reached
                angles[tick + 1, motion] = angle

    return motor
