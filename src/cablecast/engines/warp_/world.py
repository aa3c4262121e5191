"""The arrays of a batch: what a world is made of, its state, and its scratch memory.

Worlds are grouped by lanes: world w is lane w % lane_count of group w // lane_count. Arrays are
indexed [group, node] (or [group, edge]); edge e joins nodes e and e + 1.
"""

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
        dt: real  # type: ignore[valid-type]
        segment_length: real  # type: ignore[valid-type]
        contact_height: real  # type: ignore[valid-type]
        gravity: real  # type: ignore[valid-type]
        inverse_mass: wp.array2d(dtype=lane)  # type: ignore[valid-type]  # 0 where held
        bending: wp.array(dtype=lane)  # type: ignore[valid-type]  # EI / l^3 [N/m]
        friction: wp.array(dtype=lane)  # type: ignore[valid-type]
        linear_damping: wp.array(dtype=lane)  # type: ignore[valid-type]
        rotation_viscosity: wp.array(dtype=lane)  # type: ignore[valid-type]  # [kg/s]
        # Factors of the filter of the bending force (bending.py).
        filter_diagonal: wp.array2d(dtype=lane)  # type: ignore[valid-type]
        filter_lower1: wp.array2d(dtype=lane)  # type: ignore[valid-type]
        filter_lower2: wp.array2d(dtype=lane)  # type: ignore[valid-type]

    @wp.struct
    class Path:
        """Motion of a held end: pieces of quintic polynomials, and those that apply now."""

        knots: wp.array2d(dtype=real)  # type: ignore[valid-type]  # [row, piece + 1]
        coefficients: wp.array3d(dtype=real)  # type: ignore[valid-type]  # [row, piece, 30]
        piece: wp.array2d(dtype=int)  # [group, lane]
        piece_start: wp.array(dtype=lane)  # type: ignore[valid-type]
        piece_duration: wp.array(dtype=lane)  # type: ignore[valid-type]
        current: wp.array2d(dtype=lane)  # type: ignore[valid-type]  # [group, 30]
        next_knot: wp.array(dtype=real)  # type: ignore[valid-type]  # first over the lanes

    @wp.struct
    class State:
        """What moves."""

        position: wp.array2d(dtype=vec3)  # type: ignore[valid-type]
        velocity: wp.array2d(dtype=vec3)  # type: ignore[valid-type]
        # Force along an edge, as dt^2 times tension over length [kg]; the last step's value starts
        # the next step's solve.
        tension: wp.array2d(dtype=lane)  # type: ignore[valid-type]
        active: wp.array(dtype=lane)  # type: ignore[valid-type]  # 1, or 0 once at rest for good
        rest_time: wp.array(dtype=lane)  # type: ignore[valid-type]

    @wp.struct
    class Scratch:
        """Memory within a step."""

        bending: wp.array2d(dtype=vec3)  # type: ignore[valid-type]
        predicted: wp.array2d(dtype=vec3)  # type: ignore[valid-type]
        upper: wp.array2d(dtype=lane)  # type: ignore[valid-type]
        rhs: wp.array2d(dtype=lane)  # type: ignore[valid-type]

    @wp.struct
    class Samples:
        """What is recorded, and how often."""

        steps_per_sample: int
        record_nodes: int
        endpoint: wp.array2d(dtype=vec3)  # type: ignore[valid-type]  # [group, sample]
        nodes: wp.array3d(dtype=vec3)  # type: ignore[valid-type]  # [group, sample, node]

    return SimpleNamespace(Model=Model, Path=Path, State=State, Scratch=Scratch, Samples=Samples)
