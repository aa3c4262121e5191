"""Informative actions: calibration casts whose tracks tell most of a cable's parameters.

The casts are chosen one after another: the one with the largest mean logarithm of the determinant
of the Fisher information, over cables drawn from what is believed after the casts so far. The
precision of that belief is part of it, so directions that no cast can tell count for nothing.
"""

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import CableParams, Material
from cablecast.engines.base import Engine
from cablecast.errors import InputError, check_seed
from cablecast.motion.action import ActionRanges
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.setup import Setup
from cablecast.tuning.fit import MISFIT_START, TRACK_WEIGHT
from cablecast.tuning.space import ParamPosterior
from cablecast.tuning.spread import EDGE

# Actions to choose from, more where many are asked for, and cables drawn from the belief.
_POOL_COUNT, _DRAW_COUNT = 150, 6
# Finite differences step by this part of the believed deviation: a local slope of an erratic cast
# promises more than the cast can tell. For the same reason larger offsets than this count less
# [cable lengths].
_STEP, _OFFSET_MAX = 0.3, 0.25
_SAMPLE_DT = 0.1


def informative_actions(
    setup: Setup,
    count: int,
    engine: Engine,
    belief: ParamPosterior | None = None,
    material: Material | None = None,
    ranges: ActionRanges | None = None,
    seed: int = 0,
) -> NDArray[np.float64]:
    """Choose the actions whose tracks tell most of the parameters of a cable.

    Args:
        setup: Cable with what is believed of it, workspace, arm and motion settings.
        count: Number of actions.
        engine: Engine that simulates them.
        belief: Posterior of earlier casts; what the cable's file believes where None.
        material: Material of the cable; that of its file where None.
        ranges: Ranges of the actions; those that suit the set-up where None.
        seed: Seed of the actions to choose from and of the draws.

    Returns:
        Actions, the most telling one first, shape [count, 4].

    Raises:
        InputError: Too few actions stay on the table in all draws, or the seed is out of bounds.
    """
    belief = belief or ParamPosterior.before_casts(setup.cable)
    pool = feasible_uniform(max(_POOL_COUNT, 3 * count), setup, ranges, 1000 + check_seed(seed))
    told, safe = _information(pool, setup, engine, belief, material, seed)
    if safe.sum() < count:
        raise InputError(
            f"{safe.sum()} of {len(pool)} actions stay on the table for all cables that are "
            f"believed possible, too few for {count} casts: check the cable's file, or take spread"
        )
    known = np.broadcast_to(np.linalg.inv(belief.covariance), told.shape[1:]).copy()
    chosen: list[int] = []
    for _ in range(count):
        left = safe & ~np.isin(np.arange(len(pool)), chosen)
        gain = np.full(len(pool), -np.inf)
        gain[left] = np.linalg.slogdet(known + told[left])[1].mean(axis=1)
        chosen.append(int(np.argmax(gain)))
        known += told[chosen[-1]]
    return pool[chosen]


def _information(
    actions: NDArray[np.float64],
    setup: Setup,
    engine: Engine,
    belief: ParamPosterior,
    material: Material | None,
    seed: int,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return what each action tells, shape [action, draw, 10, 10], and whether it is safe.

    Args:
        actions: Actions to choose from, shape [action, 4].
        setup: Gives the cable and the table.
        engine: Engine that simulates them.
        belief: Gaussian over the parameters.
        material: Material of the cable; that of its file where None.
        seed: Seed of the draws.
    """
    space = belief.space
    cable = setup.cable if material is None else setup.cable.with_material(material)
    points = space.to_unit(belief.draw(_DRAW_COUNT, seed))
    step = np.where(points > 0.5, -1.0, 1.0) * _STEP * belief.deviation
    shifted = np.clip(points[:, None] + np.eye(space.dimension) * step[:, None], 0.0, 1.0)
    points = np.concatenate([points[:, None], shifted], axis=1)
    values = space.to_params(points.reshape(-1, space.dimension)).to_array()
    rollout = engine.rollout(
        cable,
        CableParams.from_array(np.tile(values, (len(actions), 1))),
        cast_grip_paths(actions, setup)[np.repeat(np.arange(len(actions)), len(values))],
        sample_dt=_SAMPLE_DT,
    )
    xy = rollout.endpoint_xy.reshape(len(actions), _DRAW_COUNT, space.dimension + 1, -1, 2)
    margin = setup.workspace.edge_distance(xy).min(axis=(1, 2, 3))
    offsets = (xy[:, :, 1:] - xy[:, :, :1]) / cable.length
    offsets /= np.sqrt(1.0 + np.sum(offsets**2, axis=-1, keepdims=True) / _OFFSET_MAX**2)
    slopes = offsets / step[None, :, :, None, None]
    weight = TRACK_WEIGHT / (2.0 * MISFIT_START**2 * xy.shape[3])
    told = weight * np.einsum("adptc,adqtc->adpq", slopes, slopes)
    return told, np.isfinite(told).all(axis=(1, 2, 3)) & (margin > EDGE)
