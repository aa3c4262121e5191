"""Inextensibility: every segment keeps its length, by one tridiagonal solve per step (SHAKE).

Along edge e acts a tension tau[e] d[e], with d the edge at the START of the step. With
D = x*[e+1] - x*[e] the edge that the unconstrained step leads to and w the inverse masses, one
Newton iteration on |D|^2 = l^2 reads

    (w[e] + w[e+1]) (D[e].d[e]) tau[e] - w[e] (D[e].d[e-1]) tau[e-1]
        - w[e+1] (D[e].d[e+1]) tau[e+1] = (|D[e]|^2 - l^2) / 2,

where tau carries dt^2. The step before leaves a tension that is already in x*, so tau is only its
change, and one iteration leaves an error of the fourth order in dt. (Ryckaert, Ciccotti and
Berendsen 1977; gradients at the start of the step are what makes the scheme second order.)
"""

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs


@functools.cache
def length_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Warp functions of the length stage."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3, dot, mul = f.real, f.lane, f.vec3, f.dot, f.mul
    Model, State, Scratch = s.Model, s.State, s.Scratch

    @wp.func
    def eliminate_tensions(model: Model, state: State, scratch: Scratch, group: int):  # type: ignore[valid-type]
        """Forward elimination from the grip to the free end."""
        last = model.node_count - 1
        squared_length = lane(model.segment_length * model.segment_length)
        x_here = state.position[group, 0]
        x_after = state.position[group, 1]
        p_here = scratch.predicted[group, 0]
        d_before = vec3()
        d = x_after - x_here
        w = model.inverse_mass[group, 0]
        upper = lane()
        rhs = lane()
        for e in range(last):
            p_after = scratch.predicted[group, e + 1]
            predicted = p_after - p_here
            w_after = model.inverse_mass[group, e + 1]
            d_after = vec3()
            if e + 1 < last:
                x_next = state.position[group, e + 2]
                d_after = x_next - x_after
                x_after = x_next
            below = -mul(w, dot(predicted, d_before))
            above = -mul(w_after, dot(predicted, d_after))
            diagonal = mul(w + w_after, dot(predicted, d))
            error = (dot(predicted, predicted) - squared_length) * real(0.5)
            pivot = f.div(lane(real(1.0)), diagonal - mul(below, upper))
            rhs = mul(error - mul(below, rhs), pivot)
            upper = mul(above, pivot)
            scratch.upper[group, e] = upper
            scratch.rhs[group, e] = rhs
            p_here = p_after
            d_before = d
            d = d_after
            w = w_after

    @wp.func
    def tension_change(scratch: Scratch, group: int, edge: int, change_after: lane):  # type: ignore[valid-type]
        """Back substitution: the change of an edge's tension from that of the edge after it."""
        return scratch.rhs[group, edge] - mul(scratch.upper[group, edge], change_after)

    return SimpleNamespace(eliminate_tensions=eliminate_tensions, tension_change=tension_change)
