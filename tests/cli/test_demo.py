import contextlib
import io
import json

import pytest

from cablecast.cli import main

SMALL = [
    *("--tune-count", "6", "--count", "120", "--epochs", "2", "--candidate-count", "200"),
    *("--rig", "engine"),
]


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """Return a small demo: where it ran, and what it printed."""
    folder = tmp_path_factory.mktemp("demo")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cablecast.pipeline.demo.COARSE_GENERATIONS", 1)
        patch.setattr("cablecast.pipeline.demo.FINE_GENERATIONS", 1)
        patch.chdir(folder)
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            assert main(["demo", *SMALL]) == 0
        yield folder, printed.getvalue()


def test_the_demo_goes_all_the_way_and_takes_up_what_is_done(demo, capsys):
    folder, first = demo
    root = folder / "runs" / "demo-cable_1"
    assert str(root.relative_to(folder) / "evaluate" / "report.html") in first
    for part in ("tune-data", "tune", "dataset", "model", "evaluate"):
        assert json.loads((root / part / "config.json").read_text())["versions"]
        assert (root / part / "metrics.json").is_file()

    # As if the demo had been stopped during its last stage.
    (root / "evaluate" / "metrics.json").unlink()
    assert main(["demo", *SMALL]) == 0
    second = capsys.readouterr()
    assert second.err.count("already done, nothing changed") == 2
    for done in ("epochs", "generations"):
        assert done not in second.err
    assert second.out == first


def test_the_demo_with_tuned_parameters_casts_and_tunes_none(demo):
    folder, _ = demo
    tuned = folder / "runs" / "demo-cable_1" / "tune" / "params.json"
    arguments = ["--params", str(tuned), "--out", str(folder / "other")]
    assert main(["demo", *SMALL, *arguments]) == 0
    assert {path.name for path in (folder / "other").iterdir()} == {
        *("dataset", "model", "evaluate")
    }
