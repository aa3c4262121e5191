"""EngineWarp: thousands of cables at once, on all cores of a CPU or on a CUDA device."""

import dataclasses
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable
from cablecast.engines.base import (
    GRAVITY,
    CableRows,
    CableState,
    Rollout,
    RolloutPlan,
    merge,
    plan_rollout,
    rows_of,
)
from cablecast.engines.warp_.batch import Batch, Layout
from cablecast.engines.warp_.constants import (
    EndSegment,
    fastest_at_end,
    fastest_wave,
    has_end,
    rounding_of_friction,
    substep_counts,
)
from cablecast.engines.warp_.device import find_device, launch
from cablecast.engines.warp_.lanes import LANE_COUNT_CPU, LANE_COUNT_CUDA
from cablecast.engines.warp_.material import rest_bends
from cablecast.engines.warp_.rollout import rollout_kernel
from cablecast.engines.warp_.world import Features
from cablecast.errors import InputError, check_count
from cablecast.files import core_count
from cablecast.motion.grip_path import GripPath
from cablecast.workspace import Workspace

DEFAULT_SEGMENT_COUNT = 50
DEFAULT_DT = 5e-3 / 9
"""The coarsest resolution whose landings, on all three presets, are within 1 % of cable length of
converged ones in the median, and within 2 to 6 % in nine of ten casts: `python -m benchmarks
convergence`, docs/engine.md. At an eighteenth of 10 ms no preset takes substeps yet."""

MOST_NOISE = 0.05
"""Share of friction up to which rounding in single precision does no harm [-]. Cables that lie bent
at Coulomb's limit move by less than 0.1 um in 20 s at up to a share of 0.18, by 0.1 mm at 0.5
(tests/engines/test_warp_forces.py); other scenes creep by 0.1 mm from 0.05 on."""

REST_DURATION = 0.05
"""Time for which a world must be slow to be at rest [s]."""

MODEL_VERSION = 9
"""Counts the changes that move landings by more than rounding does. It is among the settings of a
dataset, so that casts of one model are never continued with those of another."""


class EngineWarp:
    """The fast engine: an inextensible elastic rod with Coulomb friction, all worlds in one launch.

    docs/engine.md explains the model. The result of a world depends neither on its neighbours nor
    on the number of threads.

    Args:
        segment_count: Number of segments, at least 2.
        dt: Longest step [s]. Worlds whose bending asks for it take shorter ones (constants.py).
        device: "cpu" or a Warp CUDA device such as "cuda".
        precision: "single" or "double".
        thread_count: CPU threads; by default all cores that this process may use.
        rest_speed: A world whose motion is over, whose free end lies on the table, and the last
            quarter of whose cable has not moved along it faster than this for 50 ms is at rest and
            no longer computed [m/s]. Friction stops such a node within a few steps; the rest, of
            which some hangs from the gripper, may swing on at up to a hundred times that speed,
            which moves 99 of 100 free ends by less than 0.05 mm and none by more than 0.3 mm. 0
            computes every world to the end.
        gravity: Acceleration of free fall [m/s²].
        table: False for a cable in the air with no table below it, at any height. Nothing rests
            there, so that every world is computed to the end.
        hinged: True for grippers that let the cable turn about them; it must have no damping time,
            curl or yield then.

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
        rest_speed: float = 1e-3,
        gravity: float = GRAVITY,
        *,
        table: bool = True,
        hinged: bool = False,
    ):
        check_count("segment_count", segment_count, 2, 1000)
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
        self.table = table
        self.hinged = hinged
        self.device = find_device(device)
        self.thread_count = thread_count or core_count()
        # How many worlds a thread owns, and whether groups lie interleaved in memory.
        self._interleaved = self.device.is_cuda
        self._lane_count = LANE_COUNT_CUDA if self.device.is_cuda else LANE_COUNT_CPU[precision]

    def spec(self, thread_count: int = 1) -> tuple[type, dict[str, Any]]:
        """Return the class and the arguments that make this engine anew in another process.

        Args:
            thread_count: Number of its threads there; the results do not depend on it.
        """
        names = ("segment_count", "dt", "precision", "rest_speed", "gravity", "table", "hinged")
        device = "cuda" if self.device.is_cuda else "cpu"
        options = {name: getattr(self, name) for name in names}
        return type(self), options | {"device": device, "thread_count": thread_count}

    def _layout(self, features: Features) -> Layout:
        """Return the memory layout, with the kernel of some features."""
        return Layout(
            build=rollout_kernel(self.precision, self._lane_count, features),
            device=self.device,
            real=np.float32 if self.precision == "single" else np.float64,
            lane_count=self._lane_count,
            interleaved=self._interleaved,
        )

    def rollout(
        self,
        cable: Cable | Sequence[Cable],
        grip_path: GripPath,
        initial_state: CableState | None = None,
        duration: float | None = None,
        sample_dt: float = 0.1,
        *,
        far_path: GripPath | None = None,
        edges: Workspace | None = None,
        record_nodes: bool = False,
        record_forces: bool = False,
    ) -> Rollout:
        """Simulate a batch; see `Engine.rollout`.

        With `record_forces` the rollout has `forces`, and computes every world to the end.
        """
        plan = plan_rollout(
            self,
            cable,
            grip_path,
            initial_state,
            duration,
            sample_dt,
            far_path,
            plays_material=True,
        )
        cables = CableRows.of(cable)
        params = cables.params
        remembers = params.remembers_bends
        if remembers and self.hinged:
            raise InputError(
                "grippers that are hinges hold no cable with a damping time, a curl or a yield"
            )
        has_grain = self.table and bool(np.any(np.asarray(params.friction_ratio) != 1.0))
        features = Features(
            table=self.table,
            remembers=remembers,
            surface=remembers or has_grain or bool(np.any(params.drag_coefficient)),
        )
        segment_mass = np.atleast_1d(np.asarray(params.mass)) / self.segment_count
        stiffness = np.atleast_1d(np.asarray(params.bend_stiffness))
        segment_length = cables.length / self.segment_count
        fastest = fastest_wave(stiffness, segment_mass, segment_length)
        ends = has_end(params) & (far_path is None)
        if ends.any():
            end = EndSegment.of(segment_length, params)
            at_end = fastest_at_end(stiffness, segment_mass, segment_length, end)
            fastest = np.maximum(fastest, np.where(ends, at_end, 0.0))
        if self.table and self.precision == "single" and cables.world_count is None:
            warn_of_creep(cables.cables[0], self.segment_count)
        damping_time = np.atleast_1d(params.damping_time)
        counts = substep_counts(fastest, damping_time, self.dt)
        counts = np.broadcast_to(counts, plan.world_count)
        ends = np.broadcast_to(ends, plan.world_count)
        parts = []
        for count, has in np.unique(np.stack([counts, ends], axis=1), axis=0)[::-1].tolist():
            worlds = np.flatnonzero((counts == count) & (ends == has))
            rollout = self._run(
                features,
                cables.rows(worlds),
                rows_of(grip_path, worlds),
                rows_of(far_path, worlds),
                edges,
                dataclasses.replace(
                    plan,
                    initial_state=rows_of(plan.initial_state, worlds),
                    world_count=len(worlds),
                    steps_per_sample=plan.steps_per_sample * count,
                ),
                self.dt / count,
                record_nodes,
                record_forces,
                bool(has),
            )
            parts.append((worlds, rollout))
        return merge(parts)

    def _run(
        self,
        features: Features,
        cables: CableRows,
        grip_path: GripPath,
        far_path: GripPath | None,
        edges: Workspace | None,
        plan: RolloutPlan,
        dt: float,
        record_nodes: bool,
        record_forces: bool,
        with_end: bool,
    ) -> Rollout:
        """Simulate worlds that take the same step dt [s].

        All or none of them have an attachment that is a body.
        """
        layout = self._layout(features)
        end = None
        if with_end:
            end = EndSegment.of(cables.length / self.segment_count, cables.params)
            plan = dataclasses.replace(plan, initial_state=end.appended(plan.initial_state))
        batch = Batch(layout, self.segment_count, plan.world_count, grip_path.duration, end)
        motion_end = batch.to_lanes(np.asarray(grip_path.duration)[:, None])[:, 0]
        if far_path is not None:
            motion_end = np.maximum(
                motion_end, batch.to_lanes(np.asarray(far_path.duration)[:, None])[:, 0]
            )
        rest_bend = (
            self._rest_bend(cables, grip_path, plan, with_end) if features.remembers else None
        )
        state = batch.state(plan.initial_state, rest_bend)
        samples = batch.samples(
            plan.sample_count, plan.steps_per_sample, record_nodes, record_forces
        )
        build = layout.build
        may_rest = self.rest_speed > 0 and self.table and not record_forces
        inputs = [
            plan.sample_count,
            self.rest_speed,
            REST_DURATION if may_rest else np.inf,
            batch.array(motion_end, build.lane),
            batch.model(
                cables,
                dt,
                self.gravity,
                edges,
                far_is_held=far_path is not None,
                hinged=self.hinged,
            ),
            batch.path(grip_path),
            batch.path(far_path if far_path is not None else _NO_PATH),
            state,
            batch.scratch(keep_moments=record_forces),
            samples,
        ]
        launch(build.kernel, self.device, batch.group_count, self.thread_count, inputs)
        rollout = batch.read(state, samples, plan.steps_per_sample * dt, far_path is not None)
        if rollout.forces is not None:
            half_mass = 0.5 * np.atleast_1d(np.asarray(cables.params.mass)) / self.segment_count
            grips = (grip_path, rollout.forces.grip), (far_path, rollout.forces.far_grip)
            for path, force in grips:
                if path is not None and force is not None:
                    # Of the half segment that the gripper holds.
                    acceleration = path.evaluate(rollout.times, 2)[..., :3]
                    acceleration[..., 2] += self.gravity
                    force -= half_mass[:, None, None] * acceleration
        return rollout

    def _rest_bend(
        self, cables: CableRows, grip_path: GripPath, plan: RolloutPlan, with_end: bool
    ) -> NDArray[np.float64]:
        """Return the bend at which nodes feel no moment [m], shape [world, node, 3]."""
        initial = plan.initial_state
        curvature = np.atleast_1d(np.asarray(cables.params.rest_curvature, dtype=float))
        length = cables.length / self.segment_count
        worlds = max(len(grip_path), initial.world_count, len(curvature), len(length))
        return rest_bends(
            np.broadcast_to(initial.positions, (worlds, *initial.positions.shape[1:])),
            np.broadcast_to(initial.roll, (worlds, initial.roll.shape[1])),
            grip_path,
            np.broadcast_to(curvature, worlds),
            np.broadcast_to(length, worlds),
            has_joint=with_end,
        )


def warn_of_creep(cable: Cable, segment_count: int) -> None:
    """Warn where rounding in single precision moves a cable that friction should hold.

    A fit, whose worlds have parameters of their own, is not warned: its casts last seconds.
    """
    noise = float(np.max(rounding_of_friction(cable, segment_count)))
    if noise > MOST_NOISE:
        warnings.warn(
            f"{cable.name} of {segment_count} segments is so stiff and light that rounding reaches "
            f"{100 * noise:.0f} % of the friction that holds a node: at rest it may creep by "
            'millimetres in a minute; precision="double" holds it',
            stacklevel=3,
        )


_NO_PATH = GripPath.hold(np.zeros(5), 0.0)
