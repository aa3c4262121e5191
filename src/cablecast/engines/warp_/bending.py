"""Bending: the moment EI times curvature, and the filter that keeps its waves true.

At an inner node the curvature vector is b / l^2 with b = x[i-1] - 2 x[i] + x[i+1]. Segments keep
their length, so |b| = 2 l sin(phi / 2), where phi is the angle between the two edges. The energy is
that of a rod whose curvature phi / l is constant around the node, E = EI phi^2 / (2 l); its
gradient is EI / l^3 times (phi / sin phi) times b, spread over three nodes as (1, -2, 1). At the
grip the cable leaves along the gripper's tangent t: half a cell with u = x[1] - x[0] - l t.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from cablecast.engines.warp_.lanes import lane_functions

FILTER_SHARE = 1.0 / 12.0
"""Share of dt^2 K, added to the masses that the bending force accelerates, with which waves travel
as they should up to the fourth order of the step: it undoes what leapfrog adds to their
frequency, w (w dt)^2 / 24. A greater share would make any step stable for a straight cable, and
create energy on a curved one (substeps.py)."""

SHARPEST = 0.6
"""Largest sin^2(phi / 2) up to which the moment follows the angle: 101 degrees at one node. Beyond
it a chain of segments no longer resembles a rod, and the moment stops growing."""


def filter_factors(
    bending: NDArray[np.float64],
    mass: NDArray[np.float64],
    dt: float,
    joint: tuple[NDArray[np.float64], float] | None = None,
) -> tuple[NDArray[np.float64], ...]:
    """Factor M + dt^2 K / 12 = L D L^T, with K the stiffness matrix of a nearly straight rod.

    Args:
        bending: EI / l^3 [N/m], shape [world].
        mass: Node masses [kg], infinite where held, shape [world, node].
        dt: Step [s].
        joint: Length of the other segments over that of the last one, an attachment's, shape
            [world], and stiffness of its joint over that of a whole cell; None without one.

    Returns:
        1 / D [1/kg], shape [world, node], and the first and second lower diagonals of L [-], with
        two zeros beyond the last node, shape [world, node + 2].
    """
    world_count, node_count = mass.shape
    k = FILTER_SHARE * dt**2 * bending
    free = np.isfinite(mass)
    diagonal = np.where(free, mass, 1.0)
    off1 = np.zeros_like(diagonal)  # couples i and i + 1
    off2 = np.zeros_like(diagonal)  # couples i and i + 2
    diagonal[:, 1] += 2.0 * k
    diagonal[:, -2] += np.where(free[:, -1], 0.0, 2.0 * k)
    ratio, cells = (np.ones_like(k), 1.0) if joint is None else joint
    for i in range(1, node_count - 1):
        s, c = (ratio, cells * k) if i == node_count - 2 else (np.ones_like(k), k)
        # The bend x[i-1] - (1 + s) x[i] + s x[i+1], squared.
        diagonal[:, i - 1] += c
        diagonal[:, i] += (1.0 + s) ** 2 * c
        diagonal[:, i + 1] += s**2 * c
        off1[:, i - 1] -= (1.0 + s) * c
        off1[:, i] -= (1.0 + s) * s * c
        off2[:, i - 1] += s * c
    # Held nodes do not accelerate: take them out of the system.
    off1[:, :-1] *= free[:, :-1] & free[:, 1:]
    off2[:, :-2] *= free[:, :-2] & free[:, 2:]
    d = np.ones((world_count, node_count))
    lower1 = np.zeros_like(d)
    lower2 = np.zeros_like(d)
    for i in range(node_count):
        d[:, i] = diagonal[:, i]
        if i >= 2:
            lower2[:, i] = off2[:, i - 2] / d[:, i - 2]
            d[:, i] -= lower2[:, i] ** 2 * d[:, i - 2]
        if i >= 1:
            coupling = off1[:, i - 1].copy()
            if i >= 2:
                coupling -= lower2[:, i] * d[:, i - 2] * lower1[:, i - 1]
            lower1[:, i] = coupling / d[:, i - 1]
            d[:, i] -= lower1[:, i] ** 2 * d[:, i - 1]
    beyond = [(0, 0), (0, 2)]
    return np.where(free, 1.0 / d, 0.0), np.pad(lower1, beyond), np.pad(lower2, beyond)


@functools.cache
def bending_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the Warp functions of bending."""
    f = lane_functions(precision, lane_count)
    real, lane, vec3, scale, mul = f.real, f.lane, f.vec3, f.scale, f.mul
    sharpest = wp.constant(SHARPEST)

    @wp.func
    def angle_over_sine(sine_squared: lane):
        """Return phi / sin(phi) from q = sin^2(phi / 2) [-]: 1 + 2/3 q + 8/15 q^2 + ..."""
        q = f.smaller(sine_squared, lane(real(sharpest)))
        value = lane(real(128.0 / 315.0)) + q * real(256.0 / 693.0)
        value = lane(real(16.0 / 35.0)) + mul(q, value)
        value = lane(real(8.0 / 15.0)) + mul(q, value)
        value = lane(real(2.0 / 3.0)) + mul(q, value)
        return lane(real(1.0)) + mul(q, value)

    @wp.func
    def node_moment(bending: lane, sine_squared: lane, bend: vec3):
        """Return the bending moment over the segment length at an inner node [N].

        It is the gradient EI / l^3 (phi / sin phi) b of the energy.

        Args:
            bending: EI / l^3 [N/m].
            sine_squared: sin^2(phi / 2) [-].
            bend: b, the edge after the node minus the edge before it [m].
        """
        return scale(mul(bending, angle_over_sine(sine_squared)), bend)

    @wp.func
    def bend_energy(sine_squared: lane):
        """Return phi^2 / 2 from q = sin^2(phi / 2) [-], as far as `node_moment` follows it.

        It is the sum 2 q + 2/3 q^2 + 16/45 q^3 + ... of which `angle_over_sine` is half the slope.
        """
        q = f.smaller(sine_squared, lane(real(sharpest)))
        value = lane(real(256.0 / 1575.0)) + q * real(256.0 / 2079.0)
        value = lane(real(8.0 / 35.0)) + mul(q, value)
        value = lane(real(16.0 / 45.0)) + mul(q, value)
        value = lane(real(2.0 / 3.0)) + mul(q, value)
        value = mul(q, lane(real(2.0)) + mul(q, value))
        return value + mul(sine_squared - q, angle_over_sine(q)) * real(2.0)

    return SimpleNamespace(node_moment=node_moment, bend_energy=bend_energy)
