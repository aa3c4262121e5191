"""Contact with the table: the normal impulse, and friction that never reverses a motion.

The axis of the cable at a node is the chord of its neighbours over two segment lengths: of unit
length up to the square of the angle between segments, and shorter where the cable leaves the table,
so that rolling fades out there.
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

TURN_STIFFNESS = 0.125
TURN_DAMPING = 0.25
"""Shares of a segment's turning that its held couple takes up in a step, and that it damps. A node
belongs to two segments and both nodes yield, so that segments that turn to and fro stop four times
as fast as one would alone: they are held without overshoot up to the sum of the stiffness and twice
the damping of 1 (Jury's criterion), and a quarter of damping stops them at once."""


@functools.cache
def contact_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Warp functions of the contact stage."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3 = f.real, f.lane, f.vec3
    root, mul, div = f.root, f.mul, f.div
    Model = s.Model
    recovery = wp.constant(RECOVERY)
    tiny = wp.constant(1.0e-12)
    turn_stiffness = wp.constant(TURN_STIFFNESS)
    turn_damping = wp.constant(TURN_DAMPING)

    @wp.func
    def normal_push(model: Model, height: lane, speed: lane):
        """Normal impulse per mass that keeps a node from passing the surface within the step.

        A gap may close within the step; a penetration is taken back slowly.

        Args:
            height: z of the node [m].
            speed: Vertical velocity that all other forces lead to [m/s].
        """
        gap = height - lane(model.contact_height)
        rate = real(1.0) / model.dt
        floor_speed = wp.max(gap, lane()) * (-rate) - wp.min(gap, lane()) * (real(recovery) * rate)
        return wp.max(floor_speed - speed, lane())

    @wp.func
    def along_normal(a: vec3, axis: vec3):
        """Part of a vector along axis x z, the side to which a positive spin rolls a segment."""
        return mul(a[0], axis[1]) - mul(a[1], axis[0])

    @wp.func
    def add_normal(a: vec3, value: lane, axis: vec3):
        """A vector plus some of axis x z."""
        return wp.matrix_from_rows(a[0] + mul(value, axis[1]), a[1] - mul(value, axis[0]), a[2])

    @wp.func
    def friction_loss(
        limit: lane,
        roll_share: lane,
        hold: lane,
        used: lane,
        driven: lane,
        again: lane,
        axis: vec3,
        before: vec3,
        after: vec3,
    ):
        """Tangential velocity that Coulomb friction takes from a node.

        Friction acts where the node touches the table and takes at most mu times the normal
        impulse. A node that slides on loses that along the mean velocity of its contact point over
        the step, which makes sliding second order in time. One that is about to stop loses what
        stops its contact point: all of its velocity along the cable; across it what it lost in the
        step before, and of what that would leave only a share, as the rest goes into spin, unless
        rolling friction holds it (Coulomb's cone, per node). So a cable at rest is held by what
        pulls at it, wherever that pulls, and does not creep.

        Args:
            limit: mu times the normal impulse per mass [m/s].
            roll_share: That share: a third for a cylinder that twist does not hold.
            hold: Velocity of the surface up to which rolling friction keeps it from spinning up
                [m/s]; none where it spins.
            used: What of it already holds against twist, with the sign of that spin [m/s].
            driven: What the table's torque of the step before, if it acted again, would add to the
                velocity of the contact point [m/s].
            again: Sideways velocity that the node lost in the step before [m/s]; its neighbours'
                losses are taken to repeat themselves as well.
            axis: Horizontal direction of the cable, of unit length.
            before: Velocity of the contact point at the start of the step [m/s].
            after: The same after all but friction, but with the spins that the losses of the step
                before and rolling friction would lead to [m/s].
        """
        one = lane(real(1.0))
        small = lane(real(tiny))
        sideways = along_normal(after, axis) - again
        size = wp.max(sideways, -sideways)
        sign = wp.min(wp.max(sideways * real(1.0e9), -one), one)
        hold_left = hold - mul(used, sign)
        rest = wp.max(size - mul(roll_share, size + hold_left), lane())
        # What is left to roll has the sign of the sideways velocity.
        stop = add_normal(after, wp.max(wp.min(-sideways, rest), -rest), axis)
        stop_size = root(mul(stop[0], stop[0]) + mul(stop[1], stop[1]) + small)
        slides = wp.min(wp.max(div(stop_size, limit + small) - lane(real(2.0)), lane()), one)
        twice = add_normal(before + after, driven, axis)
        mean_size = root(mul(twice[0], twice[0]) + mul(twice[1], twice[1]) + small)
        stops = mul(one - slides, wp.min(div(limit, stop_size), one))
        slides = mul(slides, div(limit, mean_size))
        return wp.matrix_from_rows(
            mul(stops, stop[0]) + mul(slides, twice[0]),
            mul(stops, stop[1]) + mul(slides, twice[1]),
            lane(),
        )

    @wp.func
    def roll_friction(spin: lane, limit: lane):
        """Take at most a limit from a spin, never past zero.

        Rolling friction is a torque of at most the normal force times a lever arm; like Coulomb
        friction, it stops a spin and never reverses it.
        """
        return wp.max(spin - limit, lane()) + wp.min(spin + limit, lane())

    @wp.func
    def next_torque(torque: lane, spun: lane, gain: lane, radius: real):
        """What the table did to a spin, on its way to the torsion solve of the next step.

        There the neighbours' twist answers to it in full; within a step a segment answers to the
        table as if its neighbours stood still. Only that share of a change is passed on which no
        mode of twist can answer with more than the change itself.

        Args:
            torque: Impulse of the torque of the step before, over m r / 2 [m/s].
            spun: What the table did to the spin in this step [rad/s].
            gain: Spin per impulse, where the neighbours stand still [1/m].
            radius: Of the cable [m].
        """
        return torque + (spun - mul(gain, torque)) * radius

    @wp.func
    def hold_turn(model: Model, held: lane, limit: lane, group: int, relative: lane):
        """Couple that the table takes up against a segment's turning on the spot, one step on.

        It is stored from step to step, so that a segment at rest is held by what pulls at it and
        does not creep by what one step adds: a spring that yields at the limit, stiff enough that
        its play, of the order of dt^2, cannot be seen.

        Args:
            held: Impulse that holds the segment now, on its first node [N·s].
            limit: Normal impulse per mass on the segment [m/s].
            relative: Sideways velocity of the second node against the first [m/s].
        """
        most = mul(model.spinning[group], limit)
        more = held + mul(model.segment_mass[group], relative) * real(turn_stiffness)
        return wp.min(wp.max(more, -most), most)

    @wp.func
    def spinning_impulse(model: Model, held: lane, limit: lane, group: int, relative: lane):
        """Impulse on the first node of a segment from the friction against turning on the spot.

        The table opposes the turning of each segment about the vertical with a couple of at most
        the normal force times a lever arm; the other node feels the opposite. It is what the table
        holds, and a share of the turning itself, without which the hold would ring.
        """
        most = mul(model.spinning[group], limit)
        wish = held + mul(model.segment_mass[group], relative) * real(turn_damping)
        return wp.min(wp.max(wish, -most), most)

    return SimpleNamespace(
        normal_push=normal_push,
        along_normal=along_normal,
        add_normal=add_normal,
        friction_loss=friction_loss,
        roll_friction=roll_friction,
        next_torque=next_torque,
        hold_turn=hold_turn,
        spinning_impulse=spinning_impulse,
    )
