"""Elasticity: bending and twist of the rod, in two sweeps over its nodes.

Bending. At an inner node the curvature vector is b / l^2 with b = x[i-1] - 2 x[i] + x[i+1].
Segments keep their length, so |b| = 2 l sin(phi / 2), where phi is the angle between the two edges.
The energy is that of a rod whose curvature phi / l is constant around the node,
E = EI phi^2 / (2 l); its gradient is EI / l^3 times (phi / sin phi) times b, spread over three
nodes as (1, -2, 1). At the grip the cable leaves along the gripper's tangent t: half a cell with
u = x[1] - x[0] - l t.

Twist. The spin of a segment is its rate of turn about its tangent, measured against a frame that is
carried along without turning (parallel transport in time). A node stores the twist between the two
segments that it joins, and its rate is

    twist' = spin[i] - spin[i-1] + kb . (v[i+1] - v[i-1]) / (2 l),

where kb = 2 e x f / (l^2 + e . f) is the curvature binormal of the edges e and f. The last term is
the holonomy of a bending curve, and its gradient gives the force with which twist acts on the
shape: what makes a twisted cable buckle into loops (Bergou et al. 2008 and 2010, gradient of the
reference twist). A twist costs C twist^2 / (2 l) with C the torsional rigidity GJ; between a
gripper and the middle of its segment lies half a cell. Segments are so light against their
torsional stiffness that a step can't follow their fastest swings. The torque, which also acts on
the shape, is therefore that of the twist and a filter of the spins of three steps, the new one
included (a tridiagonal solve):

    twist + dt D (a s[n+1/2] - (a - c) s[n-1/2] - c s[n-3/2])

with D the difference between the segments of a node. What is added is of second order in the step,
takes energy at the third order only, and quells what is too fast to follow. In a material with a
damping time T the torque follows the twist and T times its whole rate, the holonomy included, of
the previous step; what the spins change of it in this step counts, too.

Sweeps. The backward sweep, from the far end to the grip, measures at each node how the cable is
curved and twisted, and eliminates the torsion system on its way; a gripper takes the place of a
segment. The forward sweep solves for the spins, and with them for the torques. A node's bending
moment w (over the segment length) and force of twist q act on its neighbours, so that the force on
node i is 2 w[i] - w[i-1] - w[i+1] + q[i+1] - q[i-1]. It also eliminates the filter of the bending
force, whose back substitution is left to the prediction of velocities (step.py).
"""

import functools
from types import SimpleNamespace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportGeneralTypeIssues=false


FILTER_SHARE = 1.0 / 12.0
"""Share of dt^2 K, added to the masses that the bending force accelerates, with which waves travel
as they should up to the fourth order of the step: it undoes what leapfrog adds to their
frequency, w (w dt)^2 / 24. A greater share would make any step stable for a straight cable, and
create energy on a curved one (constants.py)."""

SHARPEST = 0.6
"""Largest sin^2(phi / 2) up to which the moment follows the angle: 101 degrees at one node. Beyond
it a chain of segments no longer resembles a rod, and the moment stops growing."""


def filter_factors(
    bending: NDArray[np.float64],
    mass: NDArray[np.float64],
    dt: float,
    joint: tuple[NDArray[np.float64], float] | None = None,
    grip_cells: NDArray[np.float64] | float = 2.0,
) -> tuple[NDArray[np.float64], ...]:
    """Factor M + dt^2 K / 12 = L D L^T, with K the stiffness matrix of a nearly straight rod.

    Args:
        bending: EI / l^3 [N/m], shape [world].
        mass: Node masses [kg], infinite where held, shape [world, node].
        dt: Step [s].
        joint: Length of the other segments over that of the last one, an attachment's, shape
            [world], and stiffness of its joint over that of a whole cell; None without one.
        grip_cells: Stiffness at a gripper over that of a whole cell [-], shape [world].

    Returns:
        1 / D [1/kg], shape [world, node], and the first and second lower diagonals of L [-], with
        two zeros beyond the last node, shape [world, node + 2].
    """
    node_count = mass.shape[1]
    k = FILTER_SHARE * dt**2 * bending
    free = np.isfinite(mass)
    diagonal = np.where(free, mass, 1.0)
    off1 = np.zeros_like(diagonal)  # couples i and i + 1
    off2 = np.zeros_like(diagonal)  # couples i and i + 2
    diagonal[:, 1] += grip_cells * k
    diagonal[:, -2] += np.where(free[:, -1], 0.0, grip_cells * k)
    ratio, cells = (np.ones_like(k), 1.0) if joint is None else joint
    for i in range(1, node_count - 1):
        s, c = (ratio, cells * k) if i == node_count - 2 else (np.ones_like(k), k)
        # The bend x[i-1] - (1 + s) x[i] + s x[i+1], squared.
        diagonal[:, i - 1] += c
        diagonal[:, i] += (1.0 + s) ** 2 * c
        diagonal[:, i + 1] += s**2 * c
        off1[:, i - 1] -= (1.0 + s) * c
        off1[:, i] -= (1.0 + s) * s * c
        off2[:, i - 1] += s * c
    # Held nodes do not accelerate: take them out of the system.
    off1[:, :-1] *= free[:, :-1] & free[:, 1:]
    off2[:, :-2] *= free[:, :-2] & free[:, 2:]
    inverse, lower1, lower2 = factor_band(diagonal, off1, off2)
    return np.where(free, inverse, 0.0), lower1, lower2


def factor_band(
    diagonal: NDArray[np.float64], off1: NDArray[np.float64], off2: NDArray[np.float64]
) -> tuple[NDArray[np.float64], ...]:
    """Factor symmetric matrices of five diagonals as L D L^T.

    Args:
        diagonal: Diagonals, shape [world, node].
        off1: Entries that couple node i with i + 1, same shape.
        off2: Entries that couple node i with i + 2, same shape.

    Returns:
        1 / D, shape [world, node], and the first and second lower diagonals of L [-], with two
        zeros beyond the last node, shape [world, node + 2].
    """
    d = np.ones_like(diagonal)
    lower1 = np.zeros_like(d)
    lower2 = np.zeros_like(d)
    for i in range(d.shape[1]):
        d[:, i] = diagonal[:, i]
        if i >= 2:
            lower2[:, i] = off2[:, i - 2] / d[:, i - 2]
            d[:, i] -= lower2[:, i] ** 2 * d[:, i - 2]
        if i >= 1:
            coupling = off1[:, i - 1].copy()
            if i >= 2:
                coupling -= lower2[:, i] * d[:, i - 2] * lower1[:, i - 1]
            lower1[:, i] = coupling / d[:, i - 1]
            d[:, i] -= lower1[:, i] ** 2 * d[:, i - 1]
    beyond = [(0, 0), (0, 2)]
    return 1.0 / d, np.pad(lower1, beyond), np.pad(lower2, beyond)


@functools.cache
def bending_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the Warp functions of bending."""
    f = lane_functions(precision, lane_count)
    real, lane, vec3, scale, mul = f.real, f.lane, f.vec3, f.scale, f.mul
    sharpest = wp.constant(SHARPEST)

    @wp.func
    def angle_over_sine(sine_squared: lane):
        """Return phi / sin(phi) from q = sin^2(phi / 2) [-]: 1 + 2/3 q + 8/15 q^2 + ..."""
        q = f.smaller(sine_squared, lane(real(sharpest)))
        value = lane(real(128.0 / 315.0)) + q * real(256.0 / 693.0)
        value = lane(real(16.0 / 35.0)) + mul(q, value)
        value = lane(real(8.0 / 15.0)) + mul(q, value)
        value = lane(real(2.0 / 3.0)) + mul(q, value)
        return lane(real(1.0)) + mul(q, value)

    @wp.func
    def node_moment(bending: lane, sine_squared: lane, bend: vec3):
        """Return the bending moment over the segment length at an inner node [N].

        It is the gradient EI / l^3 (phi / sin phi) b of the energy.

        Args:
            bending: EI / l^3 [N/m].
            sine_squared: sin^2(phi / 2) [-].
            bend: b, the edge after the node minus the edge before it [m].
        """
        return scale(mul(bending, angle_over_sine(sine_squared)), bend)

    @wp.func
    def bend_energy(sine_squared: lane):
        """Return phi^2 / 2 from q = sin^2(phi / 2) [-], as far as `node_moment` follows it.

        It is the sum 2 q + 2/3 q^2 + 16/45 q^3 + ... of which `angle_over_sine` is half the slope.
        """
        q = f.smaller(sine_squared, lane(real(sharpest)))
        value = lane(real(256.0 / 1575.0)) + q * real(256.0 / 2079.0)
        value = lane(real(8.0 / 35.0)) + mul(q, value)
        value = lane(real(16.0 / 45.0)) + mul(q, value)
        value = lane(real(2.0 / 3.0)) + mul(q, value)
        value = mul(q, lane(real(2.0)) + mul(q, value))
        return value + mul(sine_squared - q, angle_over_sine(q)) * real(2.0)

    return SimpleNamespace(node_moment=node_moment, bend_energy=bend_energy)


IMPLICIT = 8.0 / 27.0
"""Share a of the spins at the end of the step in their torque (see above)."""

REMEMBERED = 1.0 / 27.0
"""Share c of the spins of two steps ago. With these two a twist far stiffer than a step can follow
loses half of its ringing in each step, and more in none."""


SHARP_TORSION = 1.0
"""Most that torsion may act on the shape, as C |kb|^2 dt^2 / (m l^3): where a cable that is stiff
in torsion is bent that sharply, a step can't follow how its shape untwists. A smooth curve stays
far below; `python -m benchmarks stability` tells that folds do not throw the cable about."""

MOST_TWIST = 1.0
"""Twist at one node up to which torsion acts on the shape in full [rad]. Beyond it a chain of
segments no longer resembles a rod, and the torque stops growing."""


def spin_pivots(
    torsion: np.ndarray, inertia: np.ndarray, squared_time: np.ndarray, far_is_held: bool
) -> np.ndarray:
    """Inverse pivots of I + dt (dt + tau) (C / l) L, eliminated from the far end on.

    Args:
        torsion: C / l [N·m], shape [world].
        inertia: Moment of inertia of each segment about its axis [kg·m²], shape [world, edge].
        squared_time: dt (dt + tau), tau the time by which twist is damped [s²], shape [world].
        far_is_held: Whether the far end is kept from turning.

    Returns:
        1 / pivot [1/(kg·m²)], shape [world, edge].
    """
    k = squared_time * torsion
    edge_count = inertia.shape[1]
    inverse = np.empty_like(inertia)
    beyond = np.zeros_like(k)
    for e in reversed(range(edge_count)):
        # Half a cell at a held end is twice as stiff; a free end has nothing beyond it.
        before = 2.0 if e == 0 else 1.0
        after = 1.0 if e < edge_count - 1 else (2.0 if far_is_held else 0.0)
        pivot = inertia[:, e] + (before + after) * k - beyond
        inverse[:, e] = 1.0 / pivot
        beyond = k**2 / pivot
    return inverse


@functools.cache
def twist_functions(precision: str, lane_count: int, damped: bool) -> SimpleNamespace:
    """Build the Warp functions of twist.

    `damped` is true for a material that may damp twist.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3 = f.real, f.lane, f.vec3
    dot, cross, scale, mul = f.dot, f.cross, f.scale, f.mul
    Model, Path, State, Scratch = s.Model, s.Path, s.State, s.Scratch
    most_twist = wp.constant(MOST_TWIST)
    implicit = wp.constant(IMPLICIT)
    remembered = wp.constant(REMEMBERED)

    @wp.func
    def binormal(model: Model, group: int, sine_squared: lane, before: vec3, after: vec3):
        """Return the curvature binormal of two edges of equal length, 2 tan(phi / 2) long [-].

        The factor 2 / (l^2 + e . f) is 1 / (l^2 (1 - q)) with q = sin^2(phi / 2), here as a series
        that stays finite where edges fold back on each other.

        Args:
            sine_squared: q [-].
            before: Edge e before the node [m].
            after: Edge f after the node [m].
        """
        q = sine_squared
        one = lane(real(1.0))
        series = one + mul(q, one + mul(q, one + mul(q, one + q)))
        return scale(mul(series, model.inverse_square[group]), cross(before, after))

    @wp.func
    def store_lead(
        model: Model, scratch: Scratch, group: int, node: int, rate: lane, binormal: vec3
    ):
        """Return by how much the dashpot of twist leads it [rad]; store it.

        Args:
            scratch: Receives the lead.
            rate: Rate of the twist in the previous step [rad/s].
            binormal: Curvature binormal [-].
        """
        # Where the cable is bent so sharply that a step cannot follow how this acts on the shape,
        # it leads by less.
        damped = mul(model.torsion[group], model.twist_damping_time[group])
        sharpness = mul(damped, dot(binormal, binormal)) * (real(1.0) / model.dt)
        sharp = model.sharp_torsion[group]
        followed = f.div(sharp, sharp + sharpness)
        lead = mul(mul(followed, model.twist_damping_time[group]), rate)
        scratch.lead[group, node] = lead
        return lead

    @wp.func
    def stored_lead(scratch: Scratch, group: int, node: int):
        """Return the lead of a node [rad]."""
        return scratch.lead[group][node]

    @wp.func
    def store_nothing(
        model: Model, scratch: Scratch, group: int, node: int, rate: lane, binormal: vec3
    ):
        """Return nothing in place of `store_lead`."""
        return lane()

    @wp.func
    def no_lead(scratch: Scratch, group: int, node: int):
        """Return nothing in place of `stored_lead`."""
        return lane()

    keep_lead, lead = (store_lead, stored_lead) if damped else (store_nothing, no_lead)

    @wp.func
    def constant_pivot(model: Model, scratch: Scratch, group: int, segment: int):
        """Return the inverse pivot of a segment in the torsion solve [1/(kg·m²)]."""
        return model.spin_pivot[group][segment]

    @wp.func
    def found_pivot(model: Model, scratch: Scratch, group: int, segment: int):
        """Return the inverse pivot of a segment, as `find_pivots` left it [1/(kg·m²)]."""
        return scratch.spin_pivot[group][segment]

    @wp.func
    def find_pivots(model: Model, scratch: Scratch, group: int):
        """Eliminate the matrix of the torsion solve, to which memories add inertia.

        With q the part of a pivot without the coupling k to the segment before, what is left of
        the segments beyond is k q / (k + q), which takes no difference of large numbers.
        """
        coupling = mul(model.torsion[group], model.torsion_time[group]) * model.dt
        inertias = model.spin_inertia[group]
        added = scratch.memory_inertia[group]
        pivots = scratch.spin_pivot[group]
        beyond = coupling * real(2 * model.far_is_held)
        segment = int(model.node_count - 2)
        while segment > 0:
            alone = inertias[segment] + added[segment] + beyond
            pivot = f.div(lane(real(1.0)), alone + coupling)
            pivots[segment] = pivot
            beyond = mul(mul(coupling, alone), pivot)
            segment -= 1
        alone = inertias[0] + added[0] + beyond
        pivots[0] = f.div(lane(real(1.0)), alone + coupling * real(2.0))

    @wp.func
    def find_nothing(model: Model, scratch: Scratch, group: int):
        """Do nothing in place of `find_pivots`."""

    pivot, find_pivots = (found_pivot, find_pivots) if damped else (constant_pivot, find_nothing)

    @wp.func
    def turn_twist(
        model: Model,
        state: State,
        scratch: Scratch,
        group: int,
        node: int,
        spin_difference: lane,
        edge_rates: vec3,
        new_binormal: vec3,
        previous_dt: lane,
    ):
        """Return the twist of a node after the previous step, and its lead [rad].

        Args:
            state: Holds twist and binormal of the node, which are updated.
            scratch: Receives the lead.
            spin_difference: Spin of the segment after the node minus that before it [rad/s].
            edge_rates: Sum of the rates of both edges [m/s].
            new_binormal: Curvature binormal at the start of this step [-].
        """
        # The binormal halfway through the step is the mean of those at its ends.
        twists = state.twist[group]
        binormals = state.binormal[group]
        doubled = binormals[node] + new_binormal
        holonomy = mul(dot(doubled, edge_rates), model.inverse_length[group] * real(0.25))
        rate = spin_difference + holonomy
        twist = twists[node] + mul(previous_dt, rate)
        twists[node] = twist
        binormals[node] = new_binormal
        return twist + keep_lead(model, scratch, group, node, rate, new_binormal)

    @wp.func
    def gripper_turn(model: Model, path: Path, group: int):
        """Return the turn of a gripper that counts for the torque [rad]."""
        change = path.spin[group] - path.previous_spin[group]
        damped = mul(model.twist_damping_time[group], change)
        return damped + change * (model.dt * real(implicit))

    @wp.func
    def take_spin(model: Model, state: State, group: int, segment: int, spin: lane):
        """Give a segment its spin at the end of the step [rad/s]; keep its turn for the next."""
        change = spin - state.spin[group][segment]
        state.turn[group][segment] = change * (model.dt * real(remembered))
        state.spin[group][segment] = spin

    @wp.func
    def shape_force(model: Model, state: State, group: int, node: int, twist: lane):
        """Return the force of a node's twist on the node before it [N].

        The node after it feels the opposite force.

        Args:
            state: Holds the curvature binormal of the node.
            twist: Torque of the node at the end of the step, over GJ / l [rad].
        """
        bounded = f.smaller(f.larger(twist, lane(real(-most_twist))), lane(real(most_twist)))
        binormal = state.binormal[group][node]
        sharpness = dot(binormal, binormal) + lane(real(1.0e-12))
        acting = f.smaller(model.torsion[group], f.div(model.sharp_torsion[group], sharpness))
        half_inverse_length = model.inverse_length[group] * real(0.5)
        return scale(mul(mul(acting, bounded), half_inverse_length), binormal)

    return SimpleNamespace(
        binormal=binormal,
        lead=lead,
        pivot=pivot,
        find_pivots=find_pivots,
        gripper_turn=gripper_turn,
        take_spin=take_spin,
        turn_twist=turn_twist,
        shape_force=shape_force,
    )


@functools.cache
def curvature_functions(precision: str, lane_count: int, damped: bool) -> SimpleNamespace:
    """Build the Warp functions that read segments and measure curvature and twist.

    `damped` is true for a material that may damp twist.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    node_moment = bending_functions(precision, lane_count).node_moment
    twist = twist_functions(precision, lane_count, damped)
    real, lane, vec3, dot, scale, mul = f.real, f.lane, f.vec3, f.dot, f.scale, f.mul
    Model, Path, State, Scratch = s.Model, s.Path, s.State, s.Scratch

    @wp.struct
    class Segment:
        """A segment beside a node; a gripper stands for the segment that it holds.

        Attributes:
            edge: Second node minus first [m].
            edge_rate: Rate of the edge [m/s].
            previous_spin: Spin in the previous step [rad/s].
            turn: Turn that counts for the torque now, as far as it is known [rad].
        """

        edge: vec3
        edge_rate: vec3
        previous_spin: lane
        turn: lane

    @wp.func
    def read_segment(state: State, group: int, index: int):
        """Return the `Segment` of an index."""
        segment = Segment()
        position = state.position[group]
        velocity = state.velocity[group]
        segment.edge = position[index + 1] - position[index]
        segment.edge_rate = velocity[index + 1] - velocity[index]
        segment.previous_spin = state.spin[group][index]
        segment.turn = state.turn[group][index]
        return segment

    @wp.func
    def last_segment(model: Model, state: State, group: int):
        """Return the last `Segment`, stretched to the length of the others."""
        segment = read_segment(state, group, model.node_count - 2)
        segment.edge = scale(model.last_ratio[group], segment.edge)
        segment.edge_rate = scale(model.last_ratio[group], segment.edge_rate)
        return segment

    @wp.func
    def gripper_segment(model: Model, path: Path, group: int):
        """Return a gripper as the `Segment` that it holds."""
        segment = Segment()
        segment.edge = scale(model.segment_length[group], path.direction[group])
        segment.edge_rate = scale(model.segment_length[group], path.direction_rate[group])
        segment.previous_spin = path.previous_spin[group]
        segment.turn = twist.gripper_turn(model, path, group)
        return segment

    @wp.func
    def node_torque(
        model: Model,
        state: State,
        scratch: Scratch,
        group: int,
        node: int,
        before: Segment,
        after: Segment,
        sine_squared: lane,
        previous_dt: lane,
    ):
        """Return the torque at a node as far as it is known before the spins are solved for [N·m].

        Args:
            state: Holds twist and binormal of the node, which are brought up to now.
            scratch: Receives the lead of the twist.
            before: Segment before the node.
            after: Segment after the node.
            sine_squared: sin^2 of half the angle between them [-].
        """
        turned = twist.turn_twist(
            model,
            state,
            scratch,
            group,
            node,
            after.previous_spin - before.previous_spin,
            before.edge_rate + after.edge_rate,
            twist.binormal(model, group, sine_squared, before.edge, after.edge),
            previous_dt,
        )
        return mul(model.torsion[group], turned + after.turn - before.turn)

    @wp.func
    def held_torque(
        model: Model,
        state: State,
        scratch: Scratch,
        group: int,
        node: int,
        before: Segment,
        after: Segment,
        previous_dt: lane,
    ):
        """Return the torque at a held node [N·m], with half a cell; store its bending moment.

        Bending at a gripper is linear in the angle to it. Arguments are those of `node_torque`.
        """
        bend = after.edge - before.edge
        sine_squared = mul(dot(bend, bend), model.inverse_square[group] * real(0.25))
        scratch.bending_moment[group, node] = scale(
            mul(model.bending[group], model.grip_cells[group]), bend
        )
        torque = node_torque(
            model, state, scratch, group, node, before, after, sine_squared, previous_dt
        )
        return torque * real(2.0)

    @wp.func
    def add_memory_torque(scratch: Scratch, group: int, segment: int, torque: lane):
        """Return a torque on a segment with that of its memories [N·m]."""
        return torque + scratch.memory_torque[group][segment]

    @wp.func
    def add_memory_moments(model: Model, scratch: Scratch, group: int):
        """Add the moments of memories to those of the cable."""
        moments = scratch.bending_moment[group]
        memories = scratch.memory_moment[group]
        node = int(0)
        while node < model.node_count - 1 + model.far_is_held:
            moments[node] = moments[node] + memories[node]
            node += 1

    @wp.func
    def add_no_torque(scratch: Scratch, group: int, segment: int, torque: lane):
        """Return a torque on a segment as it is, in place of `add_memory_torque`."""
        return torque

    @wp.func
    def add_no_moments(model: Model, scratch: Scratch, group: int):
        """Do nothing in place of `add_memory_moments`."""

    with_memory = add_memory_torque if damped else add_no_torque
    add_moments = add_memory_moments if damped else add_no_moments

    @wp.func
    def measure_curvature(
        model: Model,
        path: Path,
        far_path: Path,
        state: State,
        scratch: Scratch,
        group: int,
        previous_dt: lane,
    ):
        """Measure bending moments and twist; eliminate the torsion system from the far end on.

        Args:
            state: State at the start of the step; receives twist and binormals.
            scratch: Receives bending moments, and the right side of the torsion system.
        """
        last = model.node_count - 1
        bending = model.bending[group]
        quarter = model.inverse_square[group] * real(0.25)
        coupling = mul(model.torsion[group], model.torsion_time[group]) * model.dt
        torque_per_impulse = mul(
            model.segment_mass[group], model.radius[group] * real(0.5) / model.dt
        )
        axial_impulses = state.axial_impulse[group]
        moments = scratch.bending_moment[group]
        right_sides = scratch.torque[group]
        twist.find_pivots(model, scratch, group)
        after = last_segment(model, state, group)
        torque_after = lane()
        if model.far_is_held == 1:
            gripper = gripper_segment(model, far_path, group)
            torque_after = held_torque(
                model, state, scratch, group, last, after, gripper, previous_dt
            )
        eliminated = lane()
        node = int(last - 1)
        while node > 0:
            before = read_segment(state, group, node - 1)
            bend = after.edge - before.edge
            sine_squared = mul(dot(bend, bend), quarter)
            moments[node] = node_moment(bending, sine_squared, bend)
            torque = node_torque(
                model, state, scratch, group, node, before, after, sine_squared, previous_dt
            )
            # The segment after the node has both its torques now.
            table_torque = mul(torque_per_impulse, axial_impulses[node])
            table_torque = with_memory(scratch, group, node, table_torque)
            right_side = torque_after - torque + eliminated + table_torque
            right_sides[node] = right_side
            pivot = twist.pivot(model, scratch, group, node)
            eliminated = mul(mul(coupling, pivot), right_side)
            torque_after = torque
            after = before
            node -= 1
        moments[last - 1] = moments[last - 1] * model.joint_cells
        gripper = gripper_segment(model, path, group)
        torque = held_torque(model, state, scratch, group, 0, gripper, after, previous_dt)
        table_torque = mul(torque_per_impulse, axial_impulses[0])
        table_torque = with_memory(scratch, group, 0, table_torque)
        right_sides[0] = torque_after - torque + eliminated + table_torque
        add_moments(model, scratch, group)

    return SimpleNamespace(
        Segment=Segment,
        read_segment=read_segment,
        last_segment=last_segment,
        gripper_segment=gripper_segment,
        measure_curvature=measure_curvature,
    )


@functools.cache
def elastic_functions(precision: str, lane_count: int, damped: bool) -> SimpleNamespace:
    """Build the Warp function of elastic forces.

    `damped` is true for a material that may damp twist.
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
            scratch: Bending moments and the right side of the torsion system; receives spins and
                forces, halfway through the filter.
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
        turns = state.turn[group]
        twists = state.twist[group]
        lower1 = model.filter_lower1[group]
        lower2 = model.filter_lower2[group]
        moments = scratch.bending_moment[group]
        right_sides = scratch.torque[group]
        predicted_spins = scratch.spin[group]
        forces = scratch.force[group]
        # Rate of the spin [rad/s²].
        alpha = lane()
        turn_before = twist.gripper_turn(model, path, group)
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
            pivot = twist.pivot(model, scratch, group, node)
            alpha = mul(pivot, right_sides[node] + mul(coupling, alpha))
            previous_spin = spins[node]
            undamped = mul(explicit_damping, previous_spin) + alpha * force_dt
            spin = mul(implicit_damping, undamped)
            predicted_spins[node] = spin
            turn = turns[node] + mul(torsion_time, spin - previous_spin)
            w_after = moments[node]
            turned = twists[node] + turn - turn_before
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
            turn_before = turn
            cells = real(1.0)
            node += 1
        w_after = vec3()
        q_after = vec3()
        if model.far_is_held == 1:
            w_after = moments[last]
            turned = twists[last] + twist.gripper_turn(model, far_path, group) - turn_before
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
