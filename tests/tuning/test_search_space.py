import dataclasses

import numpy as np
import pytest

from cablecast.cable import CABLE_NAMES, PAPER_PARAMS, PARAMS, CableParams, load_cable
from cablecast.errors import InputError
from cablecast.tuning.space import SearchSpace

# Powers and logarithms of doubles.
ROUNDING = 1e-12


@pytest.mark.parametrize("name", CABLE_NAMES)
def test_the_ranges_hold_what_is_believed_and_what_is_allowed(name):
    cable = load_cable(name)
    space = SearchSpace.for_cable(cable)
    values = cable.params.to_array()[: space.dimension]
    assert np.all((space.low <= values) & (values <= space.high))
    for name, least, most in zip(PAPER_PARAMS, space.low, space.high, strict=True):
        low, high = PARAMS[name].bounds
        assert low <= least < most <= high


def test_points_of_the_cube_and_parameters_map_back_and_forth():
    space = SearchSpace.for_cable(load_cable("cable_1"))
    points = np.random.default_rng(0).random((50, space.dimension))
    params = space.to_params(points)
    assert params.world_count == 50
    np.testing.assert_allclose(space.to_unit(params), points, atol=ROUNDING)


def test_logarithmic_parameters_have_their_geometric_mean_in_the_middle():
    space = SearchSpace.for_cable(load_cable("cable_1"))
    middle = space.to_params(np.full(space.dimension, 0.5)).to_array()[: space.dimension]
    mean = np.where(
        space.logarithmic, np.sqrt(np.abs(space.low * space.high)), (space.low + space.high) / 2
    )
    np.testing.assert_allclose(middle, mean, rtol=ROUNDING)
    spans_decades = space.high >= 30 * np.maximum(space.low, 1e-12)
    assert np.all(space.logarithmic[spans_decades])


def test_a_cable_without_an_attachment_may_still_turn_out_to_have_a_heavy_end():
    cable = load_cable("cable_1")
    bare = cable.with_params(endpoint_mass=0.0)
    space = SearchSpace.for_cable(bare)
    index = CableParams.names().index("endpoint_mass")
    assert space.low[index] == 0.0
    assert space.high[index] == pytest.approx(0.5 * cable.params.mass)


def test_a_range_that_leaves_the_allowed_one_is_refused():
    space = SearchSpace.for_cable(load_cable("cable_1"))
    high = space.high.copy()
    high[0] = 2.0
    with pytest.raises(InputError, match="search range of twist_stiffness"):
        dataclasses.replace(space, high=high)
