"""Sliding friction: Coulomb's cone at each node, which stops a motion and never reverses it.

Where friction along the cable is r times that across it, the cone is elliptic. With S the matrix
that stretches the part along the cable by r, a node that slips at s loses mu N S (S s) / |S s|, the
normal of the ellipse at which the most energy is lost, and one that sticks may lose up to where
|S^-1 loss| = mu N.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.contact import contact_functions
from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.rolling import rolling_functions
from cablecast.engines.warp_.world import world_structs


@functools.cache
def sliding_functions(precision: str, lane_count: int, grained: bool) -> SimpleNamespace:
    """Build the Warp functions of sliding friction.

    Args:
        precision: "single" or "double".
        lane_count: Number of worlds side by side.
        grained: True where friction differs along and across the cable; otherwise that costs
            nothing.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    contact = contact_functions(precision, lane_count)
    rolling = rolling_functions(precision, lane_count)
    real, lane, vec3, scale, mul, div = f.real, f.lane, f.vec3, f.scale, f.mul, f.div
    Model, State, Scratch, Roll = s.Model, s.State, s.Scratch, rolling.Roll
    tiny = wp.constant(1.0e-12)
    sign_scale = wp.constant(1.0e9)
    upright = wp.constant(1.0e-6)

    @wp.func
    def slide_nodes(model: Model, state: State, scratch: Scratch, group: int):
        """Apply friction and normal impulses to the predicted velocities.

        Friction feels the tension of the previous step. The length solve starts without it, since a
        stale tension after a jerk would throw it far from the solution.

        Args:
            model: Constants of the batch.
            state: State at the start of the step; receives velocities and lateral losses.
            scratch: Normal impulses and predicted spins; predicted velocities, which are updated.
            group: Group of worlds.
        """
        last = model.node_count - 1
        inverse_dt = real(1.0) / model.dt
        one = lane(real(1.0))
        friction = mul(model.friction[group], model.last_friction[group])
        friction_before = mul(model.friction[group], model.joint_friction[group])
        half_inverse_length = real(0.5) / model.segment_length
        position = state.position[group]
        velocity = state.velocity[group]
        tension = state.tension[group]
        losses = state.lateral_loss[group]
        normal_impulses = scratch.normal_impulse[group]
        predicted = scratch.velocity[group]
        inverse_mass = model.inverse_mass[group]
        x = position[last]
        # The endpoint has only the segment before it, which stands for both.
        x_after = x
        share = real(2.0)
        ratio = model.last_ratio[group]
        near_ratio = model.near_ratio[group]
        roll_after = Roll()
        pull_after = vec3()
        node = int(last)
        while node > 0:
            x_before = position[node - 1]
            roll_before = rolling.predict_roll(model, state, scratch, group, node - 1, near_ratio)
            roll = rolling.node_roll(roll_before, roll_after, share)
            pull_before = scale(tension[node - 1], x - x_before)
            tensed = scale(inverse_mass[node], pull_after - pull_before) * inverse_dt
            # As if the segment after the node had the length of the others.
            stretched_edge = scale(ratio, x - x_before)
            axis = (x_after - x + stretched_edge) * (half_inverse_length * share)
            normal_impulse = normal_impulses[node]
            free = predicted[node]
            loss = friction_loss(
                model,
                group,
                mul(friction, normal_impulse),
                losses[node],
                velocity[node],
                free + tensed,
                roll,
                axis,
            )
            losses[node] = contact.lateral(loss, axis)
            v = free - loss
            v[2] = v[2] + normal_impulse
            predicted[node] = v
            velocity[node] = v
            x_after = x_before + stretched_edge
            x = x_before
            ratio = one
            friction = friction_before
            friction_before = model.friction[group]
            roll_after = roll_before
            pull_after = pull_before
            share = real(1.0)
            near_ratio = one
            node -= 1

    @wp.func
    def friction_loss(
        model: Model,
        group: int,
        limit: lane,
        previous_loss: lane,
        start: vec3,
        end: vec3,
        roll: Roll,
        axis: vec3,
    ):
        """Return the horizontal velocity that Coulomb friction takes from a node [m/s].

        A node that slips on loses the limit along the mean slip velocity over the step, which makes
        sliding second order in time. A node that sticks loses what stops its contact point: all of
        its velocity along the cable; across it what it lost in the previous step, and of the slip
        that this leaves only the share of the effective mass, as the rest goes into spin, unless
        rolling friction holds it. So a cable at rest is held by what pulls at it, wherever that
        pulls, and does not creep.

        Args:
            model: Constants of the batch.
            group: Group of worlds.
            limit: Greatest loss: mu times the normal impulse per mass [m/s].
            previous_loss: Lateral velocity that the node lost in the previous step [m/s].
            start: Velocity of the node at the start of the step [m/s].
            end: Predicted velocity of the node without friction [m/s].
            roll: Mean `Roll` of the segments beside the node.
            axis: Axis of the cable at the node [-].
        """
        one = lane(real(1.0))
        small = lane(real(tiny))
        radius = model.radius
        start_slip = contact.add_lateral(start, roll.start * (-radius), axis)
        end_slip = contact.add_lateral(end, roll.end * (-radius), axis)
        # Stick: of the slip that the previous loss leaves, `to_roll` goes into spin.
        slip = contact.lateral(end_slip, axis) - previous_loss
        slip_size = f.absolute(slip)
        slip_sign = contact.clamp(slip * real(sign_scale), one)
        held = (roll.limit - mul(roll.used, slip_sign)) * radius
        to_roll = f.larger(slip_size - mul(model.lateral_mass[group], slip_size + held), lane())
        stick = contact.add_lateral(end_slip, contact.clamp(-slip, to_roll), axis)
        stick_size = horizontal_size(shrunk(model, group, stick, axis))
        # Slip: the direction is that of the sum of both slips, twice their mean.
        sum_slip = contact.add_lateral(start_slip + end_slip, roll.repeated * (-radius), axis)
        sum_slip = stretched(model, group, sum_slip, axis)
        slips = f.smaller(f.larger(div(stick_size, limit + small) - lane(real(2.0)), lane()), one)
        stick_share = mul(one - slips, f.smaller(div(limit, stick_size), one))
        slip_share = mul(slips, div(limit, horizontal_size(sum_slip)))
        sum_slip = stretched(model, group, sum_slip, axis)
        return wp.matrix_from_rows(
            mul(stick_share, stick[0]) + mul(slip_share, sum_slip[0]),
            mul(stick_share, stick[1]) + mul(slip_share, sum_slip[1]),
            lane(),
        )

    @wp.func
    def scale_along(vector: vec3, axis: vec3, factor: lane):
        """Return a vector whose part along an axis is scaled by a factor, on the table.

        An axis that stands upright has no direction on the table and scales nothing.
        """
        along = mul(vector[0], axis[0]) + mul(vector[1], axis[1])
        square = mul(axis[0], axis[0]) + mul(axis[1], axis[1]) + lane(real(upright))
        added = div(mul(factor - lane(real(1.0)), along), square)
        return wp.matrix_from_rows(
            vector[0] + mul(added, axis[0]), vector[1] + mul(added, axis[1]), vector[2]
        )

    @wp.func
    def stretch(model: Model, group: int, vector: vec3, axis: vec3):
        """Return S times a vector."""
        return scale_along(vector, axis, model.friction_ratio[group])

    @wp.func
    def shrink(model: Model, group: int, vector: vec3, axis: vec3):
        """Return S^-1 times a vector."""
        return scale_along(vector, axis, div(lane(real(1.0)), model.friction_ratio[group]))

    @wp.func
    def keep(model: Model, group: int, vector: vec3, axis: vec3):
        """Return a vector as it is, in place of `stretch` and `shrink`."""
        return vector

    stretched, shrunk = (stretch, shrink) if grained else (keep, keep)

    @wp.func
    def horizontal_size(vector: vec3):
        """Return the size of the horizontal part of a vector, never 0, in the vector's unit."""
        return f.root(mul(vector[0], vector[0]) + mul(vector[1], vector[1]) + lane(real(tiny)))

    return SimpleNamespace(slide_nodes=slide_nodes)
