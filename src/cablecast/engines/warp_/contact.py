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
    def table_contact(model: Model, friction: lane, height: lane, before: vec3, after: vec3):
        """Velocity of a node after the table has acted on it.

        The normal impulse keeps the node from passing the surface within the step. Friction takes
        at most mu times that impulse from the tangential velocity. Its direction is that of the
        mean velocity over the step, which makes sliding second order in time; where it would stop
        the node, the node stops (Coulomb's cone, solved exactly per node).

        Args:
            friction: Coulomb coefficient [-].
            height: z of the node [m].
            before: Velocity at the start of the step [m/s].
            after: Velocity that all other forces lead to [m/s].
        """
        gap = height - lane(model.contact_height)
        rate = real(1.0) / model.dt
        # A gap may close within the step; a penetration is taken back slowly.
        floor_speed = wp.max(gap, lane()) * (-rate) - wp.min(gap, lane()) * (real(recovery) * rate)
        push = wp.max(floor_speed - after[2], lane())
        limit = mul(friction, push)
        mean_x = before[0] + after[0]
        mean_y = before[1] + after[1]
        speed = root(mul(after[0], after[0]) + mul(after[1], after[1]) + lane(real(tiny)))
        mean_speed = root(mul(mean_x, mean_x) + mul(mean_y, mean_y) + lane(real(tiny)))
        # Exact shrink for nodes about to stop, mean direction for those that slide on.
        keep = wp.max(lane(real(1.0)) - div(limit, speed), lane())
        sliding = div(limit, mean_speed)
        slow = wp.min(
            wp.max(div(speed, limit + lane(real(tiny))) - lane(real(2.0)), lane()), lane(real(1.0))
        )
        vx = mul(after[0], keep)
        vy = mul(after[1], keep)
        vx += mul(slow, after[0] - mul(sliding, mean_x) - vx)
        vy += mul(slow, after[1] - mul(sliding, mean_y) - vy)
        return wp.matrix_from_rows(vx, vy, after[2] + push)

    return SimpleNamespace(table_contact=table_contact)
