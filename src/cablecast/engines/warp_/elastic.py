"""Elasticity: two sweeps over the nodes that turn shape and spins into forces.

The backward sweep, from the far end to the grip, measures at each node how the cable is curved and
twisted, and eliminates the torsion system on its way. The forward sweep solves for the spins, and
with them for the torques; sums bending and torsion to the force on each node; and eliminates the
filter of the bending force (bending.py) on its way. What is left of the filter is substituted by
the stage that moves the nodes (step.py).
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.bending import bending_functions
from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.twist import twist_functions
from cablecast.engines.warp_.world import world_structs


@functools.cache
def elastic_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Warp functions of the elastic stage."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    node_moment = bending_functions(precision, lane_count).node_moment
    twist = twist_functions(precision, lane_count)
    real, lane, vec3, dot, scale, mul = f.real, f.lane, f.vec3, f.dot, f.scale, f.mul
    Model, Path, State, Scratch = s.Model, s.Path, s.State, s.Scratch

    @wp.func
    def measure_curvature(
        model: Model,
        path: Path,
        far_path: Path,
        state: State,
        scratch: Scratch,
        group: int,
        elapsed: lane,
    ):
        """Bending moment and twist of each node; backward elimination of the torsion system.

        Args:
            elapsed: Duration of the last step [s]; 0 before the first and for worlds at rest.
        """
        last = model.node_count - 1
        dt = model.dt
        bending = model.bending[group]
        torsion = model.torsion[group]
        coupling = torsion * (dt * dt)
        per_torque = model.segment_mass[group] * (real(0.5) * model.contact_height / dt)
        table_torques = state.table_torque[group]
        quarter = real(0.25) / (model.segment_length * model.segment_length)
        position = state.position[group]
        velocity = state.velocity[group]
        spins = state.spin[group]
        twists = state.twist[group]
        binormals = state.binormal[group]
        pivots = model.spin_pivot[group]
        moments = scratch.moment[group]
        eliminated = scratch.spin[group]
        x_here = position[last - 1]
        v_here = velocity[last - 1]
        edge_after = position[last] - x_here
        rate_after = velocity[last] - v_here
        spin_after = spins[last - 1]
        torque_after = lane()
        if model.far_is_held == 1:
            # Half a cell at a gripper, whose bending is linear in the angle to it.
            held = far_path.direction[group] * model.segment_length
            bend = held - edge_after
            curvature = twist.binormal(model, dot(bend, bend) * quarter, edge_after, held)
            turning = rate_after + far_path.turn[group] * model.segment_length
            turned = twist.turn_twist(
                model, twists, binormals, last, -spin_after, turning, curvature, elapsed
            )
            torque_after = mul(torsion, turned - spin_after * dt) * real(2.0)
            moments[last] = scale(bending * real(2.0), bend)
        passed_on = lane()
        for back in range(1, last):
            i = last - back
            x_before = position[i - 1]
            v_before = velocity[i - 1]
            edge = x_here - x_before
            rate = v_here - v_before
            spin = spins[i - 1]
            bend = edge_after - edge
            sine_squared = dot(bend, bend) * quarter
            curvature = twist.binormal(model, sine_squared, edge, edge_after)
            difference = spin_after - spin
            turned = twist.turn_twist(
                model, twists, binormals, i, difference, rate + rate_after, curvature, elapsed
            )
            # The torque that the present spins lead to by the end of the step.
            torque = mul(torsion, turned + difference * dt)
            moments[i] = node_moment(bending, sine_squared, bend)
            y = torque_after - torque + passed_on + mul(per_torque, table_torques[i])
            eliminated[i] = y
            passed_on = mul(mul(coupling, pivots[i]), y)
            torque_after = torque
            spin_after = spin
            edge_after = edge
            rate_after = rate
            x_here = x_before
            v_here = v_before
        edge = path.direction[group] * model.segment_length
        bend = edge_after - edge
        curvature = twist.binormal(model, dot(bend, bend) * quarter, edge, edge_after)
        turning = rate_after + path.turn[group] * model.segment_length
        difference = spin_after - path.spin_before[group]
        turned = twist.turn_twist(
            model, twists, binormals, 0, difference, turning, curvature, elapsed
        )
        torque = mul(torsion, turned + (spin_after - path.spin[group]) * dt) * real(2.0)
        moments[0] = scale(bending * real(2.0), bend)
        eliminated[0] = torque_after - torque + passed_on + mul(per_torque, table_torques[0])

    @wp.func
    def elastic_forces(
        model: Model, path: Path, state: State, scratch: Scratch, group: int, kick: real
    ):
        """Spins after torsion and damping, and the force on each node.

        A node's moment w and torque q act on its neighbours: the force on node i is
        2 w[i] - w[i-1] - w[i+1] + q[i+1] - q[i-1].
        """
        last = model.node_count - 1
        dt = model.dt
        coupling = model.torsion[group] * (dt * dt)
        shape_torsion = model.shape_torsion[group]
        one = lane(real(1.0))
        damping = model.angular_damping[group] * (real(0.5) * kick)
        keep = one - damping
        slow_down = f.div(one, one + damping)
        spins = state.spin[group]
        twists = state.twist[group]
        binormals = state.binormal[group]
        pivots = model.spin_pivot[group]
        filter1 = model.filter_lower1[group]
        filter2 = model.filter_lower2[group]
        moments = scratch.moment[group]
        turned = scratch.spin[group]
        forces = scratch.force[group]
        acceleration = lane()
        spin = path.spin[group]
        # Moments and torques of the two nodes before the one whose torque becomes known. Those of
        # a held end count twice, and so does the torque at it below.
        w_before = vec3()
        q_before = vec3()
        w_here = vec3()
        q_here = vec3()
        y1 = vec3()
        y2 = vec3()
        cells = real(2.0)
        for node in range(last):
            acceleration = mul(pivots[node], turned[node] + mul(coupling, acceleration))
            spin_after = mul(slow_down, mul(keep, spins[node]) + acceleration * kick)
            turned[node] = spin_after
            w_after = moments[node]
            ahead = twists[node] + (spin_after - spin) * dt
            q_after = twist.shape_force(model, shape_torsion, ahead, binormals[node]) * cells
            # The node before has all its neighbours now; before the first lies a dummy.
            i = wp.max(node - 1, 0)
            y = (
                (w_here * real(2.0) - w_before - w_after + q_after - q_before)
                - scale(filter1[i], y1)
                - scale(filter2[i], y2)
            )
            forces[i] = y
            y2 = y1
            y1 = y
            w_before = w_here
            q_before = q_here
            w_here = w_after
            q_here = q_after
            spin = spin_after
            cells = real(1.0)
        w_after = vec3()
        q_after = vec3()
        if model.far_is_held == 1:
            w_after = moments[last]
            ahead = twists[last] - spin * dt
            q_after = twist.shape_force(model, shape_torsion, ahead, binormals[last]) * real(2.0)
        y = (
            (w_here * real(2.0) - w_before - w_after + q_after - q_before)
            - scale(filter1[last - 1], y1)
            - scale(filter2[last - 1], y2)
        )
        forces[last - 1] = y
        forces[last] = (
            (w_after * real(2.0) - w_here - q_here)
            - scale(filter1[last], y)
            - scale(filter2[last], y1)
        )

    return SimpleNamespace(measure_curvature=measure_curvature, elastic_forces=elastic_forces)
