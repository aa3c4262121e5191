"""Parts of a batch: the rows of some worlds, and one rollout from those of the parts."""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, CableParams
from cablecast.engines.base import CableState, Rollout


def rows_of(values: Any, worlds: NDArray[np.int_]) -> Any:
    """Return the rows of some worlds: of cables, parameters, a state, a path, or an array.

    What all worlds share, a single row or None, is returned as it is.
    """
    if values is None or isinstance(values, (int, float)):
        return values
    if isinstance(values, CableParams):
        return values.rows(worlds)
    if isinstance(values, Cable):
        return values.with_material(values.material.rows(worlds))
    if isinstance(values, (list, tuple)):
        return values if len(values) == 1 else [values[world] for world in worlds]
    if isinstance(values, CableState):
        if values.world_count == 1:
            return values
        fields = {f.name: getattr(values, f.name)[worlds] for f in dataclasses.fields(values)}
        return CableState(**fields)
    return values if len(values) == 1 else values[worlds]


def merge(parts: list[tuple[NDArray[np.int_], Rollout]]) -> Rollout:
    """Return the rollout of a batch from those of its parts.

    Args:
        parts: Indices of worlds, and their rollout; together they name each world once.
    """
    if len(parts) == 1:
        return parts[0][1]
    order = np.argsort(np.concatenate([worlds for worlds, _ in parts]))
    rollouts = [rollout for _, rollout in parts]

    def joined(arrays: list[NDArray]) -> NDArray:
        return np.concatenate(arrays)[order]

    states = [rollout.final_state for rollout in rollouts]
    nodes = [rollout.nodes for rollout in rollouts if rollout.nodes is not None]
    return Rollout(
        times=rollouts[0].times,
        endpoint_xyz=joined([rollout.endpoint_xyz for rollout in rollouts]),
        final_state=rows_of(CableState.stack(states), order),
        finite=joined([rollout.finite for rollout in rollouts]),
        nodes=joined(nodes) if nodes else None,
    )
