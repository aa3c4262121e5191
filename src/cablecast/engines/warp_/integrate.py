"""Time integration: from forces to predicted velocities, and from velocities to positions."""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs


@functools.cache
def integrate_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the Warp functions that advance velocities and positions."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3, scale, mul = f.real, f.lane, f.vec3, f.scale, f.mul
    Model, Path, State, Scratch = s.Model, s.Path, s.State, s.Scratch
    airborne_weight = wp.constant(1.0e6)  # squared speed per height of a free end [m/s²]
    swing_weight = wp.constant(1.0e-4)  # of squared speeds outside the last quarter [-]

    @wp.func
    def predict_velocities(
        model: Model, state: State, scratch: Scratch, group: int, force_dt: real
    ):
        """Turn forces into the velocities that elasticity, gravity and damping lead to.

        The bending filter has been eliminated up to here; its back substitution goes from the far
        end to the grip. Damping is centred in the step.

        Args:
            model: Constants of the batch.
            state: State at the start of the step.
            scratch: Holds `force`; receives `velocity` in its place.
            group: Group of worlds.
            force_dt: Time for which forces act in this step [s].
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
    def move(model: Model, state: State, scratch: Scratch, group: int, active: lane):
        """Advance positions and spins; return a squared speed that tells whether worlds rest.

        Args:
            model: Constants of the batch.
            state: Receives positions, velocities and spins at the end of the step.
            scratch: Holds the new spins.
            group: Group of worlds.
            active: 1, or 0 for worlds at rest.

        Returns:
            The largest squared horizontal speed of any node [m²/s²]. A free end in the air counts
            as moving. What hangs from the gripper may swing on for seconds, so that speeds outside
            the last quarter of the cable count a hundredth.
        """
        last = model.node_count - 1
        position = state.position[group]
        velocity = state.velocity[group]
        spins = state.spin[group]
        predicted_spins = scratch.spin[group]
        lifted = f.larger(position[model.endpoint][2] - lane(model.radius * real(1.5)), lane())
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
        segment = int(0)
        while segment < last:
            spins[segment] = mul(active, predicted_spins[segment])
            segment += 1
        return fastest

    return SimpleNamespace(
        predict_velocities=predict_velocities, drive_held_ends=drive_held_ends, move=move
    )
