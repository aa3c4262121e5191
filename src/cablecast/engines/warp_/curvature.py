"""Curvature and twist: the backward sweep of elasticity, from the far end to the grip.

It measures at each node how the cable is curved and twisted, and eliminates the torsion system on
its way. Gripped ends have half a cell, with the gripper in place of a segment.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportGeneralTypeIssues=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.bending import bending_functions
from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.twist import twist_functions
from cablecast.engines.warp_.world import world_structs


@functools.cache
def curvature_functions(precision: str, lane_count: int, damped: bool) -> SimpleNamespace:
    """Build the Warp functions that read segments and measure curvature and twist.

    Args:
        precision: "single" or "double".
        lane_count: Number of worlds side by side.
        damped: True for a material that may damp twist.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    node_moment = bending_functions(precision, lane_count).node_moment
    twist = twist_functions(precision, lane_count, damped)
    real, lane, vec3, dot, scale, mul = f.real, f.lane, f.vec3, f.dot, f.scale, f.mul
    Model, Path, State, Scratch = s.Model, s.Path, s.State, s.Scratch

    @wp.struct
    class Segment:
        """A segment beside a node; a gripper stands for the segment that it holds.

        Attributes:
            edge: Second node minus first [m].
            edge_rate: Rate of the edge [m/s].
            previous_spin: Spin in the previous step [rad/s].
            spin: Spin at the start of this step [rad/s].
        """

        edge: vec3
        edge_rate: vec3
        previous_spin: lane
        spin: lane

    @wp.func
    def read_segment(state: State, group: int, index: int):
        """Return the `Segment` of an index."""
        segment = Segment()
        position = state.position[group]
        velocity = state.velocity[group]
        segment.edge = position[index + 1] - position[index]
        segment.edge_rate = velocity[index + 1] - velocity[index]
        segment.previous_spin = state.spin[group][index]
        segment.spin = segment.previous_spin
        return segment

    @wp.func
    def last_segment(model: Model, state: State, group: int):
        """Return the last `Segment`, stretched to the length of the others."""
        segment = read_segment(state, group, model.node_count - 2)
        segment.edge = scale(model.last_ratio[group], segment.edge)
        segment.edge_rate = scale(model.last_ratio[group], segment.edge_rate)
        return segment

    @wp.func
    def gripper_segment(model: Model, path: Path, group: int):
        """Return a gripper as the `Segment` that it holds."""
        segment = Segment()
        segment.edge = path.direction[group] * model.segment_length
        segment.edge_rate = path.direction_rate[group] * model.segment_length
        segment.previous_spin = path.previous_spin[group]
        segment.spin = path.spin[group]
        return segment

    @wp.func
    def node_torque(
        model: Model,
        state: State,
        scratch: Scratch,
        group: int,
        node: int,
        before: Segment,
        after: Segment,
        sine_squared: lane,
        previous_dt: lane,
    ):
        """Return the torque at a node that the present spins lead to by the end of the step [N·m].

        Args:
            model: Constants of the batch.
            state: Holds twist and binormal of the node, which are brought up to now.
            scratch: Receives the lead of the twist.
            group: Group of worlds.
            node: Index of the node.
            before: Segment before the node.
            after: Segment after the node.
            sine_squared: sin^2 of half the angle between them [-].
            previous_dt: Duration of the previous step [s]; 0 for worlds at rest.
        """
        turned = twist.turn_twist(
            model,
            state,
            scratch,
            group,
            node,
            after.previous_spin - before.previous_spin,
            before.edge_rate + after.edge_rate,
            twist.binormal(model, sine_squared, before.edge, after.edge),
            previous_dt,
        )
        spin_difference = after.spin - before.spin
        return mul(model.torsion[group], turned + mul(spin_difference, model.torsion_time[group]))

    @wp.func
    def held_torque(
        model: Model,
        state: State,
        scratch: Scratch,
        group: int,
        node: int,
        before: Segment,
        after: Segment,
        previous_dt: lane,
    ):
        """Return the torque at a held node [N·m], with half a cell; store its bending moment.

        Bending at a gripper is linear in the angle to it. Arguments are those of `node_torque`.
        """
        bend = after.edge - before.edge
        sine_squared = dot(bend, bend) * (
            real(0.25) / (model.segment_length * model.segment_length)
        )
        scratch.bending_moment[group, node] = scale(model.bending[group] * real(2.0), bend)
        torque = node_torque(
            model, state, scratch, group, node, before, after, sine_squared, previous_dt
        )
        return torque * real(2.0)

    @wp.func
    def measure_curvature(
        model: Model,
        path: Path,
        far_path: Path,
        state: State,
        scratch: Scratch,
        group: int,
        previous_dt: lane,
    ):
        """Measure bending moments and twist; eliminate the torsion system from the far end on.

        Args:
            model: Constants of the batch.
            path: Direction and spin of the gripper.
            far_path: Direction and spin of the gripper at the far end, where there is one.
            state: State at the start of the step; receives twist and binormals.
            scratch: Receives bending moments, and the right side of the torsion system.
            group: Group of worlds.
            previous_dt: Duration of the previous step [s]; 0 before the first step and for worlds
                at rest.
        """
        last = model.node_count - 1
        bending = model.bending[group]
        quarter = real(0.25) / (model.segment_length * model.segment_length)
        coupling = mul(model.torsion[group], model.torsion_time[group]) * model.dt
        torque_per_impulse = model.segment_mass[group] * (real(0.5) * model.radius / model.dt)
        axial_impulses = state.axial_impulse[group]
        pivots = model.spin_pivot[group]
        moments = scratch.bending_moment[group]
        right_sides = scratch.torque[group]
        after = last_segment(model, state, group)
        torque_after = lane()
        if model.far_is_held == 1:
            gripper = gripper_segment(model, far_path, group)
            torque_after = held_torque(
                model, state, scratch, group, last, after, gripper, previous_dt
            )
        eliminated = lane()
        node = int(last - 1)
        while node > 0:
            before = read_segment(state, group, node - 1)
            bend = after.edge - before.edge
            sine_squared = dot(bend, bend) * quarter
            moments[node] = node_moment(bending, sine_squared, bend)
            torque = node_torque(
                model, state, scratch, group, node, before, after, sine_squared, previous_dt
            )
            # The segment after the node has both its torques now.
            table_torque = mul(torque_per_impulse, axial_impulses[node])
            right_side = torque_after - torque + eliminated + table_torque
            right_sides[node] = right_side
            eliminated = mul(mul(coupling, pivots[node]), right_side)
            torque_after = torque
            after = before
            node -= 1
        moments[last - 1] = moments[last - 1] * model.joint_cells
        gripper = gripper_segment(model, path, group)
        torque = held_torque(model, state, scratch, group, 0, gripper, after, previous_dt)
        table_torque = mul(torque_per_impulse, axial_impulses[0])
        right_sides[0] = torque_after - torque + eliminated + table_torque

    return SimpleNamespace(
        Segment=Segment,
        read_segment=read_segment,
        last_segment=last_segment,
        gripper_segment=gripper_segment,
        measure_curvature=measure_curvature,
    )
