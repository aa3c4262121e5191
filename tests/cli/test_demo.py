import json

from cablecast.cli import main

SMALL = ["--count", "200", "--epochs", "3", "--candidate-count", "300", "--rig", "engine"]


def test_the_demo_simulates_trains_evaluates_and_takes_up_what_is_done(capsys, in_new_folder):
    assert main(["demo", *SMALL]) == 0
    first = capsys.readouterr()
    root = in_new_folder / "runs" / "cable_1"
    assert str(root.relative_to(in_new_folder) / "evaluate-engine" / "report.html") in first.out
    for part in ("dataset", "model", "evaluate-engine"):
        assert json.loads((root / part / "config.json").read_text())["versions"]
        assert (root / part / "metrics.json").is_file()

    # As if the demo had been stopped during its last stage.
    (root / "evaluate-engine" / "metrics.json").unlink()
    assert main(["demo", *SMALL]) == 0
    second = capsys.readouterr()
    assert "Casting" in second.err
    assert "Training" not in second.err
    assert second.out.split("metrics")[0] == first.out.split("metrics")[0]
