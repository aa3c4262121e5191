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

CPU_COMPILER_FLAGS = " ".join(
    (
        "-march=native",
        "-ffp-contract=fast",
        "-mllvm=-inline-threshold=9000",
        "-mllvm=-inline-cold-callsite-threshold=3000",
    )
)
"""Multiplications and additions are fused, and the functions of a stage become one piece of code:
only then does LLVM see that lanes can stay in vector registers.

For the same reason no variable is assigned under an `if` within the loops over nodes, and what a
neighbour needs is read from memory: Warp turns such an assignment into a choice between two
addresses, which keeps the variable in memory and costs half of the speed.
"""


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
    swinging = wp.constant(1.0e-4)

    @wp.func
    def accelerate(model: Model, state: State, scratch: Scratch, group: int, kick: real):
        """Velocities that elasticity, gravity and damping lead to, in place of the forces.

        The forces come halfway through the filter; its back substitution goes from the far end.
        """
        last = model.node_count - 1
        velocity = state.velocity[group]
        force = scratch.force[group]
        accelerations = scratch.moment[group]
        inverse_mass = model.inverse_mass[group]
        diagonal = model.filter_diagonal[group]
        filter1 = model.filter_lower1[group]
        filter2 = model.filter_lower2[group]
        one = lane(real(1.0))
        damping = model.linear_damping[group] * (real(0.5) * kick)
        keep = one - damping
        slow_down = f.div(one, one + damping)
        viscosity = model.rotation_viscosity[group] * kick
        fall = wp.matrix_from_rows(lane(), lane(), lane(model.gravity * kick))
        for back in range(last):
            i = last - back
            after = wp.min(i + 1, last)
            # Both arrays have two zeros beyond the last node.
            acceleration = (
                scale(diagonal[i], force[i])
                - scale(filter1[i + 1], accelerations[i + 1])
                - scale(filter2[i + 2], accelerations[i + 2])
            )
            accelerations[i] = acceleration
            # Damped rotation of the segments is a viscous exchange between neighbours.
            v = velocity[i]
            turning = scale(
                mul(inverse_mass[i], viscosity), velocity[i - 1] - v * real(2.0) + velocity[after]
            )
            free = scale(keep, v) + acceleration * kick + turning - fall
            force[i] = scale(slow_down, free)

    @wp.func
    def meet_table(
        model: Model, path: Path, far_path: Path, state: State, scratch: Scratch, group: int
    ):
        """What the table does to velocities and spins.

        It goes from the far end to the grip, with the normal impulse one node ahead, since what the
        table does to a node also depends on how hard its neighbours press.
        """
        last = model.node_count - 1
        dt = model.dt
        rate = real(1.0) / dt
        half = real(0.5)
        one = lane(real(1.0))
        per_edge = real(1.0) / model.segment_length
        height = model.contact_height
        friction = model.friction[group]
        rolling = model.rolling[group]
        roll_share = model.roll_share[group]
        spin_gain = model.spin_gain[group]
        position = state.position[group]
        velocity = state.velocity[group]
        tension = state.tension[group]
        couples = state.table_couple[group]
        torques = state.table_torque[group]
        losses = state.table_loss[group]
        spins = state.spin[group]
        turned_spins = scratch.spin[group]
        free_velocity = scratch.force[group]
        inverse_mass = model.inverse_mass[group]
        x_here = position[last]
        x_after = x_here
        v_here = velocity[last]
        push_here = contact.normal_push(model, x_here[2], free_velocity[last][2])
        pull = vec3()
        # All that the endpoint loses rolls the last segment, the only one that it has.
        weight = model.end_weight[group]
        per_chord = per_edge
        sides = real(2.0)
        # Of the segment after the node.
        turn = vec3()
        roll = lane()
        free_roll = lane()
        hold = lane()
        spare = lane()
        used = lane()
        driven = lane()
        gain = lane()
        gain_before = model.end_spin_gain[group]
        lost = lane()
        loss_here = losses[last]
        for back in range(last):
            j = last - back
            i = j - 1
            x_ahead = position[i]
            v_ahead = velocity[i]
            # The gripped node feels no table; the first segment rolls by its other node.
            inner = real(wp.min(i, 1))
            push_ahead = contact.normal_push(model, x_ahead[2], free_velocity[i][2])
            push_ahead = push_here + (push_ahead - push_here) * inner
            load = push_ahead + mul(weight, push_here)
            # The segment before the node.
            spin_before = spins[i]
            driven_before = turned_spins[i]
            turned = driven_before - mul(gain_before, torques[i])
            turned_spins[i] = turned
            hold_before = mul(rolling, mul(gain_before, load))
            # What the spin becomes if the nodes lose again what they lost in the step before.
            loss_ahead = losses[i]
            pushed = turned + mul(gain_before, mul(weight, loss_here) + loss_ahead)
            free_spin_before = contact.roll_friction(pushed, hold_before)
            # Rolling friction has something left to hold only a segment that it brings to a stop.
            stopped = one - wp.min(f.absolute(free_spin_before) * real(1.0e6), one)
            spare_before = mul(stopped, hold_before)
            used_before = mul(stopped, pushed)
            driven_before = driven_before - free_spin_before
            edge = x_here - x_ahead
            chord = edge * per_edge
            swing = contact.along_normal(v_here - v_ahead, chord)
            couple = contact.hold_turn(model, couples[i], load * half, group, swing)
            couples[i] = couple
            against = contact.spinning_impulse(model, couple, load * half, group, swing)
            turn_before = contact.add_normal(vec3(), against, chord)
            roll_before = spin_before * (-half * height)
            free_roll_before = free_spin_before * (-half * height)
            # The table feels the tension of the step before; the length solve starts without it,
            # since a stale tension after a jerk would throw it far from the solution.
            pull_before = scale(tension[i], edge)
            lightness = inverse_mass[j]
            tug = scale(lightness, pull - pull_before) * rate
            free = free_velocity[j] + scale(lightness, turn - turn_before)
            axis = (x_after - x_ahead) * per_chord
            loss = contact.friction_loss(
                mul(friction, push_here),
                roll_share,
                (spare_before * sides + spare) * (half * height),
                (used_before * sides + used) * (half * height),
                (driven_before * sides + driven) * (-half * height),
                loss_here,
                axis,
                contact.add_normal(v_here, roll_before * sides + roll, axis),
                contact.add_normal(free + tug, free_roll_before * sides + free_roll, axis),
            )
            sideways = contact.along_normal(loss, axis)
            losses[j] = sideways
            loss_here = loss_ahead
            # Rolling friction resists what twist and friction spin up together.
            gained = mul(gain, lost + sideways)
            turned = turned_spins[j]
            spun = contact.roll_friction(turned + gained, hold)
            turned_spins[j] = spun
            torques[j] = contact.next_torque(torques[j], spun - turned, gain, height)
            lost = mul(weight, sideways)
            after = free - loss
            after[2] = after[2] + push_here
            free_velocity[j] = after
            velocity[j] = after
            turn = turn_before
            roll = roll_before
            free_roll = free_roll_before
            hold = hold_before
            spare = spare_before
            used = used_before
            driven = driven_before
            gain = gain_before
            gain_before = spin_gain
            pull = pull_before
            push_here = push_ahead
            x_after = x_here
            x_here = x_ahead
            v_here = v_ahead
            weight = one
            per_chord = half * per_edge
            sides = real(1.0)
        losses[0] = lost
        gained = mul(gain, lost * real(2.0))
        turned = turned_spins[0]
        spun = contact.roll_friction(turned + gained, hold)
        turned_spins[0] = spun
        torques[0] = contact.next_torque(torques[0], spun - turned, gain, height)
        velocity[0] = (path.position[group] - position[0]) * rate
        if model.far_is_held == 1:
            velocity[last] = (far_path.position[group] - position[last]) * rate

    @wp.func
    def move(model: Model, state: State, scratch: Scratch, group: int, active: lane):
        """Take the new positions; return the largest squared horizontal speed of any node.

        A cable whose free end is in the air counts as moving. What hangs from the gripper may swing
        on for seconds, so that speeds outside the last quarter of the cable count a hundredth.
        """
        last = model.node_count - 1
        dt = model.dt
        position = state.position[group]
        velocity = state.velocity[group]
        spins = state.spin[group]
        turned_spins = scratch.spin[group]
        lifted = wp.max(position[last][2] - lane(model.contact_height * real(1.5)), lane())
        fastest = lifted * real(airborne)
        for i in range(last + 1):
            v = scale(active, velocity[i])
            velocity[i] = v
            position[i] = position[i] + v * dt
            in_last_quarter = real(wp.min(wp.max(4 * i - 3 * last, 0), 1))
            counts = wp.max(in_last_quarter, real(swinging))
            fastest = wp.max(fastest, (mul(v[0], v[0]) + mul(v[1], v[1])) * counts)
        for i in range(last):
            spins[i] = mul(active, turned_spins[i])
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
        accelerate(model, state, scratch, group, kick)
        meet_table(model, path, far_path, state, scratch, group)
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
