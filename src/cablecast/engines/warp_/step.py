"""One step of the cable, and the kernel that runs a whole rollout in a single launch."""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.contact import contact_functions
from cablecast.engines.warp_.elastic import elastic_functions
from cablecast.engines.warp_.grip import grip_functions
from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.length import length_functions
from cablecast.engines.warp_.world import world_structs

CPU_COMPILER_FLAGS = (
    "-march=native -mllvm=-inline-threshold=9000 -mllvm=-inline-cold-callsite-threshold=3000"
)
"""Warp's own flags but for the depth to which LLVM looks for vector instructions: its shallow
default leaves half of the lane arithmetic scalar."""


@functools.cache
def rollout_kernel(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the kernel for a precision and a lane count; Warp caches the compiled code on disk."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    grip = grip_functions(precision, lane_count)
    elastic = elastic_functions(precision, lane_count)
    contact = contact_functions(precision, lane_count)
    length = length_functions(precision, lane_count)
    real, lane, vec3, scale, mul = f.real, f.lane, f.vec3, f.scale, f.mul
    Model, Path, State, Scratch, Samples = s.Model, s.Path, s.State, s.Scratch, s.Samples
    count = wp.constant(lane_count)
    airborne = wp.constant(1.0e6)

    @wp.func
    def predict(
        model: Model,
        path: Path,
        far_path: Path,
        state: State,
        scratch: Scratch,
        group: int,
        kick: real,
    ):
        """Velocities, spins and positions after all forces but the change of tension.

        It goes from the far end to the grip, with the forces one node ahead, since what the table
        does to a node also depends on how hard its neighbours press.
        """
        last = model.node_count - 1
        dt = model.dt
        rate = real(1.0) / dt
        half = real(0.5)
        one = lane(real(1.0))
        per_edge = real(1.0) / model.segment_length
        damping = model.linear_damping[group] * (half * kick)
        keep = one - damping
        slow_down = f.div(one, one + damping)
        viscosity = model.rotation_viscosity[group] * kick
        friction = model.friction[group]
        rolling = model.rolling[group]
        roll_share = model.roll_share[group]
        end_weight = model.end_weight[group]
        scratch.predicted[group, 0] = path.position[group]
        # Nodes i + 2, i + 1 and i.
        x_after = vec3()
        x_here = state.position[group, last]
        x_ahead = x_here
        v_here = state.velocity[group, last]
        v_ahead = v_here
        free_here = vec3()
        tension_here = vec3()
        inverse_mass = lane()
        push_here = lane()
        pull = vec3()
        # The segment after node i + 1.
        turn = vec3()
        spin = lane()
        free_spin = lane()
        slack = lane()
        lost = lane()
        # The second half of the filter of the bending force: back substitution.
        a1 = vec3()
        a2 = vec3()
        lower1 = lane()
        lower2 = lane()
        lower2_next = lane()
        for back in range(last + 1):
            i = last - back
            x_before = x_ahead
            v_before = v_ahead
            free_ahead = vec3()
            tension_ahead = vec3()
            inverse_mass_ahead = lane()
            # The gripped node feels no table; the first segment rolls by its other node.
            push_ahead = push_here
            if i > 0:
                x_before = state.position[group, i - 1]
                v_before = state.velocity[group, i - 1]
                pull_before = scale(state.tension[group, i - 1], x_ahead - x_before)
                inverse_mass_ahead = model.inverse_mass[group, i]
                acceleration = (
                    scale(model.filter_diagonal[group, i], scratch.force[group, i])
                    - scale(lower1, a1)
                    - scale(lower2, a2)
                )
                a2 = a1
                a1 = acceleration
                lower1 = model.filter_lower1[group, i]
                lower2 = lower2_next
                lower2_next = model.filter_lower2[group, i]
                acceleration[2] = acceleration[2] - lane(model.gravity)
                # Damped rotation of the segments is a viscous exchange between neighbours.
                turning = scale(
                    mul(inverse_mass_ahead, viscosity), v_before - v_ahead * real(2.0) + v_here
                )
                free_ahead = scale(slow_down, scale(keep, v_ahead) + acceleration * kick + turning)
                # The table feels the tension of the step before; the length solve starts without
                # it, since a stale tension after a jerk would throw it far from the solution.
                tension_ahead = scale(inverse_mass_ahead, pull - pull_before) * rate
                push_ahead = contact.normal_push(model, x_ahead[2], free_ahead[2])
                pull = pull_before
            if i < last:
                # Node j has all its neighbours now, and so has the segment before it.
                j = i + 1
                load = push_ahead + push_here
                weight = one
                per_chord = half * per_edge
                if j == last:
                    # All that the endpoint loses rolls the last segment.
                    weight = end_weight
                    load = push_ahead + mul(weight, push_here)
                    x_after = x_here
                    per_chord = per_edge
                turned = scratch.spin[group, i]
                spin_before = state.spin[group, i]
                slack_before = mul(rolling, mul(model.spin_gain[group, i], load))
                free_spin_before = contact.roll_friction(turned, slack_before)
                slack_before = slack_before - f.absolute(turned - free_spin_before)
                turn_before = contact.spinning_impulse(
                    model, load * half, group, (x_here - x_ahead) * per_edge, v_here - v_ahead
                )
                if j == last:
                    spin = spin_before
                    free_spin = free_spin_before
                    slack = slack_before
                axis = (x_after - x_ahead) * per_chord
                roll = (spin_before + spin) * (-half * model.contact_height)
                free_roll = (free_spin_before + free_spin) * (-half * model.contact_height)
                free = free_here + scale(inverse_mass, turn - turn_before)
                loss = contact.friction_loss(
                    mul(friction, push_here),
                    roll_share,
                    (slack_before + slack) * (half * model.contact_height),
                    axis,
                    contact.add_normal(v_here, roll, axis),
                    contact.add_normal(free + tension_here, free_roll, axis),
                )
                sideways = contact.along_normal(loss, axis)
                if j < last:
                    # Rolling friction resists what friction spins up with what is left of it.
                    gained = mul(model.spin_gain[group, j], lost + sideways)
                    state.spin[group, j] = contact.roll_friction(free_spin + gained, slack)
                lost = mul(weight, sideways)
                after = free - loss
                after[2] = after[2] + push_here
                predicted = x_here + after * dt
                if j == last and model.far_is_held == 1:
                    predicted = far_path.position[group]
                    after = (predicted - x_here) * rate
                scratch.predicted[group, j] = predicted
                scratch.force[group, j] = predicted
                state.velocity[group, j] = after
                turn = turn_before
                spin = spin_before
                free_spin = free_spin_before
                slack = slack_before
            x_after = x_here
            x_here = x_ahead
            x_ahead = x_before
            v_here = v_ahead
            v_ahead = v_before
            free_here = free_ahead
            tension_here = tension_ahead
            inverse_mass = inverse_mass_ahead
            push_here = push_ahead
        gained = mul(model.spin_gain[group, 0], lost * real(2.0))
        state.spin[group, 0] = contact.roll_friction(free_spin + gained, slack)

    @wp.func
    def move(model: Model, state: State, scratch: Scratch, group: int, active: lane):
        """Take the new positions; return the largest squared horizontal speed of any node.

        A cable whose free end is in the air counts as moving.
        """
        last = model.node_count - 1
        rate = real(1.0) / model.dt
        state.velocity[group, 0] = (scratch.predicted[group, 0] - state.position[group, 0]) * rate
        lifted = wp.max(
            state.position[group, last][2] - lane(model.contact_height * real(1.5)), lane()
        )
        fastest = lifted * real(airborne)
        for i in range(last + 1):
            x = state.position[group, i]
            v = scale(active, state.velocity[group, i])
            state.velocity[group, i] = v
            state.position[group, i] = x + scale(active, scratch.predicted[group, i] - x)
            if i < last:
                state.spin[group, i] = mul(active, state.spin[group, i])
            fastest = wp.max(fastest, mul(v[0], v[0]) + mul(v[1], v[1]))
        return fastest

    @wp.func
    def step(
        model: Model,
        path: Path,
        far_path: Path,
        state: State,
        scratch: Scratch,
        group: int,
        kick: real,
        elapsed: real,
        active: lane,
    ):
        """Advance by dt: leapfrog with a filter for stiff elasticity and exact lengths.

        Args:
            kick: How long forces act in this step [s]: dt, but half of it in the first step, since
                velocities belong to the middle of a step and the initial ones to its start.
            elapsed: Duration of the step before [s]; 0 in the first.
            active: 1, or 0 for worlds that rest.
        """
        elastic.measure_curvature(model, path, far_path, state, scratch, group, active * elapsed)
        elastic.elastic_forces(model, path, state, scratch, group, kick)
        predict(model, path, far_path, state, scratch, group, kick)
        length.hold_lengths(model, state, scratch, group, active)
        return move(model, state, scratch, group, active)

    @wp.func
    def record(model: Model, state: State, samples: Samples, group: int, sample: int):
        """Write the endpoint, and the shape where asked for."""
        last = model.node_count - 1
        samples.endpoint[group, sample] = state.position[group, last]
        if samples.record_nodes == 1:
            for i in range(model.node_count):
                samples.nodes[group, sample, i] = state.position[group, i]

    @wp.kernel(
        enable_backward=False,
        module="unique",
        module_options={"cpu_compiler_flags": CPU_COMPILER_FLAGS},
    )
    def kernel(
        first_group: int,
        sample_count: int,
        rest_speed: real,
        rest_duration: real,
        motion_end: wp.array(dtype=lane),
        model: Model,
        path: Path,
        far_path: Path,
        state: State,
        scratch: Scratch,
        samples: Samples,
    ):
        group = first_group + wp.tid()
        dt = model.dt
        grip.start(path, group)
        if model.far_is_held == 1:
            grip.start(far_path, group)
        active = state.active[group]
        rest_time = state.rest_time[group]
        slow = rest_speed * rest_speed
        record(model, state, samples, group, 0)
        moving = int(1)
        kick = dt * real(0.5)
        elapsed = real(0.0)
        end = real(0.0)
        for sample in range(1, sample_count):
            for k in range(samples.steps_per_sample):
                if moving == 1:
                    t = real((sample - 1) * samples.steps_per_sample + k + 1) * dt
                    grip.follow(path, group, t, dt)
                    if model.far_is_held == 1:
                        grip.follow(far_path, group, t, dt)
                    fastest = step(
                        model, path, far_path, state, scratch, group, kick, elapsed, active
                    )
                    kick = dt
                    elapsed = dt
                    end = t
                    # A world that has been slow for a while after its motion rests for good.
                    any_moving = int(0)
                    for j in range(count):
                        if fastest[j] <= slow and t > motion_end[group][j]:
                            rest_time[j] = rest_time[j] + dt
                        else:
                            rest_time[j] = real(0.0)
                        if rest_time[j] > rest_duration:
                            active[j] = real(0.0)
                        if active[j] > real(0.0):
                            any_moving = int(1)
                    moving = any_moving
            record(model, state, samples, group, sample)
        # The twist of the last step, for the final state.
        grip.follow(path, group, end, dt)
        if model.far_is_held == 1:
            grip.follow(far_path, group, end, dt)
        elastic.measure_curvature(model, path, far_path, state, scratch, group, active * elapsed)
        state.active[group] = active
        state.rest_time[group] = rest_time

    return SimpleNamespace(kernel=kernel, **vars(s), real=real, lane=lane, vec3=vec3)
