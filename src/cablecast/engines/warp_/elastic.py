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
        x_here = state.position[group, last]
        v_here = state.velocity[group, last]
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
                x_before = state.position[group, i - 1]
                v_before = state.velocity[group, i - 1]
                edge = x_here - x_before
                rate = v_here - v_before
                spin = state.spin[group, i - 1]
                spin_ahead = spin
                x_here = x_before
                v_here = v_before
            if i < last or model.far_is_held == 1:
                bend = edge_after - edge
                sine_squared = dot(bend, bend) * quarter
                curvature = twist.binormal(model, sine_squared, edge, edge_after)
                turned = twist.turn_twist(
                    model, state, group, i, spin_after - spin, rate + rate_after, curvature, elapsed
                )
                # The torque that the present spins lead to by the end of the step.
                torque = mul(torsion, turned + (spin_after - spin_ahead) * dt)
                moment = vec3()
                if i == 0 or i == last:
                    # Half a cell at a gripper, whose bending is linear in the angle to it.
                    moment = scale(bending * real(2.0), bend)
                    torque = torque * real(2.0)
                else:
                    moment = node_moment(bending, sine_squared, bend)
                scratch.moment[group, i] = moment
                if i < last:
                    pivot = model.spin_pivot[group, wp.min(i + 1, last - 1)]
                    y = torque_after - torque + mul(mul(coupling, pivot), y)
                    scratch.spin[group, i] = y
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
        damping = model.angular_damping[group] * (real(0.5) * kick)
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
                acceleration = mul(
                    model.spin_pivot[group, node],
                    scratch.spin[group, node] + mul(coupling, acceleration),
                )
                spin_after = twist.settle_spin(
                    state.spin[group, node], acceleration * kick, damping
                )
                scratch.spin[group, node] = spin_after
            w_after = vec3()
            q_after = vec3()
            if node < last + model.far_is_held:
                w_after = scratch.moment[group, node]
                ahead = state.twist[group, node] + (spin_after - spin) * dt
                q_after = twist.shape_force(
                    model, shape_torsion, ahead, state.binormal[group, node]
                )
                if node == 0 or node == last:
                    q_after = q_after * real(2.0)
            if node > 1:
                # The node before has all its neighbours now.
                i = node - 1
                force = w_here * real(2.0) - w_before - w_after + q_after - q_before
                y = (
                    force
                    - scale(model.filter_lower1[group, i], y1)
                    - scale(model.filter_lower2[group, i], y2)
                )
                scratch.force[group, i] = y
                y2 = y1
                y1 = y
            w_before = w_here
            q_before = q_here
            w_here = w_after
            q_here = q_after
            spin = spin_after

    return SimpleNamespace(measure_curvature=measure_curvature, elastic_forces=elastic_forces)
