import re

import pytest

from cablecast.datasets import progress as progress_module
from cablecast.datasets.progress import console_progress, duration_text


@pytest.fixture
def clock(monkeypatch):
    """A clock that stands still unless a test sets it [s]."""
    now = [100.0]
    monkeypatch.setattr(progress_module.time, "monotonic", lambda: now[0])
    return now


def test_without_a_terminal_lines_tell_how_long_it_still_takes_and_until_when(clock, capsys):
    with console_progress("Casting") as show:
        show(0, 80)
        clock[0] += 40.0
        show(2, 80)
    first, second = capsys.readouterr().err.splitlines()
    assert first == "Casting: 0 of 80 casts (0 s)"
    # 20 s for each of the 78 that are left are 26 minutes.
    assert re.fullmatch(
        r"Casting: 2 of 80 casts \(40 s, about 26 min to go, until \d\d:\d\d\)", second
    )


def test_what_a_resumed_run_found_done_does_not_count_as_fast(clock, capsys):
    with console_progress("Casting") as show:
        show(70, 80)
        clock[0] += 20.0
        show(71, 80)
        clock[0] += 180.0
        show(80, 80)
    _, second, last = capsys.readouterr().err.splitlines()
    assert "about 3 min to go" in second
    assert last == "Casting: 80 of 80 casts (200 s)"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.4, "0 s"), (99, "99 s"), (100, "2 min"), (3600, "60 min"), (9000, "2.5 h")],
)
def test_durations_read_as_a_person_says_them(seconds, text):
    assert duration_text(seconds) == text
