import re

import pytest

from cablecast.cli.progress import console_progress
from cablecast.runs.progress import Progress, duration_text


@pytest.fixture
def clock(monkeypatch):
    """Return a clock that stands still unless a test sets it [s]."""
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    return now


def casting(done, total=80, **fields):
    return Progress(task="Casting", done=done, total=total, unit="casts", **fields)


def test_without_a_terminal_lines_tell_how_long_it_still_takes_and_until_when(clock, capsys):
    with console_progress() as show:
        show(casting(0))
        clock[0] += 40.0
        show(casting(2))
    first, second = capsys.readouterr().err.splitlines()
    assert first == "Casting: 0 of 80 casts (0 s)"
    # 20 s for each of the 78 that are left are 26 minutes.
    assert re.fullmatch(
        r"Casting: 2 of 80 casts \(40 s, about 26 min left, until \d\d:\d\d\)", second
    )


def test_what_a_resumed_run_found_done_does_not_count_as_fast(clock, capsys):
    with console_progress() as show:
        show(casting(70))
        clock[0] += 20.0
        show(casting(71))
        clock[0] += 180.0
        show(casting(80))
    _, second, last = capsys.readouterr().err.splitlines()
    assert "about 3 min left" in second
    assert last == "Casting: 80 of 80 casts (200 s)"


def test_a_log_gets_the_first_and_the_last_line_and_few_between(clock, capsys):
    with console_progress() as show:
        for done in range(81):
            clock[0] += 0.1
            show(casting(done))
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("Casting: 0 of 80")
    assert lines[-1].startswith("Casting: 80 of 80")
    # 8 s at one line in 2 s.
    assert len(lines) <= 6


def test_work_that_begins_again_has_a_new_clock(clock, capsys):
    with console_progress() as show:
        show(casting(0))
        clock[0] += 800.0
        show(casting(80))
        clock[0] += 900.0
        show(casting(0))
        clock[0] += 20.0
        show(casting(20))
    again, last = capsys.readouterr().err.splitlines()[2:]
    assert again == "Casting: 0 of 80 casts (0 s)"
    assert "(20 s, about 60 s left" in last


def test_a_bar_begins_again_with_its_work(monkeypatch):
    # rich writes bars to a terminal only.
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    with console_progress() as show:
        for done in (0, 80, 0, 20):
            show(casting(done))
        (bar,) = show.__self__._bars.tasks
        assert not bar.finished
        assert bar.completed == 20


def test_work_that_knows_its_own_end_and_state_is_believed(clock, capsys):
    with console_progress() as show:
        show(casting(1, note="best 8.2 %", seconds_left=7200.0))
    assert "casts, best 8.2 % (0 s, about 2.0 h left" in capsys.readouterr().err


def test_work_that_counts_nothing_is_announced_with_its_state(capsys):
    with console_progress() as show:
        show(Progress(task="Tuning cable_1", note="already done, nothing changed"))
    assert capsys.readouterr().err == "Tuning cable_1: already done, nothing changed\n"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.4, "0 s"), (99, "99 s"), (100, "2 min"), (3600, "60 min"), (9000, "2.5 h")],
)
def test_durations_read_as_a_person_says_them(seconds, text):
    assert duration_text(seconds) == text
