from cablecast.cable import CABLE_NAMES
from cablecast.evaluation.published import PUBLISHED_ROWS, published_rows


def test_every_preset_has_a_published_row_and_other_cables_have_none():
    assert all(published_rows(name) for name in CABLE_NAMES)
    assert published_rows("my_cable") == ()


def test_the_numbers_of_each_row_rise_from_least_to_greatest():
    for row in PUBLISHED_ROWS:
        assert (
            row.min_pct
            <= row.first_quartile_pct
            <= row.median_pct
            <= row.third_quartile_pct
            <= row.max_pct
        )
