"""EngineWarp: thousands of cables at once, on all cores of a CPU or on a CUDA device."""

import concurrent.futures
import functools
import os

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable, CableParams
from cablecast.engines.base import (
    GRAVITY,
    REFERENCE_SEGMENT_COUNT,
    CableState,
    Rollout,
    plan_rollout,
)
from cablecast.engines.warp_.bending import filter_factors
from cablecast.engines.warp_.lanes import LANE_COUNT_CPU, LANE_COUNT_CUDA
from cablecast.engines.warp_.step import rollout_kernel
from cablecast.engines.warp_.twist import SHAPE_TORSION, spin_pivots
from cablecast.errors import InputError
from cablecast.machine import core_count
from cablecast.motion.grip_path import GripPath

DEFAULT_SEGMENT_COUNT = 50
DEFAULT_DT = 5e-4
"""The coarsest resolution whose landings, on all three presets, are within 1 % of cable length of
converged ones in the median and within 5 % in nine of ten casts: `python -m benchmarks
convergence`, docs/engine.md."""

REST_DURATION = 0.05

MOST_VISCOSITY = 0.25
"""Share of a difference of velocity that damped rotation may exchange between neighbours in a step:
more would let short segments ring. The default resolution stays far below it."""

MODEL_VERSION = 4
"""Counts the changes that move landings by more than rounding does. It is among the settings of a
dataset, so that casts of one model are never continued with those of another."""


class EngineWarp:
    """The fast engine: an inextensible elastic rod with Coulomb friction, all worlds in one launch.

    docs/engine.md explains the model. The result of a world depends neither on its neighbours nor
    on the number of threads.

    Args:
        segment_count: Number of segments, at least 2.
        dt: Step [s].
        device: "cpu" or a Warp CUDA device such as "cuda".
        precision: "single" or "double".
        thread_count: CPU threads; by default all cores that this process may use.
        rest_speed: A world whose motion is over, whose free end lies on the table, and the last
            quarter of whose cable has not moved along it faster than this for 50 ms is at rest and
            no longer computed [m/s]. Friction stops such a node within a few steps; the rest, of
            which some hangs from the gripper, may swing on at up to a hundred times that speed,
            which moves the free end by less than 0.03 mm. 0 computes every world to the end.
        gravity: Acceleration of free fall [m/s²].

    Raises:
        InputError: A count or step out of bounds, or a device that does not exist.
    """

    def __init__(
        self,
        segment_count: int = DEFAULT_SEGMENT_COUNT,
        dt: float = DEFAULT_DT,
        device: str = "cpu",
        precision: str = "single",
        thread_count: int | None = None,
        rest_speed: float = 5e-4,
        gravity: float = GRAVITY,
    ):
        if not 2 <= segment_count <= 1000:
            raise InputError(f"segment_count = {segment_count} is outside [2, 1000]")
        if not 1e-7 <= dt <= 1e-2:
            raise InputError(f"dt = {dt} s is outside [1e-7, 1e-2]")
        if precision not in LANE_COUNT_CPU:
            raise InputError(f"precision {precision!r}: one of {', '.join(LANE_COUNT_CPU)}")
        self.model_version = MODEL_VERSION
        self.segment_count = segment_count
        self.dt = dt
        self.precision = precision
        self.rest_speed = rest_speed
        self.gravity = gravity
        self.device = _find_device(device)
        self.thread_count = thread_count or core_count()
        if self.device.is_cuda:
            self._arrange(LANE_COUNT_CUDA, interleaved=True)
        else:
            self._arrange(LANE_COUNT_CPU[precision], interleaved=False)
        self._real = np.float32 if precision == "single" else np.float64

    def _arrange(self, lane_count: int, interleaved: bool) -> None:
        """Choose how many worlds a thread owns, and whether neighbouring groups lie side by side.

        On CUDA they do, so that the threads of a warp read one stretch of memory; on a CPU each
        group has its own.
        """
        self._lane_count = lane_count
        self._interleaved = interleaved
        self._build = rollout_kernel(self.precision, lane_count)

    def rollout(
        self,
        cable: Cable,
        params: CableParams,
        grip_path: GripPath,
        initial_state: CableState | None = None,
        duration: float | None = None,
        sample_dt: float = 0.1,
        *,
        far_path: GripPath | None = None,
        record_nodes: bool = False,
    ) -> Rollout:
        """Simulate a batch; see `Engine.rollout`."""
        plan = plan_rollout(
            self, cable, params, grip_path, initial_state, duration, sample_dt, far_path
        )
        batch = _Batch(self, plan.world_count, grip_path.duration)
        model = batch.model(cable, params, held=far_path is not None)
        path = batch.path(grip_path)
        far = batch.path(far_path if far_path is not None else _NO_PATH)
        state = batch.state(plan.initial_state)
        samples = batch.samples(plan.sample_count, plan.steps_per_sample, record_nodes)
        motion_end = batch.to_lanes(np.asarray(grip_path.duration)[:, None])[:, 0]
        if far_path is not None:
            motion_end = np.maximum(
                motion_end, batch.to_lanes(np.asarray(far_path.duration)[:, None])[:, 0]
            )
        rest = self.rest_speed
        inputs = [
            plan.sample_count,
            rest,
            REST_DURATION if rest > 0 else np.inf,
            batch.array(motion_end, self._build.lane),
            model,
            path,
            far,
            state,
            batch.scratch(),
            samples,
        ]
        self._launch(batch.group_count, inputs)
        return batch.read(state, samples, plan.steps_per_sample * self.dt)

    def _launch(self, group_count: int, inputs: list) -> None:
        kernel = self._build.kernel
        if self.device.is_cuda:
            wp.launch(kernel, dim=group_count, inputs=[0, *inputs], device=self.device)
            wp.synchronize_device(self.device)
            return
        # Warp runs a CPU launch serially but releases the interpreter lock, so that threads with
        # a share of the groups each use all cores. Shares are small, for an even finish.
        wp.launch(kernel, dim=0, inputs=[0, *inputs], device=self.device)
        share = max(1, -(-group_count // (8 * self.thread_count)))
        starts = range(0, group_count, share)

        def run(start: int) -> None:
            dim = min(share, group_count - start)
            wp.launch(kernel, dim=dim, inputs=[start, *inputs], device=self.device)

        if self.thread_count == 1 or len(starts) == 1:
            for start in starts:
                run(start)
            return
        with concurrent.futures.ThreadPoolExecutor(self.thread_count) as pool:
            for done in [pool.submit(run, start) for start in starts]:
                done.result()


_NO_PATH = GripPath.hold(np.zeros(5), 0.0)


@functools.cache
def _start_warp() -> None:
    """Start Warp without its list of devices, and without its warning where there is no GPU.

    The warning goes straight to the process's error stream, at any log level; whoever asks for a
    CUDA device that is not there gets an error of our own.
    """
    wp.config.log_level = wp.LOG_ERROR
    saved, silent = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(silent, 2)
        wp.init()
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(silent)


def _find_device(name: str):
    _start_warp()
    known = ", ".join(str(device) for device in wp.get_devices())
    # Asking Warp for a CUDA device where there is none prints errors of the driver.
    if name.startswith("cuda") and not wp.get_cuda_devices():
        raise InputError(f"device {name!r} is not available here: one of {known}")
    try:
        return wp.get_device(name)
    except Exception as error:
        raise InputError(f"device {name!r} is not available here: one of {known}") from error


class _Batch:
    """Packs a batch into lanes, and unpacks it again.

    Worlds are sorted by how long they are moved, the longest first: those of a group then come to
    rest at about the same time, after which the group costs nothing, and threads finish together.
    """

    def __init__(self, engine: EngineWarp, world_count: int, duration: ArrayLike):
        self.engine = engine
        self.build = engine._build
        self.real = engine._real
        self.lane_count = engine._lane_count
        self.world_count = world_count
        self.group_count = -(-world_count // self.lane_count)
        self.node_count = engine.segment_count + 1
        longest_first = -np.broadcast_to(np.asarray(duration), world_count)
        self.order = np.argsort(longest_first, kind="stable")

    def sorted(self, values: NDArray) -> NDArray:
        """Rows of values in the order of the batch; a single row serves all worlds."""
        return values if len(values) == 1 else values[self.order]

    def to_lanes(self, values: NDArray) -> NDArray:
        """Rows of values to lanes: [world or 1, n] to [group, n, lane]; the last world pads."""
        index = np.minimum(np.arange(self.group_count * self.lane_count), len(values) - 1)
        grouped = self.sorted(values)[index].reshape(self.group_count, self.lane_count, -1)
        return np.ascontiguousarray(np.swapaxes(grouped, 1, 2), dtype=self.real)

    def array(self, values: NDArray, dtype) -> wp.array:
        """A device array of lanes, [group, ...]."""
        values = np.ascontiguousarray(values)
        axes = values.ndim - (2 if dtype is self.build.vec3 else 1)
        if self.engine._interleaved and axes > 1:
            order = (*range(1, axes), 0)
            turned = np.moveaxis(values, 0, axes - 1)
            stored = wp.array(np.ascontiguousarray(turned), dtype=dtype, device=self.engine.device)
            back = tuple(int(i) for i in np.argsort(order))
            return stored.transpose(back)
        return wp.array(values, dtype=dtype, device=self.engine.device)

    def empty(self, *shape: int, dtype) -> wp.array:
        """Uninitialised memory in the layout of `array`."""
        if self.engine._interleaved and len(shape) > 1:
            order = (*range(1, len(shape)), 0)
            stored = wp.zeros((*shape[1:], shape[0]), dtype=dtype, device=self.engine.device)
            return stored.transpose(tuple(int(i) for i in np.argsort(order)))
        return wp.zeros(shape, dtype=dtype, device=self.engine.device)

    def model(self, cable: Cable, params: CableParams, held: bool):
        engine = self.engine
        values = dict(zip(params.names(), np.atleast_2d(params.to_array()).T, strict=True))
        segment_length = cable.length / engine.segment_count
        segment_mass = values["mass"] / engine.segment_count
        mass = np.repeat(segment_mass[:, None], self.node_count, axis=1)
        mass[:, -1] = 0.5 * segment_mass + values["endpoint_mass"]
        mass[:, 0] = np.inf
        if held:
            mass[:, -1] = np.inf
        bending = values["bend_stiffness"] / segment_length**3
        diagonal, lower1, lower2 = filter_factors(bending, mass, engine.dt)
        torsion = values["twist_stiffness"] / segment_length
        # Segments and endpoint are solid cylinders of the cable's radius.
        rolling_mass = np.repeat(segment_mass[:, None], engine.segment_count, axis=1)
        rolling_mass[:, -1] += values["endpoint_mass"]
        spin_inertia = 0.5 * rolling_mass * cable.radius**2
        # What friction must overcome to spin a segment within a step: its inertia, and the
        # neighbours that torsion ties to it.
        held_inertia = spin_inertia + 2.0 * engine.dt**2 * torsion[:, None]
        spin_gain = 0.5 * segment_mass[:, None] * cable.radius / held_inertia
        end_weight = 1.0 + 2.0 * values["endpoint_mass"] / segment_mass
        # How fast the surface comes to roll by a velocity that all nodes lose; friction that
        # reckoned with less would roll some segment too far.
        answer = np.maximum(2.0 * spin_gain[:, 0], (1.0 + end_weight) * spin_gain[:, -1])
        roll_share = 1.0 / (1.0 + answer * cable.radius)
        most_torsion = SHAPE_TORSION * segment_mass * segment_length**2 / engine.dt**2
        # Torque of angular damping on a segment of the reference length turns into a viscous
        # exchange of velocity with diffusivity c l_ref^2 / 12 (a thin rod's moment of inertia).
        reference = cable.length / REFERENCE_SEGMENT_COUNT
        diffusivity = values["angular_damping"] * reference**2 / 12
        viscosity = diffusivity * segment_mass / segment_length**2
        viscosity = np.minimum(viscosity, MOST_VISCOSITY * segment_mass / engine.dt)
        lane = self.build.lane
        model = self.build.Model()
        model.node_count = self.node_count
        model.far_is_held = int(held)
        model.dt = engine.dt
        model.segment_length = segment_length
        model.contact_height = cable.radius
        model.gravity = engine.gravity
        model.inverse_mass = self.array(self.to_lanes(1.0 / mass), lane)
        for name, value in (
            ("bending", bending),
            ("friction", values["lateral_friction"] * values["worksurface_friction"]),
            ("linear_damping", values["linear_damping"]),
            ("angular_damping", values["angular_damping"]),
            ("rotation_viscosity", viscosity),
            ("torsion", torsion),
            ("shape_torsion", np.minimum(torsion, most_torsion)),
            ("roll_share", roll_share),
            ("spin_gain", spin_gain[:, 0]),
            ("end_spin_gain", spin_gain[:, -1]),
            ("end_weight", end_weight),
            ("rolling", values["rolling_friction"] / cable.radius),
            ("spinning", values["spinning_friction"] * segment_mass / segment_length),
            ("segment_mass", segment_mass),
        ):
            setattr(model, name, self.array(self.to_lanes(value[:, None])[:, 0], lane))
        model.filter_diagonal = self.array(self.to_lanes(diagonal), lane)
        model.filter_lower1 = self.array(self.to_lanes(lower1), lane)
        model.filter_lower2 = self.array(self.to_lanes(lower2), lane)
        pivots = spin_pivots(torsion, spin_inertia, engine.dt, held)
        model.spin_pivot = self.array(self.to_lanes(pivots), lane)
        return model

    def path(self, grip_path: GripPath):
        device = self.engine.device
        real = self.build.real
        row_count, piece_count = grip_path.coefficients.shape[:2]
        path = self.build.Path()
        knots = self.sorted(grip_path.knots)
        path.knots = wp.array(knots.astype(self.real), dtype=real, device=device)
        coefficients = self.sorted(grip_path.coefficients).reshape(row_count, piece_count, -1)
        path.coefficients = wp.array(coefficients.astype(self.real), dtype=real, device=device)
        path.piece = wp.zeros((self.group_count, self.lane_count), dtype=int, device=device)
        for name in ("piece_start", "piece_duration", "spin", "spin_before", "yaw"):
            setattr(path, name, self.empty(self.group_count, dtype=self.build.lane))
        for name in ("position", "direction", "next_direction", "turn"):
            setattr(path, name, self.empty(self.group_count, dtype=self.build.vec3))
        path.current = self.empty(self.group_count, 30, dtype=self.build.lane)
        path.next_knot = wp.zeros(self.group_count, dtype=real, device=device)
        return path

    def state(self, initial: CableState):
        build = self.build
        state = build.State()
        for name, values in (("position", initial.positions), ("velocity", initial.velocities)):
            lanes = self.to_lanes(values.reshape(len(values), -1))
            lanes = lanes.reshape(self.group_count, self.node_count, 3, self.lane_count)
            setattr(state, name, self.array(lanes, build.vec3))
        for name in ("tension", "table_couple", "table_torque", "table_loss"):
            setattr(state, name, self.empty(self.group_count, self.node_count, dtype=build.lane))
        twist = np.diff(initial.roll, axis=1, prepend=0.0, append=initial.roll[:, -1:])
        twist[:, -1] = -initial.roll[:, -1]
        for name, values in (("twist", twist), ("spin", initial.roll_rate)):
            setattr(state, name, self.array(self.to_lanes(values), build.lane))
        state.binormal = self.empty(self.group_count, self.node_count, dtype=build.vec3)
        ones = np.ones((self.group_count, self.lane_count), dtype=self.real)
        state.active = self.array(ones, build.lane)
        state.rest_time = self.array(0 * ones, build.lane)
        return state

    def scratch(self):
        build, shape = self.build, (self.group_count, self.node_count)
        scratch = build.Scratch()
        scratch.moment = self.empty(self.group_count, self.node_count + 2, dtype=build.vec3)
        scratch.force = self.empty(*shape, dtype=build.vec3)
        scratch.spin = self.empty(*shape, dtype=build.lane)
        return scratch

    def samples(self, sample_count: int, steps_per_sample: int, record_nodes: bool):
        samples = self.build.Samples()
        samples.steps_per_sample = steps_per_sample
        samples.record_nodes = int(record_nodes)
        vec3 = self.build.vec3
        samples.endpoint = self.empty(self.group_count, sample_count, dtype=vec3)
        node_shape = (sample_count, self.node_count) if record_nodes else (1, 1)
        samples.nodes = self.empty(self.group_count if record_nodes else 1, *node_shape, dtype=vec3)
        return samples

    def to_worlds(self, array: wp.array) -> NDArray[np.float64]:
        """Lanes back to rows: [group, ..., 3, lane] to [world, ..., 3]."""
        values = np.moveaxis(array.numpy().astype(np.float64), -1, 1)
        values = values.reshape(self.group_count * self.lane_count, *values.shape[2:])
        worlds = np.empty_like(values[: self.world_count])
        worlds[self.order] = values[: self.world_count]
        return worlds

    def read(self, state, samples, sample_dt: float) -> Rollout:
        endpoint = self.to_worlds(samples.endpoint)
        positions = self.to_worlds(state.position)
        final = CableState(
            positions=positions,
            velocities=self.to_worlds(state.velocity),
            roll=np.cumsum(self.to_worlds(state.twist)[:, :-1], axis=1),
            roll_rate=self.to_worlds(state.spin),
        )
        finite = np.isfinite(endpoint).all(axis=(1, 2))
        finite = np.asarray(finite & np.isfinite(positions).all(axis=(1, 2)))
        # Once a world is non-finite, no later sample of it may look like a position.
        broken = np.logical_or.accumulate(~np.isfinite(endpoint).all(axis=2), axis=1)
        endpoint[broken] = np.nan
        return Rollout(
            times=np.arange(endpoint.shape[1]) * sample_dt,
            endpoint_xyz=endpoint,
            final_state=final,
            finite=finite,
            nodes=self.to_worlds(samples.nodes) if samples.record_nodes else None,
        )
