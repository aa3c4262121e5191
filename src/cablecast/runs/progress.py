"""Progress of long work: the event, its callback, and stages with their times and expected end."""

import contextlib
import dataclasses
import datetime
import math
import pathlib
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence

from cablecast.runs.folder import METRICS_FILE, Parts


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

DONE_NOTE = "already done, nothing changed"


def ignore(progress: Progress) -> None:
    """Ignore a report: `progress=cc.ignore` lets a verb say nothing."""
    del progress


class Pace:
    """Times of tasks, and the time that they still take at the rate of their reports."""

    def __init__(self):
        # Time and units done at the first report, which a resumed run found done, and units done.
        self._tasks: dict[str, tuple[float, int, int]] = {}
        self._shown = -math.inf

    def starts(self, progress: Progress) -> bool:
        """Take note of a report, and return whether its task starts with it.

        A task that has fewer units done than before has started again.
        """
        done = progress.done
        start, first, last = self._tasks.get(progress.task, (0.0, 0, done + 1))
        starts = done < last
        if starts:
            start, first = time.monotonic(), done
        self._tasks[progress.task] = (start, first, done)
        return starts

    def is_due(self, progress: Progress, every: float) -> bool:
        """Take note of a report, and return whether to show it: at most one in some time [s].

        An announcement, and the first and the last report of a task, are always due.
        """
        starts, now = progress.total > 0 and self.starts(progress), time.monotonic()
        if not starts and progress.done != progress.total and now - self._shown < every:
            return False
        self._shown = now
        return True

    def seconds(self, progress: Progress) -> float:
        """Return the time since the start of a report's task [s]."""
        return time.monotonic() - self._tasks[progress.task][0]

    def seconds_left(self, progress: Progress) -> float | None:
        """Return the time that a report's task still takes [s]; None if unknown."""
        _, first, done = self._tasks[progress.task]
        if progress.seconds_left is not None or done <= first:
            return progress.seconds_left
        return self.seconds(progress) / (done - first) * (progress.total - done)

    def line(self, progress: Progress) -> str:
        """Return a line for a report that was taken note of, with the expected end."""
        if not progress.total:
            return f"{progress.task}: {progress.note}" if progress.note else progress.task
        parts = [f"{self.seconds(progress):.0f} s"]
        left = self.seconds_left(progress)
        if left is not None and progress.done != progress.total:
            end = datetime.datetime.now() + datetime.timedelta(seconds=left)
            parts.append(f"about {duration_text(left)} left, until {end:%H:%M}")
        note = f", {progress.note}" if progress.note else ""
        count = f"{progress.done} of {progress.total} {progress.unit}".rstrip()
        return f"{progress.task}: {count}{note} ({', '.join(parts)})"


_NOTEBOOK = "ipykernel.iostream"
_EVERY = 0.1  # Time between two reports that are shown [s].
_pace = Pace()


def show(progress: Progress) -> None:
    """Show a report on one line of a terminal or a notebook, and nowhere else; verbs do so.

    The line is written over until its task is done, unless it was written a moment ago.
    """
    stream = sys.stderr
    if stream is None or not (stream.isatty() or type(stream).__module__ == _NOTEBOOK):
        return
    if not _pace.is_due(progress, _EVERY):
        return
    ends = progress.done == progress.total
    width = shutil.get_terminal_size().columns - 1
    # The next line, whoever writes it, begins where this one does.
    stream.write(f"{_pace.line(progress)[:width]:{width}}" + ("\n" if ends else "\r"))
    stream.flush()


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


_STAGES = "stages"


@dataclasses.dataclass(frozen=True, kw_only=True)
class FolderStage:
    """One run folder, and the work that fills it.

    Attributes:
        name: Unique short name, which is also the path of its folder within the whole.
        title: Description for people.
        folder: Run folder; the stage is done when it holds metrics.json.
        expected: Rough duration on two cores [s]; used only for the expected end.
        work: Function that runs the verb, which resumes an earlier run.
    """

    name: str
    title: str
    folder: pathlib.Path
    expected: float
    work: Callable[[], None]

    @property
    def done(self) -> bool:
        """True if the results exist."""
        return (self.folder / METRICS_FILE).is_file()


class StageLog:
    """Time that each stage has taken so far over all runs, kept on the disk when it ends."""

    def __init__(self, folder: pathlib.Path):
        self._parts = Parts(folder, remedy="Delete it; only times are lost")
        self.seconds: dict[str, float] = self._parts.get(_STAGES) or {}

    @contextlib.contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Add the time that a stage takes to the time that earlier runs spent on it."""
        before, start = self.seconds.get(name, 0.0), time.monotonic()
        try:
            yield
        finally:
            self.seconds[name] = round(before + time.monotonic() - start, 1)
            self._parts.put(_STAGES, self.seconds)


def run_stages(
    stages: Sequence[FolderStage], folder: pathlib.Path, report: ProgressCallback = ignore
) -> StageLog:
    """Run the stages that are not done yet, in order, and return their times.

    Each may read the results of earlier ones. A stage that follows one that had work to do is run
    even if it is done: what it read may have been made again. A verb compares that with its
    settings, and computes nothing where it is equal. Before each stage, the progress of the whole
    is reported.
    """
    log = StageLog(folder)
    is_changed = False
    for place, stage in enumerate(stages):
        task = f"[{place + 1}/{len(stages)}] {stage.title}"
        if stage.done and not is_changed:
            taken = duration_text(log.seconds.get(stage.name, 0.0))
            report(Progress(task=task, note=f"done in {taken}"))
            continue
        is_changed = True
        left = remaining_time(stages, log)
        end = datetime.datetime.now().astimezone() + datetime.timedelta(seconds=left)
        note = f"the whole: about {duration_text(left)} left, until {end:%H:%M}"
        report(Progress(task=task, note=note))
        with log.timed(stage.name):
            stage.work()
    return log


def remaining_time(stages: Sequence[FolderStage], log: StageLog) -> float:
    """Return the expected time of the stages that are not done [s], at the pace of this machine."""
    done = [stage for stage in stages if stage.done and stage.name in log.seconds]
    expected = sum(stage.expected for stage in done)
    taken = sum(log.seconds[stage.name] for stage in done)
    # The first minutes say little about a machine: give the expectation the weight of one minute.
    pace = (taken + 60.0) / (expected + 60.0)
    return sum(
        max(pace * stage.expected - log.seconds.get(stage.name, 0.0), 0.1 * pace * stage.expected)
        for stage in stages
        if not stage.done
    )
