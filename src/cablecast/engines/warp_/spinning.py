"""Spinning friction: the table opposes the turning of a segment about the vertical.

The couple is at most the normal force on the segment times a lever arm; it acts as opposite
impulses on the two nodes. It is stored from step to step, so that a segment at rest is held by what
pulls at it and does not creep: a spring that yields at the limit, stiff enough that its play, of
the order of dt^2, cannot be seen.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.contact import contact_functions
from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs

COUPLE_STIFFNESS = 0.125
"""Share of a segment's turning that the stored couple takes up in a step. A node belongs to two
segments and both nodes yield, so that segments that turn to and fro stop four times as fast as one
would alone. They are held without overshoot where the stiffness and twice the damping are at most 1
(Jury's criterion)."""

COUPLE_DAMPING = 0.25
"""Share of a segment's turning that is damped in a step: enough to stop them at once."""


@functools.cache
def spinning_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the Warp functions of spinning friction."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    contact = contact_functions(precision, lane_count)
    real, lane, vec3, scale, mul = f.real, f.lane, f.vec3, f.scale, f.mul
    Model, State, Scratch = s.Model, s.State, s.Scratch
    stiffness = wp.constant(COUPLE_STIFFNESS)
    damping = wp.constant(COUPLE_DAMPING)

    @wp.func
    def resist_turning(model: Model, state: State, scratch: Scratch, group: int):
        """Apply spinning friction to the predicted velocities, and store its couples.

        Beside the stored couple a share of the turning is damped, without which the couple would
        ring.

        Args:
            model: Constants of the batch.
            state: State at the start of the step; its couple impulses are updated.
            scratch: Loads of the segments; predicted velocities, which are updated.
            group: Group of worlds.
        """
        last = model.node_count - 1
        one = lane(real(1.0))
        inverse_length = real(1.0) / model.segment_length
        segment_mass = model.segment_mass[group]
        friction = model.spinning_friction[group]
        position = state.position[group]
        velocity = state.velocity[group]
        couples = state.couple_impulse[group]
        loads = scratch.load[group]
        predicted = scratch.velocity[group]
        inverse_mass = model.inverse_mass[group]
        x = position[last]
        v = velocity[last]
        # A last segment of another length: a couple is an impulse times that length.
        ratio = model.last_ratio[group]
        # Impulse of the segment after the node [N·s].
        impulse_after = vec3()
        node = int(last)
        while node > 0:
            segment = node - 1
            x_before = position[segment]
            v_before = velocity[segment]
            axis = scale(ratio, x - x_before) * inverse_length
            limit = mul(mul(friction, ratio), loads[segment] * real(0.5))
            momentum = mul(segment_mass, contact.lateral(v - v_before, axis))
            couple = contact.clamp(couples[segment] + momentum * real(stiffness), limit)
            couples[segment] = couple
            resisting = contact.clamp(couple + momentum * real(damping), limit)
            impulse = contact.add_lateral(vec3(), resisting, axis)
            predicted[node] = predicted[node] + scale(inverse_mass[node], impulse_after - impulse)
            impulse_after = impulse
            x = x_before
            v = v_before
            ratio = one
            node -= 1

    return SimpleNamespace(resist_turning=resist_turning)
