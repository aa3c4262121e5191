"""Every experiment of the paper on a budget that shows nothing but that each stage works."""

import dataclasses
import functools
import json

import pytest

from cablecast.pipeline.reproduce import METHODS, Budget, Reproduced, reproduce
from cablecast.tuning.tune import TuneConfig
from cablecast.workspace import load_targets

pytest.importorskip("matplotlib")
pytest.importorskip("torch")

TINY = Budget(
    cables=("cable_1", "cable_2"),
    tune_casts=4,
    more_casts=1,
    validation_casts=1,
    real_trials=24,
    grid=3,
    grid_psi=3,
    generations=2,
    repeat_actions=2,
    repeat_casts=2,
    casts=100,
    epochs=2,
    candidates=200,
    repeats=1,
)
FEW_TARGETS = 4


@pytest.mark.slow
@pytest.mark.usefixtures("coarse_engine", "brief_adaptation", "blank_figures", "few_casts")
def test_a_tiny_reproduction_is_stopped_goes_on_and_reports_every_method(tmp_path, monkeypatch):
    few = load_targets()[:: 32 // FEW_TARGETS]
    monkeypatch.setattr("cablecast.pipeline.evaluate.load_targets", lambda: few)
    monkeypatch.setattr("cablecast.pipeline.reproduce.load_targets", lambda: few)
    search = functools.partial(TuneConfig, population_size=6)
    monkeypatch.setattr("cablecast.pipeline.reproduce.TuneConfig", search)
    begun = []

    def stop(report):
        begun.append(report.task)
        if "train (real)" in report.task:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reproduce(tmp_path, budget=TINY, rig="engine", progress=stop)
    other = dataclasses.replace(TINY, casts=101)
    with pytest.raises(ValueError, match=r"budget\.casts is 100 there and 101 here"):
        reproduce(tmp_path, budget=other, rig="engine")
    done_before = {path.parent for path in tmp_path.rglob("metrics.json")}
    stamps = {folder: (folder / "metrics.json").stat().st_mtime_ns for folder in done_before}
    reports = []
    reproduced = reproduce(tmp_path, budget=TINY, rig="engine", progress=reports.append)
    # What was done is not done again.
    assert {
        folder: (folder / "metrics.json").stat().st_mtime_ns for folder in done_before
    } == stamps
    assert sum(report.note.startswith("done in") for report in reports) == len(
        [folder for folder in done_before if folder.parent.parent == tmp_path]
    )

    first, second = (reproduced.metrics["evaluations"][cable] for cable in TINY.cables)
    assert set(first) == set(METHODS)
    assert set(second) == {"fine-tuning", "ours"}
    rules = {
        name: json.loads((tmp_path / f"cable_1/evaluate-{name}/config.json").read_text())
        for name in ("fine-tuning", "ours")
    }
    names = {name: config["settings"]["policy"]["name"] for name, config in rules.items()}
    assert names == {"fine-tuning": "equation 1", "ours": "forward search"}
    for values in first.values():
        assert values["trial_count"] == FEW_TARGETS
    chosen = json.loads((tmp_path / "cable_1/select/metrics.json").read_text())["choice"]
    for cable in TINY.cables:
        info = json.loads((tmp_path / cable / "dataset/meta/info.json").read_text())
        assert info["settings"]["motion"]["v_max"] == chosen["v_max"]
        assert info["settings"]["cable"]["name"] == cable
    page = reproduced.report.read_text()
    assert "data:image/svg+xml" in page
    tables = reproduced.tables.read_text()
    for words in ("polar casting", "Gaussian process", "cable_2"):
        assert words in page
        assert words in tables or words == "cable_2"

    again = reproduce(tmp_path, budget=TINY, rig="engine")
    assert again.metrics["evaluations"] == reproduced.metrics["evaluations"]


@pytest.mark.parametrize(
    ("medians", "holds"),
    [
        ({"polar": 44.0, "real": 15.0, "sim": 8.0, "fine-tuning": 9.0}, True),
        ({"polar": 44.0, "real": 8.0, "sim": 10.0, "fine-tuning": 9.0}, False),
        ({"polar": 8.0, "real": 15.0, "sim": 10.0, "fine-tuning": 9.0}, False),
        ({"polar": None, "real": 15.0, "sim": 10.0, "fine-tuning": 9.0}, True),
        ({"polar": 44.0, "real": 15.0, "sim": 10.0, "fine-tuning": None}, False),
    ],
)
def test_the_order_holds_where_simulated_casts_help(tmp_path, medians, holds):
    evaluations = {name: {"errors_pct": {"median_pct": value}} for name, value in medians.items()}
    metrics = {"evaluations": {"cable_1": evaluations}}
    result = Reproduced(path=tmp_path, report=tmp_path, tables=tmp_path, metrics=metrics)
    assert result.holds is holds
    assert list(result.medians_pct.values()) == sorted(result.medians_pct.values())
