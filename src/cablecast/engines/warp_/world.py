"""The arrays of a batch: what a world is made of, its state, and its scratch memory.

Worlds are grouped by lanes: world w is lane w % lane_count of group w // lane_count. Arrays are
indexed [group, node] (or [group, edge]); edge e joins nodes e and e + 1.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.lanes import lane_types


@functools.cache
def world_structs(precision: str, lane_count: int) -> SimpleNamespace:
    """The Warp structs of one build."""
    types = lane_types(precision, lane_count)
    real, lane, vec3 = types.real, types.lane, types.vec3

    @wp.struct
    class Model:
        """Constants of a batch; lane values differ between worlds."""

        node_count: int
        far_is_held: int
        dt: real
        segment_length: real
        contact_height: real
        gravity: real
        inverse_mass: wp.array2d(dtype=lane)  # 0 where held
        bending: wp.array(dtype=lane)  # EI / l^3 [N/m]
        friction: wp.array(dtype=lane)
        linear_damping: wp.array(dtype=lane)
        angular_damping: wp.array(dtype=lane)
        rotation_viscosity: wp.array(dtype=lane)  # [kg/s]
        torsion: wp.array(dtype=lane)  # GJ / l [N·m]
        shape_torsion: wp.array(dtype=lane)  # the same, as far as it acts on the shape [N·m]
        spin_pivot: wp.array2d(dtype=lane)  # of the torsion solve (twist.py) [1/(kg·m²)]
        roll_share: wp.array(dtype=lane)
        # Spin per velocity that a node loses sideways [1/m], of each segment and of the last.
        spin_gain: wp.array(dtype=lane)
        end_spin_gain: wp.array(dtype=lane)
        end_weight: wp.array(dtype=lane)  # mass of the last node in halves of a segment [-]
        rolling: wp.array(dtype=lane)  # lever of rolling friction over the radius [-]
        spinning: wp.array(dtype=lane)  # couple's impulse per normal impulse per mass [kg]
        segment_mass: wp.array(dtype=lane)
        # Factors of the filter of the bending force (bending.py).
        filter_diagonal: wp.array2d(dtype=lane)
        filter_lower1: wp.array2d(dtype=lane)
        filter_lower2: wp.array2d(dtype=lane)

    @wp.struct
    class Path:
        """Motion of a held end: pieces of quintic polynomials, and those that apply now."""

        knots: wp.array2d(dtype=real)  # [row, piece + 1]
        coefficients: wp.array3d(dtype=real)  # [row, piece, 30]
        piece: wp.array2d(dtype=int)  # [group, lane]
        piece_start: wp.array(dtype=lane)
        piece_duration: wp.array(dtype=lane)
        current: wp.array2d(dtype=lane)  # [group, 30]
        next_knot: wp.array(dtype=real)  # first over the lanes
        # At the end of this step: position; at its start: direction, how fast that turned in the
        # step before [1/s], and the spin of the gripper about it in this step and before [rad/s].
        position: wp.array(dtype=vec3)
        direction: wp.array(dtype=vec3)
        turn: wp.array(dtype=vec3)
        spin: wp.array(dtype=lane)
        spin_before: wp.array(dtype=lane)
        next_direction: wp.array(dtype=vec3)
        yaw: wp.array(dtype=lane)

    @wp.struct
    class State:
        """What moves."""

        position: wp.array2d(dtype=vec3)
        velocity: wp.array2d(dtype=vec3)
        # Force along an edge, as dt^2 times tension over length [kg]; the table feels that of the
        # step before (contact.py).
        tension: wp.array2d(dtype=lane)
        # What the table did in the step before, so that what it holds stays held: the impulse on
        # either node of an edge against turning on the spot [N·s], the torque's impulse about its
        # axis over m r / 2 [m/s], and the velocity that a node lost sideways [m/s].
        table_couple: wp.array2d(dtype=lane)
        table_torque: wp.array2d(dtype=lane)
        table_loss: wp.array2d(dtype=lane)
        twist: wp.array2d(dtype=lane)  # of node i, between edges i - 1 and i [rad]
        spin: wp.array2d(dtype=lane)  # of each edge [rad/s]
        binormal: wp.array2d(dtype=vec3)  # of each node, at the start of the last step
        active: wp.array(dtype=lane)  # 1, or 0 once at rest for good
        rest_time: wp.array(dtype=lane)

    @wp.struct
    class Scratch:
        """Memory within a step."""

        # Gradient of the bending energy at each node [N]; then the acceleration by elasticity;
        # then upper diagonal and right side of the solve for tensions.
        moment: wp.array2d(dtype=vec3)
        # Elastic force, halfway through the filter [N]; then the velocity before lengths are held.
        force: wp.array2d(dtype=vec3)
        spin: wp.array2d(dtype=lane)

    @wp.struct
    class Samples:
        """What is recorded, and how often."""

        steps_per_sample: int
        record_nodes: int
        endpoint: wp.array2d(dtype=vec3)  # [group, sample]
        nodes: wp.array3d(dtype=vec3)  # [group, sample, node]

    return SimpleNamespace(Model=Model, Path=Path, State=State, Scratch=Scratch, Samples=Samples)
