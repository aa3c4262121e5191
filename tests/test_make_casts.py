"""The data set of casts for others: its layout, its rows, and that it is made with one command."""

import csv
import json
import pathlib
import re
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest
from tools import make_casts

import cablecast as cc
from cablecast.data.dataset import read_dataset
from cablecast.rigs.make import make_rig

ROOT = pathlib.Path(__file__).parents[1]
# What the repository has room for [B].
SAMPLE_SIZE_MAX = 2_000_000


@pytest.mark.slow
@pytest.mark.usefixtures("coarse_engine")
def test_one_command_makes_casts_of_each_kind_with_card_and_licence(tmp_path, monkeypatch, capsys):
    out = tmp_path / "casts"
    options = "--cables cable_1 --labs 0 --calibrations 2 --targets 0 --others 1"
    words = ["make_casts.py", str(out), *options.split(), "--work", str(tmp_path / "work")]
    monkeypatch.setattr(sys, "argv", words)
    # The laboratory takes a second and more for each cast.
    rigs = {"virtual:0": "engine"}
    monkeypatch.setattr(cc, "make_rig", lambda name, setup: make_rig(rigs[name], setup))
    make_casts.main()
    assert "4 casts" in capsys.readouterr().out
    with (out / "meta/casts.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["purpose"] for row in rows] == ["calibration", "calibration", "calm", "wild"]
    # Calm and wild casts are the same motions at another pace.
    assert rows[2]["theta1"] == rows[3]["theta1"]
    assert float(rows[2]["pace"]) < float(rows[3]["pace"]) == 1.0
    made = read_dataset(tmp_path / "work" / "cable_1-0" / "calibration")
    facts, target = ("cable_1", 0.62, 0.011, 0), np.array([0.1, 1.0])
    aimed = make_casts.rows(made, "aim", facts, [target, target])
    assert [row[4:8] for row in aimed] == [("aim", 0.1, 1.0, 1), ("aim", 0.1, 1.0, 2)]
    (first, _) = make_casts.rows(made, "aim", facts, [None, target])
    assert first[4:8] == ("calibration", "", "", "")
    assert len(aimed[0]) == len(make_casts.COLUMNS) - 1
    info = json.loads((out / "meta/info.json").read_text())
    frames = pq.read_table(out / "data")
    assert (info["total_episodes"], info["total_tasks"]) == (4, 1)
    assert info["total_frames"] == len(frames)
    assert frames["index"].to_pylist() == list(range(len(frames)))
    assert sorted(set(frames["episode_index"].to_pylist())) == [0, 1, 2, 3]
    card = (out / "README.md").read_text()
    assert "license: apache-2.0" in card
    stated = card.replace(" --simulated 8000", "").replace(" --tries 3", "")
    assert f"python tools/make_casts.py casts {options}" in stated
    assert "Apache License" in (out / "LICENSE").read_text()
    with pytest.raises(SystemExit):
        make_casts.main()
    assert "give a new folder" in capsys.readouterr().err


def test_the_sample_is_small_and_tells_what_the_page_says(monkeypatch, capsys):
    sample = ROOT / "examples" / "casts"
    files = [file for file in sample.rglob("*") if file.is_file()]
    assert sum(file.stat().st_size for file in files) < SAMPLE_SIZE_MAX
    page = (ROOT / "docs" / "data.md").read_text()
    ((code, told),) = re.findall(
        r"```python\n([^`]*casts\.csv[^`]*)```\n\n```text\n([^`]*)```", page
    )
    monkeypatch.chdir(ROOT)
    exec(compile(code, "data.md", "exec"), {})
    assert capsys.readouterr().out == told
