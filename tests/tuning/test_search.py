import numpy as np
import pytest

from cablecast.errors import InputError
from cablecast.tuning.search import SearchDE, latin_hypercube

DIMENSION = 10
START = np.full(DIMENSION, 0.9)
# Two searches that draw other numbers end at other losses; over several seeds the medians of equal
# methods lie within a factor of ten of each other after the loss has fallen by seven decades.
SAME_METHOD_FACTOR = 10.0


def bowl(points):
    """Return a tilted quadratic bowl whose axes differ a hundredfold, with its bottom at 0.3."""
    axes = np.linalg.qr(np.random.default_rng(0).normal(size=(DIMENSION, DIMENSION)))[0]
    return np.sum((((points - 0.3) @ axes) * np.geomspace(1.0, 10.0, DIMENSION)) ** 2, axis=-1)


def run(generations, seed=0, size=40):
    search = SearchDE(START, size, seed)
    asked = []
    for _ in range(generations):
        candidates = search.ask()
        asked.append(candidates)
        search.tell(candidates, bowl(candidates))
    return search, asked


def test_a_search_finds_the_bottom_of_a_tilted_bowl():
    search, asked = run(300)
    best = search.population[np.argmin(search.losses)]
    np.testing.assert_allclose(best, 0.3, atol=1e-3)
    assert all(np.all((points >= 0.0) & (points <= 1.0)) for points in asked)


def test_the_seed_alone_decides_what_is_asked_for():
    (_, first), (_, again), (_, other) = run(5), run(5), run(5, seed=1)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_differential_evolution_falls_as_fast_as_scipys():
    from scipy.optimize import differential_evolution

    generations, size = 150, 40
    ours = [run(generations, seed, size)[0].losses.min() for seed in range(5)]
    theirs = [
        differential_evolution(
            lambda x: bowl(x.T),
            [(0.0, 1.0)] * DIMENSION,
            popsize=size // DIMENSION,
            maxiter=generations - 1,
            tol=0.0,
            polish=False,
            updating="deferred",
            vectorized=True,
            rng=seed,
        ).fun
        for seed in range(5)
    ]
    ratio = np.median(ours) / np.median(theirs)
    assert 1 / SAME_METHOD_FACTOR < ratio < SAME_METHOD_FACTOR


def test_members_of_the_population_never_get_worse():
    search = SearchDE(START, 12, 0)
    losses = np.full(12, np.inf)
    for _ in range(20):
        candidates = search.ask()
        search.tell(candidates, bowl(candidates))
        assert np.all(search.losses <= losses)
        losses = search.losses


def test_the_starting_point_is_among_the_first_candidates():
    np.testing.assert_array_equal(SearchDE(START, 12, 0).ask()[0], START)


def test_a_search_has_converged_where_scipys_would_stop():
    search, _ = run(1)
    assert not search.converged
    search.losses = 2.0 + np.array([0.0, 0.04])
    assert search.converged
    search.losses = 2.0 + np.array([0.0, 0.05])
    assert not search.converged


def test_a_latin_hypercube_has_one_point_in_each_interval():
    points = latin_hypercube(17, 3, np.random.default_rng(0))
    for column in points.T:
        assert sorted((column * 17).astype(int)) == list(range(17))


def test_tiny_populations_and_negative_seeds_are_refused():
    with pytest.raises(InputError, match="population_size = 3"):
        SearchDE(START, 3, 0)
    with pytest.raises(InputError, match="seed = -1"):
        SearchDE(START, 10, -1)
