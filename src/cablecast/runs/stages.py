"""Running stages one after the other: which are done, how long each took, the expected end."""

import contextlib
import dataclasses
import datetime
import pathlib
import threading
import time
from collections.abc import Callable, Iterator, Sequence

from cablecast.errors import DamagedFileError
from cablecast.files import write_json
from cablecast.reading import read_json
from cablecast.runs.folder import METRICS_FILE
from cablecast.runs.progress import Progress, ProgressCallback, duration_text, ignore

STAGES_FILE = "stages.json"

# How often the time of a running stage is stored [s]: what a kill can lose of it.
_STORE_EVERY = 5.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stage:
    """One run folder and how to fill it.

    Attributes:
        name: Short name, unique; also where its folder lies within the whole.
        title: What is done, for people.
        folder: Its run folder; metrics.json in it says that the stage is done.
        expected: How long it takes [s], roughly, on two cores; only for the expected end.
        work: Runs the verb, which takes up what an earlier run of it has left.
    """

    name: str
    title: str
    folder: pathlib.Path
    expected: float
    work: Callable[[], None]

    @property
    def done(self) -> bool:
        """Whether its results are there."""
        return (self.folder / METRICS_FILE).is_file()


class StageLog:
    """Keeps on the disk how long each stage has taken so far, over all runs.

    Args:
        folder: Where stages.json lies.
    """

    def __init__(self, folder: pathlib.Path):
        self._file = folder / STAGES_FILE
        self._lock = threading.Lock()
        self.seconds: dict[str, float] = {}
        with contextlib.suppress(FileNotFoundError):
            try:
                stored = read_json(self._file)
                self.seconds = {name: float(value) for name, value in stored.items()}
            except (ValueError, TypeError) as error:
                raise DamagedFileError(
                    f"{self._file} is damaged ({str(error)[:100]}): delete it, only times are lost"
                ) from None

    @contextlib.contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Add the time that a stage takes to what earlier runs spent on it."""
        before, start = self.seconds.get(name, 0.0), time.monotonic()
        ended = threading.Event()

        def store() -> None:
            with self._lock:
                self.seconds[name] = round(before + time.monotonic() - start, 1)
                write_json(self._file, self.seconds)

        def store_often() -> None:
            while not ended.wait(_STORE_EVERY):
                # A full disk is reported by the stage itself, which has more to lose.
                with contextlib.suppress(OSError):
                    store()

        thread = threading.Thread(target=store_often, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
            store()


def run_stages(
    stages: Sequence[Stage], folder: pathlib.Path, report: ProgressCallback = ignore
) -> StageLog:
    """Run the stages that are not done yet, in order.

    Args:
        stages: All of them; a stage may read what the ones before it wrote.
        folder: Folder in which the times are kept.
        report: Told before each stage how far the whole is.

    Returns:
        Time that each stage took.
    """
    log = StageLog(folder)
    for place, stage in enumerate(stages):
        task = f"[{place + 1}/{len(stages)}] {stage.title}"
        if stage.done:
            taken = duration_text(log.seconds.get(stage.name, 0.0))
            report(Progress(task=task, note=f"done in {taken}"))
            continue
        left = remaining_time(stages, log)
        end = datetime.datetime.now().astimezone() + datetime.timedelta(seconds=left)
        note = f"all of it: about {duration_text(left)} more, until {end:%H:%M}"
        report(Progress(task=task, note=note))
        with log.timed(stage.name):
            stage.work()
    return log


def remaining_time(stages: Sequence[Stage], log: StageLog) -> float:
    """How long the stages that are not done will take [s].

    The expected times are scaled by how much slower or faster this machine was so far.

    Args:
        stages: All stages.
        log: How long each has taken so far.
    """
    done = [stage for stage in stages if stage.done and stage.name in log.seconds]
    expected = sum(stage.expected for stage in done)
    taken = sum(log.seconds[stage.name] for stage in done)
    # The first minutes say little of a machine: let what was expected weigh as much as one minute.
    pace = (taken + 60.0) / (expected + 60.0)
    return sum(
        max(pace * stage.expected - log.seconds.get(stage.name, 0.0), 0.1 * pace * stage.expected)
        for stage in stages
        if not stage.done
    )
