"""Drag of the air: quadratic in the speed, and across the cable only.

A length dl of a cable of diameter d that moves across itself at a velocity v feels a force of
1/2 rho C d |v| v dl; along itself it feels nothing (Morison's cross-flow principle). A step takes
k |v| v' with v the velocity across at its start, v' that at its end and k the drag over the mass of
the node: implicit, of second order in time, and exact for a node that nothing else moves, whose
speed falls as v / (1 + k v t).
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs


@functools.cache
def air_functions(precision: str, lane_count: int, drags: bool) -> SimpleNamespace:
    """Build the Warp function of the air.

    Args:
        precision: "single" or "double".
        lane_count: Number of worlds side by side.
        drags: True where the air resists; otherwise the function does nothing.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3, dot, scale, mul, div = f.real, f.lane, f.vec3, f.dot, f.scale, f.mul, f.div
    Model, State, Scratch = s.Model, s.State, s.Scratch
    folded = wp.constant(1.0e-6)

    @wp.func
    def across(vector: vec3, chord: vec3, inverse_square: lane):
        """Return what of a vector is not along a chord, given 1 / |chord|²."""
        return vector - scale(mul(dot(vector, chord), inverse_square), chord)

    @wp.func
    def resist(model: Model, state: State, scratch: Scratch, group: int, force_dt: real):
        """Take from predicted velocities what the air takes in this step.

        Args:
            model: Constants of the batch.
            state: State at the start of the step.
            scratch: Predicted velocities, which are updated.
            group: Group of worlds.
            force_dt: Time for which forces act in this step [s].
        """
        last = model.node_count - 1
        one = lane(real(1.0))
        least = lane(model.segment_length * model.segment_length * real(folded))
        drag_dt = model.drag[group] * force_dt
        position = state.position[group]
        velocity = state.velocity[group]
        predicted = scratch.velocity[group]
        inverse_mass = model.inverse_mass[group]
        x = position[last]
        x_after = x
        # Half a cell lies at the endpoint.
        cells = real(0.5)
        node = int(last)
        while node > 0:
            x_before = position[node - 1]
            chord = x_after - x_before
            inverse_square = div(one, dot(chord, chord) + least)
            v = across(velocity[node], chord, inverse_square)
            taken = mul(mul(drag_dt * cells, inverse_mass[node]), f.root(dot(v, v)))
            free = predicted[node]
            share = div(taken, one + taken)
            predicted[node] = free - scale(share, across(free, chord, inverse_square))
            x_after = x
            x = x_before
            cells = real(1.0)
            node -= 1

    @wp.func
    def resist_nothing(model: Model, state: State, scratch: Scratch, group: int, force_dt: real):
        """Do nothing in place of `resist`."""

    return SimpleNamespace(resist=resist if drags else resist_nothing)
