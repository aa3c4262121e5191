"""One step of the cable: each line of `step` is a stage, and each stage has a file of its own."""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.air import air_functions
from cablecast.engines.warp_.curvature import curvature_functions
from cablecast.engines.warp_.elastic import elastic_functions
from cablecast.engines.warp_.energy import energy_functions
from cablecast.engines.warp_.features import Features
from cablecast.engines.warp_.integrate import integrate_functions
from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.length import length_functions
from cablecast.engines.warp_.material import material_functions
from cablecast.engines.warp_.table import table_functions
from cablecast.engines.warp_.world import world_structs


@functools.cache
def step_functions(precision: str, lane_count: int, features: Features) -> SimpleNamespace:
    """Build the Warp function that advances a group of worlds by one step.

    Args:
        precision: "single" or "double".
        lane_count: Number of worlds side by side.
        features: Features that the kernel plays.
    """
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    curvature = curvature_functions(precision, lane_count, features.remembers)
    elastic = elastic_functions(precision, lane_count, features.remembers)
    material = material_functions(precision, lane_count, features.remembers)
    integrate = integrate_functions(precision, lane_count)
    air = air_functions(precision, lane_count, features.surface)
    energy = energy_functions(precision, lane_count, features.remembers)
    table = table_functions(precision, lane_count, features)
    length = length_functions(precision, lane_count)
    real, lane, mul = f.real, f.lane, f.mul
    Model, Path, State, Scratch = s.Model, s.Path, s.State, s.Scratch

    @wp.func
    def step(
        model: Model,
        path: Path,
        far_path: Path,
        state: State,
        scratch: Scratch,
        group: int,
        force_dt: real,
        previous_dt: real,
        active: lane,
    ):
        """Advance by dt: leapfrog with a filter for stiff elasticity and exact lengths.

        Velocities belong to the middle of a step, but the initial ones to its start. So forces act
        for half a step in the first.

        Args:
            model: Constants of the batch.
            path: Motion of the gripper, at the end of this step.
            far_path: Motion of the gripper at the far end, where there is one.
            state: State at the start of the step; becomes that at the end.
            scratch: Memory within the step.
            group: Group of worlds.
            force_dt: Time for which forces act in this step [s]: dt, and dt / 2 in the first.
            previous_dt: Duration of the previous step [s]: dt, and 0 in the first.
            active: 1, or 0 for worlds at rest.

        Returns:
            A squared speed to compare with that of rest [m²/s²]; see `integrate.move`.
        """
        curvature.measure_curvature(
            model, path, far_path, state, scratch, group, active * previous_dt
        )
        material.remember_bends(model, path, far_path, state, scratch, group, active * previous_dt)
        work = energy.gripper_power(model, path, state, scratch, group, 0, real(1.0))
        if model.far_is_held == 1:
            work += energy.gripper_power(
                model, far_path, state, scratch, group, model.node_count - 1, real(-1.0)
            )
        elastic.elastic_forces(model, path, far_path, state, scratch, group, force_dt)
        integrate.predict_velocities(model, state, scratch, group, force_dt)
        air.resist(model, state, scratch, group, force_dt)
        table.meet_table(model, state, scratch, group)
        integrate.drive_held_ends(model, path, far_path, state, group)
        length.hold_lengths(model, state, scratch, group, active)
        work = work * force_dt + energy.tension_work(model, state, group)
        state.work[group] = state.work[group] + mul(active, work)
        return integrate.move(model, state, scratch, group, active)

    return SimpleNamespace(step=step)
