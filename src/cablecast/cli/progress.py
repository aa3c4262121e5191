"""Progress on standard error: bars on a terminal, plain lines elsewhere."""

import contextlib
from collections.abc import Iterator
from typing import Any

from cablecast.cli.streams import drain
from cablecast.runs.progress import Pace, Progress, ProgressCallback, duration_text

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
    from rich import progress as rich
    from rich.table import Column

    columns = (
        rich.TextColumn("{task.description}", markup=False),
        rich.BarColumn(),
        rich.MofNCompleteColumn(table_column=Column(no_wrap=True)),
        rich.TextColumn("{task.fields[note]}", markup=False),
        rich.TimeElapsedColumn(),
        rich.TextColumn("{task.fields[left]}", markup=False),
    )
    with rich.Progress(*columns, console=console) as bars:
        yield _Bars(bars).show


class _Bars:
    """Bars for tasks with a count, lines for tasks that are only announced."""

    def __init__(self, bars: Any):
        self._bars = bars
        self._tasks: dict[str, Any] = {}
        self._pace = Pace()

    def show(self, progress: Progress) -> None:
        """Show a report."""
        if not progress.total:
            self._bars.console.print(self._pace.line(progress), highlight=False, markup=False)
            return
        starts = self._pace.starts(progress)
        if progress.task not in self._tasks:
            self._tasks[progress.task] = self._bars.add_task(progress.task, note="", left="")
        elif starts:
            self._bars.reset(self._tasks[progress.task])
        note = " ".join(text for text in (progress.unit, progress.note) if text)
        seconds = None if progress.done == progress.total else self._pace.seconds_left(progress)
        left = "" if seconds is None else f"about {duration_text(seconds)} left"
        done, total = progress.done, progress.total
        task = self._tasks[progress.task]
        self._bars.update(task, completed=done, total=total, note=note, left=left)


class _Lines:
    """Lines with the expected end, at most one every few seconds."""

    def __init__(self, file: Any):
        self._file = file
        self._pace = Pace()

    def show(self, progress: Progress) -> None:
        """Write a line for a report, unless one was written a moment ago."""
        if not self._pace.is_due(progress, _LINE_EVERY):
            return
        try:
            print(self._pace.line(progress), file=self._file, flush=True)
        except BrokenPipeError:
            raise
        except OSError:
            # Progress that cannot be shown, on a full disk for example, is no reason to stop.
            drain(self._file)
