"""Contact with the table: the normal impulse on each node, and directions across the cable.

The table acts in four stages: normal impulses, spinning friction (spinning.py), sliding friction
(sliding.py), and the spin of each segment (rolling.py). Impulses on a node are per mass of the
node, as the change of velocity that they make [m/s].

The axis of the cable at a node is the chord of its neighbours over two segment lengths. It is of
unit length up to the square of the angle between segments, and shorter where the cable leaves the
table, so that rolling fades out there. The lateral direction is axis x z, the side to which a
positive spin rolls a segment.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs

RECOVERY = 0.2
"""Share of a penetration that one step takes back: enough to hold nodes at the surface to a
micrometre, too little to make them hop."""


@functools.cache
def contact_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the Warp functions of contact."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3, mul = f.real, f.lane, f.vec3, f.mul
    Model, State, Scratch = s.Model, s.State, s.Scratch
    recovery = wp.constant(RECOVERY)

    @wp.func
    def press_nodes(model: Model, state: State, scratch: Scratch, group: int):
        """Find the normal impulses that keep nodes above the table, and those on segments.

        A gap may close within the step; a penetration is taken back over several steps.

        Args:
            model: Constants of the batch.
            state: Positions at the start of the step.
            scratch: Predicted velocities; receives the normal impulses.
            group: Group of worlds.
        """
        inverse_dt = real(1.0) / model.dt
        position = state.position[group]
        predicted = scratch.velocity[group]
        mass_ratios = model.mass_ratio[group]
        normal_impulses = scratch.normal_impulse[group]
        loads = scratch.load[group]
        last = model.node_count - 1
        before = lane()
        node = int(1)
        while node < model.node_count:
            gap = position[node][2] - lane(model.radius)
            closing = f.larger(gap, lane()) * (-inverse_dt)
            recovering = f.smaller(gap, lane()) * (real(recovery) * inverse_dt)
            normal_impulse = f.larger(closing - recovering - predicted[node][2], lane())
            normal_impulses[node] = normal_impulse
            if node == last:
                before = mul(model.near_ratio[group], before)
            loads[node - 1] = before + mul(mass_ratios[node], normal_impulse)
            before = normal_impulse
            node += 1
        # The gripped node feels no table; its segment rolls by the other node alone.
        loads[0] = normal_impulses[1] * real(2.0)

    @wp.func
    def lateral(vector: vec3, axis: vec3):
        """Return the component of a vector along axis x z, in the unit of the vector."""
        return mul(vector[0], axis[1]) - mul(vector[1], axis[0])

    @wp.func
    def add_lateral(vector: vec3, value: lane, axis: vec3):
        """Return a vector plus a value along axis x z, both in the same unit."""
        return wp.matrix_from_rows(
            vector[0] + mul(value, axis[1]), vector[1] - mul(value, axis[0]), vector[2]
        )

    @wp.func
    def clamp(value: lane, limit: lane):
        """Return a value bounded to plus or minus a limit, both in the same unit."""
        return f.smaller(f.larger(value, -limit), limit)

    return SimpleNamespace(
        press_nodes=press_nodes, lateral=lateral, add_lateral=add_lateral, clamp=clamp
    )
