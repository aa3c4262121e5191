"""Player: moves figures through their casts in time, 25 times a second."""

import threading
import time
from collections.abc import Callable, Sequence
from typing import Protocol

from cablecast.view.shown import ShownCast

FRAMES_PER_SECOND = 25.0
PAUSE = 0.8
"""Time that the end of a cast is shown before it begins again [s]."""


class Figure(Protocol):
    """Something that can show a cast at an instant."""

    def show(self, cast: ShownCast, time: float) -> None:
        """Show a cast at a time [s]."""
        ...


class Player:
    """Plays casts side by side in a thread of its own.

    Args:
        on_frame: Called with the time [s] at every frame, e.g. to move a slider.

    Attributes:
        time: Time that is shown [s].
        speed: Shown seconds per second.
        playing: True while the time runs.
        frame_count: Number of frames shown so far.
    """

    def __init__(self, on_frame: Callable[[float], None] | None = None):
        self.time = 0.0
        self.speed = 1.0
        self.playing = False
        self.frame_count = 0
        self._on_frame = on_frame or (lambda time: None)
        self._acts: list[tuple[Figure, ShownCast]] = []
        self._rounds = 1
        self._done: Callable[[], None] | None = None
        self._lock = threading.RLock()
        self._wake = threading.Event()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="player", daemon=True)
        self._thread.start()

    @property
    def duration(self) -> float:
        """Length of the longest cast [s]."""
        return max((cast.duration for _, cast in self._acts), default=0.0)

    def play(
        self,
        acts: Sequence[tuple[Figure, ShownCast]],
        *,
        rounds: int = 1,
        start: float = 0.0,
        done: Callable[[], None] | None = None,
    ) -> None:
        """Play casts from a time on, instead of what is playing.

        Args:
            acts: Figures and their casts.
            rounds: Number of times that the casts are played, with a pause between.
            start: Time to begin at [s].
            done: Called at the first end, in the player's thread; it must not wait.
        """
        with self._lock:
            self._acts, self._rounds, self._done = list(acts), rounds, done
            self.time, self.playing = start, True
            self._draw()
        self._wake.set()

    def show(self, acts: Sequence[tuple[Figure, ShownCast]], at: float) -> None:
        """Show casts at a time [s], at rest."""
        with self._lock:
            self._acts, self.playing, self._done = list(acts), False, None
            self.time = at
            self._draw()

    def seek(self, at: float) -> None:
        """Show another time [s], at rest."""
        with self._lock:
            self.playing, self.time = False, min(max(at, 0.0), self.duration)
            self._draw()

    def toggle(self) -> None:
        """Halt, or go on; at the end begin again."""
        with self._lock:
            if not self.playing and self.time >= self.duration:
                self.time = 0.0
            self.playing = not self.playing and bool(self._acts)
        self._wake.set()

    def close(self) -> None:
        """End the thread."""
        self._ended = True
        self._wake.set()
        self._thread.join(timeout=2.0)

    def _draw(self) -> None:
        for figure, cast in self._acts:
            figure.show(cast, self.time)
        self.frame_count += 1
        self._on_frame(self.time)

    def _run(self) -> None:
        before = time.monotonic()
        while not self._ended:
            if not self.playing:
                self._wake.wait()
                self._wake.clear()
                before = time.monotonic()
                continue
            now = time.monotonic()
            with self._lock:
                if self.playing:
                    self._advance(now - before)
            before = now
            # What drawing took is part of the frame.
            time.sleep(max(0.002, 1.0 / FRAMES_PER_SECOND - (time.monotonic() - now)))

    def _advance(self, seconds: float) -> None:
        end = self.duration
        at_end = self.time >= end
        # Between two rounds the time runs on through the pause.
        self.time += self.speed * seconds
        if self.time >= end and not at_end and self._done is not None:
            self._done()
        if self._rounds > 1 and self.time >= end + PAUSE * self.speed:
            self.time, self._rounds = 0.0, self._rounds - 1
        elif self._rounds <= 1 and self.time >= end:
            self.time, self.playing = end, False
        self._draw()
