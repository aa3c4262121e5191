import pytest

from cablecast.cli import main


@pytest.mark.parametrize("fitted", [True, False])
def test_simulating_the_believed_cable_beside_a_fit_says_so(fitted, in_new_folder, capsys):
    if fitted:
        folder = in_new_folder / "runs" / "cable_1" / "tune"
        folder.mkdir(parents=True)
        (folder / "params.json").write_text("{}")
    arguments = ["--count", "60", "--segment-count", "10", "--dt", "0.002"]
    assert main(["simulate", *arguments]) == 0
    assert ("--params runs/cable_1/tune" in capsys.readouterr().out) == fitted
