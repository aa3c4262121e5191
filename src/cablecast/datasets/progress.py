"""Showing progress: a bar on a terminal, plain lines elsewhere."""

import contextlib
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
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        start = time.monotonic()

        def show_line(done: int, total: int) -> None:
            elapsed = time.monotonic() - start
            line = f"{label}: {done} of {total} {unit} ({elapsed:.0f} s)"
            # Not through the console, which would break long lines at 80 columns.
            print(line, file=console.file, flush=True)

        yield show_line
        return
    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TextColumn(unit))
    with Progress(*columns, TimeElapsedColumn(), console=console) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
