"""Twist and roll: how each segment turns about its own axis.

The spin of a segment is its rate of turn about its tangent, measured against a frame that is
carried along without turning (parallel transport in time). A node stores the twist between the two
segments that it joins, and its rate is

    twist' = spin[i] - spin[i-1] + kb . (v[i+1] - v[i-1]) / (2 l),

where kb = 2 e x f / (l^2 + e . f) is the curvature binormal of the edges e and f. The last term is
the holonomy of a bending curve, and its gradient gives the force with which twist acts on the
shape: what makes a twisted cable buckle into loops (Bergou et al. 2008 and 2010, gradient of the
reference twist). A twist costs C twist^2 / (2 l) with C the torsional rigidity GJ; between a
gripper and the middle of its segment lies half a cell.

Segments are so light against their torsional stiffness that twist settles within a step or a few.
Torsion is therefore taken at the end of the step (backward Euler, a tridiagonal solve), and it is
that torque which acts on the shape. In a material with a damping time T the torque follows the
twist and T times its whole rate, the holonomy included.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import numpy as np
import warp as wp

from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs

SHAPE_TORSION = 0.25
"""Most that torsion may act on the shape, as C dt^2 / (m l^3). A cable that is stiffer in torsion
is untwisted faster than a step can follow, and would throw its shape about."""

MOST_TWIST = 1.0
"""Twist at one node up to which torsion acts on the shape in full [rad]. Beyond it a chain of
segments no longer resembles a rod, and the torque stops growing."""


def spin_pivots(
    torsion: np.ndarray, inertia: np.ndarray, squared_time: np.ndarray, far_is_held: bool
) -> np.ndarray:
    """Inverse pivots of I + dt (dt + tau) (C / l) L, eliminated from the far end on.

    Args:
        torsion: C / l [N·m], shape [world].
        inertia: Moment of inertia of each segment about its axis [kg·m²], shape [world, edge].
        squared_time: dt (dt + tau), tau the time by which twist is damped [s²], shape [world].
        far_is_held: Whether the far end is kept from turning.

    Returns:
        1 / pivot [1/(kg·m²)], shape [world, edge].
    """
    k = squared_time * torsion
    edge_count = inertia.shape[1]
    inverse = np.empty_like(inertia)
    beyond = np.zeros_like(k)
    for e in reversed(range(edge_count)):
        # Half a cell at a held end is twice as stiff; a free end has nothing beyond it.
        before = 2.0 if e == 0 else 1.0
        after = 1.0 if e < edge_count - 1 else (2.0 if far_is_held else 0.0)
        pivot = inertia[:, e] + (before + after) * k - beyond
        inverse[:, e] = 1.0 / pivot
        beyond = k**2 / pivot
    return inverse


@functools.cache
def twist_functions(precision: str, lane_count: int, damped: bool) -> SimpleNamespace:
    """Build the Warp functions of twist.

    Args:
        precision: "single" or "double".
        lane_count: Number of worlds side by side.
        damped: True for a material that may damp twist.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3 = f.real, f.lane, f.vec3
    dot, cross, scale, mul = f.dot, f.cross, f.scale, f.mul
    Model, State, Scratch = s.Model, s.State, s.Scratch
    most_twist = wp.constant(MOST_TWIST)

    @wp.func
    def binormal(model: Model, sine_squared: lane, before: vec3, after: vec3):
        """Return the curvature binormal of two edges of equal length, 2 tan(phi / 2) long [-].

        The factor 2 / (l^2 + e . f) is 1 / (l^2 (1 - q)) with q = sin^2(phi / 2), here as a series
        that stays finite where edges fold back on each other.

        Args:
            model: Constants of the batch.
            sine_squared: q [-].
            before: Edge e before the node [m].
            after: Edge f after the node [m].
        """
        q = sine_squared
        one = lane(real(1.0))
        series = one + mul(q, one + mul(q, one + mul(q, one + q)))
        inverse_squared_length = real(1.0) / (model.segment_length * model.segment_length)
        return scale(series * inverse_squared_length, cross(before, after))

    @wp.func
    def store_lead(model: Model, scratch: Scratch, group: int, node: int, holonomy: lane):
        """Return by how much the dashpot of twist leads it as a curve bends [rad]; store it."""
        lead = mul(model.twist_damping_time[group], holonomy)
        scratch.lead[group, node] = lead
        return lead

    @wp.func
    def stored_lead(scratch: Scratch, group: int, node: int):
        """Return the lead of a node [rad]."""
        return scratch.lead[group][node]

    @wp.func
    def store_nothing(model: Model, scratch: Scratch, group: int, node: int, holonomy: lane):
        """Return nothing in place of `store_lead`."""
        return lane()

    @wp.func
    def no_lead(scratch: Scratch, group: int, node: int):
        """Return nothing in place of `stored_lead`."""
        return lane()

    keep_lead, lead = (store_lead, stored_lead) if damped else (store_nothing, no_lead)

    @wp.func
    def turn_twist(
        model: Model,
        state: State,
        scratch: Scratch,
        group: int,
        node: int,
        spin_difference: lane,
        edge_rates: vec3,
        new_binormal: vec3,
        previous_dt: lane,
    ):
        """Return the twist of a node after the previous step, and its lead [rad].

        Args:
            model: Constants of the batch.
            state: Holds twist and binormal of the node, which are updated.
            scratch: Receives the lead.
            group: Group of worlds.
            node: Index of the node.
            spin_difference: Spin of the segment after the node minus that before it [rad/s].
            edge_rates: Sum of the rates of both edges [m/s].
            new_binormal: Curvature binormal at the start of this step [-].
            previous_dt: Duration of the previous step [s]; 0 for worlds at rest.
        """
        # The binormal halfway through the step is the mean of those at its ends.
        twists = state.twist[group]
        binormals = state.binormal[group]
        doubled = binormals[node] + new_binormal
        holonomy = dot(doubled, edge_rates) * (real(0.25) / model.segment_length)
        twist = twists[node] + mul(previous_dt, spin_difference + holonomy)
        twists[node] = twist
        binormals[node] = new_binormal
        return twist + keep_lead(model, scratch, group, node, holonomy)

    @wp.func
    def shape_force(model: Model, state: State, group: int, node: int, twist: lane):
        """Return the force of a node's twist on the node before it [N].

        The node after it feels the opposite force.

        Args:
            model: Constants of the batch.
            state: Holds the curvature binormal of the node.
            group: Group of worlds.
            node: Index of the node.
            twist: Torque of the node at the end of the step, over GJ / l [rad].
        """
        bounded = f.smaller(f.larger(twist, lane(real(-most_twist))), lane(real(most_twist)))
        torque = mul(model.shape_torsion[group], bounded)
        half_inverse_length = real(0.5) / model.segment_length
        return scale(torque * half_inverse_length, state.binormal[group][node])

    return SimpleNamespace(
        binormal=binormal,
        lead=lead,
        turn_twist=turn_twist,
        shape_force=shape_force,
    )
