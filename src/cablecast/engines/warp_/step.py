"""One step of the cable: each line of `step` is a stage; time integration and air are here.

Drag of the air is quadratic in the speed, across and along the cable each by itself. A length dl of
a cable of diameter d that moves across itself at a velocity v feels 1/2 rho C d |v| v dl, and along
itself at a velocity u it feels 1/2 rho C r d |u| u dl (Morison's equation with the cross-flow
principle and a tangential coefficient, as for mooring lines; MuJoCo's inertia model has the same
law, with r the width of a body's box over its length). A step takes k |v| v' with v the velocity
across or along at its start, v' that at its end and k the drag over the mass of the node: implicit,
of second order in time, and exact for a node that nothing else moves, whose speed falls as
v / (1 + k v t).
"""

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.elastic import curvature_functions, elastic_functions
from cablecast.engines.warp_.energy import energy_functions
from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.length import length_functions
from cablecast.engines.warp_.material import material_functions
from cablecast.engines.warp_.table import table_functions
from cablecast.engines.warp_.world import Features, world_structs

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false


@functools.cache
def integrate_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the Warp functions that advance velocities and positions."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3, scale, mul = f.real, f.lane, f.vec3, f.scale, f.mul
    Model, Path, State, Scratch = s.Model, s.Path, s.State, s.Scratch
    airborne_weight = wp.constant(1.0e6)  # squared speed per height of a free end [m/s²]
    fallen = wp.constant(0.05)  # depth below the table [m]
    swing_weight = wp.constant(1.0e-4)  # of squared speeds outside the last quarter [-]

    @wp.func
    def predict_velocities(
        model: Model, state: State, scratch: Scratch, group: int, force_dt: real
    ):
        """Turn forces into the velocities that elasticity, gravity and damping lead to.

        The bending filter has been eliminated up to here; its back substitution goes from the far
        end to the grip. Damping is centred in the step.

        Args:
            scratch: Holds `force`; receives `velocity` in its place.
        """
        last = model.node_count - 1
        velocity = state.velocity[group]
        force = scratch.force[group]
        predicted = scratch.velocity[group]
        accelerations = scratch.acceleration[group]
        inverse_mass = model.inverse_mass[group]
        diagonal = model.filter_diagonal[group]
        lower1 = model.filter_lower1[group]
        lower2 = model.filter_lower2[group]
        one = lane(real(1.0))
        half_damping = model.linear_damping[group] * (real(0.5) * force_dt)
        explicit_damping = one - half_damping
        implicit_damping = f.div(one, one + half_damping)
        viscosity = model.rotation_viscosity[group] * force_dt
        fall = wp.matrix_from_rows(lane(), lane(), lane(model.gravity * force_dt))
        acceleration = vec3()
        node = int(last)
        while node > 0:
            after = wp.min(node + 1, last)
            # Filter and accelerations have two zeros beyond the last node. The nearest acceleration
            # is at hand and comes last, so that the next node waits for one product alone.
            acceleration = (
                scale(diagonal[node], force[node])
                - scale(lower2[node + 2], accelerations[node + 2])
                - scale(lower1[node + 1], acceleration)
            )
            accelerations[node] = acceleration
            # Damped rotation of the segments is a viscous exchange between neighbours.
            v = velocity[node]
            exchange = scale(
                mul(inverse_mass[node], viscosity),
                velocity[node - 1] - v * real(2.0) + velocity[after],
            )
            undamped = scale(explicit_damping, v) + acceleration * force_dt + exchange - fall
            predicted[node] = scale(implicit_damping, undamped)
            node -= 1

    @wp.func
    def drive_held_ends(model: Model, path: Path, far_path: Path, state: State, group: int):
        """Give held ends the velocity with which they follow their paths [m/s]."""
        last = model.node_count - 1
        inverse_dt = real(1.0) / model.dt
        position = state.position[group]
        velocity = state.velocity[group]
        velocity[0] = (path.position[group] - position[0]) * inverse_dt
        if model.far_is_held == 1:
            velocity[last] = (far_path.position[group] - position[last]) * inverse_dt

    @wp.func
    def move(model: Model, state: State, group: int, active: lane):
        """Advance positions; return a squared speed that tells whether worlds rest.

        Args:
            state: Receives positions and velocities at the end of the step.

        Returns:
            The largest squared horizontal speed of any node [m²/s²]. A free end in the air counts
            as moving, one that fell off the table as at rest. What hangs from the gripper may swing
            on for seconds, so that speeds outside the last quarter of the cable count a hundredth.
        """
        last = model.node_count - 1
        position = state.position[group]
        velocity = state.velocity[group]
        lifted = f.larger(position[model.endpoint][2] - model.radius[group] * real(1.5), lane())
        fastest = lifted * real(airborne_weight)
        node = int(0)
        while node < last + 1:
            v = scale(active, velocity[node])
            velocity[node] = v
            position[node] = position[node] + v * model.dt
            in_last_quarter = real(wp.min(wp.max(4 * node - 3 * last, 0), 1))
            weight = wp.max(in_last_quarter, real(swing_weight))
            fastest = f.larger(fastest, (mul(v[0], v[0]) + mul(v[1], v[1])) * weight)
            node += 1
        # 1 for a free end above the depth at which it has fallen off, 0 below.
        above = f.is_positive(position[model.endpoint][2] + lane(real(fallen)))
        return mul(above, fastest)

    return SimpleNamespace(
        predict_velocities=predict_velocities, drive_held_ends=drive_held_ends, move=move
    )


@functools.cache
def air_functions(precision: str, lane_count: int, drags: bool) -> SimpleNamespace:
    """Build the Warp function of the air.

    `drags` is true where the air resists; otherwise the function does nothing.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3, dot, scale, mul, div = f.real, f.lane, f.vec3, f.dot, f.scale, f.mul, f.div
    Model, State, Scratch = s.Model, s.State, s.Scratch
    folded = wp.constant(1.0e-6)

    @wp.func
    def along(vector: vec3, chord: vec3, inverse_square: lane):
        """Return what of a vector is along a chord, given 1 / |chord|²."""
        return scale(mul(dot(vector, chord), inverse_square), chord)

    @wp.func
    def resist(model: Model, state: State, scratch: Scratch, group: int, force_dt: real):
        """Take from predicted velocities what the air takes in this step.

        Args:
            scratch: Predicted velocities, which are updated.
        """
        last = model.node_count - 1
        one = lane(real(1.0))
        length = model.segment_length[group]
        least = mul(length, length) * real(folded)
        drag_dt = model.drag[group] * force_dt
        position = state.position[group]
        velocity = state.velocity[group]
        predicted = scratch.velocity[group]
        inverse_mass = model.inverse_mass[group]
        x = position[last]
        x_after = x
        # Half a cell lies at the endpoint.
        cells = real(0.5)
        node = int(last)
        while node > 0:
            x_before = position[node - 1]
            chord = x_after - x_before
            inverse_square = div(one, dot(chord, chord) + least)
            u = along(velocity[node], chord, inverse_square)
            v = velocity[node] - u
            per_speed = mul(drag_dt * cells, inverse_mass[node])
            taken = mul(per_speed, f.root(dot(v, v)))
            taken_along = mul(mul(per_speed, model.drag_ratio[group]), f.root(dot(u, u)))
            free = predicted[node]
            free_along = along(free, chord, inverse_square)
            share = div(taken, one + taken)
            share_along = div(taken_along, one + taken_along)
            predicted[node] = (
                free - scale(share, free - free_along) - scale(share_along, free_along)
            )
            x_after = x
            x = x_before
            cells = real(1.0)
            node -= 1

    @wp.func
    def resist_nothing(model: Model, state: State, scratch: Scratch, group: int, force_dt: real):
        """Do nothing in place of `resist`."""

    return SimpleNamespace(resist=resist if drags else resist_nothing)


@functools.cache
def step_functions(precision: str, lane_count: int, features: Features) -> SimpleNamespace:
    """Build the Warp function that advances a group of worlds by one step."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    curvature = curvature_functions(precision, lane_count, features.remembers)
    elastic = elastic_functions(precision, lane_count, features.remembers)
    material = material_functions(precision, lane_count, features.remembers)
    integrate = integrate_functions(precision, lane_count)
    air = air_functions(precision, lane_count, features.surface)
    energy = energy_functions(precision, lane_count, features.remembers)
    table = table_functions(precision, lane_count, features)
    length = length_functions(precision, lane_count)
    real, lane, mul = f.real, f.lane, f.mul
    Model, Path, State, Scratch = s.Model, s.Path, s.State, s.Scratch

    @wp.func
    def step(
        model: Model,
        path: Path,
        far_path: Path,
        state: State,
        scratch: Scratch,
        group: int,
        force_dt: real,
        previous_dt: real,
        active: lane,
    ):
        """Advance by dt: leapfrog with a filter for stiff elasticity and exact lengths.

        Velocities belong to the middle of a step, but the initial ones to its start. So forces act
        for half a step in the first. The stages take these arguments, too.

        Args:
            model: Constants of the batch.
            path: Motion of the gripper, at the end of this step.
            far_path: Motion of the gripper at the far end, where there is one.
            state: State at the start of the step; becomes that at the end.
            scratch: Memory within the step.
            group: Group of worlds.
            force_dt: Time for which forces act in this step [s]: dt, and dt / 2 in the first.
            previous_dt: Duration of the previous step [s]: dt, and 0 in the first; the stages get 0
                for worlds at rest.
            active: 1, or 0 for worlds at rest.

        Returns:
            A squared speed to compare with that of rest [m²/s²]; see `integrate.move`.
        """
        material.remember_bends(model, path, far_path, state, scratch, group, active * previous_dt)
        curvature.measure_curvature(
            model, path, far_path, state, scratch, group, active * previous_dt
        )
        work = energy.gripper_power(model, path, state, scratch, group, 0, real(1.0))
        if model.far_is_held == 1:
            work += energy.gripper_power(
                model, far_path, state, scratch, group, model.node_count - 1, real(-1.0)
            )
        elastic.elastic_forces(model, path, far_path, state, scratch, group, force_dt)
        integrate.predict_velocities(model, state, scratch, group, force_dt)
        air.resist(model, state, scratch, group, force_dt)
        table.meet_table(model, state, scratch, group, active)
        integrate.drive_held_ends(model, path, far_path, state, group)
        length.hold_lengths(model, state, scratch, group, active)
        work = work * force_dt + energy.tension_work(model, state, group)
        state.work[group] = state.work[group] + mul(active, work)
        return integrate.move(model, state, group, active)

    return SimpleNamespace(step=step)
