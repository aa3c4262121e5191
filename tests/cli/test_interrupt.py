"""Ctrl-C ends a verb with what the same command does, and a fit keeps its steps."""

import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time

import pytest
from tests.cli.conftest import SMALL_VERBS
from tools.small_results import SMALL, digests

from cablecast.cli.main import VERBS, _again, main
from cablecast.cli.progress import _Lines
from cablecast.data.record import collect_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.rigs.engine import RigEngine
from cablecast.setup import Setup


@pytest.mark.parametrize("verb", VERBS)
def test_each_verb_says_whether_the_same_command_goes_on(verb):
    words = _again([verb, "--seed", "1"])
    if verb in ("twin", "view"):
        assert words == ""
    else:
        assert ("goes on" in words) != ("anew" in words)
        assert "\n" not in words


# `tools/attack.py kills --interrupt` stops every verb, at any moment, in a process of its own.
@pytest.mark.parametrize("name", SMALL_VERBS)
def test_a_verb_stopped_by_ctrl_c_goes_on_to_the_same_results(name, in_copy, capsys, monkeypatch):
    words, good = SMALL[name], digests(in_copy)
    out = words[words.index("--out") + 1]
    shutil.rmtree(in_copy / out, ignore_errors=True)
    show, reports = _Lines.show, []

    def show_and_stop(lines, progress):
        show(lines, progress)
        reports.append(progress)
        # In the middle of something that takes a while.
        if len(reports) == 3:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(_Lines, "show", show_and_stop)
    assert main([name, *words]) == 130
    assert capsys.readouterr().err.endswith(f"cablecast: interrupted{_again([name])}\n")
    assert main([name, *words]) == 0
    assert digests(in_copy) == good


def test_a_fit_that_is_interrupted_says_that_it_goes_on_and_does(tmp_path):
    rig = RigEngine(EngineWarp(segment_count=10, dt=2e-3), Setup())
    casts = tmp_path / "casts"
    collect_dataset(casts, rig, Setup(), purpose="tune", count=2)
    out = tmp_path / "tune"
    words = ["--dataset", casts, "--out", out, "--segment-count", "10", "--dt", "0.002"]

    def run_to_step(name):
        process = subprocess.Popen(
            [sys.executable, "-m", "cablecast", "tune", *map(str, words)],
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        deadline = time.monotonic() + 120.0
        while not (out / "generations" / name).is_file():
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
        assert said.endswith("cablecast: interrupted. The same command goes on from what is kept\n")
        assert process.returncode == 130
        return said

    run_to_step("0001.json")
    kept = {file: file.stat().st_mtime_ns for file in _steps(out)}
    assert len(kept) >= 2
    run_to_step(f"{len(kept):04}.json")
    # What was kept is not made again.
    assert {file: file.stat().st_mtime_ns for file in kept} == kept


def _steps(out: pathlib.Path):
    return sorted((out / "generations").glob("*.json"))
