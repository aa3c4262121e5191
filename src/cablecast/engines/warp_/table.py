"""The table: normal impulses, then spinning, sliding and rolling friction.

Impulses on a node are per mass of the node, as the change of velocity that they make [m/s]. The
axis of the cable at a node is the chord of its neighbours over two segment lengths. It is of unit
length up to the square of the angle between segments, and shorter where the cable leaves the table,
so that rolling fades out there. The lateral direction is axis x z, the side to which a positive
spin rolls a segment.

Spinning friction opposes the turning of a segment about the vertical. The couple is at most the
normal force on the segment times a lever arm; it acts as opposite impulses on the two nodes. It is
stored from step to step, so that a segment at rest is held by what pulls at it and does not creep:
a spring that yields at the limit, stiff enough that its play, of the order of dt^2, cannot be seen.

Sliding friction is Coulomb's cone at each node, which stops a motion and never reverses it. Where
friction along the cable is r times that across it, the cone is elliptic. With S the matrix that
stretches the part along the cable by r, a node that slips at s loses mu N S (S s) / |S s|, the
normal of the ellipse at which the most energy is lost, and one that sticks may lose up to where
|S^-1 loss| = mu N.

Edges. The table is a box whose edges are rounded by the length of a segment, so that nodes pass
them one by one without a jolt. A cable hangs over an edge and is pulled back over it. The contact
and the friction of a node on the edge or at a side are those of one on top, turned to the normal
there: with n the normal and z up, R v = v - (n + z) ((n + z) v) / (1 + n z) + 2 z (n v) turns n
upwards.

Rolling. Friction that takes lateral velocity from a node spins up the segments beside it, since it
acts at the surface. Rolling friction is a torque of at most the normal force times a lever arm; it
stops a spin and never reverses it. A node slides according to how its segments roll, and a segment
rolls according to what both its nodes lose. `predict_roll` breaks the circle: it expects the nodes
to lose again what they lost in the previous step. `finish_rolls` gives the segments their spins
once all nodes have slid, and stores the impulses that warm-start the next torsion solve.
"""

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.elastic import twist_functions
from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import Features, world_structs

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportGeneralTypeIssues=false


RECOVERY = 0.2
"""Share of a penetration that one step undoes: enough to hold nodes at the surface to a
micrometre, too little to make them hop."""

EDGE_CELLS = 1.0
"""Radius of the edges of the table over the length of a segment [-]."""


@functools.cache
def contact_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the Warp functions of contact."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3, mul = f.real, f.lane, f.vec3, f.mul
    Model, State = s.Model, s.State
    edge_cells = wp.constant(EDGE_CELLS)
    tiny = wp.constant(1.0e-12)

    @wp.func
    def past_edge(model: Model, group: int, x: vec3):
        """Return how far a node is beyond where the nearest edge begins to round [m]."""
        aside = lane(model.half_width) - f.absolute(x[0])
        ahead = f.smaller(x[1] - lane(model.y_min), lane(model.y_max) - x[1])
        return model.segment_length[group] * real(edge_cells) - f.smaller(aside, ahead)

    @wp.func
    def from_edge(model: Model, group: int, x: vec3, past: lane):
        """Return the vector from the axis of the nearest edge's rounding to a node [m].

        It is upright on top of the table, where nothing is past the edge, and level at a side.
        """
        one = lane(real(1.0))
        ahead = f.smaller(x[1] - lane(model.y_min), lane(model.y_max) - x[1])
        is_aside = f.is_positive(ahead - lane(model.half_width) + f.absolute(x[0]))
        middle = lane(real(0.5) * (model.y_min + model.y_max))
        out = f.larger(past, lane())
        side = f.is_positive(x[0]) * real(2.0) - one
        end = f.is_positive(x[1] - middle) * real(2.0) - one
        return wp.matrix_from_rows(
            mul(out, mul(is_aside, side)),
            mul(out, mul(one - is_aside, end)),
            f.larger(x[2] + model.segment_length[group] * real(edge_cells), lane()),
        )

    @wp.func
    def normal_at(model: Model, group: int, x: vec3, past: lane):
        """Return the normal of the table at a node [-]; that of its top where nothing is past."""
        arm = from_edge(model, group, x, past)
        is_past = f.is_positive(past)
        size = f.root(f.dot(arm, arm)) + lane(real(tiny))
        up = lane(real(1.0)) - is_past
        normal = f.scale(f.div(is_past, size), arm)
        return wp.matrix_from_rows(normal[0], normal[1], normal[2] + up)

    @wp.func
    def gap_at(model: Model, group: int, x: vec3, past: lane):
        """Return the distance of a node from the table, less the cable's radius [m]."""
        on_top = x[2] - model.radius[group]
        arm = from_edge(model, group, x, past)
        rounding = model.segment_length[group] * real(edge_cells)
        at_edge = f.root(f.dot(arm, arm)) - rounding - model.radius[group]
        return on_top + mul(f.is_positive(past), at_edge - on_top)

    @wp.func
    def turn_up(vector: vec3, normal: vec3):
        """Return a vector turned as a normal is turned upwards, in the unit of the vector."""
        one = lane(real(1.0))
        sum = wp.matrix_from_rows(normal[0], normal[1], normal[2] + one)
        turned = vector - f.scale(f.div(f.dot(sum, vector), one + normal[2]), sum)
        return wp.matrix_from_rows(
            turned[0], turned[1], turned[2] + f.dot(normal, vector) * real(2.0)
        )

    @wp.func
    def turn_back(vector: vec3, normal: vec3):
        """Return a vector that `turn_up` turned as it was."""
        one = lane(real(1.0))
        sum = wp.matrix_from_rows(normal[0], normal[1], normal[2] + one)
        turned = vector - f.scale(f.div(f.dot(sum, vector), one + normal[2]), sum)
        return turned + f.scale(vector[2] * real(2.0), normal)

    @wp.func
    def nearest_edge(model: Model, state: State, group: int):
        """Return how far any node of a group is beyond where an edge begins to round [m]."""
        position = state.position[group]
        past = past_edge(model, group, position[1])
        node = int(2)
        while node < model.node_count:
            past = f.larger(past, past_edge(model, group, position[node]))
            node += 1
        return wp.max(past)

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
        nearest_edge=nearest_edge,
        past_edge=past_edge,
        gap_at=gap_at,
        normal_at=normal_at,
        turn_up=turn_up,
        turn_back=turn_back,
        lateral=lateral,
        add_lateral=add_lateral,
        clamp=clamp,
    )


@functools.cache
def pressing_functions(precision: str, lane_count: int, at_edge: bool) -> SimpleNamespace:
    """Build the Warp function of normal impulses.

    `at_edge` is true for a group of which a node is at an edge; otherwise that costs nothing.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    contact = contact_functions(precision, lane_count)
    real, lane, mul = f.real, f.lane, f.mul
    Model, State, Scratch = s.Model, s.State, s.Scratch
    recovery, edged = wp.constant(RECOVERY), wp.constant(at_edge)

    @wp.func
    def press_nodes(model: Model, state: State, scratch: Scratch, group: int):
        """Find the normal impulses that keep nodes above the table, and those on segments.

        A gap may close within the step; a penetration is taken back over several steps.

        Args:
            state: Positions at the start of the step.
            scratch: Predicted velocities; receives the normal impulses.
        """
        inverse_dt = real(1.0) / model.dt
        radius = model.radius[group]
        position = state.position[group]
        predicted = scratch.velocity[group]
        mass_ratios = model.mass_ratio[group]
        normal_impulses = scratch.normal_impulse[group]
        loads = scratch.load[group]
        last = model.node_count - 1
        before = lane()
        node = int(1)
        while node < model.node_count:
            gap = position[node][2] - radius
            rising = predicted[node][2]
            if edged:
                x = position[node]
                past = contact.past_edge(model, group, x)
                gap = contact.gap_at(model, group, x, past)
                rising = f.dot(contact.normal_at(model, group, x, past), predicted[node])
            closing = f.larger(gap, lane()) * (-inverse_dt)
            recovering = f.smaller(gap, lane()) * (real(recovery) * inverse_dt)
            normal_impulse = f.larger(closing - recovering - rising, lane())
            normal_impulses[node] = normal_impulse
            if node == last:
                before = mul(model.near_ratio[group], before)
            loads[node - 1] = before + mul(mass_ratios[node], normal_impulse)
            before = normal_impulse
            node += 1
        # The gripped node feels no table; its segment rolls by the other node alone.
        loads[0] = normal_impulses[1] * real(2.0)

    return SimpleNamespace(press_nodes=press_nodes)


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
            state: State at the start of the step; its couple impulses are updated.
            scratch: Loads of the segments; predicted velocities, which are updated.
        """
        last = model.node_count - 1
        one = lane(real(1.0))
        inverse_length = model.inverse_length[group]
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
            axis = scale(inverse_length, scale(ratio, x - x_before))
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


@functools.cache
def rolling_functions(precision: str, lane_count: int, at_edge: bool) -> SimpleNamespace:
    """Build the Warp functions of rolling, and the struct `Roll`.

    Those of a group at an edge have names of their own: the compiler takes a function into a loop
    where it is called once.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    twist = twist_functions(precision, lane_count, False)
    real, lane, mul = f.real, f.lane, f.mul
    Model, State, Scratch = s.Model, s.State, s.Scratch
    stopped_scale = wp.constant(1.0e6)

    @wp.struct
    class Roll:
        """Expected rolling of one segment in this step.

        Attributes:
            start: Spin at the start of the step [rad/s].
            end: Expected spin at the end of the step [rad/s].
            repeated: Spin that the axial impulse of the previous step would lead to if it were
                repeated, minus `end` [rad/s].
            used: Spin that rolling friction stops, 0 for a segment that rolls on [rad/s].
            limit: Spin that rolling friction can stop, 0 for a segment that rolls on [rad/s].
        """

        start: lane
        end: lane
        repeated: lane
        used: lane
        limit: lane

    @wp.func
    def rolling_friction(spin: lane, limit: lane):
        """Return a spin less at most a limit, never past zero, all in [rad/s]."""
        return f.larger(spin - limit, lane()) + f.smaller(spin + limit, lane())

    @wp.func(name=f"predict_roll_{at_edge}")
    def predict_roll(
        model: Model, state: State, scratch: Scratch, group: int, segment: int, near_ratio: lane
    ):
        """Return the `Roll` of a segment whose nodes lose what they lost in the previous step.

        Args:
            state: Spins, axial impulses and lateral losses of the previous step.
            scratch: Loads; spins that the axial impulses of the previous step lead to.
            near_ratio: Mass of the node before it that lies on it, over half a segment's mass [-].
        """
        response = model.spin_response[group][segment]
        limit = mul(model.rolling_friction[group], mul(response, scratch.load[group][segment]))
        losses = state.lateral_loss[group]
        far_ratio = model.mass_ratio[group][segment + 1]
        loss = mul(near_ratio, losses[segment]) + mul(far_ratio, losses[segment + 1])
        repeated_spin = scratch.spin[group][segment]
        free_spin = repeated_spin - mul(response, state.axial_impulse[group][segment])
        driven_spin = free_spin + mul(response, loss)
        roll = Roll()
        roll.start = state.spin[group][segment]
        roll.end = rolling_friction(driven_spin, limit)
        roll.repeated = repeated_spin - roll.end
        # 1 where rolling friction brings the segment to a stop, else 0.
        one = lane(real(1.0))
        stopped = one - f.smaller(f.absolute(roll.end) * real(stopped_scale), one)
        roll.used = mul(stopped, driven_spin)
        roll.limit = mul(stopped, limit)
        return roll

    @wp.func
    def node_roll(before: Roll, after: Roll, share: real):
        """Return the mean `Roll` of the segments beside a node.

        Args:
            before: Roll of the segment before the node.
            after: Roll of the segment after the node; zero where there is none.
            share: Weight of the segment before the node: 2 at the endpoint, else 1.
        """
        half = real(0.5)
        mean = Roll()
        mean.start = (before.start * share + after.start) * half
        mean.end = (before.end * share + after.end) * half
        mean.repeated = (before.repeated * share + after.repeated) * half
        mean.used = (before.used * share + after.used) * half
        mean.limit = (before.limit * share + after.limit) * half
        return mean

    @wp.func
    def finish_rolls(model: Model, state: State, scratch: Scratch, group: int, active: lane):
        """Give each segment its spin, and store the axial impulse that led to it.

        Only a share of a change of the axial impulse is passed on to the next step. There the
        neighbours' twist answers to it in full; within a step a segment answers to the table as if
        its neighbours stood still. With that share no mode of twist answers with more than the
        change itself.

        Args:
            state: Lateral losses of this step; axial impulses and spins, which are updated.
            scratch: Loads, and predicted spins.
            active: 1, or 0 for worlds at rest.
        """
        friction = model.rolling_friction[group]
        responses = model.spin_response[group]
        mass_ratios = model.mass_ratio[group]
        losses = state.lateral_loss[group]
        axial_impulses = state.axial_impulse[group]
        loads = scratch.load[group]
        spins = scratch.spin[group]
        # The gripped node loses nothing; its segment rolls by the other node alone.
        losses[0] = losses[1]
        loss_before = losses[0]
        last = model.node_count - 2
        segment = int(0)
        while segment < model.node_count - 1:
            if segment == last:
                loss_before = mul(model.near_ratio[group], loss_before)
            response = responses[segment]
            limit = mul(friction, mul(response, loads[segment]))
            loss_after = losses[segment + 1]
            loss = loss_before + mul(mass_ratios[segment + 1], loss_after)
            repeated = mul(response, axial_impulses[segment])
            free_spin = spins[segment] - repeated
            spin = rolling_friction(free_spin + mul(response, loss), limit)
            twist.take_spin(model, state, group, segment, mul(active, spin))
            change = mul(spin - free_spin - repeated, model.radius[group])
            axial_impulses[segment] = axial_impulses[segment] + change
            loss_before = loss_after
            segment += 1

    return SimpleNamespace(
        Roll=Roll, predict_roll=predict_roll, node_roll=node_roll, finish_rolls=finish_rolls
    )


@functools.cache
def sliding_functions(
    precision: str, lane_count: int, grained: bool, at_edge: bool
) -> SimpleNamespace:
    """Build the Warp functions of sliding friction.

    `grained` is true where friction differs along and across the cable, `at_edge` for a group of
    which a node is at an edge; otherwise these cost nothing.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    contact = contact_functions(precision, lane_count)
    rolling = rolling_functions(precision, lane_count, at_edge)
    real, lane, vec3, scale, mul, div = f.real, f.lane, f.vec3, f.scale, f.mul, f.div
    Model, State, Scratch, Roll = s.Model, s.State, s.Scratch, rolling.Roll
    tiny = wp.constant(1.0e-12)
    sign_scale = wp.constant(1.0e9)
    upright = wp.constant(1.0e-6)
    edged = wp.constant(at_edge)

    @wp.func
    def slide_nodes(model: Model, state: State, scratch: Scratch, group: int):
        """Apply friction and normal impulses to the predicted velocities.

        Friction feels the tension of the previous step. The length solve starts without it, since a
        stale tension after a jerk would throw it far from the solution.

        Args:
            state: State at the start of the step; receives velocities and lateral losses.
            scratch: Normal impulses and predicted spins; predicted velocities, which are updated.
        """
        last = model.node_count - 1
        inverse_dt = real(1.0) / model.dt
        one = lane(real(1.0))
        friction = mul(model.friction[group], model.last_friction[group])
        friction_before = mul(model.friction[group], model.joint_friction[group])
        half_inverse_length = model.inverse_length[group] * real(0.5)
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
        up = wp.matrix_from_rows(lane(), lane(), one)
        node = int(last)
        while node > 0:
            x_before = position[node - 1]
            roll_before = rolling.predict_roll(model, state, scratch, group, node - 1, near_ratio)
            roll = rolling.node_roll(roll_before, roll_after, share)
            pull_before = scale(tension[node - 1], x - x_before)
            tensed = scale(inverse_mass[node], pull_after - pull_before) * inverse_dt
            # As if the segment after the node had the length of the others.
            stretched_edge = scale(ratio, x - x_before)
            axis = scale(half_inverse_length * share, x_after - x + stretched_edge)
            normal_impulse = normal_impulses[node]
            free = predicted[node]
            normal = up
            if edged:
                normal = contact.normal_at(model, group, x, contact.past_edge(model, group, x))
                axis = contact.turn_up(axis, normal)
            loss = friction_loss(
                model,
                group,
                mul(friction, normal_impulse),
                losses[node],
                velocity[node],
                free + tensed,
                roll,
                axis,
                normal,
            )
            losses[node] = contact.lateral(loss, axis)
            v = free - loss
            if edged:
                v = free - contact.turn_back(loss, normal) + scale(normal_impulse, normal)
            else:
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
        normal: vec3,
    ):
        """Return the velocity along the table that Coulomb friction takes from a node [m/s].

        At an edge it is turned as the normal is turned upwards, as is the axis.

        A node that slips on loses the limit along the mean slip velocity over the step, which makes
        sliding second order in time. A node that sticks loses what stops its contact point: all of
        its velocity along the cable; across it what it lost in the previous step, and of the slip
        that this leaves only the share of the effective mass, as the rest goes into spin, unless
        rolling friction holds it. So a cable at rest is held by what pulls at it, wherever that
        pulls, and does not creep.

        Args:
            limit: Greatest loss: mu times the normal impulse per mass [m/s].
            previous_loss: Lateral velocity that the node lost in the previous step [m/s].
            start: Velocity of the node at the start of the step [m/s].
            end: Predicted velocity of the node without friction [m/s].
            roll: Mean `Roll` of the segments beside the node.
            axis: Axis of the cable at the node [-].
            normal: Normal of the table at the node [-].
        """
        if edged:
            start = contact.turn_up(start, normal)
            end = contact.turn_up(end, normal)
        one = lane(real(1.0))
        small = lane(real(tiny))
        radius = model.radius[group]
        start_slip = contact.add_lateral(start, mul(roll.start, -radius), axis)
        end_slip = contact.add_lateral(end, mul(roll.end, -radius), axis)
        # Stick: of the slip that the previous loss leaves, `to_roll` goes into spin.
        slip = contact.lateral(end_slip, axis) - previous_loss
        slip_size = f.absolute(slip)
        slip_sign = contact.clamp(slip * real(sign_scale), one)
        held = mul(roll.limit - mul(roll.used, slip_sign), radius)
        to_roll = f.larger(slip_size - mul(model.lateral_mass[group], slip_size + held), lane())
        stick = contact.add_lateral(end_slip, contact.clamp(-slip, to_roll), axis)
        stick_size = horizontal_size(shrunk(model, group, stick, axis))
        # Slip: the direction is that of the sum of both slips, twice their mean.
        sum_slip = contact.add_lateral(start_slip + end_slip, mul(roll.repeated, -radius), axis)
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


@functools.cache
def table_functions(precision: str, lane_count: int, features: Features) -> SimpleNamespace:
    """Build the Warp function that turns predicted velocities into those beside the table."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    twist = twist_functions(precision, lane_count, False)
    real, lane, mul = f.real, f.lane, f.mul
    contact = contact_functions(precision, lane_count)
    spinning = spinning_functions(precision, lane_count)
    press_nodes, press_at_edge = (
        pressing_functions(precision, lane_count, at_edge).press_nodes for at_edge in (False, True)
    )
    slide_nodes, slide_at_edge = (
        sliding_functions(precision, lane_count, features.surface, at_edge).slide_nodes
        for at_edge in (False, True)
    )
    rolling = rolling_functions(precision, lane_count, False)
    Model, State, Scratch = s.Model, s.State, s.Scratch

    @wp.func
    def meet_table(model: Model, state: State, scratch: Scratch, group: int, active: lane):
        """Give nodes and segments the velocities and spins that the table leaves them.

        Args:
            state: Receives velocities, spins, and what the table holds.
            scratch: Predicted velocities, which are updated, and spins.
            active: 1, or 0 for worlds at rest.
        """
        at_edge = contact.nearest_edge(model, state, group) > real(0.0)
        if at_edge:
            press_at_edge(model, state, scratch, group)
        else:
            press_nodes(model, state, scratch, group)
        spinning.resist_turning(model, state, scratch, group)
        if at_edge:
            slide_at_edge(model, state, scratch, group)
        else:
            slide_nodes(model, state, scratch, group)
        rolling.finish_rolls(model, state, scratch, group, active)

    @wp.func
    def meet_nothing(model: Model, state: State, scratch: Scratch, group: int, active: lane):
        """Give nodes and segments what is predicted, in place of `meet_table`."""
        node = int(1)
        while node < model.node_count:
            state.velocity[group, node] = scratch.velocity[group, node]
            spin = mul(active, scratch.spin[group][node - 1])
            twist.take_spin(model, state, group, node - 1, spin)
            node += 1

    return SimpleNamespace(meet_table=meet_table if features.table else meet_nothing)
