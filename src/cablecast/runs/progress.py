"""Progress of long work: one event, and one kind of callback for every verb."""

import dataclasses
from collections.abc import Callable


@dataclasses.dataclass(frozen=True, kw_only=True)
class Progress:
    """One report on the progress of some work.

    Attributes:
        task: Name of the work, e.g. "Simulating cable_1".
        done: Units done.
        total: Units in total; 0 for work that is only announced.
        unit: Name of a unit, e.g. "casts".
        note: State of the work in a few words, e.g. the best loss so far.
        seconds_left: Expected time left [s]; None to estimate it from the rate of the reports.
    """

    task: str
    done: int = 0
    total: int = 0
    unit: str = ""
    note: str = ""
    seconds_left: float | None = None


ProgressCallback = Callable[[Progress], None]
"""Callback that receives the progress of some work."""

CountCallback = Callable[[int, int], None]
"""Callback that receives the number of units done and the total."""

DONE_NOTE = "already done, nothing changed"


def ignore(progress: Progress) -> None:
    """Ignore a report; the default where no callback is given."""
    del progress


def counter(report: ProgressCallback | None, task: str, unit: str) -> CountCallback | None:
    """Return a callback of two numbers that reports the progress of a task.

    Args:
        report: Callback for the progress; None for no callback.
        task: Name of the work.
        unit: Name of a unit.
    """
    if report is None:
        return None
    return lambda done, total: report(Progress(task=task, done=done, total=total, unit=unit))


def resumed_counter(report: ProgressCallback | None, task: str, unit: str) -> CountCallback | None:
    """Return a callback of two numbers for work that an earlier run may have done.

    The work calls it first before its first unit. If nothing is left then, the callback says so.

    Args:
        report: Callback for the progress; None for no callback.
        task: Name of the work.
        unit: Name of a unit.
    """
    count = counter(report, task, unit)
    if report is None or count is None:
        return None
    calls = 0

    def show(done: int, total: int) -> None:
        nonlocal calls
        calls += 1
        if calls == 1 and done == total:
            report(Progress(task=task, note=DONE_NOTE))
        else:
            count(done, total)

    return show


def duration_text(seconds: float) -> str:
    """Return a duration in words.

    >>> duration_text(40), duration_text(720), duration_text(12600)
    ('40 s', '12 min', '3.5 h')
    """
    if seconds < 100:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
