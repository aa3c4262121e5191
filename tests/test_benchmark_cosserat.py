"""EngineWarp among the solvers of another author's tests, where these are installed."""

import pytest

pytest.importorskip("cosseratbench")

from benchmarks.cosserat import Args, cosserat

# Ten times what the engine errs by.
TOLERANCES = {"cantilever": 1e-3, "pendulum": 1e-3, "catenary": 5e-3}


@pytest.mark.parametrize("name", TOLERANCES)
def test_an_experiment_is_played_within_its_tolerance(name):
    (table,) = cosserat(Args(experiments=(name,), solvers=("cablecast",)))
    row = table.records()[0]
    assert row["outcome"] == "completed"
    errors = [float(word.split()[1]) for word in row["errors"].split("; ")]
    assert abs(errors[0]) < TOLERANCES[name]


@pytest.mark.parametrize("name", ["twist", "capstan", "crossing", "pile"])
def test_what_the_engine_does_not_play_is_declared(name):
    (table,) = cosserat(Args(experiments=(name,)))
    (row,) = table.records()
    assert (row["solver"], row["outcome"]) == ("cablecast", "unsupported")
