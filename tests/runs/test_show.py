"""Progress of verbs in Python: a line on a terminal and in a notebook, nothing elsewhere."""

import io

import pytest

import cablecast as cc
from cablecast.runs import progress as progress_module
from cablecast.runs.progress import Pace, Progress, show


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Notebook(io.StringIO):
    pass


Notebook.__module__ = "ipykernel.iostream"


@pytest.fixture(autouse=True)
def fresh(monkeypatch):
    monkeypatch.setattr(progress_module, "_pace", Pace())
    monkeypatch.setenv("COLUMNS", "60")


@pytest.mark.parametrize("stream", [Terminal, Notebook])
def test_a_task_has_one_line_until_it_is_done(monkeypatch, stream):
    out = stream()
    monkeypatch.setattr("sys.stderr", out)
    show(Progress(task="2/3 fit to 5 casts"))
    for done in range(6):
        show(Progress(task="Casting", done=done, total=5, unit="casts"))
    first, *casting = out.getvalue().replace("\n", "\r").rstrip("\r").split("\r")
    assert first.rstrip() == "2/3 fit to 5 casts"
    assert casting[0].startswith("Casting: 0 of 5 casts")
    assert casting[-1].startswith("Casting: 5 of 5 casts")
    # What follows a task that is done begins on a line of its own.
    assert out.getvalue().endswith("\n")
    assert max(len(line) for line in casting) < 60


def test_a_verb_shows_its_progress_on_a_terminal_unless_it_is_told_to_ignore_it(monkeypatch):
    out = Terminal()
    monkeypatch.setattr("sys.stderr", out)
    options = {"count": 60, "segment_count": 4, "dt": 4e-3}
    cc.simulate(cc.Setup(), **options)
    assert "60 of 60 casts" in out.getvalue()
    out.truncate(0)
    cc.simulate(cc.Setup(), progress=cc.ignore, **options)
    assert out.getvalue() == ""


def test_a_log_gets_nothing(capfd):
    cc.simulate(cc.Setup(), count=50, segment_count=4, dt=4e-3)
    assert capfd.readouterr() == ("", "")
