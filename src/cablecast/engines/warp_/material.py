"""Material: bending that lags behind, a curl, and sharp bends that stay in the cable.

Each node remembers two vectors that turn with the cable's material: `rest`, the bend at which it
feels no moment, and `strain`, the bend that its dashpot has not followed yet. With b the bend of
the node (elastic.py) and T the damping time, its moment over the segment length is

    EI / l^3 ((phi / sin phi) b - rest) + f,     T EI / l^3 (b - strain)' = f,

where the derivative leaves out what turns with the material. Without strain this is Kelvin's and
Voigt's solid, EI (curvature + T d curvature / dt), which a step can follow only up to a frequency:
so the strain is that of springs before the dashpots, as soft as the step needs them,

    strain = `SPRING` dt^2 B M^-1 B^T f,

with b = B x and M the masses. A mode of bending of frequency w has a spring 1 / (SPRING (w dt)^2)
times as stiff as the cable, and follows Kelvin and Voigt up to that over T; how fast it creeps
under a force depends on no spring. A step takes the dashpots by backward Euler: f solves
(dt l^3 / (T EI) + SPRING dt^2 B M^-1 B^T) f = strain with what the step has bent, a matrix of five
diagonals that is factored once.

Where the elastic bend b - rest is greater than that of the yield curvature, rest follows it by the
excess over the yield time, as in Bingham's solid: a sharp bend that lasts stays in the cable. Pads
of a gripper that give are a spring in series with the cable there, and damp as it does.

What is remembered is carried by the tangent without turning, and turned by the spin about it. So
the moment of a memory has a part that turns segments about their axis: a bent cable that rolls is
bent anew all the time, and a curl rolls back. Segments are so light about their axis that a step
takes the change of that torque implicitly: it adds to their inertia in the torsion solve.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from cablecast.conventions import tangent
from cablecast.engines.warp_.elastic import curvature_functions, factor_band
from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs
from cablecast.motion.grip_path import GripPath

SPRING = 0.75
"""Compliance of the springs before the dashpots, over that of the masses in a step (see above).
Leapfrog bears (w dt)^2 < 4 in all, of which the springs take 1 / SPRING. At 1/2 their error would
be of second order alone, and nothing would be left for bending."""

MOST_SPRING = 1.0 / SPRING
"""Most that the springs before the dashpots add to (w dt)^2 of a step."""


def dashpot_factors(
    bending: NDArray[np.float64],
    damping_time: NDArray[np.float64],
    mass: NDArray[np.float64],
    dt: float,
    grip_cells: NDArray[np.float64] | float = 2.0,
    joint: tuple[NDArray[np.float64], float] | None = None,
) -> tuple[NDArray[np.float64], ...]:
    """Factor the matrix of the dashpots (see above).

    Args:
        bending: EI / l^3 [N/m], shape [world].
        damping_time: Time by which moments lead the bend [s], shape [world].
        mass: Node masses [kg], infinite where held, shape [world, node].
        dt: Step [s].
        grip_cells: As of `filter_factors`.
        joint: As of `filter_factors`.

    Returns:
        dt l^3 / (T EI) of a whole cell [m/N], shape [world]; then what `factor_band` returns
        [N/m, -, -].
    """
    # Nothing that does not damp is stiff.
    yielding = dt / np.maximum(damping_time * bending, 1e-20)
    cells = np.ones_like(mass)
    before, middle, after = (np.full_like(mass, value) for value in (1.0, -2.0, 1.0))
    # A hinge holds no cable with a dashpot.
    cells[:, 0] = cells[:, -1] = np.where(np.asarray(grip_cells) > 0.0, grip_cells, 1.0)
    before[:, 0] = 0.0
    before[:, -1] = np.where(np.isfinite(mass[:, -1]), 0.0, 1.0)
    middle[:, -1] = after[:, -1] = 0.0
    if joint is not None:
        ratio, cells[:, -2] = joint
        middle[:, -2], after[:, -2] = -(1.0 + ratio), ratio
    inverse = SPRING * dt**2 / mass
    left, right = np.roll(inverse, 1, axis=1), np.roll(inverse, -1, axis=1)
    diagonal = before**2 * left + middle**2 * inverse + after**2 * right
    diagonal += yielding[:, None] / cells
    off1, off2 = np.zeros_like(mass), np.zeros_like(mass)
    off1[:, :-1] = (middle * inverse)[:, :-1] * before[:, 1:]
    off1[:, :-1] += (after * right)[:, :-1] * middle[:, 1:]
    off2[:, :-2] = (after * right)[:, :-2] * before[:, 2:]
    return yielding, *factor_band(diagonal, off1, off2)


def rest_bends(
    positions: NDArray[np.float64],
    roll: NDArray[np.float64],
    grip_path: GripPath,
    rest_curvature: NDArray[np.float64],
    segment_length: NDArray[np.float64],
    has_joint: bool = False,
) -> NDArray[np.float64]:
    """Return the bend of each node at which it feels no moment [m], shape [world, node, 3].

    Args:
        positions: Nodes [m], shape [world, node, 3].
        roll: Turn of each segment against a frame that the tangent carries from the grip on [rad],
            shape [world, segment].
        grip_path: Path whose start gives the direction of the grip, one row or one per world.
        rest_curvature: Curvature, positive to the left of the gripper [1/m], shape [world].
        segment_length: Length of a segment [m], shape [world].
        has_joint: Whether the node before the last clamps an attachment.
    """
    edges = np.diff(positions, axis=1)
    tangents = edges / np.maximum(np.linalg.norm(edges, axis=-1, keepdims=True), 1e-12)
    yaw, pitch = grip_path.evaluate(grip_path.knots[:, :1])[:, 0, 3:].T
    left = np.stack([-np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=-1)
    left = np.broadcast_to(left, (len(positions), 3))
    bends = np.zeros_like(positions)
    before = np.broadcast_to(tangent(yaw, pitch), (len(positions), 3))
    for node in range(positions.shape[1] - 1):
        after = tangents[:, node]
        # The smallest turn that takes one tangent to the next.
        middle = before + after
        share = np.sum(left * after, axis=-1, keepdims=True) / np.maximum(
            1.0 + np.sum(before * after, axis=-1, keepdims=True), 1e-6
        )
        left = left - middle * share
        left = left / np.maximum(np.linalg.norm(left, axis=-1, keepdims=True), 1e-12)
        angle = roll[:, node, None]
        turned = np.cos(angle) * left + np.sin(angle) * np.cross(after, left)
        bends[:, node] = turned
        before = after
    bends[:, -1] = bends[:, -2]
    # At a gripper and at an attachment lies half a cell.
    cells = np.ones(positions.shape[1])
    cells[[0, -2 if has_joint else -1]] = 0.5
    return bends * cells[:, None] * (rest_curvature * segment_length**2)[:, None, None]


@functools.cache
def material_functions(precision: str, lane_count: int, remembers: bool) -> SimpleNamespace:
    """Build the Warp functions of the material.

    `remembers` is true for a material that remembers bends; otherwise the functions do nothing.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3, dot, scale, mul = f.real, f.lane, f.vec3, f.dot, f.scale, f.mul
    cross = f.cross
    Model, Path, State, Scratch = s.Model, s.Path, s.State, s.Scratch
    segments = curvature_functions(precision, lane_count, remembers)
    Segment, read_segment = segments.Segment, segments.read_segment
    folded = wp.constant(0.01)
    tiny = wp.constant(1e-12)

    @wp.func
    def turn(a: vec3, half_turn: vec3, damp: lane):
        """Return what a vector gains as it turns by h, the tangent of half an angle.

        Args:
            a: Vector.
            half_turn: h.
            damp: 2 / (1 + |h|²).
        """
        return scale(damp, cross(half_turn, a + cross(half_turn, a)))

    @wp.func
    def strain_node(
        model: Model,
        state: State,
        group: int,
        node: int,
        before: Segment,
        after: Segment,
        cells: lane,
        previous_dt: lane,
    ):
        """Bring the memories of a node up to now; return its strain before the dashpot yields [m].

        Args:
            state: Memories; that of the rest bend is updated.
            before: Segment before the node.
            after: Segment after the node.
            cells: Stiffness of the node over that of a whole cell [-].
        """
        one = lane(real(1.0))
        half = previous_dt * real(0.5)
        bend = after.edge - before.edge
        # The sum of both edges halfway through the previous step, and its rate.
        rate = before.edge_rate + after.edge_rate
        middle = before.edge + after.edge - scale(half, rate)
        spin = (before.previous_spin + after.previous_spin) * real(0.5)
        squared_length = mul(model.segment_length[group], model.segment_length[group])
        inverse_square = f.div(one, dot(middle, middle) + squared_length * real(folded))
        along = scale(f.root(inverse_square), middle)
        half_turn = scale(mul(half, inverse_square), cross(middle, rate)) + scale(
            mul(half, spin), along
        )
        damp = f.div(lane(real(2.0)), one + dot(half_turn, half_turn))
        rest = state.rest_bend[group][node]
        rest = rest + turn(rest, half_turn, damp)
        elastic = bend - rest
        size = f.root(dot(elastic, elastic) + squared_length * real(tiny))
        excess = f.larger(size - f.div(model.yield_bend[group], cells), lane())
        yielded = mul(model.yield_share[group], previous_dt) * (real(1.0) / model.dt)
        state.rest_bend[group, node] = rest + scale(mul(yielded, f.div(excess, size)), elastic)
        # From rates, which rounding leaves exact: what the bend gained beside its turn.
        gained = scale(previous_dt, after.edge_rate - before.edge_rate)
        strain = state.strain[group][node] - bend + gained
        return state.strain[group][node] + gained + turn(strain, half_turn, damp)

    @wp.func
    def strain_nodes(
        model: Model,
        path: Path,
        far_path: Path,
        state: State,
        scratch: Scratch,
        group: int,
        previous_dt: lane,
    ):
        """Bring all memories up to now, and eliminate the dashpots from the grip on.

        Args:
            state: State at the start of the step, whose memories are updated.
            scratch: Receives the right side of the dashpots.
        """
        last = model.node_count - 1
        lower1 = model.dashpot_lower1[group]
        lower2 = model.dashpot_lower2[group]
        strains = state.strain[group]
        right_sides = scratch.dashpot[group]
        before = segments.gripper_segment(model, path, group)
        right1 = vec3()
        right2 = vec3()
        cells = model.grip_cells[group]
        node = int(0)
        while node < last - 1:
            after = read_segment(state, group, node)
            strain = strain_node(model, state, group, node, before, after, cells, previous_dt)
            strains[node] = strain
            right = strain - scale(lower1[node], right1) - scale(lower2[node], right2)
            right_sides[node] = right
            right2 = right1
            right1 = right
            before = after
            cells = lane(real(1.0))
            node += 1
        after = segments.last_segment(model, state, group)
        strain = strain_node(
            model, state, group, node, before, after, lane(model.joint_cells), previous_dt
        )
        strains[node] = strain
        right = strain - scale(lower1[node], right1) - scale(lower2[node], right2)
        right_sides[node] = right
        if model.far_is_held == 1:
            gripper = segments.gripper_segment(model, far_path, group)
            strain = strain_node(
                model, state, group, last, after, gripper, model.grip_cells[group], previous_dt
            )
            strains[last] = strain
            right_sides[last] = strain - scale(lower1[last], right) - scale(lower2[last], right1)

    @wp.func
    def remember_node(
        model: Model,
        state: State,
        scratch: Scratch,
        group: int,
        node: int,
        before: Segment,
        after: Segment,
        cells: lane,
        moment: vec3,
    ):
        """Store the moment of a node's memories; return their torque, and how it holds the roll.

        Args:
            state: Memories; the dashpot yields to its moment.
            scratch: Receives the moment.
            before: Segment before the node.
            after: Segment after the node.
            cells: Stiffness of the node over that of a whole cell [-].
            moment: Moment f of the dashpot over the segment length [N].

        Returns:
            Half the torque [N·m], and half of what a change of the roll in this step adds to the
            inertia of the segments [kg·m²], as two rows, for the segments on either side.
        """
        one = lane(real(1.0))
        bend = after.edge - before.edge
        middle = before.edge + after.edge
        squared_length = mul(model.segment_length[group], model.segment_length[group])
        along = scale(
            f.root(f.div(one, dot(middle, middle) + squared_length * real(folded))), middle
        )
        stiffness = mul(model.bending[group], cells)
        remembered = scale(stiffness, state.rest_bend[group][node]) - moment
        yielded = scale(f.div(model.dashpot_yielding[group], cells), moment)
        state.strain[group, node] = state.strain[group][node] - yielded
        scratch.memory_moment[group, node] = -remembered
        torque = dot(along, cross(remembered, bend)) * real(0.5)
        holding = state.rest_bend[group][node] + scale(model.dashpot_ratio[group], bend)
        hardness = mul(stiffness, f.absolute(dot(holding, bend))) * (
            real(0.5) * model.dt * model.dt
        )
        return wp.matrix_from_rows(torque, hardness)

    @wp.func
    def remember_bends(
        model: Model,
        path: Path,
        far_path: Path,
        state: State,
        scratch: Scratch,
        group: int,
        previous_dt: lane,
    ):
        """Bring all memories up to now, and find their moments and torques.

        Args:
            state: State at the start of the step, whose memories are updated.
            scratch: Receives moments, torques, and what these add to the inertia of the segments.
        """
        strain_nodes(model, path, far_path, state, scratch, group, previous_dt)
        last = model.node_count - 1
        diagonal = model.dashpot_diagonal[group]
        lower1 = model.dashpot_lower1[group]
        lower2 = model.dashpot_lower2[group]
        dashpots = scratch.dashpot[group]
        torques = scratch.memory_torque[group]
        inertias = scratch.memory_inertia[group]
        after = segments.last_segment(model, state, group)
        roll_after = wp.matrix_from_rows(lane(), lane())
        # Moments of the dashpots at the next two nodes [N].
        moment1 = vec3()
        moment2 = vec3()
        if model.far_is_held == 1:
            gripper = segments.gripper_segment(model, far_path, group)
            moment1 = scale(diagonal[last], dashpots[last])
            roll_after = remember_node(
                model,
                state,
                scratch,
                group,
                last,
                after,
                gripper,
                model.grip_cells[group],
                moment1,
            )
        cells = lane(model.joint_cells)
        node = int(last - 1)
        while node > 0:
            before = read_segment(state, group, node - 1)
            moment = (
                scale(diagonal[node], dashpots[node])
                - scale(lower2[node + 2], moment2)
                - scale(lower1[node + 1], moment1)
            )
            roll = remember_node(model, state, scratch, group, node, before, after, cells, moment)
            torques[node] = roll[0] + roll_after[0]
            inertias[node] = roll[1] + roll_after[1]
            roll_after = roll
            after = before
            moment2 = moment1
            moment1 = moment
            cells = lane(real(1.0))
            node -= 1
        gripper = segments.gripper_segment(model, path, group)
        moment = (
            scale(diagonal[0], dashpots[0]) - scale(lower2[2], moment2) - scale(lower1[1], moment1)
        )
        cells = model.grip_cells[group]
        roll = remember_node(model, state, scratch, group, 0, gripper, after, cells, moment)
        torques[0] = roll[0] + roll_after[0]
        inertias[0] = roll[1] + roll_after[1]

    @wp.func
    def node_energy(model: Model, state: State, group: int, node: int, bend: vec3):
        """Return the energy of a node in what it remembers, for a whole cell, over EI / l^3 [m²].

        Args:
            state: Memories of the node.
            bend: Edge after the node minus the edge before it [m].
        """
        rest = state.rest_bend[group][node]
        return dot(rest, rest * real(0.5) - bend)

    @wp.func
    def remembered_energy(model: Model, path: Path, far_path: Path, state: State, group: int):
        """Return the energy of a world in what its material remembers [J]."""
        last = model.node_count - 1
        position = state.position[group]
        edge = scale(model.segment_length[group], path.next_direction[group])
        energy = lane()
        cells = model.grip_cells[group]
        node = int(0)
        while node < last - 1:
            edge_after = position[node + 1] - position[node]
            energy += mul(node_energy(model, state, group, node, edge_after - edge), cells)
            cells = lane(real(1.0))
            edge = edge_after
            node += 1
        edge_after = scale(model.last_ratio[group], position[last] - position[last - 1])
        bend = edge_after - edge
        energy += node_energy(model, state, group, last - 1, bend) * model.joint_cells
        edge = edge_after
        if model.far_is_held == 1:
            bend = scale(model.segment_length[group], far_path.next_direction[group]) - edge
            energy += mul(node_energy(model, state, group, last, bend), model.grip_cells[group])
        return mul(model.bending[group], energy)

    @wp.func
    def forget_bends(
        model: Model,
        path: Path,
        far_path: Path,
        state: State,
        scratch: Scratch,
        group: int,
        previous_dt: lane,
    ):
        """Do nothing in place of `remember_bends`."""

    @wp.func
    def no_energy(model: Model, path: Path, far_path: Path, state: State, group: int):
        """Return nothing in place of `remembered_energy`."""
        return lane()

    if not remembers:
        return SimpleNamespace(remember_bends=forget_bends, remembered_energy=no_energy)
    return SimpleNamespace(remember_bends=remember_bends, remembered_energy=remembered_energy)
