"""The kernel that runs a whole rollout in a single launch: a thread owns a group of worlds."""

import dataclasses
import json
import subprocess
import sys
import threading
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.elastic import curvature_functions
from cablecast.engines.warp_.energy import STEPS_PER_CHECK, energy_functions
from cablecast.engines.warp_.forces import force_functions
from cablecast.engines.warp_.grip import grip_functions
from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.step import step_functions
from cablecast.engines.warp_.world import Features, world_structs
from cablecast.files import core_count
from cablecast.runs.kernels import one_builder

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

CPU_COMPILER_FLAGS = " ".join(
    (
        "-march=native",
        "-mprefer-vector-width=512",
        "-ffp-contract=fast",
        "-mllvm=-inline-threshold={inline_cost}",
        "-mllvm=-inline-cold-callsite-threshold={inline_cost}",
    )
)
"""Fuse multiplications and additions, and inline functions into one piece of code: only then does
LLVM see that lanes can stay in vector registers, and that the addresses of a group's rows are
the same in every step. Of these registers it uses no more than half on some processors, unless it
is asked to.

Three habits of the source follow from what Warp makes of it; each is worth a tenth of the speed or
more. Loops over nodes are `while` loops, since the iterator of a `range` hides from LLVM that an
index is never negative, which Warp would check at each access to an array. `smaller` and `larger`
(lanes.py) stand for Warp's `min` and `max` of lanes, which do not become one instruction each. No
variable is assigned under an `if` within a loop over nodes, and what a neighbour needs is read from
memory: Warp turns such an assignment into a choice between two addresses, which keeps the variable
in memory.
"""

INLINE_COST, INLINE_COST_SINGLE_WITH_TABLE = 200_000, 60_000
"""Cost, as LLVM counts it, up to which a function is inlined. Kernels in single precision with a
table are as fast with the lower bound, and compile in two thirds of the time; others are a fifth
slower with it."""


_kernels: dict[tuple[str, int, Features], SimpleNamespace] = {}


def rollout_kernel(precision: str, lane_count: int, features: Features) -> SimpleNamespace:
    """Return the kernel, made once; Warp caches the compiled code on disk."""
    key = (precision, lane_count, features)
    if key not in _kernels:
        with one_builder:
            if key not in _kernels:
                _kernels[key] = _build_kernel(*key)
    return _kernels[key]


def _build_kernel(precision: str, lane_count: int, features: Features) -> SimpleNamespace:
    """Build the kernel of `rollout_kernel`."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    grip = grip_functions(precision, lane_count)
    curvature = curvature_functions(precision, lane_count, features.remembers)
    step = step_functions(precision, lane_count, features).step
    real, lane, vec3 = f.real, f.lane, f.vec3
    Model, Path, State, Scratch, Samples = s.Model, s.Path, s.State, s.Scratch, s.Samples
    count = wp.constant(lane_count)
    energy = energy_functions(precision, lane_count, features.remembers)
    forces = force_functions(precision, lane_count)
    steps_per_check = wp.constant(STEPS_PER_CHECK)
    is_quick = features.table and precision == "single"
    inline_cost = INLINE_COST_SINGLE_WITH_TABLE if is_quick else INLINE_COST
    flags = CPU_COMPILER_FLAGS.format(inline_cost=inline_cost)

    @wp.kernel(enable_backward=False, module="unique", module_options={"cpu_compiler_flags": flags})
    def kernel(
        first_group: int,
        sample_count: int,
        rest_speed: real,
        rest_duration: real,
        motion_end: wp.array(dtype=lane),
        model: Model,
        path: Path,
        far_path: Path,
        state: State,
        scratch: Scratch,
        samples: Samples,
    ):
        """Simulate the rollout of one group of worlds.

        Args:
            first_group: Group of the first thread of this launch.
            sample_count: Number of samples, the first at time 0.
            rest_speed: Speed up to which a world may be at rest [m/s].
            rest_duration: Time for which it must be that slow [s].
            motion_end: End of the motion of the grippers [s], shape [group].
            path: Motion of the gripper.
            far_path: Motion of the gripper at the far end, where there is one.
            state: Initial state; becomes the final one.
            scratch: Memory within a step.
            samples: Receives the samples.
        """
        group = first_group + wp.tid()
        dt = model.dt
        start_grippers(model, path, far_path, group)
        active = state.active[group]
        rest_time = state.rest_time[group]
        record(model, state, scratch, samples, group, 0)
        slow = rest_speed * rest_speed
        any_active = int(1)
        unchecked = int(0)
        force_dt = dt * real(0.5)
        previous_dt = real(0.0)
        t_end = real(0.0)
        for sample in range(1, sample_count):
            for k in range(samples.steps_per_sample):
                if any_active == 1:
                    t_end = real((sample - 1) * samples.steps_per_sample + k + 1) * dt
                    follow_grippers(model, path, far_path, group, t_end)
                    squared_speed = step(
                        model, path, far_path, state, scratch, group, force_dt, previous_dt, active
                    )
                    force_dt = dt
                    previous_dt = dt
                    for j in range(count):
                        if squared_speed[j] <= slow and t_end > motion_end[group][j]:
                            rest_time[j] = rest_time[j] + dt
                        else:
                            rest_time[j] = real(0.0)
                        if rest_time[j] > rest_duration:
                            active[j] = real(0.0)
                    unchecked = unchecked + 1
                    if unchecked >= steps_per_check:
                        unchecked = int(0)
                        active = energy.is_sound(model, path, far_path, state, group, active)
                    any_active = int(wp.max(active))
            record(model, state, scratch, samples, group, sample)
        # The twist of the last step, for the final state.
        follow_grippers(model, path, far_path, group, t_end)
        curvature.measure_curvature(
            model, path, far_path, state, scratch, group, active * previous_dt
        )
        state.active[group] = active
        state.rest_time[group] = rest_time

    @wp.func
    def start_grippers(model: Model, path: Path, far_path: Path, group: int):
        """Take the directions of the held ends at time 0."""
        grip.start(path, group)
        if model.far_is_held == 1:
            grip.start(far_path, group)

    @wp.func
    def follow_grippers(model: Model, path: Path, far_path: Path, group: int, t: real):
        """Move the held ends on by a step, to time t [s]."""
        grip.follow(path, group, t, model.dt)
        if model.far_is_held == 1:
            grip.follow(far_path, group, t, model.dt)

    @wp.func
    def record(
        model: Model, state: State, scratch: Scratch, samples: Samples, group: int, sample: int
    ):
        """Write the endpoint, and the shape [m] and forces [N] where asked for."""
        samples.endpoint[group, sample] = state.position[group, model.endpoint]
        if samples.record_nodes == 1:
            for node in range(model.node_count):
                samples.nodes[group, sample, node] = state.position[group, node]
        if samples.record_forces == 1 and sample > 0:
            last = model.node_count - 2
            force = vec3()
            for segment in range(last + 1):
                force = forces.internal_force(model, state, scratch, group, segment)
                samples.tension[group, sample, segment] = forces.along(
                    model, state, group, segment, force
                )
                if segment == 0:
                    samples.grip_force[group, sample, 0] = force
            samples.grip_force[group, sample, 1] = -force

    return SimpleNamespace(kernel=kernel, **vars(s), real=real, lane=lane, vec3=vec3)


_COMPILE = """
import json, sys
from cablecast.engines.warp_.device import find_device
from cablecast.engines.warp_.lanes import LANE_COUNT_CPU
from cablecast.engines.warp_.rollout import rollout_kernel
from cablecast.engines.warp_.world import Features
from cablecast.runs.kernels import load
find_device("cpu")
wanted = Features(**json.loads(sys.argv[1]))
load(rollout_kernel("single", LANE_COUNT_CPU["single"], wanted).kernel)
"""


def compile_ahead(features: Features) -> subprocess.Popen[bytes] | None:
    """Start to compile the kernel of the CPU in single precision, and return at once.

    Whoever needs it meanwhile waits until it is done, as for any process that compiles the same
    kernel. Where it is compiled already this takes another core two seconds. Where it fails,
    whoever needs the kernel compiles it.

    Args:
        features: Features of the kernel.

    Returns:
        The process; None on a single core, which would only be slower, or where none can start.
    """
    if core_count() < 2:
        return None
    wanted, nothing = json.dumps(dataclasses.asdict(features)), subprocess.DEVNULL
    # -P: a file of the current folder must not stand in for a library.
    command = [sys.executable, "-P", "-c", _COMPILE, wanted]
    try:
        process = subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing)
    except OSError:
        return None
    # Nobody else waits for it.
    threading.Thread(target=process.wait, daemon=True).start()
    return process
