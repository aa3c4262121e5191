"""Progress on standard error: bars on a terminal, plain lines elsewhere."""

import contextlib
import datetime
import time
from collections.abc import Iterator
from typing import Any

from cablecast.cli.streams import drain
from cablecast.runs.progress import Progress, ProgressCallback, duration_text

# A log gets a line for the first and the last unit, and at most one in this time between [s].
_LINE_EVERY = 2.0


@contextlib.contextmanager
def console_progress() -> Iterator[ProgressCallback]:
    """Yield a callback that shows the progress of any work on standard error."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        # Not through the console, which would break long lines at 80 columns.
        yield _Lines(console.file).show
        return
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.progress import (
        Progress as Bars,
    )

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    notes = TextColumn("{task.fields[note]}", markup=False)
    # A trial on a robot takes 20 s: the speed must be told from more than the last half minute.
    times = (TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    with Bars(*columns, notes, *times, console=console, speed_estimate_period=600.0) as bars:
        yield _Bars(bars).show


class _Beginnings:
    """Tells where tasks begin: one that has fewer units done than before has begun again."""

    def __init__(self):
        self._done: dict[str, int] = {}

    def begins(self, progress: Progress) -> bool:
        """Return whether a task begins with a report, which is told once."""
        begins = progress.done < self._done.get(progress.task, progress.done + 1)
        self._done[progress.task] = progress.done
        return begins


class _Bars:
    """Bars for tasks with a count, lines for tasks that are only announced."""

    def __init__(self, bars: Any):
        self._bars = bars
        self._tasks: dict[str, Any] = {}
        self._beginnings = _Beginnings()

    def show(self, progress: Progress) -> None:
        """Show a report."""
        if not progress.total:
            self._bars.console.print(_headline(progress), highlight=False, markup=False)
            return
        begins = self._beginnings.begins(progress)
        if progress.task not in self._tasks:
            self._tasks[progress.task] = self._bars.add_task(progress.task, note="")
        elif begins:
            self._bars.reset(self._tasks[progress.task])
        note = " ".join(text for text in (progress.unit, progress.note) if text)
        self._bars.update(
            self._tasks[progress.task], completed=progress.done, total=progress.total, note=note
        )


class _Lines:
    """Lines with the expected end, at most one every few seconds."""

    def __init__(self, file: Any):
        self._file = file
        self._begun: dict[str, tuple[float, int]] = {}
        self._beginnings = _Beginnings()
        self._last = -_LINE_EVERY

    def show(self, progress: Progress) -> None:
        """Write a line for a report, unless one was written a moment ago."""
        now = time.monotonic()
        if not progress.total:
            self._write(_headline(progress))
            return
        is_first = self._beginnings.begins(progress)
        if is_first:
            # Units that a resumed run found done took it no time.
            self._begun[progress.task] = (now, progress.done)
        begun, first_done = self._begun[progress.task]
        is_last = progress.done == progress.total
        if not (is_first or is_last) and now - self._last < _LINE_EVERY:
            return
        self._last = now
        parts = [f"{now - begun:.0f} s"]
        left = progress.seconds_left
        if left is None and first_done < progress.done:
            left = (now - begun) / (progress.done - first_done) * (progress.total - progress.done)
        if left is not None and not is_last:
            end = datetime.datetime.now() + datetime.timedelta(seconds=left)
            parts.append(f"about {duration_text(left)} left, until {end:%H:%M}")
        note = f", {progress.note}" if progress.note else ""
        unit = f" {progress.unit}" if progress.unit else ""
        self._write(
            f"{progress.task}: {progress.done} of {progress.total}{unit}{note} ({', '.join(parts)})"
        )

    def _write(self, line: str) -> None:
        try:
            print(line, file=self._file, flush=True)
        except BrokenPipeError:
            raise
        except OSError:
            # Progress that cannot be shown, on a full disk for example, is no reason to stop.
            drain(self._file)


def _headline(progress: Progress) -> str:
    return f"{progress.task}: {progress.note}" if progress.note else progress.task
