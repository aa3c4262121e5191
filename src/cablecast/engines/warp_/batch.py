"""A batch in memory: worlds packed into lanes, and unpacked again."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from cablecast.engines.base import CableForces, CableRows, CableState, Rollout
from cablecast.engines.warp_.constants import JOINT_CELLS, EndSegment, model_constants
from cablecast.engines.warp_.energy import UNKNOWN_ENERGY
from cablecast.motion.grip_path import GripPath
from cablecast.workspace import Workspace

_ENDLESS = 1e6
"""Distance of the edges of a table without edges [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Layout:
    """Memory layout of a batch.

    Attributes:
        build: Kernel, structs and types of a precision and a lane count (rollout.py).
        device: Warp device.
        real: NumPy type of a number.
        lane_count: Number of worlds that a thread owns.
        interleaved: Whether neighbouring groups lie side by side. On CUDA they do, so that the
            threads of a warp read one stretch of memory; on a CPU each group has its own.
    """

    build: SimpleNamespace
    device: Any
    real: type
    lane_count: int
    interleaved: bool


class Batch:
    """Packs a batch into lanes, and unpacks it again.

    Worlds are sorted by the duration of their motions, the longest first. Those of a group then
    come to rest at about the same time, after which the group costs nothing, and threads finish
    together.

    Args:
        layout: Memory layout.
        segment_count: Number of segments.
        world_count: Number of worlds.
        duration: Duration of the motions [s], one or one per world.
        end: Attachment beyond the cable's end, if there is one: a segment more.
    """

    def __init__(
        self,
        layout: Layout,
        segment_count: int,
        world_count: int,
        duration: ArrayLike,
        end: EndSegment | None = None,
    ):
        self.layout = layout
        self.build = layout.build
        self.world_count = world_count
        self.group_count = -(-world_count // layout.lane_count)
        self.cable_segment_count = segment_count
        self.end = end
        self.segment_count = segment_count + (end is not None)
        self.node_count = self.segment_count + 1
        longest_first = -np.broadcast_to(np.asarray(duration), world_count)
        self.order = np.argsort(longest_first, kind="stable")

    def sorted(self, values: NDArray) -> NDArray:
        """Return rows of values in the order of the batch; a single row serves all worlds."""
        return values if len(values) == 1 else values[self.order]

    def to_lanes(self, values: NDArray) -> NDArray:
        """Return rows [world or 1, n] as lanes [group, n, lane]; the last world pads."""
        lane_count = self.layout.lane_count
        index = np.minimum(np.arange(self.group_count * lane_count), len(values) - 1)
        grouped = self.sorted(values)[index].reshape(self.group_count, lane_count, -1)
        return np.ascontiguousarray(np.swapaxes(grouped, 1, 2), dtype=self.layout.real)

    def to_worlds(self, array: wp.array) -> NDArray[np.float64]:
        """Return lanes [group, ..., lane] as rows [world, ...]."""
        values = np.moveaxis(array.numpy().astype(np.float64), -1, 1)
        values = values.reshape(self.group_count * self.layout.lane_count, *values.shape[2:])
        worlds = np.empty_like(values[: self.world_count])
        worlds[self.order] = values[: self.world_count]
        return worlds

    def array(self, values: NDArray, dtype) -> wp.array:
        """Return a device array of lanes or of vectors of lanes, [group, ...]."""
        axes = values.ndim - (2 if dtype is self.build.vec3 else 1)
        swapped = self.layout.interleaved and axes > 1
        stored = np.ascontiguousarray(np.moveaxis(values, 0, axes - 1) if swapped else values)
        # With the shape: Warp cannot tell one group with one lane from one with none.
        array = wp.array(stored, dtype, shape=stored.shape[:axes], device=self.layout.device)
        return array.transpose((axes - 1, *range(axes - 1))) if swapped else array

    def zeros(self, *shape: int, dtype) -> wp.array:
        """Return zeros in the layout of `array`."""
        device = self.layout.device
        if self.layout.interleaved and len(shape) > 1:
            stored = wp.zeros((*shape[1:], shape[0]), dtype=dtype, device=device)
            return stored.transpose((len(shape) - 1, *range(len(shape) - 1)))
        return wp.zeros(shape, dtype=dtype, device=device)

    def model(
        self,
        cables: CableRows,
        dt: float,
        gravity: float,
        edges: Workspace | None,
        far_is_held: bool,
        hinged: bool,
    ):
        """Pack the constants: step [s] and acceleration of free fall [m/s²] among them."""
        model = self.build.Model()
        model.node_count = self.node_count
        model.far_is_held = int(far_is_held)
        model.dt = dt
        model.endpoint = self.cable_segment_count
        model.joint_cells = 1.0 if self.end is None else JOINT_CELLS
        model.gravity = gravity
        model.half_width = _ENDLESS if edges is None else edges.half_width
        model.y_min = -_ENDLESS if edges is None else edges.y_min
        model.y_max = _ENDLESS if edges is None else edges.y_max
        constants = model_constants(
            cables, self.cable_segment_count, dt, far_is_held, self.end, hinged
        )
        length = constants["segment_length"].astype(self.layout.real)
        constants |= {"inverse_length": 1 / length, "inverse_square": 1 / (length * length)}
        for name, values in constants.items():
            lanes = self.to_lanes(values.reshape(len(values), -1))
            packed = lanes[:, 0] if values.ndim == 1 else lanes
            setattr(model, name, self.array(packed, self.build.lane))
        return model

    def path(self, grip_path: GripPath):
        """Pack a path, with memory for the pose that it has in the step."""
        device, real = self.layout.device, self.build.real
        row_count, piece_count = grip_path.coefficients.shape[:2]
        path = self.build.Path()
        knots = self.sorted(grip_path.knots)
        path.knots = wp.array(knots.astype(self.layout.real), dtype=real, device=device)
        coefficients = np.zeros((row_count, piece_count, 36), dtype=self.layout.real)
        # Row by row: there may be gigabytes of them.
        for row, source in enumerate(self.order if row_count > 1 else [0]):
            coefficients[row, :, :30] = grip_path.coefficients[source].reshape(piece_count, -1)
            if grip_path.roll is not None:
                coefficients[row, :, 30:] = grip_path.roll[source]
        path.coefficients = wp.array(coefficients, dtype=real, device=device)
        path.piece = wp.zeros((self.group_count, self.layout.lane_count), dtype=int, device=device)
        for name in ("piece_start", "piece_duration", "spin", "previous_spin", "roll"):
            setattr(path, name, self.zeros(self.group_count, dtype=self.build.lane))
        for name in ("position", "direction", "next_direction", "direction_rate"):
            setattr(path, name, self.zeros(self.group_count, dtype=self.build.vec3))
        path.current = self.zeros(self.group_count, 36, dtype=self.build.lane)
        path.next_knot = wp.zeros(self.group_count, dtype=real, device=device)
        return path

    def state(self, initial: CableState, rest_bend: NDArray | None):
        """Pack the initial state; nothing is held by the table yet.

        Nodes feel no moment at the rest bend [m], shape [world, node, 3], which is None where the
        material remembers nothing.
        """
        build, shape = self.build, (self.group_count, self.node_count)
        state = build.State()
        for name, values in (("position", initial.positions), ("velocity", initial.velocities)):
            lanes = self.to_lanes(values.reshape(len(values), -1))
            lanes = lanes.reshape(*shape, 3, self.layout.lane_count)
            setattr(state, name, self.array(lanes, build.vec3))
        twist = np.diff(initial.roll, axis=1, prepend=0.0, append=initial.far_roll[:, None])
        for name, values in (("twist", twist), ("spin", initial.roll_rate)):
            setattr(state, name, self.array(self.to_lanes(values), build.lane))
        state.binormal = self.zeros(*shape, dtype=build.vec3)
        if rest_bend is None:
            rest_bend = np.zeros((1, 1, 3))
        lanes = self.to_lanes(rest_bend.reshape(len(rest_bend), -1))
        lanes = lanes.reshape(self.group_count, rest_bend.shape[1], 3, self.layout.lane_count)
        state.rest_bend = self.array(lanes, build.vec3)
        state.strain = self.zeros(*lanes.shape[:2], dtype=build.vec3)
        state.lateral_loss = self.zeros(*shape, dtype=build.lane)
        for name in ("turn", "tension", "axial_impulse", "couple_impulse"):
            zeros = self.zeros(self.group_count, self.segment_count, dtype=build.lane)
            setattr(state, name, zeros)
        ones = np.ones((self.group_count, self.layout.lane_count), dtype=self.layout.real)
        state.active = self.array(ones, build.lane)
        state.work = self.zeros(self.group_count, dtype=build.lane)
        state.energy = self.array(ones * UNKNOWN_ENERGY, build.lane)
        for name in ("growth", "energy_scale"):
            setattr(state, name, self.zeros(self.group_count, dtype=build.lane))
        state.rest_time = self.zeros(self.group_count, dtype=build.lane)
        return state

    def scratch(self, keep_moments: bool):
        """Make the memory within a step; names that share an array follow each other in use.

        Bending moments outlast the step where they are kept.
        """
        groups, nodes, segments = self.group_count, self.node_count, self.segment_count
        lane, vec3 = self.build.lane, self.build.vec3
        scratch = self.build.Scratch()
        scratch.bending_moment = self.zeros(groups, nodes + 2, dtype=vec3)
        scratch.acceleration = scratch.bending_moment
        if keep_moments:
            scratch.acceleration = self.zeros(groups, nodes + 2, dtype=vec3)
        scratch.elimination = scratch.acceleration
        scratch.force = self.zeros(groups, nodes, dtype=vec3)
        scratch.velocity = scratch.force
        scratch.dashpot = scratch.force
        scratch.memory_moment = scratch.force
        for name in ("memory_torque", "memory_inertia", "spin_pivot"):
            setattr(scratch, name, self.zeros(groups, segments, dtype=lane))
        scratch.torque = self.zeros(groups, segments, dtype=lane)
        scratch.spin = scratch.torque
        scratch.lead = self.zeros(groups, nodes, dtype=lane)
        scratch.normal_impulse = scratch.lead
        scratch.load = self.zeros(groups, segments, dtype=lane)
        return scratch

    def samples(
        self, sample_count: int, steps_per_sample: int, record_nodes: bool, record_forces: bool
    ):
        """Make the memory for samples."""
        samples = self.build.Samples()
        samples.steps_per_sample = steps_per_sample
        samples.record_nodes = int(record_nodes)
        vec3 = self.build.vec3
        samples.endpoint = self.zeros(self.group_count, sample_count, dtype=vec3)
        node_shape = (sample_count, self.node_count) if record_nodes else (1, 1)
        samples.nodes = self.zeros(self.group_count if record_nodes else 1, *node_shape, dtype=vec3)
        samples.record_forces = int(record_forces)
        groups, count = (self.group_count, sample_count) if record_forces else (1, 1)
        samples.tension = self.zeros(groups, count, self.segment_count, dtype=self.build.lane)
        samples.grip_force = self.zeros(groups, count, 2, dtype=vec3)
        return samples

    def read(self, state, samples, sample_dt: float, far_is_held: bool) -> Rollout:
        """Unpack what a rollout left, with the time between samples [s]."""
        endpoint = self.to_worlds(samples.endpoint)
        # What lies beyond the cable's end is not told.
        count = self.cable_segment_count
        positions = self.to_worlds(state.position)[:, : count + 1]
        rolls = np.cumsum(self.to_worlds(state.twist), axis=1)
        final = CableState(
            positions=positions,
            velocities=self.to_worlds(state.velocity)[:, : count + 1],
            roll=rolls[:, :count],
            roll_rate=self.to_worlds(state.spin)[:, :count],
            far_roll=rolls[:, -1] if far_is_held else np.zeros(1),
        )
        finite = np.isfinite(endpoint).all(axis=(1, 2))
        finite = np.asarray(finite & np.isfinite(positions).all(axis=(1, 2)))
        # Once a world is broken, no later sample of it may look like a position.
        broken = np.logical_or.accumulate(~np.isfinite(endpoint).all(axis=2), axis=1)
        endpoint[broken] = np.nan
        nodes = None
        if samples.record_nodes:
            nodes = self.to_worlds(samples.nodes)[:, :, : count + 1]
            nodes[broken] = np.nan
        forces = None
        if samples.record_forces:
            broken[:, 0] = True
            tension = self.to_worlds(samples.tension)[:, :, :count]
            grips = self.to_worlds(samples.grip_force)
            tension[broken], grips[broken] = np.nan, np.nan
            far = grips[:, :, 1] if far_is_held else None
            forces = CableForces(tension=tension, grip=grips[:, :, 0], far_grip=far)
        return Rollout(
            times=np.arange(endpoint.shape[1]) * sample_dt,
            endpoint_xyz=endpoint,
            final_state=final,
            finite=finite,
            nodes=nodes,
            forces=forces,
        )
