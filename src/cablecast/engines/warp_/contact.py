"""Contact with the table: the normal impulse, and Coulomb friction that never reverses a motion."""

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
    """Warp functions of the contact stage."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3, root, mul, div = f.real, f.lane, f.vec3, f.root, f.mul, f.div
    Model = s.Model
    recovery = wp.constant(RECOVERY)
    tiny = wp.constant(1.0e-12)

    @wp.func
    def table_contact(
        model: Model, friction: lane, height: lane, before: vec3, free: vec3, tension: vec3
    ):
        """Velocity of a node after the table has acted on it.

        The normal impulse keeps the node from passing the surface within the step. Friction takes
        at most mu times that impulse from the tangential velocity that all forces together would
        give. Its direction is that of the mean velocity over the step, which makes sliding second
        order in time; where it would stop the node, the node stops (Coulomb's cone, per node).

        Args:
            friction: Coulomb coefficient [-].
            height: z of the node [m].
            before: Velocity at the start of the step [m/s].
            free: Velocity that all forces but tension lead to [m/s].
            tension: What tension adds to it, as far as the step before tells [m/s]. It turns
                friction, but does not load it: where the cable lies, it pulls along the table.
        """
        gap = height - lane(model.contact_height)
        rate = real(1.0) / model.dt
        # A gap may close within the step; a penetration is taken back slowly.
        floor_speed = wp.max(gap, lane()) * (-rate) - wp.min(gap, lane()) * (real(recovery) * rate)
        push = wp.max(floor_speed - free[2], lane())
        limit = mul(friction, push)
        after_x = free[0] + tension[0]
        after_y = free[1] + tension[1]
        mean_x = before[0] + after_x
        mean_y = before[1] + after_y
        speed = root(mul(after_x, after_x) + mul(after_y, after_y) + lane(real(tiny)))
        mean_speed = root(mul(mean_x, mean_x) + mul(mean_y, mean_y) + lane(real(tiny)))
        # A node about to stop loses its velocity, at most the limit; one that slides on loses the
        # limit along its mean velocity.
        one = lane(real(1.0))
        stopping = wp.min(div(limit, speed), one)
        sliding = div(limit, mean_speed)
        slides = wp.min(wp.max(div(speed, limit + lane(real(tiny))) - lane(real(2.0)), lane()), one)
        stops = one - slides
        loss_x = mul(stops, mul(stopping, after_x)) + mul(slides, mul(sliding, mean_x))
        loss_y = mul(stops, mul(stopping, after_y)) + mul(slides, mul(sliding, mean_y))
        return wp.matrix_from_rows(free[0] - loss_x, free[1] - loss_y, free[2] + push)

    return SimpleNamespace(table_contact=table_contact)
