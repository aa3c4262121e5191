"""The picture of misses: against tries, or against the number of casts before."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from benchmarks.casts import draw, misses
from matplotlib.figure import Figure


def found(counts, methods):
    """Results whose misses of a try are 8, 4, 2, 1 % on average, at 20 targets."""
    rng = np.random.default_rng(0)
    tries = {"aim": 4}
    return {
        ("virtual", "cable_1", count, method): [
            {
                "miss_pct": list(8.0 * 0.5 ** np.arange(tries.get(method, 1)) + rng.uniform(-1, 1)),
                "share": [0.25, 0.7, 0.95, 0.7],
            }
            for _ in range(20)
        ]
        for count in counts
        for method in methods
    }


@pytest.fixture
def drawn(monkeypatch):
    """Return a function that draws, and returns the axis with what it shows."""
    figures = []
    savefig = Figure.savefig

    def kept(figure, *args, **options):
        figures.append(figure)
        savefig(figure, *args, **options)

    monkeypatch.setattr(Figure, "savefig", kept)

    def draw_it(*what):
        assert len(draw(misses(found(*what)).records())) > 10_000
        return figures[-1].axes[0]

    return draw_it


def medians(axis):
    return {bars.get_label(): bars.lines[0].get_ydata() for bars in axis.containers}


def test_misses_are_drawn_against_the_tries(drawn):
    lines = medians(drawn((5,), ("aim",)))
    np.testing.assert_allclose(lines["aim, 5 casts before"], [8, 4, 2, 1], atol=0.8)


def test_regions_are_counted_where_a_method_states_them():
    rows = misses(found((5,), ("aim", "simulated"))).records()
    inside = [(row["in 50 %"], row["in 90 %"]) for row in rows]
    assert inside == [(100.0, 100.0), (0.0, 100.0), (0.0, 0.0), (0.0, 100.0), (None, None)]
