"""Elastic forces: the forward sweep of elasticity, from the grip to the far end.

It solves for the spins, and with them for the torques. A node's bending moment w (over the segment
length) and force of twist q act on its neighbours, so that the force on node i is
2 w[i] - w[i-1] - w[i+1] + q[i+1] - q[i-1]. The sweep also eliminates the filter of the bending
force (bending.py), whose back substitution is left to the prediction of velocities (integrate.py).
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.twist import twist_functions
from cablecast.engines.warp_.world import world_structs


@functools.cache
def elastic_functions(precision: str, lane_count: int, damped: bool) -> SimpleNamespace:
    """Build the Warp function of elastic forces.

    Args:
        precision: "single" or "double".
        lane_count: Number of worlds side by side.
        damped: True for a material that may damp twist.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    twist = twist_functions(precision, lane_count, damped)
    real, lane, vec3, scale, mul = f.real, f.lane, f.vec3, f.scale, f.mul
    Model, Path, State, Scratch = s.Model, s.Path, s.State, s.Scratch

    @wp.func
    def elastic_forces(
        model: Model,
        path: Path,
        far_path: Path,
        state: State,
        scratch: Scratch,
        group: int,
        force_dt: real,
    ):
        """Find the spins after torsion and damping, and the elastic force on each node.

        Args:
            model: Constants of the batch.
            path: Spin of the gripper.
            far_path: Spin of the gripper at the far end, where there is one.
            state: State at the start of the step.
            scratch: Bending moments and the right side of the torsion system; receives spins and
                forces, halfway through the filter.
            group: Group of worlds.
            force_dt: Time for which torques act in this step [s].
        """
        last = model.node_count - 1
        torsion_time = model.torsion_time[group]
        coupling = mul(model.torsion[group], torsion_time) * model.dt
        one = lane(real(1.0))
        half_damping = model.angular_damping[group] * (real(0.5) * force_dt)
        explicit_damping = one - half_damping
        implicit_damping = f.div(one, one + half_damping)
        spins = state.spin[group]
        twists = state.twist[group]
        pivots = model.spin_pivot[group]
        lower1 = model.filter_lower1[group]
        lower2 = model.filter_lower2[group]
        moments = scratch.bending_moment[group]
        right_sides = scratch.torque[group]
        predicted_spins = scratch.spin[group]
        forces = scratch.force[group]
        # Rate of the spin [rad/s²].
        alpha = lane()
        spin_before = path.spin[group]
        # Of w and q (see above): the force on the node before as far as the nodes up to it make it,
        # and what that node does to the next one [N]. Then the last two eliminated forces. At a
        # gripper w and q count twice; moments of held nodes do so already.
        known = vec3()
        passed_on = vec3()
        force1 = vec3()
        force2 = vec3()
        cells = real(2.0)
        node = int(0)
        while node < last:
            alpha = mul(pivots[node], right_sides[node] + mul(coupling, alpha))
            undamped = mul(explicit_damping, spins[node]) + alpha * force_dt
            spin = mul(implicit_damping, undamped)
            predicted_spins[node] = spin
            w_after = moments[node]
            turned = twists[node] + mul(torsion_time, spin - spin_before)
            turned += twist.lead(scratch, group, node)
            q_after = twist.shape_force(model, state, group, node, turned) * cells
            # The node before has all its neighbours now; before the first lies a dummy.
            i = wp.max(node - 1, 0)
            force = (
                (known - (w_after - q_after)) - scale(lower1[i], force1) - scale(lower2[i], force2)
            )
            forces[i] = force
            force2 = force1
            force1 = force
            known = w_after * real(2.0) - passed_on
            passed_on = w_after + q_after
            spin_before = spin
            cells = real(1.0)
            node += 1
        w_after = vec3()
        q_after = vec3()
        if model.far_is_held == 1:
            w_after = moments[last]
            turned = twists[last] + mul(torsion_time, far_path.spin[group] - spin_before)
            turned += twist.lead(scratch, group, last)
            q_after = twist.shape_force(model, state, group, last, turned) * real(2.0)
        # A last segment of another length turns the farther, the shorter it is.
        longer = scale(model.last_ratio[group] - one, passed_on)
        i = last - 1
        force = (
            (known - (w_after - q_after) + longer)
            - scale(lower1[i], force1)
            - scale(lower2[i], force2)
        )
        forces[i] = force
        forces[last] = (
            (w_after * real(2.0) - passed_on - longer)
            - scale(lower1[last], force)
            - scale(lower2[last], force1)
        )

    return SimpleNamespace(elastic_forces=elastic_forces)
