"""Ctrl-C ends a verb with what the same command does, and a fit keeps its steps."""

import itertools
import os
import shutil
import signal

import pytest
from tests.cli.conftest import SMALL_VERBS
from tools.small_results import SMALL, digests

from cablecast.cli.main import VERBS, _again, main
from cablecast.cli.progress import _Lines
from cablecast.data.record import collect_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.rigs.engine import RigEngine
from cablecast.setup import Setup


def test_each_verb_says_whether_the_same_command_goes_on():
    for verb in VERBS:
        words = _again([verb, "--seed", "1"])
        if verb in ("twin", "view"):
            assert words == ""
        else:
            assert ("goes on" in words) != ("anew" in words), verb
            assert "\n" not in words


@pytest.fixture
def stop_when(monkeypatch):
    """Return a function that has Ctrl-C pressed at the first progress of which something holds."""
    show = _Lines.show

    def arrange(holds):
        pressed = []

        def show_and_stop(lines, progress):
            show(lines, progress)
            if not pressed and holds():
                pressed.append(progress)
                os.kill(os.getpid(), signal.SIGINT)

        monkeypatch.setattr(_Lines, "show", show_and_stop)

    return arrange


# `tools/attack.py kills --interrupt` stops every verb, at any moment, in a process of its own.
@pytest.mark.parametrize("name", SMALL_VERBS)
def test_a_verb_stopped_by_ctrl_c_goes_on_to_the_same_results(name, in_copy, capsys, stop_when):
    words, good = SMALL[name], digests(in_copy)
    out = words[words.index("--out") + 1]
    shutil.rmtree(in_copy / out, ignore_errors=True)
    # In the middle of something that takes a while.
    reports = itertools.count(1)
    stop_when(lambda: next(reports) == 3)
    assert main([name, *words]) == 130
    assert capsys.readouterr().err.endswith(f"cablecast: interrupted{_again([name])}\n")
    assert main([name, *words]) == 0
    assert digests(in_copy) == good


def test_a_fit_that_is_interrupted_goes_on_from_its_steps(tmp_path, capsys, stop_when):
    rig = RigEngine(EngineWarp(segment_count=10, dt=2e-3), Setup())
    casts, out = tmp_path / "casts", tmp_path / "tune"
    collect_dataset(casts, rig, Setup(), purpose="tune", count=2)
    words = ["--dataset", casts, "--out", out, "--segment-count", "10", "--dt", "0.002"]

    def run_to_step(number):
        step = out / "generations" / f"{number:04}.json"
        stop_when(step.is_file)
        assert main(["tune", *map(str, words)]) == 130
        assert capsys.readouterr().err.endswith("goes on from what is kept\n")
        return {file: file.stat().st_mtime_ns for file in step.parent.glob("*.json")}

    kept = run_to_step(1)
    assert len(kept) >= 2
    # What was kept is not made again.
    assert kept.items() < run_to_step(len(kept)).items()
