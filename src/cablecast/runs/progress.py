"""Showing progress: a bar on a terminal, plain lines elsewhere."""

import contextlib
import datetime
import time
from collections.abc import Callable, Iterator


@contextlib.contextmanager
def console_progress(label: str, unit: str = "casts") -> Iterator[Callable[[int, int], None]]:
    """A callback that shows how far some work is, on standard error.

    Args:
        label: What is being done.
        unit: What is being counted.

    Yields:
        A function of the number done and the number of all.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    if not console.is_terminal:
        start = time.monotonic()
        first: tuple[float, int] | None = None

        def show_line(done: int, total: int) -> None:
            nonlocal first
            now = time.monotonic()
            if first is None:
                # What a resumed run finds done took it no time.
                first = now, done
            line = f"{label}: {done} of {total} {unit} ({now - start:.0f} s"
            if first[1] < done < total:
                left = (now - first[0]) / (done - first[1]) * (total - done)
                end = datetime.datetime.now() + datetime.timedelta(seconds=left)
                line += f", about {duration_text(left)} to go, until {end:%H:%M}"
            line += ")"
            # Not through the console, which would break long lines at 80 columns.
            print(line, file=console.file, flush=True)

        yield show_line
        return
    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TextColumn(unit))
    # A trial on a robot takes 20 s: the speed must be told from more than the last half minute.
    times = (TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    with Progress(*columns, *times, console=console, speed_estimate_period=600.0) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def duration_text(seconds: float) -> str:
    """A duration as a person says it: 40 s, 12 min, 3.5 h."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
