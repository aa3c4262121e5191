import json
import re

import pytest

from cablecast.cli import main
from cablecast.runs.folder import RunFolder
from cablecast.setup import Setup

SMALL = ["--grid", "4", "--grid-psi", "3"]


@pytest.fixture(scope="module", autouse=True)
def coarse(make_engines_coarse):
    with pytest.MonkeyPatch.context() as patch:
        make_engines_coarse(patch)
        yield


def write_repeatability(folder, scatters_pct, cable="cable_1"):
    """Return a folder as `cablecast repeat` leaves it, with casts that all stayed on the table."""
    combinations = [
        {
            "r0": 0.6,
            "v_max": v_max,
            "with_psi": with_psi,
            "distance_sd_pct": scatter_pct,
            "off_table_share": 0.0,
        }
        for (v_max, with_psi), scatter_pct in scatters_pct.items()
    ]
    with RunFolder.open(folder, "repeat", Setup(cable=cable).to_settings()).locked() as run:
        run.finish({"combinations": combinations})


@pytest.fixture(scope="module")
def selected(tmp_path_factory):
    """Return a selection without repeatability: its folder and its metrics."""
    out = tmp_path_factory.mktemp("selected") / "select"
    assert main(["select", *SMALL, "--out", str(out)]) == 0
    return out, json.loads((out / "metrics.json").read_text())


def test_select_compares_nine_combinations_and_three_with_a_turn_of_the_wrist(selected):
    out, metrics = selected
    coverage = metrics["coverage"]
    assert len({(row["r0"], row["v_max"]) for row in coverage if not row["with_psi"]}) == 9
    turning = [row for row in coverage if row["with_psi"]]
    assert {row["v_max"] for row in turning} == {1.2, 1.5, 1.8}
    assert {row["r0"] for row in turning} == {metrics["choice"]["r0"]}
    assert all(0.0 <= row["share"] <= 1.0 for row in coverage)
    assert (out / "coverage.png").read_bytes().startswith(b"\x89PNG")


def test_select_takes_up_what_an_earlier_run_measured(selected, capsys):
    out, metrics = selected
    (out / "metrics.json").unlink()
    (out / "coverage" / "r0_1-v_max_1.5.json").unlink()
    assert main(["select", *SMALL, "--out", str(out)]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert "r0 = 1 m, v_max = 1.5 m/s" in lines[0]
    assert "12 of 12 combinations" in lines[1]
    assert json.loads((out / "metrics.json").read_text()) == metrics


def test_repeatability_changes_the_choice(selected, tmp_path, capsys):
    _, metrics = selected
    assert metrics["choice"]["v_max"] > 1.2
    write_repeatability(tmp_path / "repeat", {(1.2, False): 0.1, (1.5, True): 50.0})
    arguments = [*SMALL, "--repeat", str(tmp_path / "repeat"), "--out", str(tmp_path / "other")]
    assert main(["select", *arguments]) == 0
    choice = json.loads((tmp_path / "other" / "metrics.json").read_text())["choice"]
    assert (choice["r0"], choice["v_max"], choice["with_psi"]) == (0.6, 1.2, False)
    assert "settings with a scatter of at most 3 % of cable length" in capsys.readouterr().out


def test_casts_that_were_not_repeated_or_are_of_another_cable_are_refused(tmp_path, capsys):
    write_repeatability(tmp_path / "other", {(1.5, True): 1.0}, cable="cable_2")
    for folder, words in (
        (tmp_path, "holds no finished run of `cablecast repeat`"),
        (tmp_path / "other", "was made with another cable"),
    ):
        arguments = [*SMALL, "--repeat", str(folder), "--out", str(tmp_path / "o")]
        assert main(["select", *arguments]) == 2
        assert words in capsys.readouterr().err


def test_a_cable_that_is_too_long_for_polar_casts_is_compared_all_the_same(
    tmp_path, capsys, monkeypatch
):
    for name, value in (("R0", 1.0), ("V_MAX", 1.5)):
        monkeypatch.setattr(f"cablecast.pipeline.select.{name}_CHOICES", (value,))
    cable, out = tmp_path / "long.yaml", tmp_path / "select"
    cable.write_text("name: long\nlength: 1.21\ndiameter: 0.008\nmass: 0.06\n")
    small = ["--grid", "2", "--grid-psi", "2"]
    assert main(["select", "--cable", str(cable), *small, "--out", str(out)]) == 0
    assert re.search(r"polar casting +0\.0", capsys.readouterr().out)
    assert (out / "coverage.png").is_file()
