"""EngineSpread: an engine whose worlds are simulated on a cluster or in a process for each core."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cablecast.cable import Cable
from cablecast.engines.base import (
    CableRows,
    CableState,
    Engine,
    Rollout,
    batch_size,
    default_duration,
    merge,
    rows_of,
)
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath
from cablecast.runs.workers import LOCAL, PROCESSES, check_workers, run_tasks
from cablecast.workspace import Workspace

WORLD_COUNT, SLOW_WORLD_COUNT = 128, 2
"""Worlds of a task, and of one of a slow engine: some tenths of a second on one core, or some
seconds, far longer than sending it takes."""


class EngineSpread:
    """Answers like an engine, and lets the workers of a cluster simulate the worlds of a batch.

    A world's result does not depend on its neighbours, so that a batch gives the same to the bit
    wherever it is simulated, on processors of one kind.

    Args:
        engine: Engine that each worker builds for itself; it also simulates batches that are too
            small to share.
        workers: See `check_workers`.
        world_count: Worlds of a task; those that suit the engine if None.

    Raises:
        InputError: The engine works in this process only.
    """

    def __init__(self, engine: Engine, workers: str, world_count: int | None = None):
        self._spec = spec_of(engine)
        self.segment_count, self.dt = engine.segment_count, engine.dt
        self._engine, self._workers = engine, workers
        self._world_count = world_count or (SLOW_WORLD_COUNT if is_slow(engine) else WORLD_COUNT)

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
    ) -> Rollout:
        """Simulate a batch; see `Engine.rollout`."""
        # The engine of each part checks all else, and works out where its cables start.
        world_count = batch_size(
            len(grip_path),
            None if initial_state is None else initial_state.world_count,
            None if far_path is None else len(far_path),
            CableRows.of(cable).world_count,
        )
        # The longest motion of all, not that of a task, says when a rollout ends.
        duration = default_duration(grip_path) if duration is None else duration
        options = {
            "duration": duration,
            "sample_dt": sample_dt,
            "edges": edges,
            "record_nodes": record_nodes,
        }
        if world_count <= self._world_count:
            return self._engine.rollout(
                cable, grip_path, initial_state, far_path=far_path, **options
            )
        count = math.ceil(world_count / self._world_count)
        parts = np.array_split(np.arange(world_count), count)
        batch = (cable, grip_path, initial_state, far_path)
        tasks = [
            (number, tuple(rows_of(values, worlds) for values in batch))
            for number, worlds in enumerate(parts)
        ]
        shared = (self._spec, options)
        done = dict(run_tasks(_simulate, tasks, self._workers, shared))
        return merge([(worlds, done[number]) for number, worlds in enumerate(parts)])


def spread(engine: Engine, workers: str) -> Engine:
    """Return an engine whose worlds are simulated by some workers.

    For "local" it is the engine as it is, or one that spreads its worlds over a process for each
    core if it uses one core only.

    Raises:
        InputError: There are no such workers, or the engine works in this process only.
    """
    if check_workers(workers) != LOCAL:
        return EngineSpread(engine, workers)
    return EngineSpread(engine, PROCESSES) if is_slow(engine) else engine


def is_slow(engine: Engine) -> bool:
    """Return whether an engine plays one world after the other on one core."""
    return getattr(engine, "uses_one_core", False)


def spec_of(engine: Engine) -> tuple[type, dict[str, Any]]:
    """Return a picklable spec of an engine, its class and arguments: compiled kernels are not."""
    make = getattr(engine, "spec", None)
    if make is None:
        raise InputError(f"{type(engine).__name__} works in this process only: workers = 'local'")
    return make()


def _simulate(
    cable: Cable | Sequence[Cable],
    grip_path: GripPath,
    state: CableState | None,
    far_path: GripPath | None,
    made: tuple[type, dict[str, Any]],
    options: dict[str, Any],
) -> Rollout:
    """Simulate some worlds on a worker, with an engine made there."""
    kind, arguments = made
    return kind(**arguments).rollout(cable, grip_path, state, far_path=far_path, **options)
