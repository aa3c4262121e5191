"""The arrays of a batch: constants, held ends, state, scratch memory and samples.

Worlds are grouped by lanes: world w is lane w % lane_count of group w // lane_count. Arrays are
indexed [group, node] or [group, segment]; segment s joins nodes s and s + 1. Every entry is a lane,
which has one value for each world of the group.
"""

import dataclasses
import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.lanes import lane_types

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false


@functools.cache
def world_structs(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the Warp structs for a precision and a lane count."""
    types = lane_types(precision, lane_count)
    real, lane, vec3 = types.real, types.lane, types.vec3

    @wp.struct
    class Model:
        """Constants of a batch.

        Attributes:
            node_count: Number of nodes.
            endpoint: Index of the cable's end: the last node, or that before an attachment's.
            joint_cells: Stiffness of the node before the last over that of a whole cell [-]: 2
                where it clamps an attachment, else 1.
            far_is_held: 1 where a second gripper holds the far end, else 0.
            dt: Step [s].
            gravity: Acceleration of free fall [m/s²].
            half_width, y_min, y_max: Edges of the table [m]: the largest |x|, and the bounds of y.
            segment_length: Length of a segment [m], shape [group].
            inverse_length: 1 over it [1/m], shape [group].
            inverse_square: 1 over its square [1/m²], shape [group].
            radius: Radius of the cable, and height of a node that lies on the table [m],
                shape [group].
            last_ratio: Length of a segment over that of the last one, which is an attachment's or
                1 [-], shape [group].
            squared_length: Square of each segment's length [m²], shape [group, segment].
            inverse_mass: Inverse mass of each node [1/kg], 0 where held, shape [group, node].
            segment_mass: Mass of a segment [kg], shape [group].
            bending: EI / l^3 [N/m], shape [group].
            grip_cells: Stiffness at a gripper over that of a whole cell [-]: 2 where it clamps the
                cable, less where its pads give, 0 where it is a hinge, shape [group].
            torsion: GJ / l [N·m], shape [group].
            torsion_time: Implicit share of dt, and the time by which twist is damped [s],
                shape [group].
            twist_damping_time: Time by which twist is damped [s], shape [group].
            dashpot_ratio: Time by which bending is damped, over the step [-], shape [group].
            dashpot_yielding: Bend by which the dashpot of a whole cell yields in a step to a moment
                over the segment length (material.py) [m/N], shape [group].
            dashpot_diagonal: Inverse diagonal of the dashpots (material.py) [N/m],
                shape [group, node].
            dashpot_lower1: First lower diagonal of the dashpots [-], shape [group, node + 2].
            dashpot_lower2: Second lower diagonal of the dashpots [-], shape [group, node + 2].
            yield_bend: Elastic bend of a whole cell beyond which the cable yields [m],
                shape [group].
            yield_share: Share of what lies beyond it that stays in the cable after a step [-],
                shape [group].
            sharp_torsion: Most of GJ / l times the square of a binormal that acts on the shape
                (elastic.py) [N·m], shape [group].
            friction: Coulomb coefficient [-], shape [group].
            last_friction: Coulomb coefficient at the last node over it [-], shape [group].
            joint_friction: Coulomb coefficient at the node before over it [-], shape [group].
            rolling_friction: Lever arm of rolling friction over the radius [-], shape [group].
            spinning_friction: Lever arm of spinning friction times mass per length: the impulse on
                either node of a segment per normal impulse on it over its mass [kg], shape [group].
            linear_damping: Rate at which nodes slow down [1/s], shape [group].
            angular_damping: Rate at which spins slow down [1/s], shape [group].
            rotation_viscosity: Exchange of momentum between neighbours that damps the rotation of
                segments, per difference of velocity [kg/s], shape [group].
            lateral_mass: Effective mass of a contact point across the cable, over the mass of its
                node [-], shape [group]; 1/3 for a cylinder that is free to roll.
            drag: Drag of a whole cell across the cable over the square of its speed [kg/m],
                shape [group].
            drag_ratio: Drag along the cable over that across it [-], shape [group].
            friction_ratio: Friction along the cable over that across it [-], shape [group].
            mass_ratio: Mass with which a node lies on the segment before it, over half a segment's
                mass [-], shape [group, node]: 1, and another where an attachment lies.
            near_ratio: Mass with which the node before the last lies on the last segment, over half
                a segment's mass [-], shape [group]: 1, and another for an attachment.
            spin_response: Spin that a segment takes up within a step per velocity that friction
                takes from its nodes across the cable [1/m], shape [group, segment].
            spin_inertia: Moment of inertia of each segment about its axis [kg·m²],
                shape [group, segment].
            spin_pivot: Inverse pivots of the torsion solve (elastic.py) [1/(kg·m²)],
                shape [group, segment].
            filter_diagonal: Inverse diagonal of the bending filter (elastic.py) [1/kg],
                shape [group, node].
            filter_lower1: First lower diagonal of the filter [-], shape [group, node + 2].
            filter_lower2: Second lower diagonal of the filter [-], shape [group, node + 2].
        """

        node_count: int
        endpoint: int
        joint_cells: real
        far_is_held: int
        dt: real
        gravity: real
        half_width: real
        y_min: real
        y_max: real
        segment_length: wp.array(dtype=lane)
        inverse_length: wp.array(dtype=lane)
        inverse_square: wp.array(dtype=lane)
        radius: wp.array(dtype=lane)
        last_ratio: wp.array(dtype=lane)
        squared_length: wp.array2d(dtype=lane)
        inverse_mass: wp.array2d(dtype=lane)
        segment_mass: wp.array(dtype=lane)
        bending: wp.array(dtype=lane)
        grip_cells: wp.array(dtype=lane)
        torsion: wp.array(dtype=lane)
        torsion_time: wp.array(dtype=lane)
        twist_damping_time: wp.array(dtype=lane)
        dashpot_ratio: wp.array(dtype=lane)
        dashpot_yielding: wp.array(dtype=lane)
        dashpot_diagonal: wp.array2d(dtype=lane)
        dashpot_lower1: wp.array2d(dtype=lane)
        dashpot_lower2: wp.array2d(dtype=lane)
        yield_bend: wp.array(dtype=lane)
        yield_share: wp.array(dtype=lane)
        sharp_torsion: wp.array(dtype=lane)
        friction: wp.array(dtype=lane)
        last_friction: wp.array(dtype=lane)
        joint_friction: wp.array(dtype=lane)
        rolling_friction: wp.array(dtype=lane)
        spinning_friction: wp.array(dtype=lane)
        linear_damping: wp.array(dtype=lane)
        angular_damping: wp.array(dtype=lane)
        rotation_viscosity: wp.array(dtype=lane)
        lateral_mass: wp.array(dtype=lane)
        drag: wp.array(dtype=lane)
        drag_ratio: wp.array(dtype=lane)
        friction_ratio: wp.array(dtype=lane)
        mass_ratio: wp.array2d(dtype=lane)
        near_ratio: wp.array(dtype=lane)
        spin_response: wp.array2d(dtype=lane)
        spin_inertia: wp.array2d(dtype=lane)
        spin_pivot: wp.array2d(dtype=lane)
        filter_diagonal: wp.array2d(dtype=lane)
        filter_lower1: wp.array2d(dtype=lane)
        filter_lower2: wp.array2d(dtype=lane)

    @wp.struct
    class Path:
        """Motion of a held end: quintic polynomials, the pieces that apply now, and the pose.

        A piece has six coefficients for each of x, y, z [m], yaw, pitch and roll [rad].

        Attributes:
            knots: Times at which pieces begin and end [s], shape [row, piece + 1].
            coefficients: Coefficients of all pieces, lowest power first, shape [row, piece, 36].
            piece: Index of the current piece, shape [group, lane].
            piece_start: Time at which the current piece began [s], shape [group].
            piece_duration: Duration of the current piece [s], shape [group].
            current: Coefficients of the current piece, shape [group, 36].
            next_knot: Time at which the first lane leaves its piece [s], shape [group].
            position: Position at the end of the step [m], shape [group].
            direction: Unit direction of the cable at the start of the step, shape [group].
            next_direction: Unit direction of the cable at the end of the step, shape [group].
            direction_rate: Rate of change of the direction in the previous step [1/s],
                shape [group].
            spin: Spin of the gripper about the direction in this step [rad/s], shape [group].
            previous_spin: Spin of the gripper in the previous step [rad/s], shape [group].
            roll: Roll at the end of the step [rad], shape [group].
        """

        knots: wp.array2d(dtype=real)
        coefficients: wp.array3d(dtype=real)
        piece: wp.array2d(dtype=int)
        piece_start: wp.array(dtype=lane)
        piece_duration: wp.array(dtype=lane)
        current: wp.array2d(dtype=lane)
        next_knot: wp.array(dtype=real)
        position: wp.array(dtype=vec3)
        direction: wp.array(dtype=vec3)
        next_direction: wp.array(dtype=vec3)
        direction_rate: wp.array(dtype=vec3)
        spin: wp.array(dtype=lane)
        previous_spin: wp.array(dtype=lane)
        roll: wp.array(dtype=lane)

    @wp.struct
    class State:
        """State of the cables, and what warm-starts the next step.

        Attributes:
            position: Nodes [m], shape [group, node].
            velocity: Velocities of the nodes, half a step earlier [m/s], shape [group, node].
            twist: Twist at each node, between the segments before and after it [rad],
                shape [group, node].
            spin: Spin of each segment about its tangent [rad/s], shape [group, segment].
            turn: Turn of each segment by which the torque leads its twist after the last change
                of spin (elastic.py) [rad], shape [group, segment].
            binormal: Curvature binormal of each node at the start of the last step [-],
                shape [group, node].
            tension: dt^2 times tension over length of each segment in the last step [kg],
                shape [group, segment].
            lateral_loss: Velocity across the cable that friction took from each node in the last
                step [m/s], shape [group, node].
            axial_impulse: Angular impulse of the table about each segment's axis in the last step,
                over m r / 2 [m/s], shape [group, segment].
            couple_impulse: Impulse on either node of a segment with which spinning friction holds
                it against turning about the vertical [N·s], shape [group, segment].
            rest_bend: Bend at which each node feels no moment [m], shape [group, node], or [1, 1]
                where nothing is remembered.
            strain: Bend that the dashpot at each node has not followed yet [m], same shape.
            work: Work that the grippers have done since the last check [J], shape [group].
            energy: Energy at the last check [J], shape [group].
            growth: Energy gained without work since it was least [J], shape [group].
            energy_scale: Greatest kinetic and elastic energy so far [J], shape [group].
            active: 1, or 0 once the world is at rest for good or broken [-], shape [group].
            rest_time: Time for which the world has been slow [s], shape [group].
        """

        position: wp.array2d(dtype=vec3)
        velocity: wp.array2d(dtype=vec3)
        twist: wp.array2d(dtype=lane)
        spin: wp.array2d(dtype=lane)
        turn: wp.array2d(dtype=lane)
        binormal: wp.array2d(dtype=vec3)
        tension: wp.array2d(dtype=lane)
        lateral_loss: wp.array2d(dtype=lane)
        axial_impulse: wp.array2d(dtype=lane)
        couple_impulse: wp.array2d(dtype=lane)
        rest_bend: wp.array2d(dtype=vec3)
        strain: wp.array2d(dtype=vec3)
        work: wp.array(dtype=lane)
        energy: wp.array(dtype=lane)
        growth: wp.array(dtype=lane)
        energy_scale: wp.array(dtype=lane)
        active: wp.array(dtype=lane)
        rest_time: wp.array(dtype=lane)

    @wp.struct
    class Scratch:
        """Memory within a step.

        Some attributes share an array with those before them, whose values are used up by then.

        Attributes:
            bending_moment: Bending moment at each node, over the segment length [N],
                shape [group, node + 2].
            acceleration: Acceleration of each node by elasticity [m/s²], in place of
                `bending_moment`.
            elimination: Upper diagonal [-] and right side [kg] of the eliminated system for the
                tensions, in place of `acceleration`, shape [group, segment].
            dashpot: Right side of the eliminated dashpots (material.py) [m], shape [group, node].
            memory_moment: Bending moment of what the material remembers at each node, over the
                segment length [N], in place of `dashpot`.
            memory_torque: Torque of what the material remembers on each segment [N·m],
                shape [group, segment].
            memory_inertia: What a change of that torque adds to the inertia of each segment about
                its axis [kg·m²], shape [group, segment].
            spin_pivot: Inverse pivots of the torsion solve with that inertia [1/(kg·m²)],
                shape [group, segment].
            force: Elastic force on each node, halfway through the bending filter [N], in place of
                `memory_moment`, shape [group, node].
            velocity: Predicted velocity of each node without tensions [m/s], in place of `force`.
            torque: Right side of the eliminated torsion system [N·m], shape [group, segment].
            spin: Predicted spin of each segment [rad/s], in place of `torque`.
            lead: Part of each node's torque that the dashpot of its twist makes, over GJ / l [rad],
                shape [group, node].
            normal_impulse: Normal impulse of the table, per mass of each node [m/s], in place of
                `lead`.
            load: Sum of the normal impulses on a segment from its nodes, over half its mass [m/s],
                shape [group, segment].
        """

        bending_moment: wp.array2d(dtype=vec3)
        acceleration: wp.array2d(dtype=vec3)
        elimination: wp.array2d(dtype=vec3)
        dashpot: wp.array2d(dtype=vec3)
        memory_moment: wp.array2d(dtype=vec3)
        memory_torque: wp.array2d(dtype=lane)
        memory_inertia: wp.array2d(dtype=lane)
        spin_pivot: wp.array2d(dtype=lane)
        force: wp.array2d(dtype=vec3)
        velocity: wp.array2d(dtype=vec3)
        torque: wp.array2d(dtype=lane)
        spin: wp.array2d(dtype=lane)
        lead: wp.array2d(dtype=lane)
        normal_impulse: wp.array2d(dtype=lane)
        load: wp.array2d(dtype=lane)

    @wp.struct
    class Samples:
        """Recorded quantities and their interval.

        Attributes:
            steps_per_sample: Steps between two samples.
            record_nodes: 1 to record whole shapes, else 0.
            endpoint: Free end at each sample [m], shape [group, sample].
            nodes: Shapes at each sample [m], shape [group, sample, node].
            record_forces: 1 to record forces, else 0.
            tension: Axial force in each segment [N], shape [group, sample, segment].
            grip_force: Force of the cable on the grip and on the far end [N], without the half
                segments that these hold, shape [group, sample, 2].
        """

        steps_per_sample: int
        record_nodes: int
        endpoint: wp.array2d(dtype=vec3)
        nodes: wp.array3d(dtype=vec3)
        record_forces: int
        tension: wp.array3d(dtype=lane)
        grip_force: wp.array3d(dtype=vec3)

    return SimpleNamespace(Model=Model, Path=Path, State=State, Scratch=Scratch, Samples=Samples)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Features:
    """Choices that are made when a kernel is compiled, so that what is off costs nothing.

    A kernel takes ten seconds to compile, so there are few: one that remembers bends has the
    surface, too, which costs it 2 %.

    Attributes:
        table: True where the cable meets a table.
        remembers: True for a material that remembers bends.
        surface: True where the air resists with the square of the speed, and friction differs along
            and across the cable.
    """

    table: bool = True
    remembers: bool = False
    surface: bool = False
