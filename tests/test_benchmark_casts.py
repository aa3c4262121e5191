"""The picture of misses against tries, and the table that it is drawn from."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from benchmarks.casts import draw, misses
from matplotlib.figure import Figure


def found(**tries):
    """Results of methods whose misses of a try are 8, 4, 2, 1 % on average, at 20 targets."""
    rng = np.random.default_rng(0)
    return {
        ("virtual", "cable_1", 5, method): [
            {
                "miss_pct": list(8.0 * 0.5 ** np.arange(count) + rng.uniform(-1, 1)),
                "share": [0.25, 0.7, 0.95, 0.7],
            }
            for _ in range(20)
        ]
        for method, count in tries.items()
    }


def test_misses_are_drawn_against_the_tries(monkeypatch):
    figures = []
    savefig = Figure.savefig

    def kept(figure, *args, **options):
        figures.append(figure)
        savefig(figure, *args, **options)

    monkeypatch.setattr(Figure, "savefig", kept)
    assert len(draw(misses(found(aim=4)).records())) > 10_000
    (bars,) = figures[-1].axes[0].containers
    assert bars.get_label() == "aim, 5 casts before"
    np.testing.assert_allclose(bars.lines[0].get_ydata(), [8, 4, 2, 1], atol=0.8)


def test_regions_are_counted_where_a_method_states_them():
    rows = misses(found(aim=4, simulated=1)).records()
    inside = [(row["in 50 %"], row["in 90 %"]) for row in rows]
    assert inside == [(100.0, 100.0), (0.0, 100.0), (0.0, 0.0), (0.0, 100.0), (None, None)]
