"""One step of the cable, and the kernel that runs a whole rollout in a single launch."""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.bending import bending_functions
from cablecast.engines.warp_.contact import contact_functions
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
    bend = bending_functions(precision, lane_count)
    contact = contact_functions(precision, lane_count)
    length = length_functions(precision, lane_count)
    real, lane, vec3, scale, mul = f.real, f.lane, f.vec3, f.scale, f.mul
    Model, Path, State, Scratch, Samples = s.Model, s.Path, s.State, s.Scratch, s.Samples
    count = wp.constant(lane_count)
    airborne = wp.constant(1.0e6)

    @wp.func
    def predict(
        model: Model, state: State, scratch: Scratch, group: int, kick: real, held: vec3, far: vec3
    ):
        """Velocities and positions after all forces but the change of tension."""
        last = model.node_count - 1
        dt = model.dt
        damping = model.linear_damping[group] * (real(0.5) * kick)
        one = lane(real(1.0))
        slow_down = f.div(one, one + damping)
        viscosity = model.rotation_viscosity[group]
        friction = model.friction[group]
        scratch.predicted[group, 0] = held
        x_here = state.position[group, 1]
        rate = real(1.0) / dt
        v_before = state.velocity[group, 0]
        v_here = state.velocity[group, 1]
        pull_before = scale(state.tension[group, 0], x_here - state.position[group, 0])
        for i in range(1, last + 1):
            v_after = v_here
            x_after = x_here
            pull = vec3()
            if i < last:
                x_after = state.position[group, i + 1]
                v_after = state.velocity[group, i + 1]
                pull = scale(state.tension[group, i], x_after - x_here)
            # Damped rotation of the segments: a viscous exchange between neighbours.
            turning = scale(viscosity, v_before - v_here * real(2.0) + v_after)
            acceleration = scratch.bending[group, i]
            acceleration[2] = acceleration[2] - lane(model.gravity)
            free = (
                scale(one - damping, v_here)
                + acceleration * kick
                + scale(model.inverse_mass[group, i], turning * kick)
            )
            free = scale(slow_down, free)
            # The table feels the tension of the step before; the length solve starts without it,
            # since a stale tension after a jerk would throw it far from the solution.
            tension = scale(model.inverse_mass[group, i], pull - pull_before) * rate
            after = contact.table_contact(model, friction, x_here[2], v_here, free, tension)
            predicted = x_here + after * dt
            if i == last and model.far_is_held == 1:
                predicted = far
                after = (far - x_here) * rate
            scratch.predicted[group, i] = predicted
            state.velocity[group, i] = after
            pull_before = pull
            v_before = v_here
            v_here = v_after
            x_here = x_after

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
            fastest = wp.max(fastest, mul(v[0], v[0]) + mul(v[1], v[1]))
        return fastest

    @wp.func
    def step(
        model: Model,
        state: State,
        scratch: Scratch,
        group: int,
        kick: real,
        tangent: vec3,
        held: vec3,
        far: vec3,
        active: lane,
    ):
        """Advance by dt: leapfrog with an implicit filter for bending and exact lengths.

        Args:
            kick: How long forces act in this step [s]: dt, but half of it in the first step, since
                velocities belong to the middle of a step and the initial ones to its start.
            tangent: Direction of the grip at the start of the step.
            held: Where the gripped end is at the end of the step [m].
            far: Where the far end is then, where it is held [m].
            active: 1, or 0 for worlds that rest.
        """
        bend.bending_forces(model, state, scratch, group, tangent)
        bend.bending_accelerations(model, scratch, group)
        predict(model, state, scratch, group, kick, held, far)
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
        grip.advance_pieces(path, group, real(0.0))
        tangent = grip.held_tangent(path, group, grip.local_time(path, group, real(0.0)))
        far = vec3()
        if model.far_is_held == 1:
            grip.advance_pieces(far_path, group, real(0.0))
        active = state.active[group]
        rest_time = state.rest_time[group]
        slow = rest_speed * rest_speed
        record(model, state, samples, group, 0)
        moving = int(1)
        kick = dt * real(0.5)
        for sample in range(1, sample_count):
            for k in range(samples.steps_per_sample):
                if moving == 1:
                    t = real((sample - 1) * samples.steps_per_sample + k + 1) * dt
                    if t >= path.next_knot[group]:
                        grip.advance_pieces(path, group, t)
                    tau = grip.local_time(path, group, t)
                    held = grip.held_position(path, group, tau)
                    if model.far_is_held == 1:
                        if t >= far_path.next_knot[group]:
                            grip.advance_pieces(far_path, group, t)
                        far = grip.held_position(
                            far_path, group, grip.local_time(far_path, group, t)
                        )
                    fastest = step(model, state, scratch, group, kick, tangent, held, far, active)
                    kick = dt
                    tangent = grip.held_tangent(path, group, tau)
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
        state.active[group] = active
        state.rest_time[group] = rest_time

    return SimpleNamespace(kernel=kernel, **vars(s), real=real, lane=lane, vec3=vec3)
