"""Random cables within the ranges that `tune` searches."""

import numpy as np

from cablecast.cable import Cable, CableParams
from cablecast.tuning.search_space import SearchSpace


def draw_cables(cable: Cable, count: int, seed: int) -> CableParams:
    """Draw parameters uniformly from the search ranges of a cable.

    Stiffnesses, masses, lever arms and dampings are uniform in their logarithm, the frictions in
    their value, as in `SearchSpace`. A larger count begins with the cables of a smaller one.

    Args:
        cable: Cable around whose believed values the ranges lie.
        count: Number of cables.
        seed: Seed of the draws.

    Returns:
        Parameters, one value per cable.
    """
    space = SearchSpace.for_cable(cable)
    unit = np.random.default_rng([seed, 21]).uniform(size=(count, space.dimension))
    return space.to_params(unit)
