"""Parts of scenes: cables, states and grip paths; and measurements of a motion."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable, CableParams
from cablecast.engines.base import GRAVITY, CableState, Engine
from cablecast.motion.grip_path import GripPath

LENGTH = 0.6
RADIUS = 0.005
MASS = 0.05
LOCKED = 0.1
"""Rolling friction far above the radius: segments slide and do not roll [m]."""

BARE = CableParams(
    twist_stiffness=0.0,
    bend_stiffness=0.0,
    mass=MASS,
    endpoint_mass=0.0,
    lateral_friction=0.0,
    worksurface_friction=1.0,
    spinning_friction=0.0,
    rolling_friction=0.0,
    linear_damping=0.0,
    angular_damping=0.0,
)
"""Rope that nothing resists; each case switches on the effect that it measures."""


def make_cable(**params) -> Cable:
    """Return a test cable with these parameters, shared or per world, and all others zero."""
    params = dataclasses.replace(BARE, **params)
    return Cable(name="test", length=LENGTH, diameter=2 * RADIUS, params=params)


def from_edges(edges: ArrayLike, start: ArrayLike) -> NDArray[np.float64]:
    """Return the nodes of a cable [m], shape [node, 3], from its edges [m], [segment, 3]."""
    edges = np.asarray(edges, dtype=float)
    return np.vstack([np.zeros(3), np.cumsum(edges, axis=0)]) + np.asarray(start, dtype=float)


def planar(heading: ArrayLike, start: ArrayLike, axes: str = "xy") -> NDArray[np.float64]:
    """Return the nodes of a cable in a plane from the directions of its edges.

    Args:
        heading: Directions, counted from the first axis of the plane towards the second [rad],
            shape [segment].
        start: First node [m], shape [3].
        axes: Axes of the plane.

    Returns:
        Nodes [m], shape [node, 3].
    """
    heading = np.asarray(heading, dtype=float)
    edges = np.zeros((len(heading), 3))
    edges[:, "xyz".index(axes[0])] = np.cos(heading)
    edges[:, "xyz".index(axes[1])] = np.sin(heading)
    return from_edges(LENGTH / len(heading) * edges, start)


def straight(
    segment_count: int,
    start: ArrayLike,
    direction: ArrayLike,
    velocity: ArrayLike = (0.0, 0.0, 0.0),
) -> CableState:
    """Return a straight cable that moves as a whole."""
    s = np.linspace(0.0, LENGTH, segment_count + 1)[:, None]
    state = CableState.at_rest((np.asarray(start) + s * np.asarray(direction, dtype=float))[None])
    return dataclasses.replace(state, velocities=state.velocities + np.asarray(velocity))


def turning(state: CableState, rate: float, axis: ArrayLike, centre: ArrayLike) -> CableState:
    """Return the same cable turning about an axis through a point, at a rate [rad/s]."""
    spin = rate * np.asarray(axis, dtype=float)
    velocities = np.cross(spin, state.positions - np.asarray(centre, dtype=float))
    return dataclasses.replace(state, velocities=state.velocities + velocities)


def lengthwise(segment_count: int) -> NDArray[np.float64]:
    """Return the distance of the segments' middles from the grip [m], shape [segment]."""
    return (np.arange(segment_count) + 0.5) / segment_count * LENGTH


def hold(position: ArrayLike, yaw: float = 0.0, pitch: float = 0.0) -> GripPath:
    """Return a grip that stays where it is."""
    return GripPath.hold([*np.asarray(position, dtype=float), yaw, pitch], 1.0)


def fitted(position, duration: float, yaw=None, count: int = 200) -> GripPath:
    """Return a grip that follows a law of motion.

    Args:
        position: Function of times [s] that returns positions [m], shape [step, 3].
        duration: End of the motion, after which the grip stays [s].
        yaw: Function of times that returns headings [rad]; 0 by default.
        count: Number of samples that the path is fitted to.
    """
    times = np.linspace(0.0, duration, count)
    poses = np.zeros((count, 5))
    poses[:, :3] = position(times)
    if yaw is not None:
        poses[:, 3] = yaw(times)
    return GripPath.fit(times, poses)


def pieces_along_x(knots: ArrayLike, coefficients: ArrayLike) -> GripPath:
    """Return a grip on the table that moves along x by a polynomial in each piece.

    Args:
        knots: Bounds of the pieces [s], shape [piece + 1].
        coefficients: Coefficients of 1, t and t² since the start of the piece, shape [piece, 3].
    """
    knots = np.asarray(knots, dtype=float)
    filled = np.zeros((1, len(knots) - 1, 5, 6))
    filled[0, :, 0, :3] = coefficients
    filled[0, :, 2, 0] = RADIUS
    return GripPath(knots=knots[None], coefficients=filled)


def along_x(law, duration: float) -> GripPath:
    """Return a grip that moves along x on the table by a law."""

    def position(times):
        x = law(times)
        return np.stack([x, 0 * x, np.full_like(x, RADIUS)], axis=-1)

    return fitted(position, duration)


def rolls_after(
    engine: Engine, cable: Cable, path: GripPath, state: CableState, times
) -> NDArray[np.float64]:
    """Return the roll of every segment at given times [rad], shape [step, segment].

    A rollout returns the roll at its end only, so each time is a rollout of its own.
    """
    rolls = []
    for duration in times:
        rollout = engine.rollout(cable, path, state, duration=duration, sample_dt=duration)
        rolls.append(rollout.final_state.roll[0])
    return np.array(rolls)


def fitted_swing(times, x, omega: float, decay: float = 0.0) -> tuple[float, float]:
    """Return angular frequency [rad/s] and decay rate [1/s] of the best fitting oscillation."""
    from scipy.optimize import least_squares

    def residual(p):
        wave = p[0] * np.cos(p[1] * times) + p[2] * np.sin(p[1] * times)
        return np.exp(-p[3] * times) * wave - x

    size = np.abs(x).max()
    fit = least_squares(
        residual, [x[0], omega, 0.0, decay], x_scale=[size, omega, size, max(decay, 0.1 * omega)]
    )
    return abs(fit.x[1]), fit.x[3]


def node_masses(cable: Cable, segment_count: int) -> NDArray[np.float64]:
    """Return the masses of the nodes [kg]; the gripped one counts as none."""
    mass = np.full(segment_count + 1, float(cable.params.mass) / segment_count)
    mass[-1] = 0.5 * mass[-1] + float(cable.params.endpoint_mass)
    mass[0] = 0.0
    return mass


def energies(
    nodes: NDArray[np.float64], dt: float, cable: Cable, clamp: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return kinetic energy and potential energy (weight and bending) between samples [J].

    Args:
        nodes: Nodes [m], shape [step, node, 3].
        dt: Time between samples [s].
        cable: Cable with its masses and bend stiffness.
        clamp: Direction in which the cable leaves the grip, shape [3].
    """
    count = nodes.shape[1] - 1
    mass = node_masses(cable, count)
    kinetic = 0.5 * (mass * (np.diff(nodes, axis=0) ** 2).sum(2)).sum(1) / dt**2
    edges = np.diff(nodes, axis=1)
    edges /= np.linalg.norm(edges, axis=2, keepdims=True)
    before = np.concatenate([np.broadcast_to(clamp, (len(nodes), 1, 3)), edges[:, :-1]], axis=1)
    angle = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(edges - before, axis=2), 0.0, 1.0))
    cell = np.full(count, LENGTH / count)
    cell[0] *= 0.5
    bending = (0.5 * float(cable.params.bend_stiffness) * angle**2 / cell).sum(1)
    potential = bending + GRAVITY * (mass * nodes[..., 2]).sum(1)
    return kinetic, 0.5 * (potential[1:] + potential[:-1])
