"""Material: bending that lags behind, a curl, and sharp bends that stay in the cable.

Each node remembers two bends as vectors that turn with the cable's material: `rest`, the bend at
which it feels no moment, and `lag`, the bend to which a dashpot has yielded so far. With b the bend
of the node (elastic.py), its moment over the segment length is

    EI / l^3 ((phi / sin phi) b - rest + R (b - lag)),     lag' = (b - lag) / T.

This is Zener's solid: a spring beside a spring of R times its stiffness that a dashpot stretches.
For motions slower than T it is Kelvin's and Voigt's, EI (curvature + R T d curvature / dt); faster
ones find it stiffer, but never rigid, so that no step is too long for it.

Where the elastic bend b - rest is greater than that of the yield curvature, rest follows it by the
excess over the yield time, as in Bingham's solid: a sharp bend that lasts stays in the cable.

What is remembered is carried by the tangent without turning, and turned by the spin about it. So
the moment of a memory has a part that turns segments about their axis: a bent cable that rolls is
bent anew all the time, and a curl rolls back.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from cablecast.conventions import tangent
from cablecast.engines.warp_.elastic import curvature_functions
from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs
from cablecast.motion.grip_path import GripPath

LAG_RATIO = 3.0
"""R: stiffness of the spring before the dashpot, over that of the cable. A greater one would follow
Kelvin and Voigt to faster motions, and take shorter steps."""


def lag_ratios(damping_time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the stiffness of the spring before the dashpot over that of the cable [-].

    Moments lead the bend by the damping time [s], of any shape; without one there is no dashpot.
    """
    return np.where(damping_time > 0.0, LAG_RATIO, 0.0)


def rest_bends(
    positions: NDArray[np.float64],
    roll: NDArray[np.float64],
    grip_path: GripPath,
    rest_curvature: NDArray[np.float64],
    segment_length: float,
    has_joint: bool = False,
) -> NDArray[np.float64]:
    """Return the bend of each node at which it feels no moment [m], shape [world, node, 3].

    Args:
        positions: Nodes [m], shape [world, node, 3].
        roll: Turn of each segment against a frame that the tangent carries from the grip on [rad],
            shape [world, segment].
        grip_path: Path whose start gives the direction of the grip, one row or one per world.
        rest_curvature: Curvature, positive to the left of the gripper [1/m], shape [world].
        segment_length: Length of a segment [m].
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
    def turned(a: vec3, half_turn: vec3, damp: lane):
        """Return a vector turned by h, the tangent of half an angle; damp is 2 / (1 + |h|²)."""
        return a + scale(damp, cross(half_turn, a + cross(half_turn, a)))

    @wp.func
    def remember_node(
        model: Model,
        state: State,
        scratch: Scratch,
        group: int,
        node: int,
        before: Segment,
        after: Segment,
        cells: real,
        previous_dt: lane,
    ):
        """Bring the memories of a node up to now; add its moment, and return its torque [N·m].

        Args:
            state: Memories, which are updated.
            scratch: Bending moments, to which that of the memories is added.
            before: Segment before the node.
            after: Segment after the node.
            cells: 1, and 2 at a gripper, where half a cell lies.
        """
        one = lane(real(1.0))
        half = previous_dt * real(0.5)
        bend = after.edge - before.edge
        # The sum of both edges halfway through the previous step, and its rate.
        rate = before.edge_rate + after.edge_rate
        middle = before.edge + after.edge - scale(half, rate)
        spin = (before.previous_spin + after.previous_spin) * real(0.5)
        squared_length = model.segment_length * model.segment_length
        inverse_square = f.div(one, dot(middle, middle) + lane(squared_length * real(folded)))
        along = scale(f.root(inverse_square), middle)
        half_turn = scale(mul(half, inverse_square), cross(middle, rate)) + scale(
            mul(half, spin), along
        )
        damp = f.div(lane(real(2.0)), one + dot(half_turn, half_turn))
        rest = turned(state.rest_bend[group][node], half_turn, damp)
        lag = turned(state.lag_bend[group][node], half_turn, damp)
        # In the first step, the dashpot is where the cable is.
        kept = mul(model.lag_kept[group], previous_dt) * (real(1.0) / model.dt)
        lag = bend + scale(kept, lag - bend)
        elastic = bend - rest
        size = f.root(dot(elastic, elastic) + lane(squared_length * real(tiny)))
        excess = f.larger(size - model.yield_bend[group] * (real(1.0) / cells), lane())
        yielded = mul(model.yield_share[group], previous_dt) * (real(1.0) / model.dt)
        rest = rest + scale(mul(yielded, f.div(excess, size)), elastic)
        state.rest_bend[group, node] = rest
        state.lag_bend[group, node] = lag
        stiffness = model.bending[group] * cells
        ratio = model.lag_ratio[group]
        lagging = scale(mul(stiffness, ratio), bend - lag)
        moments = scratch.bending_moment[group]
        moments[node] = moments[node] + lagging - scale(stiffness, rest)
        remembered = rest + scale(ratio, lag)
        torque = mul(stiffness, dot(along, cross(remembered, bend)))
        # What a step cannot follow, because segments are so light about their axis, takes longer.
        hardness = mul(stiffness, f.absolute(dot(remembered, bend))) * (model.dt * model.dt)
        inertia = model.segment_mass[group] * (model.radius * model.radius)
        return mul(torque, f.div(inertia, inertia + hardness))

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
        """Bring all memories up to now, and add their moments and torques to those of the cable.

        Args:
            state: State at the start of the step, whose memories are updated.
            scratch: Bending moments and the eliminated torsion system, which are added to.
        """
        last = model.node_count - 1
        pivots = model.spin_pivot[group]
        right_sides = scratch.torque[group]
        coupling = mul(model.torsion[group], model.torsion_time[group]) * model.dt
        half = real(0.5)
        after = segments.last_segment(model, state, group)
        torque_after = lane()
        if model.far_is_held == 1:
            gripper = segments.gripper_segment(model, far_path, group)
            torque_after = remember_node(
                model, state, scratch, group, last, after, gripper, real(2.0), previous_dt
            )
        # What the torque on a segment and those beyond it leaves after the elimination of these.
        eliminated = lane()
        cells = model.joint_cells
        node = int(last - 1)
        while node > 0:
            before = read_segment(state, group, node - 1)
            torque = remember_node(
                model, state, scratch, group, node, before, after, cells, previous_dt
            )
            right_side = (torque + torque_after) * half + eliminated
            right_sides[node] = right_sides[node] + right_side
            eliminated = mul(mul(coupling, pivots[node]), right_side)
            torque_after = torque
            after = before
            cells = real(1.0)
            node -= 1
        gripper = segments.gripper_segment(model, path, group)
        torque = remember_node(
            model, state, scratch, group, 0, gripper, after, real(2.0), previous_dt
        )
        right_sides[0] = right_sides[0] + (torque + torque_after) * half + eliminated

    @wp.func
    def node_energy(model: Model, state: State, group: int, node: int, bend: vec3):
        """Return the energy of a node in what it remembers, for a whole cell, over EI / l^3 [m²].

        Args:
            state: Memories of the node.
            bend: Edge after the node minus the edge before it [m].
        """
        lagging = bend - state.lag_bend[group][node]
        rest = state.rest_bend[group][node]
        lag_energy = mul(model.lag_ratio[group] * real(0.5), dot(lagging, lagging))
        return lag_energy + dot(rest, rest * real(0.5) - bend)

    @wp.func
    def remembered_energy(model: Model, path: Path, far_path: Path, state: State, group: int):
        """Return the energy of a world in what its material remembers [J]."""
        last = model.node_count - 1
        position = state.position[group]
        edge = path.next_direction[group] * model.segment_length
        energy = lane()
        node = int(0)
        while node < last - 1:
            edge_after = position[node + 1] - position[node]
            cells = real(wp.max(2 - node, 1))
            energy += node_energy(model, state, group, node, edge_after - edge) * cells
            edge = edge_after
            node += 1
        edge_after = scale(model.last_ratio[group], position[last] - position[last - 1])
        bend = edge_after - edge
        energy += node_energy(model, state, group, last - 1, bend) * model.joint_cells
        edge = edge_after
        if model.far_is_held == 1:
            bend = far_path.next_direction[group] * model.segment_length - edge
            energy += node_energy(model, state, group, last, bend) * real(2.0)
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
