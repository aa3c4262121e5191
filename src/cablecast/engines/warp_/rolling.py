"""Rolling: how the table spins up a segment about its axis, and rolling friction that resists it.

Friction that takes lateral velocity from a node spins up the segments beside it, since it acts at
the surface. Rolling friction is a torque of at most the normal force times a lever arm; it stops a
spin and never reverses it. A node slides according to how its segments roll, and a segment rolls
according to what both its nodes lose. `predict_roll` breaks the circle: it expects the nodes to
lose again what they lost in the previous step. `finish_rolls` gives the segments their spins once
all nodes have slid, and stores the impulses that warm-start the torsion solve of the next step.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportGeneralTypeIssues=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs


@functools.cache
def rolling_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the Warp functions of rolling, and the struct `Roll`."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
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

    @wp.func
    def predict_roll(
        model: Model, state: State, scratch: Scratch, group: int, segment: int, near_ratio: lane
    ):
        """Return the `Roll` of a segment whose nodes lose what they lost in the previous step.

        Args:
            model: Constants of the batch.
            state: Spins, axial impulses and lateral losses of the previous step.
            scratch: Loads; spins that the axial impulses of the previous step lead to.
            group: Group of worlds.
            segment: Index of the segment.
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
    def finish_rolls(model: Model, state: State, scratch: Scratch, group: int):
        """Give each segment its spin, and store the axial impulse that led to it.

        Only a share of a change of the axial impulse is passed on to the next step. There the
        neighbours' twist answers to it in full; within a step a segment answers to the table as if
        its neighbours stood still. With that share no mode of twist answers with more than the
        change itself.

        Args:
            model: Constants of the batch.
            state: Lateral losses of this step; axial impulses, which are updated.
            scratch: Loads; spins, which are updated.
            group: Group of worlds.
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
            spins[segment] = spin
            change = (spin - free_spin - repeated) * model.radius
            axial_impulses[segment] = axial_impulses[segment] + change
            loss_before = loss_after
            segment += 1

    return SimpleNamespace(
        Roll=Roll, predict_roll=predict_roll, node_roll=node_roll, finish_rolls=finish_rolls
    )
