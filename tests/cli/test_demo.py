import contextlib
import functools
import io
import json
import pathlib
import re
import shlex

import pytest

import cablecast as cc
from cablecast.cli import main
from cablecast.pipeline import aim_learning
from cablecast.workspace import load_targets

SMALL = [
    *("--tune-count", "2", "--count", "120", "--epochs", "2", "--candidate-count", "200"),
    # No first cast is that near.
    *("--rig", "engine", "--tries", "2", "--within", "0.01"),
]
# What has no option: a brief fit.
SEARCH = cc.FitConfig(start_count=2, coarse_iterations=1, fine_start_count=1, fine_iterations=1)
FEW_TARGETS = 2


@pytest.fixture(scope="module")
def demo(tmp_path_factory, make_engines_coarse):
    """Return a small demo: where it ran, and what it printed."""
    folder = tmp_path_factory.mktemp("demo")
    with pytest.MonkeyPatch.context() as patch:
        few = load_targets()[:: len(load_targets()) // FEW_TARGETS]
        patch.setattr("cablecast.pipeline.demo.load_targets", lambda: few)
        patch.setattr("cablecast.pipeline.evaluate.load_targets", lambda: few)
        patch.setattr("cablecast.pipeline.aim_beliefs._ACTION_COUNT", 5)
        brief = functools.partial(aim_learning.tune, config=SEARCH)
        patch.setattr(aim_learning, "tune", brief)
        make_engines_coarse(patch)
        patch.chdir(folder)
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            assert main(["demo", *SMALL]) == 0
        yield folder, printed.getvalue()


@pytest.mark.slow
def test_the_demo_goes_all_the_way_and_takes_up_what_is_done(demo, capsys):
    folder, first = demo
    root = folder / "runs" / "demo-cable_1"
    assert str(root.relative_to(folder) / "evaluate" / "report.html") in first
    for part in ("calibration", "tune", "dataset", "model", "evaluate"):
        assert json.loads((root / part / "config.json").read_text())["versions"]
        assert (root / part / "metrics.json").is_file()
    tries = json.loads((root / "evaluate" / "metrics.json").read_text())["tries"]
    assert [row["try"] for row in tries] == [1, 2]
    assert (root / "evaluate" / "tries.png").is_file()
    assert len(list((root / "session" / "casts").iterdir())) > 2 + FEW_TARGETS

    # As if the demo had been stopped during its last stage.
    (root / "evaluate" / "metrics.json").unlink()
    assert main(["demo", *SMALL]) == 0
    second = capsys.readouterr()
    assert second.err.count("already done, nothing changed") == 4
    for done in ("epochs", "steps"):
        assert done not in second.err
    assert second.out == first


def test_the_demo_with_tuned_parameters_casts_and_tunes_none(demo):
    folder, _ = demo
    tuned = folder / "runs" / "demo-cable_1" / "tune" / "params.json"
    arguments = ["--params", str(tuned), "--out", str(folder / "other")]
    assert main(["demo", *SMALL, *arguments]) == 0
    assert {path.name for path in (folder / "other").iterdir()} == {
        *("dataset", "model", "session", "evaluate")
    }


# What makes the commands of the README quick, after each verb.
QUICK = {
    "collect": ("--rig", "engine", "--count", "6"),
    "tune": ("--segment-count", "10", "--dt", "0.002"),
    "simulate": ("--count", "120", "--segment-count", "10", "--dt", "0.002"),
    "train": ("--epochs", "2", "--candidate-count", "200"),
    # The small model plans badly.
    "plan": ("--miss-max", "1000"),
    "evaluate": ("--rig", "engine"),
}


def test_the_commands_of_the_readme_run_in_the_folder_of_the_demo(demo, capsys):
    folder, _ = demo
    made = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    readme = (pathlib.Path(__file__).parents[2] / "README.md").read_text()
    block = re.search(r"^## Use it$.*?^```$(.*?)^```$", readme, re.DOTALL | re.MULTILINE)
    lines = block[1].split("\n")
    commands = [shlex.split(line)[1:] for line in lines if line.startswith("cablecast ")]
    assert {words[0] for words in commands} == set(QUICK)
    for words in commands:
        assert main([*words, *QUICK[words[0]]]) == 0, capsys.readouterr().err
    # They leave the results of the demo alone.
    assert all(path.read_bytes() == content for path, content in made.items())
    results = {path.name for path in (folder / "runs" / "cable_1").iterdir()}
    assert results == {"tune-data", "tune", "dataset", "model", "evaluate-engine"}
