"""Work that takes time, one piece at a time, in the thread that made the worker.

A page answers clicks in threads of its own. Casts and long work run in the main thread instead:
there the time limits of rigs hold, and a stop reaches the work as Ctrl-C does,
so that a robot stops, its connection is closed, and stored parts are kept.
"""

import contextlib
import dataclasses
import queue
import re
import signal
import threading
from collections.abc import Callable

from cablecast.errors import CablecastError, InputError
from cablecast.rigs.base import error_line
from cablecast.runs.progress import Pace, Progress, ProgressCallback

Work = Callable[[ProgressCallback], None]

_STEP = re.compile(r"(\d+)/\d+ ")


@dataclasses.dataclass(frozen=True, kw_only=True)
class WorkState:
    """State of the worker, for the page.

    Attributes:
        name: Name of the work under way; empty where there is none.
        progress: Latest report of the work, if it reported.
        seconds_left: Expected time left [s]; None if unknown.
        step: Number of the step that the work said it is at, as in "2/4 fit"; 0 if it has none.
        stopping: Whether the work was stopped and is still tidying up.
        message: End of the last work in one sentence; empty after a success.
    """

    name: str = ""
    progress: Progress | None = None
    seconds_left: float | None = None
    step: int = 0
    stopping: bool = False
    message: str = ""

    @property
    def busy(self) -> bool:
        """True while work is under way or about to start."""
        return bool(self.name)


class Worker:
    """Runs one piece of work at a time.

    Attributes:
        state: Work under way, or the end of the last one.
        notify: Called, in the worker's thread, whenever the state has changed.
    """

    def __init__(self):
        self.state = WorkState()
        self.notify: Callable[[], None] = lambda: None
        self._lock = threading.Lock()
        self._thread = threading.get_ident()
        self._queue: queue.SimpleQueue[Work] = queue.SimpleQueue()
        self._asked_to_stop = False
        self._pace = Pace()

    def submit(self, name: str, work: Work) -> None:
        """Start some work, or refuse it; a person reads its name, e.g. "a cast"."""
        with self._lock:
            if self.state.busy:
                raise InputError(f"the rig is busy: {self.state.name} is under way")
            self.state = WorkState(name=name)
            self._asked_to_stop = False
            self._pace = Pace()
            self._queue.put(work)
        self.notify()

    def stop(self) -> None:
        """Interrupt the work under way, if any, as Ctrl-C would.

        A rig is interrupted where it stands, so that its own `finally` clauses stop the arm. Work
        that is being stopped is not interrupted again: these clauses would be cut off.
        """
        with self._lock:
            if not self.state.busy or self.state.stopping:
                return
            self.state = dataclasses.replace(self.state, stopping=True)
            self._asked_to_stop = True
            # Under the lock, so that the worker finds it asked for.
            signal.pthread_kill(self._thread, signal.SIGINT)

    def forget(self) -> None:
        """Forget how the last work ended: there is other news."""
        with self._lock:
            if not self.state.busy:
                self.state = WorkState()

    def run(self) -> None:
        """Do the work that is submitted, without end.

        Raises:
            KeyboardInterrupt: Somebody at the keyboard stopped the program.
        """
        while True:
            try:
                self._step()
            except KeyboardInterrupt:
                if not self._take_stop():
                    raise
                # It came when the work was just done, or before it started: it must not start.
                with self._lock, contextlib.suppress(queue.Empty):
                    while True:
                        self._queue.get_nowait()
                self._finish("stopped")

    def _step(self) -> None:
        """Wait for some work, and do it."""
        work = self._queue.get()
        try:
            work(self._report)
        except KeyboardInterrupt:
            if not self._take_stop():
                raise
            self._finish(f"stopped: {self.state.name}")
        except CablecastError as error:
            self._finish(str(error))
        except Exception as error:
            # A rig is foreign code, and the page must live on.
            self._finish(error_line(error))
        else:
            self._finish("")

    def _take_stop(self) -> bool:
        with self._lock:
            asked, self._asked_to_stop = self._asked_to_stop, False
        return asked

    def _finish(self, message: str) -> None:
        with self._lock:
            self.state = WorkState(message=message)
        self.notify()

    def _report(self, progress: Progress) -> None:
        self._pace.starts(progress)
        left = self._pace.seconds_left(progress)
        named = _STEP.match(progress.task)
        with self._lock:
            step = int(named[1]) if named else self.state.step
            self.state = dataclasses.replace(
                self.state, progress=progress, seconds_left=left, step=step
            )
        self.notify()
