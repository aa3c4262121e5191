"""Verifying goes the way of the headline on small data, and compares with it."""

import functools
import pathlib
import re

import pytest

from cablecast.cli import main
from cablecast.errors import InputError
from cablecast.pipeline.verify import Verification, VerifyBudget, read_headline, verify
from cablecast.tuning.tune import TuneConfig
from cablecast.workspace import load_targets

TINY = VerifyBudget(
    tune_count=4,
    coarse_generations=1,
    fine_generations=1,
    count=100,
    epochs=2,
    real_count=32,
    candidate_count=200,
)


@pytest.mark.slow
@pytest.mark.usefixtures("coarse_engine", "blank_figures")
def test_a_run_is_compared_with_the_headline(tmp_path, monkeypatch):
    few = load_targets()[::8]
    monkeypatch.setattr("cablecast.pipeline.evaluate.load_targets", lambda: few)
    search = functools.partial(TuneConfig, population_size=6, fine_population_size=6)
    monkeypatch.setattr("cablecast.pipeline.verify.TuneConfig", search)
    # The virtual rig takes a second and more for each cast.
    result = verify(budget=TINY, rig="engine", out=tmp_path / "run")
    headline = read_headline()["figures"]
    assert [name for name, _, _ in result.rows] == list(headline)
    median = result.measured["median error"]
    assert result.difference_pct == pytest.approx(median - headline["median error"])
    quartiles = [result.measured[name] for name in ("first quartile", "third quartile")]
    assert quartiles[0] <= median <= quartiles[1]


def test_the_headline_is_that_of_the_readme():
    readme = (pathlib.Path(__file__).parents[2] / "README.md").read_text()
    headline = read_headline()
    row = re.search(rf"^\| \*\*{headline['cable']}\*\*, .*$", readme, re.MULTILINE)
    assert row
    stated = [float(cell) for cell in re.findall(r"\| \*\*([\d.]+)\*\*", row[0])]
    assert stated[:3] == list(headline["figures"].values())


def test_the_headline_of_another_cable_is_refused():
    with pytest.raises(InputError, match="cable_1, not of cable_2"):
        verify(budget=VerifyBudget(cable="cable_2"))


def test_the_exit_status_tells_a_difference(monkeypatch, capsys, tmp_path):
    headline = read_headline()["figures"]
    measured = {name: value + 17.0 for name, value in headline.items()}
    result = Verification(measured=measured, headline=headline)
    monkeypatch.setattr("cablecast.pipeline.verify.verify", lambda **_: result)
    assert main(["verify", "--out", str(tmp_path)]) == 3
    assert "+17.0" in capsys.readouterr().out
    assert main(["verify", "--out", str(tmp_path), "--difference-max", "18"]) == 0
