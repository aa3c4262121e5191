import numpy as np

from cablecast.cable import load_cable
from cablecast.tuning.space import SearchSpace, draw_cables

CABLE = load_cable("cable_2")


def test_cables_are_drawn_from_all_of_the_search_ranges():
    space = SearchSpace.for_cable(CABLE)
    unit = space.to_unit(draw_cables(CABLE, 2000, seed=0))
    # Quantiles of 2,000 uniform draws scatter by one per cent.
    for share in (0.05, 0.5, 0.95):
        np.testing.assert_allclose(np.quantile(unit, share, axis=0), share, atol=0.05)
    values = draw_cables(CABLE, 2000, seed=0).to_array()
    assert np.all((values >= space.low) & (values <= space.high))


def test_a_larger_count_begins_with_the_cables_of_a_smaller_one_and_seeds_differ():
    many, few, other = (
        draw_cables(CABLE, count, seed).to_array() for count, seed in ((50, 4), (20, 4), (20, 5))
    )
    np.testing.assert_array_equal(many[:20], few)
    assert not np.any(other == few)
