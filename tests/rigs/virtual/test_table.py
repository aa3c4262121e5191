"""The table's face: uneven by some per cent, with seams, and the same for a seed."""

import dataclasses

import numpy as np
import pytest

from cablecast.rigs.virtual._hidden import HiddenTable, hidden_table
from cablecast.rigs.virtual.forces import friction_map
from cablecast.workspace import Workspace

WORKSPACE = Workspace()


def places(count=4000, seed=0):
    rng = np.random.default_rng(seed)
    half = WORKSPACE.table_width / 2
    return np.stack([rng.uniform(-half, half, count), rng.uniform(0, 1.5, count)], axis=1)


def test_friction_differs_from_place_to_place_by_some_per_cent_about_its_mean():
    factors = friction_map(hidden_table(0), WORKSPACE).factor(places())
    assert abs(factors.mean() - 1.0) < 0.1
    assert 0.03 < factors.std() < 0.2
    assert factors.min() > 0.5


def test_a_table_is_the_same_for_its_seed_and_another_for_another():
    one, again, other = (friction_map(hidden_table(s), WORKSPACE).factors for s in (0, 0, 1))
    np.testing.assert_array_equal(one, again)
    assert np.abs(one - other).max() > 0.05


def test_friction_is_smooth_within_a_board_and_steps_only_at_seams():
    table = dataclasses.replace(hidden_table(0), board=0.0, seam=0.0)
    factors = friction_map(table, WORKSPACE).factors
    # Neighbouring cells are 5 mm apart, a fiftieth of the wear's length.
    assert np.abs(np.diff(factors, axis=0)).max() < 0.02


def test_a_cable_feels_more_friction_on_a_seam():
    flat = HiddenTable(seed=0, wear=0.0, board=0.0)
    factors = friction_map(flat, WORKSPACE).factors
    np.testing.assert_allclose(np.unique(factors), [1.0, 1.0 + flat.seam])
    on_seams = np.mean(factors > 1.0)
    expected = sum(flat.seam_width / size for size in flat.board_size)
    assert on_seams == pytest.approx(expected, rel=0.3)


def test_places_beyond_the_table_and_places_that_are_none_have_a_friction_too():
    surface = friction_map(hidden_table(0), WORKSPACE)
    xy = np.array([[9.0, 9.0], [-9.0, -9.0], [np.nan, 0.5]])
    assert np.all(np.isfinite(surface.factor(xy)))
