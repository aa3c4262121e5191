"""Internal forces: what one part of the cable exerts on the other, for whoever asks.

Across a segment act its tension and what bending, twist and damped rotation carry from one part of
the cable to the other. With w the bending moment over the segment length and q the force of twist
of a node (elastic.py), the part beyond segment s pulls the part before it by

    F[s] = tau[s] d[s] / dt^2 + w[s] - w[s+1] + q[s] + q[s+1] + c (v[s+1] - v[s]).
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.elastic import twist_functions
from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs


@functools.cache
def force_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the Warp functions of internal forces."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    twist = twist_functions(precision, lane_count, False)
    real, vec3, dot, scale = f.real, f.vec3, f.dot, f.scale
    Model, State, Scratch = s.Model, s.State, s.Scratch

    @wp.func
    def edge_before(model: Model, state: State, group: int, segment: int):
        """Return the edge of a segment at the start of the step that is over [m]."""
        rate = state.velocity[group][segment + 1] - state.velocity[group][segment]
        edge = state.position[group][segment + 1] - state.position[group][segment]
        return edge - rate * model.dt

    @wp.func
    def twist_force(model: Model, state: State, group: int, node: int):
        """Return the force of a node's twist on the node before it [N], twofold at a gripper."""
        last = model.node_count - 1
        force = twist.shape_force(model, state, group, node, state.twist[group][node])
        held = int(node == 0) + int(node == last)
        return force * real(1 + held)

    @wp.func
    def internal_force(model: Model, state: State, scratch: Scratch, group: int, segment: int):
        """Return the force of the part beyond a segment on the part before it [N].

        Args:
            state: State at the end of a step, with its tensions; twist at its start.
            scratch: Bending moments at the start of the step.
        """
        inverse_square = real(1.0) / (model.dt * model.dt)
        moments = scratch.bending_moment[group]
        edge = edge_before(model, state, group, segment)
        rate = state.velocity[group][segment + 1] - state.velocity[group][segment]
        elastic = moments[segment] - moments[segment + 1]
        elastic += twist_force(model, state, group, segment)
        elastic += twist_force(model, state, group, segment + 1)
        pull = scale(state.tension[group][segment] * inverse_square, edge)
        return pull + elastic + scale(model.rotation_viscosity[group], rate)

    @wp.func
    def along(model: Model, state: State, group: int, segment: int, force: vec3):
        """Return the part of a force along a segment [N]."""
        edge = edge_before(model, state, group, segment)
        return f.div(dot(force, edge), f.root(dot(edge, edge)))

    return SimpleNamespace(internal_force=internal_force, along=along)
