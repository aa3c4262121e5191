import csv
import json

import pytest

from cablecast.cli import main
from cablecast.cli.evaluate import Evaluate
from cablecast.cli.options import load_policy
from cablecast.errors import UnknownNameError
from cablecast.workspace import load_targets


@pytest.fixture(scope="module")
def evaluated(model_folder, tmp_path_factory):
    folder = tmp_path_factory.mktemp("evaluated") / "engine"
    arguments = ["--model", str(model_folder), "--rig", "engine", "--out", str(folder)]
    assert main(["evaluate", *arguments]) == 0
    return folder, arguments


def test_an_evaluation_leaves_config_metrics_trials_a_map_and_a_report(evaluated):
    folder, _ = evaluated
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["trial_count"] == 32
    # It simulates as the dataset was simulated.
    assert metrics["rig"]["engine"]["class"] == "EngineWarp"
    assert metrics["rig"]["engine"]["segment_count"] == 10
    with open(folder / "trials.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 32
    assert sum(row["status"] == "ok" for row in rows) == metrics["errors_pct"]["count"]
    assert (folder / "landings.png").read_bytes().startswith(b"\x89PNG")
    assert "<!doctype html>" in (folder / "report.html").read_text()
    config = json.loads((folder / "config.json").read_text())
    assert config["command"] == "evaluate"
    assert config["settings"]["repeats"] == 1
    assert config["settings"]["rig"]["rig"] == "engine"
    assert {"python", "cablecast", "numpy", "warp-lang", "torch"} <= set(config["versions"])


def test_the_same_evaluation_again_shows_its_table_without_casting(evaluated, capsys):
    folder, arguments = evaluated
    before = (folder / "metrics.json").stat().st_mtime_ns
    assert main(["evaluate", *arguments]) == 0
    captured = capsys.readouterr()
    assert "engine rig" in captured.out
    assert str(folder / "report.html") in captured.out
    assert "already done, nothing changed" in captured.err
    assert " of 32 casts" not in captured.err
    assert (folder / "metrics.json").stat().st_mtime_ns == before


def test_an_evaluation_of_other_settings_is_not_written_over_it(evaluated, capsys):
    folder, arguments = evaluated
    before = (folder / "metrics.json").read_bytes()
    assert main(["evaluate", *arguments, "--repeats", "3"]) == 2
    assert "repeats is 1 there and 3 here" in capsys.readouterr().err
    assert (folder / "metrics.json").read_bytes() == before


@pytest.mark.usefixtures("blank_figures")
def test_a_rig_of_ones_own_is_found_in_the_working_folder(model_folder, capsys, lab):
    arguments = ["--model", str(model_folder), *lab.rig, "--out", "result"]
    assert main(["evaluate", *arguments]) == 0
    assert lab.events == ["connected", *["cast"] * 32, "closed"]
    assert "32 casts at 32 targets: 32 ok" in capsys.readouterr().out
    metrics = json.loads((lab.path / "result" / "metrics.json").read_text())
    assert metrics["rig"] == {"rig": "[/] [bold]weiß"}
    assert metrics["status_counts"] == {"ok": 32}


@pytest.mark.usefixtures("coarse_engine", "blank_figures")
def test_polar_casting_is_evaluated_without_a_model(in_new_folder, capsys, monkeypatch):
    few = load_targets()[::4]
    monkeypatch.setattr("cablecast.pipeline.evaluate.load_targets", lambda: few)
    assert main(["evaluate", "--policy", "polar", "--rig", "engine"]) == 0
    folder = in_new_folder / "runs" / "cable_1" / "evaluate-polar-engine"
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["trial_count"] == len(few)
    # It can lay the cable down beyond the edge of the robot's own table only.
    assert 0 < metrics["targets_inside_coverage"] < len(few) / 2
    inside = metrics["errors_inside_coverage_pct"]["median_pct"]
    assert inside < metrics["errors_pct"]["median_pct"]
    page = (folder / "report.html").read_text()
    assert "polar casting" in page
    assert "simulated casts it had not seen" not in page


@pytest.mark.usefixtures("coarse_engine")
def test_an_evaluation_casts_at_targets_of_one_s_own(in_new_folder, capsys):
    (in_new_folder / "lab.yaml").write_text("workspace: {table_width: 1.1}\n")
    arguments = ["evaluate", "--policy", "polar", "--rig", "engine", "--setup", "lab.yaml"]
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert "the paper's targets do not fit this laboratory" in error
    assert "--target R THETA" in error
    assert main([*arguments, "--target", "1.2", "-8", "--target-xy", "0.1", "1.3"]) == 0
    shown = capsys.readouterr().out
    assert "2 casts at 2 targets" in shown
    assert "paper:" not in shown


@pytest.mark.parametrize(
    ("option", "words"),
    [(("--model", "somewhere"), "takes no model"), (("--method", "paper"), "searches nothing")],
)
def test_polar_casting_has_no_model_and_no_method(option, words, in_new_folder, capsys):
    assert main(["evaluate", "--policy", "polar", *option, "--rig", "engine"]) == 2
    assert words in capsys.readouterr().err


def test_another_simulator_casts_the_model_s_cable(model_folder):
    verb = Evaluate(rig="engine:warp")
    policy = load_policy(model_folder, None, None)
    usual = Evaluate(rig="engine")._rig(policy, model_folder / "out")
    with verb._rig(policy, model_folder / "out") as named, usual as opened:
        assert named.description == opened.description
    with pytest.raises(UnknownNameError, match="odd"):
        Evaluate(rig="engine:odd")._rig(policy, model_folder / "out")
