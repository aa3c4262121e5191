"""Forces on the cable that MuJoCo's rod does not have: air, the table's face, and memory.

MuJoCo knows one friction coefficient for the whole cable. The table here differs from it from place
to place, and along and across the cable; the difference is added where the cable's surface slides.
A rod of MuJoCo's is straight at rest. A real one keeps a curl, and some of every sharp bend.

All forces are computed element by element and never by a sum whose order a library may choose, so
that a trial's numbers do not depend on how many others are computed beside it.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable
from cablecast.conventions import GRAVITY
from cablecast.rigs.virtual._hidden import HiddenCable
from cablecast.rigs.virtual.table import FrictionMap

AIR_DENSITY = 1.2
_SLIP_SPEED = 0.01
"""Sliding speed below which the correction of the friction fades out [m/s]: at rest MuJoCo's own
contact holds the cable."""
_TOUCH = 0.001
"""Largest height above its lying place at which a vertex touches the table [m]."""
_STEEP = 0.3
"""Horizontal share of the direction below which the upper side is not well defined [-]: that of a
cable steeper than about 70 deg."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CableMotion:
    """Positions and velocities of a batch of cables.

    Attributes:
        vertices: Positions up to the endpoint [m], shape [world, vertex, 3].
        velocity: Velocities of the vertices [m/s], same shape.
        roll: Roll angle of each edge but the gripped one [rad], shape [world, edge - 1].
        roll_rate: Rate of that angle [rad/s], same shape.
    """

    vertices: NDArray[np.float64]
    velocity: NDArray[np.float64]
    roll: NDArray[np.float64]
    roll_rate: NDArray[np.float64]


class CableForces:
    """Forces on the free vertices of a batch of cables.

    Args:
        cable: Geometry of the cable.
        truth: True properties of the cable.
        friction_map: Friction of each place of the table.
        arc_lengths: Distance of each vertex from the grip [m], shape [vertex].
        masses: Mass lumped at each vertex [kg], shape [vertex].
        friction: Coulomb coefficient that MuJoCo applies [-], shape [world].
        curl: Curvature of each cable at the start, sideways and upwards [1/m], shape
            [world, 2, inner vertex].
    """

    def __init__(
        self,
        cable: Cable,
        truth: HiddenCable,
        friction_map: FrictionMap,
        arc_lengths: NDArray[np.float64],
        masses: NDArray[np.float64],
        friction: NDArray[np.float64],
        curl: NDArray[np.float64],
    ):
        edge = np.diff(arc_lengths)
        self._edge = edge
        self._cell = (edge[1:] + edge[:-1]) / 2
        self._radius = cable.radius
        self._truth = truth
        self._map = friction_map
        self._weight = GRAVITY * masses[2:]
        self._drag = 0.5 * AIR_DENSITY * truth.drag * cable.diameter * edge
        self._damping = truth.linear_damping * masses[2:]
        self._friction = friction
        self.curl = curl

    def evaluate(
        self, motion: CableMotion, active: NDArray[np.intp], elapsed: float
    ) -> NDArray[np.float64]:
        """Return the forces on the vertices after the gripped two.

        Args:
            motion: Positions and velocities of the active worlds.
            active: Indices of these worlds in the batch.
            elapsed: Time since the last evaluation [s], in which the cable yields.

        Returns:
            Forces [N], shape [world, vertex - 2, 3].
        """
        direction = np.diff(motion.vertices, axis=1)
        direction /= np.sqrt(_dot(direction, direction))[..., None]
        force = self._air(motion, direction)
        force += self._table(motion, direction, active)
        force += self._memory(motion, direction, active, elapsed)
        return force

    def _air(self, motion: CableMotion, direction: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return quadratic drag on the normal velocity of each edge, and linear damping [N]."""
        v = (motion.velocity[:, 1:] + motion.velocity[:, :-1]) / 2
        v -= _dot(v, direction)[..., None] * direction
        half = -(self._drag * np.sqrt(_dot(v, v)))[..., None] * v / 2
        force = half[:, 1:] - self._damping[:, None] * motion.velocity[:, 2:]
        force[:, :-1] += half[:, 2:]
        return force

    def _table(
        self, motion: CableMotion, direction: NDArray[np.float64], active: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Return the difference between the friction of this place and direction and MuJoCo's [N].

        With s the sliding velocity of the cable's underside, t along and n across the cable, the
        table pulls with -weight (mu_along s_t t + mu_across s_n n) / |s|; MuJoCo does so with one
        coefficient, and this is the difference.
        """
        truth = self._truth
        place = motion.vertices[:, 2:]
        along = direction[:, 1:, :2].copy()
        along[:, :-1] += direction[:, 2:, :2]
        along /= np.sqrt(along[..., 0] ** 2 + along[..., 1] ** 2 + 1e-12)[..., None]
        rolling = motion.roll_rate.copy()
        rolling[:, :-1] = (rolling[:, :-1] + motion.roll_rate[:, 1:]) / 2
        v = motion.velocity[:, 2:]
        slip_along = v[..., 0] * along[..., 0] + v[..., 1] * along[..., 1]
        # Across is to the right of the cable; a positive roll carries its underside to the left.
        slip_across = v[..., 0] * along[..., 1] - v[..., 1] * along[..., 0]
        slip_across = slip_across - self._radius * rolling
        speed2 = slip_along * slip_along + slip_across * slip_across
        local = truth.friction * self._map.factor(place[..., :2])
        base = self._friction[active, None]
        touches = (place[..., 2] < self._radius + _TOUCH) & (place[..., 2] > 0)
        pull = np.where(touches, self._weight, 0.0) / np.sqrt(speed2 + _SLIP_SPEED**2)
        scale = base / truth.friction
        f_along = -pull * (scale * local * (1.0 - truth.grain) - base) * slip_along
        f_across = -pull * (scale * local * (1.0 + truth.grain) - base) * slip_across
        force = np.zeros_like(v)
        force[..., 0] = f_along * along[..., 0] + f_across * along[..., 1]
        force[..., 1] = f_along * along[..., 1] - f_across * along[..., 0]
        return force

    def _memory(
        self,
        motion: CableMotion,
        direction: NDArray[np.float64],
        active: NDArray[np.intp],
        elapsed: float,
    ) -> NDArray[np.float64]:
        """Return forces that make the moments EI kappa_0 of the curl, after letting it creep [N].

        The elastic moment is EI (kappa - kappa_0); MuJoCo applies EI kappa. As a material with a
        yield stress and a viscosity, d kappa_0 / dt = (excess of |kappa - kappa_0|) / time.
        """
        truth = self._truth
        cos = _dot(direction[:, 1:], direction[:, :-1])
        binormal = _cross(direction[:, :-1], direction[:, 1:])
        curvature = binormal * (2.0 / (np.maximum(1.0 + cos, 0.1) * self._cell))[..., None]
        up, side = self._sides(motion, direction)
        # A curl to the side turns the cable about its upward side, one upwards about the other.
        bends = np.stack([_dot(curvature, up), _dot(curvature, side)], axis=1)
        elastic = bends - self.curl[active]
        size = np.sqrt(elastic[:, 0] ** 2 + elastic[:, 1] ** 2)
        excess = np.maximum(size - truth.yield_curvature, 0.0)
        share = min(elapsed / truth.yield_time, 1.0)
        self.curl[active] += elastic * (share * excess / np.maximum(size, 1e-9))[:, None]
        curl = self.curl[active]
        moment = truth.bend_stiffness * (curl[:, 0, :, None] * up + curl[:, 1, :, None] * side)
        # Each moment turns the edge behind its vertex, and the edge before it the other way.
        torque = moment.copy()
        torque[:, :-1] -= moment[:, 1:]
        push = _cross(torque, direction[:, 1:]) / self._edge[1:, None]
        force = push.copy()
        force[:, :-1] -= push[:, 1:]
        return force

    def _sides(
        self, motion: CableMotion, direction: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the cable's upper and right-hand side at each inner vertex, turned by its roll."""
        t = direction[:, 1:] + direction[:, :-1]
        t /= np.sqrt(_dot(t, t) + 1e-12)[..., None]
        up = -t[..., 2:3] * t
        up[..., 2] += 1.0
        up /= np.maximum(np.sqrt(_dot(up, up)), _STEEP)[..., None]
        side = _cross(t, up)
        cos, sin = np.cos(motion.roll)[..., None], np.sin(motion.roll)[..., None]
        return cos * up + sin * side, cos * side - sin * up


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return scalar products over the last axis, summed in one order whatever the batch."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vector products over the last axis."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out
