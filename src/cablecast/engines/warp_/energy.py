"""Energy: a world that gains some without work being done on it is wrong, and marked.

Friction and damping only take energy: kinetic, potential and elastic energy, less the work that the
grippers have done, can only fall. A step that is too long for a motion breaks this law first. The
work is summed up in every step, from the tension, the bending moment and the torque at a gripper;
the energy is taken every few steps, and its growth is counted from where it last was least.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.elastic import bending_functions
from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.material import material_functions
from cablecast.engines.warp_.world import world_structs

STEPS_PER_CHECK = 16
"""Steps between two checks: a growth takes tens of steps, a check a tenth of the time of one."""

MOST_GROWTH = 0.5
"""Growth at which a world is marked, as a share of its greatest kinetic and elastic energy so far.
Errors of the step and of the sum stay below a tenth; a world that breaks passes one."""

LEAST_SCALE = 1e-3
"""Least energy that a growth is compared with, as a share of the cable's weight times its length: a
cable that lies still has rounding errors, too."""

UNKNOWN_ENERGY = 1e30
"""Energy before the first check [J]: no energy has grown since."""


@functools.cache
def energy_functions(precision: str, lane_count: int, remembers: bool) -> SimpleNamespace:
    """Build the Warp functions that watch the energy.

    `remembers` is true for a material that remembers bends.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    material = material_functions(precision, lane_count, remembers)
    bend_energy = bending_functions(precision, lane_count).bend_energy
    real, lane, dot, mul, node_mass = f.real, f.lane, f.dot, f.mul, f.reciprocal
    scale = f.scale
    Model, Path, State, Scratch = s.Model, s.Path, s.State, s.Scratch
    count = wp.constant(lane_count)
    least_scale = wp.constant(LEAST_SCALE)
    most_growth = wp.constant(MOST_GROWTH)

    @wp.func
    def energies(model: Model, path: Path, far_path: Path, state: State, group: int):
        """Return the energy of a world, and how much of it is not of height [J], as two rows."""
        last = model.node_count - 1
        position = state.position[group]
        velocity = state.velocity[group]
        inverse_mass = model.inverse_mass[group]
        twists = state.twist[group]
        spins = state.spin[group]
        mass_ratios = model.mass_ratio[group]
        length = model.segment_length[group]
        squared_length = mul(length, length)
        quarter = model.inverse_square[group] * real(0.25)
        one = lane(real(1.0))
        # A gripper's cell is linear in the angle.
        x = position[1]
        edge = x - position[0]
        bend = edge - scale(length, path.next_direction[group])
        bent = mul(dot(bend, bend), mul(quarter, model.grip_cells[group]) * real(2.0))
        twisted = mul(twists[0], twists[0]) * real(2.0)
        rolling = mul(mul(spins[0], spins[0]), one + mass_ratios[1])
        mass = node_mass(inverse_mass[1])
        kinetic = mul(mass, dot(velocity[1], velocity[1]))
        height = mul(mass, x[2])
        ratio = one
        cells = real(1.0)
        node = int(2)
        while node < last + 1:
            x_after = position[node]
            at_last = real(wp.max(node + 1 - last, 0))
            ratio = one + (model.last_ratio[group] - one) * at_last
            cells = real(1.0) + (model.joint_cells - real(1.0)) * at_last
            edge_after = scale(ratio, x_after - x)
            bend = edge_after - edge
            bent += bend_energy(mul(dot(bend, bend), quarter)) * cells
            twisted += mul(twists[node - 1], twists[node - 1])
            spin = spins[node - 1]
            near = one + (model.near_ratio[group] - one) * at_last
            rolling += mul(mul(spin, spin), near + mass_ratios[node])
            mass = node_mass(inverse_mass[node])
            kinetic += mul(mass, dot(velocity[node], velocity[node]))
            height += mul(mass, x_after[2])
            edge = edge_after
            x = x_after
            node += 1
        if model.far_is_held == 1:
            bend = scale(length, far_path.next_direction[group]) - edge
            bent += mul(dot(bend, bend), mul(quarter, model.grip_cells[group]) * real(2.0))
            twisted += mul(twists[last], twists[last]) * real(2.0)
        moving = (kinetic + mul(model.torsion[group], twisted)) * real(0.5)
        moving += mul(mul(model.bending[group], bent), squared_length)
        # A segment is a solid cylinder, the last with the endpoint's mass.
        radius = model.radius[group]
        quarter_inertia = mul(model.segment_mass[group], mul(radius * real(0.125), radius))
        moving += mul(quarter_inertia, rolling)
        moving += material.remembered_energy(model, path, far_path, state, group)
        return wp.matrix_from_rows(moving + height * model.gravity, moving)

    @wp.func
    def tension_work(model: Model, state: State, group: int):
        """Return the work that the grippers do through the tension in this step [J].

        Args:
            state: Positions at the start of the step; tensions and velocities in it.
        """
        position = state.position[group]
        velocity = state.velocity[group]
        tension = state.tension[group]
        last = model.node_count - 1
        work = -mul(tension[0], dot(position[1] - position[0], velocity[0]))
        if model.far_is_held == 1:
            work += mul(tension[last - 1], dot(position[last] - position[last - 1], velocity[last]))
        return work * (real(1.0) / model.dt)

    @wp.func
    def gripper_power(
        model: Model, path: Path, state: State, scratch: Scratch, group: int, node: int, side: real
    ):
        """Return the power of a gripper through bending moment and torque at its end [W].

        Args:
            state: State at the start of the step, with velocities and spins before it.
            scratch: Holds the bending moments.
            node: Node that the gripper holds.
            side: 1 at the grip, -1 at the far end.
        """
        near = node + int(side)
        v = state.velocity[group][node]
        moment = scratch.bending_moment[group][node]
        rate = scale(model.segment_length[group], path.direction_rate[group])
        power = dot(scratch.bending_moment[group][near] - moment, v) - dot(moment, rate) * side
        half_inverse_length = model.inverse_length[group] * real(0.5)
        binormals = state.binormal[group]
        twists = state.twist[group]
        turn = mul(dot(binormals[node], rate - v * side), half_inverse_length)
        turn = (turn - path.previous_spin[group] * side) * real(2.0)
        turn_near = mul(dot(binormals[near], v), half_inverse_length * side)
        twisting = mul(twists[node], turn) - mul(twists[near], turn_near)
        return power + mul(model.torsion[group], twisting)

    @wp.func
    def is_sound(model: Model, path: Path, far_path: Path, state: State, group: int, active: lane):
        """Return `active`, but 0 for worlds whose energy has grown; those lose their endpoint.

        Args:
            state: State at the end of the step; what it remembers of the energy is updated.
        """
        last = model.node_count - 1
        end = model.endpoint
        energy = energies(model, path, far_path, state, group)
        gained = energy[0] - state.energy[group] - state.work[group]
        growth = f.larger(lane(), state.growth[group] + gained)
        length = model.segment_length[group] * real(last)
        weight = model.segment_mass[group] * (model.gravity * real(last))
        least = mul(weight, length * real(least_scale))
        moving = f.larger(state.energy_scale[group], energy[1])  # pyright: ignore
        largest = f.larger(moving, least)
        state.energy[group] = energy[0]
        state.work[group] = lane()
        state.growth[group] = growth
        state.energy_scale[group] = largest
        endpoint = state.position[group, end]
        sound = active
        for k in range(count):
            # Not a number is not sound either.
            if active[k] > real(0.0) and not (growth[k] <= real(most_growth) * largest[k]):
                sound[k] = real(0.0)
                for c in range(3):
                    endpoint[c, k] = real(wp.nan)
        state.position[group, end] = endpoint
        return sound

    return SimpleNamespace(
        gripper_power=gripper_power, tension_work=tension_work, is_sound=is_sound
    )
