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
        quarter = real(0.25) / (model.segment_length * model.segment_length)
        per_edge = real(0.25) / model.segment_length
        position = state.position[group]
        velocity = state.velocity[group]
        spins = state.spin[group]
        twists = state.twist[group]
        binormals = state.binormal[group]
        pivots = model.spin_pivot[group]
        moments = scratch.moment[group]
        eliminated = scratch.spin[group]
        x_here = position[last]
        v_here = velocity[last]
        edge_after = far_path.direction[group] * model.segment_length
        rate_after = far_path.turn[group] * model.segment_length
        spin_after = lane()
        torque_after = lane()
        y = lane()
        for back in range(last + 1):
            i = last - back
            # The segment before the node, or the gripper.
            edge = path.direction[group] * model.segment_length
            rate = path.turn[group] * model.segment_length
            spin = path.spin_before[group]
            spin_ahead = path.spin[group]
            if i > 0:
                x_before = position[i - 1]
                v_before = velocity[i - 1]
                edge = x_here - x_before
                rate = v_here - v_before
                spin = spins[i - 1]
                spin_ahead = spin
                x_here = x_before
                v_here = v_before
            if i < last or model.far_is_held == 1:
                bend = edge_after - edge
                sine_squared = dot(bend, bend) * quarter
                curvature = twist.binormal(model, sine_squared, edge, edge_after)
                # The binormal halfway through the last step is the mean of those at its ends.
                holonomy = dot(binormals[i] + curvature, rate + rate_after) * per_edge
                turned = twists[i] + mul(elapsed, spin_after - spin + holonomy)
                twists[i] = turned
                binormals[i] = curvature
                # The torque that the present spins lead to by the end of the step.
                torque = mul(torsion, turned + (spin_after - spin_ahead) * dt)
                moment = vec3()
                if i == 0 or i == last:
                    # Half a cell at a gripper, whose bending is linear in the angle to it.
                    moment = scale(bending * real(2.0), bend)
                    torque = torque * real(2.0)
                else:
                    moment = node_moment(bending, sine_squared, bend)
                moments[i] = moment
                if i < last:
                    pivot = pivots[wp.min(i + 1, last - 1)]
                    y = torque_after - torque + mul(mul(coupling, pivot), y)
                    eliminated[i] = y
                torque_after = torque
            spin_after = spin
            edge_after = edge
            rate_after = rate

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
        # Moments and torques of the two nodes before the one whose torque becomes known.
        w_before = vec3()
        q_before = vec3()
        w_here = vec3()
        q_here = vec3()
        y1 = vec3()
        y2 = vec3()
        for node in range(last + 2):
            spin_after = lane()
            if node < last:
                acceleration = mul(pivots[node], turned[node] + mul(coupling, acceleration))
                spin_after = mul(slow_down, mul(keep, spins[node]) + acceleration * kick)
                turned[node] = spin_after
            w_after = vec3()
            q_after = vec3()
            if node < last + model.far_is_held:
                w_after = moments[node]
                ahead = twists[node] + (spin_after - spin) * dt
                q_after = twist.shape_force(model, shape_torsion, ahead, binormals[node])
                if node == 0 or node == last:
                    q_after = q_after * real(2.0)
            if node > 1:
                # The node before has all its neighbours now.
                i = node - 1
                force = w_here * real(2.0) - w_before - w_after + q_after - q_before
                y = force - scale(filter1[i], y1) - scale(filter2[i], y2)
                forces[i] = y
                y2 = y1
                y1 = y
            w_before = w_here
            q_before = q_here
            w_here = w_after
            q_here = q_after
            spin = spin_after

    return SimpleNamespace(measure_curvature=measure_curvature, elastic_forces=elastic_forces)
